//! Tests of round trips, defaults, the schema and `--set`.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::{Value, json};

use super::description::{ColorMap, LightDescription, MeshColorDescription, StoredColor};
use super::*;
use crate::error::Result;

/// A scene with most keys of the format, none at its default. [`the_rest`] has the other ones.
pub(super) fn everything() -> Value {
    json!({
        "nbounces": 3, "spp": 4, "seed": -7,
        "camera": {
            "type": "thinlens", "width": 640, "height": 480, "fov": 35.5,
            "position": [0, -5, 1], "target": [0, 0, 1], "up": [0, 0, 1],
            "aperture": 0.25, "focaldistance": 5
        },
        "scene": {
            "backgroundcolor": [0.1, 0.2, 0.3], "ambient": [1, 1, 1],
            "attenuation": "quadratic", "accelerator": "embree",
            "lightsources": [
                { "type": "pointlight", "name": "key", "group": "a", "position": [0, 0, 9], "id": [1, 2, 3], "is": [0, 0, 0] },
                { "type": "arealight", "name": "fill", "group": "b", "v0": [0, 0, 5], "v1": [1, 0, 5], "v2": [0.5, 2, 5],
                  "id": [1, 1, 1], "is": [0, 0, 1], "samples": 4, "emission": "lambertian" }
            ],
            "shapes": [
                { "type": "sphere", "name": "ball", "material": "gold", "center": [0, 0, 1], "radius": 1, "pole": "x",
                  "holdout": true, "semantic": 3 },
                { "type": "plane", "name": "floor", "material": { "kr": 0.5 }, "v0": [0, 0, 0], "v1": [1, 0, 0], "v2": [1, 1, 0], "v3": [0, 1, 0],
                  "shadow_catcher": true },
                { "type": "triangle", "name": "t", "material": {}, "v0": [0, 0, 0], "v1": [1, 0, 0], "v2": [1, 1, 0],
                  "visible": { "camera": false, "shadow": false } },
                { "type": "trimesh", "name": "m", "material": "gold", "path": "a.ply", "fit": 2, "rotate": [-90, 0, 0],
                  "size": 2, "center": [1, 0, 0], "smooth": true, "bvh": false, "vertexcolors": false, "vertexcolorspace": "linear",
                  "instances": [[[1, 0, 0, 0], [0, 2, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]] }
            ],
            "materials": { "gold": {
                "kd": 0.5, "ks": 0.25, "ka": 0.125, "kr": 0.1, "specularexponent": 20, "diffusecolor": [1, 0.8, 0],
                "tPath": "a.png", "tWidth": 2, "tHeight": 3, "filter": "nearest", "wrap": "clamp", "colorspace": "linear", "tScale": [2, -1]
            } }
        },
        "tonemap": { "operator": "reinhard", "exposure": -1.5, "transfer": "linear" },
        "output": { "layers": ["N", "Z"], "transparent": true }
    })
}

/// Scenes with the keys that [`everything`] lacks, and all types of cameras, none at its default.
pub(super) fn the_rest() -> [Value; 4] {
    let aimed = |mut camera: Value| {
        for (key, value) in [("position", [0, -5, 1]), ("lookat", [0, 1, 0]), ("up", [0, 0, 1])] {
            camera[key] = json!(value);
        }
        camera
    };
    let pose = json!([[1, 0, 0, 0.5], [0, -1, 0, 2], [0, 0, -1, 7], [0, 0, 0, 1]]);
    let cameras = [
        json!({
            "type": "intrinsics", "width": 16, "height": 12, "fx": 15, "fy": 14.5, "cx": 7, "cy": 5, "skew": 0.25,
            "distortion": { "type": "brownconrady", "k1": 0.01, "k2": 0.02, "k3": 0.03, "k4": 0.015, "k5": 0.025, "k6": 0.035,
                            "p1": 0.001, "p2": 0.002 },
            "world_to_camera": pose
        }),
        json!({
            "type": "intrinsics", "width": 16, "height": 12, "fx": 15,
            "distortion": { "type": "fisheye", "k1": 0.01, "k2": 0.02, "k3": 0.03, "k4": 0.04 },
            "camera_to_world": pose, "axes": "opengl"
        }),
        aimed(json!({ "type": "orthographic", "width": 16, "height": 12, "viewwidth": 2.5 })),
        aimed(
            json!({ "type": "panorama", "width": 16, "height": 12, "longitude": [-90, 45], "latitude": [-30, 60] }),
        ),
    ];
    cameras.map(|camera| {
        json!({
            "sampler": "random", "adaptiveshadows": true, "emittersamples": 2,
            "camera": camera,
            "scene": {
                "lightsources": [
                    { "type": "sun", "name": "day", "group": "a", "azimuth": 30, "elevation": 40, "angle": 2,
                      "irradiance": [3, 3, 2], "is": [1, 0, 0], "samples": 8 },
                    { "type": "directional", "name": "moon", "group": "b", "direction": [0, 1, -1], "id": [0.1, 0.1, 0.2], "is": [0, 0, 0] },
                    { "type": "environment", "name": "sky", "group": "c", "radiance": [2, 2, 2], "image": "a.png", "rotation": 90,
                      "is": [0, 0, 1], "samples": 4, "visible": false }
                ],
                "shapes": [
                    { "type": "trimesh", "material": {}, "path": "a.ply", "smooth": { "angle": 50, "flat": 20 },
                      "color": { "property": "quality", "map": "turbo", "range": [-1, 2.5], "nan": [0, 0, 1] } },
                    { "type": "trimesh", "material": {}, "path": "a.ply", "points": 0.125, "color": "face" },
                    { "type": "sphere", "material": {}, "center": [0, 0, 1], "radius": 1, "visible": { "reflection": false } }
                ]
            },
            "output": { "layers": ["ao"], "cryptoranks": 8, "aodistance": 3, "aosamples": 4, "legend": true }
        })
    })
}

/// A scene with required keys only.
fn minimal() -> Value {
    json!({
        "camera": { "type": "pinhole", "width": 8, "height": 6, "fov": 40, "position": [0, 0, 0], "lookat": [0, 1, 0], "up": [0, 0, 1] },
        "scene": { "shapes": [] }
    })
}

/// Makes a folder with the files that [`everything`] names.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.ply"), "").unwrap();
    std::fs::write(folder.path().join("a.png"), "").unwrap();
    folder
}

pub(super) fn load_value(value: &Value, set: &[&str]) -> Result<Loaded> {
    let folder = folder();
    let text = value.to_string();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: folder.path() };
    load(source, &set.iter().map(|s| s.to_string()).collect::<Vec<_>>())
}

#[test]
fn json_and_text_round_trip() {
    for value in the_rest().into_iter().chain([everything(), minimal()]) {
        let loaded = load_value(&value, &[]).unwrap();
        assert_eq!(loaded.description.to_json(), value);
        let text = loaded.description.to_text();
        let again: SceneDescription = serde_json::from_str(&text).unwrap();
        assert_eq!(again, loaded.description);
        let folder = folder();
        let by_code = from_description("studio", &loaded.description, folder.path(), &[]).unwrap();
        assert_eq!(by_code.hash, loaded.hash);
    }
}

/// A batch renders the frames of files that have left the disk since they were read.
#[test]
fn another_frame_does_not_look_for_the_files_again() {
    let loaded = load_value(&everything(), &[]).unwrap();
    let nowhere = Path::new("/nowhere");
    let frame = loaded.with_frame("frame", &loaded.description, nowhere).unwrap();
    assert_eq!(frame.hash, loaded.hash);
    loaded.with_camera("camera", &loaded.description.camera, nowhere).unwrap();
    let error = loaded.with_description("scene", &loaded.description, nowhere).unwrap_err();
    assert!(error.to_string().contains("there is no file /nowhere"), "{error}");
}

#[test]
fn errors_of_scenes_made_by_code_have_no_line() {
    let mut description = load_value(&minimal(), &[]).unwrap().description;
    let written::CameraDescription::Pinhole(camera) = &mut description.camera else {
        unreachable!()
    };
    camera.fov = 200.0;
    let error = from_description("studio", &description, Path::new(""), &[]).unwrap_err();
    assert_eq!(error.problems[0].place, "studio (/camera/fov)");
}

#[test]
fn every_key_reaches_the_checked_scene() {
    let scene = load_value(&everything(), &[]).unwrap().scene;
    assert_eq!((scene.nbounces, scene.spp, scene.seed), (3, 4, -7));
    assert_eq!(
        (scene.falloff, scene.backend),
        (Falloff::Quadratic, Backend::Embree(EmbreeMode::Robust))
    );
    assert_eq!(scene.camera.lookat, glam::DVec3::new(0.0, 5.0, 0.0));
    assert_eq!((scene.camera.width, scene.camera.height), (640, 480));
    assert_eq!((scene.camera.position.y, scene.camera.up), (-5.0, glam::DVec3::Z));
    let (fov, lens) = scene.camera.perspective().unwrap();
    assert_eq!((fov, lens.unwrap().focal_distance), (35.5, 5.0));
    assert_eq!((scene.background, scene.ambient), ([0.1, 0.2, 0.3].into(), glam::Vec3::ONE));
    let light =
        |i: usize| (scene.lights[i].diffuse.to_array(), scene.lights[i].specular.to_array());
    assert_eq!(light(0), ([1.0, 2.0, 3.0], [0.0; 3]));
    assert_eq!(light(1), ([1.0; 3], [0.0, 0.0, 1.0]));
    let names = scene.lights.iter().map(|l| (l.name.as_deref(), l.group.as_deref()));
    assert!(names.eq([(Some("key"), Some("a")), (Some("fill"), Some("b"))]));
    let LightKind::Area { edge, height, samples, lambertian, .. } = &scene.lights[1].kind else {
        panic!("an area light");
    };
    assert_eq!((edge.to_array(), height.to_array()), ([1.0, 0.0, 0.0], [0.0, 2.0, 0.0]));
    assert_eq!((*samples, *lambertian), (4, true));
    assert_eq!(scene.shapes.iter().map(|s| s.material).collect::<Vec<_>>(), [0, 1, 2, 0]);
    let roles: Vec<Role> = scene.shapes.iter().map(|shape| shape.role).collect();
    assert_eq!(roles, [Role::Holdout, Role::ShadowCatcher, Role::Surface, Role::Surface]);
    assert_eq!(scene.shapes[2].visible.kinds(), [false, false, true]);
    assert_eq!((scene.shapes[0].semantic, scene.shapes[1].semantic), (3, 0));
    let ShapeKind::Sphere { center, radius, pole } = scene.shapes[0].kind else {
        panic!("a sphere")
    };
    assert_eq!((center, radius, pole), (glam::DVec3::Z, 1.0, 0));
    assert_eq!(scene.materials.len(), 3);
    let m = &scene.materials[0];
    assert_eq!([m.kd, m.ks, m.ka, m.kr, m.specular_exponent], [0.5, 0.25, 0.125, 0.1, 20.0]);
    assert_eq!((m.diffuse_color, scene.materials[1].kr), ([1.0, 0.8, 0.0].into(), 0.5));
    let lookup = &scene.materials[0].lookup;
    assert_eq!((lookup.filter, lookup.wrap), (Some(Filter::Nearest), Some(Wrap::Clamp)));
    assert_eq!((lookup.color_space, lookup.scale), (Some(ColorSpace::Linear), [2.0, -1.0].into()));
    let texture = scene.materials[0].texture.as_ref().expect("an image");
    assert_eq!(texture.declared_size, [Some(2), Some(3)]);
    let ShapeKind::Trimesh(mesh) = &scene.shapes[3].kind else { panic!("a mesh") };
    assert_eq!((mesh.fit, mesh.size, mesh.center), (Some(2.0), 2.0, glam::DVec3::X));
    assert_eq!(mesh.rotate_deg, glam::DVec3::new(-90.0, 0.0, 0.0));
    assert_eq!((mesh.bvh, mesh.smooth, mesh.vertex_colors), (false, Smooth::All, false));
    assert_eq!(mesh.vertex_color_space, Some(ColorSpace::Linear));
    let moved = mesh.transform.as_ref().expect("an instance");
    assert_eq!(moved.matrix3, glam::DMat3::from_diagonal([1.0, 2.0, 1.0].into()));
    assert_eq!(moved.translation, glam::DVec3::new(0.0, 0.0, 5.0));
    let t = scene.tonemap;
    assert_eq!((t.operator, t.exposure, t.srgb), (ToneOperator::Reinhard, -1.5, false));
    assert_eq!(scene.layers, [Layer::Depth, Layer::Normal]);
    assert!(scene.transparent);
    let random = load_value(&minimal(), &["/sampler=random"]).unwrap();
    assert_eq!(random.scene.sampler, SamplerKind::Random);
    assert_ne!(random.hash, load_value(&minimal(), &[]).unwrap().hash);
}

/// A scene of objects that have only required keys.
fn plain() -> Scene {
    let mut value = minimal();
    value["scene"]["lightsources"] = json!([
        { "type": "pointlight", "position": [0, 0, 9], "id": [1, 2, 3] },
        { "type": "arealight", "v0": [0, 0, 5], "v1": [1, 0, 5], "v2": [0, 2, 5], "id": [1, 1, 1] },
        { "type": "sun", "azimuth": 0, "elevation": 9, "id": [1, 1, 1] },
        { "type": "environment", "image": "a.png" }]);
    value["scene"]["shapes"] = json!([
        { "type": "sphere", "material": {}, "center": [0, 9, 0], "radius": 1 },
        { "type": "trimesh", "material": { "tPath": "a.png" }, "path": "a.ply" }]);
    load_value(&value, &[]).unwrap().scene
}

#[test]
fn defaults_match_the_documentation() {
    let scene = plain();
    assert_eq!((scene.nbounces, scene.spp, scene.seed), (1, 1, 0));
    assert_eq!(scene.sampler, SamplerKind::Sobol);
    assert_eq!((scene.background, scene.ambient), (glam::Vec3::ZERO, glam::Vec3::ZERO));
    assert_eq!((scene.falloff, scene.backend.name()), (Falloff::Linear, "bvh"));
    assert!(
        scene.camera.perspective().unwrap().1.is_none()
            && scene.layers.is_empty()
            && !scene.transparent
    );
    assert_eq!(scene.lights[0].specular, scene.lights[0].diffuse);
    assert!(matches!(scene.lights[1].kind, LightKind::Area { samples: 16, lambertian: false, .. }));
    assert!(matches!(scene.lights[2].kind, LightKind::Sun { angle_deg: 0.53, samples: 16, .. }));
    let LightKind::Environment { samples: 16, map: Some(map) } = &scene.lights[3].kind else {
        panic!("an image");
    };
    assert_eq!((map.rotation_deg, map.visible), (0.0, true));
    assert_eq!(
        (scene.lights[3].diffuse, scene.lights[3].specular),
        (glam::Vec3::ONE, glam::Vec3::ONE)
    );
    assert_eq!((scene.adaptive_shadows, scene.emitter_samples), (false, None));
    assert_eq!((scene.crypto_ranks, scene.occlusion.samples), (6, 16));
    assert_eq!(scene.occlusion.distance, None);
    assert!(matches!(scene.shapes[0].kind, ShapeKind::Sphere { pole: 2, .. }));
    let ShapeKind::Trimesh(mesh) = &scene.shapes[1].kind else {
        panic!("a mesh");
    };
    assert_eq!((mesh.fit, mesh.size, mesh.rotate_deg), (None, 1.0, glam::DVec3::ZERO));
    assert_eq!((mesh.smooth, mesh.bvh, mesh.vertex_colors), (Smooth::Off, true, true));
    assert_eq!((mesh.center, mesh.vertex_color_space), (glam::DVec3::ZERO, None));
    let m = &scene.materials[0];
    assert_eq!([m.kd, m.ks, m.ka, m.kr, m.specular_exponent], [1.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(m.diffuse_color, glam::Vec3::ONE);
    let lookup = &scene.materials[1].lookup;
    assert_eq!((lookup.filter, lookup.wrap, lookup.color_space), (None, None, None));
    assert_eq!(lookup.scale, glam::DVec2::ONE);
    let t = scene.tonemap;
    assert_eq!((t.operator, t.exposure, t.srgb), (ToneOperator::Max, 0.0, true));
}

/// Adds the names of all properties of a schema, or all keys of a scene.
fn add_names(value: &Value, of_schema: bool, names: &mut BTreeSet<String>) {
    match value {
        Value::Object(map) => {
            let keys = if of_schema { value["properties"].as_object() } else { Some(map) };
            names.extend(keys.into_iter().flat_map(|keys| keys.keys().cloned()));
            map.values().for_each(|value| add_names(value, of_schema, names));
        }
        Value::Array(items) => items.iter().for_each(|item| add_names(item, of_schema, names)),
        _ => {}
    }
}

#[test]
fn the_scenes_of_these_tests_have_every_key() {
    let (mut of_schema, mut of_scenes) = (BTreeSet::new(), BTreeSet::new());
    add_names(schema(), true, &mut of_schema);
    the_rest().iter().chain([&everything()]).for_each(|s| add_names(s, false, &mut of_scenes));
    let missing: Vec<&String> = of_schema.difference(&of_scenes).collect();
    assert_eq!(missing, ["$schema", "comment"]);
}

#[test]
fn the_rest_of_the_keys_reaches_the_checked_scene() {
    let [brown_conrady, fisheye, orthographic, panorama] =
        the_rest().map(|value| load_value(&value, &[]).unwrap().scene);
    let scene = &brown_conrady;
    assert_eq!((scene.sampler, scene.adaptive_shadows), (SamplerKind::Random, true));
    assert_eq!((scene.emitter_samples, scene.crypto_ranks), (Some(2), 8));
    assert_eq!((scene.occlusion.distance, scene.occlusion.samples), (Some(3.0), 4));
    let Projection::Distorted(calibration, distortion, _) = &scene.camera.projection else {
        panic!("a distorted camera");
    };
    assert_eq!((calibration.focal, calibration.skew), ([15.0, 14.5], 0.25));
    assert_eq!(calibration.principal, [7.5, 5.5]);
    assert_eq!(distortion.numerator, [0.01, 0.02, 0.03, 0.0]);
    assert_eq!(distortion.denominator, [0.015, 0.025, 0.035]);
    assert_eq!(distortion.tangential, [0.001, 0.002]);
    let Projection::Distorted(calibration, distortion, _) = &fisheye.camera.projection else {
        panic!("a distorted camera");
    };
    assert_eq!((calibration.focal, calibration.principal), ([15.0, 15.0], [8.0, 6.0]));
    assert_eq!(distortion.numerator, [0.01, 0.02, 0.03, 0.04]);
    assert!(matches!(orthographic.camera.projection, Projection::Orthographic { .. }));
    assert!(matches!(panorama.camera.projection, Projection::Panorama { .. }));
    let LightKind::Sun { angle_deg, samples, .. } = scene.lights[0].kind else { panic!("a sun") };
    assert_eq!((angle_deg, samples), (2.0, 8));
    assert!(
        (scene.lights[0].diffuse * std::f32::consts::PI)
            .abs_diff_eq(glam::Vec3::new(3.0, 3.0, 2.0), 1e-6)
    );
    assert_eq!(scene.lights[0].specular, glam::Vec3::X);
    let LightKind::Sun { towards, angle_deg: 0.0, .. } = scene.lights[1].kind else {
        panic!("a directional light");
    };
    // `direction` is that of the light's rays.
    assert!(towards.abs_diff_eq(glam::DVec3::new(0.0, -1.0, 1.0).normalize(), 1e-15));
    assert_eq!(scene.lights[1].diffuse, [0.1, 0.1, 0.2].into());
    assert_eq!(
        (scene.lights[1].specular, scene.lights[2].specular),
        (glam::Vec3::ZERO, glam::Vec3::Z)
    );
    let LightKind::Environment { samples, map: Some(map) } = &scene.lights[2].kind else {
        panic!("an image");
    };
    assert_eq!(*samples, 4);
    assert_eq!((map.rotation_deg, map.visible), (90.0, false));
    assert_eq!((scene.lights[2].diffuse, scene.legend), (glam::Vec3::splat(2.0), true));
    let ShapeKind::Trimesh(mesh) = &scene.shapes[0].kind else { panic!("a mesh") };
    assert_eq!(mesh.smooth, Smooth::Below { angle: 50.0, flat: 20.0 });
    let ShapeKind::Trimesh(points) = &scene.shapes[1].kind else { panic!("a mesh") };
    assert_eq!(points.points, Some(0.125));
    assert_eq!(
        points.color.as_ref().unwrap().color,
        MeshColorDescription::Stored(StoredColor::Face)
    );
    let MeshColorDescription::Property(color) = &mesh.color.as_ref().unwrap().color else {
        panic!("a property");
    };
    assert_eq!((&*color.property.0, color.map), ("quality", ColorMap::Turbo));
    assert_eq!((color.range, color.nan.vec()), (Some([-1.0, 2.5]), glam::Vec3::Z));
    assert_eq!(scene.shapes[2].visible.kinds(), [true, true, false]);
}

#[test]
fn the_schema_is_closed_and_complete() {
    let schema = schema();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    assert_eq!(schema["properties"]["spp"]["minimum"], 1);
    assert_eq!(schema["properties"]["spp"]["default"], 1);
    let text = schema.to_string();
    assert!(!text.contains("null") && !text.contains("\"format\""), "{text}");
    fn every_object(schema: &Value, seen: &mut usize) {
        if schema["type"] == "object" {
            *seen += 1;
            let text = schema["description"].as_str();
            assert!(text.is_some_and(|t| !t.contains('\n')), "{schema}");
            assert!(schema["properties"]["comment"].is_object(), "{schema}");
            assert!(!schema["additionalProperties"].is_null(), "{schema}");
        }
        match schema {
            Value::Object(map) => map.values().for_each(|v| every_object(v, seen)),
            Value::Array(items) => items.iter().for_each(|v| every_object(v, seen)),
            _ => {}
        }
    }
    let mut seen = 0;
    every_object(schema, &mut seen);
    assert!(seen >= 12, "{seen}");
    // Editors show a description of every key.
    let shape = &schema["$defs"]["Shape"]["oneOf"][3];
    assert_eq!(shape["properties"]["type"]["const"], "trimesh");
    assert!(shape["properties"]["smooth"]["description"].is_string());
    assert_eq!(shape["additionalProperties"], false);
}

#[test]
fn the_hash_ignores_spelling_and_comments() {
    let plain = load_value(&minimal(), &[]).unwrap().hash;
    let mut spelt = minimal();
    spelt["spp"] = json!(1.0);
    spelt["comment"] = json!(["anything"]);
    spelt["scene"]["comment"] = json!("here too");
    spelt["tonemap"] = json!({ "operator": "max", "comment": 3 });
    assert_eq!(load_value(&spelt, &[]).unwrap().hash, plain);
    assert_ne!(load_value(&minimal(), &["/spp=2"]).unwrap().hash, plain);
}

#[test]
fn overrides_apply_in_order_and_create() {
    let set = [
        "/camera/fov=30",
        "/camera/fov=31",
        "/tonemap/exposure=1",
        "/scene/materials/red~1blue/diffusecolor=[1,0,0]",
        r#"/scene/shapes/-={"type":"sphere","center":[0,9,0],"radius":1,"material":"red/blue"}"#,
        "/scene/shapes/0/radius=2",
        "/output/layers/-=Z",
        "/output/layers/-=N",
        r#"/scene/lightsources/-={"type":"pointlight","position":[0,0,3],"id":[1,1,1]}"#,
        "/comment=ignored",
    ];
    let loaded = load_value(&minimal(), &set).unwrap();
    assert_eq!(loaded.scene.camera.perspective().unwrap().0, 31.0);
    assert_eq!(loaded.scene.tonemap.exposure, 1.0);
    assert!(matches!(loaded.scene.shapes[0].kind, ShapeKind::Sphere { radius: 2.0, .. }));
    assert_eq!(loaded.scene.layers, [Layer::Depth, Layer::Normal]);
    assert_eq!(loaded.scene.lights.len(), 1);
}

#[test]
fn an_override_aims_the_camera_in_either_way() {
    let lookat = |value: &Value, set: &[&str]| load_value(value, set).unwrap().scene.camera.lookat;
    let set = ["/camera/position=[0,5,0]", "/camera/target=[0,0,0]"];
    assert_eq!(lookat(&minimal(), &set).normalize(), glam::DVec3::NEG_Y);
    let mut aimed = minimal();
    let camera = aimed["camera"].as_object_mut().unwrap();
    camera.remove("lookat");
    camera.insert("target".into(), json!([0, 9, 0]));
    assert_eq!(lookat(&aimed, &["/camera/lookat=[1,0,0]"]).normalize(), glam::DVec3::X);
    // Of several overrides the last one holds.
    let (at, to) = ("/camera/lookat=[1,0,0]", "/camera/target=[0,-9,0]");
    for scene in [&minimal(), &aimed] {
        assert_eq!(lookat(scene, &[to, at]).normalize(), glam::DVec3::X);
        assert_eq!(lookat(scene, &[at, to]), lookat(scene, &[to]));
        assert_eq!(lookat(scene, &[to, at, to]), lookat(scene, &[to]));
    }
    // One override with both keys is refused, as a file with both is.
    let mut both = minimal()["camera"].clone();
    both["target"] = json!([0, -9, 0]);
    let error = load_value(&minimal(), &[&format!("/camera={both}")]).unwrap_err();
    assert!(error.to_string().contains("found both `lookat`"), "{error}");
}

#[test]
fn an_aperture_of_zero_is_a_pinhole() {
    assert!(
        load_value(&everything(), &["/camera/aperture=0"])
            .unwrap()
            .scene
            .camera
            .perspective()
            .is_some_and(|(_, lens)| lens.is_none())
    );
}

#[test]
fn each_distinct_set_of_shapes_has_an_accelerator() {
    let accelerators = |visible: &[Value]| {
        let mut value = minimal();
        let sphere = |visible: &Value| {
            json!({ "type": "sphere", "material": {}, "center": [0, 9, 0],
            "radius": 1, "visible": visible })
        };
        value["scene"]["shapes"] = visible.iter().map(sphere).collect();
        load_value(&value, &[]).unwrap().scene.accelerators()
    };
    let none = || json!({ "camera": false, "shadow": false, "reflection": false });
    assert_eq!(accelerators(&[json!({}), json!({})]), [1, 1]);
    assert_eq!(accelerators(&[json!({}), none()]), [1, 0]);
    assert_eq!(accelerators(&[json!({}), json!({ "shadow": false })]), [2, 1]);
    let of_camera = json!({ "shadow": false, "reflection": false });
    assert_eq!(accelerators(&[json!({ "camera": false }), of_camera]), [1, 1]);
    let three = [json!({ "camera": false }), json!({ "shadow": false }), json!({})];
    assert_eq!(accelerators(&three), [2, 2, 3]);
}

#[test]
fn directions_of_any_length_are_accepted() {
    for length in ["1e-320", "1e-300", "1", "1e300"] {
        let lookat = format!("/camera/lookat=[0,{length},0]");
        let up = format!("/camera/up=[0,0,{length}]");
        let camera = load_value(&minimal(), &[&lookat, &up]).unwrap().scene.camera;
        assert_eq!(camera.lookat.normalize(), glam::DVec3::Y, "{length}");
        assert_eq!(camera.up.normalize(), glam::DVec3::Z, "{length}");
        let sun = format!(
            r#"/scene/lightsources=[{{"type":"sun","direction":[0,-{length},0],"id":[1,1,1]}}]"#
        );
        let lights = load_value(&minimal(), &[&sun]).unwrap().scene.lights;
        let LightKind::Sun { towards, .. } = lights[0].kind else { unreachable!() };
        assert_eq!(towards, glam::DVec3::Y, "{length}");
    }
}

/// `--light-samples` reaches the lights of the scene with all overrides. Only a `--set` of a
/// light's own `samples` keeps them.
#[test]
fn light_samples_hold_for_lights_of_overrides() {
    let text = everything().to_string();
    let folder = folder();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: folder.path() };
    let samples = |set: &[&str]| -> Vec<Option<u32>> {
        let mut all = Overrides::default();
        set.iter().for_each(|set| all.set(set));
        let scene = all.load(source).unwrap().description;
        assert!(all.light_samples(64, source, &scene).unwrap());
        let scene = all.load(source).unwrap().description;
        let samples = |light: &LightDescription| match light {
            LightDescription::AreaLight(light) => Some(light.samples),
            LightDescription::Sun(light) => Some(light.samples),
            LightDescription::Environment(light) => Some(light.samples),
            LightDescription::PointLight(_) | LightDescription::Directional(_) => None,
        };
        scene.scene.lightsources.iter().map(samples).collect()
    };
    let sky = r#"{"type":"environment","radiance":[1,1,1]}"#;
    let sun = r#"{"type":"sun","azimuth":0,"elevation":9,"id":[1,1,1],"samples":3}"#;
    let append = |light: &str| format!("/scene/lightsources/-={light}");
    let replace = |lights: &[&str]| format!("/scene/lightsources=[{}]", lights.join(","));
    assert_eq!(samples(&[]), [None, Some(64)]);
    assert_eq!(samples(&["/scene/lightsources/1/samples=5"]), [None, Some(5)]);
    let [sky_added, sun_added] = [sky, sun].map(append);
    assert_eq!(samples(&[&sky_added, &sun_added]), [None, Some(64), Some(64), Some(3)]);
    for lights in [&[sky][..], &[sky, sky], &[sky, sun, sky]] {
        let expected = lights.iter().map(|light| Some(if *light == sky { 64 } else { 3 }));
        assert_eq!(samples(&[&replace(lights)]), expected.collect::<Vec<_>>());
    }
}

#[test]
fn the_example_of_the_manual_is_valid() {
    let manual = include_str!("../../docs/guide/scene-format.md");
    let example = manual.split("```json\n").nth(1).unwrap().split("```").next().unwrap();
    let loaded = load_value(&serde_json::from_str(example).unwrap(), &[]).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
}

#[test]
fn read_as_applies_the_structural_checks() {
    #[derive(Debug, serde::Deserialize, schemars::JsonSchema)]
    struct Job {
        /// Number of frames, at least 1.
        #[schemars(range(min = 1))]
        frames: u32,
    }
    let job: Job =
        read_as(&Document::parse("j", br#"{"$schema": "x", "frames": 3, "comment": 1}"#).unwrap())
            .unwrap();
    assert_eq!(job.frames, 3);
    let bad = Document::parse("j", br#"{"frame": 3}"#).unwrap();
    let error = read_as::<Job>(&bad).unwrap_err();
    assert_eq!(error.problems.len(), 2, "{error}");
}

/// Returns the names of the light groups of lights with these `group` and `name`, and the lights
/// that collide.
fn groups(lights: &[(Option<&str>, Option<&str>)]) -> (Vec<String>, Vec<usize>) {
    let (groups, collisions) = LightGroups::new(lights.iter().copied());
    (groups.names, collisions.into_iter().map(|(light, _)| light).collect())
}

#[test]
fn light_groups_are_named_by_group_then_name_then_number() {
    let (names, collisions) =
        groups(&[(Some("a b"), Some("x")), (None, Some("x")), (None, None), (Some("a b"), None)]);
    assert_eq!(names, ["a_b", "x", "3"]);
    assert!(collisions.is_empty());
}

#[test]
fn light_groups_that_would_share_a_layer_collide() {
    assert_eq!(groups(&[(Some("a b"), None), (Some("a_b"), None)]).1, [1]);
    assert_eq!(groups(&[(None, Some("x")), (None, Some("x"))]).1, [1]);
    assert_eq!(groups(&[(Some("x"), None), (None, Some("x"))]).1, [1]);
    assert_eq!(groups(&[(None, Some("2")), (None, None)]).1, [1]);
    assert_eq!(groups(&[(Some("ambient"), None)]).1, [0]);
}

#[test]
fn a_sun_without_size_spares_no_shadow_rays() {
    for (angle, spares) in [(0, false), (1, true)] {
        let sun = json!([{ "type": "sun", "elevation": 40, "azimuth": 0, "angle": angle, "id": [1, 1, 1] }]);
        let sun = format!("/scene/lightsources={sun}");
        let scene = load_value(&minimal(), &["/adaptiveshadows=true", &sun]).unwrap().scene;
        assert_eq!(scene.can_skip_shadow_rays_with(Some(16)), spares);
    }
}

/// Returns the warnings about adaptive shadows under `lights`.
fn warnings_of_adaptive_shadows(lights: &Value, set: &[&str]) -> Vec<String> {
    let lights = format!("/scene/lightsources={lights}");
    let set = [set, &[&lights, "/adaptiveshadows=true"]].concat();
    let warnings = load_value(&everything(), &set).unwrap().warnings;
    let texts = warnings.iter().map(|warning| warning.to_string());
    texts.filter(|text| text.contains("adaptiveshadows")).collect()
}

#[test]
fn a_warning_says_why_adaptive_shadows_skip_no_ray() {
    let area = json!({ "type": "arealight", "v0": [0, 0, 9], "v1": [1, 0, 9], "v2": [0, 1, 9],
                       "id": [1, 1, 1], "samples": 32 });
    let image = json!({ "type": "environment", "image": "a.png", "samples": 32 });
    let sun = json!({ "type": "sun", "direction": [0, 0, -1], "id": [1, 1, 1], "samples": 32 });
    let surface = "/scene/shapes/1/shadow_catcher=false";
    let draws = ["/emittersamples=1", surface];
    let says = |lights: Value, set: &[&str], expected: &str| {
        let found = warnings_of_adaptive_shadows(&lights, set);
        assert!(found.len() == 1 && found[0].contains(expected), "{found:?}");
    };
    says(json!([]), &[], "no area light has more than 4 `samples`; every shadow ray is traced");
    says(json!([image]), &[], "only lights with an `image` have more than 4 `samples`");
    let drawn = "`emittersamples` takes one point of each area light that it draws";
    says(json!([area, area]), &draws, drawn);
    says(json!([image, area, area]), &draws, drawn);
    let silent: [(Value, &[&str]); 5] = [
        (json!([area, area]), &[surface]),
        (json!([area, image]), &[]),
        // All are used.
        (json!([area]), &draws),
        (json!([area, area, sun]), &draws),
        // Shadow catchers gather all lights.
        (json!([area, area]), &["/emittersamples=1"]),
    ];
    for (lights, set) in silent {
        assert_eq!(warnings_of_adaptive_shadows(&lights, set), [""; 0], "{lights} {set:?}");
    }
}
