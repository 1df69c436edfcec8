//! Rays of a caller: checked, rounded for the tree, and their hits refined in f64.

use glam::DVec3;
use rayon::prelude::*;

use super::scene::RayScene;
use crate::error::{Error, Result};
use crate::geometry::clamp_barycentrics;
use crate::ray::{Coherence, LANES, Mask, RayPacket};

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

/// A packet of rays in the coordinates of the tree, and how their parameters convert.
pub(super) struct Rounded {
    pub packet: RayPacket,
    /// The lanes whose rays can hit anything.
    pub active: Mask,
    /// The caller's t is `t * scale + shift` for a parameter t of the packet.
    scale: [f64; LANES],
    shift: [f64; LANES],
}

impl Rounded {
    /// The caller's ray parameter for a parameter of the packet.
    pub fn t(&self, lane: usize, t: f64) -> f64 {
        t * self.scale[lane] + self.shift[lane]
    }

    /// Whether neighbouring lanes are similar enough to be traced together. Compared with lane 0,
    /// directions must differ by less than 0.1 in each component (some 6 degrees), and origins by
    /// less than a thousandth of the scene's size.
    pub fn coherence(&self, size: f32) -> Coherence {
        let rays = &self.packet.rays;
        let (mut turned, mut moved) = (0.0f32, 0.0f32);
        for axis in 0..3 {
            for i in 0..LANES {
                let used = if self.active.0[i] != 0 { 1.0 } else { 0.0 };
                turned = turned.max((rays.dir[axis][i] - rays.dir[axis][0]).abs() * used);
                moved = moved.max((rays.org[axis][i] - rays.org[axis][0]).abs() * used);
            }
        }
        let similar = self.active.0[0] != 0 && turned < 0.1 && moved < 1e-3 * size;
        if similar { Coherence::Coherent } else { Coherence::Incoherent }
    }
}

/// Values of a hit, computed in f64.
#[derive(Debug, Clone, Copy)]
pub(super) struct Refined {
    pub t: f64,
    pub barycentrics: [f64; 2],
    pub normal: [f64; 3],
}

impl RayScene {
    /// Longest side of the box of all triangles.
    pub(super) fn size(&self) -> f32 {
        let [low, high] = self.local_bounds();
        (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max)
    }

    /// Rounds at most 16 rays to f32, from index `first` on.
    ///
    /// Directions are scaled by a power of two, so that their largest component lies in [1, 2).
    /// A ray that starts far away from the triangles starts nearer to them, so that its origin is
    /// rounded less.
    pub(super) fn round(&self, rays: &RayBatch, first: usize) -> Rounded {
        let mut packet = RayPacket::EMPTY;
        let (mut scale, mut shift) = ([1.0; LANES], [0.0; LANES]);
        let mut active = Mask::NONE;
        let (origin, size) = (self.origin(), f64::from(self.size()));
        let middle = (self.bounds[0] + self.bounds[1]) * 0.5;
        for i in 0..LANES.min(rays.len() - first) {
            let (from, direction) = (rays.origins[first + i], rays.directions[first + i]);
            let (from, direction) = (DVec3::from(from), DVec3::from(direction));
            let down = power_of_two(direction.abs().max_element());
            let unit = direction * down;
            let (tnear, tfar) = (rays.tnear.get(first + i), rays.tfar.get(first + i));
            let to = middle - from;
            let mut start = from - origin;
            if to.abs().max_element() > 4.0 * size {
                // From here the rest of the way to the middle is some 2 sizes.
                let ahead = to.dot(unit) / unit.length_squared() - 2.0 * size;
                if ahead > 0.0 && ahead.is_finite() {
                    shift[i] = ahead * down;
                    start += unit * ahead;
                }
            }
            scale[i] = down;
            packet.rays.set(i, start.as_vec3(), unit.as_vec3());
            // Exact: a power of two.
            let up = 1.0 / down;
            packet.rays.tnear[i] = ((tnear - shift[i]) * up).max(0.0) as f32;
            packet.rays.tfar[i] = ((tfar - shift[i]) * up) as f32;
            active.0[i] = -i32::from(tnear < tfar);
        }
        let active = packet.rays.possible(&active);
        Rounded { packet, active, scale, shift }
    }

    /// Computes the hit of ray `i` with a triangle in f64, from the caller's arrays. `t` and `uv`
    /// are what the tree found. They are kept where the ray runs in the plane of the triangle.
    pub(super) fn refine(
        &self,
        rays: &RayBatch,
        i: usize,
        primitive: u32,
        (t, uv): (f64, (f64, f64)),
    ) -> Refined {
        let corners = self.corners(primitive);
        let (origin, direction) = (rays.origins[i].into(), rays.directions[i].into());
        let hit = intersect(corners, origin, direction);
        let (exact, (u, v)) = if hit.t.is_finite() { (hit.t, hit.uv) } else { (t, uv) };
        let (u, v) = clamp_barycentrics(u, v);
        let t = exact.max(rays.tnear.get(i)).min(rays.tfar.get(i));
        Refined { t, barycentrics: [u, v], normal: hit.normal.normalize().to_array() }
    }
}

/// Where the line of a ray intersects the plane of a triangle. Not finite if they are parallel.
struct PlaneHit {
    t: f64,
    /// Weights of the second and third corner.
    uv: (f64, f64),
    /// `(v1 - v0) x (v2 - v0)`.
    normal: DVec3,
}

/// Intersects in f64: Moeller and Trumbore 1997, eq. 6, as [`crate::geometry::refine_triangle`].
#[inline(always)]
fn intersect([v0, v1, v2]: [DVec3; 3], origin: DVec3, direction: DVec3) -> PlaneHit {
    let (e1, e2, to_v0) = (v1 - v0, v2 - v0, v0 - origin);
    let normal = e1.cross(e2);
    let inverse = 1.0 / normal.dot(direction);
    let r = to_v0.cross(direction);
    let uv = (r.dot(e2) * inverse, -r.dot(e1) * inverse);
    PlaneHit { t: normal.dot(to_v0) * inverse, uv, normal }
}

/// Returns the power of two that scales a positive number to [1, 2). For denormal numbers it is
/// 2^1022.
#[inline(always)]
fn power_of_two(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}
