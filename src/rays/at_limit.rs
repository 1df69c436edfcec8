//! Hits at a limit of their ray.
//!
//! At a vertex or an edge a ray touches several faces. Each has a t of its own, as f64 rounds. A
//! limit that is one of them would lie before the others. So of faces that meet, none counts at a
//! limit if one of them does not count there.

use std::collections::HashMap;

use glam::DVec3;

use super::arrays;
use super::batch::RayBatch;
use super::refine::FoundHit;
use super::scene::RayScene;
use crate::mesh::position_key;

/// Hits whose t and limit differ by at most this fraction of t may be at the limit.
pub(super) const MARGIN: f64 = 4096.0 * f64::EPSILON;

/// Errors of t in units of the epsilon of f64, for a face that the ray meets at a right angle. On
/// vertices of spheres, two faces differed by at most 1.5.
const T_ERROR: f64 = 8.0;

/// A hit that may be at a limit of its ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct AtLimit {
    pub hit: FoundHit,
    pub t: f64,
    pub counts: bool,
}

impl RayScene {
    /// Returns the hits that count, in order. Leaves out those whose face shares a vertex with that
    /// of a hit that does not count, if their t differ by no more than the error. The hits of a ray
    /// must follow one another.
    pub(super) fn beyond_limits(&self, rays: &RayBatch, hits: &[AtLimit]) -> Vec<FoundHit> {
        let (mut beyond, mut ends) = (Vec::new(), HashMap::new());
        for hits in hits.chunk_by(|a, b| a.hit.ray == b.hit.ray) {
            let counting = || hits.iter().filter(|hit| hit.counts);
            if counting().next().is_none() {
                continue;
            }
            ends.clear();
            // For each vertex of the hits that do not count, how far the same place reaches beyond
            // each limit.
            for hit in hits.iter().filter(|hit| !hit.counts) {
                let (corners, reach) = self.reach(rays, hit);
                for corner in corners.map(position_key) {
                    let end = ends.entry(corner).or_insert(reach);
                    *end = [0, 1].map(|limit| reach[limit].max(end[limit]));
                }
            }
            beyond.extend(counting().filter_map(|hit| {
                let same_place = !ends.is_empty() && {
                    let (corners, reach) = self.reach(rays, hit);
                    let end = |corner: DVec3| ends.get(&position_key(corner));
                    let mut ends = corners.into_iter().filter_map(end);
                    ends.any(|end| end[0] + reach[0] >= 0.0 || end[1] + reach[1] >= 0.0)
                };
                (!same_place).then_some(hit.hit)
            }));
        }
        beyond
    }

    /// Returns the corners of a hit's face, and how far the error of t reaches beyond tnear and
    /// tfar. Negative if the limit is farther away than the error.
    fn reach(&self, rays: &RayBatch, &AtLimit { hit, t, .. }: &AtLimit) -> ([DVec3; 3], [f64; 2]) {
        let corners = arrays::corners(self.meshes[hit.mesh as usize].as_ref(), hit.face as usize);
        let [a, b, c] = corners;
        let (from, direction) = rays.line(hit.ray);
        let (to_a, e1, e2) = (a - DVec3::from(*from), b - a, c - a);
        // t is normal . to_a / normal . direction. The way to the hit is at most `distance`.
        let [distance, e1_length, e2_length] = [to_a, e1, e2].map(DVec3::length);
        let distance = distance + e1_length + e2_length;
        let slope = e1.cross(e2).dot((*direction).into()).abs();
        let error = T_ERROR * f64::EPSILON * distance * e1_length * e2_length / slope;
        let (tnear, tfar) = rays.limits(hit.ray);
        // A NaN becomes the other number.
        let error = error.min(MARGIN * t);
        (corners, [tnear, tfar].map(|limit| error - (t - limit).abs()))
    }
}

/// Whether t is so near to a limit of its ray that the error of t may decide whether it counts.
pub(super) fn is_near_limit(t: f64, (tnear, tfar): (f64, f64)) -> bool {
    let near = |limit: f64| (t - limit).abs() <= MARGIN * t;
    (tnear > 0.0 && near(tnear)) || near(tfar)
}
