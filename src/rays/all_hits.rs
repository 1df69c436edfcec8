//! All hits along rays, and their number.

use rayon::prelude::*;

use super::batch::RayBatch;
use super::progress;
use super::refine::HitBatch;
use super::scene::RayScene;
use crate::accel::bvh::{Bvh, Crossing};
use crate::error::Result;
use crate::monitor::Monitor;
use crate::ray::LANES;
use crate::reserve;

/// All hits of rays, in order of their rays and of t. The hits of ray i have the indices from
/// `offsets[i]` to `offsets[i + 1]`, exclusive.
#[derive(Debug, Clone, PartialEq)]
pub struct AllHits {
    /// Index of the first hit of each ray, then the number of all hits.
    pub offsets: Vec<i64>,
    /// Ray parameter in units of the direction.
    pub t: Vec<f64>,
    /// Face in its mesh.
    pub primitive: Vec<i64>,
    /// Index of the mesh.
    pub mesh: Vec<i32>,
    /// Barycentric weights of the second and third corner, in [0, 1].
    pub barycentrics: Vec<[f64; 2]>,
}

impl RayScene {
    /// Finds all hits along each ray.
    ///
    /// Where a ray passes through an edge or a vertex, each crossing of the surface is one hit, of
    /// one of the triangles there. Where it only touches the surface at an edge or a vertex, and
    /// stays on one side, there are no hits or two with the same t. A triangle whose plane contains
    /// the direction of the ray has no hits; its neighbours have. So a ray without end, from
    /// outside a closed mesh, has an even number of hits.
    ///
    /// # Errors
    /// `Unsupported` with the backend Embree; `Retry` if there is too little memory; `Interrupted`
    /// if the monitor was stopped.
    pub fn all_hits(&self, rays: &RayBatch, monitor: &Monitor) -> Result<AllHits> {
        let bvh = self.bvh()?;
        let chunks = progress::in_chunks(rays.len(), monitor, |range| {
            let (mut found, mut hits) = (Vec::new(), ChunkHits::default());
            for first in range.clone().step_by(LANES) {
                let lanes = LANES.min(range.end - first);
                self.hits_of_packet(&bvh, rays, (first, lanes), &mut found, &mut hits);
            }
            hits
        })?;
        let total: usize = chunks.iter().map(|chunk| chunk.hits.len()).sum();
        let mut all = AllHits {
            offsets: Vec::new(),
            t: reserve::filled(0.0, total, "t")?,
            primitive: reserve::filled(0, total, "primitive")?,
            mesh: reserve::filled(0, total, "mesh")?,
            barycentrics: reserve::filled([0.0; 2], total, "barycentrics")?,
        };
        reserve::exact(&mut all.offsets, rays.len() + 1, "offsets")?;
        all.offsets.push(0);
        let mut end = 0;
        for count in chunks.iter().flat_map(|chunk| &chunk.counts) {
            end += i64::from(*count);
            all.offsets.push(end);
        }
        let (mut t, mut primitive) = (&mut all.t[..], &mut all.primitive[..]);
        let (mut mesh, mut weights) = (&mut all.mesh[..], &mut all.barycentrics[..]);
        let mut parts = Vec::with_capacity(chunks.len());
        for chunk in &chunks {
            let count = chunk.hits.len();
            let ids = (first_part(&mut primitive, count), first_part(&mut mesh, count));
            let values = (first_part(&mut t, count), first_part(&mut weights, count));
            parts.push((&chunk.hits, ids, values));
        }
        parts.into_par_iter().for_each(|(hits, (primitive, mesh), (t, weights))| {
            for (i, hit) in hits.iter().enumerate() {
                let place = self.place(hit.primitive);
                (mesh[i], primitive[i]) = (place.0 as i32, place.1 as i64);
                (t[i], weights[i]) = (hit.t, hit.barycentrics);
            }
        });
        Ok(all)
    }

    /// Returns the number of hits along each ray: see [`RayScene::all_hits`].
    ///
    /// # Errors
    /// The errors of [`RayScene::all_hits`].
    pub fn count(&self, rays: &RayBatch, monitor: &Monitor) -> Result<Vec<u32>> {
        let bvh = self.bvh()?;
        let mut counts = reserve::filled(0u32, rays.len(), "count")?;
        progress::fill(&mut counts, monitor, |first, counts| {
            let mut found = Vec::new();
            for (packet, counts) in counts.chunks_mut(LANES).enumerate() {
                let rounded = self.round(rays, first + packet * LANES);
                found.clear();
                bvh.crossings(&rounded.active, &rounded.packet.rays, &mut found);
                found.iter().for_each(|crossing| counts[crossing.lane as usize] += 1);
            }
        })?;
        Ok(counts)
    }

    fn hits_of_packet(
        &self,
        bvh: &Bvh,
        rays: &RayBatch,
        (first, lanes): (usize, usize),
        found: &mut Vec<Crossing>,
        hits: &mut ChunkHits,
    ) {
        let rounded = self.round(rays, first);
        found.clear();
        bvh.crossings(&rounded.active, &rounded.packet.rays, found);
        let mut start = hits.hits.len();
        for found in found.chunks(LANES) {
            let mut batch = HitBatch::EMPTY;
            for hit in found {
                let lane = hit.lane as usize;
                let t = rounded.t(lane, hit.t);
                batch.push(first + lane, hit.primitive, t, [f64::NAN; 2]);
            }
            let refined = self.refine(rays, &batch);
            hits.hits.extend((0..batch.count).map(|i| RayHit {
                t: refined.t[i],
                primitive: batch.primitives[i],
                barycentrics: refined.weights(i),
            }));
        }
        let mut rest = &found[..];
        for lane in 0..lanes {
            let count = rest.iter().take_while(|hit| hit.lane as usize == lane).count();
            rest = &rest[count..];
            let own = &mut hits.hits[start..start + count];
            own.sort_unstable_by(|a, b| {
                a.t.total_cmp(&b.t).then_with(|| a.primitive.cmp(&b.primitive))
            });
            start += count;
            hits.counts.push(count as u32);
        }
    }
}

/// Cuts the first `count` elements off.
fn first_part<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (first, others) = std::mem::take(rest).split_at_mut(count);
    *rest = others;
    first
}

/// The hits of one task.
#[derive(Default)]
struct ChunkHits {
    /// Number of hits of each ray.
    counts: Vec<u32>,
    hits: Vec<RayHit>,
}

/// A hit of a ray.
struct RayHit {
    t: f64,
    /// Index of the triangle in the scene.
    primitive: u32,
    barycentrics: [f64; 2],
}
