//! Files for data sets: the faces that the camera sees, and ids as pictures.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueHint};

use crate::error::{Error, Result};
use crate::film::{Film, Window};
use crate::integrate::TILE;
use crate::layers::{FaceCounts, LayerPlan};
use crate::output::atomic::PartFile;
use crate::output::png;
use crate::render::Adaptive;
use crate::scene::{Layer, Scene};
use crate::world::World;
use crate::{memory, paths};

/// Flags for data sets.
#[derive(Debug, Args)]
pub struct DatasetArgs {
    /// Write which faces the camera sees, with their counts of samples and pixels, as a NumPy array
    #[arg(long, value_name = "FILE.npy", value_hint = ValueHint::FilePath)]
    pub visible_faces: Option<PathBuf>,

    /// Write the layer objectid as PREFIX.instance.png, and the shapes' `semantic` ids as
    /// PREFIX.semantic.png, 16 bits each
    #[arg(long)]
    pub png_ids: bool,
}

/// Endings of the names of the id pictures.
const ID_ENDINGS: [&str; 2] = [".instance.png", ".semantic.png"];

impl DatasetArgs {
    /// Returns the bytes that the counts of faces need. With adaptive sampling each of `threads`
    /// keeps the primitives of all samples of a tile of the window until the tile is finished.
    ///
    /// # Errors
    /// Headers that cannot be read.
    pub fn bytes(
        &self,
        scene: &Scene,
        window: Window,
        adaptive: Option<&Adaptive>,
        threads: usize,
    ) -> Result<u64> {
        if self.visible_faces.is_none() {
            return Ok(0);
        }
        let pixel = Window { x0: 0, y0: 0, x1: 1, y1: 1 };
        let primitives = memory::predict(scene, pixel)?.primitives;
        let pixels = window.pixels().min(u64::from(TILE * TILE).saturating_mul(threads as u64));
        let samples = adaptive.map_or(0, |adaptive| pixels * u64::from(adaptive.most));
        let held = samples.saturating_mul(size_of::<u32>() as u64);
        Ok(primitives.saturating_mul(FaceCounts::BYTES).saturating_add(held))
    }

    /// Returns the files that the flags name, for a picture `prefix`.
    ///
    /// # Errors
    /// Ids without the layer `objectid`, or with more shapes than 16-bit ids allow.
    pub fn paths(&self, scene: &Scene, prefix: &Path) -> Result<DatasetPaths> {
        if self.png_ids && !scene.layers.contains(&Layer::Object) {
            let message = "found without the layer `objectid`";
            return Err(Error::invalid("--png-ids", message).help("add it: --aov objectid"));
        }
        if self.png_ids && scene.shapes.len() > usize::from(u16::MAX) {
            let count = scene.shapes.len();
            let message = format!("found {count} shapes, expected at most {}", u16::MAX);
            return Err(Error::invalid("--png-ids", message));
        }
        let ids = ID_ENDINGS.iter().filter(|_| self.png_ids);
        let ids = ids.map(|end| paths::with_ending(prefix, end)).collect();
        Ok(DatasetPaths { faces: self.visible_faces.clone(), ids })
    }
}

/// Paths of the files for data sets.
#[derive(Debug, Clone)]
pub struct DatasetPaths {
    faces: Option<PathBuf>,
    /// The instances and the semantic classes, or none.
    pub ids: Vec<PathBuf>,
}

/// Part files for data sets, while they are written.
pub struct DatasetFiles {
    faces: Option<PartFile>,
    ids: Vec<PartFile>,
}

impl DatasetPaths {
    /// Returns the paths of all files.
    pub fn all(&self) -> impl Iterator<Item = &PathBuf> {
        self.faces.iter().chain(&self.ids)
    }

    /// Creates all part files.
    ///
    /// # Errors
    /// As for [`PartFile::create`].
    pub fn create(&self) -> Result<DatasetFiles> {
        let faces = self.faces.as_deref().map(PartFile::create).transpose()?;
        let ids = self.ids.iter().map(|path| PartFile::create(path)).collect::<Result<_>>()?;
        Ok(DatasetFiles { faces, ids })
    }

    /// Returns the plan of layers that also counts faces; `None` if they are not written.
    ///
    /// # Errors
    /// `Retry` if there is too little memory.
    pub fn counting_plan(&self, plan: &LayerPlan, world: &World) -> Result<Option<LayerPlan>> {
        if self.faces.is_none() {
            return Ok(None);
        }
        let faces = Some(Arc::new(FaceCounts::new(world.geometry.count())?));
        Ok(Some(LayerPlan { faces, ..plan.clone() }))
    }
}

impl DatasetFiles {
    /// Writes all files. `add` takes each for the final rename and returns its path.
    ///
    /// # Errors
    /// `Retry` if the disk is full.
    pub fn write(
        self,
        film: &Film,
        (plan, world, scene): (&LayerPlan, &World, &Scene),
        mut add: impl FnMut(PartFile) -> PathBuf,
    ) -> Result<Vec<PathBuf>> {
        let mut written = Vec::new();
        if let (Some(mut part), Some(counts)) = (self.faces, &plan.faces) {
            part.fill(&visible_faces(counts, world))?;
            written.push(add(part));
        }
        let objects = film.planes.index("objectid.id").filter(|_| !self.ids.is_empty());
        if let Some(channel) = objects {
            let semantic: Vec<u16> = scene.shapes.iter().map(|shape| shape.semantic).collect();
            let object = |pixel: usize| film.planes.uint(channel, pixel);
            let class = |object: u32| match object.checked_sub(1) {
                Some(shape) => semantic.get(shape as usize).copied().unwrap_or(0),
                None => 0,
            };
            let pixels = 0..film.pixels.len();
            let instance: Vec<u16> = pixels.clone().map(|pixel| object(pixel) as u16).collect();
            let semantic: Vec<u16> = pixels.map(|pixel| class(object(pixel))).collect();
            for (mut part, values) in self.ids.into_iter().zip([instance, semantic]) {
                part.fill_by(|file, path| png::write_ids(film, &values, file, path))?;
                written.push(add(part));
            }
        }
        Ok(written)
    }
}

/// Returns the bytes of the array. It has a row for each face that was seen: id of its shape (from
/// 1), index in the shape (from 0), number of samples, number of pixels. Rows are sorted by shape
/// and index.
///
/// Format: `numpy.lib.format`, version 1.0.
fn visible_faces(counts: &FaceCounts, world: &World) -> Vec<u8> {
    let mut rows: Vec<(u32, u32, u64, u32)> = counts
        .seen()
        .map(|(primitive, samples, pixels)| {
            let (geom, prim) = world.geometry.place(primitive);
            let face = world.shapes.index_in_shape(geom, prim);
            (world.shapes.shape(geom, prim) + 1, face, samples, pixels)
        })
        .collect();
    rows.sort_unstable();
    let types = "[('object', '<u4'), ('face', '<u4'), ('samples', '<u8'), ('pixels', '<u4')]";
    let header =
        format!("{{'descr': {types}, 'fortran_order': False, 'shape': ({},), }}", rows.len());
    // Magic, version and length take 10 bytes; the data begin at a multiple of 64.
    let length = (header.len() + 11).next_multiple_of(64) - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{header:<width$}\n", width = length - 1).into_bytes());
    for (object, face, samples, pixels) in rows {
        bytes.extend(object.to_le_bytes());
        bytes.extend(face.to_le_bytes());
        bytes.extend(samples.to_le_bytes());
        bytes.extend(pixels.to_le_bytes());
    }
    bytes
}
