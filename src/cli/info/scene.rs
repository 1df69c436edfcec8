//! `lightpath info scene.json`: runs every check that needs no rays. An error that would stop a
//! render is an error here, too, so meshes and textures are read completely.

use std::path::Path;

use serde_json::json;

use crate::accel::memory_footprint;
use crate::cli::print;
use crate::error::{Problem, Result};
use crate::film::Window;
use crate::monitor::Monitor;
use crate::scene::{self, Backend, LightKind, Scene, ShapeKind, Source};
use crate::world::{Detail, LoadOptions, World};
use crate::{memory, units};

use super::args::InfoArgs;
use super::facts::{Facts, resolution_line};

/// Checks a scene and adds its contents to `facts`. Prints its warnings.
pub fn describe(path: &Path, args: &InfoArgs, facts: &mut Facts) -> Result<()> {
    let loaded = scene::load(Source::File(path), &[])?;
    let scene = &loaded.scene;
    let (width, height) = (scene.camera.width, scene.camera.height);
    let options = LoadOptions {
        resolutions: true,
        no_mmap: args.no_mmap,
        memory_limit: memory::limit_of_machine(),
        ..LoadOptions::default()
    };
    let (world, more) = World::load(scene, options, &Monitor::default())?;
    let mut prediction = memory::predict(scene, Window::full(width, height))?;
    let backend = args.backend.map_or(scene.backend, Backend::from);
    let footprint = memory_footprint(backend, rayon::current_num_threads());
    facts.add("type", json!("scene"), "scene");
    let picture = format!(
        "{width} x {height} pixels, {} spp, {}, backend {}",
        scene.spp,
        units::plural(scene.nbounces as usize, "mirror bounce"),
        backend.name()
    );
    facts.add("size", json!([width, height]), picture);
    facts.add("spp", json!(scene.spp), "");
    facts.add("backend", json!(backend.name()), "");
    contents(scene, facts);
    let triangles = world.triangles();
    facts.add("triangles", json!(triangles), units::plural(triangles as usize, "triangle"));
    resolution(&world, facts);
    precision(&world, facts);
    let mut warnings: Vec<Problem> = loaded.warnings.iter().chain(&more).cloned().collect();
    let what = if footprint.is_ok() { "memory" } else { "memory without the accelerator" };
    match footprint {
        Ok(footprint) => prediction = prediction.with(&footprint),
        Err(error) => warnings.extend(error.problems.into_iter().map(|problem| {
            let message = format!("{}: the accelerator's memory is not predicted", problem.message);
            Problem { message, ..problem }
        })),
    }
    let memory =
        format!("{what}: about {} at most: {prediction}", units::bytes(prediction.peak_bytes));
    facts.add("memory", json!(prediction), memory);
    facts.add("scene_hash", json!(loaded.hash), format!("hash {}", loaded.hash));
    let texts: Vec<String> = warnings.iter().map(Problem::to_string).collect();
    for text in &texts {
        print::note(&format!("warning: {text}"));
    }
    facts.add("warnings", json!(texts), "");
    Ok(())
}

/// Adds the resolution of single precision relative to the scene's origin.
fn resolution(world: &World, facts: &mut Facts) {
    let details = world.resolutions.iter().map(|one| one.detail);
    let Some(worst) = details.reduce(Detail::worse) else { return };
    let mut meshes = Vec::new();
    let mut lines = Vec::new();
    for one in &world.resolutions {
        let mut value = json!(one.detail);
        value["place"] = json!(one.place);
        value["path"] = json!(one.path.display().to_string());
        meshes.push(value);
        lines.push(resolution_line(&one.detail, &format!(" of {}", one.path.display())));
    }
    let mut value = json!(worst);
    value["origin"] = json!(world.geometry.origin.to_array());
    value["meshes"] = json!(meshes);
    facts.add("resolution", value, resolution_line(&worst, " of the scene"));
    if lines.len() > 1 {
        facts.lines.append(&mut lines);
    }
}

/// Adds the rounding error of positions near the camera.
fn precision(world: &World, facts: &mut Facts) {
    let origin = &world.origin;
    if !origin.nearest.is_finite() {
        return;
    }
    let place = if origin.at_camera { "the camera" } else { "the middle of the scene" };
    let line = format!(
        "precision: positions {:.1e} from the camera are rounded to {:.1e}, {:.1e} of a pixel, relative to {place}",
        origin.nearest, origin.rounding, origin.pixels
    );
    let value = json!({
        "origin": origin.position.to_array(),
        "at_camera": origin.at_camera,
        "extent": origin.extent,
        "nearest": origin.nearest,
        "rounding": origin.rounding,
        "pixels": origin.pixels,
    });
    facts.add("precision", value, line);
}

fn contents(scene: &Scene, facts: &mut Facts) {
    let mut counts = [0usize; 5];
    for shape in &scene.shapes {
        counts[match shape.kind {
            ShapeKind::Sphere { .. } => 0,
            ShapeKind::Plane { .. } => 1,
            ShapeKind::Triangle { .. } => 2,
            ShapeKind::Trimesh(ref mesh) => {
                // The first copy.
                counts[4] += usize::from(mesh.transform.is_some());
                3
            }
            ShapeKind::Instance { .. } => 4,
        }] += 1;
    }
    let [spheres, planes, triangles, meshes, instances] = counts;
    let shapes = json!({ "sphere": spheres, "plane": planes, "triangle": triangles,
                         "trimesh": meshes, "instance": instances });
    let line = format!(
        "shapes: {}, {}, {}, {}{}",
        units::plural(spheres, "sphere"),
        units::plural(planes, "plane"),
        units::plural(triangles, "triangle"),
        units::counted(meshes as u64, ["mesh", "meshes"]),
        match instances {
            0 => String::new(),
            _ => format!(", {}", units::plural(instances, "instance")),
        }
    );
    facts.add("shapes", shapes, line);
    let [mut point, mut area, mut sun, mut environment] = [0; 4];
    for light in &scene.lights {
        match light.kind {
            LightKind::Point { .. } => point += 1,
            LightKind::Area { .. } => area += 1,
            LightKind::Sun { .. } => sun += 1,
            LightKind::Environment { .. } => environment += 1,
        }
    }
    let line = format!("lights: {point} point, {area} area, {sun} sun, {environment} environment");
    let value = json!({ "pointlight": point, "arealight": area, "sun": sun,
                        "environment": environment });
    facts.add("lights", value, line);
}
