//! Which rays are checked: the scene's own and the aimed ones, in equal shares.

use super::aimed::Aim;
use super::source::Source;
use super::{Case, Check};
use crate::error::Result;
use crate::measure::random::Random;
use crate::measure::rays::{Class, Recorded, record};
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES};

/// All packets of a check, by number.
pub struct Plan<'g> {
    /// Those of the scene.
    recorded: Vec<(Class, Recorded)>,
    aim: Option<Aim<'g>>,
    /// Packets of each aimed source.
    each: usize,
    seed: i64,
}

impl<'g> Plan<'g> {
    /// Records the scene's rays and plans the others.
    ///
    /// # Errors
    /// `Interrupted` after a signal.
    pub fn new(check: &Check<'g>, monitor: &Monitor) -> Result<Self> {
        let Check { world, seed, .. } = *check;
        let kinds = Class::ALL.len() + Source::AIMED.len();
        let each = (check.rays / LANES as u64 / kinds as u64).clamp(1, u32::MAX.into()) as usize;
        // What the camera sees is found by the first backend: it is what starts the other rays.
        let first = check.contenders[0].accelerator;
        let recording = record(world, first, each, seed, monitor)?;
        let recorded = Class::ALL
            .into_iter()
            .flat_map(|class| recording.of(class).iter().map(move |r| (class, r.clone())))
            .collect();
        Ok(Self { recorded, aim: Aim::new(&world.geometry), each, seed })
    }

    /// How many there are.
    pub fn packets(&self) -> usize {
        let aimed = if self.aim.is_some() { Source::AIMED.len() * self.each } else { 0 };
        self.recorded.len() + aimed
    }

    /// The packet of a number below [`Plan::packets`].
    pub fn case(&self, index: usize) -> Case {
        let aimed = index.checked_sub(self.recorded.len()).zip(self.aim.as_ref());
        let Some((index, aim)) = aimed else {
            let (class, packet) = self.recorded[index].clone();
            let (shadow, coherence) = (class.is_shadow(), class.coherence());
            return Case { source: class.name().into(), shadow, coherence, packet };
        };
        let source = Source::AIMED[index / self.each];
        let mut random = Random::new(self.seed as u64, index as u64);
        let shadow = index % 2 == 1;
        let packet = aim.packet(source, shadow, &mut random);
        let coherence = Coherence::Incoherent;
        Case { source: source.name().into(), shadow, coherence, packet }
    }
}
