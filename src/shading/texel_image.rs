//! The stored texels of an image, in linear RGB.

use std::ops::Range;
use std::sync::Arc;

use glam::{DVec2, Vec3};

use super::points::{Lanes3, set_lane};
use super::texel_filter;
use super::tiles::{TileCache, TileWriter, Tiles};
use crate::error::Result;
use crate::ray::LANES;
use crate::scene::Wrap;

/// An image in linear RGB; rows from the top.
#[derive(Debug, Clone)]
pub struct TexelImage {
    width: u32,
    height: u32,
    texels: Texels,
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
    /// The same in a temporary file.
    Tiles(Arc<Tiles>, Box<[f32; 256]>),
    /// Linear RGB of every texel.
    Floats(Vec<f32>),
    /// Linear RGB of a part of the image; the rest is black.
    Part(Box<Part>),
}

/// The texels of an image that are not black because its file lacks them.
#[derive(Debug, Clone)]
pub(super) struct Part {
    /// Linear RGB, row by row.
    pub texels: Vec<f32>,
    /// Columns of the image that it has.
    pub columns: Range<u32>,
    /// Rows of the image that it has.
    pub rows: Range<u32>,
}

impl Part {
    /// The texel in column `x` of row `y`; black outside of the part.
    pub fn texel(&self, x: usize, y: usize) -> Vec3 {
        let at = (x as u32, y as u32);
        if !self.columns.contains(&at.0) || !self.rows.contains(&at.1) {
            return Vec3::ZERO;
        }
        let (x, y) = (at.0 - self.columns.start, at.1 - self.rows.start);
        let at = 3 * (y as usize * self.columns.len() + x as usize);
        Vec3::from_slice(&self.texels[at..at + 3])
    }
}

impl TexelImage {
    /// An image of RGB bytes. `linear` has the linear value of each byte, in [0, 1].
    pub fn from_bytes(
        (width, height): (u32, u32),
        bytes: Vec<u8>,
        linear: Box<[f32; 256]>,
    ) -> Self {
        Self { width, height, texels: Texels::Bytes(bytes, linear) }
    }

    /// An image of RGB bytes in a temporary file.
    pub fn from_tiles(tiles: Tiles, linear: Box<[f32; 256]>) -> Self {
        let (width, height) = tiles.size();
        Self { width, height, texels: Texels::Tiles(Arc::new(tiles), linear) }
    }

    /// Moves RGB bytes into a temporary file. An image of floats stays in memory.
    ///
    /// # Errors
    /// Errors of the disk.
    pub fn into_tiles(self, mut writer: TileWriter) -> Result<Self> {
        match self.texels {
            Texels::Bytes(bytes, linear) => {
                for row in bytes.chunks_exact(3 * self.width as usize) {
                    writer.push(row)?;
                }
                Ok(Self::from_tiles(writer.finish()?, linear))
            }
            texels => Ok(Self { texels, ..self }),
        }
    }

    /// The temporary file of the texels, and the linear value of each byte. `None` for an image in
    /// memory.
    pub fn tiles(&self) -> Option<(&Tiles, &[f32; 256])> {
        match &self.texels {
            Texels::Tiles(tiles, linear) => Some((tiles, linear)),
            _ => None,
        }
    }

    /// An image of linear RGB floats.
    pub fn from_floats((width, height): (u32, u32), floats: Vec<f32>) -> Self {
        Self { width, height, texels: Texels::Floats(floats) }
    }

    /// An image of linear RGB floats in these columns and rows. The rest of the image is black.
    pub fn from_part(
        (width, height): (u32, u32),
        columns: Range<u32>,
        rows: Range<u32>,
        floats: Vec<f32>,
    ) -> Self {
        let texels = match (&columns, &rows) == (&(0..width), &(0..height)) {
            true => Texels::Floats(floats),
            false => Texels::Part(Box::new(Part { texels: floats, columns, rows })),
        };
        Self { width, height, texels }
    }

    /// Width and height in texels, both >= 1.
    #[inline(always)]
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Memory of the texels, in bytes.
    pub fn bytes(&self) -> u64 {
        let bytes = match &self.texels {
            Texels::Bytes(bytes, table) => bytes.len() + size_of_val(&**table),
            Texels::Tiles(tiles, table) => tiles.bytes() as usize + size_of_val(&**table),
            Texels::Floats(floats) => size_of_val(&**floats),
            Texels::Part(part) => size_of_val(&part.texels[..]),
        };
        bytes as u64
    }

    /// Columns and rows of the texels in memory; black texels around them may be left out.
    pub fn stored_part(&self) -> (Range<u32>, Range<u32>) {
        match &self.texels {
            Texels::Part(part) => (part.columns.clone(), part.rows.clone()),
            _ => (0..self.width, 0..self.height),
        }
    }

    /// Whether the texels are stored as bytes. Then every value is in [0, 1].
    pub fn is_stored_as_bytes(&self) -> bool {
        matches!(self.texels, Texels::Bytes(..) | Texels::Tiles(..))
    }

    /// The texel in column `x` of row `y`, both inside the image.
    #[inline(always)]
    pub fn texel(&self, x: usize, y: usize) -> Vec3 {
        let at = 3 * (y * self.width as usize + x);
        match &self.texels {
            Texels::Bytes(bytes, table) => linear_rgb(&bytes[at..at + 3], table),
            Texels::Tiles(tiles, table) => {
                tiles.with(|cache| linear_rgb(cache.texel(tiles, x, y), table))
            }
            Texels::Floats(floats) => Vec3::from_slice(&floats[at..at + 3]),
            Texels::Part(part) => part.texel(x, y),
        }
    }

    /// 16 texels, by column and row.
    #[inline(always)]
    pub fn texels(&self, x: &[u32; LANES], y: &[u32; LANES]) -> Lanes3 {
        let mut all = [[0.0; LANES]; 3];
        if let Texels::Floats(floats) = &self.texels {
            for i in 0..LANES {
                let at = 3 * (y[i] as usize * self.width as usize + x[i] as usize);
                set_lane(&mut all, i, Vec3::from_slice(&floats[at..at + 3]));
            }
        } else {
            for i in 0..LANES {
                set_lane(&mut all, i, self.texel(x[i] as usize, y[i] as usize));
            }
        }
        all
    }

    /// The texel at `uv`. Any u, v are safe.
    #[inline(always)]
    pub fn nearest(&self, uv: DVec2, wrap: [Wrap; 2]) -> Vec3 {
        let (x, y) = texel_filter::nearest(self.size(), uv, wrap);
        self.texel(x, y)
    }

    /// Interpolates between the four texels around `uv`. Any u, v are safe.
    #[inline(always)]
    pub fn bilinear(&self, uv: DVec2, wrap: [Wrap; 2]) -> Vec3 {
        match &self.texels {
            Texels::Tiles(tiles, table) => bilinear_in_tiles(tiles, table, uv, wrap),
            Texels::Bytes(bytes, table) => {
                let width = self.width as usize;
                texel_filter::bilinear(self.size(), uv, wrap, |x, y| {
                    let at = 3 * (y * width + x);
                    linear_rgb(&bytes[at..at + 3], table)
                })
            }
            _ => texel_filter::bilinear(self.size(), uv, wrap, |x, y| self.texel(x, y)),
        }
    }

    /// Column and row of the first texel with a value that is NaN or infinite.
    pub fn first_non_finite(&self) -> Option<[u32; 2]> {
        let (values, first, width) = self.floats()?;
        let at = values.iter().position(|value| !value.is_finite())?;
        Some(place(at / 3, first, width))
    }

    /// Counts the texels with a negative value. `None` if there are none.
    pub fn negative(&self) -> Option<Negative> {
        let (values, first, width) = self.floats()?;
        let negative = |rgb: &[f32]| rgb.iter().any(|&value| value < 0.0);
        let at = values.chunks_exact(3).position(negative)?;
        let rest = values[3 * at..].chunks_exact(3).filter(|rgb| negative(rgb));
        Some(Negative { texels: rest.count() as u64, first: place(at, first, width) })
    }

    /// The stored floats, which may have any values; column and row of the first; number of
    /// columns. `None` for bytes.
    fn floats(&self) -> Option<(&[f32], [u32; 2], u32)> {
        match &self.texels {
            Texels::Bytes(..) | Texels::Tiles(..) => None,
            Texels::Floats(floats) => Some((floats, [0; 2], self.width)),
            Texels::Part(part) => {
                let first = [part.columns.start, part.rows.start];
                Some((&part.texels, first, part.columns.len() as u32))
            }
        }
    }
}

/// The linear value of RGB bytes.
#[inline(always)]
pub(super) fn linear_rgb(rgb: &[u8], table: &[f32; 256]) -> Vec3 {
    Vec3::new(table[rgb[0] as usize], table[rgb[1] as usize], table[rgb[2] as usize])
}

#[inline(never)]
fn bilinear_in_tiles(tiles: &Tiles, table: &[f32; 256], uv: DVec2, wrap: [Wrap; 2]) -> Vec3 {
    tiles.with(|cache: &mut TileCache| {
        let texel = |x, y| linear_rgb(cache.texel(tiles, x, y), table);
        texel_filter::bilinear(tiles.size(), uv, wrap, texel)
    })
}

/// Column and row of the texel with index `texel`, in rows of `width` that begin at (`left`,
/// `top`).
fn place(texel: usize, [left, top]: [u32; 2], width: u32) -> [u32; 2] {
    let (texel, width) = (texel as u64, u64::from(width));
    [left + (texel % width) as u32, top + (texel / width) as u32]
}
