//! Checks the lights. An area light is the rectangle of docs/guide/lights.md and must have an area.

use std::f64::consts::PI;

use glam::DVec3;

use crate::scene::checked::{CheckedLight, LightKind, MapUse};
use crate::scene::description::{
    AreaLight, Color, Direction, Emission, EnvironmentDescription, LightDescription, Name, Sky,
};

use super::camera::scaled_to_range;
use super::context::Check;
use super::geometry::is_flat;

impl Check<'_, '_> {
    /// Checks `/scene/lightsources` and makes the checked lights.
    pub(super) fn lights(&mut self) -> Vec<CheckedLight> {
        let mut lights: Vec<CheckedLight> = Vec::new();
        for i in 0..self.count("/scene/lightsources") {
            let pointer = format!("/scene/lightsources/{i}");
            let Some(light) = self.part::<LightDescription>(&pointer) else {
                continue;
            };
            let (kind, name, group, id, specular) = match light {
                LightDescription::Environment(l) => {
                    let map = self.map(&pointer, &l);
                    let kind = LightKind::Environment { samples: l.samples, map };
                    let factor = l.factor();
                    (kind, l.name, l.group, factor, l.specular)
                }
                LightDescription::Directional(l) => {
                    let kind = LightKind::Sun {
                        towards: self.towards(&pointer, l.sky),
                        angle_deg: 0.0,
                        samples: 1,
                    };
                    let id = self.distant_color(&pointer, l.id, l.irradiance);
                    (kind, l.name, l.group, id, l.specular)
                }
                LightDescription::Sun(l) => {
                    // A sun of size 0 has only one direction.
                    let samples = if l.angle > 0.0 { l.samples } else { 1 };
                    let towards = self.towards(&pointer, l.sky);
                    let kind = LightKind::Sun { towards, angle_deg: l.angle, samples };
                    let id = self.distant_color(&pointer, l.id, l.irradiance);
                    (kind, l.name, l.group, id, l.specular)
                }
                LightDescription::PointLight(l) => {
                    let kind = LightKind::Point { position: l.position.vec() };
                    (kind, l.name, l.group, l.id, l.specular)
                }
                LightDescription::AreaLight(l) => {
                    (self.area(&pointer, &l), l.name, l.group, l.id, l.specular)
                }
            };
            lights.push(CheckedLight {
                name: self.name(&format!("{pointer}/name"), &name),
                group: self.name(&format!("{pointer}/group"), &group),
                diffuse: id.vec(),
                specular: specular.unwrap_or(id).vec(),
                kind,
            });
        }
        lights
    }

    /// Checks that an environment has a radiance or an image, and that the image exists. Returns
    /// the image.
    fn map(&mut self, pointer: &str, light: &EnvironmentDescription) -> Option<MapUse> {
        let Some(Name(written)) = &light.image else {
            if light.radiance.is_none() {
                let message = "found neither, expected `radiance` or `image`";
                self.problems.error(pointer, message, None);
            }
            if light.rotation != 0.0 {
                let message = "found `rotation` without `image`; it has no effect";
                self.problems.warn(&format!("{pointer}/rotation"), message, None);
            }
            return None;
        };
        let place = format!("{pointer}/image");
        let path = self.file(&place, written, "an image");
        let place = self.document.place(&place);
        Some(MapUse { place, path, rotation_deg: light.rotation, visible: light.visible })
    }

    /// Returns the unit direction towards a distant light. After an error, any direction.
    fn towards(&mut self, pointer: &str, sky: Sky) -> DVec3 {
        let Some(towards) = sky.towards() else {
            let found = match sky.direction {
                Some(_) => "`direction` together with `azimuth` or `elevation`",
                None => "no complete direction",
            };
            let message =
                format!("found {found}, expected `direction`, or `azimuth` and `elevation`");
            self.problems.error(pointer, message, None);
            return DVec3::Y;
        };
        let towards = scaled_to_range(Direction(towards.to_array()));
        if towards == DVec3::ZERO {
            let message = "found a zero vector, expected a direction";
            self.problems.error(&format!("{pointer}/direction"), message, None);
            return DVec3::Y;
        }
        towards.normalize()
    }

    /// Returns the colour of a distant light, from exactly one of `id` and `irradiance`. A diffuse
    /// surface that faces the light returns `id` times its own colour.
    fn distant_color(
        &mut self,
        pointer: &str,
        id: Option<Color>,
        irradiance: Option<Color>,
    ) -> Color {
        match (id, irradiance) {
            (Some(id), None) => id,
            (None, Some(Color(irradiance))) => Color(irradiance.map(|e| e / PI)),
            (id, _) => {
                let found = if id.is_some() { "both" } else { "neither" };
                let message = format!("found {found}, expected `id` or `irradiance`");
                self.problems.error(pointer, message, None);
                Color::default()
            }
        }
    }

    fn area(&mut self, pointer: &str, light: &AreaLight) -> LightKind {
        let corner = light.v0.vec();
        let edge = light.v1.vec() - corner;
        let across = light.v2.vec() - corner;
        if is_flat(edge, across) {
            let message =
                "found an area light of zero area, expected v0, v1 and v2 not on one line";
            self.problems.error(pointer, message, None);
        }
        LightKind::Area {
            corner,
            edge,
            height: across - edge * (across.dot(edge) / edge.length_squared()),
            samples: light.samples,
            lambertian: light.emission == Emission::Lambertian,
        }
    }
}
