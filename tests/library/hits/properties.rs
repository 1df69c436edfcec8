//! Properties of hits over sixteen decades of coordinates: rays that leave a primitive, positions
//! within their primitive's box, impossible rays, and packets compared with single rays and an f64
//! oracle.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use crate::support::backends::{self, on_both};
use crate::support::oracle::{Answer, Scale, closest};
use glam::DVec3;
use lightpath::{
    accel::Accelerator,
    geometry::{Geometry, NONE, Sphere, Surfaces, TriangleMesh, refine},
    ray::{Coherence, LANES, Mask, RayPacket},
    scene::Backend,
};
use proptest::{
    collection::vec,
    prelude::*,
    test_runner::{Config, TestCaseResult, TestRunner},
};

/// Returns the f32 below a finite `x`; for zero, the largest negative normal number.
fn below(x: f32) -> f32 {
    match x {
        0.0 => -f32::MIN_POSITIVE,
        x if x > 0.0 => f32::from_bits(x.to_bits() - 1),
        x => f32::from_bits(x.to_bits() + 1),
    }
}

/// Numbers of either sign, of magnitudes 1e-8 to 1e8. Every decade is equally likely.
fn wide() -> impl Strategy<Value = f64> {
    (-8.0..8.0, any::<bool>()).prop_map(|(decade, negative)| {
        let magnitude = 10f64.powf(decade);
        if negative { -magnitude } else { magnitude }
    })
}

fn wide_point() -> impl Strategy<Value = DVec3> {
    [wide(), wide(), wide()].prop_map(DVec3::from_array)
}

fn unit() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0]
        .prop_map(DVec3::from_array)
        .prop_filter("a direction", |d| d.length() > 0.1)
        .prop_map(|d| d.normalize())
}

/// Three corners: all anywhere, or near each other.
fn corners() -> impl Strategy<Value = [DVec3; 3]> {
    let far = [wide_point(), wide_point(), wide_point()];
    let near = (wide_point(), wide(), unit(), unit())
        .prop_map(|(base, size, a, b)| [base, base + a * size, base + b * size]);
    prop_oneof![far, near]
}

fn sphere() -> impl Strategy<Value = Sphere> {
    (wide_point(), wide()).prop_map(|(center, radius)| Sphere { center, radius: radius.abs() })
}

/// A geometry of triangles, parallelograms and spheres.
fn geometry(triangles: &[[DVec3; 3]], quads: &[[DVec3; 3]], spheres: &[Sphere]) -> Geometry {
    let point = |p: DVec3| p.as_vec3().to_array();
    let vertices = triangles.iter().flatten().map(|&p| point(p)).collect();
    let indices = (0..triangles.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
    let mesh = TriangleMesh::new(vertices, indices, false);
    let quads = quads.iter().map(|[a, b, d]| [*a, *b, *b + *d - *a, *d].map(point)).collect();
    Geometry::new(DVec3::ZERO, vec![mesh], quads, spheres.to_vec()).unwrap()
}

fn packet(rays: &[(DVec3, DVec3)]) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    for (i, (origin, direction)) in rays.iter().enumerate() {
        for axis in 0..3 {
            packet.rays.org[axis][i] = origin[axis] as f32;
            packet.rays.dir[axis][i] = direction[axis] as f32;
        }
    }
    packet
}

/// Returns a lane's ray as it was traced: rounded to f32.
fn traced(packet: &RayPacket, i: usize) -> (DVec3, DVec3) {
    let lane =
        |v: &[[f32; LANES]; 3]| DVec3::from_array([0, 1, 2].map(|axis| f64::from(v[axis][i])));
    (lane(&packet.rays.org), lane(&packet.rays.dir))
}

fn only(lane: usize) -> Mask {
    let mut mask = Mask::NONE;
    mask.0[lane] = -1;
    mask
}

/// Traces every lane on its own. One to three active lanes take the path of single rays.
fn one_by_one(accelerator: &dyn Accelerator, packet: &mut RayPacket) {
    for lane in 0..LANES {
        let lane = packet.rays.possible(&only(lane));
        accelerator.closest(&lane, packet, Coherence::Unordered);
    }
}

/// Returns the box of the primitive that lane `i` hit.
fn box_of(geometry: &Geometry, packet: &RayPacket, i: usize) -> [DVec3; 2] {
    let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i] as usize);
    let points: Vec<DVec3> = if geom == geometry.spheres_id() {
        let Sphere { center, radius } = geometry.spheres[prim];
        vec![center - radius, center + radius]
    } else if geom == geometry.quads_id() {
        geometry.quads[prim].map(|p| DVec3::from(p.map(f64::from))).to_vec()
    } else {
        let corners = geometry.meshes[geom as usize].corners(prim as u32);
        corners.map(|p| DVec3::from(p.map(f64::from))).to_vec()
    };
    let fold = |f: fn(DVec3, DVec3) -> DVec3| points.iter().copied().reduce(f).unwrap();
    [fold(DVec3::min), fold(DVec3::max)]
}

/// Sixteen rays towards points of one primitive, from any distance.
fn aimed() -> impl Strategy<Value = Vec<([f64; 2], DVec3, f64)>> {
    vec(([0.0..1.0, 0.0..1.0], unit(), -8.0..8.0), LANES)
}

fn aim(
    [a, b, c]: [DVec3; 3],
    sphere: Sphere,
    at: &[([f64; 2], DVec3, f64)],
) -> Vec<(DVec3, DVec3)> {
    let ray = |(lane, &([u, v], direction, decade)): (usize, &([f64; 2], DVec3, f64))| {
        let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
        let target = match lane % 4 {
            0 | 1 => a + (b - a) * u + (c - a) * v,
            2 => sphere.center + direction.any_orthonormal_vector() * sphere.radius * u,
            _ => sphere.center,
        };
        (target - direction * 10f64.powf(decade), direction)
    };
    at.iter().enumerate().map(ray).collect()
}

fn position_is_in_the_box(
    geometry: &Geometry,
    packet: &RayPacket,
    points: &Surfaces,
    i: usize,
) -> TestCaseResult {
    let [low, high] = box_of(geometry, packet, i);
    for axis in 0..3 {
        let position = points.position[axis][i];
        let (low, high) = (below(low[axis] as f32), -below(-high[axis] as f32));
        prop_assert!(
            low <= position && position <= high,
            "axis {axis}: {position:e} is not in [{low:e}, {high:e}]"
        );
    }
    Ok(())
}

/// A ray that leaves a hit point can hit its primitive again only on the far side of a sphere.
fn leaves_for_good(
    geometry: &Geometry,
    first: &Surfaces,
    packet: &RayPacket,
    second: &RayPacket,
    i: usize,
) -> TestCaseResult {
    if second.hits.geom[i] == NONE {
        if packet.hits.geom[i] == geometry.spheres_id() {
            let Sphere { center, radius } = geometry.spheres[packet.hits.prim[i] as usize];
            let (origin, direction) = traced(second, i);
            let inward = (center - origin).dot(direction);
            // The origin may be 1.5 ulp of each coordinate outside, where the ray misses a flat
            // chord. The line's squared distance from the centre is (radius + away)^2 - inward^2.
            let away = 4e-7 * (center.length() + radius);
            let clear = inward > 0.0 && inward * inward > 2.0 * away * (2.0 * radius + away);
            prop_assert!(!clear, "a ray across a sphere left it without meeting the far side");
        }
        return Ok(());
    }
    let primitive = geometry.primitive(second.hits.geom[i], second.hits.prim[i]);
    if primitive != first.primitive[i] {
        return Ok(());
    }
    prop_assert_eq!(packet.hits.geom[i], geometry.spheres_id(), "a planar primitive was hit again");
    let sphere = geometry.spheres[packet.hits.prim[i] as usize];
    let (origin, direction) = traced(second, i);
    let inward = (sphere.center - origin).dot(direction);
    prop_assert!(inward > 0.0, "an outward ray hit its sphere again: {inward:e}");
    Ok(())
}

/// Traces sixteen rays at a triangle, a quad and a sphere, then rays that leave their hits.
fn hits_of(
    backend: Backend,
    triangle: [DVec3; 3],
    quad: [DVec3; 3],
    sphere: Sphere,
    at: &[([f64; 2], DVec3, f64)],
    out: &[DVec3],
    count: &AtomicU64,
) -> TestCaseResult {
    let geometry = geometry(&[triangle], &[quad], &[sphere]);
    let accelerator = backends::build(&geometry, backend);
    for corners in [triangle, quad] {
        for single in [false, true] {
            let mut packet = packet(&aim(corners, sphere, at));
            if single {
                one_by_one(&*accelerator, &mut packet);
            } else {
                accelerator.closest(&Mask::ALL, &mut packet, Coherence::Unordered);
            }
            let mut first = Surfaces::EMPTY;
            refine(&geometry, &packet.hit(&Mask::ALL), &packet, &mut first);
            let mut second = RayPacket::EMPTY;
            for i in 0..LANES {
                for axis in 0..3 {
                    second.rays.org[axis][i] = first.outside[axis][i];
                    second.rays.dir[axis][i] = out[i][axis] as f32;
                }
                second.rays.leaving[i] = first.primitive[i];
            }
            if single {
                one_by_one(&*accelerator, &mut second);
            } else {
                accelerator.closest(&first.hit, &mut second, Coherence::Unordered);
            }
            for i in (0..LANES).filter(|&i| first.hit.0[i] != 0) {
                count.fetch_add(1, Relaxed);
                position_is_in_the_box(&geometry, &packet, &first, i)?;
                leaves_for_good(&geometry, &first, &packet, &second, i)?;
            }
        }
    }
    Ok(())
}

on_both! {
    fn hits_lie_in_their_box_and_rays_leave_for_good(backend: Backend) {
        let count = AtomicU64::new(0);
        let input = (corners(), corners(), sphere(), aimed(), vec(unit(), LANES));
        let test = |(triangle, quad, sphere, at, out): (_, _, _, Vec<_>, Vec<_>)| {
            hits_of(backend, triangle, quad, sphere, &at, &out, &count)
        };
        run(2048, input, test);
        let count = count.into_inner();
        assert!(count > 2000, "only {count} rays hit anything");
    }
}

fn run<S: Strategy>(cases: u32, input: S, test: impl Fn(S::Value) -> TestCaseResult) {
    let cases = std::env::var("PROPTEST_CASES").map_or(cases, |n| n.parse().unwrap());
    let mut runner =
        TestRunner::new(Config { cases, failure_persistence: None, ..Config::default() });
    if let Err(error) = runner.run(&input, test) {
        panic!("{error}");
    }
}

/// A handful of shapes of one size within a cube of ten times that size, at any scale that gives no
/// warning.
#[derive(Debug, Clone)]
struct Cloud {
    scale: f64,
    triangles: Vec<[DVec3; 3]>,
    quads: Vec<[DVec3; 3]>,
    spheres: Vec<Sphere>,
}

fn cloud() -> impl Strategy<Value = Cloud> {
    let place = || [-3.0..3.0, -3.0..3.0, -3.0..3.0].prop_map(DVec3::from_array);
    let corners = move || (place(), unit(), unit()).prop_map(|(p, a, b)| [p, p + a * 2.0, p + b]);
    let ball = (place(), 0.2..1.5).prop_map(|(center, radius)| Sphere { center, radius });
    (-12.0..12.0, vec(corners(), 1..6), vec(corners(), 0..4), vec(ball, 0..6)).prop_map(
        |(decade, triangles, quads, spheres)| {
            let scale = 10f64.powf(decade);
            let rounded = |c: [DVec3; 3]| c.map(|p| (p * scale).as_vec3().as_dvec3());
            Cloud {
                scale,
                triangles: triangles.into_iter().map(rounded).collect(),
                quads: quads.into_iter().map(rounded).collect(),
                spheres: spheres
                    .into_iter()
                    .map(|s| Sphere { center: s.center * scale, radius: s.radius * scale })
                    .collect(),
            }
        },
    )
}

/// Sixteen rays through the middle of a cloud of scale 1.
fn rays() -> impl Strategy<Value = Vec<(DVec3, DVec3)>> {
    let ray = ([-2.0..2.0, -2.0..2.0, -2.0..2.0], unit(), 0.0..9.0);
    vec(ray.prop_map(|(p, d, back)| (DVec3::from_array(p) - d * back, d)), LANES)
}

fn mask() -> impl Strategy<Value = Mask> {
    any::<u16>().prop_map(|bits| Mask(std::array::from_fn(|i| -i32::from(bits >> i & 1 == 1))))
}

/// Compares packets with any mask, single rays and shadow rays with the oracle.
fn agrees(
    backend: Backend,
    cloud: &Cloud,
    rays: &[(DVec3, DVec3)],
    mask: Mask,
    sure: &AtomicU64,
) -> TestCaseResult {
    let geometry = geometry(&cloud.triangles, &cloud.quads, &cloud.spheres);
    let accelerator = backends::build(&geometry, backend);
    let scaled: Vec<_> = rays.iter().map(|(o, d)| (*o * cloud.scale, *d)).collect();
    let start = packet(&scaled);
    let mut single = start.clone();
    one_by_one(&*accelerator, &mut single);
    let answers: [Option<Answer>; LANES] = std::array::from_fn(|i| {
        let (origin, direction) = traced(&start, i);
        (mask.0[i] != 0).then(|| closest(&geometry, origin, direction, Scale(cloud.scale)))
    });
    for coherence in [Coherence::Coherent, Coherence::Unordered] {
        let mut packet = start.clone();
        accelerator.closest(&mask, &mut packet, coherence);
        for i in 0..LANES {
            let Some(answer) = answers[i] else {
                prop_assert_eq!(packet.hits.geom[i], NONE, "an inactive lane has a hit");
                prop_assert_eq!(packet.rays.tfar[i], f32::INFINITY, "an inactive lane has a t");
                continue;
            };
            for found in [&packet, &single] {
                let prim = match found.hits.geom[i] {
                    NONE => NONE,
                    geom => geometry.primitive(geom, found.hits.prim[i]),
                };
                match answer {
                    Answer::Unsure => continue,
                    Answer::Miss => prop_assert_eq!(prim, NONE, "lane {}", i),
                    Answer::Hit { primitive, t } => {
                        prop_assert_eq!(prim, primitive, "lane {}", i);
                        let error = (f64::from(found.rays.tfar[i]) - t).abs();
                        prop_assert!(error <= 1e-4 * cloud.scale, "lane {i}: {error:e} off {t:e}");
                    }
                }
            }
            sure.fetch_add(u64::from(!matches!(answer, Answer::Unsure)), Relaxed);
            shadow_agrees(&*accelerator, &start, &mask, coherence, i, answer)?;
        }
    }
    Ok(())
}

/// A segment that ends before the closest hit is free. One that ends behind it is occluded.
fn shadow_agrees(
    accelerator: &dyn Accelerator,
    start: &RayPacket,
    mask: &Mask,
    coherence: Coherence,
    i: usize,
    answer: Answer,
) -> TestCaseResult {
    let (ends, expected): (&[f64], _) = match answer {
        Answer::Unsure => return Ok(()),
        Answer::Miss => (&[f64::INFINITY], [false, false]),
        Answer::Hit { t, .. } => (&[0.9 * t, 1.1 * t], [false, true]),
    };
    for (&end, blocked) in ends.iter().zip(expected) {
        for mask in [*mask, only(i)] {
            let mut rays = start.rays.clone();
            rays.tfar[i] = end as f32;
            accelerator.occluded(&mask, &mut rays, coherence);
            prop_assert_eq!(rays.tfar[i] == f32::NEG_INFINITY, blocked, "lane {} to {}", i, end);
            for other in (0..LANES).filter(|&other| mask.0[other] == 0) {
                prop_assert_eq!(rays.tfar[other], f32::INFINITY, "an inactive lane is blocked");
            }
        }
    }
    Ok(())
}

on_both! {
    fn packets_single_rays_and_shadow_rays_agree_with_an_oracle(backend: Backend) {
        let sure = AtomicU64::new(0);
        let test = |(cloud, rays, mask): (Cloud, Vec<_>, Mask)| agrees(backend, &cloud, &rays, mask, &sure);
        run(2048, (cloud(), rays(), mask()), test);
        let sure = sure.into_inner();
        assert!(sure > 2000, "only {sure} rays were clear");
    }
}

/// Rays that cannot hit anything.
fn impossible() -> impl Strategy<Value = (DVec3, DVec3)> {
    let bad = || prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]);
    prop_oneof![
        Just((DVec3::ZERO, DVec3::ZERO)),
        ([-2.0..2.0, -2.0..2.0, -2.0..2.0])
            .prop_map(|origin| (DVec3::from_array(origin), DVec3::ZERO)),
        (unit(), bad(), 0..6usize).prop_map(|(direction, bad, at)| {
            let (mut origin, mut direction) = (-direction * 4.0, direction);
            if at < 3 {
                origin[at] = bad
            } else {
                direction[at - 3] = bad
            }
            (origin, direction)
        }),
    ]
}

/// Impossible rays miss, and do not change the answers of the other lanes.
fn undisturbed(
    backend: Backend,
    cloud: &Cloud,
    rays: &[(DVec3, DVec3)],
    bad: &[(DVec3, DVec3)],
    mask: Mask,
) -> TestCaseResult {
    let geometry = geometry(&cloud.triangles, &cloud.quads, &cloud.spheres);
    let accelerator = backends::build(&geometry, backend);
    let mixed: Vec<(DVec3, DVec3)> = (0..LANES)
        .map(|i| if mask.0[i] != 0 { rays[i] } else { bad[i] })
        .map(|(origin, direction)| (origin * cloud.scale, direction))
        .collect();
    let start = packet(&mixed);
    let all = start.rays.possible(&Mask::ALL);
    for coherence in [Coherence::Coherent, Coherence::Unordered] {
        let [mut with, mut without, mut single] = [start.clone(), start.clone(), start.clone()];
        accelerator.closest(&all, &mut with, coherence);
        accelerator.closest(&mask, &mut without, coherence);
        one_by_one(&*accelerator, &mut single);
        let [mut shadows, mut clear] = [start.rays.clone(), start.rays.clone()];
        accelerator.occluded(&all, &mut shadows, coherence);
        accelerator.occluded(&mask, &mut clear, coherence);
        let hit = |p: &RayPacket, i: usize| (p.hits.geom[i], p.rays.tfar[i]);
        for i in 0..LANES {
            if mask.0[i] == 0 {
                prop_assert_eq!(with.hits.geom[i], NONE, "lane {} {:?}", i, traced(&start, i));
                prop_assert_eq!(single.hits.geom[i], NONE, "single {:?}", traced(&start, i));
                prop_assert_eq!(shadows.tfar[i], f32::INFINITY, "{:?}", traced(&start, i));
            } else {
                prop_assert_eq!(hit(&with, i), hit(&without, i), "lane {}", i);
                prop_assert_eq!(shadows.tfar[i], clear.tfar[i], "lane {}", i);
            }
        }
    }
    Ok(())
}

on_both! {
    fn impossible_rays_miss_and_do_not_affect_other_lanes(backend: Backend) {
        let input = (cloud(), rays(), vec(impossible(), LANES), mask());
        run(2048, input, |(cloud, rays, bad, mask)| undisturbed(backend, &cloud, &rays, &bad, mask));
    }
}
