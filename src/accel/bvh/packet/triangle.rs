//! Tests a triangle of a leaf against a packet: the test of [`exact`](crate::accel::bvh::exact) for
//! 16 lanes at once. Hits and t are the same. The weights come from edge functions in f32 where
//! these tell them to 1.5e-3, else from the exact ones.

use super::Packet;
use crate::accel::bvh::exact::{
    BOX_SLACK, DEPTH_SLACK, Ray64, STEEP, ShearedTriangle, TrianglePlane, weights_of,
};
use crate::accel::bvh::node::Block;
use crate::accel::bvh::query::max;
use crate::accel::bvh::simd::{EDGE_FLOOR, EDGE_SLACK, Tier};
use crate::geometry::NEAR_START;
use crate::ray::LANES;

/// The sum of the edge functions, in units of their slack, from which f32 tells the weights. Each
/// edge function is off by at most 3/8 of the slack, so a weight by 1.5 / 1024.
///
/// Below are triangles that the ray sees almost edge-on, and those that it sees as slivers: less
/// than 5e-4 of the square of their size.
const CLEAR: f32 = 1024.0;

/// The edge functions of a triangle for the lines of 16 rays, in f32.
pub struct Edges {
    /// All bits set in lanes whose line may hit the triangle, before the end of the ray.
    pub maybe: [i32; LANES],
    /// All bits set in lanes of `maybe` whose line may also miss the triangle: f32 cannot decide.
    pub unsure: [i32; LANES],
    /// Smallest depth of a corner: its distance from the ray's origin along the dominant axis, in
    /// the direction of the ray.
    pub first: [f32; LANES],
    /// Largest depth of a corner.
    pub last: [f32; LANES],
    /// Barycentric weights of a hit as two edge functions and the sum of all three, as in
    /// [`ClosestHits::weights`](crate::accel::bvh::hits::ClosestHits::weights).
    pub weights: [[f32; LANES]; 3],
    /// All bits set in lanes whose weights f32 cannot tell: see [`CLEAR`].
    pub blurred: [i32; LANES],
}

/// The hits of 16 rays with a triangle.
pub struct Test {
    /// All bits set in lanes whose line hits the triangle. Some lanes whose hit lies before the
    /// start or beyond the end of the segment are cleared. The caller compares t with both ends.
    pub hit: [i32; LANES],
    /// Ray parameters of the hits. Other lanes hold any value.
    pub t: [f64; LANES],
    pub weights: [[f32; LANES]; 3],
}

impl<T: Tier> Packet<'_, T> {
    /// Tests the lines of the rays in `entering` against the triangle in `slot` of a leaf, whose
    /// scene-wide index is `primitive`. Returns `None` if no ray may hit it.
    #[inline(always)]
    pub fn edges(
        &self,
        block: &Block,
        (slot, primitive): (usize, u32),
        entering: &[i32; LANES],
    ) -> Option<Edges> {
        let (mut maybe, mut any) = ([0i32; LANES], 0);
        for i in 0..LANES {
            let leaving = self.rays.leaving[i] == primitive;
            maybe[i] = entering[i] & -i32::from(!leaving);
            any |= maybe[i];
        }
        if any == 0 {
            return None;
        }
        let axes = self.frustum.axes;
        let corner = |k: usize| {
            let v = block.corner(k, slot);
            [block.vertices[axes[0]][v], block.vertices[axes[1]][v], block.vertices[axes[2]][v]]
        };
        let (p, q, r) = (corner(0), corner(1), corner(2));
        let query = self.query;
        let mut weights = [[0.0f32; LANES]; 3];
        let (mut unsure, mut blurred) = ([0i32; LANES], [0i32; LANES]);
        let (mut first, mut last) = ([0.0f32; LANES], [0.0f32; LANES]);
        let backward = self.frustum.forward < 0.0;
        for i in 0..LANES {
            let (sx, sy) = (query.shear[0][i], query.shear[1][i]);
            let (ox, oy, oz) = (query.origin[0][i], query.origin[1][i], query.origin[2][i]);
            let shear = |v: [f32; 3]| {
                let [x, y, z] = v;
                let depth = z - oz;
                ((x - ox) - sx * depth, (y - oy) - sy * depth, depth)
            };
            let ((ax, ay, az), (bx, by, bz), (cx, cy, cz)) = (shear(p), shear(q), shear(r));
            let (q0, q1, q2) = (cy * bx, ay * cx, by * ax);
            // Not fused, because these become the weights. They must be equal in every instruction
            // set.
            let (u, v, w) = (cx * by - q0, ax * cy - q1, bx * ay - q2);
            let sum = u + v + w;
            (weights[0][i], weights[1][i], weights[2][i]) = (v, w, sum);
            let largest = T::larger(T::larger(q0.abs(), q1.abs()), q2.abs());
            let slack = largest * EDGE_SLACK + EDGE_FLOOR;
            // True for NaN.
            blurred[i] = -i32::from(!(sum.abs() >= CLEAR * slack));
            let (lowest, highest) = (T::lesser(T::lesser(u, v), w), T::larger(T::larger(u, v), w));
            let misses = (lowest < -slack) & (highest > slack);
            let sure = (lowest > slack) | (highest < -slack);
            let (lowest, highest) =
                (T::lesser(T::lesser(az, bz), cz), T::larger(T::larger(az, bz), cz));
            (first[i], last[i]) = if backward { (-highest, -lowest) } else { (lowest, highest) };
            maybe[i] &= -i32::from(!misses);
            unsure[i] = maybe[i] & -i32::from(!sure);
        }
        any = 0;
        for i in 0..LANES {
            // The whole triangle lies beyond the end of the segment, so its plane need not be
            // intersected.
            let beyond = first[i] > query.depth(i, self.tfar[i]);
            maybe[i] &= -i32::from(!beyond);
            unsure[i] &= maybe[i];
            any |= maybe[i];
        }
        (any != 0).then_some(Edges { maybe, unsure, first, last, weights, blurred })
    }

    /// Intersects the rays of `edges` with the triangle. Decides the unsure ones exactly.
    #[inline(always)]
    pub fn test(&self, block: &Block, slot: usize, edges: Edges) -> Test {
        let Edges { maybe, mut unsure, first, last, mut weights, .. } = edges;
        let plane = TrianglePlane::new(block.triangle(slot));
        let (t, towards) = self.distances(&plane);
        let normal_l1 = plane.normal_l1();
        // All in one loop. Between two loops the values would be stored as halves of a register,
        // and to read them as a whole register would wait for both stores.
        let (mut doubt, mut any_flat, mut flat) = (0, 0, [0i32; LANES]);
        for i in 0..LANES {
            let dominant_component = self.dominant_component(i).abs();
            let depth = t[i] * dominant_component;
            // `within` as in `ShearedTriangle::t`. It is false for an infinite depth: infinity
            // minus infinity is NaN.
            let slack = depth.abs() * DEPTH_SLACK;
            let within =
                (depth + slack >= f64::from(first[i])) & (depth - slack <= f64::from(last[i]));
            let steep = STEEP * towards[i].abs() >= normal_l1 * dominant_component;
            let far = max(-first[i], last[i]);
            // A hit behind the origin needs no exact decision: the caller rejects a negative t.
            let at_start = (depth > 0.0) & (depth <= NEAR_START * f64::from(far));
            unsure[i] |= maybe[i] & -i32::from(!within | at_start);
            flat[i] = maybe[i] & -i32::from(!steep);
            doubt |= unsure[i];
            any_flat |= flat[i];
        }
        if any_flat != 0 {
            // The slack is at most half of that in `ShearedTriangle::clamped`. So where this is
            // true, that one returns the plane's t, too.
            let weights = plane.weights();
            for i in 0..LANES {
                let slack = 0.5 * BOX_SLACK * f64::from(max(-first[i], last[i]));
                let near = plane.is_near(&weights, self.line(i), (t[i], slack));
                unsure[i] |= flat[i] & -i32::from(!near);
                doubt |= unsure[i];
            }
        }
        if doubt == 0 {
            return Test { hit: maybe, t, weights };
        }
        // Copies: a value whose address is passed to a call cannot stay in a register.
        let (unsure, mut decided) = (unsure, Test { hit: maybe, t, weights: [[0.0; LANES]; 3] });
        self.decide(block, slot, &unsure, &mut decided);
        for (weights, exact) in weights.iter_mut().zip(&decided.weights) {
            for i in 0..LANES {
                weights[i] = if unsure[i] != 0 { exact[i] } else { weights[i] };
            }
        }
        Test { hit: decided.hit, t: decided.t, weights }
    }

    /// Returns the component of the caller's direction along the dominant axis.
    #[inline(always)]
    fn dominant_component(&self, i: usize) -> f64 {
        // `scale` is a power of two. So the product is exact, except for denormals.
        f64::from(self.query.dominant_component[i]) * f64::from(self.query.scale[i])
    }

    /// Intersects 16 rays with a plane: see [`TrianglePlane::intersect`].
    #[inline(always)]
    fn distances(&self, plane: &TrianglePlane) -> ([f64; LANES], [f64; LANES]) {
        let (mut t, mut towards) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            let (origin, direction) = self.line(i);
            (t[i], towards[i]) = plane.intersect(origin, direction);
        }
        (t, towards)
    }

    /// Returns the origin and the direction of a ray.
    #[inline(always)]
    fn line(&self, i: usize) -> ([f64; 3], [f64; 3]) {
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.rays.org, &self.rays.dir);
        let origin = [f64::from(ox[i]), f64::from(oy[i]), f64::from(oz[i])];
        (origin, [f64::from(dx[i]), f64::from(dy[i]), f64::from(dz[i])])
    }

    /// Decides the unsure lanes one by one.
    #[inline(never)]
    fn decide(&self, block: &Block, slot: usize, unsure: &[i32; LANES], test: &mut Test) {
        let Test { hit, t, weights } = test;
        for i in (0..LANES).filter(|&i| unsure[i] != 0) {
            let lane = self.query.lane(i);
            let seen = ShearedTriangle::new(&lane, block, slot);
            if seen.inside() {
                let ray = Ray64::new(self.rays, i, lane.axes[2]);
                t[i] = seen.t(&ray, block.triangle(slot));
                let after_start = t[i] > 0.0 && ray.hit_is_after_start(t[i], block.triangle(slot));
                hit[i] = -i32::from(after_start);
                [weights[0][i], weights[1][i]] = weights_of(seen.edges);
                weights[2][i] = 1.0;
            } else {
                hit[i] = 0;
            }
        }
    }
}
