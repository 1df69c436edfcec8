//! Rays from inside closed meshes, at corners and edges and close to them. Rejecting false hits
//! must not open leaks.

use glam::DVec3;
use lightpath::ray::{Coherence, LANES, NONE, RayPacket};
use lightpath::scene::{Backend, EmbreeMode};

use super::setup::{ALL, cube, geometry, packet};
use crate::support::backends::build;
use crate::support::random::Random;

/// A closed mesh around the origin.
struct Shell {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

/// A sphere of `n` rings, stretched.
fn shell(n: u32, stretch: DVec3) -> Shell {
    let around = 2 * n;
    let mut vertices = vec![DVec3::Y * stretch];
    for ring in 1..n {
        let (r, y) = (std::f64::consts::PI * f64::from(ring) / f64::from(n)).sin_cos();
        for k in 0..around {
            let (s, c) = (std::f64::consts::TAU * f64::from(k) / f64::from(around)).sin_cos();
            vertices.push(DVec3::new(r * c, y, r * s) * stretch);
        }
    }
    let last = vertices.len() as u32;
    vertices.push(DVec3::NEG_Y * stretch);
    let at = |ring: u32, k: u32| 1 + (ring - 1) * around + k % around;
    let mut triangles = Vec::new();
    for k in 0..around {
        triangles.push([0, at(1, k), at(1, k + 1)]);
        triangles.push([last, at(n - 1, k + 1), at(n - 1, k)]);
        for ring in 1..n - 1 {
            let [a, b, c, d] = [at(ring, k), at(ring, k + 1), at(ring + 1, k), at(ring + 1, k + 1)];
            triangles.extend([[a, c, b], [b, c, d]]);
        }
    }
    // The f32 vertices that every backend gets.
    let vertices = vertices.into_iter().map(|v| v.as_vec3().as_dvec3()).collect();
    Shell { vertices, triangles }
}

impl Shell {
    /// Returns a ray at a corner, at an edge, or slightly beside an edge.
    fn ray(&self, random: &mut Random, stretch: DVec3) -> (DVec3, DVec3) {
        let corners = self.triangles[random.below(self.triangles.len())];
        let [a, b, c] = corners.map(|v| self.vertices[v as usize]);
        let edge = a.lerp(b, random.unit());
        let target = match random.below(3) {
            0 => a,
            1 => edge,
            _ => edge.lerp(c, 10f64.powf(random.within(-8.0, -3.0))),
        };
        let origin = (cube(random) * 0.5 * stretch).as_vec3().as_dvec3();
        (origin, target - origin)
    }
}

/// Counts the rays that leave the shell: by candidates, by closest hits, by occlusion.
fn leaks(backend: Backend, stretch: DVec3, packets: usize) -> [u64; 3] {
    let shell = shell(24, stretch);
    let vertices = shell.vertices.iter().map(|v| v.as_vec3().to_array()).collect();
    let geometry = geometry(vertices, shell.triangles.clone(), vec![]);
    let accelerator = build(&geometry, backend);
    let mut random = Random(1);
    let mut leaks = [0; 3];
    for k in 0..packets {
        let traced = packet(|| shell.ray(&mut random, stretch));
        let how = [Coherence::Unordered, Coherence::Single, Coherence::Coherent][k % 3];
        let (mut native, mut closest): (RayPacket, RayPacket) = (traced.clone(), traced.clone());
        let mut shadow = traced.rays;
        accelerator.closest_unfiltered(&ALL, &mut native, how);
        accelerator.closest(&ALL, &mut closest, how);
        accelerator.occluded(&ALL, &mut shadow, how);
        for i in 0..LANES {
            leaks[0] += u64::from(native.hits.geom[i] == NONE);
            leaks[1] += u64::from(closest.hits.geom[i] == NONE);
            leaks[2] += u64::from(shadow.tfar[i] > 0.0);
        }
    }
    println!("{} {stretch}: {leaks:?} of {}", backend.name(), packets * LANES);
    leaks
}

/// A ball, a needle whose long edges are nearly parallel to rays, and a plate.
const STRETCHES: [DVec3; 3] = [DVec3::ONE, DVec3::new(1.0, 300.0, 1.0), DVec3::new(1.0, 1e-3, 1.0)];

/// Embree's own test leaks. Rejecting false hits must not add leaks.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn discarding_opens_no_leak_in_embree() {
    let embree = Backend::Embree(EmbreeMode::Robust);
    for stretch in STRETCHES {
        let [native, closest, shadow] = leaks(embree, stretch, 60_000);
        assert!(closest <= native && shadow <= native, "{stretch}: {native} {closest} {shadow}");
    }
}

#[test]
fn bvh_leaks_nothing() {
    for stretch in STRETCHES {
        assert_eq!(leaks(Backend::default(), stretch, 10_000), [0; 3], "{stretch}");
    }
}
