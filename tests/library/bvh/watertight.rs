//! Closed convex meshes have no gap for rays at their vertices, edges and faces, from inside and
//! outside.

use glam::{DVec3, Vec3};
use lightpath::geometry::{Geometry, TriangleMesh};
use lightpath::lab::accuracy::meshes::{TestMesh, cube, icosphere};
use lightpath::ray::{LANES, Rays};

use super::tiers::{ALL, Tiers, put, ray};
use crate::support::random::Random;

/// A shape that is placed in a scene.
struct Place {
    geometry: Geometry,
    center: DVec3,
    scale: f64,
}

fn place(shape: &TestMesh, center: DVec3, scale: f64) -> Place {
    let mesh = shape.placed(center, scale);
    let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few enough");
    Place { geometry, center, scale }
}

fn f64s(v: [f32; 3]) -> DVec3 {
    Vec3::from(v).as_dvec3()
}

/// Returns a vertex, a point of an edge or a point of a triangle.
fn target(random: &mut Random, mesh: &TriangleMesh, triangle: usize) -> DVec3 {
    let [a, b, c] = mesh.corners((triangle % mesh.triangles().len()) as u32).map(f64s);
    let (u, v) = (random.unit(), random.unit());
    match random.below(3) {
        0 => a,
        1 => a + (b - a) * u,
        _ => a + (b - a) * (u * v) + (c - a) * (u * (1.0 - v)),
    }
}

/// Aims `rays` rays at a shape. Each must hit its target.
fn aim(random: &mut Random, shape: &TestMesh, at: &Place, tiers: &Tiers, rays: usize) {
    let mesh = &at.geometry.meshes[0];
    let extents = shape.vertices.iter().fold(DVec3::ZERO, |m, v| m.max(v.abs()));
    for _ in 0..rays.div_ceil(LANES) {
        let mut rays = Rays::EMPTY;
        let outside = random.below(2) == 0;
        // Half of the packets have one origin and neighbouring targets.
        let together = random.below(2) == 0;
        let start = random.below(mesh.triangles().len());
        let mut inner = at.center;
        let mut steps = 1.0;
        let mut before = [f64::INFINITY; LANES];
        for i in 0..LANES {
            if i == 0 || !together {
                let offset = [0; 3].map(|_| random.within(-0.3, 0.3));
                inner = at.center + DVec3::from(offset) * extents * at.scale;
                steps = random.within(0.25, 4.0);
            }
            let triangle = if together { start + i } else { random.below(mesh.triangles().len()) };
            let goal = target(random, mesh, triangle);
            let origin = if outside {
                // Through the target to a point well inside, away from any silhouette.
                goal + (goal - inner) * steps
            } else {
                inner
            };
            let origin = origin.as_vec3();
            let direction = (goal - origin.as_dvec3()).as_vec3();
            put(&mut rays, i, origin.to_array(), direction.to_array());
            // Ends before the inner point; the other side lies behind it.
            before[i] = if outside { 1.0 + 0.5 / steps } else { 1.5 };
        }
        for (i, hit) in tiers.trace(&ALL, &rays).into_iter().enumerate() {
            let near = hit.is_some_and(|hit| f64::from(hit.t) < before[i]);
            assert!(near, "a leak: {hit:?} for a ray {}", ray(&rays, i));
        }
    }
}

fn all_shapes(rays: usize) {
    let mut random = Random(12);
    let shapes = [
        icosphere(5),
        cube(32),
        icosphere(5).squashed(DVec3::new(1.0, 1.0, 1e-3)),
        cube(32).squashed(DVec3::new(1e-3, 1.0, 1.0)),
    ];
    let places = [
        (DVec3::ZERO, 1.0),
        (DVec3::new(1e5, -1e5, 1e5), 1e3),
        (DVec3::ZERO, 1e-4),
        (DVec3::ZERO, 1e6),
        (DVec3::new(3.0, 0.0, -7.0), 1.0),
    ];
    for shape in &shapes {
        assert!(shape.is_closed());
        for (center, scale) in places {
            let at = place(shape, center, scale);
            let each = rays / (shapes.len() * places.len());
            // Nine in ten rays with the best instruction set only.
            aim(&mut random, shape, &at, &Tiers::best(&at.geometry), each * 9 / 10);
            aim(&mut random, shape, &at, &Tiers::new(&at.geometry), each / 10);
        }
    }
}

#[test]
fn no_ray_leaks_through_a_closed_mesh() {
    all_shapes(1_000_000);
}

#[test]
#[ignore = "minutes"]
fn no_ray_of_a_hundred_million_leaks_through_a_closed_mesh() {
    all_shapes(100_000_000);
}
