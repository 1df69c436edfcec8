//! 16 rays of one direction octant through the tree together.
//!
//! One ray that bounds them all finds the children of a node that any of them can meet; then the 16
//! rays are tested against each of these, and against each triangle of a leaf, lane by lane. The
//! decisions are those of [`super::exact`], taken over lanes.

use std::cell::Cell;

use super::build::Tree;
use super::exact::{DEPTH_SLACK, Plane, Ray64, Sheared};
use super::found::Found;
use super::frustum::Frustum;
use super::node::{Block, Child, Kind, Node};
use super::query::{Query, max, min};
use super::simd::{EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
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

/// So many rays are traced on alone.
const FEW: u32 = 3;

/// What is yet to visit.
pub struct Stacks {
    /// By the rays together: the thread's own, whose room it keeps.
    packet: Vec<Entry>,
    /// By one ray alone.
    single: Stack,
}

impl Stacks {
    /// Empty stacks. (No closure gets them: that would be compiled for the portable tier.)
    #[inline(always)]
    pub fn take() -> Self {
        Self { packet: STACK.take(), single: Stack::new() }
    }

    /// Keeps the room for the thread's next packet.
    #[inline(always)]
    pub fn keep(self) {
        let mut stack = self.packet;
        stack.clear();
        STACK.set(stack);
    }
}

/// A triangle against the lines of 16 rays, in f32.
struct Edges {
    /// Lanes whose line may meet it: all bits set.
    maybe: [i32; LANES],
    /// Those of them whose line may also miss it.
    unsure: [i32; LANES],
    /// How far along the dominant axis the triangle begins.
    first: [f32; LANES],
    /// How far it ends.
    last: [f32; LANES],
    /// See [`Found::weights`].
    weights: [[f32; LANES]; 3],
}

/// A triangle against 16 rays.
struct Test {
    /// Lanes that hit, at `t`: all bits set.
    hit: [i32; LANES],
    t: [f64; LANES],
    /// See [`Found::weights`].
    weights: [[f32; LANES]; 3],
}

/// The numbers of the bits that are set, from the lowest on.
struct Bits(u32);

impl Iterator for Bits {
    type Item = usize;
    #[inline(always)]
    fn next(&mut self) -> Option<usize> {
        let lowest = self.0.trailing_zeros() as usize;
        self.0 &= self.0.wrapping_sub(1);
        (lowest < LANES).then_some(lowest)
    }
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
    /// Around the rays.
    frustum: Frustum,
    /// Where it ends: see [`Frustum::end`].
    end: f32,
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
        let (frustum, end) = Frustum::new(tier, query, active, &tfar, &tree.bounds);
        Self { tier, tree, geometry, query, rays, tfar, frustum, end }
    }

    /// The kernels.
    #[inline(always)]
    pub fn tier(&self) -> T {
        self.tier
    }

    /// Ends of the segments as the boxes see them.
    #[inline(always)]
    pub fn tfar(&self) -> &[f32; LANES] {
        &self.tfar
    }

    /// Updates the closest hits.
    #[inline(always)]
    pub fn closest(mut self, stacks: &mut Stacks, best: &mut Found) {
        stacks.packet.push(Entry { near: [f32::NEG_INFINITY; LANES], child: Child::node(0) });
        while let Some(entry) = stacks.packet.pop() {
            let entering = self.tier.at_most(&entry.near, &self.tfar);
            match entry.child.kind() {
                _ if entering == 0 => {}
                Kind::Node(index) if entering.count_ones() > FEW => {
                    self.push(&self.tree.nodes[index], &mut stacks.packet);
                }
                Kind::Node(_) => {
                    for i in Bits(entering) {
                        let mut one = Best::of(best, i, self.tfar[i]);
                        self.single(i).closest_below(entry.child, &mut stacks.single, &mut one);
                        self.take(i, &one, best);
                    }
                    self.shorten();
                }
                _ => {
                    self.closest_in_leaf(entry.child, entering, best);
                    if !stacks.packet.is_empty() {
                        self.shorten();
                    }
                }
            }
        }
    }

    /// The rays that anything stops: all bits set.
    #[inline(always)]
    pub fn occluded(mut self, stacks: &mut Stacks) -> [i32; LANES] {
        let mut stopped = [0; LANES];
        stacks.packet.push(Entry { near: [f32::NEG_INFINITY; LANES], child: Child::node(0) });
        while let Some(entry) = stacks.packet.pop() {
            let entering = self.tier.at_most(&entry.near, &self.tfar);
            match entry.child.kind() {
                _ if entering == 0 => {}
                Kind::Node(index) if entering.count_ones() > FEW => {
                    self.push(&self.tree.nodes[index], &mut stacks.packet);
                }
                Kind::Node(_) => {
                    for i in Bits(entering) {
                        if self.single(i).occluded_below(entry.child, &mut stacks.single) {
                            stopped[i] = -1;
                        }
                    }
                    self.stop(&stopped);
                }
                _ => self.any_in_leaf(entry.child, entering, &mut stopped),
            }
        }
        stopped
    }

    /// Updates the closest hits of the rays that enter a leaf's box.
    #[inline(always)]
    pub fn closest_in_leaf(&mut self, leaf: Child, entering: u32, best: &mut Found) {
        match leaf.kind() {
            Kind::Triangles(index) => self.closest_in_block(index, entering, best),
            Kind::Spheres(index) => self.closest_in_spheres(index, best),
            Kind::Node(_) | Kind::Empty => {}
        }
    }

    /// Adds the rays that anything in a leaf stops, of those that enter its box.
    #[inline(always)]
    pub fn any_in_leaf(&mut self, leaf: Child, entering: u32, stopped: &mut [i32; LANES]) {
        match leaf.kind() {
            Kind::Triangles(index) => self.any_in_block(index, entering, stopped),
            Kind::Spheres(index) => self.any_in_spheres(index, stopped),
            Kind::Node(_) | Kind::Empty => {}
        }
        self.stop(stopped);
    }

    /// The frustum ends with the last ray.
    #[inline(always)]
    pub fn shorten(&mut self) {
        self.end = self.frustum.end(self.tier, self.query, &self.tfar);
    }

    /// Ends stopped rays.
    #[inline(always)]
    fn stop(&mut self, stopped: &[i32; LANES]) {
        for i in 0..LANES {
            self.tfar[i] = if stopped[i] != 0 { f32::NEG_INFINITY } else { self.tfar[i] };
        }
    }

    /// Takes over what a ray alone has found, if it has found anything.
    #[inline(always)]
    fn take(&mut self, i: usize, one: &Best, best: &mut Found) {
        if one.t != best.t[i] || one.primitive != best.primitive[i] {
            self.tfar[i] = one.tfar;
            one.store(best, i);
        }
    }

    /// Pushes the children that any ray meets, the nearest last.
    #[inline(always)]
    fn push(&self, node: &Node, stack: &mut Vec<Entry>) {
        let (q, octant) = (self.query, self.frustum.octant);
        let rows = [0, 1, 2].map(|axis| (axis + 3 * ((octant >> axis) & 1)) % 6);
        for place in Bits(self.tier.overlaps(node, &self.frustum, self.end)) {
            let slot = node.ordered(octant, place);
            let mut near = q.tnear;
            let mut far = self.tfar;
            for axis in 0..3 {
                let enter = node.planes[rows[axis]][slot];
                let leave = node.planes[2 * axis + 3 - rows[axis]][slot];
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

    /// The lines of the rays that enter a leaf's box against one of its triangles; none if no ray may hit it.
    #[inline(always)]
    fn edges(&self, block: &Block, slot: usize, entering: &[i32; LANES]) -> Option<Edges> {
        let axes = self.frustum.axes;
        let corner = |k: usize| {
            let v = block.corner(k, slot);
            [block.vertices[axes[0]][v], block.vertices[axes[1]][v], block.vertices[axes[2]][v]]
        };
        let (p, q, r) = (corner(0), corner(1), corner(2));
        let query = self.query;
        let mut weights = [[0.0f32; LANES]; 3];
        let mut maybe = [0i32; LANES];
        let mut unsure = [0i32; LANES];
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
            // Not fused: these become the weights, which are the same in every tier.
            let (u, v, w) = (cx * by - q0, ax * cy - q1, bx * ay - q2);
            (weights[0][i], weights[1][i], weights[2][i]) = (v, w, u + v + w);
            let slack = max(max(q0.abs(), q1.abs()), q2.abs()) * EDGE_SLACK + EDGE_FLOOR;
            let (least, most) = (min(min(u, v), w), max(max(u, v), w));
            let misses = (least < -slack) & (most > slack);
            let sure = (least > slack) | (most < -slack);
            let (least, most) = (min(min(az, bz), cz), max(max(az, bz), cz));
            (first[i], last[i]) = if backward { (-most, -least) } else { (least, most) };
            maybe[i] = entering[i] & -i32::from(!misses);
            unsure[i] = maybe[i] & -i32::from(!sure);
        }
        let primitive = block.primitives[slot];
        let mut any = 0;
        for i in 0..LANES {
            // Behind what the ray has met: no need to look at the plane.
            let behind = first[i] > query.depth(i, self.tfar[i]);
            let leaving = self.rays.leaving[i] == primitive;
            maybe[i] &= -i32::from(!(behind | leaving));
            unsure[i] &= maybe[i];
            any |= maybe[i];
        }
        (any != 0).then_some(Edges { maybe, unsure, first, last, weights })
    }

    /// Where the rays of `edges` meet the triangle, those in doubt decided.
    #[inline(always)]
    fn test(&self, block: &Block, slot: usize, edges: Edges) -> Test {
        let Edges { mut maybe, mut unsure, first, last, weights } = edges;
        let mut t = self.distances(block.triangle(slot));
        // In one loop: what is stored by halves of a register is not there for a whole one at once.
        let mut doubt = 0;
        for i in 0..LANES {
            let depth = t[i] * self.along(i).abs();
            let slack = depth.abs() * DEPTH_SLACK;
            let within =
                (depth >= f64::from(first[i]) - slack) & (depth <= f64::from(last[i]) + slack);
            unsure[i] |= maybe[i] & -i32::from(!within);
            doubt |= unsure[i];
        }
        if doubt != 0 {
            // Copies: of what a call has seen nothing stays in registers.
            let (unsure, mut hit, mut at) = (unsure, maybe, t);
            self.decide(block, slot, &unsure, &mut hit, &mut at);
            (maybe, t) = (hit, at);
        }
        Test { hit: maybe, t, weights }
    }

    /// Direction along the dominant axis.
    #[inline(always)]
    fn along(&self, i: usize) -> f64 {
        // The scaled one times a power of two: exact but for denormals.
        f64::from(self.query.along[i]) * f64::from(self.query.scale[i])
    }

    /// Ray parameters of a triangle's plane.
    #[inline(always)]
    fn distances(&self, corners: [[f32; 3]; 3]) -> [f64; LANES] {
        let mut t = [0.0; LANES];
        let plane = Plane::new(corners);
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.rays.org, &self.rays.dir);
        for i in 0..LANES {
            let origin = [f64::from(ox[i]), f64::from(oy[i]), f64::from(oz[i])];
            let direction = [f64::from(dx[i]), f64::from(dy[i]), f64::from(dz[i])];
            t[i] = plane.t(origin, direction);
        }
        t
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
    fn closest_in_block(&mut self, index: usize, entering: u32, best: &mut Found) {
        let block = &self.tree.blocks[index];
        let triangles = self.tier.overlapping(block, &self.frustum, self.end);
        if entering.count_ones() <= triangles.count_ones() {
            for i in Bits(entering) {
                let mut one = Best::of(best, i, self.tfar[i]);
                self.single(i).closest_in_block(index, &mut one);
                self.take(i, &one, best);
            }
            return;
        }
        let entering = spread(entering);
        for slot in Bits(triangles) {
            let Some(edges) = self.edges(block, slot, &entering) else { continue };
            let test = self.test(block, slot, edges);
            let primitive = block.primitives[slot];
            let second_half = -i32::from(block.is_second_half(slot));
            for i in 0..LANES {
                let t = test.t[i];
                let closer = (t < best.t[i])
                    | ((t == best.t[i])
                        & (primitive < best.primitive[i])
                        & (best.primitive[i] != NONE));
                let counts = (test.hit[i] != 0) & closer & (t > f64::from(self.rays.tnear[i]));
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
    fn any_in_block(&mut self, index: usize, entering: u32, stopped: &mut [i32; LANES]) {
        let block = &self.tree.blocks[index];
        let triangles = self.tier.overlapping(block, &self.frustum, self.end);
        if entering.count_ones() <= triangles.count_ones() {
            for i in Bits(entering) {
                if self.single(i).any_in_block(index) {
                    stopped[i] = -1;
                }
            }
            return;
        }
        let entering = spread(entering);
        for slot in Bits(triangles) {
            let Some(mut edges) = self.edges(block, slot, &entering) else { continue };
            let mut rest = 0;
            for i in 0..LANES {
                // t is kept within the depths of the corners: where these are clear of the ends, it is not asked for.
                let within = self.query.within(i, edges.first[i], edges.last[i]);
                let sure = edges.maybe[i] & !edges.unsure[i] & -i32::from(within);
                stopped[i] |= sure;
                self.tfar[i] = if sure != 0 { f32::NEG_INFINITY } else { self.tfar[i] };
                edges.maybe[i] &= !sure;
                rest |= edges.maybe[i];
            }
            if rest == 0 {
                continue;
            }
            let test = self.test(block, slot, edges);
            for i in 0..LANES {
                let t = test.t[i];
                let counts = (test.hit[i] != 0)
                    & (t > f64::from(self.rays.tnear[i]))
                    & (t < f64::from(self.rays.tfar[i]));
                stopped[i] |= -i32::from(counts);
                self.tfar[i] = if counts { f32::NEG_INFINITY } else { self.tfar[i] };
            }
        }
    }

    #[inline(always)]
    fn single(&self, i: usize) -> Single<'a, T> {
        Single::new(self.tier, (self.tree, self.geometry), self.query.lane(i), self.rays)
    }

    #[inline(never)]
    fn closest_in_spheres(&mut self, index: usize, best: &mut Found) {
        for i in 0..LANES {
            if self.tfar[i] == f32::NEG_INFINITY {
                continue;
            }
            let mut one = Best::of(best, i, self.tfar[i]);
            self.single(i).closest_in_spheres(index, &mut one);
            self.take(i, &one, best);
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

/// Bits as lanes: all bits set.
#[inline(always)]
fn spread(bits: u32) -> [i32; LANES] {
    let mut lanes = [0; LANES];
    for i in 0..LANES {
        lanes[i] = -(((bits >> i) & 1) as i32);
    }
    lanes
}
