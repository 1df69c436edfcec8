//! Who is wrong where backends disagree: every claimed hit is looked at again, alone, in f64.
//!
//! A hit is a claim that can be checked without searching: the ray meets that primitive there, or
//! it does not. A claim that is true beyond the rounding of single precision refutes everyone who
//! says "nothing" or "farther"; one that is false refutes itself. What lies within that rounding,
//! the rays along edges and silhouettes, refutes nobody. So whoever is called wrong here is wrong;
//! errors that all backends share are not found (`crosscheck` looks for those).

use glam::DVec3;

use super::replay::Answer;
use crate::geometry::{Geometry, GeometryKind};
use crate::ray::{LANES, Rays};

/// How far single precision may move a corner, in units of the largest distance between the ray's
/// origin and the corners: the shear of Woop et al. 2013 takes 6 roundings of 2^-24 in each of two
/// coordinates; Embree's Pluecker coordinates are of the same order.
const BOUND: f64 = 16.0 / (1 << 24) as f64;

/// What is true of a claimed hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Claim {
    /// The ray misses the primitive, or may not meet it.
    False,
    /// Too near to an edge to say.
    Edge,
    /// The ray meets it, with t between these.
    Solid([f64; 2]),
}

/// Which of the answers to one closest-hit query (lane `i` of `rays`) are wrong.
pub fn closest(geometry: &Geometry, rays: &Rays, i: usize, answers: &[Answer]) -> Vec<bool> {
    let claims: Vec<Option<Claim>> =
        answers.iter().map(|a| a.hit.then(|| examine(geometry, rays, i, a))).collect();
    let mut nearest = f64::INFINITY;
    for claim in claims.iter().flatten() {
        if let Claim::Solid([_, far]) = claim {
            nearest = nearest.min(*far);
        }
    }
    let wrong = |(claim, answer): (&Option<Claim>, &Answer)| match claim {
        None => nearest < f64::INFINITY,
        Some(Claim::False) => true,
        Some(Claim::Edge) => nearest < f64::from(answer.t) * (1.0 - BOUND),
        Some(Claim::Solid([near, far])) => {
            let t = f64::from(answer.t);
            nearest < *near || t < *near || t > *far
        }
    };
    claims.iter().zip(answers).map(wrong).collect()
}

/// Which of the answers to one occlusion query are wrong. `witnesses`: what closest-hit queries of
/// the same ray found.
pub fn occluded(
    geometry: &Geometry,
    rays: &Rays,
    i: usize,
    answers: &[bool],
    witnesses: &[Answer],
) -> Vec<bool> {
    let claims = witnesses.iter().filter(|w| w.hit).map(|w| examine(geometry, rays, i, w));
    let claims: Vec<Claim> = claims.collect();
    let solid = claims.iter().any(|claim| matches!(claim, Claim::Solid(_)));
    let edge = claims.contains(&Claim::Edge);
    answers.iter().map(|&hit| if hit { !solid && !edge } else { solid }).collect()
}

/// Looks at one claimed hit. Its t is not looked at.
pub fn examine(geometry: &Geometry, rays: &Rays, i: usize, hit: &Answer) -> Claim {
    let at = |v: &[[f32; LANES]; 3]| DVec3::from([v[0][i], v[1][i], v[2][i]].map(f64::from));
    let (origin, direction) = (at(&rays.org), at(&rays.dir));
    let leaving = rays.leaving[i] == geometry.primitive(hit.geom, hit.prim);
    let corner = |p: [f32; 3]| DVec3::from(p.map(f64::from)) - origin;
    let claim = match geometry.kind(hit.geom) {
        GeometryKind::Spheres => {
            let sphere = &geometry.spheres[hit.prim as usize];
            let centre = sphere.center - origin;
            let (tnear, tfar) = (f64::from(rays.tnear[i]), f64::from(rays.tfar[i]));
            let t = sphere.intersect(origin, direction, tnear, tfar, leaving);
            let off = (centre - direction * (centre.dot(direction) / direction.length_squared()))
                .length();
            let bound = BOUND * (centre.length() + sphere.radius);
            let slack = bound / direction.length() + BOUND * t.abs();
            match (off - sphere.radius).abs() <= bound {
                true => Claim::Edge,
                false if t.is_nan() => Claim::False,
                false => Claim::Solid([t - slack, t + slack]),
            }
        }
        // A flat primitive cannot be met by a ray that leaves it.
        _ if leaving => Claim::False,
        GeometryKind::Mesh(mesh) => {
            polygon(&geometry.meshes[mesh].corners(hit.prim).map(corner), direction)
        }
        GeometryKind::Quads => polygon(&geometry.quads[hit.prim as usize].map(corner), direction),
    };
    let Claim::Solid([near, far]) = claim else { return claim };
    let (tnear, tfar) = (f64::from(rays.tnear[i]), f64::from(rays.tfar[i]));
    match (near > tnear && far < tfar, far < tnear || near > tfar) {
        (true, _) => claim,
        (_, true) => Claim::False,
        _ => Claim::Edge,
    }
}

/// A convex planar polygon, corners in order and relative to the ray's origin.
fn polygon(corners: &[DVec3], direction: DVec3) -> Claim {
    let n = corners.len();
    let edges = || (0..n).map(|k| (corners[k], corners[(k + 1) % n]));
    let reach = corners.iter().fold(0.0, |m: f64, c| m.max(c.abs().max_element()));
    let normal: DVec3 = edges().map(|(a, b)| (a - corners[0]).cross(b - corners[0])).sum();
    let facing = normal.dot(direction);
    let bound = BOUND * reach;
    // Signed distance between the ray's line and that of each edge, > 0 inside.
    let distance = |(a, b): (DVec3, DVec3)| {
        let across = direction.cross(b - a).length();
        direction.dot(a.cross(b)) * facing.signum() / across
    };
    let least = edges().map(distance).fold(f64::INFINITY, |m, d| if d >= m { m } else { d });
    let longest = edges().map(|(a, b)| (b - a).length()).fold(0.0, f64::max);
    let height = normal.length() / longest;
    let cosine = facing.abs() / (normal.length() * direction.length());
    // The rounding of the corners tilts the plane, a narrow one more.
    let planar = corners.iter().map(|c| (*c - corners[0]).dot(normal).abs() / normal.length());
    let off = planar.fold(0.0, f64::max);
    let slack = (bound * (1.0 + longest / height) + off) / (cosine * direction.length());
    let t = corners[0].dot(normal) / facing;
    if least < -bound {
        Claim::False
    } else if least > bound && slack.is_finite() && t.is_finite() {
        Claim::Solid([t - slack, t + slack])
    } else {
        // Also whatever is NaN: an edge along the ray, a polygon without area.
        Claim::Edge
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Sphere, TriangleMesh};

    /// Triangles z = 1 (primitive 0) and z = 2 (1) over the unit right angle, a sphere around z = 5.
    fn geometry() -> Geometry {
        let at = |z: f32| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let mesh =
            TriangleMesh::new([at(1.0), at(2.0)].concat(), vec![[0, 1, 2], [3, 4, 5]], false);
        let sphere = Sphere { center: DVec3::new(0.0, 0.0, 5.0), radius: 1.0 };
        Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![sphere]).unwrap()
    }

    fn ray(x: f32, y: f32) -> Rays {
        let mut rays = Rays::EMPTY;
        (rays.org[0][0], rays.org[1][0], rays.dir[2][0]) = (x, y, 1.0);
        rays
    }

    const fn hit(geom: u32, prim: u32, t: f32) -> Answer {
        Answer { hit: true, geom, prim, t }
    }

    const FIRST: Answer = hit(0, 0, 1.0);
    const SECOND: Answer = hit(0, 1, 2.0);

    #[test]
    fn a_nearer_solid_hit_refutes_a_farther_one_and_a_miss() {
        let answers = [FIRST, SECOND, Answer::MISS, hit(0, 0, 1.5)];
        assert_eq!(closest(&geometry(), &ray(0.25, 0.25), 0, &answers), [false, true, true, true]);
    }

    #[test]
    fn a_false_hit_refutes_itself() {
        let answers = [FIRST, Answer::MISS];
        assert_eq!(closest(&geometry(), &ray(0.75, 0.75), 0, &answers), [true, false]);
        let mut leaving = ray(0.25, 0.25);
        leaving.leaving[0] = 0;
        assert_eq!(closest(&geometry(), &leaving, 0, &[FIRST, SECOND]), [true, false]);
        let mut short = ray(0.25, 0.25);
        short.tfar[0] = 0.5;
        assert_eq!(closest(&geometry(), &short, 0, &answers), [true, false]);
    }

    #[test]
    fn along_an_edge_nobody_is_wrong() {
        for x in [0.0, 1e-7, -1e-7] {
            let answers = [FIRST, SECOND, Answer::MISS];
            assert_eq!(closest(&geometry(), &ray(x, 0.25), 0, &answers), [false; 3], "{x}");
        }
        // Ten thousand ulps from it, somebody is.
        let answers = [FIRST, Answer::MISS];
        assert_eq!(closest(&geometry(), &ray(1e-3, 0.25), 0, &answers), [false, true]);
        assert_eq!(closest(&geometry(), &ray(-1e-3, 0.25), 0, &answers), [true, false]);
    }

    #[test]
    fn spheres() {
        let geometry = geometry();
        let sphere = hit(2, 0, 4.0);
        let front = hit(2, 0, 5.0 - 0.99f32.sqrt());
        let answers = [front, Answer::MISS, hit(2, 0, 5.0 + 0.99f32.sqrt())];
        assert_eq!(closest(&geometry, &ray(0.0, 0.1), 0, &answers), [false, true, true]);
        assert_eq!(closest(&geometry, &ray(-2.0, 0.0), 0, &[sphere, Answer::MISS]), [true, false]);
        let silhouette = [hit(2, 0, 5.0), Answer::MISS];
        assert_eq!(closest(&geometry, &ray(-1.0, 0.0), 0, &silhouette), [false; 2]);
    }

    #[test]
    fn shadows_need_a_witness() {
        let geometry = geometry();
        let judged =
            |rays: &Rays, witness| occluded(&geometry, rays, 0, &[true, false], &[witness]);
        assert_eq!(judged(&ray(0.25, 0.25), FIRST), [false, true]);
        assert_eq!(judged(&ray(0.0, 0.25), FIRST), [false, false]);
        assert_eq!(judged(&ray(0.75, 0.75), Answer::MISS), [true, false]);
        assert_eq!(judged(&ray(0.75, 0.75), FIRST), [true, false]);
    }
}
