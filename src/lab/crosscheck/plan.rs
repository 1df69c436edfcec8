//! The packets of a check: rays of the scene and aimed rays. Each class and source has the same
//! largest number of packets.

use super::aimed::Aim;
use super::check::CrossCheck;
use super::source::RaySource;
use crate::error::Result;
use crate::lab::query::QueryPacket;
use crate::lab::random::Random;
use crate::lab::rays::{PacketToTrace, RayClass, record};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES};

/// All packets of a check, by index. Aimed packets are generated on demand.
pub struct CheckPackets<'g> {
    /// The recorded packets of the scene.
    recorded: Vec<(RayClass, PacketToTrace)>,
    aim: Option<Aim<'g>>,
    /// Number of packets for each aimed source.
    each: usize,
    seed: i64,
}

impl<'g> CheckPackets<'g> {
    /// Records the rays of the scene, and plans the aimed rays.
    ///
    /// # Errors
    /// `Interrupted` after a signal.
    pub fn new(check: &CrossCheck<'g>, monitor: &Monitor) -> Result<Self> {
        let CrossCheck { world, seed, .. } = *check;
        let kinds = RayClass::ALL.len() + RaySource::ALL.len();
        let each = (check.rays / LANES as u64 / kinds as u64).clamp(1, u32::MAX.into()) as usize;
        // The first backend finds the camera hits, from which the other rays start.
        let first = check.built_backends[0].accelerator;
        let recording = record(world, first, each, seed, monitor)?;
        let recorded = RayClass::ALL
            .into_iter()
            .flat_map(|class| recording.packets(class).iter().map(move |r| (class, r.clone())))
            .collect();
        Ok(Self { recorded, aim: Aim::new(&world.geometry), each, seed })
    }

    /// Number of packets, recorded and aimed.
    pub fn packets(&self) -> usize {
        let aimed = if self.aim.is_some() { RaySource::ALL.len() * self.each } else { 0 };
        self.recorded.len() + aimed
    }

    /// Returns packet `index`, which must be below [`CheckPackets::packets`].
    pub fn case(&self, index: usize) -> QueryPacket {
        let aimed = index.checked_sub(self.recorded.len()).zip(self.aim.as_ref());
        let Some((index, aim)) = aimed else {
            let (class, packet) = self.recorded[index].clone();
            let (shadow, coherence) = (class.is_shadow(), class.coherence());
            return QueryPacket { source: class.name().into(), shadow, coherence, packet };
        };
        let source = RaySource::ALL[index / self.each];
        let mut random = Random::new(self.seed as u64, index as u64);
        // Every source has both kinds, if it has more than one packet.
        let shadow = index % self.each % 2 == 1;
        let packet = aim.packet(source, shadow, &mut random);
        let coherence = Coherence::Unordered;
        QueryPacket { source: source.name().into(), shadow, coherence, packet }
    }
}
