//! Replaces false closest hits by the closest true hit.
//!
//! The ray is traced again with a filter that rejects every candidate. So Embree visits all
//! candidates along the ray, and neither a false hit nor a wrong t hides a farther hit.

use super::candidate::Candidate;
use super::filter::{ClosestTrueHit, HitFilter, PassedTriangle};
use super::{Embree, NO_HIT, ffi, ray};
use crate::geometry::{GeometryKind, NONE, Surfaces, on_quad_half, refine, refine_triangle};
use crate::ray::{Coherence, LANES, Mask, RayPacket};

impl Embree<'_> {
    /// Replaces every false hit by the closest true hit. For other hits of triangles and quads,
    /// replaces Embree's t by its value computed in f64, clamped to `tnear` and `tfar`.
    ///
    /// `tfar` holds the ends of the rays before the query.
    pub(super) fn retrace_rejected(
        &self,
        active: &Mask,
        packet: &mut RayPacket,
        tfar: &[f32; LANES],
    ) {
        let hit = packet.hit(active);
        if !hit.any() {
            return;
        }
        let mut surfaces = Surfaces::EMPTY;
        refine(&self.truth.geometry, &hit, packet, &mut surfaces);
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            let end = std::mem::replace(&mut packet.rays.tfar[i], tfar[i]);
            if surfaces.doubtful.0[i] != 0 {
                self.retrace_lane(packet, i);
            } else if self.truth.geometry.kind(packet.hits.geom[i]) == GeometryKind::Spheres {
                packet.rays.tfar[i] = end;
            } else {
                packet.rays.tfar[i] = surfaces.t[i].max(packet.rays.tnear[i]).min(tfar[i]);
            }
        }
    }

    #[cold]
    fn retrace_lane(&self, packet: &mut RayPacket, i: usize) {
        let look = ClosestTrueHit::new(&self.truth);
        let mut single = ffi::RtcRayHit { ray: ray(&packet.rays, i), hit: NO_HIT };
        // SAFETY: aligned to 16 bytes and laid out as Embree's.
        self.query(Coherence::Single, Some(HitFilter::ClosestTrueHit(&look)), |args| unsafe {
            (self.scene.api().intersect1)(self.scene.handle(), &mut single, args);
        });
        // Spheres call no filter, so `single` holds the closest sphere.
        let mut hit = single.hit;
        let mut end = f64::from(single.ray.tfar);
        let triangle =
            look.best().filter(|(found, _)| hit.geom_id == NONE || found.passing.t < end);
        if let Some((found, candidate)) = triangle {
            end = found.passing.t;
            (hit.geom_id, hit.prim_id) = (candidate.geom, candidate.prim);
            (hit.u, hit.v, hit.ng) = weights(&found, &candidate);
        }
        packet.rays.tfar[i] = end as f32;
        (packet.hits.u[i], packet.hits.v[i]) = (hit.u, hit.v);
        (packet.hits.prim[i], packet.hits.geom[i]) = (hit.prim_id, hit.geom_id);
        for (lanes, n) in packet.hits.ng.iter_mut().zip(hit.ng) {
            lanes[i] = n;
        }
    }
}

/// Returns u and v as Embree defines them, and a unit normal, computed in f64.
fn weights(found: &PassedTriangle, candidate: &Candidate) -> (f32, f32, [f32; 3]) {
    let turn = |u: f64| if found.turned { 1.0 - u } else { u };
    let reported = (turn(candidate.u.into()), turn(candidate.v.into()));
    let Candidate { origin, direction, .. } = *candidate;
    let point = refine_triangle(found.corners, origin, direction, reported);
    let (u, v) = on_quad_half(turn(point.u) as f32, turn(point.v) as f32, found.turned);
    (u, v, point.normal.as_vec3().to_array())
}
