//! Packets of rays with their queries, and the functions that trace them.

use std::time::{Duration, Instant};

use super::answer::Answer;
use super::rays::PacketToTrace;
use crate::accel::Accelerator;
use crate::ray::{Coherence, LANES, Mask, RayPacket};

/// A packet with its query.
#[derive(Debug, Clone)]
pub struct QueryPacket {
    /// Name of the source of the rays.
    pub source: String,
    /// Whether the query is `occluded`, not `closest`.
    pub shadow: bool,
    /// Coherence of the packet in the renderer.
    pub coherence: Coherence,
    /// The rays before the query.
    pub packet: PacketToTrace,
}

impl QueryPacket {
    /// Traces a copy of the packet with `coherence`. Returns the answers of all lanes:
    /// [`Answer::Miss`] for lanes that are not active.
    pub fn answers(&self, accelerator: &dyn Accelerator, coherence: Coherence) -> [Answer; LANES] {
        answers(accelerator, &self.packet, self.shadow, coherence)
    }
}

/// Traces a copy of a packet and returns the answers of all lanes: [`Answer::Miss`] for lanes that
/// are not active.
pub fn answers(
    accelerator: &dyn Accelerator,
    packet: &PacketToTrace,
    shadow: bool,
    coherence: Coherence,
) -> [Answer; LANES] {
    let mut traced = RayPacket { rays: packet.rays.clone(), ..RayPacket::EMPTY };
    trace(accelerator, &packet.active, &mut traced, shadow, coherence);
    std::array::from_fn(|i| match packet.active.0[i] {
        0 => Answer::Miss,
        _ => Answer::in_lane(&traced, i, shadow),
    })
}

/// Traces a packet by `occluded` if `shadow`, else by `closest`. Returns the time of the query.
pub fn trace(
    accelerator: &dyn Accelerator,
    active: &Mask,
    packet: &mut RayPacket,
    shadow: bool,
    coherence: Coherence,
) -> Duration {
    let started = Instant::now();
    match shadow {
        true => accelerator.occluded(active, &mut packet.rays, coherence),
        false => accelerator.closest(active, packet, coherence),
    }
    started.elapsed()
}
