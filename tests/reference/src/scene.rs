//! Scene files ("Top level", "scene", "Lights", "Shapes", "Material") read into plain structs.

use super::camera::Camera;
use super::geometry::Shape;
use super::json::{need_number, need_vec3, number_or, switch_or, vec3_or, word_or};
use super::mesh::Mesh;
use super::texture::Texture;
use glam::DVec3;
use serde_json::Value;
use std::path::Path;

/// A scene, ready for rays.
pub struct Scene {
    pub nbounces: usize,
    pub spp: usize,
    pub transparent: bool,
    pub camera: Camera,
    pub background: DVec3,
    pub ambient: DVec3,
    pub attenuation: Attenuation,
    pub lights: Vec<Light>,
    pub objects: Vec<Object>,
}

/// Divisor of a light's radiance at distance d.
#[derive(Clone, Copy, PartialEq)]
pub enum Attenuation {
    None,
    Linear,
    Quadratic,
}

/// A light: its points, and the emission of each point.
pub struct Light {
    pub id: DVec3,
    pub is: DVec3,
    pub form: LightForm,
}

/// Positions of a light's points.
pub enum LightForm {
    /// A single point.
    Point(DVec3),
    /// The points `corner + s e + t h`.
    Area { corner: DVec3, e: DVec3, h: DVec3, lambertian: bool, samples: usize },
}

/// A shape with its material.
pub struct Object {
    pub shape: Shape,
    pub material: Material,
}

/// "Material", Blinn-Phong.
pub struct Material {
    pub kd: f64,
    pub ks: f64,
    pub ka: f64,
    pub kr: f64,
    pub specularexponent: f64,
    pub diffusecolor: DVec3,
    pub texture: Option<Texture>,
}

impl Scene {
    /// Reads a scene file; asset paths are relative to its folder.
    pub fn load(path: &Path) -> Scene {
        let text = std::fs::read_to_string(path).expect("scene file");
        let json: Value = serde_json::from_str(&text).expect("JSON");
        let folder = path.parent().expect("a file has a folder");
        let scene = &json["scene"];
        let named = &scene["materials"];
        let list = |key: &str| scene[key].as_array().cloned().unwrap_or_default();
        Scene {
            nbounces: number_or(&json, "nbounces", 1.0) as usize,
            spp: number_or(&json, "spp", 1.0) as usize,
            transparent: json.get("output").is_some_and(|o| switch_or(o, "transparent", false)),
            camera: Camera::read(&json["camera"]),
            background: vec3_or(scene, "backgroundcolor", DVec3::ZERO),
            ambient: vec3_or(scene, "ambient", DVec3::ZERO),
            attenuation: match word_or(scene, "attenuation", "linear") {
                "none" => Attenuation::None,
                "linear" => Attenuation::Linear,
                "quadratic" => Attenuation::Quadratic,
                other => panic!("attenuation {other}"),
            },
            lights: list("lightsources").iter().map(read_light).collect(),
            objects: list("shapes").iter().map(|s| read_object(s, named, folder)).collect(),
        }
    }
}

fn read_light(json: &Value) -> Light {
    let id = need_vec3(json, "id");
    let form = match json["type"].as_str() {
        Some("pointlight") => LightForm::Point(need_vec3(json, "position")),
        Some("arealight") => {
            let corner = need_vec3(json, "v0");
            let e = need_vec3(json, "v1") - corner;
            let side = need_vec3(json, "v2") - corner;
            let h = side - e * (side.dot(e) / e.dot(e));
            let lambertian = word_or(json, "emission", "uniform") == "lambertian";
            let samples = number_or(json, "samples", 16.0) as usize;
            LightForm::Area { corner, e, h, lambertian, samples }
        }
        other => panic!("light {other:?}"),
    };
    Light { id, is: vec3_or(json, "is", id), form }
}

fn read_object(json: &Value, named: &Value, folder: &Path) -> Object {
    let corner = |k: usize| need_vec3(json, &format!("v{k}"));
    let (shape, wrap) = match json["type"].as_str() {
        Some("sphere") => {
            let (center, radius) = (need_vec3(json, "center"), need_number(json, "radius"));
            let pole = word_or(json, "pole", "z").chars().next().expect("a pole");
            (Shape::Sphere { center, radius, pole }, ["repeat", "clamp"])
        }
        Some("plane") => (Shape::Plane(std::array::from_fn(corner)), ["clamp", "clamp"]),
        Some("triangle") => (Shape::Triangle(std::array::from_fn(corner)), ["clamp", "clamp"]),
        Some("trimesh") => (Shape::Mesh(Mesh::load(json, folder)), ["repeat", "repeat"]),
        other => panic!("shape {other:?}"),
    };
    let material = match &json["material"] {
        Value::String(name) => &named[name.as_str()],
        inline => inline,
    };
    Object { shape, material: read_material(material, folder, wrap) }
}

fn read_material(json: &Value, folder: &Path, wrap: [&str; 2]) -> Material {
    Material {
        kd: number_or(json, "kd", 1.0),
        ks: number_or(json, "ks", 0.0),
        ka: number_or(json, "ka", 0.0),
        kr: number_or(json, "kr", 0.0),
        specularexponent: number_or(json, "specularexponent", 1.0),
        diffusecolor: vec3_or(json, "diffusecolor", DVec3::ONE),
        texture: json.get("tPath").map(|_| Texture::load(json, folder, wrap)),
    }
}
