//! Recorded rays through a backend: how long it takes, what it answers, what it visits.

use std::hint::black_box;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::rays::{Class, Recorded};
use crate::accel::{Accelerator, Visits};
use crate::ray::{Coherence, LANES, NONE, RayPacket, Rays};

/// Packets between two looks at the clock: so few that their copies stay in the cache, so many that
/// the clock costs nothing (a thousandth of the fastest queries).
const BATCH: usize = 32;

/// How rays are handed over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Each alone.
    Single,
    /// 16 at a time, and whether they are coherent.
    Packets,
}

impl Mode {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Single, Self::Packets];

    /// As reports name it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "single",
            Self::Packets => "packets",
        }
    }
}

/// What a backend says of one ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Whether it meets anything.
    pub hit: bool,
    /// Geometry of the closest hit; [`NONE`] for a miss or a shadow ray.
    pub geom: u32,
    /// Primitive within it.
    pub prim: u32,
    /// Where on the ray.
    pub t: f32,
}

impl Answer {
    /// A miss, or no ray.
    pub const MISS: Self = Self { hit: false, geom: NONE, prim: NONE, t: f32::INFINITY };
}

/// Rays of one class, handed over in one way.
#[derive(Debug, Clone, Copy)]
pub struct Replay<'a> {
    /// What they are.
    pub class: Class,
    /// How.
    pub mode: Mode,
    /// The rays.
    pub packets: &'a [Recorded],
}

impl Replay<'_> {
    /// What the backend is told.
    pub fn coherence(&self) -> Coherence {
        match self.mode {
            Mode::Single => Coherence::Single,
            Mode::Packets => self.class.coherence(),
        }
    }

    /// Seconds of all queries on the threads of the current rayon pool: what the threads spent in
    /// them, divided by the number of threads. Copying the rays is not in it; neither is what a
    /// renderer adds to a backend's own answer ([`Accelerator::closest_candidates`]).
    pub fn seconds(&self, accelerator: &dyn Accelerator) -> f64 {
        let coherence = self.coherence();
        let spent: Duration = match self.class.is_shadow() {
            true => self
                .packets
                .par_chunks(BATCH)
                .map_init(
                    || vec![Rays::EMPTY; BATCH],
                    |scratch, batch| {
                        for (rays, packet) in scratch.iter_mut().zip(batch) {
                            rays.clone_from(&packet.rays);
                        }
                        let started = Instant::now();
                        for (rays, packet) in scratch.iter_mut().zip(batch) {
                            accelerator.occluded_candidates(&packet.active, rays, coherence);
                        }
                        let spent = started.elapsed();
                        black_box(&scratch);
                        spent
                    },
                )
                .sum(),
            false => self
                .packets
                .par_chunks(BATCH)
                .map_init(
                    || vec![RayPacket::EMPTY; BATCH],
                    |scratch, batch| {
                        for (to, packet) in scratch.iter_mut().zip(batch) {
                            to.rays.clone_from(&packet.rays);
                            to.clear_hits();
                        }
                        let started = Instant::now();
                        for (to, packet) in scratch.iter_mut().zip(batch) {
                            accelerator.closest_candidates(&packet.active, to, coherence);
                        }
                        let spent = started.elapsed();
                        black_box(&scratch);
                        spent
                    },
                )
                .sum(),
        };
        spent.as_secs_f64() / rayon::current_num_threads() as f64
    }

    /// An answer per lane of every packet, on the threads of the current rayon pool.
    pub fn answers(&self, accelerator: &dyn Accelerator) -> Vec<[Answer; LANES]> {
        let (shadow, coherence) = (self.class.is_shadow(), self.coherence());
        let packets = self.packets.par_iter();
        packets.map(|packet| answers(accelerator, packet, shadow, coherence)).collect()
    }

    /// What is visited in all, where the backend can tell.
    pub fn visits(&self, accelerator: &dyn Accelerator) -> Option<Visits> {
        let (shadow, coherence) = (self.class.is_shadow(), self.coherence());
        let visits = |p: &Recorded| accelerator.visits(&p.active, &p.rays, shadow, coherence);
        let add = |a: Visits, b: Visits| Visits {
            nodes: a.nodes + b.nodes,
            primitives: a.primitives + b.primitives,
        };
        self.packets
            .par_iter()
            .map(visits)
            .try_reduce(Visits::default, |a, b| Some(add(a, b)))
            .filter(|_| !self.packets.is_empty())
    }
}

/// What `accelerator` says of one packet.
pub fn answers(
    accelerator: &dyn Accelerator,
    packet: &Recorded,
    shadow: bool,
    coherence: Coherence,
) -> [Answer; LANES] {
    let mut answers = [Answer::MISS; LANES];
    let mut traced = RayPacket { rays: packet.rays.clone(), ..RayPacket::EMPTY };
    match shadow {
        true => accelerator.occluded(&packet.active, &mut traced.rays, coherence),
        false => accelerator.closest(&packet.active, &mut traced, coherence),
    }
    for i in (0..LANES).filter(|&i| packet.active.0[i] != 0) {
        let (t, hits) = (traced.rays.tfar[i], &traced.hits);
        if shadow {
            answers[i].hit = t < 0.0;
        } else if hits.geom[i] != NONE {
            answers[i] = Answer { hit: true, geom: hits.geom[i], prim: hits.prim[i], t };
        }
    }
    answers
}
