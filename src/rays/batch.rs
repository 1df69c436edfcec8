//! Rays of a caller, and their checks.

use crate::error::{Error, Result};
use crate::ray::LANES;
use crate::simd;
use crate::units::plural;

/// One value for all rays, or a value for each.
#[derive(Debug, Clone, Copy)]
pub enum Limits<'a> {
    /// The same value for all rays.
    All(f64),
    /// A value for each ray.
    Each(&'a [f64]),
}

impl Limits<'_> {
    #[inline(always)]
    fn get(&self, i: usize) -> f64 {
        match self {
            Self::All(value) => *value,
            Self::Each(values) => values[i],
        }
    }

    fn values(&self) -> &[f64] {
        match self {
            Self::All(value) => std::slice::from_ref(value),
            Self::Each(values) => values,
        }
    }
}

/// Rays `origin + t direction`, with t in (`tnear`, `tfar`). Their values are checked by the
/// queries of a [`RayScene`](super::RayScene), while these read them.
#[derive(Debug, Clone, Copy)]
pub struct RayBatch<'a> {
    origins: &'a [[f64; 3]],
    directions: &'a [[f64; 3]],
    tnear: Limits<'a>,
    tfar: Limits<'a>,
}

impl<'a> RayBatch<'a> {
    /// Rays without end, from t = 0. Directions may have any length > 0.
    ///
    /// # Errors
    /// `Invalid` for arrays of different lengths.
    pub fn new(origins: &'a [[f64; 3]], directions: &'a [[f64; 3]]) -> Result<Self> {
        let (count, others) = (origins.len(), directions.len());
        if count != others {
            let found = plural(others, "direction");
            let message = format!("found {found}, expected {count} as of origins");
            return Err(Error::invalid("directions", message));
        }
        let (tnear, tfar) = (Limits::All(0.0), Limits::All(f64::INFINITY));
        Ok(Self { origins, directions, tnear, tfar })
    }

    /// The same rays with another segment. A ray with `tfar <= tnear` hits nothing, nor does one
    /// with an infinite `tnear`: so `tnear` may be the t of all hits of another query. The t of a
    /// hit is compared in f64; a `tnear` of 0 excludes no hit.
    ///
    /// # Errors
    /// `Invalid` for a number of values other than that of the rays.
    pub fn with_limits(self, tnear: Limits<'a>, tfar: Limits<'a>) -> Result<Self> {
        for (name, limits) in [("tnear", tnear), ("tfar", tfar)] {
            let found = if let Limits::Each(values) = limits { values.len() } else { self.len() };
            if found != self.len() {
                let message =
                    format!("found {}, expected 1 or {}", plural(found, "value"), self.len());
                return Err(Error::invalid(name, message));
            }
        }
        Ok(Self { tnear, tfar, ..self })
    }

    /// Checks all rays. The error is that of the first wrong value: of origins, then of directions,
    /// then of limits.
    ///
    /// # Errors
    /// `Invalid` for an origin that is not finite or beyond 1e18, a direction that is not finite or
    /// has length 0, or a limit that is negative or NaN.
    #[cold]
    pub(super) fn check(&self) -> Result<()> {
        if let Some(i) = first(self.origins, |&v| !fits(v)) {
            let found = self.origins[i];
            let message = format!("found {found:?}, expected finite numbers up to 1e18");
            return Err(Error::invalid(format!("origins[{i}]"), message));
        }
        if let Some(i) = first(self.directions, |&v| !is_direction(v)) {
            let found = self.directions[i];
            let message = format!("found {found:?}, expected finite numbers that are not all 0");
            return Err(Error::invalid(format!("directions[{i}]"), message));
        }
        for (name, limits) in [("tnear", &self.tnear), ("tfar", &self.tfar)] {
            let values = limits.values();
            if let Some(i) = first(values, |&x| !is_limit(x)) {
                let message = format!("found {}, expected a number >= 0 or infinity", values[i]);
                let place = match limits {
                    Limits::All(_) => name.to_owned(),
                    Limits::Each(_) => format!("{name}[{i}]"),
                };
                return Err(Error::invalid(place, message));
            }
        }
        Ok(())
    }

    /// Returns the number of rays.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Origin and direction of a ray.
    #[inline(always)]
    pub(super) fn line(&self, i: usize) -> (&[f64; 3], &[f64; 3]) {
        (&self.origins[i], &self.directions[i])
    }

    /// tnear and tfar of a ray.
    #[inline(always)]
    pub(super) fn limits(&self, i: usize) -> (f64, f64) {
        (self.tnear.get(i), self.tfar.get(i))
    }

    /// Prefetches 16 rays. The index may be out of bounds.
    #[inline(always)]
    pub(super) fn prefetch(&self, i: usize) {
        const LINES: usize = (LANES * size_of::<[f64; 3]>()).div_ceil(64);
        for line in 0..LINES {
            simd::prefetch_line(self.origins, i, line);
            simd::prefetch_line(self.directions, i, line);
        }
    }

    /// Whether there is no ray.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }
}

/// Index of the first element for which `wrong` is true. Fast if there is none and `wrong` has no
/// branches.
pub(super) fn first<T>(all: &[T], wrong: impl Fn(&T) -> bool) -> Option<usize> {
    const PART: usize = 1 << 12;
    // Not in parallel: tasks that find a wrong ray call this, and would wait in each other.
    let mut parts = all.chunks(PART);
    let part = parts.position(|part| part.iter().fold(false, |any, item| any | wrong(item)))?;
    let rest = &all[part * PART..];
    rest.iter().position(wrong).map(|i| part * PART + i)
}

/// Whether all coordinates are finite and at most 1e18.
#[inline(always)]
pub(super) fn fits([x, y, z]: [f64; 3]) -> bool {
    (x.abs() <= 1e18) & (y.abs() <= 1e18) & (z.abs() <= 1e18)
}

/// Whether all components are finite, and one is not 0.
#[inline(always)]
pub(super) fn is_direction([x, y, z]: [f64; 3]) -> bool {
    let [x, y, z] = [x.abs(), y.abs(), z.abs()];
    (x <= f64::MAX) & (y <= f64::MAX) & (z <= f64::MAX) & (x + y + z > 0.0)
}

/// Whether a limit is a number >= 0 or infinity.
#[inline(always)]
pub(super) fn is_limit(x: f64) -> bool {
    x >= 0.0
}
