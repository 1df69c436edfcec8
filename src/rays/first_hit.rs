//! Closest hits and occlusion.

use rayon::prelude::*;
use std::sync::atomic::Ordering::Relaxed;

use super::batch::RayBatch;
use super::filling::{Filling, Part};
use super::progress::{self, CHUNK};
use super::refine::HitBatch;
use super::rounded::Rounded;
use super::scene::RayScene;
use crate::error::Result;
use crate::monitor::{Monitor, Phase};
use crate::ray::LANES;
use crate::reserve;

/// The closest hits of rays, an element for each ray.
#[derive(Debug, Clone, PartialEq)]
pub struct FirstHits {
    /// Ray parameter in units of the direction; infinite for a miss.
    pub t: Vec<f64>,
    /// Face in its mesh; -1 for a miss.
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
    /// equally near hits, `bvh` returns that of the lowest mesh and then the lowest face. A
    /// triangle that contains the origin of a ray is not hit at t = 0, if f32 can represent the
    /// origin.
    ///
    /// # Errors
    /// `Invalid` for a value of a ray: an origin that is not finite or beyond 1e18, a direction
    /// that is not finite or has length 0, a limit that is negative or NaN, an infinite `tnear`.
    /// `Retry` if there is too little memory; `Interrupted` if the monitor was stopped.
    pub fn closest(&self, rays: &RayBatch, monitor: &Monitor) -> Result<FirstHits> {
        let count = rays.len();
        let (accelerator, rounding) = (self.accelerator(), self.rounding(rays)?);
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
        chunks.try_for_each(|(chunk, ((t, (primitive, mesh)), (barycentrics, normal)))| {
            monitor.check()?;
            let first = chunk * CHUNK;
            let range = first..first + t.room();
            let mut chunk = HitChunk { t, primitive, mesh, barycentrics, normal };
            let mut rounded = Rounded::EMPTY;
            for first in range.clone().step_by(LANES) {
                chunk.prefetch();
                rounding.round(first, &mut rounded)?;
                let Rounded { active, packet, coherence, .. } = &mut rounded;
                accelerator.closest(active, packet, *coherence);
                let hits = self.hits_in_f64(rays, first, &rounded);
                chunk.extend(&hits, LANES.min(range.end - first));
            }
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

    /// The hits of a packet whose first ray has the index `first`.
    fn hits_in_f64(&self, rays: &RayBatch, first: usize, rounded: &Rounded) -> PacketHits {
        let hit = rounded.packet.hit(&rounded.active);
        let found = &rounded.packet.hits;
        let mut out = PacketHits::MISSES;
        let (mut hits, mut lanes) = (HitBatch::EMPTY, [0; LANES]);
        for i in 0..LANES {
            if hit.0[i] == 0 {
                continue;
            }
            let (mesh, face) = (found.geom[i], found.prim[i]);
            (out.primitive[i], out.mesh[i]) = (face.into(), mesh as i32);
            let primitive = self.geometry().primitive(mesh, face);
            let t = rounded.t(i, rounded.packet.rays.tfar[i].into());
            lanes[hits.count] = i;
            hits.push(first + i, primitive, t, [found.u[i].into(), found.v[i].into()]);
        }
        if hits.count == 0 {
            return out;
        }
        let refined = self.refine(rays, &hits);
        for (i, &lane) in lanes.iter().enumerate().take(hits.count) {
            (out.t[lane], out.barycentrics[lane]) = (refined.t[i], refined.weights(i));
            out.normal[lane] = refined.normal(i);
        }
        out
    }

    /// Returns whether each ray hits anything. Faster than [`RayScene::closest`].
    ///
    /// # Errors
    /// The errors of [`RayScene::closest`].
    pub fn occluded(&self, rays: &RayBatch, monitor: &Monitor) -> Result<Vec<bool>> {
        let (accelerator, rounding) = (self.accelerator(), self.rounding(rays)?);
        let mut occluded = reserve::filled(false, rays.len(), "occluded")?;
        progress::fill(&mut occluded, monitor, |first, occluded| {
            let mut rounded = Rounded::EMPTY;
            for (packet, occluded) in occluded.chunks_mut(LANES).enumerate() {
                rounding.round(first + packet * LANES, &mut rounded)?;
                let Rounded { active, packet, coherence, .. } = &mut rounded;
                accelerator.occluded(active, &mut packet.rays, *coherence);
                for (i, occluded) in occluded.iter_mut().enumerate() {
                    let end = packet.rays.tfar[i];
                    *occluded = active.0[i] != 0 && end == f32::NEG_INFINITY;
                }
            }
            Ok(())
        })?;
        Ok(occluded)
    }
}

/// The hits of 16 rays, by lane.
struct PacketHits {
    t: [f64; LANES],
    primitive: [i64; LANES],
    mesh: [i32; LANES],
    barycentrics: [[f64; 2]; LANES],
    normal: [[f64; 3]; LANES],
}

impl PacketHits {
    const MISSES: Self = Self {
        t: [f64::INFINITY; LANES],
        primitive: [-1; LANES],
        mesh: [-1; LANES],
        barycentrics: [[f64::NAN; 2]; LANES],
        normal: [[0.0; 3]; LANES],
    };
}

/// The output of one task.
struct HitChunk<'a> {
    t: Part<'a, f64>,
    primitive: Part<'a, i64>,
    mesh: Part<'a, i32>,
    barycentrics: Part<'a, [f64; 2]>,
    normal: Part<'a, [f64; 3]>,
}

impl HitChunk<'_> {
    /// Prefetches the memory of the next packet. Else its stores would wait for memory, and later
    /// loads for the stores.
    #[inline(always)]
    fn prefetch(&self) {
        self.t.prefetch(LANES);
        self.primitive.prefetch(LANES);
        self.mesh.prefetch(LANES);
        self.barycentrics.prefetch(LANES);
        self.normal.prefetch(LANES);
    }

    /// Appends the first `count` hits of a packet.
    #[inline(always)]
    fn extend(&mut self, hits: &PacketHits, count: usize) {
        self.t.extend(&hits.t[..count]);
        self.primitive.extend(&hits.primitive[..count]);
        self.mesh.extend(&hits.mesh[..count]);
        self.barycentrics.extend(&hits.barycentrics[..count]);
        self.normal.extend(&hits.normal[..count]);
    }
}
