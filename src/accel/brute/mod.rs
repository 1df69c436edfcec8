//! The oracle: tests every primitive against every ray with exact predicates.
//!
//! - A triangle is closed: its edges and corners belong to it, so a closed mesh is watertight.
//! - A triangle seen edge-on, without area along the ray, is never hit.
//! - The order of hits is exact as well. Of equally near hits, the lowest scene-wide primitive
//!   index wins.
//! - A quad is tested as its two triangles.
//! - A sphere is not exact. [`crate::geometry::Sphere::intersect`] solves the quadratic with some
//!   106 bits where f64 is not enough. `tests/library/hits/spheres.rs` compares it with integers.

mod blocks;
mod exact;
mod near;
mod triangle;

pub use self::exact::Fraction;
pub use self::near::{Near, Outline, near_primitive};

use std::cmp::Ordering;

use glam::DVec3;

use self::blocks::{Blocks, ROUNDING};
use self::triangle::{compare, crossing};
use super::accelerator::{Accelerator, BuildInfo, BuildOptions, over_limit};
use super::geometry_ref::GeometryRef;
use super::lane::{LaneHit, LaneRay, lanes};
use crate::error::Result;
use crate::geometry::{Box3, Geometry, GeometryKind, Unseen, on_quad_half};
use crate::monitor::Monitor;
use crate::parallel;
use crate::ray::{Coherence, Mask, RayPacket, Rays};

/// The oracle: closest hits and occlusion by exact tests of every primitive.
pub struct Brute<'g> {
    geometry: GeometryRef<'g>,
    blocks: Blocks,
    peak_bytes: u64,
}

/// A hit with what the exact comparison of two hits needs.
struct ExactHit {
    hit: LaneHit,
    /// Bound on the error of `hit.t`.
    t_error: f64,
    /// The triangle that was hit; `None` for a sphere.
    corners: Option<[DVec3; 3]>,
}

impl<'g> Brute<'g> {
    /// Sorts the primitives into blocks, on the threads of the current rayon pool.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        Self::build_part((geometry.into(), &Unseen::NONE), options, monitor)
    }

    /// [`Brute::build`] without the primitives in `unseen`.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build_part(
        (geometry, unseen): (GeometryRef<'g>, &Unseen),
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let peak_bytes = geometry.count() * (size_of::<Box3>() as u64 + 28);
        if let Some(limit) = options.max_bytes.filter(|&limit| peak_bytes > limit) {
            return Err(over_limit(limit));
        }
        let all = 0..geometry.count() as u32;
        let boxes = |count, primitive: &(dyn Fn(usize) -> u32 + Sync)| {
            let mut boxes = vec![Box3::EMPTY; count];
            parallel::fill(&mut boxes, |i| bounds(&geometry, primitive(i)));
            boxes
        };
        let blocks = if unseen.is_empty() {
            Blocks::new(&boxes(all.len(), &|i| i as u32))
        } else {
            let seen: Vec<u32> = all.filter(|&primitive| !unseen.has(primitive)).collect();
            Blocks::new(&boxes(seen.len(), &|i| seen[i])).renamed(&seen)
        };
        monitor.check()?;
        Ok(Self { geometry, blocks, peak_bytes })
    }

    /// Returns the geometry that the oracle was built over.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Returns all hits of the ray, nearest first. Ties are sorted by scene-wide primitive index.
    ///
    /// A `t` on a triangle or quad has a relative error of at most 2^-40. On a sphere, `t` is right
    /// to single precision. A sphere or quad counts once.
    pub fn all_hits(&self, ray: &LaneRay) -> Vec<LaneHit> {
        let mut all = Vec::new();
        self.each_hit(ray, |candidate| all.push(candidate));
        all.sort_by(|a, b| self.order(ray, a, b));
        all.into_iter().map(|candidate| candidate.hit).collect()
    }

    /// Returns the closest hit of the ray: the first of [`Brute::all_hits`].
    pub fn closest_hit(&self, ray: &LaneRay) -> Option<LaneHit> {
        let mut best: Option<ExactHit> = None;
        self.each_hit(ray, |candidate| {
            let nearer = |best| self.order(ray, &candidate, best) == Ordering::Less;
            if best.as_ref().is_none_or(nearer) {
                best = Some(candidate);
            }
        });
        best.map(|candidate| candidate.hit)
    }

    /// Returns all primitives that the line of the ray hits or nearly hits, at any t.
    ///
    /// The line nearly hits a primitive if a shift of the sheared corners can cause a hit. Each
    /// corner may move by `factor` times the error bound of the test.
    ///
    /// A sphere gives one entry for each of its roots. A flat primitive that the ray leaves gives
    /// none. Returns `None` if there are more than `most` entries.
    pub fn near(&self, ray: &LaneRay, factor: f64, most: usize) -> Option<Vec<Near>> {
        near::near(&self.geometry, &self.blocks, ray, factor, most)
    }

    fn each_hit(&self, ray: &LaneRay, mut found: impl FnMut(ExactHit)) {
        self.blocks.each(ray, ROUNDING, [ray.tnear, ray.tfar], |primitive| {
            if let Some(candidate) = self.test(ray, primitive) {
                found(candidate);
            }
        });
    }

    fn test(&self, ray: &LaneRay, primitive: u32) -> Option<ExactHit> {
        let (geom, prim) = self.geometry.place(primitive);
        let leaving = primitive == ray.leaving;
        let on_triangle = |(corners, turned): ([DVec3; 3], bool)| {
            let at = crossing(ray, &corners)?;
            let (u, v) = if turned { (1.0 - at.u, 1.0 - at.v) } else { (at.u, at.v) };
            // A packet holds f32 weights, which tell the half.
            let rounded = (u as f32, v as f32);
            let kept = on_quad_half(rounded.0, rounded.1, turned);
            let (u, v) = if kept == rounded { (u, v) } else { (kept.0.into(), kept.1.into()) };
            let hit = LaneHit { geom, prim, t: at.t, u, v, ng: at.ng };
            Some(ExactHit { hit, t_error: at.t_error(), corners: Some(corners) })
        };
        match self.geometry.kind(geom) {
            GeometryKind::Spheres => {
                let sphere = &self.geometry.spheres[prim as usize];
                let LaneRay { origin, direction, tnear, tfar, .. } = *ray;
                let t = sphere.intersect(origin, direction, tnear, tfar, leaving);
                let ng = origin + direction * t - sphere.center;
                let hit = LaneHit { geom, prim, t, u: 0.0, v: 0.0, ng };
                (!t.is_nan()).then_some(ExactHit { hit, t_error: 0.0, corners: None })
            }
            _ if leaving => None,
            _ => {
                let hits = self.geometry.triangles(geom, prim).filter_map(on_triangle);
                hits.reduce(|a, b| if self.order(ray, &b, &a) == Ordering::Less { b } else { a })
            }
        }
    }

    fn order(&self, ray: &LaneRay, a: &ExactHit, b: &ExactHit) -> Ordering {
        let by_t = match (&a.corners, &b.corners) {
            (Some(first), Some(second)) if (a.hit.t - b.hit.t).abs() <= a.t_error + b.t_error => {
                compare(ray, first, second)
            }
            _ => a.hit.t.total_cmp(&b.hit.t),
        };
        let number = |c: &ExactHit| self.geometry.primitive(c.hit.geom, c.hit.prim);
        by_t.then(number(a).cmp(&number(b)))
    }
}

fn bounds(geometry: &Geometry, primitive: u32) -> Box3 {
    let (geom, prim) = geometry.place(primitive);
    match geometry.kind(geom) {
        GeometryKind::Spheres => {
            let sphere = &geometry.spheres[prim as usize];
            // The box is widened by more than the error of the sphere test, for rays that start
            // within the scene.
            let radius =
                sphere.radius + (sphere.center.abs().max_element() + sphere.radius) * 1e-12;
            Box3::of_sphere(sphere.center, radius)
        }
        _ => Box3::around(geometry.triangles(geom, prim).map(|(corners, _)| Box3::of(&corners))),
    }
}

impl Accelerator for Brute<'_> {
    fn info(&self) -> BuildInfo {
        BuildInfo {
            version: "brute".into(),
            isa: "f64 and integers".into(),
            bytes: self.blocks.bytes(),
            peak_bytes: self.peak_bytes,
        }
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, _: Coherence) {
        for i in lanes(active) {
            if let Some(hit) = self.closest_hit(&LaneRay::of(&packet.rays, i)) {
                hit.store(packet, i);
            }
        }
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, _: Coherence) {
        for i in lanes(active) {
            let ray = LaneRay::of(rays, i);
            let mut any = false;
            self.each_hit(&ray, |_| any = true);
            if any {
                rays.tfar[i] = f32::NEG_INFINITY;
            }
        }
    }
}

#[cfg(test)]
mod tests;
