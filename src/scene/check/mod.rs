//! Converts a description to a [`Scene`] and checks what the types cannot express.
//!
//! Every problem is collected. Parts with structural errors are skipped, and the others are still
//! checked, so one run reports everything. Named files must exist. They are not opened, except to
//! recognise a PLY mesh.

mod affine;
mod calibrated;
mod camera;
mod context;
mod files;
mod geometry;
mod layers;
mod lights;
mod materials;
mod overview;
mod shapes;

pub use self::camera::MAX_PIXELS;
pub use self::materials::unused_material;
pub use files::{CONVERT, IN_MEMORY, begins_as_ply, near_file};

use std::path::Path;

use glam::Vec3;

use self::context::Check;
use super::checked::{OcclusionRays, Scene, Tonemap};
use super::description::{LightDescription, SceneDescription, Transfer};
use super::problems::Problems;

/// Checks the meaning of `problems.document`. `broken` holds the pointers with structural errors.
/// Paths are relative to `folder`. Files that are known are not looked for. Returns `None` if there
/// is any error.
pub fn check(
    problems: &mut Problems,
    broken: Vec<String>,
    (folder, are_files_known): (&Path, bool),
) -> Option<(SceneDescription, Scene)> {
    let mut check = Check {
        document: problems.document,
        problems,
        broken: broken.into_iter().collect(),
        folder,
        are_files_known,
    };
    let camera = check.camera();
    let lights = check.lights();
    let mut materials = check.named_materials();
    let shapes = check.shapes(&mut materials);
    check.unused(&materials);
    let (layers, light_groups) = check.layers(&lights);
    let description: Option<SceneDescription> = check.part("");
    let (camera, description) = (camera?, description?);
    let scene = Scene {
        nbounces: description.nbounces,
        adaptive_shadows: description.adaptiveshadows,
        emitter_samples: description.emittersamples,
        spp: description.spp,
        seed: description.seed,
        sampler: description.sampler,
        camera,
        background: background(&description),
        ambient: description.scene.ambient.vec(),
        falloff: description.scene.attenuation,
        backend: description.scene.accelerator.into(),
        lights,
        shapes,
        materials: materials.all,
        tonemap: tonemap(&description),
        layers,
        occlusion: OcclusionRays {
            distance: description.output.aodistance,
            samples: description.output.aosamples,
        },
        crypto_ranks: description.output.cryptoranks,
        light_groups,
        transparent: description.output.transparent,
        legend: description.output.legend,
    };
    check.legend(&scene);
    check.warn_about_mistakes(&scene);
    check.problems.is_empty().then_some((description, scene))
}

/// Returns the radiance of rays that hit nothing, without the images of environments.
fn background(description: &SceneDescription) -> Vec3 {
    let seen = |light: &LightDescription| match light {
        LightDescription::Environment(environment)
            if environment.visible && environment.image.is_none() =>
        {
            environment.factor().vec()
        }
        _ => Vec3::ZERO,
    };
    let lights = description.scene.lightsources.iter();
    description.scene.backgroundcolor.vec() + lights.map(seen).sum::<Vec3>()
}

fn tonemap(description: &SceneDescription) -> Tonemap {
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
    let folder = Path::new("");
    Check { document, problems, broken, folder, are_files_known: false }.camera();
}
