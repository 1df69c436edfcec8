//! What a render cost: `--stats`, `--json` and the summary at the end.

use std::collections::BTreeMap;

use serde::Serialize;

use super::units;

/// The file of `--stats`. docs/guide/cli.md describes it.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Stats {
    /// Wall-clock time.
    pub seconds: Seconds,
    /// Rays traced.
    pub rays: Rays,
    /// Camera samples per pixel, where their number differs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<Samples>,
    /// Memory held.
    pub memory: Memory,
    /// Of all meshes and single triangles.
    pub triangles: u64,
    /// Name of the backend.
    pub backend: String,
    /// Worker threads.
    pub threads: usize,
    /// Of the program and what it was built and run with.
    pub versions: BTreeMap<String, String>,
    /// Model name of the processor.
    pub cpu: String,
    /// Instruction sets in use.
    pub isa: String,
    /// SHA-256 of the canonical scene.
    pub scene_hash: String,
    /// Of every random choice.
    pub seed: i64,
}

/// Wall-clock seconds by phase.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Seconds {
    /// Scene, meshes, textures.
    pub load: f64,
    /// Accelerator.
    pub build: f64,
    /// Rays and shading.
    pub render: f64,
    /// EXR and PNG.
    pub write: f64,
    /// From the start of the command to the renamed files.
    pub total: f64,
}

/// Rays by class.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Rays {
    /// From the camera.
    pub primary: u64,
    /// Towards lights.
    pub shadow: u64,
    /// Mirror bounces.
    pub reflection: u64,
    /// Hits that the backend's test in f32 offered and f64 discarded.
    pub false_hits: u64,
}

/// Camera samples per pixel.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Samples {
    /// The fewest.
    pub least: u32,
    /// The most.
    pub most: u32,
    /// On average.
    pub mean: f64,
}

/// Bytes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Memory {
    /// Largest resident set of the process (`VmHWM`); 0 where the system does not tell.
    pub peak_bytes: u64,
    /// Held by the accelerator after its build.
    pub accelerator_bytes: u64,
    /// Most that the accelerator held during its build.
    pub accelerator_peak_bytes: u64,
    /// Primitives and vertex data.
    pub mesh_bytes: u64,
    /// Textures.
    pub texture_bytes: u64,
}

impl Stats {
    /// A few lines for people.
    pub fn summary(&self) -> String {
        let s = &self.seconds;
        let all = self.rays.primary + self.rays.shadow + self.rays.reflection;
        let rate = all as f64 / s.render.max(1e-9) / 1e6;
        format!(
            "{} triangles, {} ({}), {} threads\n\
             load {:.2} s, build {:.2} s, render {:.2} s, write {:.2} s, total {}\n\
             {}rays: {} primary, {} shadow, {} reflection; {rate:.1} Mray/s{}\n\
             peak memory {} (accelerator {}, meshes {}, textures {})",
            units::count(self.triangles),
            self.backend,
            self.isa,
            self.threads,
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
            units::count(self.rays.primary),
            units::count(self.rays.shadow),
            units::count(self.rays.reflection),
            match self.rays.false_hits {
                0 => String::new(),
                n => format!("; {} false hits discarded", units::count(n)),
            },
            units::bytes(self.memory.peak_bytes),
            units::bytes(self.memory.accelerator_bytes),
            units::bytes(self.memory.mesh_bytes),
            units::bytes(self.memory.texture_bytes),
        )
    }
}

/// Model name of the processor; the architecture where the system does not tell.
pub fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == "model name").then(|| value.trim().to_string())
    });
    name.unwrap_or_else(|| std::env::consts::ARCH.to_string())
}
