//! Compares the hits of every instruction set, of single rays and of packets on whole trees.

use std::collections::HashMap;
use std::sync::Arc;

use super::cases::Random;
use crate::accel::bvh::Bvh;
use crate::accel::{Accelerator, BuildOptions};
use crate::geometry::{Geometry, Sphere, TriangleMesh};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket};
use crate::simd::Isa;

/// Returns an icosahedron whose faces are split into four `levels` times, with all vertices on a
/// sphere.
fn icosphere(levels: usize) -> TriangleMesh {
    let g = 0.5 + 1.25f32.sqrt();
    let mut vertices = Vec::new();
    for (a, b) in [(1.0, g), (1.0, -g), (-1.0, g), (-1.0, -g)] {
        vertices.extend([[0.0, a, b], [a, b, 0.0], [b, 0.0, a]]);
    }
    // A face is three vertices at the distance of an edge, 2, from each other.
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
        let mut middles = HashMap::new();
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

/// Returns random triangles, some of them with the same vertices, two quads and some spheres.
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

/// Returns the hits of the tree of every instruction set. Checks that a ray is occluded exactly if
/// it has a hit.
fn hits(geometry: &Geometry, packets: &[RayPacket], how: Coherence) -> Vec<(Isa, Vec<RayPacket>)> {
    Isa::available()
        .map(|isa| {
            let options = BuildOptions { threads: 1, max_bytes: None };
            let bvh = Bvh::build(geometry, isa, &options, &Monitor::default()).unwrap();
            let mut packets = packets.to_vec();
            for packet in &mut packets {
                let mut shadow = packet.rays.clone();
                bvh.closest(&Mask::ALL, packet, how);
                bvh.occluded(&Mask::ALL, &mut shadow, how);
                let hit = packet.hit(&Mask::ALL);
                for i in 0..LANES {
                    let occluded = shadow.tfar[i] == f32::NEG_INFINITY;
                    assert_eq!(occluded, hit.0[i] != 0, "{isa}: {i} {packet:?}");
                }
            }
            (isa, packets)
        })
        .collect()
}

/// Returns all bits of the hits of a packet.
fn bits(packet: &RayPacket) -> [[u32; LANES]; 5] {
    let (rays, hits) = (&packet.rays, &packet.hits);
    [
        rays.tfar.map(f32::to_bits),
        hits.geom,
        hits.prim,
        hits.u.map(f32::to_bits),
        hits.v.map(f32::to_bits),
    ]
}

/// Returns rays from one origin: to targets all over the scene, or, if `together`, to targets near
/// one point.
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

/// Returns rays from inside a mesh through its vertices and the midpoints of its edges.
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
    let count: u32 = expected.iter().map(|packet| packet.hit(&Mask::ALL).count()).sum();
    assert!(count > 1000);
    for (isa, found) in &found {
        for (a, b) in found.iter().zip(expected) {
            assert_eq!(bits(a), bits(b), "{isa}");
        }
    }
}

#[test]
fn a_closed_mesh_has_no_gap_in_any_tier() {
    let mesh = icosphere(3);
    let packets = from_within(&mesh);
    let geometry = Geometry::new(glam::DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
    for how in [Coherence::Single, Coherence::Incoherent, Coherence::Coherent] {
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
                // In packets the weights come from edge functions in f32, where these tell them to
                // 1.5e-3.
                let off = (a.hits.u[i] - b.hits.u[i]).abs() + (a.hits.v[i] - b.hits.v[i]).abs();
                assert!(off < 1e-2, "{isa}: {off}");
            }
        }
    }
}

#[test]
fn rays_in_turns_find_what_they_find_alone() {
    let mut random = Random(4);
    let geometry = soup();
    for isa in Isa::available() {
        let options = BuildOptions { threads: 1, max_bytes: None };
        let mut bvh = Bvh::build(&geometry, isa, &options, &Monitor::default()).unwrap();
        // As in a large tree.
        Arc::get_mut(&mut bvh.tree).expect("the only reference").closest_in_turns = true;
        for round in 0..300u32 {
            let packet = scattered(&mut random, round % 2 == 0);
            // All numbers of rays from 0 to 16, then any rays.
            let bits_of_lanes = match round {
                ..=16 => (1 << round) - 1,
                _ => round.wrapping_mul(0x9E37_79B9) >> 16,
            };
            let active = Mask(std::array::from_fn(|i| -(((bits_of_lanes >> i) & 1) as i32)));
            let found = [Coherence::Single, Coherence::Unordered].map(|how| {
                let (mut closest, mut shadow) = (packet.clone(), packet.rays.clone());
                bvh.closest(&active, &mut closest, how);
                bvh.occluded(&active, &mut shadow, how);
                (bits(&closest), shadow.tfar.map(f32::to_bits))
            });
            assert_eq!(found[0], found[1], "{isa}: {bits_of_lanes:b}");
        }
    }
}
