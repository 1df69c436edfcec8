//! Textures: loads image files as linear RGB and looks up colours at (u, v).
//!
//! Reads PPM and related formats, PNG, JPEG, Radiance HDR and OpenEXR. The content decides the
//! format, never the file name. Texels are decoded to linear light before filtering: integer images
//! of any format from sRGB, float images unchanged, unless the scene sets the colour space.
//! Integers are divided by the largest value of their type; Netpbm samples are divided by the white
//! level of their header. Embedded colour profiles, gamma chunks and EXIF orientations are ignored;
//! alpha is dropped. The texture of an OpenEXR is its display window; memory is allocated only for
//! the pixels in the file.
//!
//! Negative texels are kept and counted. Rejected are:
//!
//! - images above a given number of bytes, which the header tells before decoding
//! - truncated files
//! - Netpbm samples above the white level
//! - float images with texels that are not finite

use std::{ops::Range, path::Path};

use super::image_file::{
    Opened, Source, TextureSize, check_jpeg_end, check_size, explain, name, source,
};
use crate::{
    error::{Error, Result},
    files::Stamp,
    reserve,
    scene::{ColorSpace, Filter, Wrap},
};
use glam::{DVec2, Vec3};
use image::{DynamicImage, ImageDecoder, ImageFormat};

use super::exr::Layout;
use super::mip_map::{Footprint, MipMap};

/// Limit of [`Texture::load`] on the memory of one texture while it is decoded: 4 GiB.
pub const DEFAULT_MAX_BYTES: u64 = 4 << 30;

/// An image in linear RGB; rows from the top.
#[derive(Debug, Clone)]
pub struct Texture {
    width: u32,
    height: u32,
    texels: Texels,
    had_alpha: bool,
    negative: Option<Negative>,
    stamp: Option<Stamp>,
    mip_map: Option<Box<MipMap>>,
}

/// Texels with a negative value. No real surface has a negative reflectance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Negative {
    /// Number of texels, >= 1.
    pub texels: u64,
    /// Column and row of the first such texel, from the top left.
    pub first: [u32; 2],
}

/// Stored texels. 8-bit images stay 8-bit: a quarter of the memory, and exact.
#[derive(Debug, Clone)]
enum Texels {
    /// RGB bytes, and a table of the linear value of each byte.
    Bytes(Vec<u8>, Box<[f32; 256]>),
    /// Linear RGB of every texel.
    Floats(Vec<f32>),
    /// Linear RGB of a part of the image; the rest is black.
    Part(Box<Part>),
}

/// The texels of an image that its file has.
#[derive(Debug, Clone)]
struct Part {
    texels: Vec<f32>,
    columns: Range<u32>,
    rows: Range<u32>,
}

impl Part {
    fn texel(&self, x: usize, y: usize) -> Vec3 {
        let at = (x as u32, y as u32);
        if !self.columns.contains(&at.0) || !self.rows.contains(&at.1) {
            return Vec3::ZERO;
        }
        let (x, y) = (at.0 - self.columns.start, at.1 - self.rows.start);
        let at = 3 * (y as usize * self.columns.len() + x as usize);
        Vec3::from_slice(&self.texels[at..at + 3])
    }
}

impl Texture {
    /// Reads an image that needs at most 4 GiB while it is decoded.
    ///
    /// A `color_space` of `None` is sRGB for integer images and linear for float images.
    pub fn load(path: &Path, color_space: Option<ColorSpace>) -> Result<Self> {
        Self::load_within(path, color_space, DEFAULT_MAX_BYTES)
    }

    /// Memory that the image at `path` needs, from its header alone.
    ///
    /// # Errors
    /// The errors of [`Texture::load`] that concern the header.
    pub fn size(path: &Path) -> Result<TextureSize> {
        Ok(TextureSize::of(&source(path, u64::MAX)?.source))
    }

    /// Reads an image that needs at most `max_bytes` while it is decoded.
    pub fn load_within(
        path: &Path,
        color_space: Option<ColorSpace>,
        max_bytes: u64,
    ) -> Result<Self> {
        let Opened { source, stamp } = source(path, max_bytes)?;
        let (width, height) = source.dimensions();
        let needed = check_size(path, &source, max_bytes)?;
        let (had_alpha, texels) = match source {
            Source::Exr(layout, mut file) => {
                let texels = layout.read(&mut file, path)?;
                (layout.has_alpha, exr_texels(layout, texels, color_space))
            }
            Source::Image(format, decoder, white) => {
                let had_alpha = decoder.color_type().has_alpha();
                if format == ImageFormat::Jpeg {
                    check_jpeg_end(path)?;
                }
                // The library's single allocations cannot fail, so the sum is tested first.
                reserve::probe(needed, &name(path))?;
                let image = DynamicImage::from_decoder(decoder).map_err(|e| explain(path, e))?;
                let texels = decode(image, color_space, white).map_err(|texel| {
                    let (x, y) = (texel % u64::from(width), texel / u64::from(width));
                    let white = white.unwrap_or_default();
                    let message = format!(
                        "texel ({x}, {y}) is more than {white}, the largest that the header allows"
                    );
                    Error::invalid(name(path), message)
                })?;
                (had_alpha, texels)
            }
        };
        if let Some([x, y]) = texels.first_non_finite(width) {
            return Err(Error::invalid(
                name(path),
                format!("texel ({x}, {y}) is NaN or infinite; every value must be finite"),
            ));
        }
        let negative = texels.negative(width);
        let mip_map = None;
        Ok(Self { width, height, texels, had_alpha, negative, stamp, mip_map })
    }

    /// Width in texels, >= 1.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in texels, >= 1.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Whether the file has an alpha channel, which is ignored.
    pub fn had_alpha(&self) -> bool {
        self.had_alpha
    }

    /// Texels with negative values, if there are any. They are kept.
    pub fn negative(&self) -> Option<Negative> {
        self.negative
    }

    /// Stamp of the file when it was opened.
    pub fn stamp(&self) -> Option<Stamp> {
        self.stamp
    }

    /// Memory of the texels and of the smaller copies, in bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = match &self.texels {
            Texels::Bytes(bytes, table) => bytes.len() + size_of_val(&**table),
            Texels::Floats(floats) => size_of_val(&**floats),
            Texels::Part(part) => size_of_val(&part.texels[..]),
        };
        bytes as u64 + self.mip_map.as_ref().map_or(0, |map| map.bytes())
    }

    /// Linear RGB at (u, v). u points right, v points down from the first row; the image is [0,
    /// 1]^2.
    ///
    /// Any u, v are safe: NaN gives texel 0 of its axis, huge values give some texel of the image.
    pub fn lookup(&self, u: f64, v: f64, filter: Filter, wrap_u: Wrap, wrap_v: Wrap) -> Vec3 {
        // The products are exact for u, v that are f32 values, so floor is right at every border.
        let x = u * f64::from(self.width);
        let y = v * f64::from(self.height);
        match filter {
            Filter::Nearest => self.texel(
                index(x.floor(), 0, self.width, wrap_u),
                index(y.floor(), 0, self.height, wrap_v),
            ),
            Filter::Bilinear | Filter::Trilinear => {
                let (uv, size) = (DVec2::new(u, v), (self.width, self.height));
                bilinear(size, uv, [wrap_u, wrap_v], |x, y| self.texel(x, y))
            }
        }
    }

    /// Mean colour over an area around `uv`. Without [`Texture::make_mip_map`] it is the colour at
    /// `uv`.
    pub fn lookup_area(&self, uv: DVec2, area: &Footprint, wrap: [Wrap; 2]) -> Vec3 {
        match &self.mip_map {
            Some(map) => map.lookup(self, uv, area, wrap),
            None => self.lookup(uv.x, uv.y, Filter::Bilinear, wrap[0], wrap[1]),
        }
    }

    /// Makes the smaller copies for [`Texture::lookup_area`]. `what` names the texture in errors.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn make_mip_map(&mut self, what: &str) -> Result<()> {
        if self.mip_map.is_none() {
            self.mip_map = Some(Box::new(MipMap::new(self, what)?));
        }
        Ok(())
    }

    /// Whether the texels are stored as bytes. Then every value is in [0, 1].
    pub(super) fn is_stored_as_bytes(&self) -> bool {
        matches!(self.texels, Texels::Bytes(..))
    }

    /// The texel in column `x` of row `y`, both inside the image.
    #[inline(always)]
    pub(super) fn texel(&self, x: usize, y: usize) -> Vec3 {
        let at = 3 * (y * self.width as usize + x);
        match &self.texels {
            Texels::Bytes(bytes, table) => {
                let rgb = &bytes[at..at + 3];
                Vec3::new(table[rgb[0] as usize], table[rgb[1] as usize], table[rgb[2] as usize])
            }
            Texels::Floats(floats) => Vec3::from_slice(&floats[at..at + 3]),
            Texels::Part(part) => part.texel(x, y),
        }
    }
}

/// Interpolates between the four texels around `uv`; the image is [0, 1]^2.
///
/// Any u, v are safe, as in [`Texture::lookup`].
#[inline(always)]
pub(super) fn bilinear(
    (width, height): (u32, u32),
    uv: DVec2,
    [wrap_u, wrap_v]: [Wrap; 2],
    texel: impl Fn(usize, usize) -> Vec3,
) -> Vec3 {
    let (x, y) = (uv.x * f64::from(width) - 0.5, uv.y * f64::from(height) - 0.5);
    let (column, row) = (x.floor(), y.floor());
    let (x0, x1) = (index(column, 0, width, wrap_u), index(column, 1, width, wrap_u));
    let (y0, y1) = (index(row, 0, height, wrap_v), index(row, 1, height, wrap_v));
    let (s, t) = (fraction(x - column), fraction(y - row));
    let upper = mix(texel(x0, y0), texel(x1, y0), s);
    let lower = mix(texel(x0, y1), texel(x1, y1), s);
    mix(upper, lower, t)
}

impl Texels {
    /// The stored floats, which may have any values; column and row of the first; number of
    /// columns. `width` is that of the image. `None` for bytes.
    fn floats(&self, width: u32) -> Option<(&[f32], [u32; 2], u32)> {
        match self {
            Texels::Bytes(..) => None,
            Texels::Floats(floats) => Some((floats, [0; 2], width)),
            Texels::Part(part) => {
                let first = [part.columns.start, part.rows.start];
                Some((&part.texels, first, part.columns.len() as u32))
            }
        }
    }

    /// Column and row of the first texel with a value that is NaN or infinite.
    fn first_non_finite(&self, width: u32) -> Option<[u32; 2]> {
        let (values, first, width) = self.floats(width)?;
        let at = values.iter().position(|value| !value.is_finite())?;
        Some(place(at / 3, first, width))
    }

    /// Counts the texels with a negative value. `None` if there are none.
    fn negative(&self, width: u32) -> Option<Negative> {
        let (values, first, width) = self.floats(width)?;
        let negative = |rgb: &[f32]| rgb.iter().any(|&value| value < 0.0);
        let at = values.chunks_exact(3).position(negative)?;
        let rest = values[3 * at..].chunks_exact(3).filter(|rgb| negative(rgb));
        Some(Negative { texels: rest.count() as u64, first: place(at, first, width) })
    }
}

/// Column and row of the texel with index `texel`, in rows of `width` that begin at (`left`,
/// `top`).
fn place(texel: usize, [left, top]: [u32; 2], width: u32) -> [u32; 2] {
    let (texel, width) = (texel as u64, u64::from(width));
    [left + (texel % width) as u32, top + (texel / width) as u32]
}

/// Texel index `floor + offset` on an axis of `size` texels. Any `floor` is safe: `as` saturates
/// and turns NaN into 0.
fn index(floor: f64, offset: i64, size: u32, wrap: Wrap) -> usize {
    let i = (floor as i64).saturating_add(offset);
    let size = i64::from(size);
    let inside = if (0..size).contains(&i) {
        i
    } else {
        match wrap {
            Wrap::Repeat => i.rem_euclid(size),
            Wrap::Clamp => i.clamp(0, size - 1),
        }
    };
    inside as usize
}

/// A filter weight; 0 if the coordinate was not finite.
fn fraction(value: f64) -> f32 {
    if value.is_finite() { value as f32 } else { 0.0 }
}

/// Linear interpolation from `a` at t = 0 to `b` at t = 1. Exactly `a` for any t if the two are
/// equal.
fn mix(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a + (b - a) * t
}

/// Decodes sRGB to linear (IEC 61966-2-1). An odd function, so that negative values of float images
/// survive.
pub fn linear_from_srgb(value: f64) -> f64 {
    let x = value.abs();
    let linear = if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) };
    linear.copysign(value)
}

/// Drops alpha, expands grey to RGB and makes values linear. `white` is the divisor of integers, if
/// it is not the largest value of their type.
///
/// # Errors
/// The first texel (row by row) with a value above `white`.
fn decode(
    image: DynamicImage,
    color_space: Option<ColorSpace>,
    white: Option<u16>,
) -> std::result::Result<Texels, u64> {
    let color = image.color();
    let bytes_per_value = color.bytes_per_pixel() / color.channel_count();
    let is_float = matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    let default = if is_float { ColorSpace::Linear } else { ColorSpace::Srgb };
    let linear = |stored: f64| match color_space.unwrap_or(default) {
        ColorSpace::Srgb => linear_from_srgb(stored) as f32,
        ColorSpace::Linear => stored as f32,
    };
    let beyond = |at: Option<usize>| at.map_or(Ok(()), |at| Err(at as u64 / 3));
    if is_float {
        let mut floats = image.into_rgb32f().into_raw();
        for value in &mut floats {
            *value = linear(f64::from(*value));
        }
        Ok(Texels::Floats(floats))
    } else if bytes_per_value == 1 {
        let bytes = image.into_rgb8().into_raw();
        let white = white.unwrap_or(255);
        if white < 255 {
            beyond(bytes.iter().position(|&byte| u16::from(byte) > white))?;
        }
        let table = std::array::from_fn(|byte| linear(byte as f64 / f64::from(white)));
        Ok(Texels::Bytes(bytes, Box::new(table)))
    } else {
        let words = image.into_rgb16().into_raw();
        let white = white.unwrap_or(65535);
        if white < 65535 {
            beyond(words.iter().position(|&word| word > white))?;
        }
        let floats = words.iter().map(|&word| linear(f64::from(word) / f64::from(white)));
        Ok(Texels::Floats(floats.collect()))
    }
}

/// Texels of an EXR: linear unless the scene sets another colour space.
fn exr_texels(layout: Layout, mut texels: Vec<f32>, color_space: Option<ColorSpace>) -> Texels {
    if color_space == Some(ColorSpace::Srgb) {
        texels.iter_mut().for_each(|v| *v = linear_from_srgb(f64::from(*v)) as f32);
    }
    let Layout { size: [width, height], columns, rows, .. } = layout;
    match (&columns, &rows) == (&(0..width), &(0..height)) {
        true => Texels::Floats(texels),
        false => Texels::Part(Box::new(Part { texels, columns, rows })),
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use image::{Rgb, RgbImage, Rgba, RgbaImage};
    use tempfile::TempDir;

    use super::*;
    use crate::error::Kind;

    const N: Filter = Filter::Nearest;
    const B: Filter = Filter::Bilinear;
    const R: Wrap = Wrap::Repeat;
    const C: Wrap = Wrap::Clamp;

    /// Writes one file into a new folder.
    fn file(name: &str, data: &[u8]) -> (TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, data).unwrap();
        (folder, path)
    }

    fn saved(name: &str, image: &DynamicImage) -> (TempDir, PathBuf) {
        let (folder, path) = file(name, b"");
        image.save(&path).unwrap();
        (folder, path)
    }

    fn load(name: &str, data: &[u8]) -> Texture {
        let (_folder, path) = file(name, data);
        Texture::load(&path, None).unwrap()
    }

    fn error(name: &str, data: &[u8]) -> Error {
        let (_folder, path) = file(name, data);
        Texture::load(&path, None).unwrap_err()
    }

    fn linear_ppm(data: &str) -> Texture {
        let (_folder, path) = file("t.ppm", data.as_bytes());
        Texture::load(&path, Some(ColorSpace::Linear)).unwrap()
    }

    /// A linear 4 x 2 texture: grey 0 20 40 60 over 100 120 140 160, white is 200.
    fn ramp() -> Texture {
        let grey = "0 20 40 60 100 120 140 160".split(' ');
        let body: Vec<String> = grey.map(|g| format!("{g} {g} {g}")).collect();
        linear_ppm(&format!("P3\n# by hand\n4 2\n200\n{}\n", body.join("\n")))
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
        assert_eq!((t.width(), t.height(), t.had_alpha()), (4, 2, false));
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
        let t = load(
            "t.ppm",
            b"P3 3 2 255 \
            7 80 9 7 80 9 7 80 9 7 80 9 7 80 9 7 80 9",
        );
        let expected = t.lookup(0.5, 0.5, N, R, R);
        for i in 0..50 {
            let (u, v) = (f64::from(i) * 0.0371, f64::from(i) * 0.0713);
            assert_eq!(t.lookup(u, v, B, R, C), expected);
        }
    }

    #[test]
    fn integers_are_srgb_and_decoded_before_filtering() {
        let t = load("t.ppm", b"P6 2 1 255\n\x00\x80\xff\xff\x80\xff");
        let half = linear_from_srgb(128.0 / 255.0) as f32;
        assert!((half - 0.215_860_5).abs() < 1e-6);
        let middle = t.lookup(0.5, 0.5, B, C, C);
        assert_eq!(middle, Vec3::new(0.5, half, 1.0));
        assert_eq!(t.bytes(), 6 + 1024);
    }

    #[test]
    fn a_linear_color_space_skips_the_srgb_curve() {
        let t = linear_ppm("P3 1 1 255 51 102 255");
        let rgb = t.lookup(0.5, 0.5, N, C, C);
        assert!((rgb - Vec3::new(0.2, 0.4, 1.0)).length() < 1e-6);
    }

    #[test]
    fn sixteen_bits_are_kept() {
        let t = linear_ppm("P3 1 1 65535 1 32768 65535");
        let rgb = t.lookup(0.5, 0.5, N, C, C);
        assert_eq!(rgb, Vec3::new(1.0, 32768.0, 65535.0) / 65535.0);
        let t = load("t.ppm", b"P6 1 1 65535\n\x80\x00\x00\x00\xff\xff");
        let half = linear_from_srgb(32768.0 / 65535.0) as f32;
        assert_eq!(t.lookup(0.0, 0.0, N, C, C), Vec3::new(half, 0.0, 1.0));
    }

    /// Every sample of every kind of Netpbm file is divided by the header's white level.
    #[test]
    fn samples_of_any_maxval_are_exact() {
        for white in [1u32, 2, 100, 200, 254, 255, 256, 1000, 4095, 65534, 65535] {
            let wide = white > 255;
            let samples: Vec<u32> = (0..=white).collect();
            let ascii: Vec<String> = samples.iter().map(u32::to_string).collect();
            let two = |x: &u32| (*x as u16).to_be_bytes();
            let binary: Vec<u8> = match wide {
                true => samples.iter().flat_map(two).collect(),
                false => samples.iter().map(|x| *x as u8).collect(),
            };
            let count = samples.len();
            let header = |magic: &str| format!("{magic}\n{count} 1\n{white}\n").into_bytes();
            let grey = |texel: u32| vec![texel; 3];
            let thirds: Vec<u8> = match wide {
                true => samples.iter().flat_map(|x| grey(*x)).flat_map(|x| two(&x)).collect(),
                false => samples.iter().flat_map(|x| grey(*x)).map(|x| x as u8).collect(),
            };
            let pam = format!(
                "P7\nWIDTH {count}\nHEIGHT 1\nDEPTH 1\nMAXVAL {white}\nTUPLTYPE GRAYSCALE\nENDHDR\n"
            );
            let files = [
                [header("P2"), ascii.join(" ").into_bytes()].concat(),
                [header("P5"), binary.clone()].concat(),
                [header("P6"), thirds].concat(),
                [pam.into_bytes(), binary].concat(),
            ];
            for data in files {
                let (_folder, path) = file("t.ppm", &data);
                for space in [ColorSpace::Linear, ColorSpace::Srgb] {
                    let texture = Texture::load(&path, Some(space)).unwrap();
                    for &sample in &samples {
                        let exact = f64::from(sample) / f64::from(white);
                        let exact = match space {
                            ColorSpace::Linear => exact,
                            ColorSpace::Srgb => linear_from_srgb(exact),
                        };
                        let u = (f64::from(sample) + 0.5) / count as f64;
                        let found = texture.lookup(u, 0.5, N, C, C);
                        let start = String::from_utf8_lossy(&data[..2]);
                        assert_eq!(
                            found,
                            Vec3::splat(exact as f32),
                            "{start}: {sample} of {white}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn samples_above_the_maxval_are_refused() {
        for data in [&b"P3 2 1 100 1 2 3 4 101 6"[..], b"P5 2 1 100\n\x64\x65", b"P2 2 1 300 5 301"]
        {
            let message = error("t.ppm", data).to_string();
            assert!(message.contains("texel (1, 0)"), "{message}");
            assert!(
                message.contains("more than 100") || message.contains("more than 300"),
                "{message}"
            );
        }
    }

    #[test]
    fn png_grey_alpha_and_sixteen_bits() {
        let rgba = RgbaImage::from_fn(2, 1, |x, _| Rgba([255 * x as u8, 255, 0, 9]));
        let (_folder, path) = saved("a.png", &rgba.into());
        let t = Texture::load(&path, None).unwrap();
        assert!(t.had_alpha());
        assert_eq!(t.lookup(0.6, 0.5, N, C, C), Vec3::new(1.0, 1.0, 0.0));

        let grey = image::GrayImage::from_pixel(1, 1, image::Luma([51]));
        let (_folder, path) = saved("g.png", &grey.into());
        let t = Texture::load(&path, Some(ColorSpace::Linear)).unwrap();
        assert!((t.lookup(0.5, 0.5, N, C, C) - Vec3::splat(0.2)).length() < 1e-6);

        let deep = image::ImageBuffer::from_pixel(1, 1, Rgb([1u16, 2, 65535]));
        let (_folder, path) = saved("d.png", &DynamicImage::ImageRgb16(deep));
        let t = Texture::load(&path, Some(ColorSpace::Linear)).unwrap();
        let expected = Vec3::new(1.0, 2.0, 65535.0) / 65535.0;
        assert_eq!(t.lookup(0.5, 0.5, N, C, C), expected);
        assert_eq!(t.bytes(), 12);
    }

    #[test]
    fn content_decides_the_format() {
        let t = load("actually-a-ppm.png", b"P6 1 1 255\n\xff\xff\xff");
        assert_eq!(t.lookup(0.5, 0.5, N, C, C), Vec3::ONE);
    }

    #[test]
    fn jpeg_is_decoded() {
        let image = RgbImage::from_pixel(16, 8, Rgb([200, 100, 50]));
        let (_folder, path) = saved("t.jpg", &image.into());
        let t = Texture::load(&path, Some(ColorSpace::Linear)).unwrap();
        assert_eq!((t.width(), t.height()), (16, 8));
        let rgb = t.lookup(0.5, 0.5, N, C, C) * 255.0;
        assert!((rgb - Vec3::new(200.0, 100.0, 50.0)).abs().max_element() < 4.0);
    }

    #[test]
    fn hdr_and_exr_are_linear_and_unbounded() {
        let image = image::Rgb32FImage::from_pixel(3, 2, Rgb([4.0, 0.25, 0.0]));
        let image = DynamicImage::ImageRgb32F(image);
        for name in ["t.hdr", "t.exr"] {
            let (_folder, path) = saved(name, &image);
            let t = Texture::load(&path, None).unwrap();
            assert_eq!((t.width(), t.height()), (3, 2));
            assert_eq!(t.lookup(0.4, 0.6, B, R, C), Vec3::new(4.0, 0.25, 0.0));
            let t = Texture::load(&path, Some(ColorSpace::Srgb)).unwrap();
            assert!(t.lookup(0.4, 0.6, B, R, C).x > 20.0);
        }
    }

    #[test]
    fn exr_alpha_is_dropped_and_nan_refused() {
        let rgba = image::Rgba32FImage::from_pixel(2, 2, Rgba([1.0, 2.0, 3.0, 0.5]));
        let mut image = DynamicImage::ImageRgba32F(rgba);
        let (_folder, path) = saved("t.exr", &image);
        let t = Texture::load(&path, None).unwrap();
        assert!(t.had_alpha());
        assert_eq!(t.lookup(0.5, 0.5, N, C, C), Vec3::new(1.0, 2.0, 3.0));

        if let DynamicImage::ImageRgba32F(rgba) = &mut image {
            rgba.put_pixel(1, 1, Rgba([0.0, f32::NAN, 0.0, 1.0]));
        }
        let (_folder, path) = saved("n.exr", &image);
        let message = Texture::load(&path, None).unwrap_err().to_string();
        assert!(message.contains("texel (1, 1) is NaN"), "{message}");
    }

    /// The data window lies inside the picture, leaves it on two sides, lies beside it, or contains
    /// it.
    #[test]
    fn an_exr_texture_is_its_display_window() {
        use ::exr::prelude::*;
        for (first, size) in
            [((2, 1), (3, 2)), ((-2, -1), (4, 3)), ((9, 9), (2, 2)), ((-1, -1), (9, 8))]
        {
            let pixels = SpecificChannels::rgb(|at: Vec2<usize>| {
                (at.x() as f32 + 1.0, at.y() as f32 + 1.0, 0.5)
            });
            let attributes = LayerAttributes {
                layer_position: Vec2(first.0 + 5, first.1 - 7),
                ..Default::default()
            };
            let layer = Layer::new(size, attributes, Encoding::FAST_LOSSLESS, pixels);
            let window = IntegerBounds::new((5, -7), (6usize, 5usize));
            let image =
                Image { attributes: ImageAttributes::new(window), ..Image::from_layer(layer) };
            let (_folder, path) = file("w.exr", b"");
            image.write().to_file(&path).unwrap();
            let texture = Texture::load(&path, None).unwrap();
            assert_eq!((texture.width(), texture.height()), (6, 5));
            let mut has = 0;
            for (x, y) in (0..5).flat_map(|y| (0..6).map(move |x| (x, y))) {
                let (dx, dy) = (x - first.0, y - first.1);
                let inside = (0..size.0 as i32).contains(&dx) && (0..size.1 as i32).contains(&dy);
                let expected = match inside {
                    true => Vec3::new(dx as f32 + 1.0, dy as f32 + 1.0, 0.5),
                    false => Vec3::ZERO,
                };
                let (u, v) = ((f64::from(x) + 0.5) / 6.0, (f64::from(y) + 0.5) / 5.0);
                assert_eq!(texture.lookup(u, v, N, C, C), expected, "{first:?} {x} {y}");
                has += u64::from(inside);
            }
            assert_eq!(texture.bytes(), 12 * has);
            assert_eq!(Texture::size(&path).unwrap().decoding, 12 * has);
        }
    }

    #[test]
    fn a_header_larger_than_memory_is_refused_before_decoding() {
        for header in ["P3 100000 100000 255 ", "P6 100000 100000 255\n"] {
            let e = error("t.ppm", header.as_bytes());
            assert_eq!(e.kind, Kind::Limit);
            let message = e.to_string();
            assert!(message.contains("100000 x 100000 pixels need 60000000000 bytes"));
            assert!(message.contains("the limit is 4294967296"), "{message}");
        }
        let (_folder, path) = file("t.ppm", b"P6 2 2 255\n123456789012");
        assert!(Texture::load_within(&path, None, 24).is_ok());
        let e = Texture::load_within(&path, None, 23).unwrap_err();
        assert_eq!(e.kind, Kind::Limit);
        error("t.ppm", b"P6 4294967295 4294967295 255\n");
        let beyond = error("t.ppm", b"P6 2000000000 2000000000 255\n").to_string();
        assert!(beyond.contains("need at least 18446744073709551615 bytes"), "{beyond}");
        error("t.ppm", b"P4 4294967295 4294967295\n");
        error("t.ppm", b"P6 99999999999999 1 255\n");
        error("t.ppm", b"P6 0 5 255\n");
    }

    #[test]
    fn files_that_are_no_images_have_clear_errors() {
        let folder = tempfile::tempdir().unwrap();
        let message = |path: &Path| Texture::load(path, None).unwrap_err().to_string();
        let missing = message(&folder.path().join("no.png"));
        assert!(missing.contains("no.png: cannot read the texture: No such file"));
        assert!(message(folder.path()).contains("is a folder"));
        assert!(message(Path::new("/dev/null")).contains("not a regular file"));
        assert!(error("t.png", b"").to_string().contains("is empty"));
        let unknown = error("t.png", b"hello world, this is text").to_string();
        assert!(unknown.contains("not an image of a known format"), "{unknown}");
        assert!(unknown.contains("PNG, JPEG"));
        let webp = error("t.webp", b"RIFF\x00\x00\x00\x00WEBPVP8 ");
        assert_eq!(webp.kind, Kind::Unsupported);
    }

    #[test]
    fn every_truncation_is_an_error() {
        let image = DynamicImage::ImageRgb8(RgbImage::from_fn(24, 16, |x, y| {
            Rgb([(x * 10) as u8, (y * 15) as u8, (x * y) as u8])
        }));
        for name in ["t.png", "t.jpg", "t.hdr", "t.exr", "t.ppm"] {
            let image = match name {
                "t.hdr" | "t.exr" => DynamicImage::ImageRgb32F(image.to_rgb32f()),
                _ => image.clone(),
            };
            let (_folder, path) = saved(name, &image);
            let whole = std::fs::read(&path).unwrap();
            // A PNG is complete once its pixels are; its last chunk holds no data.
            let end = whole.len() - if name == "t.png" { 13 } else { 1 };
            for length in (0..end).step_by(7).chain([end]) {
                std::fs::write(&path, &whole[..length]).unwrap();
                let e = Texture::load(&path, None);
                assert!(e.is_err(), "{name} cut at {length} of {}", whole.len());
            }
        }
        let short = error("t.ppm", b"P3 2 2 255 1 2 3 4");
        assert_eq!(short.kind, Kind::Invalid);
    }

    #[test]
    fn flipped_bytes_never_panic() {
        let image = DynamicImage::ImageRgb8(RgbImage::from_pixel(9, 7, Rgb([1, 200, 77])));
        for name in ["t.png", "t.jpg", "t.hdr", "t.exr", "t.ppm"] {
            let image = match name {
                "t.hdr" | "t.exr" => DynamicImage::ImageRgb32F(image.to_rgb32f()),
                _ => image.clone(),
            };
            let (_folder, path) = saved(name, &image);
            let whole = std::fs::read(&path).unwrap();
            for at in (0..whole.len().min(700)).step_by(5) {
                for bits in [0xff, 0x01] {
                    let mut data = whole.clone();
                    data[at] ^= bits;
                    std::fs::write(&path, &data).unwrap();
                    let _ = Texture::load_within(&path, None, 1 << 26);
                }
            }
        }
    }
}
