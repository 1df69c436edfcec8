//! Every tier against the exact decisions, against f64 boxes, and against the other tiers.

use super::super::Bvh;
use super::super::bounds::Bounds3;
use super::super::exact::{Ray64, Sheared};
use super::super::node::{Block, Child, Node, SECOND_HALF, WIDTH};
use super::super::query::{Bundle, Lane, Query};
use super::*;
use crate::accel::{Accelerator, BuildOptions};
use crate::geometry::{Geometry, Sphere, TriangleMesh};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays};
use crate::simd::{Isa, Kernel, dispatch};

const ALL: Mask = Mask([-1; LANES]);

/// Numbers that look random (Steele and Vigna's constants of a 64-bit congruential generator).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_mul(0xd134_2543_de82_ef95).wrapping_add(1);
        (self.0 >> 33) as usize % n
    }

    /// In [-1, 1).
    fn unit(&mut self) -> f32 {
        self.below(1 << 24) as f32 / (1 << 23) as f32 - 1.0
    }

    fn point(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.unit())
    }

    /// Of few different coordinates, so that rays meet edges and vertices and lie in planes.
    fn grid_point(&mut self) -> [f32; 3] {
        std::array::from_fn(|_| self.below(5) as f32 - 2.0)
    }
}

/// Random and nasty points: on a grid, or anywhere, of any magnitude.
fn points(random: &mut Random) -> Vec<[f32; 3]> {
    let magnitude = [1.0, 1.0, 1e-3, 1e6, 1e-30, 1e18][random.below(6)];
    let grid = random.below(2) == 0;
    let point = |random: &mut Random| if grid { random.grid_point() } else { random.point() };
    (0..WIDTH).map(|_| point(random).map(|x| x * magnitude)).collect()
}

fn around(points: &[[f32; 3]]) -> Bounds3 {
    Bounds3::of(points)
}

/// A leaf over 16 points.
fn block(random: &mut Random, points: &[[f32; 3]]) -> Block {
    let mut block = Block::EMPTY;
    for (i, point) in points.iter().enumerate() {
        for axis in 0..3 {
            block.vertices[axis][i] = point[axis];
        }
    }
    for i in 0..1 + random.below(WIDTH) {
        for k in 0..3 {
            block.corners[k][i] = random.below(WIDTH) as u8;
        }
        if random.below(3) == 0 {
            block.corners[0][i] |= SECOND_HALF;
        }
        block.primitives[i] = i as u32;
        block.present |= 1 << i;
    }
    block
}

/// A node whose boxes have corners among the points.
fn node(random: &mut Random, points: &[[f32; 3]]) -> Node {
    let mut node = Node::EMPTY;
    for i in 0..1 + random.below(WIDTH) {
        let (p, q) = (points[random.below(WIDTH)], points[random.below(WIDTH)]);
        for axis in 0..3 {
            node.planes[axis][i] = p[axis].min(q[axis]);
            node.planes[axis + 3][i] = p[axis].max(q[axis]);
        }
        node.children[i] = Child::triangles(i);
    }
    for octant in 0..8 {
        let mut order: [u8; WIDTH] = std::array::from_fn(|i| i as u8);
        for i in (1..WIDTH).rev() {
            order.swap(i, random.below(i + 1));
        }
        node.set_order(octant, &order);
    }
    node
}

/// Rays from a random place at points, at what lies between them, and along axes.
fn rays(random: &mut Random, points: &[[f32; 3]]) -> Rays {
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        let reach = points.iter().flatten().fold(0.0f32, |m, x| m.max(x.abs())).max(1e-30);
        let from = if random.below(4) == 0 {
            points[random.below(WIDTH)]
        } else {
            random.grid_point().map(|x| x * reach)
        };
        let (a, b, c) =
            (points[random.below(WIDTH)], points[random.below(WIDTH)], points[random.below(WIDTH)]);
        let target = match random.below(3) {
            0 => a,
            1 => std::array::from_fn(|k| 0.5 * (a[k] + b[k])),
            _ => std::array::from_fn(|k| 0.25 * a[k] + 0.25 * b[k] + 0.5 * c[k]),
        };
        let mut direction: [f32; 3] = std::array::from_fn(|k| target[k] - from[k]);
        if random.below(4) == 0 || direction.iter().all(|d| d.abs() < 1e-33) {
            direction = [0.0, -0.0, 0.0];
            direction[random.below(3)] = if random.below(2) == 0 { 1.0 } else { -3.0 };
        }
        for axis in 0..3 {
            rays.org[axis][i] = from[axis];
            rays.dir[axis][i] = direction[axis];
        }
        if random.below(3) == 0 {
            rays.tfar[i] = 1.0;
        }
    }
    rays
}

/// What a tier says of one ray, a node and a leaf.
#[derive(Debug)]
struct Answers {
    ordered: Vec<(Child, f32)>,
    any: Vec<(Child, f32)>,
    overlaps: u32,
    candidates: Candidates,
}

struct Ask<'a, T> {
    tier: T,
    node: &'a Node,
    block: &'a Block,
    lane: &'a Lane<'a>,
    tfar: f32,
}

impl<T: Tier> Kernel for Ask<'_, T> {
    type Output = Answers;
    #[inline(always)]
    fn run(self) -> Answers {
        let Self { tier, node, block, lane, tfar } = self;
        let mut stack = Stack::new();
        tier.push_ordered(node, lane, tfar, &mut stack);
        let ordered = drain(&mut stack);
        tier.push_any(node, lane, tfar, &mut stack);
        let any = drain(&mut stack);
        let overlaps = tier.overlaps(node, lane, tfar);
        Answers { ordered, any, overlaps, candidates: tier.candidates(block, lane, tfar) }
    }
}

/// All entries of a stack, the first pushed first.
fn drain(stack: &mut Stack) -> Vec<(Child, f32)> {
    let mut entries: Vec<_> = std::iter::from_fn(|| stack.pop()).collect();
    entries.reverse();
    entries
}

struct AskBundle<'a, T> {
    tier: T,
    block: &'a Block,
    query: &'a Query,
    active: &'a Mask,
    axes: [usize; 3],
}

impl<T: Tier> Kernel for AskBundle<'_, T> {
    type Output = u32;
    #[inline(always)]
    fn run(self) -> u32 {
        let bundle: Bundle = self.query.bundle(self.tier, self.active, self.axes);
        self.tier.overlapping(self.block, &bundle)
    }
}

struct AskLeast<'a, T> {
    tier: T,
    values: &'a [f32; WIDTH],
}

impl<T: Tier> Kernel for AskLeast<'_, T> {
    type Output = f32;
    #[inline(always)]
    fn run(self) -> f32 {
        self.tier.least(self.values)
    }
}

/// What each tier of this machine answers, by name; the first is the portable one.
macro_rules! every_tier {
    ($tier:ident => $ask:expr) => {{
        let mut answers = Vec::new();
        {
            let $tier = portable::Portable;
            answers.push((Isa::Portable, dispatch(Isa::Portable, $ask)));
        }
        #[cfg(target_arch = "x86_64")]
        if let Some($tier) = avx2::Avx2::new() {
            answers.push((Isa::Avx2, dispatch(Isa::Avx2, $ask)));
        }
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        if let Some($tier) = avx512::Avx512::new() {
            answers.push((Isa::Avx512, dispatch(Isa::Avx512, $ask)));
        }
        assert_eq!(answers.len(), Isa::available().count());
        answers
    }};
}

/// Where the ray's line enters a child's box, in f64; none if it misses it or does so after `tfar`.
fn entry(node: &Node, i: usize, rays: &Rays, ray: usize, tfar: f64) -> Option<f64> {
    let (mut near, mut far) = (f64::from(rays.tnear[ray]), tfar);
    for axis in 0..3 {
        let (o, d) = (f64::from(rays.org[axis][ray]), f64::from(rays.dir[axis][ray]));
        let (lower, upper) =
            (f64::from(node.planes[axis][i]), f64::from(node.planes[axis + 3][i]));
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

/// A node, a leaf and rays, one case after the other.
fn cases(n: usize, mut look: impl FnMut(&mut Random, &Node, &Block, &Rays, &Query)) {
    let mut random = Random(7);
    for _ in 0..n {
        let points = points(&mut random);
        let (node, block) = (node(&mut random, &points), block(&mut random, &points));
        let rays = rays(&mut random, &points);
        let query = Query::new(&rays, &around(&points));
        look(&mut random, &node, &block, &rays, &query);
    }
}

#[test]
fn no_tier_misses_a_box_and_all_keep_the_order() {
    let (mut met, mut missed) = (0, 0);
    cases(600, |_, node, block, rays, query| {
        for i in 0..LANES {
            let (lane, scale) = (&query.lane(i), f64::from(query.scale[i]));
            let tfar = query.tfar[i];
            for (isa, answers) in every_tier!(tier => Ask { tier, node, block, lane, tfar }) {
                let order = (0..WIDTH).map(|j| node.ordered(lane.octant, j));
                let places: Vec<usize> = order
                    .enumerate()
                    .filter(|(j, _)| (answers.overlaps >> j) & 1 != 0)
                    .map(|(_, child)| child)
                    .collect();
                let pushed: Vec<usize> = answers.ordered.iter().map(|(c, _)| c.0 as usize).collect();
                let pushed: Vec<usize> =
                    pushed.iter().map(|c| c & Child::MAX_INDEX).collect();
                assert_eq!(pushed, places, "{isa}: {answers:?}");
                let sorted = |entries: &[(Child, f32)]| {
                    let mut entries: Vec<_> =
                        entries.iter().map(|(c, d)| (c.0, d.to_bits())).collect();
                    entries.sort_unstable();
                    entries
                };
                assert_eq!(sorted(&answers.ordered), sorted(&answers.any), "{isa}");
                for child in 0..WIDTH {
                    let distance = answers.ordered.iter().find(|e| e.0 == node.children[child]);
                    match entry(node, child, rays, i, f64::from(rays.tfar[i])) {
                        Some(exact) => {
                            let distance = distance.unwrap_or_else(|| panic!("{isa}: {child}"));
                            assert!(f64::from(distance.1) <= exact * scale, "{isa}");
                            met += 1;
                        }
                        None => missed += usize::from(distance.is_none()),
                    }
                }
            }
        }
    });
    assert!(met > 1000 && missed > 1000, "{met} {missed}");
}

#[test]
fn candidates_miss_nothing_and_are_sure_of_hits_only() {
    let (mut hits, mut sure, mut ruled_out) = (0, 0, 0);
    cases(1500, |random, node, block, rays, query| {
        for i in 0..LANES {
            let lane = &query.lane(i);
            let ray = Ray64::new(rays, i, lane.axes[2]);
            let met: Vec<Option<f64>> = (0..WIDTH)
                .map(|slot| {
                    let seen = Sheared::new(lane, block, slot);
                    let present = (block.present >> slot) & 1 != 0;
                    (present && seen.inside()).then(|| seen.t(&ray, block.triangle(slot)))
                })
                .collect();
            // The end of the segment, or a hit: one of the same distance is a candidate still.
            let end = met[random.below(WIDTH)].filter(|t| *t >= 0.0);
            let tfar = end.map_or(query.tfar[i], |t| t as f32 * query.scale[i]);
            let end = end.unwrap_or(ray.tfar);
            for (isa, answers) in every_tier!(tier => Ask { tier, node, block, lane, tfar }) {
                let Candidates { maybe, sure: certain } = answers.candidates;
                assert_eq!(certain & !maybe, 0, "{isa}");
                assert_eq!(maybe & !u32::from(block.present), 0, "{isa}");
                for slot in 0..WIDTH {
                    let bit = 1 << slot;
                    let hit = met[slot].is_some_and(|t| t > 0.0 && t <= end);
                    assert!(!hit || maybe & bit != 0, "{isa}: {slot} {block:?} {answers:?}");
                    assert!(certain & bit == 0 || met[slot].is_some(), "{isa}: {slot} {block:?}");
                    hits += u32::from(hit);
                    sure += u32::from(certain & bit != 0);
                    ruled_out += u32::from(maybe & bit == 0);
                }
            }
        }
    });
    assert!(hits > 1000 && sure > 1000 && ruled_out > 1000, "{hits} {sure} {ruled_out}");
}

#[test]
fn a_bundle_drops_no_triangle_that_any_of_its_rays_meets() {
    let (mut met, mut dropped) = (0, 0);
    cases(1500, |random, _, block, rays, query| {
        let axes = query.lane(random.below(LANES)).axes;
        let few = random.below(2) == 0;
        let active = &Mask(std::array::from_fn(|i| {
            -i32::from(query.lane(i).axes == axes && (!few || random.below(4) == 0))
        }));
        if !active.any() {
            return;
        }
        for (isa, found) in every_tier!(tier => AskBundle { tier, block, query, active, axes }) {
            for slot in (0..WIDTH).filter(|slot| (block.present >> slot) & 1 != 0) {
                let hit = (0..LANES).any(|i| {
                    active.0[i] != 0 && Sheared::new(&query.lane(i), block, slot).inside()
                });
                let kept = (found >> slot) & 1 != 0;
                assert!(kept || !hit, "{isa}: {slot} {block:?} {rays:?} {active:?}");
                (met, dropped) = (met + usize::from(hit), dropped + usize::from(!kept));
            }
            assert_eq!(found & !u32::from(block.present), 0, "{isa}");
        }
    });
    assert!(met > 1000 && dropped > 100, "{met} {dropped}");
}

#[test]
fn the_least_of_16_numbers_is_found_in_every_place() {
    let mut random = Random(3);
    for place in 0..WIDTH {
        for least in [-2.0, f32::NEG_INFINITY] {
            let mut values: [f32; WIDTH] = std::array::from_fn(|_| random.unit());
            values[(place + 3) % WIDTH] = f32::INFINITY;
            values[place] = least;
            let values = &values;
            for (isa, found) in every_tier!(tier => AskLeast { tier, values }) {
                assert_eq!(found, least, "{isa}: {place}");
            }
        }
    }
}

// -----------------------------------------------------------------------------------------------
// Whole traversals

/// An icosahedron whose faces were split in four `levels` times, with vertices on a sphere.
fn icosphere(levels: usize) -> TriangleMesh {
    let g = 0.5 + 1.25f32.sqrt();
    let mut vertices = Vec::new();
    for (a, b) in [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)] {
        vertices.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    // Faces: three vertices at the distance of an edge, 2, from each other.
    let apart = |a: [f32; 3], b: [f32; 3]| {
        let [x, y, z] = [0, 1, 2].map(|k| a[k] - b[k]);
        x * x + y * y + z * z
    };
    let mut faces = Vec::new();
    for a in 0..12 {
        for b in 0..a {
            for c in 0..b {
                let [p, q, r] = [a, b, c].map(|i| vertices[i]);
                if apart(p, q) < 4.1 && apart(q, r) < 4.1 && apart(r, p) < 4.1 {
                    faces.push([a as u32, b as u32, c as u32]);
                }
            }
        }
    }
    assert_eq!(faces.len(), 20);
    for _ in 0..levels {
        let mut middles = std::collections::HashMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in faces {
            let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(a, b)| {
                *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let (p, q) = (vertices[a as usize], vertices[b as usize]);
                    vertices.push(std::array::from_fn(|k| 0.5 * (p[k] + q[k])));
                    vertices.len() as u32 - 1
                })
            });
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        faces = finer;
    }
    for v in &mut vertices {
        let length = apart(*v, [0.0; 3]).sqrt();
        *v = v.map(|x| x / length);
    }
    TriangleMesh::new(vertices, faces, false)
}

/// Random triangles, some alike, two quads and some spheres.
fn soup() -> Geometry {
    let mut random = Random(11);
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..3000u32 {
        let center = random.point();
        for _ in 0..3 {
            let away = random.point();
            vertices.push([0, 1, 2].map(|k| center[k] + 0.1 * away[k]));
        }
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
        if i % 5 == 0 {
            triangles.push([3 * i + 1, 3 * i, 3 * i + 2]);
        }
    }
    let mesh = TriangleMesh::new(vertices, triangles, false);
    let quad = |z: f32| [[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]];
    let spheres = (0..50)
        .map(|_| Sphere { center: random.point().map(f64::from).into(), radius: 0.05 })
        .collect();
    Geometry::new(glam::DVec3::ZERO, vec![mesh], vec![quad(-0.9), quad(0.8)], spheres).unwrap()
}

/// The hits of a tree of every tier.
fn hits(geometry: &Geometry, packets: &[RayPacket], how: Coherence) -> Vec<(Isa, Vec<RayPacket>)> {
    Isa::available()
        .map(|isa| {
            let options = BuildOptions { threads: 1, fast: false, isa, max_bytes: None };
            let bvh = Bvh::build(geometry, &options, &Monitor::default()).unwrap();
            let mut packets = packets.to_vec();
            for packet in &mut packets {
                let mut shadow = packet.rays.clone();
                bvh.closest(&ALL, packet, how);
                bvh.occluded(&ALL, &mut shadow, how);
                let hit = packet.hit(&ALL);
                for i in 0..LANES {
                    let stopped = shadow.tfar[i] == f32::NEG_INFINITY;
                    assert_eq!(stopped, hit.0[i] != 0, "{isa}: {i} {packet:?}");
                }
            }
            (isa, packets)
        })
        .collect()
}

/// Everything of a packet's hits, as bits.
fn bits(packet: &RayPacket) -> [[u32; LANES]; 5] {
    let (rays, hits) = (&packet.rays, &packet.hits);
    [rays.tfar.map(f32::to_bits), hits.geom, hits.prim, hits.u.map(f32::to_bits), hits.v.map(f32::to_bits)]
}

/// Rays from near `from` to all over the scene, or all to near one place.
fn scattered(random: &mut Random, together: bool) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    let (from, to) = (random.point(), random.point());
    for i in 0..LANES {
        let (shift, other) = (random.point(), random.point());
        for axis in 0..3 {
            let target = if together { to[axis] + 0.05 * shift[axis] } else { other[axis] };
            packet.rays.org[axis][i] = 2.0 * from[axis];
            packet.rays.dir[axis][i] = target - 2.0 * from[axis];
        }
    }
    packet
}

/// Rays from the middle of a mesh through its vertices and the middles of its edges.
fn from_within(mesh: &TriangleMesh) -> Vec<RayPacket> {
    let mut targets = mesh.vertices().to_vec();
    for t in mesh.triangles() {
        let [a, b, _] = t.map(|i| mesh.vertices()[i as usize]);
        targets.push([0, 1, 2].map(|k| 0.5 * (a[k] + b[k])));
    }
    let mut random = Random(5);
    let packet = |targets: &[[f32; 3]]| {
        let mut packet = RayPacket::EMPTY;
        let from = random.point().map(|x| 0.3 * x);
        for i in 0..LANES {
            for axis in 0..3 {
                packet.rays.org[axis][i] = from[axis];
                packet.rays.dir[axis][i] = targets[i % targets.len()][axis] - from[axis];
            }
        }
        packet
    };
    targets.chunks(LANES).map(packet).collect()
}

#[test]
fn every_tier_finds_the_same_hits_of_single_rays() {
    let mut random = Random(1);
    let packets: Vec<_> = (0..600).map(|i| scattered(&mut random, i % 2 == 0)).collect();
    let found = hits(&soup(), &packets, Coherence::Single);
    let (_, expected) = &found[0];
    let count: u32 = expected.iter().map(|packet| packet.hit(&ALL).count()).sum();
    assert!(count > 1000);
    for (isa, found) in &found {
        for (a, b) in found.iter().zip(expected) {
            assert_eq!(bits(a), bits(b), "{isa}");
        }
    }
}

#[test]
fn a_closed_mesh_has_no_gap_in_any_tier() {
    let mesh = icosphere(4);
    let packets = from_within(&mesh);
    let geometry = Geometry::new(glam::DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
    for how in [Coherence::Single, Coherence::Coherent] {
        let found = hits(&geometry, &packets, how);
        for (isa, packets) in &found {
            for (packet, expected) in packets.iter().zip(&found[0].1) {
                assert!(packet.hits.geom.iter().all(|&geom| geom != NONE), "{isa}");
                assert_eq!(bits(packet)[..3], bits(expected)[..3], "{isa}");
            }
        }
    }
}

#[test]
fn packets_find_what_single_rays_find() {
    let mut random = Random(2);
    let packets: Vec<_> = (0..600).map(|_| scattered(&mut random, true)).collect();
    let geometry = soup();
    let single = hits(&geometry, &packets, Coherence::Single);
    let together = hits(&geometry, &packets, Coherence::Coherent);
    for ((isa, single), (_, together)) in single.iter().zip(&together) {
        for (a, b) in single.iter().zip(together) {
            assert_eq!(bits(a)[..3], bits(b)[..3], "{isa}");
            for i in 0..LANES {
                // Weights are of f32 edge functions in packets: off by 1e-6 or so of the distance
                // over the size of the triangle.
                let off = (a.hits.u[i] - b.hits.u[i]).abs() + (a.hits.v[i] - b.hits.v[i]).abs();
                assert!(off < 1e-2, "{isa}: {off}");
            }
        }
    }
}
