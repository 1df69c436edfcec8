//! All crossings of a ray with the triangles.
//!
//! A ray that passes exactly through an edge or a vertex touches several triangles. Each crossing
//! of the surface is assigned to one of them by a tie rule (simulation of simplicity, Edelsbrunner
//! and Mücke 1990, ACM TOG 9(1)): the point where the ray pierces the plane normal to its dominant
//! axis is moved by (e, e^2), with e infinitely small. An edge function that is zero has the sign
//! that it takes after this move. The move is the same for all triangles, and vertices are sheared
//! in the same way in every triangle. So the answer is that of one ray in general position:
//!
//! - Where a ray crosses a closed surface at an edge or a vertex, exactly one triangle is hit.
//! - Where a ray only touches a surface at a silhouette edge or vertex, the moved ray either misses
//!   it (no hit) or passes through both sides (two hits at the same t).
//! - A triangle that the ray sees edge-on is not crossed. Its neighbours are.

use super::exact::{ShearedTriangle, TrianglePlane};
use super::interleaved::{Interleaved, LeafVisitor};
use super::node::{Block, Child, ChildKind, WIDTH};
use super::query::{Lane, Query};
use super::simd::{self, Tier};
use super::single::Single;
use super::tree::Bvh;
use crate::ray::{LANES, Mask, Rays};
use crate::simd::Kernel;

/// A crossing of a ray with a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Ray parameter of the crossing.
    pub t: f64,
    /// Scene-wide primitive index of the triangle.
    pub primitive: u32,
    /// Lane of the ray.
    pub lane: u32,
}

impl Bvh<'_> {
    /// Appends all crossings of the active rays within (`tnear`, `tfar`) to `found`, lane by lane,
    /// in no particular order within a lane. Spheres and `leaving` are ignored.
    pub fn crossings(&self, active: &Mask, rays: &Rays, found: &mut Vec<Crossing>) {
        let (bvh, touches, slack) = (self, false, None);
        with_tier!(self.isa, tier => {
            tier.run(AllCrossings { tier, bvh, active, rays, touches, slack, found })
        });
    }

    /// As [`Bvh::crossings`], but edges and vertices belong to all their triangles, as in closest
    /// hits.
    pub fn touches(&self, active: &Mask, rays: &Rays, found: &mut Vec<Crossing>) {
        let (bvh, touches, slack) = (self, true, None);
        with_tier!(self.isa, tier => {
            tier.run(AllCrossings { tier, bvh, active, rays, touches, slack, found })
        });
    }

    /// Appends the crossings of the active rays' lines that stray from a point of the ray by more
    /// than half of `slack`, although the triangle is within `slack` of the point. The point lies
    /// `slack` before `tfar`, and `tnear` at most `slack` before it. Some triangles that are
    /// farther away may be found, too: slivers, and others whose plane is not much farther away.
    ///
    /// If `touches`, edges and vertices belong to all their triangles: see [`Bvh::touches`].
    pub fn strays(
        &self,
        active: &Mask,
        rays: &Rays,
        (slack, touches): (f32, bool),
        found: &mut Vec<Crossing>,
    ) {
        let (bvh, slack) = (self, Some(slack));
        with_tier!(self.isa, tier => {
            tier.run(AllCrossings { tier, bvh, active, rays, touches, slack, found })
        });
    }
}

struct AllCrossings<'a, T> {
    tier: T,
    bvh: &'a Bvh<'a>,
    active: &'a Mask,
    rays: &'a Rays,
    touches: bool,
    /// Only strays within this distance: see [`Bvh::strays`].
    slack: Option<f32>,
    found: &'a mut Vec<Crossing>,
}

impl<T: Tier> Kernel for AllCrossings<'_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { tier, bvh, active, rays, touches, slack, found } = self;
        let more = [slack.unwrap_or(0.0); LANES];
        let query = Query::with_slack(rays, &bvh.tree.bounds, &more);
        let first = found.len();
        let mut crossings = Crossings { touches, slack, found };
        Interleaved::new(tier, bvh, &query, rays).visit(tier.bits(active), &mut crossings);
        found[first..].sort_unstable_by_key(|crossing| crossing.lane);
    }
}

/// Collects the crossings of rays.
struct Crossings<'a> {
    /// Whether triangles that are only touched are collected, too.
    touches: bool,
    slack: Option<f32>,
    found: &'a mut Vec<Crossing>,
}

impl LeafVisitor for Crossings<'_> {
    #[inline(always)]
    fn visit<T: Tier>(&mut self, ray: &Single<T>, leaf: Child) -> bool {
        if let ChildKind::Triangles(block) = leaf.kind() {
            let Self { touches, slack, found } = self;
            if let Some(slack) = *slack {
                ray.strays_in_block(block, (slack.into(), *touches), found);
            } else {
                let end = ray.lane.value(&ray.lane.query.tfar);
                let is_within = |seen: &ShearedTriangle, t, triangle: (&Block, usize)| {
                    ray.is_within(seen, &ray.ray(), t, triangle)
                };
                ray.crossings_in_block(block, (end, *touches), is_within, found);
            }
        }
        false
    }
}

impl<T: Tier> Single<'_, T> {
    /// Adds the strays among the triangles of a leaf: see [`Bvh::strays`].
    #[inline(always)]
    fn strays_in_block(
        &self,
        index: usize,
        (slack, touches): (f64, bool),
        found: &mut Vec<Crossing>,
    ) {
        let mut ray = self.ray();
        let middle = ray.tfar - slack;
        (ray.tnear, ray.tfar) = (0.0, f64::INFINITY);
        let strays = |seen: &ShearedTriangle, t: f64, (block, slot): (&Block, usize)| {
            let (off, plane) = ((t - middle).abs(), TrianglePlane::new(block.triangle(slot)));
            let (_, towards) = plane.intersect(ray.origin, ray.direction);
            // A NaN is a stray.
            let is_far = off * towards.abs() > 2.0 * slack * plane.normal_l1();
            off > 0.5 * slack && !is_far && self.is_within(seen, &ray, t, (block, slot))
        };
        self.crossings_in_block(index, (f32::INFINITY, touches), strays, found);
    }

    /// Adds the crossings with the triangles of a leaf before `end` for which `counts` is true.
    #[inline(always)]
    fn crossings_in_block(
        &self,
        index: usize,
        (end, touches): (f32, bool),
        counts: impl Fn(&ShearedTriangle, f64, (&Block, usize)) -> bool,
        found: &mut Vec<Crossing>,
    ) {
        let block = &self.tree.blocks[index];
        let candidates = self.tier.candidates(block, &self.lane, end);
        let mut left = candidates.maybe;
        while left != 0 {
            let i = left.trailing_zeros();
            left &= left - 1;
            let slot = i as usize % WIDTH;
            let sure = (candidates.sure >> i) & 1 != 0;
            if !sure && !touches && !is_crossed(&self.lane, block, slot) {
                continue;
            }
            let (seen, ray) = (ShearedTriangle::new(&self.lane, block, slot), self.ray());
            if !sure && touches && !seen.inside() {
                continue;
            }
            let t = seen.t(&ray, block.triangle(slot));
            if counts(&seen, t, (block, slot)) {
                let lane = (self.lane.i % LANES) as u32;
                let primitive = self.tree.indices().of(block, slot);
                found.push(Crossing { t, primitive, lane });
            }
        }
    }
}

/// Whether the ray crosses triangle `slot` of a leaf, by the tie rule.
#[inline(always)]
fn is_crossed(lane: &Lane, block: &Block, slot: usize) -> bool {
    let corner = |k: usize| {
        let v = block.corner(k, slot);
        let [x, y, _] = lane.sheared(lane.axes.map(|axis| block.vertices[axis][v]));
        [x, y]
    };
    let (a, b, c) = (corner(0), corner(1), corner(2));
    let (u, v, w) = (side(b, c), side(c, a), side(a, b));
    u != 0 && u == v && v == w
}

/// Returns the side of the edge from `a` to `b` on which the ray passes: -1 or 1. Returns 0 if the
/// points are equal, or if a x b is NaN.
///
/// The sign of a x b is exact: see [`super::exact`]. For the moved ray (e, e^2) the edge function
/// is a x b + e (a_y - b_y) + e^2 (b_x - a_x).
#[inline(always)]
fn side(a: [f32; 2], b: [f32; 2]) -> i32 {
    let (p, q) = (f64::from(a[0]) * f64::from(b[1]), f64::from(a[1]) * f64::from(b[0]));
    let sign = |x: f64, y: f64| i32::from(x > y) - i32::from(x < y);
    match sign(p, q) {
        0 if (p - q).is_nan() => 0,
        0 => match sign(a[1].into(), b[1].into()) {
            0 => sign(b[0].into(), a[0].into()),
            tie => tie,
        },
        decided => decided,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All edges between lattice points around the ray. Reversing an edge flips the side.
    #[test]
    fn sides_are_antisymmetric_and_never_tied() {
        let points: Vec<[f32; 2]> =
            (-2i8..=2).flat_map(|x| (-2i8..=2).map(move |y| [x.into(), y.into()])).collect();
        for &a in &points {
            for &b in &points {
                assert_eq!(side(a, b), -side(b, a));
                assert_eq!(side(a, b) == 0, a == b);
            }
        }
        assert_eq!(side([f32::NAN, 0.0], [1.0, 1.0]), 0);
    }

    /// A fan around the origin: the ray through its middle crosses one triangle.
    #[test]
    fn a_vertex_belongs_to_one_triangle_of_a_fan() {
        let ring: [[f32; 2]; 6] =
            [[2.0, 0.0], [1.0, 1.0], [-1.0, 2.0], [-2.0, 0.0], [-1.0, -1.0], [0.0, -3.0]];
        let inside = |a, b, c| {
            let (u, v, w) = (side(b, c), side(c, a), side(a, b));
            u != 0 && u == v && v == w
        };
        let middle = [0.0, 0.0];
        let hits = (0..6).filter(|&i| inside(middle, ring[i], ring[(i + 1) % 6])).count();
        assert_eq!(hits, 1);
        // The fan ends at a point of its rim, so the ray there crosses at most one triangle.
        let rim = [2.0f32, 0.0];
        let moved = |p: [f32; 2]| [p[0] - rim[0], p[1] - rim[1]];
        let hits = (0..6)
            .filter(|&i| inside(moved(middle), moved(ring[i]), moved(ring[(i + 1) % 6])))
            .count();
        assert!(hits < 2, "{hits}");
    }
}
