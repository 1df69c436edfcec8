//! Frames of a turntable: the same shapes, seen from around.
//!
//! Whatever turns, the shapes stay where they are: a frame turns the camera, and the lights if these
//! stay with it. So the geometry and what is built over it serve all frames, and a frame is an ordinary
//! scene. Positions and normals in layers, and the camera in a file's header, are those of this scene.

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scene::{Description, written::Light};

use super::furnish::main_axis;

/// What turns.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Turning {
    /// the object with all shapes, as on a turntable
    #[default]
    Object,
    /// the camera, around the object
    Camera,
}

/// What lights stay with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Fixed {
    /// the camera: light falls from the same side in every frame
    Camera,
    /// the object: its lit side turns with it
    Object,
}

/// Frames evenly around a whole turn, counterclockwise as seen from above.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turntable {
    /// How many, >= 1.
    pub frames: u32,
    /// What turns.
    pub turn: Turning,
    /// What the lights stay with.
    pub lights: Fixed,
    /// Degrees at the first frame.
    pub start_deg: f64,
}

impl Turntable {
    /// So many frames of a turning object, the lights staying in the room.
    pub fn new(frames: u32) -> Self {
        Self { frames, turn: Turning::Object, lights: Fixed::Camera, start_deg: 0.0 }
    }

    /// The scene of one frame, turned about the vertical axis (the main axis of the camera's `up`)
    /// through `pivot`. Frame 0 of a turntable that starts at 0 is the scene itself, bit for bit.
    pub fn frame(&self, scene: &Description, pivot: DVec3, frame: u32) -> Description {
        let mut scene = scene.clone();
        let turned = self.start_deg + 360.0 * f64::from(frame) / f64::from(self.frames);
        // What is seen of a turning object, a camera sees that goes the other way.
        let degrees = match self.turn {
            Turning::Object => -turned,
            Turning::Camera => turned,
        };
        if degrees % 360.0 == 0.0 {
            return scene;
        }
        let turn = turn(scene.camera.up.0.into(), degrees);
        let direction = |v: &mut [f64; 3]| *v = (turn * DVec3::from(*v)).to_array();
        let point = |p: &mut [f64; 3]| {
            *p = (turn * (DVec3::from(*p) - pivot) + pivot).to_array();
        };
        let camera = &mut scene.camera;
        point(&mut camera.position.0);
        camera.lookat.iter_mut().for_each(|v| direction(&mut v.0));
        camera.target.iter_mut().for_each(|p| point(&mut p.0));
        direction(&mut camera.up.0);
        if self.lights == Fixed::Camera {
            for light in &mut scene.scene.lightsources {
                match light {
                    Light::PointLight(light) => point(&mut light.position.0),
                    Light::AreaLight(light) => {
                        [&mut light.v0, &mut light.v1, &mut light.v2]
                            .into_iter()
                            .for_each(|p| point(&mut p.0));
                    }
                }
            }
        }
        scene
    }
}

/// The turn by `degrees` about the main axis of `up`, counterclockwise as seen from its side.
fn turn(up: DVec3, degrees: f64) -> DMat3 {
    let axis = main_axis(up);
    let turn = DMat3::from_axis_angle(
        DVec3::AXES[axis] * up[axis].signum(),
        (degrees % 360.0).to_radians(),
    );
    // Quarter turns must be exact, or a square would not stay one.
    let exact = |x: f64| if (x - x.round()).abs() < 1e-15 { x.round() } else { x };
    DMat3::from_cols_array(&turn.to_cols_array().map(exact))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Source, load};

    fn scene() -> Description {
        let text = br#"{ "camera": { "type": "pinhole", "width": 4, "height": 4, "fov": 40,
            "position": [1, 2, 5], "lookat": [0, -0.25, -1], "up": [0, 1, 0] },
            "scene": { "shapes": [{ "type": "sphere", "center": [1, 0, 0], "radius": 1,
              "material": {} }],
            "lightsources": [{ "type": "pointlight", "position": [1, 7, 3], "id": [1, 1, 1] }] } }"#;
        let source = Source::Text { name: "x", text, folder: "".as_ref() };
        load(source, &[]).unwrap().description
    }

    #[test]
    fn a_quarter_of_a_turn_each_way() {
        let (scene, pivot) = (scene(), DVec3::X);
        let object = Turntable::new(4);
        let seen = object.frame(&scene, pivot, 1);
        // The object turns from +z to +x; the camera at +z goes to -x.
        assert_eq!(seen.camera.position.0, [-4.0, 2.0, 0.0]);
        assert_eq!(seen.camera.lookat.unwrap().0, [1.0, -0.25, 0.0]);
        assert!(
            matches!(&seen.scene.lightsources[0], Light::PointLight(l) if l.position.0 == [-2.0, 7.0, 0.0])
        );
        let camera = Turntable { turn: Turning::Camera, lights: Fixed::Object, ..object };
        let seen = camera.frame(&scene, pivot, 1);
        assert_eq!(seen.camera.position.0, [6.0, 2.0, 0.0]);
        assert_eq!(seen.scene.lightsources, scene.scene.lightsources);
        assert_eq!(seen.scene.shapes, scene.scene.shapes);
    }

    #[test]
    fn the_first_frame_is_the_scene() {
        let scene = scene();
        assert_eq!(Turntable::new(7).frame(&scene, DVec3::splat(0.1), 0), scene);
    }
}
