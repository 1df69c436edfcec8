//! Environment maps: an image of the radiance from all directions, and the choice of directions in
//! proportion to it.
//!
//! The image is equirectangular (latlong). Its top row is straight up (+y), its middle column is
//! the north (-z), and the columns go east (+x). For the light of surfaces, each texel is a patch
//! of the sphere with constant radiance. Camera rays and mirrors see it with bilinear
//! interpolation.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;

use super::image_file::{self, TextureSize};
use super::texture::Texture;
use crate::error::Result;
use crate::math::{atan2, luminance};
use crate::reserve;
use crate::scene::{Filter, Wrap};

/// The radiance from all directions.
#[derive(Debug)]
pub struct EnvironmentMap {
    texture: Texture,
    /// Cosines of the polar angle at the upper border of each row, and at the end of the last.
    cosines: Vec<f32>,
    /// By row: the share of the importance of this row and all rows before.
    rows: Vec<f32>,
    /// By texel: the share of its row's importance of this texel and all before.
    columns: Vec<f32>,
    /// Mean luminance of the sphere. Only what exceeds it is important.
    mean: f32,
    /// 1 over the integral of the importance by solid angle. 0 if no texel is brighter than
    /// others.
    scale: f32,
}

/// What a map sends from one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Radiance, in linear RGB.
    pub radiance: Vec3,
    /// Density of [`EnvironmentMap::direction`] by solid angle.
    pub density: f32,
}

impl EnvironmentMap {
    /// Prepares an image for sampling.
    ///
    /// The importance of a texel is its luminance above the mean. Directions with the density of
    /// the cosine, which every shading point has too, take care of the rest: Karlik et al. 2019,
    /// "MIS Compensation: Optimizing Sampling Techniques in Multiple Importance Sampling", ACM
    /// Transactions on Graphics 38(6).
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn new(texture: Texture, what: &str) -> Result<Self> {
        let (width, height) = (texture.width() as usize, texture.height() as usize);
        let cosine = |row: usize| (PI * row as f64 / height as f64).cos();
        let angle = |row: usize| (cosine(row) - cosine(row + 1)) * TAU / width as f64;
        let bright = |x: usize, y: usize| luminance(texture.texel(x, y).to_array());
        let sums = (0..height)
            .into_par_iter()
            .map(|y| (0..width).map(|x| bright(x, y)).sum::<f64>() * angle(y));
        // Collected first: a parallel sum would depend on the number of threads.
        let sums: Vec<f64> = sums.collect();
        let mean = (sums.iter().sum::<f64>() / (2.0 * TAU)) as f32;

        let mut columns = reserve::filled(0f32, width * height, what)?;
        let totals: Vec<f64> = columns
            .par_chunks_exact_mut(width)
            .enumerate()
            .map(|(y, row)| {
                angle(y) * accumulate(row, |x| (bright(x, y) - f64::from(mean)).max(0.0) as f32)
            })
            .collect();
        let mut rows = vec![0.0; height];
        let total = accumulate(&mut rows, |y| totals[y] as f32);
        // A constant image exceeds its mean by rounding alone.
        let flat = total <= 1e-5 * f64::from(mean) * 2.0 * TAU;
        let scale = if flat { 0.0 } else { (1.0 / total) as f32 };
        let cosines = (0..=height).map(|row| cosine(row) as f32).collect();
        Ok(Self { texture, cosines, rows, columns, mean, scale })
    }

    /// Memory that the image at `path` needs as a map, from its header alone.
    ///
    /// # Errors
    /// The errors of [`Texture::load`] that concern the header.
    pub fn size(path: &Path) -> Result<TextureSize> {
        let ((width, height), size) = image_file::size(path, u64::MAX)?;
        let table = u64::from(width) * u64::from(height) * size_of::<f32>() as u64;
        let stored = size.stored.saturating_add(table);
        Ok(TextureSize { stored, decoding: size.decoding.max(stored), mip_map: 0 })
    }

    /// The image of the map.
    pub fn texture(&self) -> &Texture {
        &self.texture
    }

    /// Memory of the image and of the shares by texel, in bytes.
    pub fn bytes(&self) -> u64 {
        self.texture.bytes() + size_of_val(&self.columns[..]) as u64
    }

    /// Mean luminance over all directions.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// Whether all directions are equally bright, so that none is more important.
    pub fn is_uniform(&self) -> bool {
        self.scale == 0.0
    }

    /// A unit direction with a density that is proportional to the importance, for a point in the
    /// unit square.
    #[inline(always)]
    pub fn direction(&self, [s, t]: [f32; 2]) -> Vec3 {
        let (row, down) = pick(&self.rows, t);
        let width = self.texture.width() as usize;
        let (column, across) = pick(&self.columns[row * width..(row + 1) * width], s);
        let (upper, lower) = (self.cosines[row], self.cosines[row + 1]);
        // The height on a sphere is uniform by area (Archimedes).
        let y = upper + (lower - upper) * down;
        let around = (1.0 - y * y).max(0.0).sqrt();
        let azimuth = ((column as f32 + across) / width as f32 - 0.5) * TAU as f32;
        Vec3::new(around * azimuth.sin(), y, -around * azimuth.cos())
    }

    /// Radiance and density of a unit direction.
    #[inline(always)]
    pub fn arrival(&self, direction: Vec3) -> Arrival {
        let (u, v) = place(direction);
        let column = (u * self.texture.width() as f32) as usize;
        let row = (v * self.texture.height() as f32) as usize;
        let column = column.min(self.texture.width() as usize - 1);
        let row = row.min(self.texture.height() as usize - 1);
        let radiance = self.texture.texel(column, row);
        let excess = luminance(radiance.to_array()) - f64::from(self.mean);
        let density = excess.max(0.0) as f32 * self.scale;
        Arrival { radiance, density }
    }

    /// Radiance of a unit direction as camera rays and mirrors see it.
    pub fn seen(&self, direction: Vec3) -> Vec3 {
        let (u, v) = place(direction);
        let (u, v) = (f64::from(u), f64::from(v));
        self.texture.lookup(u, v, Filter::Bilinear, Wrap::Repeat, Wrap::Clamp)
    }
}

/// Place of a unit direction in the image, in the unit square; v from the top.
#[inline(always)]
fn place(direction: Vec3) -> (f32, f32) {
    let Vec3 { x, y, z } = direction;
    let u = 0.5 + atan2(x, -z) * (1.0 / TAU) as f32;
    (u, atan2((x * x + z * z).sqrt(), y) * (1.0 / PI) as f32)
}

/// Sets `ends` to the cumulative share of each value, so that the last is 1. Returns the sum.
fn accumulate(ends: &mut [f32], value: impl Fn(usize) -> f32) -> f64 {
    let total: f64 = (0..ends.len()).map(|i| f64::from(value(i))).sum();
    let last = (0..ends.len()).rev().find(|&i| value(i) > 0.0);
    let mut sum = 0.0;
    for (i, end) in ends.iter_mut().enumerate() {
        sum += f64::from(value(i));
        // Rounding must not leave a gap before 1.
        *end = if last.is_none_or(|last| i >= last) { 1.0 } else { (sum / total) as f32 };
    }
    total
}

/// The interval that holds `x` in [0, 1), and the place of `x` in it, in [0, 1).
#[inline(always)]
fn pick(ends: &[f32], x: f32) -> (usize, f32) {
    let index = ends.partition_point(|&end| end <= x).min(ends.len() - 1);
    let start = if index > 0 { ends[index - 1] } else { 0.0 };
    let within = (x - start) / (ends[index] - start);
    (index, within.clamp(0.0, 1.0 - f32::EPSILON))
}
