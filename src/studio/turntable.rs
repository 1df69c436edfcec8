//! Frames of a turntable: the same shapes, seen from all around.
//!
//! The shapes never move. A frame turns the camera, and also the lights if these stay with the
//! camera. So the geometry and the acceleration structure serve all frames, and a frame is an
//! ordinary scene. Positions and normals in layers, and the camera in a file's header, are in the
//! space of that scene.

use clap::ValueEnum;
use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scene::SceneDescription;
use crate::scene::written::{Axes, CameraDescription, LightDescription, MAX_TURN, Matrix};

use super::axes::main_axis;

/// The object that turns: mesh or camera.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Turning {
    /// the object and all shapes, as on a turntable
    #[default]
    Object,
    /// the camera, around the object
    Camera,
}

/// The object that lights stay with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum LightsFollow {
    /// the camera: light falls from the same side in every frame
    Camera,
    /// the object: its lit side turns with it
    Object,
}

/// Frames at equal angles over a whole turn, counterclockwise as seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turntable {
    /// Number of frames, >= 1.
    pub frames: u32,
    /// The object that turns.
    pub turn: Turning,
    /// The object that lights stay with.
    pub lights: LightsFollow,
    /// Angle of the first frame in degrees.
    pub start_deg: f64,
}

impl Turntable {
    /// Makes a turntable of `frames` frames: the object turns, and the lights stay with the camera.
    #[cfg(test)]
    pub fn new(frames: u32) -> Self {
        Self { frames, turn: Turning::Object, lights: LightsFollow::Camera, start_deg: 0.0 }
    }

    /// Returns true unless the only frame is the scene itself.
    pub fn turns(&self) -> bool {
        self.frames > 1 || self.start_deg % 360.0 != 0.0
    }

    /// Returns the scene of one frame, turned about the vertical axis (the main axis of the
    /// camera's `up`) through `pivot`. Frame 0 of a turntable that starts at 0 is the scene itself,
    /// bit for bit.
    ///
    /// The image of an environment turns about y only: about another axis it stays where it is.
    pub fn frame(&self, scene: &SceneDescription, pivot: DVec3, frame: u32) -> SceneDescription {
        let mut scene = scene.clone();
        let turned = self.start_deg + 360.0 * f64::from(frame) / f64::from(self.frames);
        // Turning the object one way looks the same as moving the camera the other way.
        let degrees = match self.turn {
            Turning::Object => -turned,
            Turning::Camera => turned,
        };
        if degrees % 360.0 == 0.0 {
            return scene;
        }
        let up = up(&scene.camera);
        let turn = turn(up, degrees);
        let direction = |v: &mut [f64; 3]| *v = (turn * DVec3::from(*v)).to_array();
        let point = |p: &mut [f64; 3]| {
            *p = (turn * (DVec3::from(*p) - pivot) + pivot).to_array();
        };
        if let Some((position, aim)) = scene.camera.stand_mut() {
            point(&mut position.0);
            aim.lookat.iter_mut().for_each(|v| direction(&mut v.0));
            aim.target.iter_mut().for_each(|p| point(&mut p.0));
            direction(&mut aim.up.0);
        }
        if let CameraDescription::Intrinsics(camera) = &mut scene.camera {
            camera.camera_to_world.iter_mut().for_each(|m| turn_to_world(m, turn, pivot));
            camera.world_to_camera.iter_mut().for_each(|m| turn_to_camera(m, turn, pivot));
        }
        if self.lights == LightsFollow::Camera {
            for light in &mut scene.scene.lightsources {
                match light {
                    LightDescription::PointLight(light) => point(&mut light.position.0),
                    LightDescription::AreaLight(light) => {
                        [&mut light.v0, &mut light.v1, &mut light.v2]
                            .into_iter()
                            .for_each(|p| point(&mut p.0));
                    }
                    LightDescription::Environment(light) => {
                        if main_axis(up) == 1 && light.image.is_some() {
                            // An azimuth goes clockwise as seen from +y.
                            let turned = light.rotation - degrees * up.y.signum();
                            let fits = turned.abs() <= MAX_TURN;
                            light.rotation = if fits { turned } else { turned % 360.0 };
                        }
                    }
                    LightDescription::Directional(light) => light.sky.turn(turn),
                    LightDescription::Sun(light) => light.sky.turn(turn),
                }
            }
        }
        scene
    }
}

/// Returns the up direction of a camera in world space, of any length.
fn up(camera: &CameraDescription) -> DVec3 {
    if let Some((_, aim)) = camera.stand() {
        return aim.up.0.into();
    }
    let CameraDescription::Intrinsics(camera) = camera else { return DVec3::Y };
    let column = camera.camera_to_world.map(|Matrix(m)| DVec3::new(m[0][1], m[1][1], m[2][1]));
    let row = camera.world_to_camera.map(|Matrix(m)| DVec3::new(m[1][0], m[1][1], m[1][2]));
    let y = column.or(row).unwrap_or(DVec3::Y);
    if camera.axes == Axes::OpenCv { -y } else { y }
}

/// Turns a `camera_to_world` matrix about an axis through `pivot`.
fn turn_to_world(Matrix(rows): &mut Matrix, turn: DMat3, pivot: DVec3) {
    for k in 0..4 {
        let column = DVec3::new(rows[0][k], rows[1][k], rows[2][k]);
        let turned = if k < 3 { turn * column } else { turn * (column - pivot) + pivot };
        (0..3).for_each(|row| rows[row][k] = turned[row]);
    }
}

/// Turns a `world_to_camera` matrix about an axis through `pivot`. With T = `turn`, its map
/// `q = R p + t` becomes `q = R T^-1 (p - pivot) + R pivot + t`.
fn turn_to_camera(Matrix(rows): &mut Matrix, turn: DMat3, pivot: DVec3) {
    for row in rows.iter_mut().take(3) {
        let [x, y, z, t] = *row;
        let before = DVec3::new(x, y, z);
        let after = turn * before;
        *row = [after.x, after.y, after.z, t + before.dot(pivot) - after.dot(pivot)];
    }
}

/// Returns the rotation by `degrees` about the main axis of `up`, counterclockwise as seen from its
/// positive side.
fn turn(up: DVec3, degrees: f64) -> DMat3 {
    let axis = main_axis(up);
    let turn = DMat3::from_axis_angle(
        DVec3::AXES[axis] * up[axis].signum(),
        (degrees % 360.0).to_radians(),
    );
    // Quarter turns must be exact, so that a square stays a square.
    let exact = |x: f64| if (x - x.round()).abs() < 1e-15 { x.round() } else { x };
    DMat3::from_cols_array(&turn.to_cols_array().map(exact))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Source, from_description, load};

    fn scene() -> SceneDescription {
        let text = br#"{ "camera": { "type": "pinhole", "width": 4, "height": 4, "fov": 40,
            "position": [1, 2, 5], "lookat": [0, -0.25, -1], "up": [0, 1, 0] },
            "scene": { "shapes": [{ "type": "sphere", "center": [1, 0, 0], "radius": 1,
              "material": {} }],
            "lightsources": [{ "type": "pointlight", "position": [1, 7, 3], "id": [1, 1, 1] }] } }"#;
        let source = Source::Text { name: "x", text, folder: "".as_ref() };
        load(source, &[]).unwrap().description
    }

    fn stand(scene: &SceneDescription) -> ([f64; 3], [f64; 3]) {
        let (position, aim) = scene.camera.stand().unwrap();
        (position.0, aim.lookat.unwrap().0)
    }

    #[test]
    fn matrices_turn_as_position_and_direction_do() {
        let (mut scene, pivot) = (scene(), DVec3::new(0.5, -1.0, 0.25));
        let camera = CameraDescription::Intrinsics(
            serde_json::from_value(serde_json::json!({
                "width": 4, "height": 4, "fx": 5.0,
                "camera_to_world": [[1.0, 0.0, 0.0, 1.0], [0.0, -1.0, 0.0, 2.0],
                                    [0.0, 0.0, -1.0, 5.0], [0.0, 0.0, 0.0, 1.0]]
            }))
            .unwrap(),
        );
        // The same pose, inverted by hand.
        let mut inverted = camera.clone();
        let CameraDescription::Intrinsics(other) = &mut inverted else { unreachable!() };
        other.camera_to_world = None;
        let rows = [[1.0, 0.0, 0.0, -1.0], [0.0, -1.0, 0.0, 2.0], [0.0, 0.0, -1.0, 5.0]];
        other.world_to_camera = Some(Matrix([rows[0], rows[1], rows[2], [0.0, 0.0, 0.0, 1.0]]));
        let turning = Turntable { turn: Turning::Camera, ..Turntable::new(3) };
        let seen = [camera, inverted].map(|camera| {
            scene.camera = camera;
            let frame = turning.frame(&scene, pivot, 1);
            from_description("x", &frame, "".as_ref(), &[]).unwrap().scene.camera
        });
        let turn = DMat3::from_rotation_y(120f64.to_radians());
        for camera in seen {
            let position = turn * (DVec3::new(1.0, 2.0, 5.0) - pivot) + pivot;
            assert!((camera.position - position).length() < 1e-14);
            assert!((camera.lookat - turn * DVec3::NEG_Z).length() < 1e-14);
            assert!((camera.up - DVec3::Y).length() < 1e-14);
        }
    }

    #[test]
    fn a_quarter_turn_of_object_and_camera_goes_opposite_ways() {
        let (scene, pivot) = (scene(), DVec3::X);
        let object = Turntable::new(4);
        let seen = object.frame(&scene, pivot, 1);
        // The object turns from +z to +x, so the camera at +z moves to -x.
        assert_eq!(stand(&seen), ([-4.0, 2.0, 0.0], [1.0, -0.25, 0.0]));
        assert!(
            matches!(&seen.scene.lightsources[0], LightDescription::PointLight(l) if l.position.0 == [-2.0, 7.0, 0.0])
        );
        let camera = Turntable { turn: Turning::Camera, lights: LightsFollow::Object, ..object };
        let seen = camera.frame(&scene, pivot, 1);
        assert_eq!(stand(&seen).0, [6.0, 2.0, 0.0]);
        assert_eq!(seen.scene.lightsources, scene.scene.lightsources);
        assert_eq!(seen.scene.shapes, scene.scene.shapes);
    }

    #[test]
    fn an_image_around_the_scene_stays_with_the_camera() {
        let mut scene = scene();
        let environment = |image: Option<&str>| {
            serde_json::from_value(serde_json::json!(
                { "type": "environment", "image": image, "rotation": 30.0 }
            ))
            .unwrap()
        };
        scene.scene.lightsources = vec![environment(Some("sky.exr")), environment(None)];
        let rotations = |table: Turntable, scene: &SceneDescription| {
            let seen = table.frame(scene, DVec3::X, 1);
            let lights = seen.scene.lightsources.iter().map(|light| match light {
                LightDescription::Environment(light) => light.rotation,
                _ => unreachable!(),
            });
            lights.collect::<Vec<_>>()
        };
        // The camera moves from +z to -x and so looks towards +x, at azimuth 90 instead of 0.
        let object = Turntable::new(4);
        assert_eq!(rotations(object, &scene), [120.0, 30.0]);
        let held = Turntable { lights: LightsFollow::Object, ..object };
        assert_eq!(rotations(held, &scene), [30.0, 30.0]);
        let set_up = |scene: &mut SceneDescription, up: [f64; 3]| {
            scene.camera.stand_mut().unwrap().1.up.0 = up;
        };
        set_up(&mut scene, [0.0, -1.0, 0.0]);
        assert_eq!(rotations(object, &scene), [-60.0, 30.0]);
        set_up(&mut scene, [0.0, 0.0, 1.0]);
        assert_eq!(rotations(object, &scene), [30.0, 30.0]);
        // The largest angle of a scene stays within the bounds: 1000090 is 2778 turns and 10.
        set_up(&mut scene, [0.0, 1.0, 0.0]);
        if let LightDescription::Environment(light) = &mut scene.scene.lightsources[0] {
            light.rotation = MAX_TURN;
        }
        assert_eq!(rotations(object, &scene), [10.0, 30.0]);
    }

    #[test]
    fn the_first_frame_equals_the_scene() {
        let scene = scene();
        assert_eq!(Turntable::new(7).frame(&scene, DVec3::splat(0.1), 0), scene);
    }
}
