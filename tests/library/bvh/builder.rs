//! Trees over every number and kind of primitives, and over sets that are hard to split.

use std::sync::atomic::Ordering::Relaxed;

use glam::DVec3;
use lightpath::accel::bvh::{Bvh, TreeStats};
use lightpath::accel::{self, Accelerator, BuildOptions};
use lightpath::error::ErrorKind;
use lightpath::geometry::{Geometry, Sphere, TriangleMesh};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Rays};
use lightpath::scene::Backend;
use lightpath::simd::Isa;

use super::reference;
use super::tiers::{ALL, OPTIONS, Tiers, build, put, ray};
use crate::support::random::Random;

const NUMBERS: [usize; 14] = [0, 1, 2, 3, 4, 5, 15, 16, 17, 31, 32, 33, 256, 257];

fn geometry(
    triangles: &[[[f32; 3]; 3]],
    quads: Vec<[[f32; 3]; 4]>,
    spheres: Vec<Sphere>,
) -> Geometry {
    let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriangleMesh::new(triangles.as_flattened().to_vec(), indices, false);
    Geometry::new(DVec3::ZERO, vec![mesh], quads, spheres).expect("few enough")
}

fn random_point(random: &mut Random) -> [f32; 3] {
    [0; 3].map(|_| random.within(-10.0, 10.0) as f32)
}

/// Returns a geometry with this many primitives of each kind.
fn some(random: &mut Random, triangles: usize, quads: usize, spheres: usize) -> Geometry {
    let near = |random: &mut Random, p: [f32; 3]| p.map(|x| x + random.within(-1.0, 1.0) as f32);
    let triangles: Vec<_> = (0..triangles)
        .map(|_| {
            let p = random_point(random);
            [p, near(random, p), near(random, p)]
        })
        .collect();
    let quads = (0..quads)
        .map(|_| {
            let p = random_point(random);
            let [a, b] = [near(random, p), near(random, p)];
            [p, a, [0, 1, 2].map(|k| a[k] + b[k] - p[k]), b]
        })
        .collect();
    let spheres = (0..spheres)
        .map(|_| Sphere {
            center: DVec3::from(random_point(random).map(f64::from)),
            radius: random.within(0.01, 1.0),
        })
        .collect();
    geometry(&triangles, quads, spheres)
}

/// Traces rays through points of a scene and compares with the reference. Returns the number of
/// hits.
fn trace(random: &mut Random, geometry: &Geometry, packets: usize, size: f64) -> usize {
    let tiers = Tiers::new(geometry);
    let mut hits = 0;
    for _ in 0..packets {
        let mut rays = Rays::EMPTY;
        for i in 0..LANES {
            let corner = |random: &mut Random| match geometry.meshes[0].vertices() {
                [] => random_point(random),
                vertices => vertices[random.below(vertices.len())],
            };
            let (a, b, c) = (corner(random), corner(random), corner(random));
            let origin = [0; 3].map(|_| (size * random.within(-1.0, 1.0)) as f32);
            let direction = match random.below(3) {
                0 => [0, 1, 2].map(|k| a[k] - origin[k]),
                1 => [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0 - origin[k]),
                _ => [0; 3].map(|_| random.within(-1.0, 1.0) as f32),
            };
            put(&mut rays, i, origin, direction);
        }
        let active = rays.possible(&ALL);
        let found = tiers.trace(&active, &rays);
        for i in (0..LANES).filter(|&i| active.0[i] != 0) {
            hits += usize::from(found[i].is_some());
            if let Err(wrong) = reference::check(geometry, &rays, i, found[i]) {
                panic!("{}: {wrong}", ray(&rays, i));
            }
        }
    }
    hits
}

#[test]
fn every_number_of_every_kind_is_built_and_found() {
    let mut random = Random(3);
    for n in NUMBERS {
        for (triangles, quads, spheres) in
            [(n, 0, 0), (0, n, 0), (0, 0, n), (n, n, 0), (n, 0, n), (0, n, n), (n, n, n), (n, 1, 1)]
        {
            let geometry = some(&mut random, triangles, quads, spheres);
            let stats = build(&geometry, Isa::detect()).validate().expect("a sound tree");
            assert_eq!((stats.triangles, stats.spheres), (triangles + 2 * quads, spheres));
            trace(&mut random, &geometry, 4, 12.0);
        }
    }
}

#[test]
fn a_million_copies_of_one_triangle() {
    let corners = vec![[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
    let mesh = TriangleMesh::new(corners, vec![[0, 1, 2]; 1_000_000], false);
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few enough");
    let isa = Isa::detect();
    let bvh = Bvh::build(&geometry, isa, &OPTIONS, &Monitor::default()).expect("a tree");
    let stats = bvh.validate().expect("a sound tree");
    assert_eq!((stats.triangles, stats.triangles_per_leaf() > 14.0), (1_000_000, true), "{stats}");
    let mut rays = Rays::EMPTY;
    put(&mut rays, 0, [0.25, 0.25, 0.0], [0.0, 0.0, 2.0]);
    put(&mut rays, 1, [0.75, 0.75, 0.0], [0.0, 0.0, 2.0]);
    let mut active = ALL;
    active.0[2..].fill(0);
    let found = Tiers::of(&geometry, isa, bvh).trace(&active, &rays);
    // All are at the same distance, so the lowest number wins.
    assert_eq!(found[0].map(|hit| (hit.primitive, hit.t)), Some((0, 0.5)));
    assert_eq!(found[1], None);
}

#[test]
fn centroids_that_are_all_equal() {
    let mut random = Random(4);
    let triangles: Vec<_> = (0..500)
        .map(|i| {
            // Boxes symmetric around the origin.
            let size = 1.0 + i as f32;
            [[-size, -size, 0.0], [size, -size, 0.0], [0.0, size, 0.0]]
        })
        .collect();
    let spheres = (0..50).map(|i| Sphere { center: DVec3::ZERO, radius: 0.5 + f64::from(i) });
    let geometry = geometry(&triangles, vec![], spheres.collect());
    assert!(trace(&mut random, &geometry, 60, 300.0) > 300);
}

#[test]
fn needles_and_plates() {
    let mut random = Random(5);
    for extents in [[1e6, 1e-6, 1e-6], [1e5, 1e5, 1e-5], [1e-3, 1e7, 1.0], [1e6, 0.0, 0.0]] {
        let triangles: Vec<_> = (0..300)
            .map(|_| {
                let base = random_point(&mut random);
                [0; 3].map(|_: u32| {
                    [0, 1, 2].map(|k| base[k] + (random.within(-1.0, 1.0) * extents[k]) as f32)
                })
            })
            .collect();
        trace(&mut random, &geometry(&triangles, vec![], vec![]), 60, 20.0);
    }
}

/// Triangles and spheres of sizes 2^k, each around all smaller ones or beside them.
fn chain(nested: bool) -> Geometry {
    let sizes = (-60..=60).map(|k| f64::from(k).exp2());
    let start = |size: f64| if nested { -size * 0.25 } else { size };
    let triangles: Vec<_> = sizes
        .clone()
        .map(|size| {
            let [p, q] = [start(size) as f32, (start(size) + size) as f32];
            [[p, p, p], [q, p, q], [p, q, q]]
        })
        .collect();
    let spheres = sizes.map(|size| Sphere {
        center: DVec3::new(-start(size), start(size), 0.0),
        radius: size * 0.25,
    });
    geometry(&triangles, vec![], spheres.collect())
}

#[test]
fn chains_of_sizes_that_double() {
    let mut random = Random(6);
    for nested in [false, true] {
        let geometry = chain(nested);
        let hits: usize = (-60..=60)
            .step_by(10)
            .map(|k| trace(&mut random, &geometry, 20, f64::from(k).exp2()))
            .sum();
        assert!(hits > 500, "{hits}");
    }
}

#[test]
fn a_chain_makes_a_tree_that_is_deep_for_its_size() {
    // Each of 240 triangles lies in a box half as large as the next one's. The large ones are split
    // off, level by level.
    let triangles: Vec<_> = (-120..120)
        .map(|k| {
            let size = f32::powi(2.0, k);
            [[0.0, 0.0, 0.0], [size, 0.0, size], [0.0, size, size]]
        })
        .collect();
    let geometry = geometry(&triangles, vec![], vec![]);
    let stats = build(&geometry, Isa::detect()).validate().expect("a sound tree");
    assert!(stats.depth >= 6, "{stats}");
    assert!(trace(&mut Random(12), &geometry, 60, 1.0) > 300);
}

#[test]
fn a_build_that_would_not_fit_is_refused() {
    let geometry = some(&mut Random(13), 100_000, 0, 0);
    let little = BuildOptions { max_bytes: Some(100_000), ..OPTIONS };
    let refused =
        Bvh::build(&geometry, Isa::detect(), &little, &Monitor::default()).err().map(|e| e.kind);
    assert_eq!(refused, Some(ErrorKind::Limit));
    let enough = BuildOptions { max_bytes: Some(100_000_000), ..little };
    assert!(Bvh::build(&geometry, Isa::detect(), &enough, &Monitor::default()).is_ok());
}

#[test]
fn coordinates_that_are_tiny_or_huge() {
    let mut random = Random(7);
    for scale in [1e-25f32, 1e-12, 1e12, 1e18] {
        let triangles: Vec<_> = (0..200)
            .map(|_| {
                let base = random_point(&mut random).map(|x| x / 10.0);
                [0; 3].map(|_: u32| base.map(|x| (x + random.within(-0.3, 0.3) as f32) * scale))
            })
            .collect();
        let spheres = (0..20)
            .map(|_| Sphere {
                center: DVec3::from(random_point(&mut random).map(f64::from))
                    * 0.1
                    * f64::from(scale),
                radius: f64::from(scale) * random.within(0.01, 0.1),
            })
            .collect();
        let geometry = geometry(&triangles, vec![], spheres);
        let hits = trace(&mut random, &geometry, 100, f64::from(scale));
        assert!(hits > 800, "{scale}: {hits}");
    }
}

#[test]
fn a_signal_stops_the_build() {
    let geometry = some(&mut Random(8), 1000, 0, 0);
    let monitor = Monitor::default();
    monitor.signal.store(15, Relaxed);
    let stopped = Bvh::build(&geometry, Isa::detect(), &OPTIONS, &monitor).err().map(|e| e.kind);
    assert_eq!(stopped, Some(ErrorKind::Interrupted(15)));
    let monitor = Monitor::default();
    monitor.signal.store(2, Relaxed);
    let stopped = accel::build(&geometry, Backend::default(), &OPTIONS, &monitor);
    assert_eq!(stopped.err().map(|e| e.kind), Some(ErrorKind::Interrupted(2)));
}

#[test]
fn stats_are_those_of_the_tree() {
    let geometry = some(&mut Random(9), 1000, 10, 30);
    let bvh = build(&geometry, Isa::detect());
    let stats: TreeStats = bvh.validate().expect("a sound tree");
    assert_eq!(stats.nodes_of.iter().sum::<usize>(), stats.nodes);
    assert_eq!(stats.leaves_of.iter().sum::<usize>(), stats.leaves);
    let children: usize = stats.nodes_of.iter().enumerate().map(|(n, count)| n * count).sum();
    assert_eq!(children, stats.nodes - 1 + stats.leaves + stats.sphere_leaves);
    let bytes = stats.nodes * 512 + stats.leaves * 256 + stats.sphere_leaves * 16;
    assert_eq!(bvh.info().bytes, bytes as u64);
}

#[test]
fn visits_are_counted() {
    let geometry = some(&mut Random(10), 0, 1, 0);
    let bvh = build(&geometry, Isa::detect());
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        put(&mut rays, i, [0.0, 0.0, 100.0], [0.0, 0.0, 1.0]);
    }
    let nothing = bvh.visits(&ALL, &rays, false, Coherence::Single).expect("a count");
    // Each ray visits the root and misses its only child.
    assert_eq!((nothing.nodes, nothing.primitives), (16, 0));
    let [a, _, c, _] = geometry.quads[0];
    let middle = [0, 1, 2].map(|k| (a[k] + c[k]) / 2.0);
    for i in 0..LANES {
        put(&mut rays, i, [0.0, 0.0, 100.0], [middle[0], middle[1], middle[2] - 100.0]);
    }
    for shadow in [false, true] {
        let single = bvh.visits(&ALL, &rays, shadow, Coherence::Single).expect("a count");
        assert_eq!((single.nodes, single.primitives), (16, 32));
        // A packet visits each once.
        let packet = bvh.visits(&ALL, &rays, shadow, Coherence::Coherent).expect("a count");
        assert_eq!((packet.nodes, packet.primitives), (1, 2));
    }
    let geometry = some(&mut Random(11), 0, 0, 3);
    let bvh = build(&geometry, Isa::detect());
    let center = geometry.spheres[0].center.as_vec3().to_array();
    for i in 0..LANES {
        put(&mut rays, i, center, [1.0, 0.0, 0.0]);
    }
    let spheres = bvh.visits(&ALL, &rays, false, Coherence::Single).expect("a count");
    assert_eq!((spheres.nodes, spheres.primitives), (16, 48));
}
