//! Textures: images in linear RGB, looked up at (u, v) or averaged over an area.
//!
//! Negative texels are kept and counted.

use std::path::Path;

use glam::{DVec2, Vec3};

use super::image_file::{self, DecodedImage, ImageRequest, TextureSize};
use super::mip_map::{self, Footprint, MipMap};
use super::points::Lanes3;
use super::tiles::Tiles;
use crate::error::Result;
use crate::ray::LANES;
use crate::scene::{Filter, Wrap};

/// An image, and smaller copies of it where it is averaged over areas.
#[derive(Debug, Clone)]
pub struct Texture {
    file: DecodedImage,
    mip_map: Option<Box<MipMap>>,
    whole: u64,
}

impl Texture {
    /// Memory that the image at `path` needs, from its header alone.
    ///
    /// # Errors
    /// The errors of [`Texture::load`] that concern the header.
    pub fn size(path: &Path) -> Result<TextureSize> {
        Self::size_in_tiles(path, u64::MAX)
    }

    /// The same for an image that is kept in tiles if it has more than `whole` texels.
    pub fn size_in_tiles(path: &Path, whole: u64) -> Result<TextureSize> {
        Ok(image_file::size(path, whole)?.1)
    }

    /// Reads a whole image that needs at most `max_bytes` while it is decoded. The `gAMA` chunk of
    /// a PNG counts.
    pub fn load_within(path: &Path, max_bytes: u64) -> Result<Self> {
        Ok(Self::new(image_file::read_by_gamma(path, max_bytes)?, u64::MAX))
    }

    /// Reads an image. One that is kept in tiles lies in a temporary file, and memory is taken only
    /// for the texels that threads looked at last.
    pub fn load(request: ImageRequest) -> Result<Self> {
        Ok(Self::new(image_file::read(request)?, request.whole))
    }

    fn new(file: DecodedImage, whole: u64) -> Self {
        Self { file, mip_map: None, whole }
    }

    /// Width in texels, >= 1.
    pub fn width(&self) -> u32 {
        self.file.image.size().0
    }

    /// Height in texels, >= 1.
    pub fn height(&self) -> u32 {
        self.file.image.size().1
    }

    /// The image as it was read from its file.
    pub fn file(&self) -> &DecodedImage {
        &self.file
    }

    /// Memory of the texels and of the smaller copies, in bytes.
    pub fn bytes(&self) -> u64 {
        self.file.image.bytes() + self.mip_map.as_ref().map_or(0, |map| map.bytes())
    }

    /// Linear RGB at (u, v). u points right, v points down from the first row; the image is [0,
    /// 1]^2.
    ///
    /// Any u, v are safe: NaN gives texel 0 of its axis, huge values give some texel of the image.
    pub fn lookup(&self, u: f64, v: f64, filter: Filter, wrap_u: Wrap, wrap_v: Wrap) -> Vec3 {
        let (uv, wrap) = (DVec2::new(u, v), [wrap_u, wrap_v]);
        match filter {
            Filter::Nearest => self.file.image.nearest(uv, wrap),
            Filter::Bilinear | Filter::Trilinear => self.file.image.bilinear(uv, wrap),
        }
    }

    /// Mean colour over an area around `uv`. Without [`Texture::make_mip_map`] it is the colour at
    /// `uv`.
    pub fn lookup_area(&self, uv: DVec2, area: &Footprint, wrap: [Wrap; 2]) -> Vec3 {
        match &self.mip_map {
            Some(map) => map.lookup(&self.file.image, uv, area, wrap),
            None => self.lookup(uv.x, uv.y, Filter::Bilinear, wrap[0], wrap[1]),
        }
    }

    /// Makes the smaller copies for [`Texture::lookup_area`]. `what` names the texture in errors.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn make_mip_map(&mut self, what: &str) -> Result<()> {
        if self.mip_map.is_none() {
            self.mip_map = Some(Box::new(MipMap::new(&self.file.image, self.whole, what)?));
        }
        Ok(())
    }

    /// Upper bound of the memory of the smaller copies, in bytes.
    pub fn max_mip_map_bytes(&self) -> u64 {
        let image = &self.file.image;
        match image.tiles() {
            Some((tiles, _)) => mip_map::max_bytes(tiles.size(), self.whole),
            // 6 bytes for every fourth, 16th... of the 3-byte texels.
            None if image.is_stored_as_bytes() => image.bytes() - image.bytes() / 3,
            None => mip_map::float_bytes(image.size(), image.stored_part()),
        }
    }

    /// Returns the error of the first lookup that could not read its texels.
    pub fn check(&self) -> Result<()> {
        let copies = self.mip_map.iter().flat_map(|map| map.tiles());
        let own = self.file.image.tiles().map(|(tiles, _)| tiles);
        own.into_iter().chain(copies).try_for_each(Tiles::check)
    }

    /// The texel in column `x` of row `y`, both inside the image.
    #[inline(always)]
    pub(super) fn texel(&self, x: usize, y: usize) -> Vec3 {
        self.file.image.texel(x, y)
    }

    /// 16 texels, by column and row.
    #[inline(always)]
    pub(super) fn texels(&self, x: &[u32; LANES], y: &[u32; LANES]) -> Lanes3 {
        self.file.image.texels(x, y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ColorSpace;
    use crate::shading::DEFAULT_MAX_BYTES;

    const N: Filter = Filter::Nearest;
    const B: Filter = Filter::Bilinear;
    const R: Wrap = Wrap::Repeat;
    const C: Wrap = Wrap::Clamp;

    fn ppm(data: &str, color_space: Option<ColorSpace>) -> Texture {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.ppm");
        std::fs::write(&path, data).unwrap();
        let max_bytes = DEFAULT_MAX_BYTES;
        let request = ImageRequest { path: &path, color_space, max_bytes, whole: u64::MAX };
        Texture::load(request).unwrap()
    }

    /// A linear 4 x 2 texture: grey 0 20 40 60 over 100 120 140 160, white is 200.
    fn ramp() -> Texture {
        let grey = "0 20 40 60 100 120 140 160".split(' ');
        let body: Vec<String> = grey.map(|g| format!("{g} {g} {g}")).collect();
        let data = format!("P3\n# by hand\n4 2\n200\n{}\n", body.join("\n"));
        ppm(&data, Some(ColorSpace::Linear))
    }

    /// Grey value of a lookup, in units of the ramp.
    fn grey(texture: &Texture, u: f64, v: f64, filter: Filter, wrap: Wrap) -> f32 {
        let rgb = texture.lookup(u, v, filter, wrap, wrap);
        assert_eq!((rgb.x, rgb.x), (rgb.y, rgb.z));
        (rgb.x * 200.0).round()
    }

    #[test]
    fn nearest_is_the_texel_under_the_point() {
        let t = ramp();
        assert_eq!((t.width(), t.height(), t.file().had_alpha), (4, 2, false));
        for (u, v, expected) in [
            (0.0, 0.0, 0.0),
            (0.2499, 0.4999, 0.0),
            (0.25, 0.0, 20.0),
            (0.9999, 0.25, 60.0),
            (0.0, 0.5, 100.0),
            (0.75, 0.99, 160.0),
        ] {
            assert_eq!(grey(&t, u, v, N, R), expected, "{u} {v}");
        }
    }

    #[test]
    fn nearest_wraps_each_index() {
        let t = ramp();
        assert_eq!(grey(&t, 1.0, 0.0, N, R), 0.0);
        assert_eq!(grey(&t, 1.0, 0.0, N, C), 60.0);
        assert_eq!(grey(&t, -0.01, 0.0, N, R), 60.0);
        assert_eq!(grey(&t, -0.01, 0.0, N, C), 0.0);
        assert_eq!(grey(&t, 7.3, -3.2, N, R), 120.0);
        assert_eq!(grey(&t, 0.0, 1.0, N, R), 0.0);
        assert_eq!(grey(&t, 0.0, 1.0, N, C), 100.0);
        let mixed = t.lookup(1.1, 1.1, N, R, C).x * 200.0;
        assert_eq!(mixed.round(), 100.0);
    }

    #[test]
    fn bilinear_has_centres_at_half_integers() {
        let t = ramp();
        assert_eq!(grey(&t, 0.125, 0.25, B, C), 0.0);
        assert_eq!(grey(&t, 0.375, 0.75, B, C), 120.0);
        assert_eq!(grey(&t, 0.25, 0.25, B, C), 10.0);
        assert_eq!(grey(&t, 0.3125, 0.25, B, C), 15.0);
        assert_eq!(grey(&t, 0.5, 0.5, B, C), 80.0);
    }

    #[test]
    fn bilinear_borders_wrap_or_clamp() {
        let t = ramp();
        assert_eq!(grey(&t, 0.0, 0.25, B, C), 0.0);
        assert_eq!(grey(&t, 0.0, 0.25, B, R), 30.0);
        assert_eq!(grey(&t, 1.0, 0.25, B, R), 30.0);
        assert_eq!(grey(&t, 1.0, 0.25, B, C), 60.0);
        assert_eq!(grey(&t, 0.125, 0.0, B, C), 0.0);
        assert_eq!(grey(&t, 0.125, 0.0, B, R), 50.0);
        assert_eq!(grey(&t, 0.125, 1.0, B, C), 100.0);
        assert_eq!(grey(&t, -5.0, 9.0, B, C), 100.0);
    }

    #[test]
    fn any_coordinate_is_safe() {
        let t = ramp();
        let odd = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            1e300,
            -1e300,
            9.3e18,
            -9.3e18,
            f64::MAX,
            -0.0,
        ];
        for u in odd {
            for v in odd {
                for (filter, wrap) in [(N, R), (N, C), (B, R), (B, C)] {
                    let rgb = t.lookup(u, v, filter, wrap, wrap);
                    assert!(rgb.is_finite() && (0.0..=0.8).contains(&rgb.x), "{u} {v}");
                }
            }
        }
        assert_eq!(grey(&t, f64::NAN, 0.75, N, R), 100.0);
        assert_eq!(grey(&t, f64::INFINITY, 0.0, N, C), 60.0);
    }

    #[test]
    fn a_constant_texture_is_constant() {
        let t = ppm("P3 3 2 255 7 80 9 7 80 9 7 80 9 7 80 9 7 80 9 7 80 9", None);
        let expected = t.lookup(0.5, 0.5, N, R, R);
        for i in 0..50 {
            let (u, v) = (f64::from(i) * 0.0371, f64::from(i) * 0.0713);
            assert_eq!(t.lookup(u, v, B, R, C), expected);
        }
    }

    /// The same image held whole, and in tiles with all but the smallest copies.
    fn whole_and_tiles(width: u32, height: u32) -> [Texture; 2] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.png");
        let hash = |x: u32, y: u32| {
            (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77)).wrapping_mul(0xc2b2_ae3d)
        };
        let rgb = |x, y| image::Rgb([(hash(x, y) >> 24) as u8, (x + y) as u8, x as u8]);
        image::RgbImage::from_fn(width, height, rgb).save(&path).unwrap();
        [u64::MAX, 300].map(|whole| {
            let mut texture = Texture::load(ImageRequest {
                path: &path,
                color_space: None,
                max_bytes: 1 << 30,
                whole,
            })
            .unwrap();
            let bound = texture.max_mip_map_bytes();
            let held = texture.bytes();
            texture.make_mip_map("test").unwrap();
            assert!(texture.bytes() - held <= bound || whole > 300, "{width} x {height}");
            texture
        })
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(24))]
        #[test]
        fn tiles_make_no_difference(
            (width, height) in (64u32..900, 64u32..400),
            lookups in proptest::collection::vec(
                ((-1.5..2.5f64, -1.5..2.5f64), (-9.0..1.0f64, -9.0..1.0f64), 0.0..6.3f64), 60),
        ) {
            let textures = whole_and_tiles(width, height);
            for ((u, v), (long, short), turn) in lookups {
                let (long, short) = (DVec2::from_angle(turn) * long.exp(), short.exp());
                let sides = [long, long.perp().normalize() * short];
                for wrap in [[R, R], [C, R], [C, C]] {
                    let [whole, tiles] = [&textures[0], &textures[1]].map(|texture| [
                        texture.lookup(u, v, N, wrap[0], wrap[1]),
                        texture.lookup(u, v, B, wrap[0], wrap[1]),
                        texture.lookup_area(DVec2::new(u, v), &Footprint { sides }, wrap),
                    ]);
                    assert_eq!(whole.map(|c| c.to_array().map(f32::to_bits)),
                               tiles.map(|c| c.to_array().map(f32::to_bits)));
                }
            }
            assert_eq!(textures[1].check(), Ok(()));
        }
    }
}
