//! `lightpath info scan.ply --cameras FILE`: where the cameras stand, and how much of the mesh each
//! of them sees.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use serde_json::{Value, json};

use crate::accel::{self, BuildOptions};
use crate::error::{Error, Result};
use crate::film::{ReservedFilm, Window};
use crate::geometry::doubles;
use crate::layers::{FaceCounts, LayerPlan};
use crate::monitor::Monitor;
use crate::poses::Poses;
use crate::render::{RenderContext, render_layers};
use crate::scene::{Backend, CheckedCamera, Loaded, Overrides, Projection};
use crate::studio::{self, Appearance, Studio, Subject, Template};
use crate::units;
use crate::world::{LoadOptions, World};

use super::args::InfoArgs;
use super::facts::Facts;

/// Maximum number of cameras that the text lists; JSON lists all.
const LISTED: usize = 12;

/// How much of the mesh a camera sees.
struct Coverage {
    image: String,
    size: [u32; 2],
    /// Number of faces that at least one of its rays hits: one ray per pixel.
    faces: u64,
    /// Area of these faces, relative to the area of the mesh.
    area: f64,
}

/// Adds the facts of the cameras in `list` for the mesh at `path`.
///
/// # Errors
/// Problems of the list or of the mesh; too little memory.
pub fn describe(path: &Path, list: &Path, args: &InfoArgs, facts: &mut Facts) -> Result<()> {
    let poses = Poses::read(list, false)?;
    poses.check(None)?;
    let monitor = Monitor::default();
    let subject = Subject {
        calibrated: true,
        no_mmap: args.no_mmap,
        looks: Appearance { no_ground: true, ..Appearance::default() },
        ..Subject::new(path)
    };
    let mut overrides = Overrides::default();
    for set in ["/scene/lightsources=[]", "/spp=1", "/sampler=sobol", "/output/layers=[]"] {
        overrides.set(set);
    }
    let template = Template::studio(Studio::default());
    let shown = studio::show(&subject, &template, overrides, None, &monitor)?;
    let base = shown.loaded;
    let frame = |index: usize| -> Result<Loaded> {
        let pose = &poses.list[index];
        base.with_camera(&pose.image, &pose.camera, Path::new(""))
    };
    let first = frame(0)?;
    let options = LoadOptions { ready: vec![shown.mesh], ..LoadOptions::default() };
    let (loaded, _) = World::load(&first.scene, options, &monitor)?;
    let backend = args.backend.map_or(first.scene.backend, Backend::from);
    let build = BuildOptions { threads: rayon::current_num_threads(), max_bytes: None };
    let accelerator = accel::build(&loaded.geometry, backend, &build, &monitor)?;
    let areas = areas(&loaded);
    let whole: f64 = areas.iter().sum();
    let mut cameras = Vec::new();
    let mut seen_by_any = vec![false; areas.len()];
    let mut seen = Vec::new();
    for (index, pose) in poses.list.iter().enumerate() {
        let scene = frame(index)?.scene;
        let world = loaded.frame_of(&scene);
        let counts = Arc::new(FaceCounts::new(loaded.geometry.count())?);
        let plan = LayerPlan { faces: Some(Arc::clone(&counts)), ..LayerPlan::new(&scene) };
        let (width, height) = (scene.camera.width, scene.camera.height);
        let window = Window::full(width, height);
        let mut film = ReservedFilm::new([width, height], window, Vec::new())?.film();
        let (accelerator, isa) = (accelerator.as_ref(), backend.isa());
        let context = RenderContext { world: &world, accelerator, isa, monitor: &monitor };
        render_layers(context, &mut film, &plan, None)?;
        let mut coverage =
            Coverage { image: pose.image.clone(), size: [width, height], faces: 0, area: 0.0 };
        for (primitive, ..) in counts.seen() {
            let Some(area) = areas.get(primitive as usize) else { continue };
            coverage.faces += 1;
            coverage.area += area;
            seen_by_any[primitive as usize] = true;
        }
        coverage.area = share(coverage.area, whole);
        seen.push(coverage);
        cameras.push(scene.camera);
    }
    let of_faces = |count: u64| count as f64 / areas.len().max(1) as f64;
    spread(&cameras, facts);
    distances(&cameras, &loaded, facts);
    let pairs = seen_by_any.iter().zip(&areas).filter(|(seen, _)| **seen);
    let (any, any_area) = pairs.fold((0, 0.0), |(n, sum), (_, area)| (n + 1, sum + area));
    let any_area = share(any_area, whole);
    let line = format!(
        "seen by any camera: {:.1}% of the faces, {:.1}% of the area",
        100.0 * of_faces(any),
        100.0 * any_area
    );
    facts.add("seen", json!({ "faces": of_faces(any), "area": any_area }), line);
    let listed = seen.iter().take(LISTED).map(|one| {
        let [width, height] = one.size;
        let (faces, area) = (100.0 * of_faces(one.faces), 100.0 * one.area);
        format!(
            "{}: {width} x {height}, {faces:.1}% of the faces, {area:.1}% of the area",
            one.image
        )
    });
    facts.lines.extend(listed);
    if seen.len() > LISTED {
        facts.lines.push(format!("and {} more: see --json", seen.len() - LISTED));
    }
    let all: Vec<Value> = seen
        .iter()
        .map(|one| {
            json!({ "image": one.image, "size": one.size, "faces": of_faces(one.faces),
                    "visible_faces": one.faces, "area": one.area })
        })
        .collect();
    facts.add("cameras", json!(all), "");
    Ok(())
}

/// Makes the error for a file that is not a mesh. `found` names it.
pub fn refuse(found: &str) -> Error {
    let message = format!("found with {found}, expected with a PLY mesh");
    Error::invalid("--cameras", message)
}

/// Areas of the mesh's faces, in world units.
fn areas(world: &World) -> Vec<f64> {
    let Some(mesh) = world.geometry.meshes.first() else { return Vec::new() };
    let faces = mesh.triangles().len() - mesh.stitches();
    let corners = (0..faces as u32).map(|face| mesh.corners(face).map(doubles));
    corners.map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).collect()
}

/// Adds the bounds of the cameras' positions, and the spread of their view directions.
fn spread(cameras: &[CheckedCamera], facts: &mut Facts) {
    let low = cameras.iter().fold(DVec3::INFINITY, |low, camera| low.min(camera.position));
    let high = cameras.iter().fold(DVec3::NEG_INFINITY, |high, camera| high.max(camera.position));
    let directions = || cameras.iter().map(|camera| camera.lookat.normalize());
    let mean = directions().sum::<DVec3>().normalize_or_zero();
    let angle = directions().map(|d| d.dot(mean).clamp(-1.0, 1.0).acos().to_degrees());
    let widest = angle.fold(0.0, f64::max);
    let focal: Vec<f64> = cameras.iter().filter_map(focal_length).collect();
    let [shortest, longest] =
        [f64::min as fn(f64, f64) -> f64, f64::max].map(|pick| focal.iter().copied().reduce(pick));
    let line = format!(
        "{}, between {low} and {high}; views up to {widest:.0} degrees from their mean",
        units::plural(cameras.len(), "camera")
    );
    let value = json!({
        "count": cameras.len(),
        "bounds": [low.to_array(), high.to_array()],
        "mean_direction": mean.to_array(),
        "widest_angle": widest,
        "focal_length": [shortest, longest],
    });
    facts.add("poses", value, line);
    if let (Some(shortest), Some(longest)) = (shortest, longest) {
        facts.lines.push(format!("focal lengths: {shortest:.1} to {longest:.1} pixels"));
    }
}

/// Adds the smallest and largest distance of a camera from the middle of the mesh.
fn distances(cameras: &[CheckedCamera], world: &World, facts: &mut Facts) {
    let Some(mesh) = world.geometry.meshes.first() else { return };
    let points = || mesh.vertices().iter().map(|&v| doubles(v));
    let low = points().fold(DVec3::INFINITY, DVec3::min);
    let high = points().fold(DVec3::NEG_INFINITY, DVec3::max);
    let middle = world.geometry.origin + (low + high) / 2.0;
    let away = || cameras.iter().map(|camera| camera.position.distance(middle));
    let (near, far) = (away().fold(f64::INFINITY, f64::min), away().fold(0.0, f64::max));
    let size = (high - low).max_element();
    let line = format!("distance to the mesh's middle: {near:.4} to {far:.4}; its size: {size:.4}");
    facts.add("distance", json!([near, far]), line);
}

/// Returns the focal length in pixels, of a calibrated camera the horizontal one. `None` for a
/// camera without focal length.
fn focal_length(camera: &CheckedCamera) -> Option<f64> {
    match &camera.projection {
        Projection::Perspective { fov_deg, .. } => {
            Some(f64::from(camera.height) / 2.0 / (fov_deg.to_radians() / 2.0).tan())
        }
        Projection::Calibrated(calibration) | Projection::Distorted(calibration, ..) => {
            Some(calibration.focal[0])
        }
        Projection::Orthographic { .. } | Projection::Panorama { .. } => None,
    }
}

/// Returns the share of a part, from 0 to 1. All is 0 of a mesh without area.
fn share(part: f64, whole: f64) -> f64 {
    if whole > 0.0 { (part / whole).min(1.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_are_at_most_all_and_nothing_of_nothing() {
        assert_eq!([share(1.0, 4.0), share(1.0 + 1e-15, 1.0), share(0.0, 0.0)], [0.25, 1.0, 0.0]);
    }
}
