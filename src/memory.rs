//! Predicts how much memory a render will need, from file headers and the accelerator's footprint.
//!
//! `info` prints the prediction. `--max-memory` is compared with it before the first mesh is read.

use std::collections::{HashMap, HashSet};
use std::path::Path;

use serde::Serialize;

use crate::accel::MemoryFootprint;
use crate::error::{Error, ErrorKind, Failures, Problem, Result};
use crate::files;
use crate::film::Window;
use crate::geometry::PrimitiveCounts;
use crate::layers::LayerPlan;
use crate::mesh::{self, ReadOptions};
use crate::output::tonemap::Depth;
use crate::scene::{Backend, Filter, Scene, ShapeKind, Smooth, TextureLookup};
use crate::shading::{EnvironmentMap, Texture, WHOLE_TEXELS};
use crate::units;
use crate::world::{color_request, own_images};

mod available;
mod budget;
mod freed;
mod limits;

pub use self::freed::{limit_arenas, release_freed, return_large_arrays};

pub use available::available_bytes;
pub use budget::{Budget, limit_for_meshes};
pub use limits::{
    ensure_build_fits, ensure_build_may_fit, ensure_film_fits, less_than_predicted,
    limit_before_kill, limit_of_machine, machine_limit_for, peak_bytes,
};

/// Size in bytes of a pixel in the film: R, G, B, A in f32.
const FILM_BYTES: u64 = 16;
/// Size in bytes of a pixel while the PNG is written: 8-bit RGBA.
const PNG_BYTES: u64 = 4;
/// Estimated bytes of the program, its threads and its tables. All of the program's file may be
/// resident.
const BASE_BYTES: u64 = 32 << 20;

/// Predicted memory of a render.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Prediction {
    /// Bytes of the film and the PNG.
    pub film_bytes: u64,
    /// Bytes of the mesh arrays.
    pub mesh_bytes: u64,
    /// Bytes of the decoded images.
    pub texture_bytes: u64,
    /// Maximum number of bytes that decoding one image needs beside the decoded image.
    pub decoding_bytes: u64,
    /// The same for the images that meshes name, which are decoded beside all meshes.
    #[serde(skip)]
    pub own_decoding_bytes: u64,
    /// Bytes of the accelerator after its build, if they are known.
    pub accelerator_bytes: Option<u64>,
    /// Maximum number of bytes during the build of the accelerator, if it is known.
    pub accelerator_peak_bytes: Option<u64>,
    /// Bytes of the files of the accelerator's library; 0 if lightpath is the accelerator.
    pub library_bytes: u64,
    /// Maximum of all bytes that are held at the same time.
    pub peak_bytes: u64,
    /// Number of triangles in all shapes (a plane counts as two), and of spheres.
    pub primitives: u64,
    /// The primitives in all accelerators. Each distinct set of shapes that a kind of ray can hit
    /// has one.
    #[serde(skip)]
    pub accelerated: PrimitiveCounts,
}

/// The sizes that a mesh header declares. All are 0 if the file is too small for them.
#[derive(Debug, Clone, Copy, Default)]
pub struct DeclaredSizes {
    /// Bytes of the vertex and index arrays.
    pub array_bytes: u64,
    /// Bytes of the vertex normals to compute; 0 if the file has normals.
    pub missing_normal_bytes: u64,
    /// The triangles after polygons are split, or the points drawn as spheres.
    pub counts: PrimitiveCounts,
}

/// An instance takes some 400 bytes: at least as much as is predicted for this many triangles.
const INSTANCE_PRIMITIVES: u64 = 12;

/// Bytes of a point that is drawn as a sphere: the sphere in f64, and the index of its shape.
const SPHERE_BYTES: u64 = 36;

/// Maximum number of bytes that one byte of gzip data can unpack to. zstd can reach more, but
/// hardly on a mesh.
const MAX_PACKING_RATIO: u64 = 1032;

/// Returns the sizes that the header of a PLY file declares, for a reader with these options.
///
/// # Errors
/// A pipe or a device, whose header could not be read again; a header that cannot be read.
pub fn declared_sizes(path: &Path, options: &ReadOptions) -> Result<DeclaredSizes> {
    if let Some(error) = files::not_a_file(path) {
        return Err(error.help("save it as a file: memory is predicted from its header"));
    }
    let summary = mesh::inspect_ply_with(path, options)?;
    // The reader refuses a header that declares more rows than the file has bytes. Its message is
    // the better one, so the prediction must not fail first.
    let ratio = if summary.packed.is_some() { MAX_PACKING_RATIO } else { 1 };
    let maximum = summary.file_bytes.saturating_mul(ratio);
    let implausible = summary.triangles.max(summary.vertices) > maximum;
    if options.points && !implausible {
        let spheres = summary.vertices.saturating_mul(SPHERE_BYTES);
        return Ok(DeclaredSizes {
            array_bytes: summary.array_bytes.saturating_add(spheres),
            missing_normal_bytes: 0,
            counts: PrimitiveCounts::new(summary.vertices),
        });
    }
    Ok(match implausible {
        true => DeclaredSizes::default(),
        false => DeclaredSizes {
            array_bytes: summary.array_bytes,
            missing_normal_bytes: if summary.normals { 0 } else { 12 * summary.vertices },
            counts: PrimitiveCounts::of_mesh(summary.triangles, summary.vertices),
        },
    })
}

/// Returns the bytes that a PNG of this depth needs beyond 8 bits per channel.
pub fn deeper_png_bytes(window: Window, depth: Depth) -> u64 {
    PNG_BYTES.saturating_mul(window.pixels()) * u64::from(depth.bits() / 8 - 1)
}

/// Predicts the memory of a scene from the headers of all files, without the accelerator.
///
/// # Errors
/// Headers that cannot be read.
pub fn predict(scene: &Scene, window: Window) -> Result<Prediction> {
    predict_words(scene, window, LayerPlan::new(scene).layout.channels.len())
}

/// Returns the bytes of film and PNG with `words` channels in addition to R, G, B, A.
pub fn film_bytes(window: Window, words: usize) -> u64 {
    let words = words as u64;
    window.pixels().saturating_mul(words.saturating_mul(4).saturating_add(FILM_BYTES + PNG_BYTES))
}

/// Predicts the memory of a scene with `words` channels in addition to R, G, B, A.
///
/// # Errors
/// Headers that cannot be read.
pub fn predict_words(scene: &Scene, window: Window, words: usize) -> Result<Prediction> {
    let mut sum = Prediction { film_bytes: film_bytes(window, words), ..Prediction::default() };
    let mut failures = Failures::default();
    // For each shape, its primitives and the bytes of its mesh: instances come after their mesh.
    let mut meshes: Vec<(PrimitiveCounts, u64)> = Vec::with_capacity(scene.shapes.len());
    for (shape, times) in scene.shapes.iter().zip(scene.accelerators()) {
        let mut mesh_bytes = 0u64;
        let counts = match &shape.kind {
            ShapeKind::Trimesh(mesh) => {
                let textured = scene.materials[shape.material].texture.is_some();
                let options = ReadOptions::default().color(color_request(mesh, textured));
                let options = options.points(mesh.points.is_some());
                let declared = failures.keep(declared_sizes(&mesh.path, &options));
                let declared = declared.unwrap_or_default();
                if !textured && mesh.color.is_none() && mesh.points.is_none() {
                    let lookup = &scene.materials[shape.material].lookup;
                    own_textures(&mesh.path, lookup, &mut sum);
                }
                let smooth = mesh.smooth != Smooth::Off && mesh.points.is_none();
                let normals = if smooth { declared.missing_normal_bytes } else { 0 };
                let bytes = declared.array_bytes.saturating_add(normals);
                mesh_bytes = bytes;
                declared.counts
            }
            // `brute` has a box around every triangle of a copy.
            ShapeKind::Instance { of, .. } if matches!(scene.backend, Backend::Brute) => {
                meshes[*of].0
            }
            ShapeKind::Instance { .. } if scene.backend.traces_instances() => {
                PrimitiveCounts::new(INSTANCE_PRIMITIVES)
            }
            ShapeKind::Instance { of, .. } => {
                let (counts, bytes) = meshes[*of];
                mesh_bytes = bytes;
                counts
            }
            ShapeKind::Sphere { .. } | ShapeKind::Triangle { .. } => PrimitiveCounts::new(1),
            ShapeKind::Plane { .. } => PrimitiveCounts::new(2),
        };
        meshes.push((counts, mesh_bytes));
        sum.mesh_bytes = sum.mesh_bytes.saturating_add(mesh_bytes);
        sum.primitives = sum.primitives.saturating_add(counts.primitives);
        sum.accelerated = sum.accelerated.plus(counts.times(times.into()));
    }
    failures.check()?;
    textures(scene, &mut sum);
    Ok(sum.with_peak())
}

/// Predicts the memory of a mesh alone, without a scene. The studio reads a mesh before it makes
/// the scene, because the camera depends on the mesh.
///
/// # Errors
/// A header that cannot be read.
pub fn predict_mesh(path: &Path, points: bool) -> Result<Prediction> {
    let declared = declared_sizes(path, &ReadOptions::default().points(points))?;
    Ok(Prediction {
        mesh_bytes: declared.array_bytes,
        primitives: declared.counts.primitives,
        accelerated: declared.counts,
        ..Prediction::default()
    }
    .with_peak())
}

/// Adds the images of the materials that shapes use, and of the environments. A texture is loaded
/// once for each colour space, an environment once. Files that are not images are reported later.
fn textures(scene: &Scene, sum: &mut Prediction) {
    let used = scene.shapes.iter().map(|shape| &scene.materials[shape.material]);
    let mut keys = HashMap::new();
    for material in used {
        let (Some(texture), lookup) = (&material.texture, &material.lookup) else { continue };
        let areas = keys.entry((texture.path.as_path(), lookup.color_space)).or_insert(false);
        *areas |= lookup.filter == Some(Filter::Trilinear);
    }
    let images = keys.into_iter().filter_map(|((path, _), areas)| {
        let size = Texture::size_in_tiles(path, WHOLE_TEXELS).ok()?;
        Some((size, if areas { size.mip_map } else { 0 }))
    });
    let maps: HashSet<_> = scene.maps().map(|map| map.path.as_path()).collect();
    let maps = maps.into_iter().filter_map(|path| Some((EnvironmentMap::size(path).ok()?, 0)));
    for (size, copies) in images.chain(maps) {
        let stored = size.stored.saturating_add(copies);
        sum.texture_bytes = sum.texture_bytes.saturating_add(stored);
        let beside = size.decoding.saturating_sub(size.stored);
        sum.decoding_bytes = sum.decoding_bytes.max(beside);
    }
}

/// Adds the images that a mesh names. They are loaded for each shape.
fn own_textures(mesh: &Path, lookup: &TextureLookup, sum: &mut Prediction) {
    let areas = lookup.filter.is_none_or(|filter| filter == Filter::Trilinear);
    let size = |path| Texture::size_in_tiles(path, WHOLE_TEXELS).ok();
    for size in own_images(mesh).iter().filter_map(|path| size(path)) {
        let copies = if areas { size.mip_map } else { 0 };
        let stored = size.stored.saturating_add(copies);
        sum.texture_bytes = sum.texture_bytes.saturating_add(stored);
        let beside = size.decoding.saturating_sub(size.stored);
        sum.own_decoding_bytes = sum.own_decoding_bytes.max(beside);
        sum.decoding_bytes = sum.decoding_bytes.max(beside);
    }
}

impl Prediction {
    /// Returns the prediction with an accelerator of this footprint.
    pub fn with(self, footprint: &MemoryFootprint) -> Self {
        Self {
            accelerator_bytes: Some(footprint.built_bytes(self.accelerated)),
            accelerator_peak_bytes: Some(footprint.peak_bytes(self.accelerated)),
            library_bytes: footprint.library_bytes(),
            ..self
        }
        .with_peak()
    }

    /// Returns the prediction with additional bytes that exist as long as the film.
    pub fn with_film_bytes(self, bytes: u64) -> Self {
        Self { film_bytes: self.film_bytes.saturating_add(bytes), ..self }.with_peak()
    }

    /// Returns the prediction with `count` films at a time.
    pub fn with_films(self, count: u64) -> Self {
        Self { film_bytes: self.film_bytes.saturating_mul(count), ..self }.with_peak()
    }

    /// Returns how many films, at most `most` and at least one, fit into `limit` bytes.
    pub fn films_within(&self, limit: u64, most: u64) -> u64 {
        let fits = |count: &u64| self.clone().with_films(*count).peak_bytes <= limit;
        (1..=most).rev().find(fits).unwrap_or(1)
    }

    /// Computes `peak_bytes`: the maximum over decoding, building and rendering. The images of a
    /// scene are decoded before meshes are read, and the film is allocated after the accelerator is
    /// built.
    fn with_peak(self) -> Self {
        let world = [self.program_bytes(), self.mesh_bytes, self.texture_bytes];
        let world = world.into_iter().fold(0, u64::saturating_add);
        let beside = [
            self.decoding_bytes.saturating_sub(self.mesh_bytes),
            self.own_decoding_bytes,
            self.accelerator_peak_bytes.unwrap_or(0),
            self.accelerator_bytes.unwrap_or(0).saturating_add(self.film_bytes),
        ];
        let maximum = beside.into_iter().max().unwrap_or(0);
        Self { peak_bytes: world.saturating_add(maximum), ..self }
    }

    /// Returns the bytes of the program and of its libraries.
    fn program_bytes(&self) -> u64 {
        BASE_BYTES + self.library_bytes
    }

    /// Checks that the render fits into `limit` bytes.
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
        Err(over_limit(message))
    }
}

fn over_limit(message: String) -> Error {
    let problem = Problem::new("--max-memory", message);
    Error::new(ErrorKind::Limit, problem.help("a smaller --size or mesh, or `render` with --crop"))
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
            ("its library", self.library_bytes),
        ];
        let parts = parts.into_iter().filter(|(_, bytes)| *bytes > 0);
        let parts: Vec<_> =
            parts.map(|(name, bytes)| format!("{name} {}", units::bytes(bytes))).collect();
        f.write_str(&parts.join(", "))
    }
}
