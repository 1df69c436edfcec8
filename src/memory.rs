//! How much memory a render will need, from headers and the accelerator's footprint: said by `info`,
//! and held against `--max-memory` before the first mesh is read. And what the system says.

use std::{collections::HashSet, path::Path};

use serde::Serialize;

use crate::{
    accel::Footprint,
    error::{Error, Kind, Problem, Result},
    film::Window,
    layers::Plan,
    mesh,
    output::tonemap::Depth,
    scene::{Backend, Scene, ShapeKind, Smooth},
    shading::Texture,
};

use crate::{reserve::Room, units};

mod available;
mod freed;

pub use available::available_bytes;
use available::{available_bytes_and_swap, bytes_before_a_kill, kib};

/// R, G, B, A in f32.
const FILM_BYTES: u64 = 16;
/// 8-bit RGBA while the PNG is written.
const PNG_BYTES: u64 = 4;
/// The program, its threads, tables.
const BASE_BYTES: u64 = 30 << 20;
/// Predicted bytes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Prediction {
    /// Film and PNG.
    pub film_bytes: u64,
    /// Mesh arrays.
    pub mesh_bytes: u64,
    /// Decoded images.
    pub texture_bytes: u64,
    /// What decoding takes at most beside them.
    pub decoding_bytes: u64,
    /// The accelerator once built, if that is known.
    pub accelerator_bytes: Option<u64>,
    /// The most that its build holds.
    pub accelerator_peak_bytes: Option<u64>,
    /// The most at any time.
    pub peak_bytes: u64,
    /// Triangles of all shapes (a plane counts as two) and spheres.
    pub primitives: u64,
}

/// What a header promises, within what the file's size allows.
#[derive(Debug, Clone, Copy, Default)]
pub struct Promise {
    /// Bytes of vertex and index arrays.
    pub array_bytes: u64,
    /// Bytes of the vertex normals that the file does not have.
    pub missing_normal_bytes: u64,
    /// Triangles after splitting.
    pub triangles: u64,
}

/// Bytes that one byte of gzip data can stand for; more for zstd, but not of a mesh.
const MOST_PACKED: u64 = 1032;

/// Reads the header alone.
pub fn promise(path: &Path) -> Result<Promise> {
    let summary = mesh::inspect_ply(path)?;
    // The reader refuses a header that promises more rows than the file has bytes; a prediction
    // must not choke on it first.
    let most = match summary.packed {
        None => summary.file_bytes,
        Some(_) => summary.file_bytes.saturating_mul(MOST_PACKED),
    };
    let lies = summary.triangles.max(summary.vertices) > most;
    Ok(match lies {
        true => Promise::default(),
        false => Promise {
            array_bytes: summary.array_bytes,
            missing_normal_bytes: if summary.normals { 0 } else { 12 * summary.vertices },
            triangles: summary.triangles,
        },
    })
}

/// What a PNG of two bytes a channel needs beyond one of single bytes.
pub fn deeper_png_bytes(window: Window, depth: Depth) -> u64 {
    match depth {
        Depth::Eight => 0,
        Depth::Sixteen => {
            PNG_BYTES.saturating_mul(u64::from(window.width()) * u64::from(window.height()))
        }
    }
}

/// Looks at the headers of all files; leaves the accelerator out.
///
/// # Errors
/// Headers that cannot be read.
pub fn predict(scene: &Scene, window: Window) -> Result<Prediction> {
    predict_words(scene, window, Plan::new(scene).recipe.channels.len())
}

/// Film and PNG, with so many channels beside R, G, B, A.
pub fn film_bytes(window: Window, words: usize) -> u64 {
    let pixels = u64::from(window.width()) * u64::from(window.height());
    let words = words as u64;
    pixels.saturating_mul(words.saturating_mul(4).saturating_add(FILM_BYTES + PNG_BYTES))
}

/// The same with so many channels beside R, G, B, A.
///
/// # Errors
/// Headers that cannot be read.
pub fn predict_words(scene: &Scene, window: Window, words: usize) -> Result<Prediction> {
    let mut sum = Prediction { film_bytes: film_bytes(window, words), ..Prediction::default() };
    let mut problems = Vec::new();
    for shape in &scene.shapes {
        match &shape.kind {
            ShapeKind::Trimesh(mesh) => {
                let promise = promise(&mesh.path).unwrap_or_else(|error| {
                    problems.extend(error.problems);
                    Default::default()
                });
                sum.primitives = sum.primitives.saturating_add(promise.triangles);
                let normals =
                    if mesh.smooth != Smooth::Off { promise.missing_normal_bytes } else { 0 };
                let bytes = promise.array_bytes.saturating_add(normals);
                sum.mesh_bytes = sum.mesh_bytes.saturating_add(bytes);
            }
            ShapeKind::Sphere { .. } | ShapeKind::Triangle { .. } => sum.primitives += 1,
            ShapeKind::Plane { .. } => sum.primitives += 2,
        }
    }
    if !problems.is_empty() {
        return Err(Error { kind: Kind::Invalid, problems });
    }
    textures(scene, &mut sum);
    Ok(sum.with_peak())
}

/// What a mesh alone needs, whatever the scene around it: said before the mesh is read for its
/// framing.
///
/// # Errors
/// A header that cannot be read.
pub fn predict_mesh(path: &Path) -> Result<Prediction> {
    let promise = promise(path)?;
    Ok(Prediction {
        mesh_bytes: promise.array_bytes,
        primitives: promise.triangles,
        ..Prediction::default()
    }
    .with_peak())
}

/// The images of all materials that shapes use, each as often as it is loaded; files that are no
/// images are complained about later.
fn textures(scene: &Scene, sum: &mut Prediction) {
    let used = scene.shapes.iter().map(|shape| &scene.materials[shape.material]);
    let used = used.filter_map(|m| m.texture.as_ref());
    let keys: HashSet<_> = used.map(|t| (t.path.as_path(), t.color_space)).collect();
    for (path, _) in keys {
        if let Ok(size) = Texture::size(path) {
            sum.texture_bytes = sum.texture_bytes.saturating_add(size.stored);
            let beside = size.decoding.saturating_sub(size.stored);
            sum.decoding_bytes = sum.decoding_bytes.max(beside);
        }
    }
}

impl Prediction {
    /// The same with the accelerator.
    pub fn with(self, footprint: &Footprint) -> Self {
        Self {
            accelerator_bytes: Some(footprint.built_bytes(self.primitives)),
            accelerator_peak_bytes: Some(footprint.peak_bytes(self.primitives)),
            ..self
        }
        .with_peak()
    }

    /// The same with more bytes that are there as long as the film.
    pub fn beside_film(self, bytes: u64) -> Self {
        Self { film_bytes: self.film_bytes.saturating_add(bytes), ..self }.with_peak()
    }

    /// Images are decoded before meshes are read; the film comes when the accelerator is built.
    fn with_peak(self) -> Self {
        let world = [self.mesh_bytes, self.texture_bytes];
        let world = world.iter().fold(BASE_BYTES, |a, b| a.saturating_add(*b));
        let beside = [
            self.decoding_bytes.saturating_sub(self.mesh_bytes),
            self.accelerator_peak_bytes.unwrap_or(0),
            self.accelerator_bytes.unwrap_or(0).saturating_add(self.film_bytes),
        ];
        let most = beside.into_iter().max().unwrap_or(0);
        Self { peak_bytes: world.saturating_add(most), ..self }
    }

    /// Refuses a render that will not fit.
    ///
    /// # Errors
    /// `Limit`, with the numbers.
    pub fn check(&self, limit: u64) -> Result<()> {
        if limit >= self.peak_bytes {
            return Ok(());
        }
        let message = format!(
            "found {}, expected at least {}: {self}",
            units::bytes(limit),
            units::bytes_rounded_up(self.peak_bytes)
        );
        let problem = Problem::new("--max-memory", message);
        Err(Error::new(Kind::Limit, problem.help("render a --crop, or a smaller mesh")))
    }
}

/// `--max-memory`, and what was predicted under it.
#[derive(Debug)]
pub struct Budget {
    limit: u64,
    prediction: Prediction,
}

impl Budget {
    /// Refuses a scene that will not fit, of a film by its pixels, channels beside R, G, B, A, and bytes beside
    /// them. Costs the headers, then a small build for the
    /// accelerator's footprint.
    ///
    /// # Errors
    /// `Limit`, with the numbers; headers that cannot be read; a backend that cannot run.
    pub fn check(
        limit: u64,
        scene: &Scene,
        (window, words, beside): (Window, usize, u64),
        threads: usize,
    ) -> Result<Self> {
        let prediction = predict_words(scene, window, words)?.beside_film(beside);
        prediction.check(limit)?;
        Self::of(limit, prediction.with(&Footprint::of(scene.backend, threads)?))
    }

    /// Refuses what is predicted not to fit.
    ///
    /// # Errors
    /// `Limit`, with the numbers.
    pub fn of(limit: u64, prediction: Prediction) -> Result<Self> {
        prediction.check(limit)?;
        Ok(Self { limit, prediction })
    }

    /// What is left for images, beside what the meshes will need.
    pub fn for_textures(&self) -> u64 {
        self.limit.saturating_sub(BASE_BYTES).saturating_sub(self.prediction.mesh_bytes)
    }

    /// What is left for meshes.
    pub fn for_meshes(&self) -> Room {
        room(self.limit)
    }

    /// What is left for the accelerator beside a world of `world_bytes`.
    pub fn for_accelerator(&self, world_bytes: u64) -> u64 {
        self.limit.saturating_sub(BASE_BYTES).saturating_sub(world_bytes)
    }

    /// Refuses a film that does not fit beside world and accelerator, of `held` bytes.
    ///
    /// # Errors
    /// `Limit`, with the numbers.
    pub fn check_film(&self, held: u64) -> Result<()> {
        let film = self.prediction.film_bytes;
        let needed = BASE_BYTES.saturating_add(held).saturating_add(film);
        if self.limit >= needed {
            return Ok(());
        }
        let message = format!(
            "found {}, expected at least {}: film {} beside meshes, textures and accelerator of {}",
            units::bytes(self.limit),
            units::bytes_rounded_up(needed),
            units::bytes(film),
            units::bytes(held),
        );
        let problem = Problem::new("--max-memory", message);
        Err(Error::new(Kind::Limit, problem.help("render a --crop, or a smaller mesh")))
    }
}

impl std::fmt::Display for Prediction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let built = self.accelerator_bytes.unwrap_or(0);
        let peak = self.accelerator_peak_bytes.unwrap_or(0);
        let parts = [
            ("film", self.film_bytes),
            ("meshes", self.mesh_bytes),
            ("textures", self.texture_bytes),
            ("decoding them", self.decoding_bytes),
            ("accelerator", built),
            ("its build", peak.saturating_sub(built)),
        ];
        let parts = parts.into_iter().filter(|(_, bytes)| *bytes > 0);
        let parts: Vec<_> =
            parts.map(|(name, bytes)| format!("{name} {}", units::bytes(bytes))).collect();
        f.write_str(&parts.join(", "))
    }
}

/// What a limit of the user's leaves for meshes.
pub fn room(limit: u64) -> Room {
    Room { bytes: limit.saturating_sub(BASE_BYTES), asked: true }
}

/// Largest resident set of this process so far, in bytes.
pub fn peak_bytes() -> u64 {
    kib("/proc/self/status".as_ref(), "VmHWM:").unwrap_or(0)
}

/// What meshes or textures may take where the user sets no limit: all that the machine can still give, or
/// swap out.
pub fn machine() -> Option<Room> {
    available_bytes_and_swap().map(|bytes| Room { bytes, asked: false })
}

/// The same where `bytes` will be asked for: if they are not there, what was freed is given back first.
pub fn machine_for(bytes: u64) -> Option<Room> {
    if available_bytes().is_some_and(|available| available < bytes) {
        freed::give_back();
    }
    machine()
}

/// What a whole run may take: the system ends a process that takes more.
pub fn before_a_kill() -> Option<Room> {
    bytes_before_a_kill().map(|bytes| Room { bytes, asked: false })
}

/// No accelerator takes more for a primitive, at any time.
const MOST_PER_PRIMITIVE: u64 = 512;

/// Refuses to build an accelerator that will not fit into what the machine still has, with a film of `film_bytes` beside
/// it once it is built.
///
/// # Errors
/// `Retry`, with the numbers.
pub fn check_build(
    backend: Backend,
    threads: usize,
    primitives: u64,
    film_bytes: u64,
) -> Result<()> {
    let most = primitives.saturating_mul(MOST_PER_PRIMITIVE).saturating_add(film_bytes);
    let short = || before_a_kill().filter(|room| room.bytes < most);
    if short().is_some() {
        freed::give_back();
    }
    let Some(room) = short() else { return Ok(()) };
    let footprint = Footprint::of(backend, threads)?;
    let built = footprint.built_bytes(primitives).saturating_add(film_bytes);
    room.check(footprint.peak_bytes(primitives).max(built), "the accelerator and the film")
}
