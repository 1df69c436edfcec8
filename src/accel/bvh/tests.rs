//! The builder makes the same tree for any number of threads and in every instruction set, also of
//! unusual scenes. `validate` detects every kind of damage.

use glam::DVec3;

use super::Bvh;
use super::build::Tree;
use super::node::{Child, ChildKind, Node};
use crate::accel::BuildOptions;
use crate::geometry::{Geometry, Sphere, TriangleMesh};
use crate::monitor::Monitor;
use crate::ray::NONE;
use crate::simd::Isa;

/// Returns a bumpy square of `2 rows^2` triangles, `others` quads above it and `others` spheres
/// below it. A tree counts a quad as two triangles.
fn scene(rows: u32, others: u32) -> Geometry {
    let at = |row: u32, column: u32| {
        let height = (row * 7 + column * 13) % 11;
        [row as f32, column as f32, height as f32 * 0.1]
    };
    let vertices = (0..=rows).flat_map(|r| (0..=rows).map(move |c| at(r, c))).collect();
    let index = |row: u32, column: u32| row * (rows + 1) + column;
    let triangles = (0..rows)
        .flat_map(|r| (0..rows).map(move |c| (r, c)))
        .flat_map(|(r, c)| {
            let [a, b] = [index(r, c), index(r, c + 1)];
            let [d, e] = [index(r + 1, c), index(r + 1, c + 1)];
            [[a, b, d], [e, d, b]]
        })
        .collect();
    let quads = (0..others).map(|i| {
        let (x, y) = (i as f32 * 0.7, (i * i % 17) as f32);
        [[x, y, 5.0], [x + 0.5, y, 5.0], [x + 0.5, y + 0.5, 5.0], [x, y + 0.5, 5.0]]
    });
    let spheres = (0..others).map(|i| Sphere {
        center: DVec3::new(f64::from(i) * 0.9, f64::from(i * i % 13), -4.0),
        radius: 0.3,
    });
    let mesh = TriangleMesh::new(vertices, triangles, false);
    Geometry::new(DVec3::ZERO, vec![mesh], quads.collect(), spheres.collect()).expect("few")
}

fn build(geometry: &Geometry, isa: Isa, threads: usize) -> Bvh<'_> {
    let options = BuildOptions { threads, max_bytes: None };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(|| Bvh::build(geometry, isa, &options, &Monitor::default())).expect("a tree")
}

/// Neighbours in space whose indices differ by 70,000. Offsets in a leaf have 16 bits, so leaves of
/// such triangles hold whole indices, in `tree.wide`. All triangles beside the strip are equal.
#[test]
fn leaves_of_distant_indices_are_wide() {
    let (far, strip) = (70_000u32, 64);
    let vertices = (0..=strip).flat_map(|x| [[x as f32, 0.0, 0.0], [x as f32, 1.0, 0.0]]);
    let mut vertices: Vec<[f32; 3]> = vertices.collect();
    let faraway = vertices.len() as u32;
    vertices.extend([[1e3, 0.0, 0.0], [1e3, 1.0, 0.0], [1e3, 0.0, 1.0]]);
    let triangle = |i: u32| match (i / far, i % far) {
        (half, x) if x < strip => [0, 1, 2].map(|k| 2 * x + half + k),
        _ => [0, 1, 2].map(|k| faraway + k),
    };
    let mesh = TriangleMesh::new(vertices, (0..2 * far).map(triangle).collect(), false);
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
    let bvh = build(&geometry, Isa::detect(), 2);
    assert_eq!(bvh.validate().map(|stats| stats.triangles), Ok(2 * far as usize));
    assert!(!bvh.tree.wide.is_empty() && bvh.tree.wide.len() < 100);
}

/// Returns every bit of a tree that a query reads from its nodes and leaves.
fn bits(tree: &Tree) -> Vec<u64> {
    let mut bits = Vec::new();
    for node in &tree.nodes {
        bits.extend(node.planes.as_flattened().iter().map(|x| u64::from(x.to_bits())));
        bits.extend(node.children.map(|child| u64::from(child.0)));
        bits.extend(node.order);
    }
    for block in &tree.blocks {
        bits.extend(block.vertices.as_flattened().iter().map(|x| u64::from(x.to_bits())));
        bits.extend(block.offsets.map(u64::from));
        bits.extend([block.base, block.second_halves.into()].map(u64::from));
        bits.extend(block.corners.as_flattened().iter().map(|&corner| u64::from(corner)));
        bits.push(block.present.into());
    }
    bits.extend(tree.wide.iter().flatten().map(|&bits| u64::from(bits)));
    bits.extend(tree.spheres.iter().flat_map(|leaf| leaf.0.map(u64::from)));
    bits
}

#[test]
fn threads_and_tiers_build_the_same_tree() {
    // Large enough for all that the builder does in parallel: the bins of one split, subtrees, and
    // the collapse of the binary tree into nodes of eight children.
    let geometry = scene(91, 40);
    let one = build(&geometry, Isa::Portable, 1);
    let stats = one.validate().expect("a sound tree");
    assert_eq!((stats.triangles, stats.spheres), (16_642, 40));
    let expected = bits(&one.tree);
    for (isa, threads) in Isa::available().zip([3, 2, 7]) {
        let found = bits(&build(&geometry, isa, threads).tree);
        assert!(found == expected, "{isa}, {threads} threads");
    }
}

/// Returns a [`scene`] of 16,580 triangles whose mesh has vertices that no triangle uses. `scale`
/// is that of the mesh.
fn with_unused(unused: &[[f32; 3]], scale: f32) -> Geometry {
    let mut geometry = scene(91, 9);
    let mesh = std::mem::take(&mut geometry.meshes[0]);
    let used = mesh.vertices().iter().map(|v| v.map(|x| x * scale));
    let vertices = used.chain(unused.iter().copied()).collect();
    geometry.meshes[0] = TriangleMesh::new(vertices, mesh.triangles().to_vec(), false);
    geometry
}

#[test]
fn unused_vertices_and_crowded_cells_do_not_change_what_is_in_the_tree() {
    let unused = [[f32::NAN, 0.0, 0.0], [f32::INFINITY; 3], [-1e38; 3]];
    // In the last case the unused vertex is so far away that nearly all triangles lie in one cell
    // of the builder's grid.
    for (unused, scale) in [(&unused[..], 1.0), (&[[1e6; 3]], 1e-3)] {
        let geometry = with_unused(unused, scale);
        let one = build(&geometry, Isa::Portable, 1);
        let stats = one.validate().expect("a sound tree");
        assert_eq!((stats.triangles, stats.spheres), (16_580, 9));
        assert!(bits(&build(&geometry, Isa::detect(), 3).tree) == bits(&one.tree));
    }
}

#[test]
fn sums_of_huge_areas_stay_in_range() {
    let mut seed = 1u64;
    let mut random = move || {
        seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((seed >> 40) as f32 / (1 << 23) as f32 - 1.0) * 1e18
    };
    let vertices = (0..9000).map(|_| [random(), random(), random()]).collect();
    let triangles = (0..3000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriangleMesh::new(vertices, triangles, false);
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
    let stats = build(&geometry, Isa::Portable, 2).validate().expect("a sound tree");
    assert_eq!(stats.triangles, 3000);
}

#[test]
fn an_empty_scene_becomes_an_empty_root() {
    let geometry = scene(0, 0);
    let stats = build(&geometry, Isa::Portable, 1).validate().expect("a sound tree");
    assert_eq!((stats.nodes, stats.depth, stats.leaves, stats.nodes_of[0]), (1, 1, 0, 1));
}

/// Returns slot and index of the first inner node below the root.
fn inner(tree: &Tree) -> (usize, usize) {
    let kinds = tree.nodes[0].children.iter().enumerate();
    kinds
        .filter_map(|(slot, child)| match child.kind() {
            ChildKind::Node(index) => Some((slot, index)),
            _ => None,
        })
        .next()
        .expect("an inner node below the root")
}

#[test]
fn validate_detects_every_kind_of_damage() {
    type Damage = fn(&mut Tree);
    let damages: &[(&str, Damage)] = &[
        ("box of child", |t| {
            t.nodes[0].planes[0][1] = f32::from_bits(t.nodes[0].planes[0][1].to_bits() + 1)
        }),
        ("box of child", |t| t.nodes[0].planes[5][2] += 1.0),
        ("scene's box", |t| t.bounds.0[1] -= 1.0),
        ("from far to near", |t| t.nodes[0].order[3] = t.nodes[0].order[4]),
        ("is no permutation", |t| t.nodes[0].order[0] = 0),
        ("reached twice", |t| {
            let index = inner(t).1;
            t.nodes[index].children[0] = Child::node(0);
        }),
        ("has no children", |t| {
            let index = inner(t).1;
            t.nodes[index] = Node::EMPTY;
        }),
        ("follows an empty one", |t| t.nodes[0].children[1] = Child::EMPTY),
        ("has a plane at", |t| {
            let children = &mut t.nodes[0].children;
            *children.iter_mut().rfind(|child| **child != Child::EMPTY).expect("a child") =
                Child::EMPTY;
        }),
        ("does not exist", |t| {
            let slot = inner(t).0;
            t.nodes[0].children[slot] = Child::node(100_000);
        }),
        ("is not in the tree", |t| t.blocks[3].present &= !2),
        ("has no primitive indices", |t| t.blocks[3].base = super::node::WIDE),
        ("primitive", |t| t.blocks[0].corners[1][0] ^= 1),
        ("primitive", |t| t.blocks[0].vertices[2][0] += 1.0),
        ("second half: true", |t| {
            let of_mesh = t.blocks.iter_mut().find(|block| block.base < 3200);
            of_mesh.expect("a leaf of the mesh").second_halves |= 1;
        }),
        ("there is no primitive", |t| t.blocks[0].base = 1 << 20),
        ("is empty", |t| {
            t.blocks[0].present = 0;
        }),
        ("is in the tree twice", |t| t.spheres[0].0[0] = t.spheres[1].0[0]),
        ("there is no sphere", |t| t.spheres[0].0[0] = 1000),
        ("sphere leaf 0: holds", |t| t.spheres[0].0 = [NONE; 4]),
        ("is not in the tree", |t| {
            // The spheres are equal, so the leaf's box is right without the last one.
            let last = t.spheres.len() - 1;
            let leaf = &mut t.spheres[last].0;
            *leaf.iter_mut().rfind(|id| **id != NONE).expect("a sphere") = NONE;
        }),
        ("recorded", |t| t.depth += 1),
        ("recorded", |t| {
            let copy = t.blocks[0].clone();
            t.blocks.push(copy);
        }),
    ];
    let mut geometry = scene(40, 9);
    let first = geometry.spheres[0];
    geometry.spheres.fill(first);
    for (wanted, damage) in damages {
        let mut bvh = build(&geometry, Isa::Portable, 1);
        assert_eq!(bvh.validate().map(|stats| stats.triangles), Ok(3218));
        damage(std::sync::Arc::get_mut(&mut bvh.tree).expect("the only owner"));
        let found = bvh.validate().expect_err(wanted);
        assert!(found.contains(wanted), "expected `{wanted}`, found `{found}`");
    }
}
