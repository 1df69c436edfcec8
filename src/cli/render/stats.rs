//! Statistics of a render: `--stats`, `--json` and the summary at the end.

use std::collections::BTreeMap;

use serde::Serialize;

use crate::render::{RayCounts, SampleCounts};
use crate::units;

/// Content of the `--stats` file, described in docs/guide/cli.md.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Stats {
    pub seconds: Seconds,
    pub rays: RayStats,
    /// Samples per pixel, if their number varies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<SampleCounts>,
    pub memory: MemoryStats,
    /// Triangles of all meshes, and single triangles.
    pub triangles: u64,
    pub backend: String,
    /// Number of worker threads.
    pub threads: usize,
    /// Versions of the program, its compiler and its backend.
    pub versions: BTreeMap<String, String>,
    pub cpu: String,
    /// Instruction sets of rays and of shading.
    pub isa: String,
    /// SHA-256 of the canonical scene.
    pub scene_hash: String,
    /// Seed of all random choices.
    pub seed: i64,
}

/// Wall-clock seconds by phase.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Seconds {
    /// Reading the scene, meshes and textures.
    pub load: f64,
    /// Time to build the accelerator.
    pub build: f64,
    /// Time to trace and shade.
    pub render: f64,
    /// Time to write the files.
    pub write: f64,
    /// From the start of the command until the files have their final names.
    pub total: f64,
}

/// Numbers of rays by class.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct RayStats {
    /// Rays that were traced.
    #[serde(flatten)]
    pub counts: RayCounts,
    /// Hits that the backend's f32 test reported and the f64 test rejected.
    pub false_hits: u64,
}

/// Memory use in bytes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct MemoryStats {
    /// Largest resident set of the process (`VmHWM`); 0 if the system does not report it.
    pub peak_bytes: u64,
    /// Accelerator after its build.
    pub accelerator_bytes: u64,
    /// Peak of the accelerator during its build.
    pub accelerator_peak_bytes: u64,
    /// Primitives and vertex data.
    pub mesh_bytes: u64,
    pub texture_bytes: u64,
}

impl Stats {
    /// Formats a summary of a few lines for the terminal.
    pub fn summary(&self) -> String {
        let s = &self.seconds;
        let RayStats { counts, false_hits } = self.rays;
        let rate = counts.all() as f64 / s.render.max(1e-9) / 1e6;
        format!(
            "{}, {} ({}), {}\n\
             load {:.2} s, build {:.2} s, render {:.2} s, write {:.2} s, total {}\n\
             {}rays: {} primary, {} shadow, {} reflection; {rate:.1} Mray/s{}\n\
             peak memory {} (accelerator {}, meshes {}, textures {})",
            units::plural(self.triangles as usize, "triangle"),
            self.backend,
            self.isa,
            units::plural(self.threads, "thread"),
            s.load,
            s.build,
            s.render,
            s.write,
            units::duration(s.total),
            match &self.samples {
                Some(n) => format!(
                    "samples per pixel: {} to {}, {:.1} on average\n",
                    n.least, n.most, n.mean
                ),
                None => String::new(),
            },
            units::count(counts.primary),
            units::count(counts.shadow),
            units::count(counts.reflection),
            match false_hits {
                0 => String::new(),
                n => format!("; {} discarded", units::plural(n as usize, "false hit")),
            },
            units::bytes(self.memory.peak_bytes),
            units::bytes(self.memory.accelerator_bytes),
            units::bytes(self.memory.mesh_bytes),
            units::bytes(self.memory.texture_bytes),
        )
    }
}
