//! What a task of a job needs: memory and time, estimated before it runs.

use std::ops::RangeInclusive;

use crate::accel::memory_footprint;
use crate::batch::{self, Job, JournalRecord};
use crate::error::Result;
use crate::integrate::TILE;
use crate::render::{Adaptive, sampling};
use crate::scene::{CheckedLight, LightKind};

/// Rays that one thread traces per second, and triangles that it reads and builds per second.
/// docs/notebook/scaling.md has the measurements. The numbers only affect the frames per task.
const RAYS_PER_SECOND: f64 = 5e6;
const TRIANGLES_PER_SECOND: f64 = 1.8e6;

/// Estimated needs of a task.
pub struct Needs {
    /// Memory of the largest input alone in bytes.
    pub peak: u64,
    /// Time of a frame in seconds.
    pub frame_seconds: f64,
    /// Camera rays per frame: one range for each size and `spp` of the job. Only the noise of a
    /// frame and an overscan make a range more than a number.
    pub camera_rays: Vec<RangeInclusive<u64>>,
}

impl Needs {
    /// Estimates the memory from the headers of all inputs, and the time from the first input, with
    /// `cpus` threads. Inputs that cannot be read are skipped: they fail in their task.
    ///
    /// # Errors
    /// The first error, if no input can be read.
    pub fn of(job: &Job, cpus: u16) -> Result<Self> {
        let mut needs = Self { peak: 0, frame_seconds: 0.0, camera_rays: Vec::new() };
        let mut first_error = None;
        for task in batch::tasks(job.inputs.len(), job.frames(), None)? {
            let (scene, prediction) = match batch::predict(job, &task) {
                Ok(known) => known,
                Err(error) => {
                    first_error = first_error.or(Some(error));
                    continue;
                }
            };
            let footprint = memory_footprint(scene.backend, usize::from(cpus));
            // Embree may be missing here and present on the nodes. Its memory is then assumed to be
            // half of the predicted rest.
            let peak = match footprint {
                Ok(footprint) => prediction.clone().with(&footprint).peak_bytes,
                Err(_) => prediction.peak_bytes + prediction.peak_bytes / 2,
            };
            needs.peak = needs.peak.max(peak);
            let poses = job.poses.iter().flat_map(|poses| &poses.list);
            let sizes = poses.map(|pose| pose.camera.size());
            let sizes = sizes.chain([[scene.camera.width, scene.camera.height]]);
            let around = |side: u32| u64::from(side) + 2 * u64::from(job.overscan);
            let adaptive = sampling::adaptive(&job.sampling, &scene).ok().flatten();
            // Packets of up to 4 x 4 pixels are traced whole where the window of an overscan
            // begins, where the frame ends, and where the window ends; with noise perhaps tiles.
            let cut = if adaptive.is_some() { TILE } else { 4 };
            let beyond = if job.overscan > 0 { 3 * u64::from(cut - 1) } else { 0 };
            let pixels = sizes
                .map(|[width, height]| [width, height].map(around))
                .map(|[w, h]| [w * h, (w + beyond) * (h + beyond)]);
            let [least, most] = match adaptive {
                // The estimate of the brightness takes at most as many again as the first pass.
                Some(Adaptive { first, most, .. }) => [first, first + most],
                None => [scene.spp; 2],
            };
            let range = |[few, many]: [u64; 2]| few * u64::from(least)..=many * u64::from(most);
            needs.camera_rays.extend(pixels.map(range));
            if needs.frame_seconds == 0.0 {
                let pixels = around(scene.camera.width) * around(scene.camera.height);
                let points = |light: &CheckedLight| match light.kind {
                    LightKind::Point { .. } => 1.0,
                    LightKind::Area { samples, .. }
                    | LightKind::Sun { samples, .. }
                    | LightKind::Environment { samples, .. } => f64::from(samples),
                };
                let spp = adaptive.map_or(scene.spp, |adaptive| adaptive.first);
                let lights: f64 = scene.lights.iter().map(points).sum();
                let rays = pixels as f64 * f64::from(spp) * (1.0 + lights);
                let triangles = prediction.primitives as f64 / f64::from(job.frames());
                let alone = rays / RAYS_PER_SECOND + triangles / TRIANGLES_PER_SECOND;
                needs.frame_seconds = alone / f64::from(cpus);
            }
        }
        match first_error {
            Some(error) if needs.peak == 0 => Err(error),
            _ => Ok(needs),
        }
    }

    /// Returns the memory of a task in bytes.
    pub fn memory(&self) -> u64 {
        // A batch holds up to two meshes: the next one loads while the current one renders. A
        // quarter of both is the reserve.
        let both = self.peak.saturating_mul(2);
        both.saturating_add(both / 4)
    }
}

/// Returns the seconds per frame by the journals of earlier runs: the median of a frame, and its
/// share of the median of loading and building a mesh for `per_mesh` frames. `None` without frames.
///
/// Only frames within one of the ranges of `camera_rays` count: others have another size or `spp`.
pub fn frame_seconds(
    journal: impl IntoIterator<Item = JournalRecord>,
    per_mesh: u64,
    camera_rays: &[RangeInclusive<u64>],
) -> Option<f64> {
    let (mut frames, mut meshes) = (Vec::new(), Vec::new());
    let is_of_job = |rays: &u64| camera_rays.iter().any(|range| range.contains(rays));
    for record in journal {
        match record {
            JournalRecord::Frame(frame) if frame.rays.get("primary").is_some_and(&is_of_job) => {
                frames.push(frame.render_s + frame.write_s);
            }
            JournalRecord::Mesh(mesh) => meshes.push(mesh.load_s + mesh.build_s),
            _ => {}
        }
    }
    let share = median(meshes).unwrap_or(0.0) / per_mesh.max(1) as f64;
    median(frames).map(|frame| frame + share).filter(|seconds| *seconds > 0.0)
}

/// Returns the upper median; `None` of nothing.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_its_share_of_loading_and_building() {
        let record = |json: &str| serde_json::from_str::<JournalRecord>(json).unwrap();
        let mesh = record(
            r#"{"event": "mesh", "input": "a.ply", "triangles": 1, "load_s": 5, "build_s": 1,
                "bytes": 1, "camera": null, "warnings": []}"#,
        );
        let frame = |seconds: f64| {
            record(&format!(
                r#"{{"event": "frame", "index": 0, "input": "a.ply", "frame": 0, "outputs": [],
                    "render_s": {seconds}, "write_s": 0.5, "rays": {{"primary": 96}},
                    "peak_bytes": 1, "warnings": []}}"#
            ))
        };
        let rays = [96..=96, 200..=300];
        let all = || [mesh.clone(), frame(9.0), frame(1.0), frame(2.0)];
        assert_eq!(frame_seconds(all(), 1, &rays), Some(8.5));
        assert_eq!(frame_seconds(all(), 4, &rays), Some(4.0));
        assert_eq!(frame_seconds([mesh.clone()], 1, &rays), None);
        assert_eq!(frame_seconds([frame(3.0)], 1, &rays), Some(3.5));
        // Frames of a preview do not count.
        assert_eq!(frame_seconds(all(), 1, &rays[1..]), None);
        assert_eq!(frame_seconds(all(), 1, &[90..=100]), Some(8.5));
    }
}
