//! Replays recorded rays on a backend: its time, its answers and its visits.

use std::hint::black_box;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::answer::Answer;
use super::query::answers;
use super::rays::{PacketToTrace, RayClass};
use crate::accel::{Accelerator, Visits};
use crate::lab::named::named;
use crate::parallel;
use crate::ray::{Coherence, LANES, Mask, RayPacket, Rays};

/// Number of packets between two readings of the clock.
///
/// Their copies stay in the cache, and reading the clock costs a thousandth of the fastest queries.
const BATCH: usize = 32;

named! {
    /// How rays are traced: single or in packets.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "lowercase")]
    pub enum Mode {
        /// Single rays, one query for each lane.
        Single = "single",
        /// Packets of 16 rays, with the coherence of their class.
        Packets = "packets",
    }
}

/// Rays of one class, traced in one mode.
#[derive(Debug, Clone, Copy)]
pub struct Replay<'a> {
    /// Class of the rays: decides the query and its coherence.
    pub class: RayClass,
    /// Single rays or packets.
    pub mode: Mode,
    /// The recorded packets of the class.
    pub packets: &'a [PacketToTrace],
}

impl Replay<'_> {
    /// Coherence that the queries announce to the backend.
    pub fn coherence(&self) -> Coherence {
        match self.mode {
            Mode::Single => Coherence::Single,
            Mode::Packets => self.class.coherence(),
        }
    }

    /// Times all queries on the current rayon pool: the seconds that its threads spend in queries,
    /// divided by the number of threads.
    ///
    /// The copies of the rays are not included. Neither is the refinement that a renderer adds to
    /// the backend's own answer ([`Accelerator::closest_unfiltered`]).
    pub fn seconds(&self, accelerator: &dyn Accelerator) -> f64 {
        let coherence = self.coherence();
        let spent = match self.class.is_shadow() {
            true => self.spent(&Rays::EMPTY, Rays::clone_from, |rays, active| {
                accelerator.occluded_unfiltered(active, rays, coherence);
            }),
            false => {
                let copy = |to: &mut RayPacket, rays: &Rays| {
                    to.rays.clone_from(rays);
                    to.clear_hits();
                };
                self.spent(&RayPacket::EMPTY, copy, |packet, active| {
                    accelerator.closest_unfiltered(active, packet, coherence);
                })
            }
        };
        spent.as_secs_f64() / rayon::current_num_threads() as f64
    }

    /// Sum of the times of `query` over all packets. It gets a copy of each, made by `copy`.
    fn spent<T: Clone + Send + Sync>(
        &self,
        empty: &T,
        copy: impl Fn(&mut T, &Rays) + Sync,
        query: impl Fn(&mut T, &Mask) + Sync,
    ) -> Duration {
        let times = parallel::map(self.packets.chunks(BATCH), |batch| {
            let mut scratch = vec![empty.clone(); BATCH];
            for (to, packet) in scratch.iter_mut().zip(batch) {
                copy(to, &packet.rays);
            }
            let started = Instant::now();
            for (to, packet) in scratch.iter_mut().zip(batch) {
                query(to, &packet.active);
            }
            let spent = started.elapsed();
            black_box(&scratch);
            spent
        });
        times.into_iter().sum()
    }

    /// Answers of every lane of every packet, computed on the current rayon pool.
    pub fn answers(&self, accelerator: &dyn Accelerator) -> Vec<[Answer; LANES]> {
        let (shadow, coherence) = (self.class.is_shadow(), self.coherence());
        let answers = |packet: &_| answers(accelerator, packet, shadow, coherence);
        let batches = parallel::map(self.packets.chunks(BATCH), |batch| {
            batch.iter().map(answers).collect::<Vec<_>>()
        });
        batches.concat()
    }

    /// Nodes and primitives visited by all queries; `None` if the backend cannot count them or
    /// there are no packets.
    pub fn visits(&self, accelerator: &dyn Accelerator) -> Option<Visits> {
        let (shadow, coherence) = (self.class.is_shadow(), self.coherence());
        let visits = |p: &PacketToTrace| accelerator.visits(&p.active, &p.rays, shadow, coherence);
        let add = |a: Visits, b: Visits| Visits {
            nodes: a.nodes + b.nodes,
            primitives: a.primitives + b.primitives,
        };
        let sum =
            |batch: &[PacketToTrace]| batch.iter().map(visits).reduce(|a, b| Some(add(a?, b?)));
        let sums = parallel::map(self.packets.chunks(BATCH), sum);
        sums.into_iter().flatten().reduce(|a, b| Some(add(a?, b?))).flatten()
    }
}
