//! Checks the lights. An area light is the rectangle of docs/guide/scene-format.md and must have an
//! area.

use crate::scene::{
    checked::{Light, LightKind},
    description::{self, AreaLight, Emission},
};

use super::{context::Check, geometry::is_flat};

impl Check<'_, '_> {
    /// Checks `/scene/lightsources` and makes the checked lights.
    pub(super) fn lights(&mut self) -> Vec<Light> {
        let mut lights: Vec<Light> = Vec::new();
        for i in 0..self.count("/scene/lightsources") {
            let pointer = format!("/scene/lightsources/{i}");
            let Some(light) = self.part::<description::Light>(&pointer) else {
                continue;
            };
            let (kind, name, group, id, specular) = match light {
                description::Light::PointLight(l) => {
                    let kind = LightKind::Point { position: l.position.vec() };
                    (kind, l.name, l.group, l.id, l.specular)
                }
                description::Light::AreaLight(l) => {
                    (self.area(&pointer, &l), l.name, l.group, l.id, l.specular)
                }
            };
            lights.push(Light {
                name: self.name(&format!("{pointer}/name"), &name),
                group: self.name(&format!("{pointer}/group"), &group),
                diffuse: id.vec(),
                specular: specular.unwrap_or(id).vec(),
                kind,
            });
        }
        lights
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
