//! Packets of a caller's rays, rounded for the tree.

use super::batch::RayBatch;
use super::scene::RayScene;
use crate::ray::{Coherence, LANES, Mask, RayPacket};
use crate::simd::{self, Isa, Kernel};

/// One double per lane.
pub(super) type Doubles = [f64; LANES];

/// A packet of rays in the coordinates of the tree, and how their parameters convert.
pub(super) struct Rounded {
    pub packet: RayPacket,
    /// The lanes whose rays can hit anything.
    pub active: Mask,
    /// Whether neighbouring lanes are similar enough to be traced together.
    pub coherence: Coherence,
    /// The caller's t is `t * scale + shift` for a parameter t of the packet.
    scale: Doubles,
    shift: Doubles,
}

impl Rounded {
    /// The caller's ray parameter for a parameter of the packet.
    pub fn t(&self, lane: usize, t: f64) -> f64 {
        t * self.scale[lane] + self.shift[lane]
    }
}

impl RayScene {
    /// Rounds at most 16 rays to f32, from index `first` on.
    ///
    /// Directions are scaled by a power of two, so that their largest component lies in [1, 2).
    /// A ray that starts far away from the triangles starts nearer to them, so that its origin is
    /// rounded less.
    pub(super) fn round(&self, rays: &RayBatch, first: usize) -> Rounded {
        let [low, high] = self.local_bounds();
        let size = (0..3).map(|k| high[k] - low[k]).fold(0.0, f32::max);
        let middle = (self.bounds[0] + self.bounds[1]) * 0.5;
        let places = [self.origin().to_array(), middle.to_array()];
        simd::dispatch(Isa::detect(), Round { rays, first, size, places })
    }
}

/// The work of [`RayScene::round`].
struct Round<'a> {
    rays: &'a RayBatch<'a>,
    first: usize,
    /// Longest side of the box of all triangles.
    size: f32,
    /// Origin of the coordinates of the tree, and the middle of the box.
    places: [[f64; 3]; 2],
}

impl Kernel for Round<'_> {
    type Output = Rounded;

    #[inline(always)]
    fn run(self) -> Rounded {
        let Self { rays, first, size, places: [origin, middle] } = self;
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
        let mut packet = RayPacket::EMPTY;
        let (mut scale, mut shift) = ([1.0; LANES], [0.0; LANES]);
        let mut active = Mask::NONE;
        let far = 4.0 * f64::from(size);
        for i in 0..LANES {
            let [dx, dy, dz] = [direction[0][i], direction[1][i], direction[2][i]];
            let down = power_of_two(dx.abs().max(dy.abs()).max(dz.abs()));
            let [dx, dy, dz] = [dx * down, dy * down, dz * down];
            let [fx, fy, fz] = [from[0][i], from[1][i], from[2][i]];
            let [x, y, z] = [middle[0] - fx, middle[1] - fy, middle[2] - fz];
            // From here the rest of the way to the middle is some 2 sizes.
            let along = (x * dx + y * dy + z * dz) / (dx * dx + dy * dy + dz * dz);
            let ahead = along - 2.0 * f64::from(size);
            let is_far = x.abs().max(y.abs()).max(z.abs()) > far;
            let ahead = if is_far & (ahead > 0.0) & (ahead < f64::INFINITY) { ahead } else { 0.0 };
            (scale[i], shift[i]) = (down, ahead * down);
            packet.rays.org[0][i] = (fx - origin[0] + dx * ahead) as f32;
            packet.rays.org[1][i] = (fy - origin[1] + dy * ahead) as f32;
            packet.rays.org[2][i] = (fz - origin[2] + dz * ahead) as f32;
            packet.rays.dir[0][i] = dx as f32;
            packet.rays.dir[1][i] = dy as f32;
            packet.rays.dir[2][i] = dz as f32;
            // Exact: a power of two.
            let up = 1.0 / down;
            packet.rays.tnear[i] = ((tnear[i] - shift[i]) * up).max(0.0) as f32;
            packet.rays.tfar[i] = ((tfar[i] - shift[i]) * up) as f32;
            active.0[i] = -i32::from((tnear[i] < tfar[i]) & (i < count));
        }
        let active = packet.rays.possible(&active);
        let coherence = coherence(&packet, &active, size);
        Rounded { packet, active, coherence, scale, shift }
    }
}

/// Compared with lane 0, directions must differ by less than 0.1 in each component (some 6
/// degrees), and origins by less than a thousandth of the scene's size.
#[inline(always)]
fn coherence(packet: &RayPacket, active: &Mask, size: f32) -> Coherence {
    let rays = &packet.rays;
    let mut similar = active.0[0];
    for axis in 0..3 {
        let (dir, org) = (&rays.dir[axis], &rays.org[axis]);
        for i in 0..LANES {
            let near = ((dir[i] - dir[0]).abs() < 0.1) & ((org[i] - org[0]).abs() < 1e-3 * size);
            similar &= -i32::from(near) | !active.0[i];
        }
    }
    if similar != 0 { Coherence::Coherent } else { Coherence::Incoherent }
}

/// Returns the power of two that scales a positive number to [1, 2). For denormal numbers it is
/// 2^1022.
#[inline(always)]
fn power_of_two(x: f64) -> f64 {
    let exponent = (x.to_bits() >> 52).clamp(1, 2045);
    f64::from_bits((2046 - exponent) << 52)
}
