//! Environment maps: an image of the radiance from all directions, and the choice of directions in
//! proportion to it.
//!
//! The image is equirectangular (latlong). Its top row is straight up (+y), its middle column is
//! the north (-z), and the columns go east (+x). For the light of surfaces, each texel is a patch
//! of the sphere with constant radiance. Camera rays and mirrors see it with bilinear
//! interpolation.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use glam::{DVec3, Vec3};

use super::image_file::{self, TextureSize};
use super::points::{Lanes, Lanes3, lane};
use super::texture::Texture;
use crate::error::Result;
use crate::math::{atan2, luminance};
use crate::parallel;
use crate::ray::LANES;
use crate::reserve;
use crate::scene::{Filter, Wrap};

/// Largest [`Moments::variance_by_cosine`] of a smooth map. Under a sky of 0.43, the cosine alone
/// has the smaller error at 1 to 64 samples, under one of 0.50 only at 1 to 16.
const SMOOTH: f64 = 0.45;

/// The radiance from all directions.
#[derive(Debug)]
pub struct EnvironmentMap {
    texture: Texture,
    /// Cosines of the polar angle at the upper border of each row, and at the end of the last.
    cosines: Vec<f32>,
    /// By row: the share of the importance of this row and all rows before. Empty if the map is
    /// smooth.
    rows: Vec<f32>,
    /// By texel: the share of its row's importance of this texel and all before. Empty if the map
    /// is smooth.
    columns: Vec<f32>,
    /// Mean luminance of the sphere. Only what exceeds it is important.
    mean: f32,
    /// 1 over the integral of the importance by solid angle. 0 if the map is smooth.
    scale: f32,
}

/// Means over the sphere.
struct Moments {
    /// Of the luminance.
    mean: f64,
    /// Of its square.
    square: f64,
    /// Of the luminance times the direction.
    vector: DVec3,
}

impl Moments {
    /// The means of an image with this luminance of texel (x, y).
    fn new([width, height]: [usize; 2], bright: impl Fn(usize, usize) -> f64 + Sync) -> Self {
        let azimuth = |x: usize| ((x as f64 + 0.5) / width as f64 - 0.5) * TAU;
        let sides: Vec<(f64, f64)> = (0..width).map(|x| azimuth(x).sin_cos()).collect();
        let row = |y: usize| {
            let [upper, lower] = [y, y + 1].map(|row| (PI * row as f64 / height as f64).cos());
            let up = (upper + lower) / 2.0;
            let around = (1.0 - up * up).max(0.0).sqrt();
            let (mut sum, mut squares, mut side, mut ahead) = (0.0, 0.0, 0.0, 0.0);
            for (x, (sin, cos)) in sides.iter().enumerate() {
                let value = bright(x, y);
                sum += value;
                squares += value * value;
                side += value * sin;
                ahead -= value * cos;
            }
            let vector = DVec3::new(around * side, up * sum, around * ahead);
            let share = (upper - lower) / (2.0 * width as f64);
            Self { mean: share * sum, square: share * squares, vector: share * vector }
        };
        // Collected first: a parallel sum would depend on the number of threads.
        let rows = parallel::map(0..height, row);
        let sum = |value: fn(&Self) -> f64| rows.iter().map(value).sum();
        let vector = rows.iter().map(|row| row.vector).sum();
        Self { mean: sum(|row| row.mean), square: sum(|row| row.square), vector }
    }

    /// Variance of the light that one direction with the density of the cosine brings to a diffuse
    /// surface in the open, over its squared mean; both are means over all normals. The squared
    /// irradiance is that of the first two bands of spherical harmonics: Ramamoorthi and Hanrahan
    /// 2001, "An Efficient Representation for Irradiance Environment Maps", eq. 7 to 9. It is not
    /// above the whole one.
    fn variance_by_cosine(&self) -> f64 {
        let irradiance = self.mean * self.mean + 4.0 / 3.0 * self.vector.length_squared();
        if irradiance > 0.0 { self.square / irradiance - 1.0 } else { 0.0 }
    }
}

/// What a map sends from 16 directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrivals {
    /// Radiance, in linear RGB.
    pub radiance: Lanes3,
    /// Density of [`EnvironmentMap::direction`] by solid angle.
    pub density: Lanes,
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
        let moments = Moments::new([width, height], bright);
        let mean = moments.mean as f32;
        let cosines = (0..=height).map(|row| cosine(row) as f32).collect();
        if moments.variance_by_cosine() <= SMOOTH {
            let (columns, rows) = Default::default();
            return Ok(Self { texture, cosines, rows, columns, mean, scale: 0.0 });
        }
        let mut columns = reserve::filled(0f32, width * height, what)?;
        let totals = parallel::map(columns.chunks_mut(width).enumerate(), |(y, row)| {
            angle(y) * accumulate(row, |x| (bright(x, y) - f64::from(mean)).max(0.0) as f32)
        });
        let mut rows = vec![0.0; height];
        let total = accumulate(&mut rows, |y| totals[y] as f32);
        Ok(Self { texture, cosines, rows, columns, mean, scale: (1.0 / total) as f32 })
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

    /// Whether the image is so smooth that directions with the density of the cosine alone have
    /// less variance. [`EnvironmentMap::direction`] is then not available, and its density is 0.
    pub fn is_smooth(&self) -> bool {
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

    /// Radiance and density of 16 unit directions.
    #[inline(always)]
    pub fn arrivals(&self, directions: &Lanes3) -> Arrivals {
        let size = [self.texture.width(), self.texture.height()];
        let (mut columns, mut rows) = ([0; LANES], [0; LANES]);
        for i in 0..LANES {
            let (u, v) = place(lane(directions, i));
            columns[i] = ((u * size[0] as f32) as u32).min(size[0] - 1);
            rows[i] = ((v * size[1] as f32) as u32).min(size[1] - 1);
        }
        // Alone in their loop, the reads wait for memory together.
        let radiance = self.texture.texels(&columns, &rows);
        let mut density = [0.0; LANES];
        for (i, density) in density.iter_mut().enumerate() {
            let excess = luminance(lane(&radiance, i).to_array()) - f64::from(self.mean);
            *density = excess.max(0.0) as f32 * self.scale;
        }
        Arrivals { radiance, density }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The moments of a luminance by direction.
    fn moments(bright: impl Fn(DVec3) -> f64 + Sync) -> Moments {
        let [width, height] = [256, 128];
        Moments::new([width, height], |x, y| {
            let (sin, cos) = (PI * (y as f64 + 0.5) / height as f64).sin_cos();
            let (side, ahead) = (TAU * ((x as f64 + 0.5) / width as f64 - 0.5)).sin_cos();
            bright(DVec3::new(sin * side, cos, -sin * ahead))
        })
    }

    #[test]
    fn variance_by_the_cosine_is_that_of_closed_forms() {
        // A luminance of 1 + a d has the irradiance 1 + 2/3 a n, and the mean square 1 + |a|^2/3.
        for a in [DVec3::ZERO, DVec3::Y, DVec3::NEG_Z, DVec3::new(0.3, -0.4, 0.5)] {
            let expected = (1.0 + a.length_squared() / 3.0)
                / (1.0 + a.length_squared() * 4.0 / 9.0 / 3.0)
                - 1.0;
            let found = moments(|d| 1.0 + a.dot(d)).variance_by_cosine();
            assert!((found - expected).abs() < 1e-4, "{a}: {found} for {expected}");
        }
        assert_eq!(moments(|_| 0.0).variance_by_cosine(), 0.0);
    }

    #[test]
    fn only_an_image_with_a_bright_light_is_not_smooth() {
        let overcast = moments(|d| 1.0 + 2.0 * d.y.max(0.0));
        let sun = moments(|d| if d.y > 0.99 { 1000.0 } else { 1.0 });
        assert!(overcast.variance_by_cosine() < SMOOTH);
        assert!(sun.variance_by_cosine() > 10.0 * SMOOTH);
    }
}
