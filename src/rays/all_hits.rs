//! All hits along rays, and their number.

use super::batch::RayBatch;
use super::filling::Filling;
use super::progress;
use super::refine::FoundHit;
use super::rounded::{Rounded, Rounding};
use super::scene::RayScene;
use crate::accel::bvh::{Bvh, Crossing};
use crate::error::Result;
use crate::monitor::Monitor;
use crate::parallel;
use crate::ray::LANES;
use crate::reserve;

/// All hits of rays, in order of their rays and of t. The hits of ray i have the indices from
/// `offsets[i]` to `offsets[i + 1]`, exclusive.
#[derive(Debug, Clone, PartialEq)]
pub struct AllHits {
    /// Index of the first hit of each ray, then the number of all hits.
    pub offsets: Vec<i64>,
    /// Ray parameter in units of the direction, as [`FirstHits::t`](super::FirstHits::t).
    pub t: Vec<f64>,
    /// Face in its mesh, as [`FirstHits::primitive`](super::FirstHits::primitive).
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
    /// the direction of the ray has no hits; its neighbours have. At a stitch, which closes a
    /// T-junction, one crossing of the surface may be three hits. So a ray without end, from
    /// outside a closed mesh, has an even number of hits.
    ///
    /// # Errors
    /// `Unsupported` with the backend Embree, and the errors of [`RayScene::closest`].
    pub fn all_hits(&self, rays: &RayBatch, monitor: &Monitor) -> Result<AllHits> {
        let bvh = self.bvh()?;
        let rounding = self.rounding(rays)?;
        let chunks = progress::in_chunks(rays.len(), monitor, |range| {
            let (mut rounded, mut crossings) = (Rounded::EMPTY, Vec::new());
            let mut found = Vec::new();
            for first in range.clone().step_by(LANES) {
                rounding.round(first, &mut rounded)?;
                crossings.clear();
                bvh.crossings(&rounded.active, &rounded.packet.rays, &mut crossings);
                self.add_strays(&bvh, &rounding, first, &rounded, &mut crossings);
                reserve::growing(&mut found, crossings.len(), "hits")?;
                self.collect_crossings(first, &crossings, &mut found);
            }
            let (mut counts, mut hits) = (vec![0; range.len()], Vec::new());
            reserve::exact(&mut hits, found.len(), "hits")?;
            self.refine(rays, &found, 0.0, |found, refined| {
                for (i, hit) in found.iter().enumerate().filter(|(i, _)| refined.counts[*i]) {
                    counts[hit.ray - range.start] += 1;
                    hits.push(RayHit {
                        t: refined.t[i],
                        mesh: hit.mesh,
                        face: hit.face,
                        barycentrics: refined.weights(i),
                    });
                }
            });
            Ok(ChunkHits::new(counts, hits))
        })?;
        let total: usize = chunks.iter().map(|chunk| chunk.hits.len()).sum();
        let mut offsets = Vec::new();
        reserve::exact(&mut offsets, rays.len() + 1, "offsets")?;
        offsets.push(0);
        let mut end = 0;
        for count in chunks.iter().flat_map(|chunk| &chunk.counts) {
            end += i64::from(*count);
            offsets.push(end);
        }
        let lengths = || chunks.iter().map(|chunk| chunk.hits.len());
        let mut t = Filling::new(total, "t")?;
        let mut primitive = Filling::new(total, "primitive")?;
        let mut mesh = Filling::new(total, "mesh")?;
        let mut barycentrics = Filling::new(total, "barycentrics")?;
        let ids = primitive.parts(lengths()).into_iter().zip(mesh.parts(lengths()));
        let values = t.parts(lengths()).into_iter().zip(barycentrics.parts(lengths()));
        let parts = chunks.iter().zip(ids).zip(values);
        parallel::each(parts, |((chunk, (mut primitive, mut mesh)), (mut t, mut barycentrics))| {
            for hit in &chunk.hits {
                mesh.extend(&[hit.mesh as i32]);
                primitive.extend(&[hit.face.into()]);
                t.extend(&[hit.t]);
                barycentrics.extend(&[hit.barycentrics]);
            }
        });
        Ok(AllHits {
            offsets,
            t: t.finish(),
            primitive: primitive.finish(),
            mesh: mesh.finish(),
            barycentrics: barycentrics.finish(),
        })
    }

    /// Returns the number of hits along each ray: see [`RayScene::all_hits`].
    ///
    /// # Errors
    /// The errors of [`RayScene::all_hits`].
    pub fn count(&self, rays: &RayBatch, monitor: &Monitor) -> Result<Vec<u32>> {
        let bvh = self.bvh()?;
        let mut counts = reserve::filled(0u32, rays.len(), "count")?;
        let rounding = self.rounding(rays)?;
        progress::fill(&mut counts, monitor, |first, counts| {
            let (mut rounded, mut crossings) = (Rounded::EMPTY, Vec::new());
            let mut found = Vec::new();
            for (packet, counts) in counts.chunks_mut(LANES).enumerate() {
                let first = first + packet * LANES;
                rounding.round(first, &mut rounded)?;
                crossings.clear();
                bvh.crossings(&rounded.active, &rounded.packet.rays, &mut crossings);
                if !rounded.limited.any() {
                    crossings.iter().for_each(|crossing| counts[crossing.lane as usize] += 1);
                    continue;
                }
                self.add_strays(&bvh, &rounding, first, &rounded, &mut crossings);
                found.clear();
                self.collect_crossings(first, &crossings, &mut found);
                self.refine(rays, &found, 0.0, |found, refined| {
                    for (hit, counting) in found.iter().zip(refined.counts) {
                        counts[hit.ray - first] += u32::from(counting);
                    }
                });
            }
            Ok(())
        })?;
        Ok(counts)
    }

    /// Adds the crossings of a packet's rays that stray from their limits, in order of the rays.
    fn add_strays(
        &self,
        bvh: &Bvh,
        rounding: &Rounding,
        first: usize,
        rounded: &Rounded,
        crossings: &mut Vec<Crossing>,
    ) {
        if !rounded.limited.any() {
            return;
        }
        let (rays, mut strays) = (&rounded.packet.rays, Vec::new());
        let lanes = rounding.at_limits(first, &rounded.limited);
        self.strays(bvh, rays, &lanes, false, &mut strays);
        // The others are among the crossings.
        strays.retain(|stray| {
            let i = stray.lane as usize;
            stray.t <= rays.tnear[i].into() || stray.t >= rays.tfar[i].into()
        });
        if !strays.is_empty() {
            strays.sort_unstable_by_key(|stray| (stray.lane, stray.primitive));
            strays.dedup_by_key(|stray| (stray.lane, stray.primitive));
            crossings.extend(strays);
            crossings.sort_by_key(|crossing| crossing.lane);
        }
    }

    /// Appends the crossings of a packet, whose first ray has the index `first`, to `found`.
    pub(super) fn collect_crossings(
        &self,
        first: usize,
        crossings: &[Crossing],
        found: &mut Vec<FoundHit>,
    ) {
        found.extend(crossings.iter().map(|crossing| {
            let (mesh, face) = self.geometry().place(crossing.primitive);
            self.prefetch_face(mesh, face);
            let (ray, t) = (first + crossing.lane as usize, crossing.t as f32);
            FoundHit { ray, mesh, face, t }
        }));
    }
}

/// The hits of one task.
struct ChunkHits {
    /// Number of hits of each ray.
    counts: Vec<u32>,
    hits: Vec<RayHit>,
}

impl ChunkHits {
    /// Sorts the hits of each ray.
    fn new(counts: Vec<u32>, mut hits: Vec<RayHit>) -> Self {
        let mut rest = &mut hits[..];
        for &count in &counts {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(count as usize);
            own.sort_unstable_by(|a, b| {
                a.t.total_cmp(&b.t).then((a.mesh, a.face).cmp(&(b.mesh, b.face)))
            });
            rest = others;
        }
        Self { counts, hits }
    }
}

/// A hit of a ray.
struct RayHit {
    t: f64,
    mesh: u32,
    /// Face in the mesh.
    face: u32,
    barycentrics: [f64; 2],
}
