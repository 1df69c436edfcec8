//! Rays along the edges of meshes, which see faces edge-on.

use lightpath::math::cross;
use lightpath::{FirstHits, Limits, Mesh, Monitor, Positions, RayBatch, RayScene};

use super::queries::{difference, scene};
use crate::support::random::Random;

type Point = [f64; 3];

/// What `RayScene` takes for one place in a scene of size 1: 256u (u = 2^-24), along each axis.
const SLACK: f64 = 1.0 / 65536.0;

/// The vertices and the faces of a mesh.
type Shape = (Vec<Point>, Vec<[u32; 3]>);

pub(super) fn cube() -> Shape {
    let vertices = (0..8u8).map(|i| [0, 1, 2].map(|k| f64::from(i >> k & 1) - 0.5)).collect();
    let squares =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (vertices, squares.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

/// A grid of `rows` by `columns` vertices, at places by row and column.
fn grid(rows: u32, columns: u32, mut at: impl FnMut(f64, f64) -> Point) -> Shape {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for i in 0..rows {
        for j in 0..columns {
            vertices.push(at(i.into(), j.into()));
            if i > 0 && j > 0 {
                let d = i * columns + j;
                let [a, b, c] = [d - columns - 1, d - columns, d - 1];
                faces.extend([[a, b, c], [b, d, c]]);
            }
        }
    }
    (vertices, faces)
}

/// A sphere of radius 0.5.
fn sphere() -> Shape {
    let (rows, columns) = (24, 33);
    let pi = std::f64::consts::PI;
    let (mut vertices, mut faces) = grid(rows, columns, |i, j| {
        let (polar, turn) = (pi * (i + 0.5) / f64::from(rows), 2.0 * pi * j / 32.0);
        [polar.sin() * turn.cos(), polar.sin() * turn.sin(), polar.cos()].map(|x| 0.5 * x)
    });
    // The last column is the first one.
    faces.as_flattened_mut().iter_mut().for_each(|v| {
        if *v % columns == columns - 1 {
            *v -= columns - 1;
        }
    });
    for (row, height) in [(0, 0.5), (rows - 1, -0.5)] {
        let pole = vertices.len() as u32;
        vertices.push([0.0, 0.0, height]);
        let first = row * columns;
        faces.extend((0..32).map(|j| [pole, first + j, first + (j + 1) % 32]));
    }
    (vertices, faces)
}

fn height_field(random: &mut Random) -> Shape {
    grid(30, 30, |i, j| [i / 30.0 - 0.5, j / 30.0 - 0.5, random.within(-0.1, 0.1)])
}

/// A rotation about each axis in turn.
fn turned(shape: &Shape, random: &mut Random) -> Shape {
    let turns = [0; 3].map(|_| random.within(0.0, 6.3).sin_cos());
    let turn = |mut v: Point| {
        for (axis, (sin, cos)) in turns.into_iter().enumerate() {
            let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
            (v[i], v[j]) = (cos * v[i] - sin * v[j], sin * v[i] + cos * v[j]);
        }
        v
    };
    (shape.0.iter().map(|&v| turn(v)).collect(), shape.1.clone())
}

/// Rays along edges, from outside of them.
fn along_edges((vertices, faces): &Shape, count: usize, random: &mut Random) -> [Vec<Point>; 2] {
    let (mut origins, mut directions) = (Vec::new(), Vec::new());
    for _ in 0..count {
        let (face, k) = (faces[random.below(faces.len())], random.below(3));
        let [a, b] = [face[k], face[(k + 1) % 3]].map(|v| vertices[v as usize]);
        let edge = difference(b, a);
        let back = random.within(0.5, 3.0) / edge.iter().map(|x| x * x).sum::<f64>().sqrt();
        origins.push([0, 1, 2].map(|k| a[k] - back * edge[k]));
        directions.push(edge.map(|x| x * back));
    }
    [origins, directions]
}

fn mesh((vertices, faces): Shape) -> RayScene {
    scene(Mesh::new(Positions::F64(vertices), faces).expect("a mesh"))
}

/// The closest hits of rays, each repeated `times` times, before `tfar`.
fn closest(scene: &RayScene, [o, d]: &[Vec<Point>; 2], tfar: &[f64], times: usize) -> FirstHits {
    let repeated = |of: &[Point]| of.iter().flat_map(|&v| vec![v; times]).collect::<Vec<_>>();
    let (origins, directions) = (repeated(o), repeated(d));
    let tfar: Vec<f64> = tfar.iter().flat_map(|&t| vec![t; times]).collect();
    let rays = RayBatch::new(&origins, &directions).expect("rays");
    let rays = rays.with_limits(Limits::All(0.0), Limits::Each(&tfar)).expect("limits");
    scene.closest(&rays, &Monitor::default()).expect("hits")
}

/// Checks that no hit lies in front of the closest one, and that t and the weights name one place.
/// Returns the number of rays that hit. t may be off by `error`. If `grazing`, the face of such a
/// hit may pass by the closest one, as near as rounding explains.
fn check(shape: &Shape, rays: &[Vec<Point>; 2], error: f64, grazing: bool) -> usize {
    let scene = mesh(shape.clone());
    let batch = RayBatch::new(&rays[0], &rays[1]).expect("rays");
    let all = scene.all_hits(&batch, &Monitor::default()).expect("hits");
    let count = rays[0].len();
    let hits = closest(&scene, rays, &vec![f64::INFINITY; count], 1);
    let behind = |factor: f64| hits.t.iter().map(|t| t.max(1e-9) * factor).collect::<Vec<_>>();
    let limits = [f64::INFINITY, 1.5, 1.0 + 1e-6].map(behind);
    let mut answers = Vec::new();
    for times in [1, 16] {
        answers.extend(limits.iter().map(|tfar| (times, closest(&scene, rays, tfar, times))));
    }
    for (i, (from, direction)) in rays[0].iter().zip(&rays[1]).enumerate() {
        let crossed = all.offsets[i] as usize..all.offsets[i + 1] as usize;
        let first = all.t[crossed].first().copied().unwrap_or(f64::INFINITY);
        let (t, face) = (hits.t[i], hits.primitive[i]);
        let corners_of = |face: i64| shape.1[face as usize].map(|corner| shape.0[corner as usize]);
        let passes_hit = |face: i64| {
            let [a, b, c] = corners_of(face);
            let normal = cross(difference(b, a), difference(c, a));
            let way = [0, 1, 2].map(|k| from[k] + t * direction[k] - a[k]);
            let [height, length] = [way, normal].map(|v| (0..3).map(|k| v[k] * normal[k]).sum());
            f64::abs(height) < 2.0 * SLACK * f64::sqrt(length)
        };
        let case =
            || format!("{from:?} {direction:?}: t {t}, face {face}, crossed first at {first}");
        let first_face = all.primitive.get(all.offsets[i] as usize).copied();
        let may_be = grazing && first_face.is_some_and(passes_hit);
        assert!(t >= 0.0 && (t <= first + error || may_be), "{}", case());
        for (times, answers) in &answers {
            for at in i * times..(i + 1) * times {
                let found = (answers.t[at], answers.primitive[at]);
                assert_eq!(found, (t, face), "{times} {}", case());
            }
        }
        if face >= 0 {
            let ([u, v], [a, b, c]) = (hits.barycentrics[i], corners_of(face));
            for k in 0..3 {
                let place = a[k] * (1.0 - u - v) + b[k] * u + c[k] * v;
                assert!((from[k] + t * direction[k] - place).abs() < 2.0 * SLACK, "{}", case());
            }
        }
    }
    hits.primitive.iter().filter(|&&face| face >= 0).count()
}

/// Checks turned shapes, and such whose vertices and rays f32 can represent. Returns the number of
/// rays that hit.
fn check_turned(shape: &Shape, turns: usize, count: usize) -> usize {
    let (mut random, mut hits) = (Random(1), 0);
    for _ in 0..turns {
        let mut shape = turned(shape, &mut random);
        let mut rays = along_edges(&shape, count, &mut random);
        hits += check(&shape, &rays, 1e-6, false);
        let round = |of: &mut [Point]| {
            of.as_flattened_mut().iter_mut().for_each(|x| *x = f64::from(*x as f32));
        };
        round(&mut shape.0);
        rays.iter_mut().for_each(|of| round(of));
        hits += check(&shape, &rays, SLACK, false);
    }
    hits
}

#[test]
fn the_first_hit_along_an_edge_of_a_cube_is_the_closest() {
    let hits = check_turned(&cube(), 100, 48);
    assert!(hits > 5000, "{hits}");
}

#[test]
fn the_first_hit_along_an_edge_of_a_sphere_is_the_closest() {
    let hits = check_turned(&sphere(), 3, 2000);
    assert!(hits > 5000, "{hits}");
}

#[test]
fn the_first_hit_along_an_edge_of_a_height_field_is_the_closest() {
    let hits = check_turned(&height_field(&mut Random(2)), 3, 2000);
    assert!(hits > 5000, "{hits}");
}

/// A floor with walls that stand on both of its sides.
fn walled_floor() -> Shape {
    let mut vertices = vec![[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]];
    let mut faces = vec![[0, 1, 2], [0, 2, 3]];
    for i in 1..20 {
        let (x, first) = (f64::from(i) / 20.0 - 0.5, vertices.len() as u32);
        let square = [(-0.5, -0.05), (0.5, -0.05), (0.5, 0.05), (-0.5, 0.05)];
        vertices.extend(square.map(|(y, z)| [x, y, z]));
        faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    (vertices, faces)
}

/// Rays that meet points of a face, or leave them for a negative slope.
fn at_slope((vertices, faces): &Shape, slope: f64, random: &mut Random) -> [Vec<Point>; 2] {
    let (mut origins, mut directions) = (Vec::new(), Vec::new());
    for _ in 0..300 {
        let [a, b, c] = faces[random.below(2)].map(|v| vertices[v as usize]);
        let (e1, e2) = (difference(b, a), difference(c, a));
        let [u, v] = [0; 2].map(|_| random.within(0.05, 0.45));
        let [x, y] = [0; 2].map(|_| random.within(-1.0, 1.0));
        let normal = cross(e1, e2);
        let away = if slope < 0.0 { 1e-8 } else { random.within(0.1, 1.0) };
        let direction = |k: usize| x * e1[k] + y * e2[k] - slope * normal[k];
        origins.push([0, 1, 2].map(|k| match slope < 0.0 {
            true => a[k] + u * e1[k] + v * e2[k] + away * normal[k],
            false => a[k] + u * e1[k] + v * e2[k] - away * direction(k),
        }));
        directions.push([0, 1, 2].map(direction));
    }
    [origins, directions]
}

/// Single precision moves the hits of such rays by up to the size of the scene.
#[test]
fn the_first_hit_of_a_grazing_ray_is_the_closest() {
    let (floor, mut random, mut hits) = (walled_floor(), Random(1), 0);
    for slope in [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2] {
        for _ in 0..5 {
            let shape = turned(&floor, &mut random);
            let rays = at_slope(&shape, slope, &mut random);
            hits += check(&shape, &rays, 2.0 * SLACK, true);
            check(&shape, &at_slope(&shape, -slope, &mut random), 2.0 * SLACK, true);
        }
    }
    assert!(hits > 6000, "{hits}");
}

/// Narrow faces, seen at small slopes: t is that of f64, not the tree's, whose planes are rounded.
#[test]
fn narrow_faces_have_the_t_of_double_precision() {
    let mut random = Random(1);
    for (width, slope) in [(1e-2, 1e-8), (1e-3, 1e-7), (1e-4, 1e-6), (1e-5, 1e-5), (1e-6, 1e-4)] {
        let mut hits = 0;
        for _ in 0..300 {
            let z = random.within(0.05, 0.2);
            let corners = vec![[0.0, 0.0, z], [1.0, 0.5 * width, z], [1.0, -0.5 * width, z]];
            let scene = mesh((corners, vec![[0, 1, 2]]));
            let (x, t) = (random.within(0.3, 0.9), random.within(0.5, 1.5));
            let from = [x - t, random.within(-0.1, 0.1) * width, z + t * slope];
            let rays = (vec![from], vec![[1.0, 0.0, -slope]]);
            let rays = RayBatch::new(&rays.0, &rays.1).expect("a ray");
            let found = scene.closest(&rays, &Monitor::default()).expect("hits").t[0];
            if found.is_finite() {
                hits += 1;
                let exact = (from[2] - z) / slope;
                assert!((found - exact).abs() < 1e-5, "{width:e} {slope:e}: {found} {exact}");
            }
        }
        assert!(hits > 50, "{width:e} {slope:e}: {hits}");
    }
}
