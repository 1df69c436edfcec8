//! Closest hits and occlusion.

use rayon::prelude::*;
use std::sync::atomic::Ordering::Relaxed;

use super::batch::RayBatch;
use super::progress::{self, CHUNK};
use super::refine::HitBatch;
use super::scene::RayScene;
use crate::accel::Accelerator;
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
    /// `Retry` if there is too little memory; `Interrupted` if the monitor was stopped.
    pub fn closest(&self, rays: &RayBatch, monitor: &Monitor) -> Result<FirstHits> {
        let count = rays.len();
        let mut hits = FirstHits {
            t: reserve::filled(0.0, count, "t")?,
            primitive: reserve::filled(0, count, "primitive")?,
            mesh: reserve::filled(0, count, "mesh")?,
            barycentrics: reserve::filled([0.0; 2], count, "barycentrics")?,
            normal: reserve::filled([0.0; 3], count, "normal")?,
        };
        let accelerator = self.accelerator();
        monitor.begin(Phase::Check, count as u64);
        let t = hits.t.par_chunks_mut(CHUNK);
        let ids = hits.primitive.par_chunks_mut(CHUNK).zip(hits.mesh.par_chunks_mut(CHUNK));
        let places = hits.barycentrics.par_chunks_mut(CHUNK);
        let chunks = t.zip(ids).zip(places.zip(hits.normal.par_chunks_mut(CHUNK)));
        chunks.enumerate().try_for_each(|(chunk, ((t, (primitive, mesh)), (uv, normal)))| {
            monitor.check()?;
            let length = t.len();
            let mut chunk = HitChunk { first: chunk * CHUNK, t, primitive, mesh, uv, normal };
            let packets = (0..length).step_by(LANES);
            packets.for_each(|i| self.closest_of_packet(&*accelerator, rays, &mut chunk, i));
            monitor.done.fetch_add(length as u64, Relaxed);
            Ok(())
        })?;
        Ok(hits)
    }

    fn closest_of_packet(
        &self,
        accelerator: &dyn Accelerator,
        rays: &RayBatch,
        chunk: &mut HitChunk,
        at: usize,
    ) {
        let first = chunk.first + at;
        let mut rounded = self.round(rays, first);
        let active = rounded.active;
        accelerator.closest(&active, &mut rounded.packet, rounded.coherence);
        let hit = rounded.packet.hit(&active);
        let found = &rounded.packet.hits;
        let mut hits = HitBatch::EMPTY;
        for i in 0..LANES.min(chunk.t.len() - at) {
            let out = at + i;
            if hit.0[i] == 0 {
                (chunk.t[out], chunk.primitive[out], chunk.mesh[out]) = (f64::INFINITY, -1, -1);
                (chunk.uv[out], chunk.normal[out]) = ([f64::NAN; 2], [0.0; 3]);
                continue;
            }
            let (mesh, face) = (found.geom[i], found.prim[i]);
            (chunk.primitive[out], chunk.mesh[out]) = (face.into(), mesh as i32);
            let primitive = self.geometry().primitive(mesh, face);
            let t = rounded.t(i, rounded.packet.rays.tfar[i].into());
            hits.push(first + i, primitive, t, [found.u[i].into(), found.v[i].into()]);
        }
        if hits.count == 0 {
            return;
        }
        let refined = self.refine(rays, &hits);
        for i in 0..hits.count {
            let out = hits.rays[i] - chunk.first;
            (chunk.t[out], chunk.uv[out]) = (refined.t[i], refined.weights(i));
            chunk.normal[out] = refined.normal(i);
        }
    }

    /// Returns whether each ray hits anything. Faster than [`RayScene::closest`].
    ///
    /// # Errors
    /// The errors of [`RayScene::closest`].
    pub fn occluded(&self, rays: &RayBatch, monitor: &Monitor) -> Result<Vec<bool>> {
        let accelerator = self.accelerator();
        let mut occluded = reserve::filled(false, rays.len(), "occluded")?;
        progress::fill(&mut occluded, monitor, |first, occluded| {
            for (packet, occluded) in occluded.chunks_mut(LANES).enumerate() {
                let mut rounded = self.round(rays, first + packet * LANES);
                let active = rounded.active;
                accelerator.occluded(&active, &mut rounded.packet.rays, rounded.coherence);
                for (i, occluded) in occluded.iter_mut().enumerate() {
                    let end = rounded.packet.rays.tfar[i];
                    *occluded = active.0[i] != 0 && end == f32::NEG_INFINITY;
                }
            }
        })?;
        Ok(occluded)
    }
}

/// The output of one task.
struct HitChunk<'a> {
    /// Number of the first ray.
    first: usize,
    t: &'a mut [f64],
    primitive: &'a mut [i64],
    mesh: &'a mut [i32],
    uv: &'a mut [[f64; 2]],
    normal: &'a mut [[f64; 3]],
}
