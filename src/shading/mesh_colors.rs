//! Colours of a mesh: those of the file, or a scalar property through a colour map.

use glam::Vec3;

use crate::colormap::ColorMap;
use crate::mesh::{Colors, MeshElement, Scalars};
use crate::output::srgb;
use crate::scene::ColorSpace;

/// Number of segments of a sampled colour map. The crate's maps have 8 bits per channel.
const SEGMENTS: usize = 256;

/// The colours of a shape. They multiply the colour of its material.
#[derive(Debug, Clone)]
pub struct MeshColors {
    /// What has a value: vertices or triangles.
    pub element: MeshElement,
    /// The values, and how they become colours.
    pub source: ColorSource,
}

/// Values, and how they become colours.
#[derive(Debug, Clone)]
pub enum ColorSource {
    /// Colours as stored in the file.
    Stored(StoredColors),
    /// Numbers through a colour map.
    Mapped(Box<MappedScalars>),
}

/// Colours as stored in the file, and how to decode them.
#[derive(Debug, Clone)]
pub struct StoredColors {
    /// Values as stored in the file.
    pub values: Colors,
    /// Alpha as stored. 1 shows the colour, 0 shows white. `None` is 1 everywhere.
    pub alpha: Option<Scalars>,
    /// Colour space of the values; decoding makes them linear.
    pub space: ColorSpace,
}

/// Numbers, and the colour map that shows them.
#[derive(Debug, Clone)]
pub struct MappedScalars {
    /// Values as stored in the file.
    values: Scalars,
    /// Factor of all values, a power of two, with which no difference from `low` overflows.
    unit: f64,
    /// Value at the start of the map, times `unit`.
    low: f64,
    /// The product is 1 / (value at the end of the map, times `unit`, - `low`). There are two
    /// factors, because the reciprocal of a denormal difference is infinite.
    scales: [f64; 2],
    /// Linear colours at equal steps along the map.
    table: [Vec3; SEGMENTS + 1],
    /// Colour of values that are not finite.
    nan: Vec3,
}

impl MeshColors {
    /// Returns the linear colour at a point of triangle `prim`. `corners` are its vertices,
    /// `weights` the barycentrics of the point.
    pub(super) fn at(&self, prim: u32, corners: [u32; 3], weights: [f32; 3]) -> Vec3 {
        match (&self.source, self.element) {
            (ColorSource::Stored(colors), MeshElement::Vertex) => {
                let [a, b, c] = corners.map(|corner| colors.at(corner));
                a * weights[0] + b * weights[1] + c * weights[2]
            }
            (ColorSource::Stored(colors), MeshElement::Face) => colors.at(prim),
            (ColorSource::Mapped(scalars), MeshElement::Vertex) => {
                let values = corners.map(|corner| scalars.values.get(corner as usize));
                scalars.mean_color(values, weights)
            }
            (ColorSource::Mapped(scalars), MeshElement::Face) => scalars.of(prim),
        }
    }

    /// Returns the linear colour of one vertex or triangle.
    pub(super) fn of(&self, index: u32) -> Vec3 {
        match &self.source {
            ColorSource::Stored(colors) => colors.at(index),
            ColorSource::Mapped(scalars) => scalars.of(index),
        }
    }

    /// Heap memory in bytes.
    pub(super) fn bytes(&self) -> usize {
        match &self.source {
            ColorSource::Stored(colors) => {
                colors.values.bytes() + colors.alpha.as_ref().map_or(0, Scalars::bytes)
            }
            ColorSource::Mapped(scalars) => scalars.values.bytes() + size_of::<MappedScalars>(),
        }
    }
}

impl StoredColors {
    fn at(&self, index: u32) -> Vec3 {
        let i = index as usize;
        let stored = match &self.values {
            Colors::U8(c) => c[i].map(|x| f32::from(x) / 255.0),
            Colors::U16(c) => c[i].map(|x| f32::from(x) / 65535.0),
            Colors::F32(c) => c[i],
        };
        let color = Vec3::from(match self.space {
            ColorSpace::Linear => stored,
            ColorSpace::Srgb => stored.map(|c| srgb::to_linear(c.into()) as f32),
        });
        let Some(alpha) = &self.alpha else { return color };
        let maximum = match alpha {
            Scalars::U8(_) => 255.0,
            Scalars::U16(_) => 65535.0,
            Scalars::F32(_) | Scalars::F64(_) => 1.0,
        };
        let alpha = (alpha.get(i) / maximum).clamp(0.0, 1.0) as f32;
        Vec3::ONE + (color - Vec3::ONE) * alpha
    }
}

impl MappedScalars {
    /// Values that `map` shows from `range[0]` to `range[1]`, which must differ.
    pub fn new(values: Scalars, map: ColorMap, range: [f64; 2], nan: Vec3) -> Self {
        let linear = |c: u8| srgb::to_linear(f64::from(c) / 255.0) as f32;
        let color = |i: usize| Vec3::from(map.srgb(i as f64 / SEGMENTS as f64).map(linear));
        // Up to the limit, the difference from the largest f64 rounds to a finite number.
        let unit = if range.iter().all(|end| end.abs() <= 1e290) { 1.0 } else { 0.25 };
        let [low, high] = range.map(|end| end * unit);
        let first = if (high - low).is_subnormal() { 2f64.powi(64) } else { 1.0 };
        let scales = [first, 1.0 / ((high - low) * first)];
        Self { values, unit, low, scales, table: std::array::from_fn(color), nan }
    }

    /// The colour of one value.
    fn of(&self, index: u32) -> Vec3 {
        self.color(self.values.get(index as usize))
    }

    /// The colour of the weighted mean of three values: the number is interpolated, not the colour.
    fn mean_color(&self, values: [f64; 3], weights: [f32; 3]) -> Vec3 {
        if values.iter().any(|value| !value.is_finite()) {
            return self.nan;
        }
        // Differences from `low`, so that large numbers keep the digits of a small range.
        let [a, b, c] = values.map(|value| value * self.unit - self.low);
        let [u, v, w] = weights.map(f64::from);
        self.lookup(a * u + b * v + c * w)
    }

    fn color(&self, value: f64) -> Vec3 {
        if value.is_finite() { self.lookup(value * self.unit - self.low) } else { self.nan }
    }

    /// The colour at a `distance` from `low`, interpolated in linear light.
    fn lookup(&self, distance: f64) -> Vec3 {
        let t = distance * self.scales[0] * self.scales[1];
        let x = t.clamp(0.0, 1.0) * SEGMENTS as f64;
        let i = (x as usize).min(SEGMENTS - 1);
        self.table[i] + (self.table[i + 1] - self.table[i]) * (x - i as f64) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(map: ColorMap, t: f64) -> Vec3 {
        Vec3::from(map.srgb(t).map(|c| srgb::to_linear(f64::from(c) / 255.0) as f32))
    }

    fn mapped(values: Vec<f64>, range: [f64; 2]) -> MeshColors {
        let nan = Vec3::new(1.0, 0.0, 1.0);
        let scalars = MappedScalars::new(Scalars::F64(values), ColorMap::Viridis, range, nan);
        MeshColors { element: MeshElement::Vertex, source: ColorSource::Mapped(Box::new(scalars)) }
    }

    #[test]
    fn the_number_is_interpolated_and_not_the_colour() {
        let colors = mapped(vec![1e9, 1e9 + 2.0, 1e9 + 2.0], [1e9, 1e9 + 2.0]);
        let corners = [0, 1, 2];
        assert_eq!(colors.at(0, corners, [1.0, 0.0, 0.0]), linear(ColorMap::Viridis, 0.0));
        assert_eq!(colors.at(0, corners, [0.0, 0.5, 0.5]), linear(ColorMap::Viridis, 1.0));
        let middle = colors.at(0, corners, [0.5, 0.25, 0.25]);
        assert_eq!(middle, linear(ColorMap::Viridis, 0.5));
        let mean = (colors.of(0) + colors.of(1)) / 2.0;
        assert!((middle - mean).length() > 0.1, "the map is not straight");
    }

    #[test]
    fn values_beyond_the_range_have_the_colours_of_its_ends() {
        let colors = mapped(vec![-7.0, 0.25, 9.0], [0.0, 1.0]);
        assert_eq!(colors.of(0), linear(ColorMap::Viridis, 0.0));
        assert_eq!(colors.of(1), linear(ColorMap::Viridis, 0.25));
        assert_eq!(colors.of(2), linear(ColorMap::Viridis, 1.0));
        let reversed = mapped(vec![0.0, 1.0], [1.0, 0.0]);
        assert_eq!(reversed.of(0), linear(ColorMap::Viridis, 1.0));
    }

    /// The reciprocal of the width would be infinite.
    #[test]
    fn a_range_of_denormal_width_has_all_colours() {
        for width in [1e-300, 5.6e-309, 3e-309, 1e-310, 4e-320] {
            let values = vec![0.0, width / 4.0, width, f64::MAX, -f64::MAX];
            let colors = mapped(values, [0.0, width]);
            for (i, t) in [0.0, 0.25, 1.0, 1.0, 0.0].into_iter().enumerate() {
                let expected = linear(ColorMap::Viridis, t);
                assert!((colors.of(i as u32) - expected).length() < 1e-2, "{width:e} {i}");
            }
            assert_eq!(colors.at(0, [0, 2, 2], [0.0, 0.5, 0.5]), linear(ColorMap::Viridis, 1.0));
            let mixed = colors.at(0, [0, 3, 4], [1.0, 0.0, 0.0]);
            assert_eq!(mixed, linear(ColorMap::Viridis, 0.0), "{width:e}");
        }
    }

    #[test]
    fn a_triangle_with_a_value_that_is_not_finite_has_the_colour_for_it() {
        for odd in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let colors = mapped(vec![0.0, odd, 1.0], [0.0, 1.0]);
            let magenta = Vec3::new(1.0, 0.0, 1.0);
            assert_eq!(colors.at(0, [0, 1, 2], [0.5, 0.0, 0.5]), magenta);
            assert_eq!(colors.of(1), magenta);
            assert_ne!(colors.of(0), magenta);
        }
    }

    #[test]
    fn alpha_fades_a_colour_to_white() {
        let colors = StoredColors {
            values: Colors::U8(vec![[255, 0, 0]; 3]),
            alpha: Some(Scalars::U8(vec![255, 0, 51])),
            space: ColorSpace::Srgb,
        };
        assert_eq!(colors.at(0), Vec3::X);
        assert_eq!(colors.at(1), Vec3::ONE);
        assert!((colors.at(2) - Vec3::new(1.0, 0.8, 0.8)).length() < 1e-6);
    }
}
