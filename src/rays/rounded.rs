//! Packets of a caller's rays, rounded for the tree.

use super::batch::{RayBatch, fits, is_direction, is_limit};
use super::scene::RayScene;
use crate::error::Result;
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use crate::simd::{self, Isa, Kernel};

/// How far a hit of a rounded ray lies from the caller's ray and triangle at most, as a fraction of
/// the longest side of the box of all triangles: 256u (u = 2^-24).
///
/// A rounded ray starts less than 6 sides from the middle of the box ([`Rounding::round`]). Origin,
/// direction and corners move by some 20u, and the test of the tree by 6u of the distance. The rest
/// is for slanting triangles.
const SLACK: f64 = 128.0 * f32::EPSILON as f64;

/// One double per lane.
pub(super) type Doubles = [f64; LANES];

/// The rays that are this far ahead are prefetched.
const PREFETCH_DISTANCE: usize = 4 * LANES;

/// A packet of rays in the coordinates of the tree.
pub(super) struct Rounded {
    pub packet: RayPacket,
    /// The lanes whose rays can hit anything.
    pub active: Mask,
    /// The active lanes whose rays have limits of their own.
    pub limited: Mask,
    /// Whether neighbouring lanes are similar enough to be traced together.
    pub coherence: Coherence,
}

impl Rounded {
    pub const EMPTY: Self = Self {
        packet: RayPacket::EMPTY,
        active: Mask::NONE,
        limited: Mask::NONE,
        coherence: Coherence::Coherent,
    };
}

/// Rounds the rays of a batch to f32.
pub(super) struct Rounding<'a> {
    rays: &'a RayBatch<'a>,
    /// Longest side of the box of all triangles.
    size: f32,
    /// Origin of the coordinates of the tree.
    origin: [f64; 3],
    /// Middle of the box.
    middle: [f64; 3],
    /// Added to both ends of a ray that has limits of its own.
    slack: f64,
}

impl RayScene {
    /// How far a hit of the rounded triangles lies from the caller's ray and triangle at most.
    pub(super) fn rounding_slack(&self) -> f64 {
        f64::from(self.size()) * SLACK
    }

    /// Longest side of the box of all triangles.
    fn size(&self) -> f32 {
        let [low, high] = self.local_bounds();
        (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max)
    }

    /// Returns the rounding of rays for the tree of this scene.
    ///
    /// # Errors
    /// The errors of [`RayBatch::check`], if there is no ray: else packets check them.
    pub(super) fn rounding<'a>(&self, rays: &'a RayBatch<'a>) -> Result<Rounding<'a>> {
        if rays.is_empty() {
            rays.check()?;
        }
        let middle = (self.bounds[0] + self.bounds[1]) * 0.5;
        let (origin, middle) = (self.origin().into(), middle.into());
        Ok(Rounding { rays, size: self.size(), origin, middle, slack: self.rounding_slack() })
    }
}

impl<'a> Rounding<'a> {
    /// The rays.
    pub fn rays(&self) -> &'a RayBatch<'a> {
        self.rays
    }

    /// The rounding to rays that end within their own limits by more than what rounding explains,
    /// except on grazing faces.
    pub fn shortened(&self) -> Self {
        Self { slack: -self.slack, ..*self }
    }

    /// Checks and rounds at most 16 rays, from index `first` on.
    ///
    /// Directions are scaled by a power of two, so that their largest component lies in [1, 2).
    /// A ray that starts far away from the triangles starts nearer to them, so that its origin is
    /// rounded less. Limits other than 0 and infinity are widened by what rounding explains.
    ///
    /// # Errors
    /// The errors of [`RayBatch::check`], if one of these rays is wrong.
    #[inline(always)]
    pub fn round(&self, first: usize, out: &mut Rounded) -> Result<()> {
        let valid = simd::dispatch(Isa::detect(), Round { rounding: self, first, out });
        if valid { Ok(()) } else { self.rays.check() }
    }
}

/// The work of [`Rounding::round`]. Returns whether the values of all rays are valid.
struct Round<'a> {
    rounding: &'a Rounding<'a>,
    first: usize,
    out: &'a mut Rounded,
}

impl Kernel for Round<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { rounding, first, out } = self;
        // Copies, as writing to `out` might change them for all that the compiler knows.
        let Rounding { rays, size, origin, middle, slack } = *rounding;
        rays.prefetch(first + PREFETCH_DISTANCE);
        let mut from = [[0.0; LANES]; 3];
        let mut direction = [[1.0; LANES]; 3];
        let (mut tnear, mut tfar) = ([0.0; LANES], [0.0; LANES]);
        let count = LANES.min(rays.len() - first);
        for i in 0..count {
            let (o, d) = rays.line(first + i);
            for axis in 0..3 {
                from[axis][i] = o[axis];
                direction[axis][i] = d[axis];
            }
            (tnear[i], tfar[i]) = rays.limits(first + i);
        }
        let mut valid = true;
        for i in 0..LANES {
            valid &= fits([from[0][i], from[1][i], from[2][i]])
                & is_direction([direction[0][i], direction[1][i], direction[2][i]])
                & is_limit(tnear[i])
                & is_limit(tfar[i]);
        }
        let (mut local, mut active, mut limited) = (Rays::EMPTY, Mask::NONE, Mask::NONE);
        let far = 4.0 * f64::from(size);
        for i in 0..LANES {
            let [dx, dy, dz] = [direction[0][i], direction[1][i], direction[2][i]];
            let longest = dx.abs().max(dy.abs()).max(dz.abs());
            let down = power_of_two(longest);
            let [dx, dy, dz] = [dx * down, dy * down, dz * down];
            let [fx, fy, fz] = [from[0][i], from[1][i], from[2][i]];
            let [x, y, z] = [middle[0] - fx, middle[1] - fy, middle[2] - fz];
            // From here the rest of the way to the middle is some 2 sizes.
            let along = (x * dx + y * dy + z * dz) / (dx * dx + dy * dy + dz * dz);
            let ahead = along - 2.0 * f64::from(size);
            // A denormal direction stays short, so `ahead` would lead too far.
            let is_far = (x.abs().max(y.abs()).max(z.abs()) > far) & (longest >= f64::MIN_POSITIVE);
            let ahead = if is_far & (ahead > 0.0) & (ahead < f64::INFINITY) { ahead } else { 0.0 };
            local.org[0][i] = (fx - origin[0] + dx * ahead) as f32;
            local.org[1][i] = (fy - origin[1] + dy * ahead) as f32;
            local.org[2][i] = (fz - origin[2] + dz * ahead) as f32;
            local.dir[0][i] = dx as f32;
            local.dir[1][i] = dy as f32;
            local.dir[2][i] = dz as f32;
            // Exact: a power of two.
            let up = 1.0 / down;
            let before = if tnear[i] > 0.0 { slack } else { 0.0 };
            local.tnear[i] = (tnear[i] * up - ahead - before).max(0.0) as f32;
            local.tfar[i] = (tfar[i] * up - ahead + slack) as f32;
            limited.0[i] = -i32::from((tnear[i] > 0.0) | (tfar[i] < f64::INFINITY));
            active.0[i] = -i32::from((tnear[i] < tfar[i]) & (i < count));
        }
        out.active = local.possible(&active);
        out.limited = out.active.and(&limited);
        out.coherence = coherence(&local, &out.active, size);
        out.packet.rays = local;
        out.packet.clear_hits();
        valid
    }
}

/// Compared with lane 0, directions must differ by less than 0.1 in each component (some 6
/// degrees), and origins by less than a thousandth of the scene's size.
#[inline(always)]
fn coherence(rays: &Rays, active: &Mask, size: f32) -> Coherence {
    let mut similar = active.0[0];
    for axis in 0..3 {
        let (dir, org) = (&rays.dir[axis], &rays.org[axis]);
        for i in 0..LANES {
            let near = ((dir[i] - dir[0]).abs() < 0.1) & ((org[i] - org[0]).abs() < 1e-3 * size);
            similar &= -i32::from(near) | !active.0[i];
        }
    }
    if similar != 0 { Coherence::Coherent } else { Coherence::Unordered }
}

/// Returns the power of two that scales a positive number to [1, 2). For denormal numbers it is
/// 2^1022.
#[inline(always)]
pub(super) fn power_of_two(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}
