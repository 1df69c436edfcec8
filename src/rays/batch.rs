//! Rays of a caller, checked.

use rayon::prelude::*;

use crate::error::{Error, Result};

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
}

/// Rays `origin + t direction`, with t in (`tnear`, `tfar`).
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
    /// `Invalid` for arrays of different lengths, a number that is not finite, an origin beyond
    /// 1e18, or a direction of length 0.
    pub fn new(origins: &'a [[f64; 3]], directions: &'a [[f64; 3]]) -> Result<Self> {
        let (count, others) = (origins.len(), directions.len());
        if count != others {
            let message = format!("found {others} directions, expected {count} as of origins");
            return Err(Error::invalid("directions", message));
        }
        if let Some(i) = first(origins, |v| !fits(v)) {
            let message = format!("found {:?}, expected finite numbers up to 1e18", origins[i]);
            return Err(Error::invalid(format!("origins[{i}]"), message));
        }
        let is_direction = |[x, y, z]: &[f64; 3]| {
            let sum = x.abs() + y.abs() + z.abs();
            // A sum of finite numbers may overflow.
            (sum > 0.0) & (sum <= f64::MAX)
                | (x.is_finite() & y.is_finite() & z.is_finite() & (sum > 0.0))
        };
        if let Some(i) = first(directions, |v| !is_direction(v)) {
            let found = directions[i];
            let message = format!("found {found:?}, expected finite numbers that are not all 0");
            return Err(Error::invalid(format!("directions[{i}]"), message));
        }
        let (tnear, tfar) = (Limits::All(0.0), Limits::All(f64::INFINITY));
        Ok(Self { origins, directions, tnear, tfar })
    }

    /// The same rays with another segment. A ray with `tfar <= tnear` hits nothing.
    ///
    /// # Errors
    /// `Invalid` for a number of values other than that of the rays, a value below 0 or NaN, or an
    /// infinite `tnear`.
    pub fn with_limits(self, tnear: Limits<'a>, tfar: Limits<'a>) -> Result<Self> {
        for (name, limits) in [("tnear", tnear), ("tfar", tfar)] {
            let wrong = |x: f64| !(x >= 0.0 && (x.is_finite() || name == "tfar"));
            let message = |x: f64| match name {
                "tfar" => format!("found {x}, expected a number >= 0 or infinity"),
                _ => format!("found {x}, expected a finite number >= 0"),
            };
            match limits {
                Limits::All(x) if wrong(x) => return Err(Error::invalid(name, message(x))),
                Limits::All(_) => {}
                Limits::Each(values) if values.len() != self.len() => {
                    let (found, count) = (values.len(), self.len());
                    let message = format!("found {found} values, expected 1 or {count}");
                    return Err(Error::invalid(name, message));
                }
                Limits::Each(values) => {
                    if let Some(i) = first(values, |&x| wrong(x)) {
                        return Err(Error::invalid(format!("{name}[{i}]"), message(values[i])));
                    }
                }
            }
        }
        Ok(Self { tnear, tfar, ..self })
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

    /// Whether there is no ray.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }
}

/// Index of the first element for which `wrong` is true. Fast if there is none and `wrong` has no
/// branches.
pub(super) fn first<T: Sync>(all: &[T], wrong: impl Fn(&T) -> bool + Sync + Send) -> Option<usize> {
    const PART: usize = 1 << 12;
    let any = |part: &[T]| part.iter().fold(false, |any, item| any | wrong(item));
    let part = all.par_chunks(PART).position_first(any)?;
    let rest = &all[part * PART..];
    rest.iter().position(&wrong).map(|i| part * PART + i)
}

/// Whether all coordinates are finite and at most 1e18.
pub(super) fn fits([x, y, z]: &[f64; 3]) -> bool {
    (x.abs() <= 1e18) & (y.abs() <= 1e18) & (z.abs() <= 1e18)
}
