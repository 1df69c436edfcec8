//! Compares the renderer's pictures with those of a second, independent ray tracer
//! (`tests/reference/`).
//!
//! Five scenes cover the format. Scenes without random choices must agree pixel by pixel. Scenes
//! with area lights, lens and antialiasing must agree within the noise that their number of samples
//! implies. `compare.rs` states and justifies every tolerance.

use crate::support::backends::on_both;
use crate::support::reference::{assets, compare, program};
use lightpath::scene::Backend;
use lightpath_reference::{self as reference, Density, Picture, scene::Scene};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

/// Makes a temporary folder with the scene and every asset.
fn stage(name: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    assets::write_all(folder.path());
    let scene = folder.path().join(format!("{name}.json"));
    let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/reference");
    std::fs::copy(stored.join(format!("{name}.json")), &scene).expect("the stored scene");
    (folder, scene)
}

/// Returns the reference's picture of a scene.
fn reference_of(name: &str) -> Picture {
    let (_folder, scene) = stage(name);
    reference::render(&Scene::load(&scene), Density::default())
}

/// The reference's pictures of scenes with random choices take seconds, and several tests need
/// them.
static AREA_LIGHTS: LazyLock<Picture> = LazyLock::new(|| reference_of("arealights"));
static LENS: LazyLock<Picture> = LazyLock::new(|| reference_of("lens"));

/// Returns the renderer's picture of a scene.
fn rendered(backend: Backend, name: &str) -> Picture {
    let (_folder, scene) = stage(name);
    program::render(&scene, backend.name())
}

on_both! {
    fn shapes_mirrors_and_shadows(backend: Backend) {
        compare::assert_same("shapes", &rendered(backend, "shapes"), &reference_of("shapes"));
    }
}

on_both! {
    fn textures_on_every_shape(backend: Backend) {
        compare::assert_same("textures", &rendered(backend, "textures"), &reference_of("textures"));
    }
}

on_both! {
    fn meshes_smooth_and_coloured(backend: Backend) {
        compare::assert_same("meshes", &rendered(backend, "meshes"), &reference_of("meshes"));
    }
}

on_both! {
    fn area_lights_uniform_and_lambertian(backend: Backend) {
        compare::assert_same_sampled("arealights", &rendered(backend, "arealights"), &AREA_LIGHTS);
    }
}

on_both! {
    fn thin_lens_antialiasing_and_alpha(backend: Backend) {
        compare::assert_same_sampled("lens", &rendered(backend, "lens"), &LENS);
    }
}

/// Multiplies the pixels that come from random choices by `factor`.
fn brightened(picture: &Picture, factor: f64) -> Picture {
    let noisy = |deviation: &[f64; 4]| deviation.iter().any(|d| *d > 0.0);
    let brighter = |(p, d): (&[f64; 4], &[f64; 4])| {
        let factor = if noisy(d) { factor } else { 1.0 };
        [p[0] * factor, p[1] * factor, p[2] * factor, p[3]]
    };
    let pixels = picture.pixels.iter().zip(&picture.deviation).map(brighter).collect();
    Picture { pixels, deviation: Vec::new(), ..*picture }
}

/// The tolerance is justified: moving the camera by the rounding of f32 (a ten-millionth of the
/// scene) changes no more pixels than may differ.
#[test]
fn exact_scenes_are_well_conditioned() {
    for name in ["shapes", "textures", "meshes"] {
        let (_folder, path) = stage(name);
        let mut scene = Scene::load(&path);
        let expected = reference::render(&scene, Density::default());
        scene.camera.shift(glam::DVec3::new(6e-7, -5e-7, 7e-7));
        let moved = reference::render(&scene, Density::default());
        compare::assert_same(&format!("{name}-moved"), &moved, &expected);
    }
}

/// The reference's own discretisation error is within the tolerance of the sampled scenes: other
/// grids give the same picture. And the comparison is sharp: it detects one percent more light.
#[test]
fn sampled_scenes_have_converged() {
    let other = Density { light: 27, pixel: 13, lens: 5 };
    for (name, expected) in [("arealights", &*AREA_LIGHTS), ("lens", &*LENS)] {
        let (_folder, path) = stage(name);
        let again = reference::render(&Scene::load(&path), other);
        compare::assert_same_sampled(&format!("{name}-again"), &again, expected);
        let verdict = compare::judge_sampled(&brightened(expected, 1.01), expected);
        assert!(verdict.is_err(), "{name}: one percent goes unnoticed");
    }
}
