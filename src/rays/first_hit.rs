//! Closest hits and occlusion.

use rayon::prelude::*;
use std::sync::atomic::Ordering::Relaxed;

use super::batch::RayBatch;
use super::filling::{Filling, Part};
use super::further::Unanswered;
use super::progress::{self, CHUNK};
use super::refine::{FoundHit, Refined};
use super::rounded::{Rounded, Rounding};
use super::scene::RayScene;
use crate::accel::Accelerator;
use crate::error::Result;
use crate::monitor::{Monitor, Phase};
use crate::ray::{LANES, Mask, RayPacket};
use crate::reserve;

/// The closest hits of rays, an element for each ray.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstHits {
    /// Ray parameter in units of the direction; infinite for a miss. On a face without area, such
    /// as a stitch, it is rounded to f32.
    pub t: Vec<f64>,
    /// Face in its mesh; -1 for a miss. In a [`Mesh`](crate::Mesh) the stitches follow the
    /// triangles.
    pub primitive: Vec<i64>,
    /// Index of the mesh; -1 for a miss.
    pub mesh: Vec<i32>,
    /// Barycentric weights of the second and third corner, in [0, 1]; NaN for a miss.
    pub barycentrics: Vec<[f64; 2]>,
    /// Unit normal `(v1 - v0) x (v2 - v0)`; 0 for a miss. NaN for a face without area.
    pub normal: Vec<[f64; 3]>,
}

impl RayScene {
    /// Finds the closest hit of each ray. Edges and vertices belong to all their triangles. Of
    /// hits of equal t, `bvh` returns that of the lowest mesh and then the lowest face. A
    /// triangle that contains the origin of a ray is not hit at t = 0, if f32 can represent the
    /// origin.
    ///
    /// # Errors
    /// `Invalid` for a value of a ray: an origin that is not finite or beyond 1e18, a direction
    /// that is not finite or has length 0, a limit that is negative or NaN.
    /// `Retry` if there is too little memory; `Interrupted` if the monitor was stopped.
    pub fn closest(&self, rays: &RayBatch, monitor: &Monitor) -> Result<FirstHits> {
        let count = rays.len();
        let (accelerator, rounding) = (self.accelerator(), self.rounding(rays)?);
        let margin = self.margin();
        monitor.begin(Phase::Check, count as u64);
        let lengths = || (0..count).step_by(CHUNK).map(|first| CHUNK.min(count - first));
        let mut t = Filling::new(count, "t")?;
        let mut primitive = Filling::new(count, "primitive")?;
        let mut mesh = Filling::new(count, "mesh")?;
        let mut barycentrics = Filling::new(count, "barycentrics")?;
        let mut normal = Filling::new(count, "normal")?;
        let ids = primitive.parts(lengths()).into_par_iter().zip(mesh.parts(lengths()));
        let weights = barycentrics.parts(lengths()).into_par_iter();
        let places = weights.zip(normal.parts(lengths()));
        let chunks = t.parts(lengths()).into_par_iter().zip(ids).zip(places).enumerate();
        let begin = || (Rounded::EMPTY, Vec::with_capacity(CHUNK), Answers::new());
        chunks.try_for_each_init(begin, |(rounded, found, answers), (chunk, parts)| {
            monitor.check()?;
            let mut limited = false;
            let ((t, (primitive, mesh)), (barycentrics, normal)) = parts;
            let range = chunk * CHUNK..chunk * CHUNK + t.room();
            let output = Output { t, primitive, mesh, barycentrics, normal };
            found.clear();
            for first in range.clone().step_by(LANES) {
                output.prefetch(first - range.start);
                rounding.round(first, rounded)?;
                limited |= rounded.limited.any();
                let Rounded { active, packet, coherence, .. } = rounded;
                accelerator.closest(active, packet, *coherence);
                self.collect_hits(first, rounded, found);
            }
            answers.clear();
            let mut left = Vec::new();
            self.refine(rays, found, margin, |hits, refined| {
                answers.store(range.start, hits, refined, &mut left);
            });
            if limited {
                let start = range.start;
                let is_answered = |ray| [false, answers.t[ray - start] < f64::INFINITY];
                self.leave_strays(&rounding, range.clone(), &mut left, is_answered)?;
            }
            if !left.is_empty() {
                self.search_on(&*accelerator, &rounding, left, |hits, refined, i| {
                    answers.store_nearer(range.start, &hits[i], refined, i);
                })?;
            }
            output.fill(answers);
            monitor.done.fetch_add(range.len() as u64, Relaxed);
            Ok(())
        })?;
        Ok(FirstHits {
            t: t.finish(),
            primitive: primitive.finish(),
            mesh: mesh.finish(),
            barycentrics: barycentrics.finish(),
            normal: normal.finish(),
        })
    }

    /// Appends the hits of a packet, whose first ray has the index `first`, to `found`.
    #[inline(always)]
    pub(super) fn collect_hits(&self, first: usize, rounded: &Rounded, found: &mut Vec<FoundHit>) {
        let RayPacket { rays, hits } = &rounded.packet;
        let hit = rounded.packet.hit(&rounded.active);
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            let (mesh, face) = (hits.geom[i], hits.prim[i]);
            self.prefetch_face(mesh, face);
            found.push(FoundHit { ray: first + i, mesh, face, t: rays.tfar[i] });
        }
    }

    /// Returns whether each ray hits anything. Faster than [`RayScene::closest`].
    ///
    /// # Errors
    /// The errors of [`RayScene::closest`].
    pub fn occluded(&self, rays: &RayBatch, monitor: &Monitor) -> Result<Vec<bool>> {
        let (accelerator, rounding) = (self.accelerator(), self.rounding(rays)?);
        let mut occluded = reserve::filled(false, rays.len(), "occluded")?;
        progress::fill(&mut occluded, monitor, |start, occluded| {
            let (mut rounded, mut left) = (Rounded::EMPTY, Vec::new());
            for (packet, occluded) in occluded.chunks_mut(LANES).enumerate() {
                let first = start + packet * LANES;
                rounding.round(first, &mut rounded)?;
                let hit = if rounded.limited.any() {
                    self.hits_within(&*accelerator, &rounding, first, &mut rounded, &mut left)?
                } else {
                    rounded.hits_any(&*accelerator)
                };
                for (occluded, hit) in occluded.iter_mut().zip(hit.0) {
                    *occluded = hit != 0;
                }
            }
            let store = |hits: &[FoundHit], _: &Refined, i: usize| {
                occluded[hits[i].ray - start] = true;
            };
            self.search_on(&*accelerator, &rounding, left, store)
        })?;
        Ok(occluded)
    }

    /// Returns the rays of a packet that certainly hit anything within their limits. Appends those
    /// that may to `left`. `rounded` holds the packet, whose first ray has the index `first`, and
    /// is changed.
    ///
    /// # Errors
    /// The errors of [`Rounding::round`].
    fn hits_within(
        &self,
        accelerator: &dyn Accelerator,
        rounding: &Rounding,
        first: usize,
        rounded: &mut Rounded,
        left: &mut Vec<Unanswered>,
    ) -> Result<Mask> {
        let limited = rounded.limited;
        let mut unsure = Mask::NONE;
        if let Ok(bvh) = self.bvh() {
            let (mut strays, lanes) = (Vec::new(), rounding.at_limits(first, &limited));
            self.strays(&bvh, &rounded.packet.rays, &lanes, true, &mut strays);
            strays.iter().for_each(|stray| unsure.0[stray.lane as usize] = -1);
        }
        let hit = rounded.hits_any(accelerator).without(&unsure);
        let mut doubtful = hit.and(&limited);
        if doubtful.any() {
            rounding.shortened().round(first, rounded)?;
            rounded.active = rounded.active.and(&doubtful);
            doubtful = doubtful.without(&self.hits_surely(accelerator, rounding, first, rounded));
        }
        let hit = hit.without(&doubtful);
        let lanes = (0..LANES).filter(|&i| unsure.0[i] | doubtful.0[i] != 0);
        left.extend(lanes.map(|i| Unanswered { ray: first + i, last: None }));
        Ok(hit)
    }

    /// Returns the active rays, of those that have no strays, that certainly hit anything.
    /// `rounded` holds shortened rays, and is changed.
    fn hits_surely(
        &self,
        accelerator: &dyn Accelerator,
        rounding: &Rounding,
        first: usize,
        rounded: &mut Rounded,
    ) -> Mask {
        if self.bvh().is_ok() {
            return rounded.hits_any(accelerator);
        }
        // Embree does not tell strays. So the t of a hit decides.
        let Rounded { active, packet, coherence, .. } = rounded;
        accelerator.closest(active, packet, *coherence);
        let (mut found, mut hit) = (Vec::new(), Mask::NONE);
        self.collect_hits(first, rounded, &mut found);
        self.refine(rounding.rays(), &found, self.margin(), |hits, refined| {
            for (found, counts) in hits.iter().zip(refined.counts) {
                hit.0[found.ray - first] = -i32::from(counts);
            }
        });
        hit
    }
}

impl Rounded {
    /// Returns the active rays that hit anything. Changes their tfar.
    #[inline(always)]
    fn hits_any(&mut self, accelerator: &dyn Accelerator) -> Mask {
        let Self { active, packet, coherence, .. } = self;
        accelerator.occluded(active, &mut packet.rays, *coherence);
        let mut hit = Mask::NONE;
        for i in 0..LANES {
            hit.0[i] = active.0[i] & -i32::from(packet.rays.tfar[i] == f32::NEG_INFINITY);
        }
        hit
    }
}

/// The answers of a task, in the order of its rays.
struct Answers {
    t: Vec<f64>,
    primitive: Vec<i64>,
    mesh: Vec<i32>,
    barycentrics: Vec<[f64; 2]>,
    normal: Vec<[f64; 3]>,
}

impl Answers {
    fn new() -> Self {
        Self {
            t: vec![0.0; CHUNK],
            primitive: vec![0; CHUNK],
            mesh: vec![0; CHUNK],
            barycentrics: vec![[0.0; 2]; CHUNK],
            normal: vec![[0.0; 3]; CHUNK],
        }
    }

    /// Makes all answers misses.
    fn clear(&mut self) {
        self.t.fill(f64::INFINITY);
        self.primitive.fill(-1);
        self.mesh.fill(-1);
        self.barycentrics.fill([f64::NAN; 2]);
        self.normal.fill([0.0; 3]);
    }

    /// Stores the hits that count, and appends rays for which others must be searched to `left`.
    /// `first` is the index of the task's first ray.
    #[inline(always)]
    fn store(
        &mut self,
        first: usize,
        hits: &[FoundHit],
        refined: &Refined,
        left: &mut Vec<Unanswered>,
    ) {
        for (i, hit) in hits.iter().enumerate() {
            if refined.counts[i] {
                self.store_hit(first, hit, refined, i);
            }
            left.extend(Unanswered::around(hit, refined, i));
        }
    }

    /// Stores hit `i` of those whose values were computed, if it comes before the answer so far.
    fn store_nearer(&mut self, first: usize, hit: &FoundHit, refined: &Refined, i: usize) {
        let at = hit.ray - first;
        let (place, best) =
            ((hit.mesh as i32, hit.face.into()), (self.mesh[at], self.primitive[at]));
        if refined.t[i] < self.t[at] || (refined.t[i] == self.t[at] && place < best) {
            self.store_hit(first, hit, refined, i);
        }
    }

    /// Stores hit `i` of those whose values were computed.
    #[inline(always)]
    fn store_hit(&mut self, first: usize, hit: &FoundHit, refined: &Refined, i: usize) {
        let at = hit.ray - first;
        (self.t[at], self.primitive[at]) = (refined.t[i], hit.face.into());
        (self.mesh[at], self.barycentrics[at]) = (hit.mesh as i32, refined.weights(i));
        self.normal[at] = refined.normal(i);
    }
}

/// Where the answers of a task go.
struct Output<'a> {
    t: Part<'a, f64>,
    primitive: Part<'a, i64>,
    mesh: Part<'a, i32>,
    barycentrics: Part<'a, [f64; 2]>,
    normal: Part<'a, [f64; 3]>,
}

impl Output<'_> {
    /// Prefetches the memory of the packet that begins at ray `i` of the task. Else the stores of
    /// its answers would wait for memory, and later loads for the stores.
    #[inline(always)]
    fn prefetch(&self, i: usize) {
        self.t.prefetch(i, LANES);
        self.primitive.prefetch(i, LANES);
        self.mesh.prefetch(i, LANES);
        self.barycentrics.prefetch(i, LANES);
        self.normal.prefetch(i, LANES);
    }

    /// Writes all answers.
    fn fill(mut self, answers: &Answers) {
        let count = self.t.room();
        self.t.extend(&answers.t[..count]);
        self.primitive.extend(&answers.primitive[..count]);
        self.mesh.extend(&answers.mesh[..count]);
        self.barycentrics.extend(&answers.barycentrics[..count]);
        self.normal.extend(&answers.normal[..count]);
    }
}
