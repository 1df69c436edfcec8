use std::path::Path;

use super::mattes::{id, rank};
use super::*;
use crate::scene::{self, Source};

fn scene(layers: &str) -> Scene {
    let text = format!(
        r#"{{ "camera": {{ "type": "pinhole", "width": 4, "height": 4, "fov": 45,
               "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] }},
             "output": {{ "layers": {layers} }},
             "scene": {{
               "lightsources": [
                 {{ "type": "pointlight", "position": [0, 5, 0], "id": [1, 1, 1], "group": "key light" }},
                 {{ "type": "pointlight", "position": [0, 5, 1], "id": [1, 1, 1] }},
                 {{ "type": "pointlight", "position": [0, 5, 2], "id": [1, 1, 1], "group": "key light" }}],
               "materials": {{ "gold": {{}} }},
               "shapes": [
                 {{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": "gold" }},
                 {{ "type": "sphere", "center": [0, 0, 2], "radius": 1, "material": {{}} }},
                 {{ "type": "sphere", "center": [0, 0, 4], "radius": 1, "material": "gold", "name": "sphere.2" }}]
             }} }}"#
    );
    let source = Source::Text { name: "s", text: text.as_bytes(), folder: Path::new("") };
    scene::load(source, &[]).unwrap().scene
}

#[test]
fn ids_match_the_examples_of_the_specification() {
    assert_eq!(id("bunny"), 0x1385_1a76);
    assert_eq!(id("default"), 0x42c9_679f);
    assert_eq!(id("torus"), 4_053_562_365);
    assert_eq!(id("равнина"), 2_518_896_926);
}

#[test]
fn a_scene_without_layers_has_an_empty_plan() {
    assert!(LayerPlan::new(&scene("[]")).is_empty());
}

#[test]
fn channels_have_conventional_names_and_types() {
    let plan = LayerPlan::new(&scene(r#"["Z", "N", "P", "objectid", "light", "uv"]"#));
    let names: Vec<&str> = plan.layout.channels.iter().map(|c| c.name.as_str()).collect();
    let expected = [
        "N.X",
        "N.Y",
        "N.Z",
        "uv.U",
        "uv.V",
        "uv.A",
        "light_key_light.R",
        "light_key_light.G",
        "light_key_light.B",
        "light_2.R",
        "light_2.G",
        "light_2.B",
        "light_ambient.R",
        "light_ambient.G",
        "light_ambient.B",
        "light_background.R",
        "light_background.G",
        "light_background.B",
        "Z",
        "P.X",
        "P.Y",
        "P.Z",
        "objectid.id",
    ];
    assert_eq!(names, expected);
    let kind_of = |name: &str| plan.layout.channels.iter().find(|c| c.name == name).unwrap().kind;
    assert_eq!(kind_of("N.X"), ChannelKind::Half);
    assert_eq!(kind_of("Z"), ChannelKind::Float);
    assert_eq!(kind_of("objectid.id"), ChannelKind::Uint);
    assert_eq!(plan.lights, [Some(6), Some(9), Some(6)]);
    assert_eq!(plan.layout.filtered, 18);
}

#[test]
fn repeated_layers_are_planned_once() {
    let plan = LayerPlan::new(&scene(r#"["all", "Z"]"#));
    let mut names: Vec<&str> = plan.layout.channels.iter().map(|c| c.name.as_str()).collect();
    let count = names.len();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), count);
    assert_eq!(plan.shadows[0].unwrap().1, 0.5);
    assert_eq!(plan.shadows[1].unwrap().1, 1.0);
}

#[test]
fn generated_names_are_unique() {
    let scene = scene("[]");
    assert_eq!(names::shapes(&scene), ["sphere", "sphere.3", "sphere.2"]);
    assert_eq!(names::materials(&scene), ["gold", "material.sphere.3"]);
    let manifest = Mattes::materials(&scene).manifest();
    let expected = format!("{{\"gold\":\"{:08x}\",", id("gold"));
    assert!(manifest.starts_with(&expected), "{manifest}");
}

#[test]
fn ranks_are_sorted_by_coverage() {
    let mattes = Mattes::materials(&scene("[]"));
    let mut counts = Vec::new();
    // The two gold spheres count as one id.
    for (shape, times) in [(0, 1), (1, 2), (2, 2)] {
        count(&mut counts, mattes.id(shape), times);
    }
    let mut words = [7; 4];
    rank(&counts, 8, &mut words);
    let ids = [id("gold"), id("material.sphere.3")];
    assert_eq!(words, [ids[0], 0.375f32.to_bits(), ids[1], 0.25f32.to_bits()]);
    assert_eq!(mattes.ids(), 2);
    rank(&[], 8, &mut words);
    assert_eq!(words, [0; 4]);
}
