//! 16 rays of one direction octant through the tree together.
//!
//! One ray that bounds them all finds the children of a node that any of them can meet; then the 16
//! rays are tested against each of these, and against each triangle of a leaf, lane by lane. The
//! decisions are those of [`super::exact`], taken over lanes.

use std::cell::Cell;

use super::build::Tree;
use super::exact::{DEPTH_SLACK, Plane, Ray64, Sheared};
use super::found::Found;
use super::node::{Block, Child, Kind, Node, WIDTH};
use super::query::{Bundle, Query, Slabs};
use super::simd::{EDGE_FLOOR, EDGE_SLACK, Tier};
use super::single::{Best, Single};
use crate::geometry::Geometry;
use crate::ray::{LANES, Mask, NONE, Rays};

/// A child yet to visit and the distances at which the rays enter it, infinite for those that miss.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub struct Entry {
    near: [f32; LANES],
    child: Child,
}

thread_local! {
    /// Room for the packets of this thread.
    static STACK: Cell<Vec<Entry>> = const { Cell::new(Vec::new()) };
}

/// An empty stack. (No closure gets it: that would be compiled for the portable tier.)
#[inline(always)]
pub fn take_stack() -> Vec<Entry> {
    STACK.take()
}

/// Keeps a stack for the thread's next packet.
#[inline(always)]
pub fn keep_stack(mut stack: Vec<Entry>) {
    stack.clear();
    STACK.set(stack);
}

/// A triangle against 16 rays.
struct Test {
    /// Lanes that hit, at `t`: all bits set.
    hit: [i32; LANES],
    t: [f64; LANES],
    /// See [`Found::weights`].
    weights: [[f32; LANES]; 3],
}

impl Test {
    const NONE: Self = Self { hit: [0; LANES], t: [0.0; LANES], weights: [[0.0; LANES]; 3] };
}

/// 16 rays on their way through the tree.
pub struct Packet<'a, T> {
    tier: T,
    tree: &'a Tree,
    geometry: &'a Geometry,
    query: &'a Query,
    rays: &'a Rays,
    /// Ends of the segments as the boxes see them; -inf where a ray is done.
    tfar: [f32; LANES],
}

impl<'a, T: Tier> Packet<'a, T> {
    /// The active rays of a query, which are coherent ([`Query::coherent`]).
    #[inline(always)]
    pub fn new(
        tier: T,
        (tree, geometry): (&'a Tree, &'a Geometry),
        (query, rays): (&'a Query, &'a Rays),
        active: &Mask,
    ) -> Self {
        let mut tfar = query.tfar;
        for i in 0..LANES {
            tfar[i] = if active.0[i] != 0 { tfar[i] } else { f32::NEG_INFINITY };
        }
        Self { tier, tree, geometry, query, rays, tfar }
    }

    /// Updates the closest hits.
    #[inline(always)]
    pub fn closest(mut self, active: &Mask, stack: &mut Vec<Entry>, best: &mut Found) {
        let bundle = self.query.bundle(self.tier, active);
        let around = self.query.around(self.tier, active, &bundle);
        let mut reach = self.reach();
        stack.push(Entry { near: [f32::NEG_INFINITY; LANES], child: Child::node(0) });
        while let Some(entry) = stack.pop() {
            if !self.any_before(&entry.near) {
                continue;
            }
            match entry.child.kind() {
                Kind::Node(index) => {
                    self.push(&self.tree.nodes[index], &around, reach, stack);
                }
                Kind::Triangles(index) => {
                    self.closest_in_block(index, &bundle, &entry.near, best);
                    reach = self.reach();
                }
                Kind::Spheres(index) => {
                    self.closest_in_spheres(index, best);
                    reach = self.reach();
                }
                Kind::Empty => {}
            }
        }
    }

    /// The rays that anything stops: all bits set.
    #[inline(always)]
    pub fn occluded(mut self, active: &Mask, stack: &mut Vec<Entry>) -> [i32; LANES] {
        let bundle = self.query.bundle(self.tier, active);
        let around = self.query.around(self.tier, active, &bundle);
        let reach = self.reach();
        let mut stopped = [0; LANES];
        stack.push(Entry { near: [f32::NEG_INFINITY; LANES], child: Child::node(0) });
        while let Some(entry) = stack.pop() {
            if !self.any_before(&entry.near) {
                continue;
            }
            match entry.child.kind() {
                Kind::Node(index) => {
                    self.push(&self.tree.nodes[index], &around, reach, stack);
                }
                Kind::Triangles(index) => {
                    self.any_in_block(index, &bundle, &entry.near, &mut stopped);
                }
                Kind::Spheres(index) => self.any_in_spheres(index, &mut stopped),
                Kind::Empty => {}
            }
            for i in 0..LANES {
                self.tfar[i] = if stopped[i] != 0 { f32::NEG_INFINITY } else { self.tfar[i] };
            }
        }
        stopped
    }

    /// The farthest end of any ray.
    #[inline(always)]
    fn reach(&self) -> f32 {
        let mut minus = [0.0; LANES];
        for i in 0..LANES {
            minus[i] = -self.tfar[i];
        }
        -self.tier.least(&minus)
    }

    /// Whether any ray enters before its end.
    #[inline(always)]
    fn any_before(&self, near: &[f32; LANES]) -> bool {
        let mut any = 0;
        for i in 0..LANES {
            any |= i32::from(near[i] <= self.tfar[i]);
        }
        any != 0
    }

    /// Pushes the children that any ray meets, the nearest last.
    #[inline(always)]
    fn push(&self, node: &Node, around: &Slabs, reach: f32, stack: &mut Vec<Entry>) {
        let mut places = self.tier.overlaps(node, around, reach);
        let q = self.query;
        while places != 0 {
            let slot = node.ordered(around.octant, places.trailing_zeros() as usize);
            places &= places - 1;
            let mut near = q.tnear;
            let mut far = self.tfar;
            for axis in 0..3 {
                let enter = node.planes[around.enter[axis]][slot];
                let leave = node.planes[around.leave[axis]][slot];
                for i in 0..LANES {
                    let t0 = T::mul_sub(enter, q.near_inverse[axis][i], q.near_offset[axis][i]);
                    let t1 = T::mul_sub(leave, q.far_inverse[axis][i], q.far_offset[axis][i]);
                    near[i] = if t0 > near[i] { t0 } else { near[i] };
                    far[i] = if t1 < far[i] { t1 } else { far[i] };
                }
            }
            let mut any = 0;
            for i in 0..LANES {
                let meets = near[i] <= far[i];
                any |= i32::from(meets);
                near[i] = if meets { near[i] } else { f32::INFINITY };
            }
            if any != 0 {
                stack.push(Entry { near, child: node.children[slot] });
            }
        }
    }

    /// One triangle of a leaf against the rays that enter the leaf's box.
    #[inline(always)]
    fn test(
        &self,
        block: &Block,
        slot: usize,
        axes: [usize; 3],
        near: &[f32; LANES],
        out: &mut Test,
    ) -> bool {
        let corner = |k: usize| {
            let v = block.corner(k, slot);
            [block.vertices[axes[0]][v], block.vertices[axes[1]][v], block.vertices[axes[2]][v]]
        };
        let (p, q, r) = (corner(0), corner(1), corner(2));
        let query = self.query;
        let mut maybe = [0i32; LANES];
        let mut unsure = [0i32; LANES];
        let (mut least_depth, mut most_depth) = ([0.0f32; LANES], [0.0f32; LANES]);
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
            // Not fused: these become the weights, which are the same in every tier.
            let (u, v, w) = (cx * by - q0, ax * cy - q1, bx * ay - q2);
            (out.weights[0][i], out.weights[1][i], out.weights[2][i]) = (v, w, u + v + w);
            let slack = max(max(q0.abs(), q1.abs()), q2.abs()) * EDGE_SLACK + EDGE_FLOOR;
            let (least, most) = (min(min(u, v), w), max(max(u, v), w));
            let misses = (least < -slack) & (most > slack);
            let sure = (least > slack) | (most < -slack);
            least_depth[i] = min(min(az, bz), cz);
            most_depth[i] = max(max(az, bz), cz);
            let active = near[i] <= self.tfar[i];
            maybe[i] = -i32::from(active & !misses);
            unsure[i] = -i32::from(active & !misses & !sure);
        }
        let mut any = 0;
        for i in 0..LANES {
            any |= maybe[i];
        }
        if any == 0 {
            return false;
        }
        self.distances(block.triangle(slot), &mut out.t);
        for i in 0..LANES {
            let depth = out.t[i] * self.along(i);
            let slack = depth.abs() * DEPTH_SLACK;
            let within = (depth >= f64::from(least_depth[i]) - slack)
                & (depth <= f64::from(most_depth[i]) + slack);
            unsure[i] |= maybe[i] & -i32::from(!within);
        }
        let mut doubt = 0;
        for i in 0..LANES {
            doubt |= unsure[i];
        }
        if doubt != 0 {
            self.decide(block, slot, &unsure, &mut maybe, &mut out.t);
        }
        out.hit = maybe;
        true
    }

    /// Direction along the dominant axis.
    #[inline(always)]
    fn along(&self, i: usize) -> f64 {
        // The scaled one times a power of two: exact but for denormals.
        f64::from(self.query.along[i]) * f64::from(self.query.scale[i])
    }

    /// Ray parameters of a triangle's plane.
    #[inline(always)]
    fn distances(&self, corners: [[f32; 3]; 3], t: &mut [f64; LANES]) {
        let plane = Plane::new(corners);
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.rays.org, &self.rays.dir);
        for i in 0..LANES {
            let origin = [f64::from(ox[i]), f64::from(oy[i]), f64::from(oz[i])];
            let direction = [f64::from(dx[i]), f64::from(dy[i]), f64::from(dz[i])];
            t[i] = plane.t(origin, direction);
        }
    }

    /// Lanes in doubt, one by one.
    #[inline(never)]
    fn decide(
        &self,
        block: &Block,
        slot: usize,
        unsure: &[i32; LANES],
        hit: &mut [i32; LANES],
        t: &mut [f64; LANES],
    ) {
        for i in (0..LANES).filter(|&i| unsure[i] != 0) {
            let lane = self.query.lane(i);
            let seen = Sheared::new(&lane, block, slot);
            if seen.inside() {
                let ray = Ray64::new(self.rays, i, lane.axes[2]);
                t[i] = seen.t(&ray, block.triangle(slot));
            } else {
                hit[i] = 0;
            }
        }
    }

    #[inline(always)]
    fn closest_in_block(
        &mut self,
        index: usize,
        bundle: &Bundle,
        near: &[f32; LANES],
        best: &mut Found,
    ) {
        let block = &self.tree.blocks[index];
        let mut test = Test::NONE;
        let mut left = self.tier.overlapping(block, bundle);
        while left != 0 {
            let slot = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            if !self.test(block, slot, bundle.axes, near, &mut test) {
                continue;
            }
            let primitive = block.primitives[slot];
            let second_half = -i32::from(block.is_second_half(slot));
            for i in 0..LANES {
                let t = test.t[i];
                let closer = (t < best.t[i])
                    | ((t == best.t[i])
                        & (primitive < best.primitive[i])
                        & (best.primitive[i] != NONE));
                let counts = (test.hit[i] != 0)
                    & closer
                    & (t > f64::from(self.rays.tnear[i]))
                    & (primitive != self.rays.leaving[i]);
                best.t[i] = if counts { t } else { best.t[i] };
                best.primitive[i] = if counts { primitive } else { best.primitive[i] };
                for (weights, found) in best.weights.iter_mut().zip(&test.weights) {
                    weights[i] = if counts { found[i] } else { weights[i] };
                }
                best.second_half[i] = if counts { second_half } else { best.second_half[i] };
                let tfar = t as f32 * self.query.scale[i];
                self.tfar[i] = if counts { tfar } else { self.tfar[i] };
            }
        }
    }

    #[inline(always)]
    fn any_in_block(
        &mut self,
        index: usize,
        bundle: &Bundle,
        near: &[f32; LANES],
        stopped: &mut [i32; LANES],
    ) {
        let block = &self.tree.blocks[index];
        let mut test = Test::NONE;
        let mut left = self.tier.overlapping(block, bundle);
        while left != 0 {
            let slot = left.trailing_zeros() as usize % WIDTH;
            left &= left - 1;
            if !self.test(block, slot, bundle.axes, near, &mut test) {
                continue;
            }
            let primitive = block.primitives[slot];
            for i in 0..LANES {
                let t = test.t[i];
                let counts = (test.hit[i] != 0)
                    & (t > f64::from(self.rays.tnear[i]))
                    & (t < f64::from(self.rays.tfar[i]))
                    & (primitive != self.rays.leaving[i]);
                stopped[i] |= -i32::from(counts);
                self.tfar[i] = if counts { f32::NEG_INFINITY } else { self.tfar[i] };
            }
        }
    }

    fn single(&self, i: usize) -> Single<'a, T> {
        let lane = self.query.lane(i);
        let ray = Ray64::new(self.rays, i, lane.axes[2]);
        Single::new(self.tier, (self.tree, self.geometry), lane, ray, self.rays.leaving[i])
    }

    #[inline(never)]
    fn closest_in_spheres(&mut self, index: usize, best: &mut Found) {
        for i in 0..LANES {
            if self.tfar[i] == f32::NEG_INFINITY {
                continue;
            }
            let mut one = Best::of(best, i, self.tfar[i]);
            self.single(i).closest_in_spheres(index, &mut one);
            if one.primitive != best.primitive[i] {
                self.tfar[i] = one.tfar;
                one.store(best, i);
            }
        }
    }

    #[inline(never)]
    fn any_in_spheres(&self, index: usize, stopped: &mut [i32; LANES]) {
        for i in 0..LANES {
            if self.tfar[i] != f32::NEG_INFINITY && self.single(i).any_in_spheres(index) {
                stopped[i] = -1;
            }
        }
    }
}

#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn max(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}
