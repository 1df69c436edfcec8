//! Converts a description to a [`Scene`] and checks what the types cannot express.
//!
//! Every problem is collected. Parts with structural errors are skipped, the others are still
//! checked, so one run reports everything. No file is opened except to recognise a PLY mesh; named
//! files must exist.

mod calibrated;
mod camera;
mod files;
mod geometry;
mod layers;
mod lights;
mod materials;
mod overview;
mod shapes;

pub use self::camera::MAX_PIXELS;
pub use files::{CONVERT, IN_MEMORY, begins_as_ply, near_file};

use std::{collections::BTreeSet, path::Path};

use serde::de::DeserializeOwned;

use super::{
    checked::{Scene, Tonemap},
    description::{Description, Name, Transfer},
    document::Document,
    node::NodeKind,
    problems::Problems,
};

/// Maximum length of a name in characters. EXR headers hold 255 bytes, including prefixes and
/// suffixes.
const MAX_NAME_CHARS: usize = 200;

/// Checks the meaning of `problems.document`. `broken` holds the pointers with structural errors.
/// Paths are relative to `folder`.
pub fn check(
    problems: &mut Problems,
    broken: Vec<String>,
    folder: &Path,
) -> Option<(Description, Scene)> {
    let mut check = Check {
        document: problems.document,
        problems,
        broken: broken.into_iter().collect(),
        folder,
    };
    let camera = check.camera();
    let lights = check.lights();
    let mut materials = check.named_materials();
    let shapes = check.shapes(&mut materials);
    check.unused(&materials);
    let (layers, light_groups) = check.layers(&lights);
    let description: Option<Description> = check.part("");
    let (camera, description) = (camera?, description?);
    let scene = Scene {
        nbounces: description.nbounces,
        adaptive_shadows: description.adaptiveshadows,
        spp: description.spp,
        seed: description.seed,
        sampler: description.sampler,
        camera,
        background: description.scene.backgroundcolor.vec(),
        ambient: description.scene.ambient.vec(),
        falloff: description.scene.attenuation,
        backend: description.scene.accelerator.into(),
        lights,
        shapes,
        materials: materials.all,
        tonemap: tonemap(&description),
        layers,
        crypto_ranks: description.output.cryptoranks,
        light_groups,
        transparent: description.output.transparent,
        legend: description.output.legend,
    };
    check.legend(&scene);
    check.warn_about_mistakes(&scene);
    check.problems.is_empty().then_some((description, scene))
}

fn tonemap(description: &Description) -> Tonemap {
    let tonemap = &description.tonemap;
    Tonemap {
        operator: tonemap.operator,
        exposure: tonemap.exposure as f32,
        srgb: tonemap.transfer == Transfer::Srgb,
    }
}

/// Checks the meaning of `/camera` alone.
pub fn check_camera(problems: &mut Problems, broken: Vec<String>) {
    let (document, broken) = (problems.document, broken.into_iter().collect());
    Check { document, problems, broken, folder: Path::new("") }.camera();
}

struct Check<'d, 'p> {
    document: &'d Document,
    problems: &'p mut Problems<'d>,
    broken: BTreeSet<String>,
    folder: &'p Path,
}

impl Check<'_, '_> {
    /// Returns the value at `pointer`, unless it is absent or has structural errors.
    fn part<T: DeserializeOwned>(&mut self, pointer: &str) -> Option<T> {
        let below = format!("{pointer}/");
        let next = self.broken.range(below.clone()..).next();
        if self.broken.contains(pointer) || next.is_some_and(|p| p.starts_with(&below)) {
            return None;
        }
        let value = self.document.get(pointer)?.to_value();
        match serde_json::from_value(value) {
            Ok(part) => Some(part),
            Err(error) => {
                // Not expected: the schema is generated from the types.
                self.problems.error(pointer, error.to_string(), None);
                None
            }
        }
    }

    /// Returns the number of items of the array at `pointer`.
    fn count(&self, pointer: &str) -> usize {
        match self.document.get(pointer).map(|node| &node.kind) {
            Some(NodeKind::List(items)) => items.len(),
            _ => 0,
        }
    }

    /// Checks that a name can be written to an EXR header, and returns it.
    fn name(&mut self, pointer: &str, name: &Option<Name>) -> Option<String> {
        let Name(name) = name.as_ref()?;
        if name.chars().any(char::is_control) || name.trim().is_empty() {
            let message = format!("found {name:?}, expected a name without control characters");
            self.problems.error(pointer, message, None);
        } else if name.chars().count() > MAX_NAME_CHARS {
            let count = name.chars().count();
            let message =
                format!("found a name of {count} characters, expected at most {MAX_NAME_CHARS}");
            self.problems.error(pointer, message, None);
        }
        Some(name.clone())
    }
}
