//! Small integers make every quantity of the test exact, so every answer must be exact.

use glam::DVec3;
use lightpath::accel;
use lightpath::geometry::{Geometry, Sphere, TriangleMesh};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, NONE, RayPacket, Rays};
use lightpath::scene::{Backend, EmbreeMode};
use proptest::{collection::vec, prelude::*, test_runner::TestCaseResult};

use super::tiers::{ALL, Hit, OPTIONS, Tiers, put, ray};

/// Cells along each axis.
const SIZE: i64 = 8;

type Point = [i64; 3];

fn point() -> impl Strategy<Value = Point> {
    [0..=SIZE, 0..=SIZE, 0..=SIZE]
}

/// A direction to one of the 26 neighbours, times a power of two.
fn direction() -> impl Strategy<Value = (Point, i32)> {
    let towards = [-1..=1i64, -1..=1i64, -1..=1i64].prop_filter("not zero", |d| *d != [0; 3]);
    (towards, -3..4)
}

#[derive(Debug, Clone)]
struct Scene {
    triangles: Vec<[Point; 3]>,
    /// Two opposite corners.
    boxes: Vec<[Point; 2]>,
    /// A corner and two extents in the plane normal to an axis.
    quads: Vec<(Point, i64, i64, usize)>,
    spheres: Vec<(Point, i64)>,
}

fn scene() -> impl Strategy<Value = Scene> {
    let quad = (point(), 1..4i64, 1..4i64, 0..3usize);
    (
        vec([point(), point(), point()], 0..40),
        vec([point(), point()], 0..4),
        vec(quad, 0..6),
        vec((point(), 1..3i64), 0..6),
    )
        .prop_map(|(triangles, boxes, quads, spheres)| Scene {
            triangles,
            boxes,
            quads,
            spheres,
        })
}

/// Returns the twelve triangles of a box.
fn sides([p, q]: [Point; 2]) -> Vec<[Point; 3]> {
    let mut all = Vec::new();
    for axis in 0..3 {
        for end in [p[axis], q[axis]] {
            let corner = |second: bool, third: bool| {
                let mut v = [0; 3];
                v[axis] = end;
                let (k, l) = ((axis + 1) % 3, (axis + 2) % 3);
                v[k] = if second { q[k] } else { p[k] };
                v[l] = if third { q[l] } else { p[l] };
                v
            };
            let [a, b, c, d] = [
                corner(false, false),
                corner(true, false),
                corner(true, true),
                corner(false, true),
            ];
            all.extend([[a, b, c], [a, c, d]]);
        }
    }
    all
}

/// Every flat primitive as integer triangles, and the scene for the backend.
struct Exact {
    /// Number of the primitive, and corners.
    flat: Vec<(u32, [Point; 3])>,
    geometry: Geometry,
}

impl Exact {
    fn new(scene: &Scene) -> Self {
        let mesh = |triangles: &[[Point; 3]]| {
            let vertices = triangles.as_flattened().iter().map(|v| v.map(|x| x as f32)).collect();
            let indices = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]);
            TriangleMesh::new(vertices, indices.collect(), false)
        };
        let sides: Vec<[Point; 3]> = scene.boxes.iter().flat_map(|&ends| sides(ends)).collect();
        let quads: Vec<[Point; 4]> = scene
            .quads
            .iter()
            .map(|&(p, first, second, axis)| {
                let to = |a: i64, b: i64| {
                    let mut v = p;
                    v[(axis + 1) % 3] += a;
                    v[(axis + 2) % 3] += b;
                    v
                };
                [p, to(first, 0), to(first, second), to(0, second)]
            })
            .collect();
        let spheres = scene.spheres.iter().map(|&(p, radius)| Sphere {
            center: DVec3::from(p.map(|x| x as f64)),
            radius: radius as f64,
        });
        let corners = quads.iter().map(|quad| quad.map(|v| v.map(|x| x as f32))).collect();
        let meshes = vec![mesh(&scene.triangles), mesh(&sides)];
        let geometry = Geometry::new(DVec3::ZERO, meshes, corners, spheres.collect()).expect("few");
        let mut flat: Vec<(u32, [Point; 3])> =
            scene.triangles.iter().chain(&sides).copied().zip(0..).map(|(t, i)| (i, t)).collect();
        let first = flat.len() as u32;
        for (&[v0, v1, v2, v3], i) in quads.iter().zip(first..) {
            flat.extend([(i, [v0, v1, v3]), (i, [v2, v3, v1])]);
        }
        Self { flat, geometry }
    }

    /// Returns the closest hit; of equal ones, that of the lower primitive.
    fn closest(
        &self,
        origin: Point,
        direction: Point,
        scale: f64,
        rays: &Rays,
        i: usize,
    ) -> Option<Hit> {
        let (tnear, tfar) = (f64::from(rays.tnear[i]), f64::from(rays.tfar[i]));
        let leaving = rays.leaving[i];
        let flat = self.flat.iter().filter(|(primitive, _)| *primitive != leaving).filter_map(
            |&(primitive, corners)| {
                Some((triangle(corners, origin, direction)? / scale, primitive))
            },
        );
        let first = self.geometry.primitive(self.geometry.spheres_id(), 0);
        let [o, d] = [origin, direction].map(|v| DVec3::from(v.map(|x| x as f64)));
        let spheres = self.geometry.spheres.iter().zip(first..).map(|(sphere, primitive)| {
            (sphere.intersect(o, d * scale, tnear, tfar, primitive == leaving), primitive)
        });
        flat.chain(spheres)
            .filter(|&(t, _)| t > tnear && t < tfar)
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map(|(t, primitive)| Hit { primitive, t: t as f32 })
    }
}

/// Returns t of a triangle, edges and corners included, in integers except for the last division.
fn triangle(corners: [Point; 3], origin: Point, direction: Point) -> Option<f64> {
    let minus = |a: Point, b: Point| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let cross = |a: Point, b: Point| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let dot = |a: Point, b: Point| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let [a, b, c] = corners.map(|v| minus(v, origin));
    // Volumes spanned by the ray's direction and each edge.
    let volumes =
        [dot(direction, cross(c, b)), dot(direction, cross(a, c)), dot(direction, cross(b, a))];
    let (least, most) = (volumes.into_iter().min()?, volumes.into_iter().max()?);
    let normal = cross(minus(b, a), minus(c, a));
    let towards = dot(normal, direction);
    let inside = towards != 0 && (least >= 0 || most <= 0);
    inside.then(|| dot(normal, a) as f64 / towards as f64)
}

#[derive(Debug, Clone)]
struct Shot {
    origin: Point,
    direction: (Point, i32),
    /// Ends of the segment, in eighths.
    ends: (u32, Option<u32>),
    leaving: u32,
}

fn shots() -> impl Strategy<Value = Vec<Shot>> {
    let origin = [-2..SIZE + 3, -2..SIZE + 3, -2..SIZE + 3];
    let near = prop_oneof![3 => Just(0), 1 => 0..20u32];
    let ends = (near, prop::option::weighted(0.2, 20..100u32));
    let leaving = prop_oneof![3 => Just(u32::MAX), 1 => 0..60u32];
    let shot = (origin, direction(), ends, leaving);
    // Packets are traced together if all rays have one direction.
    (vec(shot, LANES), any::<bool>()).prop_map(|(all, together)| {
        let first = all[0].1;
        all.into_iter()
            .map(|(origin, direction, ends, leaving)| {
                let direction = if together { first } else { direction };
                Shot { origin, direction, ends, leaving }
            })
            .collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn integers_are_answered_exactly(scene in scene(), packets in vec(shots(), 4)) {
        let exact = Exact::new(&scene);
        let tiers = Tiers::new(&exact.geometry);
        for shots in packets {
            let mut rays = Rays::EMPTY;
            for (i, shot) in shots.iter().enumerate() {
                let scale = (f64::from(shot.direction.1)).exp2() as f32;
                let direction = shot.direction.0.map(|x| x as f32 * scale);
                put(&mut rays, i, shot.origin.map(|x| x as f32), direction);
                rays.tnear[i] = shot.ends.0 as f32 / 8.0;
                rays.tfar[i] = shot.ends.1.map_or(f32::INFINITY, |end| end as f32 / 8.0);
                // A ray that leaves a sphere would have to start on it.
                let flat = exact.geometry.primitive(exact.geometry.spheres_id(), 0);
                rays.leaving[i] = if shot.leaving < flat { shot.leaving } else { NONE };
            }
            let found = tiers.trace(&ALL, &rays);
            for (i, shot) in shots.iter().enumerate() {
                let scale = f64::from(shot.direction.1).exp2();
                let expected = exact.closest(shot.origin, shot.direction.0, scale, &rays, i);
                prop_assert_eq!(found[i], expected, "{}", ray(&rays, i));
            }
        }
    }
}

/// Boxes, and axial rays that pass between the edges. Even for backends that round, no answer is in
/// doubt: on the diagonal of a side, either triangle is right.
fn boxed() -> impl Strategy<Value = (Vec<[Point; 2]>, Vec<[Axial; LANES]>)> {
    let thick = (point(), [1..4i64, 1..4i64, 1..4i64]);
    let boxes = vec(thick.prop_map(|(p, d)| [p, [p[0] + d[0], p[1] + d[1], p[2] + d[2]]]), 1..12);
    let within = [1..4i64, 1..4i64, 1..4i64];
    let axial = (point(), within, 0..3usize, any::<bool>(), -3..4).prop_map(
        |(cell, within, axis, backward, power)| Axial { cell, within, axis, backward, power },
    );
    let packet = vec(axial, LANES).prop_map(|all| std::array::from_fn(|i| all[i].clone()));
    (boxes, vec(packet, 4))
}

/// A ray along an axis.
#[derive(Debug, Clone)]
struct Axial {
    /// Cell in which the ray starts.
    cell: Point,
    /// Position within the cell in quarters. It is never on a side of a box, where Embree's
    /// segments are closed and ours are open.
    within: Point,
    axis: usize,
    backward: bool,
    /// The direction's length is 2 to this power.
    power: i32,
}

impl Axial {
    /// Returns the origin in quarters.
    fn origin(&self) -> Point {
        [0, 1, 2].map(|k| 4 * self.cell[k] + self.within[k])
    }

    fn step(&self) -> f32 {
        if self.backward { -(self.power as f32).exp2() } else { (self.power as f32).exp2() }
    }

    /// Returns the nearest side of a box in front of the ray, in quarters.
    fn nearest(&self, boxes: &[[Point; 2]]) -> Option<i64> {
        let origin = self.origin();
        let across = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        let beside = |[p, q]: &&[Point; 2]| {
            across.iter().all(|&k| (4 * p[k]..=4 * q[k]).contains(&origin[k]))
        };
        let sides = boxes.iter().filter(beside).flatten().map(|corner| {
            let ahead = 4 * corner[self.axis] - origin[self.axis];
            if self.backward { -ahead } else { ahead }
        });
        sides.filter(|&distance| distance > 0).min()
    }
}

/// Checks the answers of backends. Each may be off in distance by a given number of 2^-23.
fn agree_on_boxes(
    backends: &[(Backend, f32)],
    (boxes, packets): (Vec<[Point; 2]>, Vec<[Axial; LANES]>),
) -> TestCaseResult {
    let scene = Scene { triangles: vec![], boxes, quads: vec![], spheres: vec![] };
    let exact = Exact::new(&scene);
    for &(backend, off) in backends {
        let built = accel::build(&exact.geometry, backend, &OPTIONS, &Monitor::default());
        let accelerator = built.expect("a backend");
        for packet in &packets {
            let mut rays = Rays::EMPTY;
            for (i, axial) in packet.iter().enumerate() {
                let mut direction = [0.0; 3];
                direction[axial.axis] = axial.step();
                put(&mut rays, i, axial.origin().map(|x| x as f32 / 4.0), direction);
            }
            for way in [Coherence::Single, Coherence::Unordered, Coherence::Coherent] {
                let mut traced = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
                accelerator.closest(&ALL, &mut traced, way);
                let mut shadow = rays.clone();
                accelerator.occluded(&ALL, &mut shadow, way);
                for (i, axial) in packet.iter().enumerate() {
                    let t = axial.nearest(&scene.boxes);
                    let t = t.map(|d| d as f32 / 4.0 / axial.step().abs());
                    let found = (traced.hits.geom[i] != NONE).then_some(traced.rays.tfar[i]);
                    let near = match (found, t) {
                        (Some(found), Some(t)) => (found - t).abs() <= off * f32::EPSILON * t,
                        (found, t) => found == t,
                    };
                    let ray = ray(&rays, i);
                    prop_assert!(near, "{backend:?} {way:?}: {found:?}, expected {t:?}: {ray}");
                    prop_assert_eq!(shadow.tfar[i] < 0.0, t.is_some(), "{:?} {:?}", backend, way);
                }
            }
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn our_backends_agree_on_boxes(case in boxed()) {
        let ours = [Backend::default(), Backend::Brute, Backend::Coursework];
        agree_on_boxes(&ours.map(|backend| (backend, 0.0)), case)?;
    }

    /// Embree divides by an estimate and a Newton step.
    #[test]
    #[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
    fn embree_agrees_on_boxes(case in boxed()) {
        agree_on_boxes(&[(Backend::Embree(EmbreeMode::Robust), 1.0)], case)?;
    }
}

#[test]
fn boxes_and_their_diagonals_are_hit() {
    // Checks that the generator's scenes can be hit, and at the right distance.
    let scene =
        Scene { triangles: vec![], boxes: vec![[[2; 3], [4; 3]]], quads: vec![], spheres: vec![] };
    let exact = Exact::new(&scene);
    let tiers = Tiers::new(&exact.geometry);
    let mut rays = Rays::EMPTY;
    for i in 0..LANES {
        put(&mut rays, i, [0.0; 3], [1.0; 3]);
    }
    put(&mut rays, 1, [3.0, 3.0, 9.0], [0.0, 0.0, -2.0]);
    put(&mut rays, 2, [5.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
    let found = tiers.trace(&ALL, &rays);
    assert_eq!(found[0].map(|hit| hit.t), Some(2.0));
    assert_eq!(found[1].map(|hit| hit.t), Some(2.5));
    assert_eq!(found[2], None);
}
