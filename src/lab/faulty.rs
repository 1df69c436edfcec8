//! A backend that gives wrong answers on purpose, for tests.

use crate::accel::brute::Brute;
use crate::accel::lane::{LaneHit, LaneRay, lanes};
use crate::accel::{Accelerator, BuildInfo};
use crate::ray::{Coherence, Hits, Mask, NONE, RayPacket, Rays};

/// Fault of a backend.
#[derive(Clone, Copy, PartialEq)]
pub enum BackendFault {
    /// All answers are right.
    None,
    /// Never hits one primitive: geometry id, index in the geometry.
    Misses(u32, u32),
    /// Lane 3 always misses.
    MissesLane3,
    /// Misses everything along directions shorter than 1e-29.
    MissesTiny,
    /// Reports a hit for every miss.
    HitsInsteadOfMisses,
    /// Swaps the two primitives of the first geometry.
    OtherPrimitive,
    /// Lane 5 reports primitive 0 of the geometry that it hits.
    FirstPrimitiveInLane5,
    /// Reports the mirrored place on every quad, which lies on the quad's other half.
    OtherHalf,
    /// Every t is multiplied by this factor.
    ScalesT(f64),
    /// Writes to lane 7, even if it is not active.
    WritesLane7,
}

/// The oracle with a fault.
pub struct Faulty<'a>(pub &'a Brute<'a>, pub BackendFault);

impl Faulty<'_> {
    /// Returns the closest hit of one ray, before the faults of single lanes.
    fn hit(&self, ray: &LaneRay) -> Option<LaneHit> {
        let Self(oracle, fault) = *self;
        if fault == BackendFault::MissesTiny && ray.direction.length() < 1e-29 {
            return None;
        }
        let missed = |hit: &LaneHit| fault == BackendFault::Misses(hit.geom, hit.prim);
        let mut hit = oracle.all_hits(ray).into_iter().find(|hit| !missed(hit))?;
        match fault {
            BackendFault::OtherPrimitive if hit.geom == 0 => hit.prim = 1 - hit.prim,
            BackendFault::ScalesT(factor) => hit.t *= factor,
            BackendFault::OtherHalf => (hit.u, hit.v) = (1.0 - hit.u, 1.0 - hit.v),
            _ => {}
        }
        Some(hit)
    }
}

impl Accelerator for Faulty<'_> {
    fn info(&self) -> BuildInfo {
        BuildInfo::default()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, _: Coherence) {
        let before = packet.rays.tfar;
        for i in lanes(active) {
            match self.hit(&LaneRay::of(&packet.rays, i)) {
                Some(hit) => hit.store(packet, i),
                None if self.1 == BackendFault::HitsInsteadOfMisses => {
                    (packet.hits.geom[i], packet.hits.prim[i]) = (0, 0);
                    packet.rays.tfar[i] = 1.0;
                }
                None => {}
            }
        }
        match self.1 {
            BackendFault::MissesLane3 => {
                (packet.hits.geom[3], packet.rays.tfar[3]) = (NONE, before[3])
            }
            BackendFault::FirstPrimitiveInLane5 => packet.hits.prim[5] = 0,
            BackendFault::WritesLane7 => packet.rays.tfar[7] = 1.0,
            _ => {}
        }
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        let mut packet = RayPacket { rays: rays.clone(), hits: Hits::EMPTY };
        self.closest(active, &mut packet, coherence);
        for i in lanes(active).filter(|&i| packet.hits.geom[i] != NONE) {
            rays.tfar[i] = f32::NEG_INFINITY;
        }
    }
}
