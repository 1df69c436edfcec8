//! Compares every instruction set with the exact decisions, with box tests in f64, and with the
//! other instruction sets.

mod cases;
mod traversals;

use self::cases::{Random, cases};
use super::super::bounds::Bounds3;
use super::super::exact::{Ray64, ShearedTriangle};
use super::super::frustum::Frustum;
use super::super::node::{Block, Child, Node, WIDTH};
use super::super::query::{Lane, Query};
use super::*;
use crate::ray::{LANES, Mask, Rays};
use crate::simd::Isa;

/// The results of the kernels for one ray, one node and one leaf.
#[derive(Debug)]
struct Answers {
    nearest: Child,
    others: Vec<(Child, f32)>,
    hit_children: u32,
    candidates: Candidates,
}

struct RunKernels<'a, T> {
    tier: T,
    node: &'a Node,
    block: &'a Block,
    lane: &'a Lane<'a>,
    tfar: f32,
}

impl<T: Tier> Kernel for RunKernels<'_, T> {
    type Output = Answers;
    #[inline(always)]
    fn run(self) -> Answers {
        let Self { tier, node, block, lane, tfar } = self;
        let mut stack = Stack::new();
        let nearest = tier.first_in_order(node, lane, tfar, &mut stack);
        let others = drain(&mut stack);
        let hit_children = tier.hit_children(node, lane, tfar);
        Answers { nearest, others, hit_children, candidates: tier.candidates(block, lane, tfar) }
    }
}

/// Returns all entries of a stack in the order in which they were pushed.
fn drain(stack: &mut Stack) -> Vec<(Child, f32)> {
    let mut entries: Vec<_> = std::iter::from_fn(|| stack.pop()).collect();
    entries.reverse();
    entries
}

/// Returns what a frustum around the active rays overlaps: children by place in the order, and
/// triangles.
struct RunFrustum<'a, T> {
    tier: T,
    node: &'a Node,
    block: &'a Block,
    query: &'a Query,
    active: &'a Mask,
    scene: &'a Bounds3,
}

impl<T: Tier> Kernel for RunFrustum<'_, T> {
    type Output = [u32; 2];
    #[inline(always)]
    fn run(self) -> [u32; 2] {
        let Self { tier, node, block, query, active, scene } = self;
        let mut tfar = query.tfar;
        for i in 0..LANES {
            tfar[i] = if active.0[i] != 0 { tfar[i] } else { f32::NEG_INFINITY };
        }
        let (frustum, end) = Frustum::new(tier, query.lane(active.first()), active, &tfar, scene);
        [
            tier.children_in_frustum(node, &frustum, end),
            tier.triangles_in_frustum(block, &frustum, end),
        ]
    }
}

struct RunHorizontalMin<'a, T> {
    tier: T,
    values: &'a [f32; WIDTH],
}

impl<T: Tier> Kernel for RunHorizontalMin<'_, T> {
    type Output = (f32, [f32; 8]);
    #[inline(always)]
    fn run(self) -> (f32, [f32; 8]) {
        let mut rows = [[0.0; WIDTH]; 8];
        for (r, row) in rows.iter_mut().enumerate() {
            for (i, value) in self.values.iter().enumerate() {
                // In every row, the minimum has another lane and another value.
                row[(i + 3 * r) % WIDTH] = value + r as f32;
            }
        }
        (self.tier.horizontal_min(self.values), self.tier.horizontal_min_rows(&rows))
    }
}

/// Returns the result of every instruction set of this machine. The first result is that of the
/// portable kernels.
macro_rules! every_tier {
    ($tier:ident => $ask:expr) => {{
        let mut answers = Vec::new();
        {
            let $tier = portable::Portable;
            answers.push((Isa::Portable, $tier.run($ask)));
        }
        #[cfg(target_arch = "aarch64")]
        {
            let $tier = neon::Neon;
            answers.push((Isa::Neon, $tier.run($ask)));
        }
        #[cfg(target_arch = "x86_64")]
        if let Some($tier) = avx2::Avx2::new() {
            answers.push((Isa::Avx2, $tier.run($ask)));
        }
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        if let Some($tier) = avx512::Avx512::new() {
            answers.push((Isa::Avx512, $tier.run($ask)));
        }
        assert_eq!(answers.len(), Isa::available().count());
        answers
    }};
}

/// Returns where the ray's line enters the box of a child, in f64. Returns `None` if it misses the
/// box or enters it after `tfar`.
fn entry(node: &Node, i: usize, rays: &Rays, ray: usize, tfar: f64) -> Option<f64> {
    let (mut near, mut far) = (f64::from(rays.tnear[ray]), tfar);
    for axis in 0..3 {
        let (o, d) = (f64::from(rays.org[axis][ray]), f64::from(rays.dir[axis][ray]));
        let (lower, upper) = (f64::from(node.planes[axis][i]), f64::from(node.planes[axis + 3][i]));
        if d == 0.0 {
            if o < lower || o > upper {
                return None;
            }
            continue;
        }
        let (a, b) = ((lower - o) / d, (upper - o) / d);
        (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
    }
    (near <= far).then_some(near)
}

#[test]
fn every_tier_finds_every_box_and_keeps_the_order() {
    let (mut hits, mut missed) = (0, 0);
    cases(600, |_, node, block, rays, query| {
        for i in 0..LANES {
            let (lane, scale) = (&query.lane(i), f64::from(query.scale[i]));
            let tfar = query.tfar[i];
            for (isa, answers) in every_tier!(tier => RunKernels { tier, node, block, lane, tfar })
            {
                let order = (0..WIDTH).map(|j| node.children[node.ordered(lane.octant, j)]);
                // From far to near: first the pushed children, then the nearest one.
                let mut found: Vec<Child> = answers.others.iter().map(|entry| entry.0).collect();
                found.extend(Some(answers.nearest).filter(|child| *child != Child::EMPTY));
                let expected: Vec<Child> = order.filter(|child| found.contains(child)).collect();
                assert_eq!(found, expected, "{isa}: {answers:?}");
                for (child, &kind) in node.children.iter().enumerate() {
                    let is_hit = (answers.hit_children >> child) & 1 != 0;
                    assert_eq!(is_hit, found.contains(&kind), "{isa}: {answers:?}");
                    if kind == Child::EMPTY {
                        continue;
                    }
                    match entry(node, child, rays, i, f64::from(rays.tfar[i])) {
                        Some(exact) => {
                            assert!(is_hit, "{isa}: {child} {node:?}");
                            let pushed = answers.others.iter().find(|entry| entry.0 == kind);
                            let distance = pushed.map_or(f32::NEG_INFINITY, |entry| entry.1);
                            assert!(f64::from(distance) <= exact * scale, "{isa}");
                            hits += 1;
                        }
                        None => missed += usize::from(!is_hit),
                    }
                }
            }
        }
    });
    assert!(hits > 1000 && missed > 1000, "{hits} {missed}");
}

/// Whether a ray certainly misses a triangle: its line misses it by more than rounding errors, or
/// the whole triangle lies behind the ray's origin.
fn misses_by_far(lane: &Lane, block: &Block, slot: usize) -> bool {
    let corners = [0, 1, 2].map(|k| {
        let v = block.corner(k, slot);
        lane.sheared(lane.axes.map(|axis| block.vertices[axis][v]))
    });
    let forward = 1.0f32.copysign(lane.value(&lane.query.dominant_component));
    let behind = corners.iter().all(|[.., depth]| depth * forward < 0.0);
    let largest = (0..3)
        .map(|k| f64::from(corners[k][1]) * f64::from(corners[(k + 1) % 3][0]))
        .chain((0..3).map(|k| f64::from(corners[k][0]) * f64::from(corners[(k + 1) % 3][1])))
        .fold(0.0, |m: f64, q| m.max(q.abs()));
    let slack = 2.0 * (f64::from(EDGE_SLACK) * largest + f64::from(EDGE_FLOOR));
    let edges = ShearedTriangle::new(lane, block, slot).edges;
    behind || (edges.iter().any(|e| *e < -slack) && edges.iter().any(|e| *e > slack))
}

#[test]
fn candidates_include_every_hit_and_sure_ones_are_hits() {
    let (mut hits, mut sure, mut ruled_out) = (0, 0, 0);
    cases(1500, |random, node, block, rays, query| {
        for i in 0..LANES {
            let lane = &query.lane(i);
            let ray = Ray64::new(rays, i, lane.axes[2]);
            let exact: Vec<Option<f64>> = (0..WIDTH)
                .map(|slot| {
                    let seen = ShearedTriangle::new(lane, block, slot);
                    let present = (block.present >> slot) & 1 != 0;
                    (present && seen.inside()).then(|| seen.t(&ray, block.triangle(slot)))
                })
                .collect();
            // The segment ends at its own end or at a hit. Another hit at the same distance must
            // still be a candidate.
            let end = exact[random.below(WIDTH)].filter(|t| *t >= 0.0);
            let tfar = end.map_or(query.tfar[i], |t| query.tfar_for_hit(i, t));
            let end = end.unwrap_or(ray.tfar);
            let hit = |t: &Option<f64>| t.is_some_and(|t| t > 0.0 && t <= end);
            let hit: Vec<bool> = exact.iter().map(hit).collect();
            let missed: Vec<bool> =
                (0..WIDTH).map(|slot| misses_by_far(lane, block, slot)).collect();
            for (isa, answers) in every_tier!(tier => RunKernels { tier, node, block, lane, tfar })
            {
                let Candidates { maybe, sure: certain } = answers.candidates;
                assert_eq!(certain & !maybe, 0, "{isa}");
                assert_eq!(maybe & !u32::from(block.present), 0, "{isa}");
                for slot in 0..WIDTH {
                    let bit = 1 << slot;
                    assert!(!hit[slot] || maybe & bit != 0, "{isa}: {slot} {block:?} {answers:?}");
                    let ruled = maybe & bit == 0;
                    assert!(ruled || !missed[slot], "{isa}: {slot} {block:?}");
                    assert!(certain & bit == 0 || exact[slot].is_some(), "{isa}: {slot} {block:?}");
                    hits += u32::from(hit[slot]);
                    sure += u32::from(certain & bit != 0);
                    ruled_out += u32::from(ruled);
                }
            }
        }
    });
    assert!(hits > 1000 && sure > 1000 && ruled_out > 1000, "{hits} {sure} {ruled_out}");
}

#[test]
fn a_frustum_culls_nothing_that_its_rays_hit() {
    let (mut hits, mut dropped) = ([0; 2], [0; 2]);
    cases(3000, |random, node, block, rays, query| {
        let lane = query.lane(random.below(LANES));
        let (few, mixed) = (random.below(2) == 0, random.below(2) == 0);
        // The active rays may have several octants, but all have the same sign along the dominant
        // axis.
        let octants = if mixed { 1 << lane.axes[2] } else { 7 };
        let active = &Mask(std::array::from_fn(|i| {
            let other = query.lane(i);
            let same = (other.octant ^ lane.octant) & octants == 0 && other.axes == lane.axes;
            -i32::from(same && (!few || random.below(4) == 0))
        }));
        if !active.any() {
            return;
        }
        let scene = &scene(node, block);
        let octant = query.lane(active.first()).octant;
        let active_lanes: Vec<usize> = (0..LANES).filter(|&i| active.0[i] != 0).collect();
        let child_hit: [bool; WIDTH] = std::array::from_fn(|child| {
            active_lanes.iter().any(|&i| {
                node.children[child] != Child::EMPTY
                    && entry(node, child, rays, i, f64::from(rays.tfar[i])).is_some()
            })
        });
        let triangle_hit: [bool; WIDTH] = std::array::from_fn(|slot| {
            active_lanes.iter().any(|&i| {
                let lane = query.lane(i);
                let seen = ShearedTriangle::new(&lane, block, slot);
                let ray = Ray64::new(rays, i, lane.axes[2]);
                let t = seen.t(&ray, block.triangle(slot));
                seen.inside() && t > ray.tnear && t < ray.tfar
            })
        });
        for (isa, [children, triangles]) in
            every_tier!(tier => RunFrustum { tier, node, block, query, active, scene })
        {
            for place in 0..WIDTH {
                let child = node.ordered(octant, place);
                let hit = child_hit[child];
                let kept = (children >> place) & 1 != 0;
                assert!(kept || !hit, "{isa}: {child} {node:?} {rays:?} {active:?}");
                (hits[0], dropped[0]) = (hits[0] + u32::from(hit), dropped[0] + u32::from(!kept));
            }
            for slot in (0..WIDTH).filter(|slot| (block.present >> slot) & 1 != 0) {
                let hit = triangle_hit[slot];
                let kept = (triangles >> slot) & 1 != 0;
                assert!(kept || !hit, "{isa}: {slot} {block:?} {rays:?} {active:?}");
                (hits[1], dropped[1]) = (hits[1] + u32::from(hit), dropped[1] + u32::from(!kept));
            }
            assert_eq!(triangles & !u32::from(block.present), 0, "{isa}");
        }
    });
    assert!(hits.iter().chain(&dropped).all(|n| *n > 1000), "{hits:?} {dropped:?}");
}

/// Returns the box around a node's children and a leaf's vertices.
fn scene(node: &Node, block: &Block) -> Bounds3 {
    let corner = |row: usize, i: usize| [0, 1, 2].map(|axis| node.planes[row + axis][i]);
    let children = (0..WIDTH).filter(|&i| node.children[i] != Child::EMPTY);
    let boxes: Vec<[f32; 3]> = children.flat_map(|i| [corner(0, i), corner(3, i)]).collect();
    let vertices: Vec<[f32; 3]> =
        (0..WIDTH).map(|i| [0, 1, 2].map(|axis| block.vertices[axis][i])).collect();
    Bounds3::from_points(&boxes).union(Bounds3::from_points(&vertices))
}

#[test]
fn the_minimum_of_16_numbers_is_found_in_every_lane() {
    let mut random = Random(3);
    for place in 0..WIDTH {
        for least in [-2.0, f32::NEG_INFINITY] {
            let mut values: [f32; WIDTH] = std::array::from_fn(|_| random.unit());
            values[(place + 3) % WIDTH] = f32::INFINITY;
            values[place] = least;
            let values = &values;
            for (isa, (found, of_rows)) in every_tier!(tier => RunHorizontalMin { tier, values }) {
                assert_eq!(found, least, "{isa}: {place}");
                let expected: [f32; 8] = std::array::from_fn(|r| least + r as f32);
                assert_eq!(of_rows, expected, "{isa}: {place}");
            }
        }
    }
}
