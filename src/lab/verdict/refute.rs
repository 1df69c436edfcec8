//! Finds the wrong answers where backends disagree, by testing every reported hit in f64.
//!
//! A reported hit can be checked without a search: the ray hits that primitive at that t, or it
//! does not.
//!
//! - A hit that is certain, beyond the rounding of single precision, proves that a miss or a
//!   farther hit is wrong.
//! - A hit of a primitive that the ray certainly misses is wrong itself.
//! - A hit within the rounding of single precision, along an edge or silhouette, proves nothing.
//!
//! So every answer that is called wrong here is wrong. Errors that all backends share are not
//! found; `crosscheck` finds those.

use super::layers::layers;
use crate::accel::brute::{Near, near_primitive};
use crate::accel::lane::LaneRay;
use crate::geometry::Geometry;
use crate::lab::answer::Answer;
use crate::lab::backend::MAX_ERROR_FACTOR;
use crate::ray::Rays;

/// Largest relative rounding of t: four f32 ulp.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

/// Result of the check of one reported hit.
#[derive(Debug, Clone, Copy, PartialEq)]
enum HitCheck {
    /// The ray certainly misses the primitive, or must not hit it: the ray leaves the primitive, or
    /// the hit lies outside the ray's segment.
    Impossible,
    /// The ray passes an edge, or an end of its segment, too closely to decide.
    Edge,
    /// The ray certainly hits the primitive, at a t between these two values.
    Certain([f64; 2]),
}

/// Returns which of the answers to one closest-hit query (lane `i` of `rays`) are wrong.
pub fn closest(geometry: &Geometry, rays: &Rays, i: usize, answers: &[Answer]) -> Vec<bool> {
    let checks: Vec<Option<HitCheck>> =
        answers.iter().map(|answer| check(geometry, rays, i, answer)).collect();
    let mut nearest = f64::INFINITY;
    for check in checks.iter().flatten() {
        if let HitCheck::Certain([_, far]) = check {
            nearest = nearest.min(*far);
        }
    }
    let wrong = |(check, answer): (&Option<HitCheck>, &Answer)| match check {
        None => nearest < f64::INFINITY,
        Some(HitCheck::Impossible) => true,
        Some(HitCheck::Edge) => nearest < answer.t() * (1.0 - ROUNDING),
        Some(HitCheck::Certain([near, far])) => {
            let t = answer.t();
            nearest < *near || t < *near || t > *far
        }
    };
    checks.iter().zip(answers).map(wrong).collect()
}

/// Returns which of the answers to one occlusion query are wrong.
///
/// `witnesses` are the answers of closest-hit queries for the same ray.
pub fn occluded(
    geometry: &Geometry,
    rays: &Rays,
    i: usize,
    answers: &[bool],
    witnesses: &[Answer],
) -> Vec<bool> {
    let checks = witnesses.iter().filter_map(|witness| check(geometry, rays, i, witness));
    let checks: Vec<HitCheck> = checks.collect();
    let certain = checks.iter().any(|check| matches!(check, HitCheck::Certain(_)));
    let edge = checks.contains(&HitCheck::Edge);
    answers.iter().map(|&hit| if hit { !certain && !edge } else { certain }).collect()
}

/// Checks whether the ray hits the reported primitive within its segment. The reported t is not
/// used. `None` if the answer names no primitive.
fn check(geometry: &Geometry, rays: &Rays, i: usize, answer: &Answer) -> Option<HitCheck> {
    let [geom, prim] = answer.primitive()?;
    let ray = LaneRay::of(rays, i);
    let near = near_primitive(geometry, &ray, geom, prim, MAX_ERROR_FACTOR);
    // A sphere has two entries, one for each root.
    let layers = layers(&near);
    let first = layers
        .iter()
        .filter(|layer| layer.near > ray.tnear && layer.far < ray.tfar)
        .min_by(|a, b| a.near.total_cmp(&b.near));
    let may_count =
        |part: &Near| part.t + part.t_error >= ray.tnear && part.t - part.t_error <= ray.tfar;
    Some(match first {
        Some(layer) => HitCheck::Certain([layer.near, layer.far]),
        None if near.iter().any(may_count) => HitCheck::Edge,
        None => HitCheck::Impossible,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    use crate::geometry::{Sphere, TriangleMesh};

    /// Two parallel right triangles at z = 1 (primitive 0) and z = 2 (primitive 1), and a unit
    /// sphere around z = 5.
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
        Answer::Hit { geom, prim, t: t as f64 }
    }

    const FIRST: Answer = hit(0, 0, 1.0);
    const SECOND: Answer = hit(0, 1, 2.0);

    #[test]
    fn a_certain_hit_proves_a_farther_hit_and_a_miss_wrong() {
        let answers = [FIRST, SECOND, Answer::Miss, hit(0, 0, 1.5)];
        assert_eq!(closest(&geometry(), &ray(0.25, 0.25), 0, &answers), [false, true, true, true]);
    }

    #[test]
    fn a_false_hit_is_wrong() {
        let answers = [FIRST, Answer::Miss];
        assert_eq!(closest(&geometry(), &ray(0.75, 0.75), 0, &answers), [true, false]);
        let mut leaving = ray(0.25, 0.25);
        leaving.leaving[0] = 0;
        assert_eq!(closest(&geometry(), &leaving, 0, &[FIRST, SECOND]), [true, false]);
        let mut short = ray(0.25, 0.25);
        short.tfar[0] = 0.5;
        assert_eq!(closest(&geometry(), &short, 0, &answers), [true, false]);
    }

    #[test]
    fn no_answer_is_wrong_along_an_edge() {
        for x in [0.0, 1e-7, -1e-7] {
            let answers = [FIRST, SECOND, Answer::Miss];
            assert_eq!(closest(&geometry(), &ray(x, 0.25), 0, &answers), [false; 3], "{x}");
        }
        // Ten thousand ulps from the edge, one answer is wrong.
        let answers = [FIRST, Answer::Miss];
        assert_eq!(closest(&geometry(), &ray(1e-3, 0.25), 0, &answers), [false, true]);
        assert_eq!(closest(&geometry(), &ray(-1e-3, 0.25), 0, &answers), [true, false]);
    }

    #[test]
    fn hits_of_spheres_are_judged_by_both_roots() {
        let geometry = geometry();
        let sphere = hit(2, 0, 4.0);
        let front = hit(2, 0, 5.0 - 0.99f32.sqrt());
        let answers = [front, Answer::Miss, hit(2, 0, 5.0 + 0.99f32.sqrt())];
        assert_eq!(closest(&geometry, &ray(0.0, 0.1), 0, &answers), [false, true, true]);
        assert_eq!(closest(&geometry, &ray(-2.0, 0.0), 0, &[sphere, Answer::Miss]), [true, false]);
        let silhouette = [hit(2, 0, 5.0), Answer::Miss];
        assert_eq!(closest(&geometry, &ray(-1.0, 0.0), 0, &silhouette), [false; 2]);
    }

    #[test]
    fn occlusion_is_judged_by_a_closest_hit() {
        let geometry = geometry();
        let judged =
            |rays: &Rays, witness| occluded(&geometry, rays, 0, &[true, false], &[witness]);
        assert_eq!(judged(&ray(0.25, 0.25), FIRST), [false, true]);
        assert_eq!(judged(&ray(0.0, 0.25), FIRST), [false, false]);
        assert_eq!(judged(&ray(0.75, 0.75), Answer::Miss), [true, false]);
        assert_eq!(judged(&ray(0.75, 0.75), FIRST), [true, false]);
    }
}
