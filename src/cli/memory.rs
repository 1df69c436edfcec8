//! How much memory a render will need, from headers alone: said by `info`, and held against
//! `--max-memory` before the first mesh is read.

use std::{collections::BTreeSet, path::Path};

use serde::Serialize;

use crate::{
    error::{Error, Kind, Problem, Result},
    film::Window,
    scene::{Backend, Scene, ShapeKind},
};

use super::{meshes, units};

/// R, G, B, A in f32.
const FILM_BYTES: u64 = 16;
/// 8-bit RGBA while the PNG is written.
const PNG_BYTES: u64 = 4;
/// The program, its threads, tables.
const BASE_BYTES: u64 = 30 << 20;
/// What an accelerator holds however small the scene: blocks that its threads begin.
const ACCELERATOR_BYTES: u64 = 2 << 20;

/// Predicted bytes.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Prediction {
    /// Film and PNG.
    pub film_bytes: u64,
    /// Mesh arrays.
    pub mesh_bytes: u64,
    /// Decoded images.
    pub texture_bytes: u64,
    /// The accelerator once built.
    pub accelerator_bytes: u64,
    /// The most that its build holds.
    pub accelerator_peak_bytes: u64,
    /// The most at any time.
    pub peak_bytes: u64,
    /// Triangles of all shapes.
    pub triangles: u64,
}

/// Bytes per triangle: built, and at most during the build.
fn per_triangle(backend: Backend) -> [u64; 2] {
    match backend {
        Backend::Embree => [66, 104],
        Backend::Bvh => [66, 130],
        Backend::Coursework => [136, 300],
        Backend::Brute => [6, 80],
    }
}

/// Looks at the headers of all files.
///
/// # Errors
/// Headers that cannot be read.
pub fn predict(scene: &Scene, window: Window) -> Result<Prediction> {
    let pixels = u64::from(window.width()) * u64::from(window.height());
    let mut sum =
        Prediction { film_bytes: pixels * (FILM_BYTES + PNG_BYTES), ..Prediction::default() };
    let mut problems = Vec::new();
    for shape in &scene.shapes {
        match &shape.kind {
            ShapeKind::Trimesh(mesh) => {
                let promise = meshes::promise(&mesh.path).unwrap_or_else(|error| {
                    problems.extend(error.problems);
                    Default::default()
                });
                sum.triangles = sum.triangles.saturating_add(promise.triangles);
                let normals = if mesh.smooth { promise.missing_normal_bytes } else { 0 };
                let bytes = promise.array_bytes.saturating_add(normals);
                sum.mesh_bytes = sum.mesh_bytes.saturating_add(bytes);
            }
            ShapeKind::Sphere { .. } | ShapeKind::Triangle { .. } => sum.triangles += 1,
            ShapeKind::Plane { .. } => sum.triangles += 2,
        }
    }
    if !problems.is_empty() {
        return Err(Error { kind: Kind::Invalid, problems });
    }
    sum.texture_bytes = textures(scene);
    let [live, peak] = per_triangle(scene.backend);
    sum.accelerator_bytes = sum.triangles.saturating_mul(live);
    sum.accelerator_peak_bytes =
        sum.triangles.saturating_mul(peak).saturating_add(ACCELERATOR_BYTES);
    let parts = [sum.film_bytes, sum.mesh_bytes, sum.texture_bytes, sum.accelerator_peak_bytes];
    sum.peak_bytes = parts.iter().fold(BASE_BYTES, |a, b| a.saturating_add(*b));
    Ok(sum)
}

/// What a mesh alone needs, whatever the scene around it: said before the mesh is read for its
/// framing.
///
/// # Errors
/// A header that cannot be read.
pub fn predict_mesh(path: &Path) -> Result<Prediction> {
    let promise = meshes::promise(path)?;
    Ok(Prediction {
        mesh_bytes: promise.array_bytes,
        triangles: promise.triangles,
        peak_bytes: BASE_BYTES.saturating_add(promise.array_bytes),
        ..Prediction::default()
    })
}

/// Bytes of the decoded images, each once; files that are no images are complained about later.
fn textures(scene: &Scene) -> u64 {
    let paths = scene.materials.iter().filter_map(|m| m.texture.as_ref().map(|t| &t.path));
    let paths: BTreeSet<_> = paths.collect();
    let bytes = paths.into_iter().filter_map(|path| {
        let reader = image::ImageReader::open(path).ok()?.with_guessed_format().ok()?;
        use image::ImageFormat::{Hdr, OpenExr};
        let float = matches!(reader.format(), Some(Hdr | OpenExr));
        let (width, height) = reader.into_dimensions().ok()?;
        let texel = if float { 12 } else { 3 };
        Some(u64::from(width) * u64::from(height) * texel)
    });
    bytes.fold(0, u64::saturating_add)
}

impl Prediction {
    /// Refuses a render that will not fit.
    ///
    /// # Errors
    /// `Limit`, with the numbers.
    pub fn check(&self, limit: Option<u64>) -> Result<()> {
        let Some(limit) = limit.filter(|limit| *limit < self.peak_bytes) else {
            return Ok(());
        };
        let message = format!(
            "found {}, expected at least {}: {self}",
            units::bytes(limit),
            units::bytes_rounded_up(self.peak_bytes)
        );
        let problem = Problem::new("--max-memory", message);
        Err(Error::new(Kind::Limit, problem.help("render a --crop, or a smaller mesh")))
    }

    /// What is left of `limit` for the accelerator beside a world of `mesh_bytes`.
    pub fn left(&self, limit: u64, mesh_bytes: u64) -> u64 {
        limit.saturating_sub(BASE_BYTES).saturating_sub(self.film_bytes).saturating_sub(mesh_bytes)
    }
}

impl std::fmt::Display for Prediction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts = [
            ("film", self.film_bytes),
            ("meshes", self.mesh_bytes),
            ("textures", self.texture_bytes),
            ("accelerator", self.accelerator_bytes),
            ("its build", self.accelerator_peak_bytes.saturating_sub(self.accelerator_bytes)),
        ];
        let parts = parts.into_iter().filter(|(_, bytes)| *bytes > 0);
        let parts: Vec<_> =
            parts.map(|(name, bytes)| format!("{name} {}", units::bytes(bytes))).collect();
        f.write_str(&parts.join(", "))
    }
}
