//! Smaller copies of a texture (a mip map: Williams 1983, "Pyramidal Parametrics", SIGGRAPH), and
//! lookups of an area instead of a point.

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use super::texel_filter::bilinear;
use super::texel_image::TexelImage;
use crate::error::Result;
use crate::reserve;
use crate::scene::Wrap;

/// Most points along the longer axis of an area.
const MAX_POINTS: f64 = 16.0;

/// Copies of half the size each, down to one texel. The image itself is level 0.
#[derive(Debug, Clone)]
pub struct MipMap {
    levels: Vec<Level>,
}

/// A smaller copy, in linear RGB; rows from the top.
#[derive(Debug, Clone)]
struct Level {
    width: u32,
    height: u32,
    texels: LevelTexels,
}

#[derive(Debug, Clone)]
enum LevelTexels {
    /// 1 is 65535: finer than 8 bits of sRGB, and half the memory of floats.
    Words(Vec<[u16; 3]>),
    Floats(Vec<[f32; 3]>),
}

/// The area of a texture that one sample stands for: a parallelogram with these sides, in (u, v).
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// Two sides; v points down.
    pub sides: [DVec2; 2],
}

impl Level {
    fn texel(&self, x: usize, y: usize) -> Vec3 {
        let at = y * self.width as usize + x;
        match &self.texels {
            LevelTexels::Words(words) => {
                Vec3::from(words[at].map(f32::from)) * (1.0 / f32::from(u16::MAX))
            }
            LevelTexels::Floats(floats) => Vec3::from(floats[at]),
        }
    }

    /// Means over the texels of a larger image. `words`: all values are in [0, 1].
    fn halve(
        (width, height): (u32, u32),
        texel: impl Fn(usize, usize) -> Vec3 + Sync,
        words: bool,
        what: &str,
    ) -> Result<Self> {
        let half = |side: u32| (side / 2).max(1);
        let (w, h) = (half(width), half(height));
        let mean = |x: u32, y: u32| {
            let mut sum = Vec3::ZERO;
            for (row, down) in overlaps(y, height, h) {
                for (column, across) in overlaps(x, width, w) {
                    sum += texel(column, row) * (down * across);
                }
            }
            sum
        };
        let count = w as usize * h as usize;
        let place = |i: usize| (i as u32 % w, i as u32 / w);
        let texels = if words {
            let mut all = reserve::filled([0u16; 3], count, what)?;
            all.par_iter_mut().enumerate().for_each(|(i, texel)| {
                let (x, y) = place(i);
                let value = (mean(x, y) * f32::from(u16::MAX)).round();
                *texel = value.to_array().map(|value| value as u16);
            });
            LevelTexels::Words(all)
        } else {
            let mut all = reserve::filled([0f32; 3], count, what)?;
            all.par_iter_mut().enumerate().for_each(|(i, texel)| {
                let (x, y) = place(i);
                *texel = mean(x, y).to_array();
            });
            LevelTexels::Floats(all)
        };
        Ok(Self { width: w, height: h, texels })
    }
}

/// The texels of a side of `large` that texel `i` of a side of `small` overlaps, with their shares.
fn overlaps(i: u32, large: u32, small: u32) -> impl Iterator<Item = (usize, f32)> {
    let ratio = f64::from(large) / f64::from(small);
    let (start, end) = (f64::from(i) * ratio, f64::from(i + 1) * ratio);
    let texels = start as u32..(end.ceil() as u32).min(large);
    texels.filter_map(move |texel| {
        let part = end.min(f64::from(texel + 1)) - start.max(f64::from(texel));
        (part > 1e-9).then_some((texel as usize, (part / ratio) as f32))
    })
}

impl MipMap {
    /// The smaller copies of an image, on the threads of the current rayon pool.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn new(image: &TexelImage, what: &str) -> Result<Self> {
        let words = image.is_stored_as_bytes();
        let mut levels: Vec<Level> = Vec::new();
        let mut size = image.size();
        while size != (1, 1) {
            let next = match levels.last() {
                None => Level::halve(size, |x, y| image.texel(x, y), words, what),
                Some(level) => Level::halve(size, |x, y| level.texel(x, y), words, what),
            }?;
            size = (next.width, next.height);
            levels.push(next);
        }
        Ok(Self { levels })
    }

    /// Memory of the smaller copies, in bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = self.levels.iter().map(|level| match &level.texels {
            LevelTexels::Words(words) => size_of_val(&words[..]),
            LevelTexels::Floats(floats) => size_of_val(&floats[..]),
        });
        bytes.sum::<usize>() as u64
    }

    /// Mean colour of `image` over an area around `uv`.
    ///
    /// Points along the longer side of the area, each a trilinear lookup as wide as the shorter
    /// side: McCormack et al. 1999, "Feline: Fast Elliptical Lines for Anisotropic Texture
    /// Mapping", SIGGRAPH.
    pub fn lookup(&self, image: &TexelImage, uv: DVec2, area: &Footprint, wrap: [Wrap; 2]) -> Vec3 {
        let (width, height) = image.size();
        let size = DVec2::new(f64::from(width), f64::from(height));
        let [mut long, mut short] = area.sides.map(|side| (side, (side * size).length()));
        if short.1 > long.1 {
            std::mem::swap(&mut long, &mut short);
        }
        // An area within a texel is a point.
        if !(long.1 > 1.0) {
            return image.bilinear(uv, wrap);
        }
        let points = (long.1 / short.1.max(1.0)).ceil().clamp(1.0, MAX_POINTS);
        let width = (long.1 / points).max(short.1);
        let level = width.log2().max(0.0);
        let mut sum = Vec3::ZERO;
        for point in 0..points as u32 {
            let along = (f64::from(point) + 0.5) / points - 0.5;
            sum += self.trilinear(image, uv + long.0 * along, level, wrap);
        }
        sum / points as f32
    }

    fn trilinear(&self, image: &TexelImage, uv: DVec2, level: f64, wrap: [Wrap; 2]) -> Vec3 {
        let lower = (level as usize).min(self.levels.len());
        let upper = (lower + 1).min(self.levels.len());
        let between = (level - lower as f64).clamp(0.0, 1.0) as f32;
        let sharp = self.level(image, uv, lower, wrap);
        if between == 0.0 {
            return sharp;
        }
        sharp + (self.level(image, uv, upper, wrap) - sharp) * between
    }

    fn level(&self, image: &TexelImage, uv: DVec2, level: usize, wrap: [Wrap; 2]) -> Vec3 {
        match level.checked_sub(1).and_then(|below| self.levels.get(below)) {
            Some(level) => {
                bilinear((level.width, level.height), uv, wrap, |x, y| level.texel(x, y))
            }
            None => image.bilinear(uv, wrap),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPEAT: [Wrap; 2] = [Wrap::Repeat; 2];

    fn floats(width: u32, height: u32) -> TexelImage {
        let value = |x: u32, y: u32| (x * 37 + y * 101) as f32 % 17.0;
        let texels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let floats = texels.flat_map(|(x, y)| [value(x, y), x as f32, y as f32]);
        TexelImage::from_floats((width, height), floats.collect())
    }

    #[test]
    fn every_level_has_the_mean_of_the_image() {
        for (width, height) in [(64, 64), (37, 23), (5, 1), (1, 7), (100, 3)] {
            let image = floats(width, height);
            let map = MipMap::new(&image, "test").unwrap();
            let mut mean = Vec3::ZERO;
            for (x, y) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))) {
                mean += image.texel(x as usize, y as usize) / (width * height) as f32;
            }
            for level in &map.levels {
                let (w, h) = (level.width as usize, level.height as usize);
                let all = (0..w).flat_map(|x| (0..h).map(move |y| (x, y)));
                let sum: Vec3 = all.map(|(x, y)| level.texel(x, y)).sum();
                let off = (sum / (w * h) as f32 - mean).abs().max_element();
                assert!(off < 1e-4 * mean.max_element(), "{width} x {height}: {w} x {h} {off}");
            }
            let last = map.levels.last().unwrap();
            assert_eq!((last.width, last.height), (1, 1));
        }
    }

    #[test]
    fn the_area_of_the_whole_image_has_its_mean() {
        let image = floats(64, 64);
        let map = MipMap::new(&image, "test").unwrap();
        let mean = map.levels.last().unwrap().texel(0, 0);
        for sides in [[DVec2::X, DVec2::Y], [DVec2::X * 9.0, DVec2::Y * 1e3]] {
            let found = map.lookup(&image, DVec2::new(0.3, 0.7), &Footprint { sides }, REPEAT);
            assert!((found - mean).abs().max_element() < 1e-3, "{found} {mean}");
        }
    }

    #[test]
    fn a_point_is_looked_up_as_without_a_map() {
        let image = floats(37, 23);
        let map = MipMap::new(&image, "test").unwrap();
        let point = Footprint { sides: [DVec2::X * 1e-3, DVec2::ZERO] };
        for i in 0..100 {
            let uv = DVec2::new(0.013 * f64::from(i), 0.029 * f64::from(i));
            let found = map.lookup(&image, uv, &point, REPEAT);
            assert_eq!(found, image.bilinear(uv, REPEAT));
        }
    }

    #[test]
    fn a_long_area_is_sharp_across() {
        // Columns are black and white: a long area down a column must not mix them.
        let texels = (0..64 * 64).flat_map(|i| [if i % 64 / 4 % 2 == 0 { 0 } else { 255 }; 3]);
        let linear = std::array::from_fn(|byte| byte as f32 / 255.0);
        let image = TexelImage::from_bytes((64, 64), texels.collect(), Box::new(linear));
        let map = MipMap::new(&image, "test").unwrap();
        let area = Footprint { sides: [DVec2::Y * 0.2, DVec2::X / 64.0] };
        let black = map.lookup(&image, DVec2::new(2.0 / 64.0, 0.5), &area, REPEAT);
        let white = map.lookup(&image, DVec2::new(6.0 / 64.0, 0.5), &area, REPEAT);
        assert!(black.x < 0.01 && white.x > 0.99, "{black} {white}");
    }
}
