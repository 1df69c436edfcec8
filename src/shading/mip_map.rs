//! Smaller copies of a texture (a mip map: Williams 1983, "Pyramidal Parametrics", SIGGRAPH), and
//! lookups of an area instead of a point.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec2, Vec3};

use super::texel_filter::bilinear;
use super::texel_image::{Part, TexelImage, linear_rgb};
use super::tiles::{self, Band, SIDE, TileWriter, Tiles};
use crate::error::Result;
use crate::parallel;
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
    /// Words in a temporary file.
    Tiles(Arc<Tiles>),
    /// Floats, without texels to which only texels contribute that the image leaves out.
    Floats(Part),
}

/// The area of a texture that one sample stands for: a parallelogram with these sides, in (u, v).
#[derive(Debug, Clone, Copy)]
pub struct Footprint {
    /// Two sides; v points down.
    pub sides: [DVec2; 2],
}

impl Footprint {
    /// The area after u and v are multiplied by `scale`.
    pub fn scaled(self, scale: DVec2) -> Self {
        Self { sides: self.sides.map(|side| side * scale) }
    }
}

impl Level {
    fn texel(&self, x: usize, y: usize) -> Vec3 {
        let at = y * self.width as usize + x;
        match &self.texels {
            LevelTexels::Words(words) => from_words(words[at]),
            LevelTexels::Tiles(tiles) => tiles.with(|cache| from_bytes(cache.texel(tiles, x, y))),
            LevelTexels::Floats(part) => part.texel(x, y),
        }
    }

    fn bilinear(&self, uv: DVec2, wrap: [Wrap; 2]) -> Vec3 {
        let size = (self.width, self.height);
        match &self.texels {
            LevelTexels::Tiles(tiles) => tiles.with(|cache| {
                bilinear(size, uv, wrap, |x, y| from_bytes(cache.texel(tiles, x, y)))
            }),
            LevelTexels::Words(words) => {
                let width = self.width as usize;
                bilinear(size, uv, wrap, |x, y| from_words(words[y * width + x]))
            }
            LevelTexels::Floats(_) => bilinear(size, uv, wrap, |x, y| self.texel(x, y)),
        }
    }

    /// Means over the texels of a larger image. `part` has the columns and rows to keep as floats;
    /// the others are black. Without it, all values are in [0, 1].
    fn halve(
        size: (u32, u32),
        texel: impl Fn(usize, usize) -> Vec3 + Sync,
        part: Option<(Range<u32>, Range<u32>)>,
        what: &str,
    ) -> Result<Self> {
        let (width, height) = half(size);
        let texels = if let Some((columns, rows)) = part {
            let mut all = reserve::filled([0f32; 3], columns.len() * rows.len(), what)?;
            means(size, texel, (&columns, rows.start), |mean| mean.to_array(), &mut all);
            LevelTexels::Floats(Part { texels: all.into_flattened(), columns, rows })
        } else {
            let mut all = reserve::filled([0u16; 3], width as usize * height as usize, what)?;
            means(size, texel, (&(0..width), 0), to_words, &mut all);
            LevelTexels::Words(all)
        };
        Ok(Self { width, height, texels })
    }

    /// Means over the texels of a larger image in a temporary file, whose values are in [0, 1]. At
    /// most `whole` texels are held in memory.
    fn halve_tiles(
        tiles: &Tiles,
        texel: impl Fn(&[u8]) -> Vec3 + Sync,
        whole: u64,
        what: &str,
    ) -> Result<Self> {
        let (width, height) = half(tiles.size());
        let file =
            (!is_whole((width, height), whole)).then(|| Tiles::new((width, height), WORD_BYTES));
        let mut writer = file.flatten().map(|file| TileWriter::new(file, what)).transpose()?;
        let mut all = Vec::new();
        if writer.is_none() {
            reserve::exact(&mut all, width as usize * height as usize, what)?;
        }
        let mut rows = Vec::new();
        let mut band = Band::default();
        for first in (0..height).step_by(SIDE) {
            let last = (first + SIDE as u32).min(height) - 1;
            let ends = [first, last].map(|row| overlapped(row, tiles.size().1, height));
            band.read(tiles, ends[0].start as usize..ends[1].end as usize, what)?;
            rows.resize((last + 1 - first) as usize * width as usize, [0; WORD_BYTES]);
            let texel = |x, y| texel(band.texel(tiles, x, y));
            let convert = |mean| to_bytes(to_words(mean));
            means(tiles.size(), texel, (&(0..width), first), convert, &mut rows);
            match &mut writer {
                Some(writer) => {
                    let mut rows = rows.chunks_exact(width as usize);
                    rows.try_for_each(|row| writer.push(row.as_flattened()))?;
                }
                None => all.extend(rows.iter().map(|bytes| read_words(bytes))),
            }
        }
        let texels = match writer {
            Some(writer) => LevelTexels::Tiles(Arc::new(writer.finish()?)),
            None => LevelTexels::Words(all),
        };
        Ok(Self { width, height, texels })
    }
}

/// Bytes of a texel of [`LevelTexels::Words`].
const WORD_BYTES: usize = size_of::<[u16; 3]>();

fn to_words(mean: Vec3) -> [u16; 3] {
    (mean * f32::from(u16::MAX)).round().to_array().map(|value| value as u16)
}

#[inline(always)]
fn from_words(words: [u16; 3]) -> Vec3 {
    Vec3::from(words.map(f32::from)) * (1.0 / f32::from(u16::MAX))
}

fn to_bytes(words: [u16; 3]) -> [u8; WORD_BYTES] {
    let [[a, b], [c, d], [e, f]] = words.map(u16::to_le_bytes);
    [a, b, c, d, e, f]
}

#[inline(always)]
fn read_words(bytes: &[u8]) -> [u16; 3] {
    let word = |i: usize| u16::from_le_bytes([bytes[i], bytes[i + 1]]);
    [word(0), word(2), word(4)]
}

#[inline(always)]
fn from_bytes(bytes: &[u8]) -> Vec3 {
    from_words(read_words(bytes))
}

/// Size of the next smaller copy.
fn half((width, height): (u32, u32)) -> (u32, u32) {
    let half = |side: u32| (side / 2).max(1);
    (half(width), half(height))
}

/// Whether a copy of this size is held in memory, beside an image in a temporary file. `whole` is
/// the most texels of an image that is held in memory.
fn is_whole((width, height): (u32, u32), whole: u64) -> bool {
    u64::from(width) * u64::from(height) <= whole / 4
}

/// Upper bound of the memory of all smaller copies of an image in a temporary file, in bytes.
pub fn max_bytes(mut size: (u32, u32), whole: u64) -> u64 {
    let mut bytes = 0;
    while size != (1, 1) {
        size = half(size);
        bytes += match is_whole(size, whole) {
            true => u64::from(size.0) * u64::from(size.1) * WORD_BYTES as u64,
            false => tiles::max_bytes(size, WORD_BYTES),
        };
    }
    bytes
}

/// Memory of all smaller copies of an image of floats, in bytes. The image is black outside of
/// `part`.
pub fn float_bytes(mut size: (u32, u32), mut part: (Range<u32>, Range<u32>)) -> u64 {
    let mut bytes = 0u64;
    while size != (1, 1) {
        part = half_part(size, part);
        size = half(size);
        let texels = (part.0.len() as u64).saturating_mul(part.1.len() as u64);
        bytes = bytes.saturating_add(texels.saturating_mul(size_of::<[f32; 3]>() as u64));
    }
    bytes
}

/// Columns and rows of the next smaller copy to which the texels of a part contribute.
fn half_part(
    (width, height): (u32, u32),
    (columns, rows): (Range<u32>, Range<u32>),
) -> (Range<u32>, Range<u32>) {
    let (w, h) = half((width, height));
    let side = |part: Range<u32>, large: u32, small: u32| {
        let [start, end] = [part.start, part.end].map(|at| u64::from(at) * u64::from(small));
        // An image of no texels is refused later.
        let large = u64::from(large.max(1));
        (start / large) as u32..end.div_ceil(large) as u32
    };
    (side(columns, width, w), side(rows, height, h))
}

/// Computes rows of an image of half `size`, from the row `first`: means of the larger image's
/// texels.
fn means<T: Send>(
    (width, height): (u32, u32),
    texel: impl Fn(usize, usize) -> Vec3 + Sync,
    (columns, first): (&Range<u32>, u32),
    convert: impl Fn(Vec3) -> T + Sync,
    out: &mut [T],
) {
    let (w, h) = half((width, height));
    let mean = |x: u32, y: u32| {
        let mut sum = Vec3::ZERO;
        for (row, down) in overlaps(y, height, h) {
            for (column, across) in overlaps(x, width, w) {
                sum += texel(column, row) * (down * across);
            }
        }
        sum
    };
    parallel::fill(out, |i| {
        let (row, column) = (i / columns.len(), i % columns.len());
        convert(mean(columns.start + column as u32, first + row as u32))
    });
}

/// The texels of a side of `large` between the ends of texel `i` of a side of `small`.
fn overlapped(i: u32, large: u32, small: u32) -> Range<u32> {
    let ratio = f64::from(large) / f64::from(small);
    let (start, end) = (f64::from(i) * ratio, f64::from(i + 1) * ratio);
    start as u32..(end.ceil() as u32).min(large)
}

/// The texels of a side of `large` that texel `i` of a side of `small` overlaps, with their shares.
fn overlaps(i: u32, large: u32, small: u32) -> impl Iterator<Item = (usize, f32)> {
    let ratio = f64::from(large) / f64::from(small);
    let (start, end) = (f64::from(i) * ratio, f64::from(i + 1) * ratio);
    overlapped(i, large, small).filter_map(move |texel| {
        let part = end.min(f64::from(texel + 1)) - start.max(f64::from(texel));
        (part > 1e-9).then_some((texel as usize, (part / ratio) as f32))
    })
}

impl MipMap {
    /// The smaller copies of an image, on the threads of the current rayon pool. Beside an image
    /// in a temporary file, copies of more than `whole` / 4 texels are in such files, too.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn new(image: &TexelImage, whole: u64, what: &str) -> Result<Self> {
        let mut part = (!image.is_stored_as_bytes()).then(|| image.stored_part());
        let mut levels: Vec<Level> = Vec::new();
        let mut size = image.size();
        while size != (1, 1) {
            part = part.map(|part| half_part(size, part));
            let next = match (levels.last(), image.tiles()) {
                (None, Some((tiles, linear))) => {
                    Level::halve_tiles(tiles, |rgb| linear_rgb(rgb, linear), whole, what)
                }
                (None, None) => Level::halve(size, |x, y| image.texel(x, y), part.clone(), what),
                (Some(Level { texels: LevelTexels::Tiles(tiles), .. }), _) => {
                    Level::halve_tiles(tiles, from_bytes, whole, what)
                }
                (Some(level), _) => {
                    Level::halve(size, |x, y| level.texel(x, y), part.clone(), what)
                }
            }?;
            size = (next.width, next.height);
            levels.push(next);
        }
        Ok(Self { levels })
    }

    /// Memory of the smaller copies, in bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = self.levels.iter().map(|level| match &level.texels {
            LevelTexels::Words(words) => size_of_val(&words[..]) as u64,
            LevelTexels::Tiles(tiles) => tiles.bytes(),
            LevelTexels::Floats(part) => size_of_val(&part.texels[..]) as u64,
        });
        bytes.sum()
    }

    /// The temporary files.
    pub fn tiles(&self) -> impl Iterator<Item = &Tiles> {
        self.levels.iter().filter_map(|level| match &level.texels {
            LevelTexels::Tiles(tiles) => Some(&**tiles),
            _ => None,
        })
    }

    /// Mean colour of `image` over an area around `uv`.
    ///
    /// Points along the longer axis of the area, each a trilinear lookup as wide as the shorter
    /// axis: McCormack et al. 1999, "Feline: Fast Elliptical Lines for Anisotropic Texture
    /// Mapping", SIGGRAPH. The variance of the points' positions and that of a box as wide as a
    /// lookup add to that of the area, so that a further point changes the mean by little.
    pub fn lookup(&self, image: &TexelImage, uv: DVec2, area: &Footprint, wrap: [Wrap; 2]) -> Vec3 {
        let (width, height) = image.size();
        let size = DVec2::new(f64::from(width), f64::from(height));
        let (long, length, thickness) = axes(area.sides.map(|side| side * size));
        // An area within a texel is a point.
        if !(length > 1.0) {
            return image.bilinear(uv, wrap);
        }
        let width = thickness.max(length / MAX_POINTS).max(1.0);
        let points = (length / width).ceil();
        let others = (points * points - 1.0).max(1.0);
        let step = long / size * (((length * length - width * width).max(0.0) / others).sqrt());
        let level = width.log2();
        let mut sum = Vec3::ZERO;
        for point in 0..points as u32 {
            let along = f64::from(point) - 0.5 * (points - 1.0);
            sum += self.trilinear(image, uv + step * along, level, wrap);
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
            Some(level) => level.bilinear(uv, wrap),
            None => image.bilinear(uv, wrap),
        }
    }
}

/// The axes of the ellipse through the ends of two conjugate half sides: the unit vector along the
/// longer one, its length, and that of the shorter one.
fn axes([a, b]: [DVec2; 2]) -> (DVec2, f64, f64) {
    let (mean, half) = (
        0.5 * (a.length_squared() + b.length_squared()),
        0.5 * (a.length_squared() - b.length_squared()),
    );
    let mixed = a.dot(b);
    let root = half.hypot(mixed);
    let long = (mean + root).sqrt();
    // Exact where the ellipse is a line: the area is the product of the axes.
    let short = a.perp_dot(b).abs() / long;
    // The angle at which a cos + b sin is longest, from twice the angle.
    let cosine = if root > 0.0 { (0.5 * (1.0 + half / root)).max(0.0).sqrt() } else { 1.0 };
    let sine = if root > 0.0 { (0.5 * (1.0 - half / root)).max(0.0).sqrt() } else { 0.0 };
    ((a * cosine + b * sine.copysign(mixed)) / long, long, short)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

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
            let map = MipMap::new(&image, u64::MAX, "test").unwrap();
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

    /// Copies of a part of an image have the texels of copies of the whole image, and hardly more.
    #[test]
    fn copies_of_a_part_leave_the_same_texels_out() {
        let parts = [(0..64, 0..64), (3..20, 40..64), (63..64, 0..1), (5..5, 9..9), (7..8, 0..61)];
        for (size, (columns, rows)) in
            [(64, 64), (37, 61), (64, 3)].into_iter().flat_map(|s| parts.clone().map(|p| (s, p)))
        {
            let within = |side: Range<u32>, size: u32| side.start.min(size)..side.end.min(size);
            let (columns, rows) = (within(columns, size.0), within(rows, size.1));
            let value = |x: u32, y: u32| [(x * 37 + y * 101) as f32, x as f32, 1.0];
            let all = (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y)));
            let inside = |x: u32, y: u32| columns.contains(&x) && rows.contains(&y);
            let black = |(x, y)| if inside(x, y) { value(x, y) } else { [0.0; 3] };
            let whole = TexelImage::from_floats(size, all.clone().flat_map(black).collect());
            let kept = all.filter(|&(x, y)| inside(x, y)).flat_map(|(x, y)| value(x, y));
            let part = TexelImage::from_part(size, columns.clone(), rows.clone(), kept.collect());
            let [whole, map] =
                [&whole, &part].map(|image| MipMap::new(image, u64::MAX, "test").unwrap());
            for (a, b) in whole.levels.iter().zip(&map.levels) {
                assert_eq!((a.width, a.height), (b.width, b.height));
                for at in 0..a.width as usize * a.height as usize {
                    let (x, y) = (at % a.width as usize, at / a.width as usize);
                    assert_eq!(a.texel(x, y), b.texel(x, y), "{size:?} {columns:?} {rows:?}");
                }
            }
            let stored = part.stored_part();
            assert_eq!(map.bytes(), float_bytes(size, stored));
            assert!(map.bytes() <= part.bytes() + 12 * 6 * 70);
        }
    }

    #[test]
    fn the_area_of_the_whole_image_has_its_mean() {
        let image = floats(64, 64);
        let map = MipMap::new(&image, u64::MAX, "test").unwrap();
        let mean = map.levels.last().unwrap().texel(0, 0);
        for sides in [[DVec2::X, DVec2::Y], [DVec2::X * 9.0, DVec2::Y * 1e3]] {
            let found = map.lookup(&image, DVec2::new(0.3, 0.7), &Footprint { sides }, REPEAT);
            assert!((found - mean).abs().max_element() < 1e-3, "{found} {mean}");
        }
    }

    #[test]
    fn a_point_is_looked_up_as_without_a_map() {
        let image = floats(37, 23);
        let map = MipMap::new(&image, u64::MAX, "test").unwrap();
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
        let map = MipMap::new(&image, u64::MAX, "test").unwrap();
        let area = Footprint { sides: [DVec2::Y * 0.2, DVec2::X / 64.0] };
        let black = map.lookup(&image, DVec2::new(2.0 / 64.0, 0.5), &area, REPEAT);
        let white = map.lookup(&image, DVec2::new(6.0 / 64.0, 0.5), &area, REPEAT);
        assert!(black.x < 0.01 && white.x > 0.99, "{black} {white}");
    }

    #[test]
    fn axes_are_those_of_the_ellipse() {
        for (turn, scale, mix) in
            [(0.0, 0.3, 0.0), (0.4, 0.2, 1.1), (2.0, 1.0, 0.7), (1.2, 0.0, 2.5)]
        {
            // Any two conjugate half sides of an ellipse with these axes.
            let (long, short) = (DVec2::from_angle(turn) * 3.0, DVec2::from_angle(turn).perp());
            let at = |angle: f64| long * angle.cos() + short * (3.0 * scale * angle.sin());
            let (direction, length, thickness) = axes([at(mix), at(mix + 0.5 * PI)]);
            assert!((length - 3.0).abs() < 1e-12 && (thickness - 3.0 * scale).abs() < 1e-9);
            let parallel = direction.dot(long).abs() / 3.0;
            assert!(scale == 1.0 || (parallel - 1.0).abs() < 1e-9, "{parallel}");
        }
    }

    /// More points than before change the mean by little: an area that is hardly longer than wide
    /// is read as a square one.
    #[test]
    fn the_mean_changes_little_with_the_number_of_points() {
        let image = floats(64, 64);
        let map = MipMap::new(&image, u64::MAX, "test").unwrap();
        let read = |length: f64, uv| {
            let sides = [DVec2::X * (4.0 * length / 64.0), DVec2::Y * (4.0 / 64.0)];
            map.lookup(&image, uv, &Footprint { sides }, REPEAT)
        };
        for i in 0..100 {
            let uv = DVec2::new(0.013 * f64::from(i), 0.029 * f64::from(i));
            let off = (read(1.000_001, uv) - read(1.0, uv)).abs().max_element();
            assert!(off < 0.05, "{off}");
        }
    }
}
