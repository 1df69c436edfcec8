//! Warns about valid values that are most likely mistakes in the scene as a whole.

use glam::DVec3;

use crate::scene::checked::{FIRST_SHADOW_POINTS, LightKind, Scene, ShapeKind};
use crate::scene::layers::Layer;
use crate::units::counted;

use super::context::Check;

/// Cosine between the view and the y axis above which the camera looks straight up or down.
const ALONG_Y: f64 = 0.99;

/// The same cosine at 45 degrees above or below the horizon.
const STEEP: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Cosine between two directions below which they are about at right angles.
const ACROSS: f64 = 0.5;

/// Sine of the angle of an exported `up` to the picture's plane: 0 but for rounding.
const IN_PICTURE: f64 = 1e-3;

impl Check<'_, '_> {
    /// Warns about a camera or a light inside a sphere, suns below the horizon, poles without a
    /// texture, mirrors without bounces, at least as many draws as lights, adaptive shadows that
    /// cannot skip a ray, and skies whose up is not the camera's.
    pub(super) fn warn_about_mistakes(&mut self, scene: &Scene) {
        let spheres: Vec<(usize, DVec3, f64)> = scene
            .shapes
            .iter()
            .enumerate()
            .filter_map(|(i, shape)| match shape.kind {
                ShapeKind::Sphere { center, radius, .. } => Some((i, center, radius)),
                _ => None,
            })
            .collect();
        let around = |point: DVec3| {
            let holds = move |sphere: &&(usize, DVec3, f64)| point.distance(sphere.1) < sphere.2;
            spheres.iter().filter(holds).map(|(i, ..)| *i)
        };
        let enclosing: Vec<usize> = around(scene.camera.position).collect();
        for i in enclosing.iter().filter(|&&i| scene.shapes[i].visible.camera) {
            let message = format!(
                "found the camera inside the sphere /scene/shapes/{i}; it sees only the inner side"
            );
            self.problems.warn(&format!("/scene/shapes/{i}"), message, None);
        }
        for (l, light) in scene.lights.iter().enumerate() {
            let point = match light.kind {
                LightKind::Point { position } => position,
                LightKind::Area { corner, edge, height, .. } => corner + (edge + height) / 2.0,
                LightKind::Environment { .. } => continue,
                LightKind::Sun { towards, angle_deg, .. } => {
                    let elevation = towards.y.clamp(-1.0, 1.0).asin().to_degrees();
                    let pointer = format!("/scene/lightsources/{l}");
                    // In a scene whose z is up, a `direction` may well have y < 0.
                    let by_angles = self.document.get(&format!("{pointer}/elevation")).is_some();
                    if by_angles && elevation < -angle_deg / 2.0 {
                        let message = format!(
                            "found the light {:.1} degrees below the horizon; y is up",
                            -elevation
                        );
                        self.problems.warn(&pointer, message, None);
                    }
                    continue;
                }
            };
            let shades = |i: &usize| scene.shapes[*i].visible.shadow && !enclosing.contains(i);
            if let Some(i) = around(point).find(shades) {
                let message = format!(
                    "found the light inside the sphere /scene/shapes/{i}, so everything outside the sphere is in its shadow"
                );
                self.problems.warn(&format!("/scene/lightsources/{l}"), message, None);
            }
        }
        let shows_uv = scene.layers.contains(&Layer::Uv);
        for (i, shape) in scene.shapes.iter().enumerate() {
            let pointer = format!("/scene/shapes/{i}/pole");
            let used = shows_uv || scene.materials[shape.material].texture.is_some();
            if !used && self.document.get(&pointer).is_some() {
                let message = "found `pole` without a texture; it has no effect";
                self.problems.warn(&pointer, message, None);
            }
        }
        if scene.nbounces == 0 && scene.materials.iter().any(|m| m.kr > 0.0) {
            let message = "found 0 although a material has `kr` > 0; mirrors do not reflect";
            self.problems.warn("/nbounces", message, Some("set `nbounces` to 1 or more".into()));
        }
        if scene.emitter_samples.is_some() && !scene.draws_lights() {
            let what = ["point or area light; it is used", "point and area lights; all are used"];
            let placed = counted(scene.placed_lights() as u64, what);
            let message = format!("found no fewer than the {placed}");
            self.problems.warn("/emittersamples", message, None);
        }
        if scene.adaptive_shadows && !scene.can_skip_shadow_rays() {
            let (reason, help) = why_none_is_skipped(scene);
            let message = format!("found true, but {reason}; every shadow ray is traced");
            self.problems.warn("/adaptiveshadows", message, Some(help.into()));
        }
        self.warn_about_another_up(scene);
    }

    /// Warns if another axis than y seems to point up, and lights count on y.
    fn warn_about_another_up(&mut self, scene: &Scene) {
        let up = scene.camera.up;
        // The `up` of a matrix is that of the picture.
        let is_named = self.document.get("/camera/up").is_some();
        if !is_named || !is_another_up(scene.camera.lookat, up) {
            return;
        }
        let axis = if up.x.abs() > up.z.abs() { "x" } else { "z" };
        for (l, light) in scene.lights.iter().enumerate() {
            let key = match light.kind {
                LightKind::Sun { .. } => "elevation",
                LightKind::Environment { map: Some(_), .. } => "image",
                _ => continue,
            };
            let pointer = format!("/scene/lightsources/{l}/{key}");
            if self.document.get(&pointer).is_some() {
                let message = format!(
                    "y is up in the sky, but the camera's `up` is mainly {axis}: is {axis} up in the scene?"
                );
                let help = match key {
                    "elevation" => "if so, give the sun a `direction`, or turn the scene",
                    _ => "if so, turn the scene, for example meshes with \"rotate\": [-90, 0, 0]",
                };
                self.problems.warn(&pointer, message, Some(help.into()));
            }
        }
    }
}

/// Returns why adaptive shadows cannot skip a ray, and what helps.
fn why_none_is_skipped(scene: &Scene) -> (String, &'static str) {
    let lights = || scene.lights.iter().map(|light| &light.kind).filter(|kind| kind.has_extent());
    let mut many = lights().filter(|kind| kind.samples() > FIRST_SHADOW_POINTS);
    if lights().any(|kind| scene.has_one_point(kind)) {
        let reason = "`emittersamples` takes one point of each area light that it draws";
        (reason.into(), "leave out one of the two")
    } else if many.next().is_none() {
        let reason = format!("no area light has more than {FIRST_SHADOW_POINTS} `samples`");
        (reason, "give lights more `samples`, or leave it out")
    } else {
        let reason = "only lights with an `image` have more than";
        let help = "it does not apply to images: leave it out";
        (format!("{reason} {FIRST_SHADOW_POINTS} `samples`"), help)
    }
}

/// Returns true if the camera's `up` tells that another axis than y is up in the scene, or that the
/// camera is rolled, which looks the same.
///
/// An `up` in the picture's plane, as programs export it, leans with the view. So it tells nothing
/// where the view is steep. There, an `up` out of that plane tells it: someone wrote the scene's
/// axis. It then points along the axis, not against it.
fn is_another_up(view: DVec3, up: DVec3) -> bool {
    let (view, up) = (view.normalize(), up.normalize());
    let main = if up.x.abs() > up.z.abs() { up.x } else { up.z };
    if up.y.abs() >= main.abs() || view.y.abs() > ALONG_Y {
        return false;
    }
    if view.y.abs() > STEEP {
        return main > 0.0 && up.dot(view).abs() > IN_PICTURE;
    }
    let in_picture = |axis: DVec3| (axis - view * view.dot(axis)).normalize();
    in_picture(up).dot(in_picture(DVec3::Y)).abs() < ACROSS
}
