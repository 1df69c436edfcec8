//! Compares t, weights, position and its error bound with the exact oracle, for every backend.

use glam::DVec3;
use lightpath::accel::brute::Brute;
use lightpath::accel::lane::{LaneHit, LaneRay};
use lightpath::geometry::{Geometry, Surfaces, refine, triangle_error};
use lightpath::ray::{Coherence, LANES, RayPacket};
use lightpath::scene::Backend;

use super::setup::{ALL, cube, geometry, oracle, packet, unit};
use crate::support::backends::{build, on_both};
use crate::support::errors::worse;
use crate::support::random::Random;

/// Triangles of sizes from 1e-3 to 10 and of all shapes, and some quads.
fn soup(random: &mut Random) -> Geometry {
    let (mut vertices, mut triangles, mut quads) = (Vec::new(), Vec::new(), Vec::new());
    for k in 0..300u32 {
        let center = cube(random) * 3.0;
        let size = 10f64.powf(random.within(-3.0, 1.0));
        let thin = 10f64.powf(random.within(-3.0, 0.0));
        let (a, b) = (unit(random) * size, unit(random) * size * thin);
        let of = |v: DVec3| v.as_vec3().to_array();
        if k % 8 == 0 {
            quads.push([center, center + a, center + a + b, center + b].map(of));
        } else {
            let first = vertices.len() as u32;
            vertices.extend([center, center + a, center + b].map(of));
            triangles.push([first, first + 1, first + 2]);
        }
    }
    geometry(vertices, triangles, quads)
}

/// Returns the oracle's hit of one primitive.
fn exact(oracle: &Brute, ray: &LaneRay, geom: u32, prim: u32) -> Option<LaneHit> {
    oracle.all_hits(ray).into_iter().find(|hit| (hit.geom, hit.prim) == (geom, prim))
}

/// Returns the difference in units of f32's spacing at t.
fn ulps(t: f32, exact: f64) -> f64 {
    let bits = (exact as f32).abs();
    let spacing = f64::from(f32::from_bits(bits.to_bits() + 1)) - f64::from(bits);
    (f64::from(t) - exact).abs() / spacing
}

#[derive(Debug, Default)]
struct Seen {
    hits: u64,
    /// Number of hits whose t is off by more than 2 ulp.
    over_two: u64,
    worst_ulps: f64,
    worst_weight: f64,
    /// Distance of the position from the exact point, in units of its bound.
    worst_share: f64,
}

fn survey(backend: Backend) -> Seen {
    let mut random = Random(11);
    let mut seen = Seen::default();
    for _ in 0..6 {
        let geometry = soup(&mut random);
        let (oracle, accelerator) = (oracle(&geometry), build(&geometry, backend));
        for _ in 0..1500 {
            let mut traced = packet(|| {
                let origin = cube(&mut random) * 10f64.powf(random.within(-1.0, 2.0));
                (origin, (cube(&mut random) * 3.0 - origin) * random.within(0.1, 3.0))
            });
            let rays = traced.rays.clone();
            accelerator.closest(&ALL, &mut traced, Coherence::Incoherent);
            let mut points = Surfaces::EMPTY;
            refine(&geometry, &traced.hit(&ALL), &traced, &mut points);
            for i in (0..LANES).filter(|&i| points.hit.0[i] != 0) {
                let (geom, prim) = (traced.hits.geom[i], traced.hits.prim[i]);
                let ray = LaneRay::of(&rays, i);
                // Rays that pass an edge within the bound of an f32 test have no exact hit there.
                let Some(hit) = exact(&oracle, &ray, geom, prim) else { continue };
                assert_eq!(points.doubtful.0[i], 0, "{ray:?} {hit:?}");
                let corners = corners(&geometry, &traced, i);
                check(&mut seen, &geometry, (&points, i, corners), &ray, &hit);
            }
        }
    }
    println!("{}: {seen:?}", backend.name());
    seen
}

/// Returns the corners of the triangle, or of the half of a quad, that lane `i` hit.
fn corners(geometry: &Geometry, traced: &RayPacket, i: usize) -> [DVec3; 3] {
    let hits = &traced.hits;
    let corners = if hits.geom[i] == geometry.quads_id() {
        geometry.quad_half(hits.prim[i], hits.u[i], hits.v[i]).0
    } else {
        geometry.meshes[hits.geom[i] as usize].corners(hits.prim[i])
    };
    corners.map(|corner| DVec3::from(corner.map(f64::from)))
}

fn check(
    seen: &mut Seen,
    geometry: &Geometry,
    (points, i, corners): (&Surfaces, usize, [DVec3; 3]),
    ray: &LaneRay,
    hit: &LaneHit,
) {
    seen.hits += 1;
    let off = ulps(points.t[i], hit.t);
    seen.worst_ulps = worse(seen.worst_ulps, off);
    seen.over_two += u64::from(off > 2.0);
    let (u, v) = if hit.geom == geometry.quads_id() && hit.u + hit.v > 1.0 {
        (1.0 - hit.u, 1.0 - hit.v)
    } else {
        (hit.u, hit.v)
    };
    // On a quad's diagonal, either half is right.
    if hit.geom != geometry.quads_id() || (hit.u + hit.v - 1.0).abs() > 1e-6 {
        let weights = worse((points.u[i] - u).abs(), (points.v[i] - v).abs());
        seen.worst_weight = worse(seen.worst_weight, weights);
    }
    let met = ray.origin + ray.direction * hit.t;
    let at = DVec3::from([0, 1, 2].map(|axis| f64::from(points.position[axis][i])));
    // The oracle's own t has an error of 2^-40.
    let known = (ray.direction * hit.t).abs().max_element() * 2f64.powi(-40);
    let off = (at - met).abs().to_array().into_iter().fold(0.0, worse);
    let rounding = 0.5001 * f64::from(f32::EPSILON) * at.abs().max_element();
    let error = triangle_error(corners, ray.origin, ray.direction) + rounding;
    seen.worst_share = worse(seen.worst_share, (off - known).max(0.0) / error);
}

fn exact_to_the_last_digits(backend: Backend) {
    let seen = survey(backend);
    assert!(seen.hits > 10_000, "{seen:?}");
    assert!(seen.over_two * 10_000 <= seen.hits && seen.worst_ulps <= 8.0, "{seen:?}");
    assert!(seen.worst_weight <= 1e-6, "{seen:?}");
    assert!(seen.worst_share <= 1.0, "{seen:?}");
}

on_both! {
    fn refined_hits_are_exact_to_the_last_digits(backend: Backend) {
        exact_to_the_last_digits(backend);
    }
}

#[test]
fn refined_hits_of_other_backends_are_exact() {
    exact_to_the_last_digits(Backend::Coursework);
    exact_to_the_last_digits(Backend::Brute);
}
