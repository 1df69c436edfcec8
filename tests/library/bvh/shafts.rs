//! A shaft may be reported as empty only if none of its shadow rays is occluded.

use glam::{DVec3, Vec3};
use lightpath::accel::{Accelerator, Shaft};
use lightpath::geometry::{Geometry, Sphere, Surfaces, TriangleMesh, refine};
use lightpath::ray::{Coherence, LANES, Mask, NONE, RayPacket};
use lightpath::scene::Falloff;
use lightpath::shading::{
    Area, Cone, Distant, LightWeights, ShadowPoints, lane, light_rays, set_lane,
};

use super::tiers::{ALL, Tiers, put, ray};
use crate::support::random::Random;

/// A bumpy square from -1 to 1 of `2 rows^2` triangles at `offset`, with some triangles and a
/// sphere above it.
fn landscape(random: &mut Random, rows: u32, bumps: f64, offset: DVec3) -> Geometry {
    let mut vertices = Vec::new();
    for row in 0..=rows {
        for column in 0..=rows {
            let at = |i: u32| 2.0 * f64::from(i) / f64::from(rows) - 1.0;
            let height = bumps * random.within(-1.0, 1.0) / f64::from(rows);
            vertices.push((offset + DVec3::new(at(row), height, at(column))).as_vec3().to_array());
        }
    }
    let index = |row: u32, column: u32| row * (rows + 1) + column;
    let mut triangles = Vec::new();
    for (row, column) in (0..rows).flat_map(|row| (0..rows).map(move |column| (row, column))) {
        let [a, b] = [index(row, column), index(row, column + 1)];
        let [c, d] = [index(row + 1, column), index(row + 1, column + 1)];
        triangles.extend([[a, b, c], [d, c, b]]);
    }
    let mut point = |size: f64| DVec3::from_array([0; 3].map(|_| random.within(-size, size)));
    for _ in 0..4 {
        let base = offset + point(0.8) + DVec3::Y;
        let first = vertices.len() as u32;
        triangles.push([first, first + 1, first + 2]);
        vertices.extend([0; 3].map(|_| (base + point(0.2)).as_vec3().to_array()));
    }
    let sphere = Sphere { center: offset + point(0.5) + DVec3::Y, radius: 0.1 };
    let mesh = TriangleMesh::new(vertices, triangles, false);
    Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![sphere]).expect("few")
}

/// Points where a block of rays from above hits the landscape.
fn surface_points(
    tree: &dyn Accelerator,
    geometry: &Geometry,
    random: &mut Random,
    offset: DVec3,
) -> ShadowPoints {
    let width = 10f64.powf(random.within(-4.0, -0.5));
    let eye = offset + DVec3::new(random.within(-1.5, 1.5), 2.5, random.within(-1.5, 1.5));
    let mid = offset + DVec3::new(random.within(-0.9, 0.9), 0.0, random.within(-0.9, 0.9));
    let mut packet = RayPacket::EMPTY;
    for i in 0..LANES {
        let at = mid + DVec3::new(random.within(0.0, width), 0.0, random.within(0.0, width));
        let direction = (at - eye).as_vec3().to_array();
        put(&mut packet.rays, i, eye.as_vec3().to_array(), direction);
    }
    tree.closest(&ALL, &mut packet, Coherence::Coherent);
    let hit = packet.hit(&ALL);
    let mut surfaces = Surfaces::EMPTY;
    refine(geometry, &hit, &packet, &mut surfaces);
    let mut points = ShadowPoints::EMPTY;
    (points.position, points.origin) = (surfaces.position, surfaces.outside);
    (points.ng, points.n) = (surfaces.ng, surfaces.ng);
    (points.primitive, points.hit) = (surfaces.primitive, hit);
    // Points at an edge have rules of their own.
    for i in 0..LANES {
        points.hit.0[i] &= !surfaces.at_edge.0[i] & !surfaces.doubtful.0[i];
    }
    points
}

/// Points in the air, which leave nothing.
fn free_points(random: &mut Random, offset: DVec3) -> ShadowPoints {
    let width = 10f64.powf(random.within(-3.0, 0.0));
    let mut point = |size: f64| DVec3::from_array([0; 3].map(|_| random.within(-size, size)));
    let base = offset + point(1.5) + DVec3::Y;
    let mut points = ShadowPoints::EMPTY;
    for i in 0..LANES {
        let at = (base + point(width)).as_vec3();
        set_lane(&mut points.position, i, at);
        set_lane(&mut points.origin, i, at);
        points.hit.0[i] = -1;
    }
    points
}

/// A parallelogram of light above the landscape.
fn light(random: &mut Random, offset: DVec3) -> Area {
    let size = 10f64.powf(random.within(-2.0, 0.7));
    let far = 10f64.powf(random.within(0.0, 2.0));
    let mut point = |size: f64| DVec3::from_array([0; 3].map(|_| random.within(-size, size)));
    let corner = offset + point(2.0) + DVec3::Y * (2.0 + far);
    Area::new(corner.as_vec3(), point(size), point(size), false, 4)
}

/// A sun above the landscape, of up to 60 degrees.
fn sun(random: &mut Random, geometry: &Geometry) -> Area {
    let towards = DVec3::new(random.within(-1.0, 1.0), 1.0, random.within(-1.0, 1.0));
    let angle = if random.unit() < 0.2 { 0.0 } else { 10f64.powf(random.within(-1.0, 1.78)) };
    Area::from_distant(Distant::Sun(Cone::new(towards, angle, geometry)), 4)
}

/// Shadow rays of all lanes to random points of the light. The first rounds go to its corners and
/// edges.
fn shadow_rays(
    points: &ShadowPoints,
    area: &Area,
    random: &mut Random,
    round: u32,
) -> (Mask, RayPacket) {
    let mut squares = [[0.0; LANES]; 2];
    for i in 0..LANES {
        let (mut s, mut t) = (random.unit() as f32, random.unit() as f32);
        if round < 4 {
            s = s.round();
        }
        if round < 2 {
            t = t.round();
        }
        (squares[0][i], squares[1][i]) = (s, t);
    }
    let mut packet = RayPacket::EMPTY;
    let mut lit = LightWeights::EMPTY;
    let q = area.points(&squares, points);
    let falloff = Falloff::None;
    light_rays(points, &q, None, falloff, false, &mut packet.rays, &mut lit);
    (points.hit, packet)
}

#[test]
fn no_ray_in_an_empty_shaft_is_occluded() {
    let mut random = Random(11);
    let (mut empty, mut shafts) = ([0; 2], [0; 2]);
    for (rows, bumps, offset) in [
        (4, 0.0, DVec3::ZERO),
        (12, 0.4, DVec3::ZERO),
        (40, 1.0, DVec3::ZERO),
        (40, 0.3, DVec3::new(900.0, -70.0, 3000.0)),
    ] {
        let geometry = landscape(&mut random, rows, bumps, offset);
        let tiers = Tiers::new(&geometry);
        for case in 0..800 {
            let on_surface = case % 2 == 0;
            let points = match on_surface {
                true => surface_points(tiers.last(), &geometry, &mut random, offset),
                false => free_points(&mut random, offset),
            };
            if !points.hit.any() {
                continue;
            }
            let area = match case % 3 {
                0 => sun(&mut random, &geometry),
                _ => light(&mut random, offset),
            };
            let Some(corners) = area.corners(&points) else { continue };
            let corners = corners.map(|corner: Vec3| corner.to_array());
            let leaving = points.primitive;
            let shaft = Shaft {
                active: points.hit,
                origins: &points.origin,
                leaving,
                between: false,
                corners: &corners,
            };
            shafts[usize::from(on_surface)] += 1;
            if tiers.reporting_empty_shaft(&shaft) == 0 {
                continue;
            }
            empty[usize::from(on_surface)] += 1;
            for round in 0..8 {
                let (active, packet) = shadow_rays(&points, &area, &mut random, round);
                let hits = tiers.trace(&active, &packet.rays);
                let hit = hits.iter().position(Option::is_some);
                assert_eq!(hit.map(|i| ray(&packet.rays, i)), None, "{rows} {on_surface} {area:?}");
            }
        }
    }
    for (empty, shafts) in empty.into_iter().zip(shafts) {
        assert!(4 * empty > shafts && empty < shafts, "{empty} of {shafts} shafts");
    }
}

/// A box of up to 0.1 around a point of the landscape, and the triangle that the point lies on.
fn patch(points: &ShadowPoints, random: &mut Random) -> ([Vec3; 2], u32) {
    let first = points.hit.first();
    let at = lane(&points.origin, first);
    let sizes = [0; 2].map(|_| 10f64.powf(random.within(-4.0, -1.0)) as f32);
    // The landscape is nearly flat, and so are most boxes.
    let flat = if random.unit() < 0.5 { 1e-6 } else { sizes[0] };
    let half = Vec3::new(sizes[0], flat, sizes[1]);
    ([at - half, at + half], points.primitive[first])
}

/// Shadow rays from random points of the box, its corners first. They leave `primitive`.
fn rays_from_box(
    [low, high]: [Vec3; 2],
    primitive: u32,
    area: &Area,
    random: &mut Random,
    round: u32,
) -> RayPacket {
    let mut points = ShadowPoints::EMPTY;
    for i in 0..LANES {
        let mut at = || {
            let x = random.unit() as f32;
            if round < 2 { x.round() } else { x }
        };
        let origin = low + (high - low) * Vec3::new(at(), at(), at());
        set_lane(&mut points.position, i, origin);
        set_lane(&mut points.origin, i, origin);
        (points.hit.0[i], points.primitive[i]) = (-1, primitive);
    }
    shadow_rays(&points, area, random, round).1
}

#[test]
fn no_ray_from_inside_the_hull_of_an_empty_shaft_is_occluded() {
    let mut random = Random(12);
    let (mut empty, mut shafts) = (0, 0);
    for (rows, bumps) in [(1, 0.0), (1, 0.0), (4, 0.0), (12, 0.4)] {
        let geometry = landscape(&mut random, rows, bumps, DVec3::ZERO);
        let tiers = Tiers::new(&geometry);
        for _ in 0..800 {
            let points = surface_points(tiers.last(), &geometry, &mut random, DVec3::ZERO);
            if !points.hit.any() {
                continue;
            }
            let (ends, primitive) = patch(&points, &mut random);
            let mut origins = [[0.0; LANES]; 3];
            let mut active = Mask::NONE;
            for i in 0..8 {
                let pick = |axis: usize| ends[(i >> axis) & 1][axis];
                set_lane(&mut origins, i, Vec3::new(pick(0), pick(1), pick(2)));
                active.0[i] = -1;
            }
            let area = light(&mut random, DVec3::ZERO);
            let Some(corners) = area.corners(&points) else { continue };
            let corners = corners.map(|corner: Vec3| corner.to_array());
            let (origins, leaving) = (&origins, [primitive; LANES]);
            let shaft = Shaft { active, origins, leaving, between: true, corners: &corners };
            shafts += 1;
            if tiers.reporting_empty_shaft(&shaft) == 0 {
                continue;
            }
            empty += 1;
            for round in 0..8 {
                let packet = rays_from_box(ends, primitive, &area, &mut random, round);
                let hits = tiers.trace(&ALL, &packet.rays);
                let hit = hits.iter().position(Option::is_some);
                assert_eq!(hit.map(|i| ray(&packet.rays, i)), None, "{rows} {ends:?} {area:?}");
            }
        }
    }
    assert!(4 * empty > shafts && empty < shafts, "{empty} of {shafts} shafts");
}

#[test]
fn every_tier_distinguishes_a_free_light_from_a_hidden_one() {
    let wall = [[-1.0, 5.0, -1.0], [1.0, 5.0, -1.0], [1.0, 5.0, 1.0], [-1.0, 5.0, 1.0]];
    let geometry = Geometry::new(DVec3::ZERO, vec![], vec![wall], vec![]).expect("few");
    let tiers = Tiers::new(&geometry);
    let all = lightpath::simd::Isa::available().count();
    let count_empty = |x0: f32, x1: f32, y: f32| {
        let corners = [[x0, y, -0.5], [x1, y, -0.5], [x0, y, 0.5], [x1, y, 0.5]];
        let origins = [[0.0; LANES]; 3];
        let (active, leaving) = (Mask::ALL, [NONE; LANES]);
        let shaft = Shaft { active, origins: &origins, leaving, between: false, corners: &corners };
        tiers.reporting_empty_shaft(&shaft)
    };
    // Beside the wall; before it; on the other side; its edge inside; the whole wall inside.
    assert_eq!(count_empty(2.1, 4.0, 10.0), all);
    assert_eq!(count_empty(-1.0, 1.0, 4.9), all);
    assert_eq!(count_empty(-1.0, 1.0, -5.0), all);
    assert_eq!(count_empty(1.9, 4.0, 10.0), 0);
    assert_eq!(count_empty(-8.0, 8.0, 10.0), 0);
}

/// Products of three coordinates overflow from 7e12 on. The signs of some corners of the light are
/// then NaN.
#[test]
fn a_shaft_of_huge_coordinates_is_not_empty_if_a_ray_hits() {
    for scale in [1.0, 1e11, 1e13, 1e15] {
        let at = |p: [f32; 3]| p.map(|x| x * scale);
        let vertices = [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, -1.0, 0.0]].map(at).to_vec();
        let mesh = TriangleMesh::new(vertices, vec![[0, 1, 2]], false);
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
        let tiers = Tiers::new(&geometry);
        // The first corner lies behind the triangle's plane, the point and the last two before it.
        let corners = [[-0.5, -1.5, 0.4], [-1.0, 2.0, 0.4], [2.0, 2.0, 0.4], [1.5, 5.5, 0.4]];
        let (corners, point) = (corners.map(at), at([1.0, 1.0, 0.2]));
        let mut packet = RayPacket::EMPTY;
        let towards = [0, 1, 2].map(|axis| corners[0][axis] - point[axis]);
        put(&mut packet.rays, 0, point, towards);
        packet.rays.tfar[0] = 1.0;
        let mut active = Mask::NONE;
        active.0[0] = -1;
        assert!(tiers.trace(&active, &packet.rays)[0].is_some(), "{scale}");
        let origins = &packet.rays.org;
        let leaving = [NONE; LANES];
        let shaft = Shaft { active, origins, leaving, between: false, corners: &corners };
        assert_eq!(tiers.reporting_empty_shaft(&shaft), 0, "{scale}");
    }
}
