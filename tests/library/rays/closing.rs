//! Which faces without area of a file close its mesh, in other places than one edge of a cube.

use lightpath::{Mesh, Monitor, RayBatch, RayScene};

use super::stitches::{CUBE, parse};

type Corner = [f64; 3];

/// A tetrahedron with a right angle. Coordinates are whole numbers, so points at sixteenths of
/// edges are exact.
const A: Corner = [0.0, 0.0, 0.0];
const B: Corner = [64.0, 32.0, 16.0];
const C: Corner = [-32.0, 64.0, 0.0];
const D: Corner = [-16.0, -32.0, 128.0];

/// The point of an edge at a sixteenth.
fn at(p: Corner, q: Corner, sixteenths: u32) -> Corner {
    [0, 1, 2].map(|k| p[k] + (q[k] - p[k]) * f64::from(sixteenths) / 16.0)
}

/// Reads triangles, moved. With `soup`, no two of them share a vertex.
fn mesh(triangles: &[[Corner; 3]], soup: bool, offset: Corner) -> Mesh {
    let mut vertices: Vec<Corner> = Vec::new();
    let vertex = |corner: &Corner| {
        let corner = [0, 1, 2].map(|k| corner[k] + offset[k]);
        let known = vertices.iter().position(|&v| v == corner).filter(|_| !soup);
        known.unwrap_or_else(|| {
            vertices.push(corner);
            vertices.len() - 1
        }) as u32
    };
    let corners: Vec<u32> = triangles.iter().flatten().map(vertex).collect();
    let faces: Vec<_> = corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    parse(&vertices, &faces)
}

/// Returns the number of stitches, and whether the mesh is closed. Checks that rays from outside
/// through points of `edges` cross a closed mesh an even number of times.
fn stitches(mesh: Mesh, edges: &[[Corner; 2]], offset: Corner) -> (usize, bool) {
    let monitor = Monitor::default();
    let stitches = mesh.stitches.len();
    let scene = RayScene::new(vec![Box::new(mesh)], &monitor).expect("a scene");
    let closed = scene.closed(&monitor).expect("answers")[0];
    let (mut origins, mut directions) = (Vec::new(), Vec::new());
    for (i, [p, q]) in edges.iter().enumerate() {
        for k in 0..64u32 {
            let turn = f64::from(k) * 2.399_963 + i as f64;
            let from = [500.0 * turn.cos(), 500.0 * turn.sin(), 300.0 * (1.7 * turn).sin()];
            let to = [0, 1, 2].map(|k| p[k] + (q[k] - p[k]) * (turn * 0.618).fract());
            origins.push([0, 1, 2].map(|k| from[k] + offset[k]));
            directions.push([0, 1, 2].map(|k| to[k] - from[k]));
        }
    }
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let counts = scene.count(&rays, &monitor).expect("counts");
    assert!(!closed || counts.iter().all(|count| count % 2 == 0), "{counts:?}");
    (stitches, closed)
}

/// Checks triangles as they are, as a soup, and far away from 0.
fn check(triangles: &[[Corner; 3]], expected: (usize, bool)) {
    for soup in [false, true] {
        for offset in [[0.0; 3], [4e5, 5.6e6, 100.0]] {
            let mesh = mesh(triangles, soup, offset);
            assert_eq!(stitches(mesh, &[[A, B]], offset), expected, "{soup} {offset:?}");
        }
    }
}

#[test]
fn t_junctions_of_an_edge_are_closed_from_both_sides() {
    let (p, q) = (at(A, B, 4), at(A, B, 12));
    let long = [[A, D, C], [B, C, D]];
    let one_side = [&long[..], &[[A, C, B], [A, p, D], [p, B, D]]].concat();
    check(&one_side, (0, false));
    check(&[&one_side[..], &[[A, B, p]]].concat(), (1, true));
    check(&[&one_side[..], &[[A, B, p], [p, A, B]]].concat(), (1, true));
    let both = [&long[..], &[[A, C, p], [p, C, B], [A, q, D], [q, B, D]]].concat();
    for pair in [[[A, p, q], [p, B, q]], [[A, p, B], [A, B, q]], [[A, p, B], [B, q, A]]] {
        check(&[&both[..], &pair].concat(), (2, true));
    }
    check(&[&both[..], &[[A, p, B]]].concat(), (1, false));
}

#[test]
fn faces_that_close_nothing_are_dropped() {
    let closed = [[A, C, B], [A, D, C], [B, C, D], [A, B, D]];
    let (p, q) = (at(A, B, 4), at(A, B, 12));
    let strays: [&[[Corner; 3]]; 6] = [
        &[[A, p, B]],
        &[[A, p, B], [B, p, A]],
        &[[A, p, B], [A, q, B]],
        &[[A, p, q], [p, q, B]],
        &[[A, A, B], [p, p, p]],
        &[[[900.0, 0.0, 0.0], [901.0, 0.0, 0.0], [902.0, 0.0, 0.0]], [A, p, q]],
    ];
    for stray in strays {
        check(&[&closed[..], stray].concat(), (0, true));
    }
    // On a stitch, too.
    let split = [[A, D, C], [B, C, D], [A, C, B], [A, q, D], [q, B, D], [A, B, q]];
    check(&[&split[..], &[[A, p, q]]].concat(), (1, true));
}

/// Each face has a copy with the other winding and its own vertices, as exporters of two-sided
/// meshes write it. Copies with the same vertices are dropped before.
#[test]
fn t_junctions_of_two_equal_layers_are_closed_in_both() {
    let (p, q) = (at(A, B, 4), at(A, B, 12));
    let twice = |faces: &[[Corner; 3]]| {
        faces.iter().flat_map(|&[a, b, c]| [[a, b, c], [c, b, a]]).collect::<Vec<_>>()
    };
    let check = |faces: &[[Corner; 3]], expected| {
        for offset in [[0.0; 3], [4e5, 5.6e6, 100.0]] {
            let mesh = mesh(&twice(faces), true, offset);
            assert_eq!(stitches(mesh, &[[A, B]], offset), expected, "{offset:?}");
        }
    };
    let one_side = [[A, D, C], [B, C, D], [A, C, B], [A, p, D], [p, B, D]];
    check(&[&one_side[..], &[[A, B, p]]].concat(), (2, true));
    let two = [[A, D, C], [B, C, D], [A, C, B], [A, p, D], [p, q, D], [q, B, D]];
    check(&[&two[..], &[[A, B, q], [A, q, p]]].concat(), (4, true));
    // What closes nothing is dropped there, too.
    check(&[[A, C, B], [A, D, C], [B, C, D], [A, B, D], [A, p, B]], (0, true));
}

#[test]
fn an_open_mesh_keeps_what_closes_a_t_junction_at_its_border() {
    let p = at(A, B, 4);
    let open = [[A, C, B], [A, p, D]];
    check(&[&open[..], &[[A, B, p]]].concat(), (1, false));
    // Nothing has an edge that ends at the point.
    check(&[[A, C, B], [A, p, B]], (0, false));
}

#[test]
fn a_cube_with_a_sliver_stays_closed() {
    let vertices: Vec<Corner> = (0..8u8)
        .map(|i| [0, 1, 2].map(|k| f64::from(i >> k & 1)))
        .chain([[0.5, 0.0, 0.0]])
        .collect();
    let mesh = parse(&vertices, &[&CUBE[..], &[[0, 8, 1]]].concat());
    assert_eq!(stitches(mesh, &[], [0.0; 3]), (0, true));
}

/// Numbers that seem random.
struct Random(u64);

impl Random {
    fn below(&mut self, below: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (self.0 >> 33) as usize % below
    }
}

/// Faces of a closed mesh with T-junctions on many edges. Each of its two sides has points of its
/// own on an edge, and faces without area fill the polygon between them.
fn random_closed(random: &mut Random) -> Vec<[Corner; 3]> {
    let corners = [A, B, C, D];
    let (mut faces, mut chains) = (Vec::new(), Vec::new());
    for [a, b, c] in [[0, 2, 1], [0, 3, 2], [1, 2, 3], [0, 1, 3]] {
        let middle = [0, 1, 2].map(|k| (corners[a][k] + corners[b][k] + corners[c][k]) * 0.25);
        for (p, q) in [(a, b), (b, c), (c, a)] {
            // Sometimes no point, sometimes all.
            let some = random.below(4);
            let inner = (1..16).filter(|_| random.below(3) < some);
            let inner: Vec<u32> = inner.collect();
            let ends = [&[0][..], &inner, &[16]].concat();
            let chain: Vec<_> = ends.iter().map(|&i| at(corners[p], corners[q], i)).collect();
            faces.extend(chain.windows(2).map(|pair| [pair[0], pair[1], middle]));
            chains.push(([p, q], chain));
        }
    }
    for (i, (edge, chain)) in chains.iter().enumerate() {
        let opposite = chains[..i].iter().find(|(other, _)| other == &[edge[1], edge[0]]);
        let Some((_, other)) = opposite else { continue };
        let mut ring = [chain, &other[1..other.len() - 1]].concat();
        while ring.len() > 2 {
            let n = ring.len();
            let k = random.below(n);
            faces.push([ring[k], ring[(k + 1) % n], ring[(k + 2) % n]]);
            ring.remove((k + 1) % n);
        }
    }
    faces
}

#[test]
fn random_closed_meshes_stay_closed_among_stray_faces() {
    let corners = [A, B, C, D];
    let edges: Vec<_> =
        (0..4).flat_map(|i| (0..i).map(move |k| [corners[i], corners[k]])).collect();
    let (mut random, mut kept) = (Random(7), 0);
    for run in 0..400 {
        let mut faces = random_closed(&mut random);
        for _ in 0..random.below(6) {
            let [p, q] = edges[random.below(6)];
            let stray = [0; 3].map(|_| at(p, q, random.below(17) as u32));
            faces.push(stray);
            if random.below(3) == 0 {
                faces.push([stray[1], stray[2], stray[0]]);
            }
        }
        for i in 0..faces.len() {
            let other = random.below(faces.len());
            faces.swap(i, other);
        }
        let soup = random.below(3) == 0;
        let offset = if random.below(2) == 0 { [0.0; 3] } else { [4e5, 5.6e6, 100.0] };
        let (count, closed) = stitches(mesh(&faces, soup, offset), &edges, offset);
        assert!(closed, "run {run}: {count} kept");
        kept += count;
    }
    assert!(kept > 4000, "{kept}");
}
