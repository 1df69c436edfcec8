//! Instances through the program: pictures, ids, names, memory.

use std::collections::BTreeSet;

use crate::support::program::{Done, Scratch, sheet};
use serde_json::{Value, json};

/// Instances of a mesh, which has a name or not, before a plane.
fn scene(name: Option<&str>, count: usize) -> Value {
    let place = |k: usize| {
        let (x, y) = ((k % 5) as f64 * 1.2 - 2.4, (k / 5) as f64 * 0.1);
        json!([[0.8, 0.3, 0.0, x], [-0.3, 0.8, 0.1, y], [0.0, 0.1, 1.1, -0.2], [0, 0, 0, 1]])
    };
    let mut mesh = json!({ "type": "trimesh", "path": "sheet.ply", "fit": 1, "smooth": true,
        "material": { "ks": 0.2 }, "semantic": 3,
        "instances": (0..count).map(place).collect::<Vec<_>>() });
    if let Some(name) = name {
        mesh["name"] = json!(name);
    }
    json!({
        "spp": 4,
        "camera": { "type": "pinhole", "width": 80, "height": 40, "fov": 40,
                    "position": [0, 0.5, 6], "target": [0, 0, 0], "up": [0, 1, 0] },
        "scene": {
            "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [9, 9, 9] }],
            "shapes": [
                mesh,
                { "type": "plane", "v0": [-9, -9, -3], "v1": [9, -9, -3], "v2": [9, 9, -3],
                  "v3": [-9, 9, -3], "material": {} }
            ]
        },
        "output": { "layers": ["N", "Z", "primid", "objectid", "cryptomatte"] }
    })
}

fn scratch(scene: &Value) -> Scratch {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("sheet.ply"), sheet(20)).unwrap();
    scratch.write("s.json", &scene.to_string());
    scratch
}

fn render(scratch: &Scratch, name: &str, flags: &[&str]) -> Done {
    scratch.run(&[&["render", "s.json", "--quiet", "-o", name], flags].concat()).good()
}

#[test]
fn other_backends_render_the_same_bytes_from_copies() {
    let scratch = scratch(&scene(Some("leaf"), 5));
    render(&scratch, "instances", &[]);
    for backend in ["coursework", "brute"] {
        render(&scratch, backend, &["--backend", backend]);
        let [one, other] =
            ["instances", backend].map(|name| scratch.floats(&format!("{name}.exr")));
        assert!(one == other, "{backend}");
    }
    scratch.run(&["crosscheck", "s.json", "--backend", "bvh,coursework", "--rays", "2000"]).good();
}

/// Every instance has an object id and a matte of its own.
#[test]
fn instances_have_ids_and_names() {
    for (name, expected) in [
        (Some("leaf"), ["leaf", "leaf.2", "leaf.3", "leaf.4", "leaf.5"]),
        (
            None,
            [
                "trimesh.sheet",
                "trimesh.sheet.2",
                "trimesh.sheet.3",
                "trimesh.sheet.4",
                "trimesh.sheet.5",
            ],
        ),
    ] {
        let scratch = scratch(&scene(name, 5));
        render(&scratch, "p", &["--png-ids"]);
        let bytes = scratch.read("p.exr");
        let text = String::from_utf8_lossy(&bytes);
        for name in expected {
            assert!(text.contains(&format!("\"{name}\":")), "{name}");
        }
        let ids: BTreeSet<u32> =
            scratch.floats("p.exr")["objectid.id"].iter().map(|&id| id as u32).collect();
        // The mesh is the first shape, the plane the second, and the other instances follow.
        assert_eq!(ids, (1..=6).collect());
    }
}

/// The names of a scene's object mattes.
fn mattes(scratch: &Scratch) -> Vec<String> {
    render(scratch, "p", &["--crypto-sidecar"]);
    let names: Value = serde_json::from_slice(&scratch.read("p.CryptoObject.json")).unwrap();
    names.as_object().unwrap().keys().cloned().collect()
}

/// Equal names of copies would merge their mattes.
#[test]
fn copies_never_share_a_matte() {
    let mut written = scene(Some("cow"), 2);
    let shapes = written["scene"]["shapes"].as_array_mut().unwrap();
    let herd = shapes[0].clone();
    let mut single = herd.clone();
    single.as_object_mut().unwrap().remove("instances");
    shapes[1]["name"] = json!("cow.2");
    let two = scratch(&written);
    assert_eq!(mattes(&two), ["cow", "cow.2", "cow.3"]);
    written["scene"]["shapes"].as_array_mut().unwrap().push(herd);
    assert_eq!(mattes(&scratch(&written)), ["cow", "cow.2", "cow.3", "cow.4", "cow.5"]);
    // Shapes of one name that are no copies stay one matte.
    written["scene"]["shapes"] = json!([single.clone(), single, written["scene"]["shapes"][0]]);
    assert_eq!(mattes(&scratch(&written)), ["cow", "cow.2", "cow.3"]);
}

/// A thousand instances need hardly more memory than one, as the prediction says.
#[test]
fn instances_share_their_mesh() {
    let scratch = Scratch::new();
    std::fs::write(scratch.path("sheet.ply"), sheet(200)).unwrap();
    let memory = |count: usize| {
        scratch.write("s.json", &scene(None, count).to_string());
        render(&scratch, "p", &["--stats", "stats.json", "--max-memory", "100M"]);
        let stats: Value = serde_json::from_slice(&scratch.read("stats.json")).unwrap();
        let bytes = |key: &str| stats["memory"][key].as_u64().unwrap();
        assert_eq!(stats["triangles"], json!(count * 2 * 200 * 200));
        bytes("accelerator_bytes") + bytes("mesh_bytes")
    };
    let (one, thousand) = (memory(1), memory(1000));
    assert!(thousand < one + 1_000_000, "{one} {thousand}");
    let refused = scratch.run(&[
        "render",
        "s.json",
        "-o",
        "q",
        "--backend",
        "coursework",
        "--max-memory",
        "100M",
    ]);
    assert_ne!(refused.code(), 0);
    assert!(refused.stderr().contains("--max-memory"), "{}", refused.stderr());
}

/// A mesh in a template stands at the template's instances. The camera sees them all.
#[test]
fn a_template_is_framed_with_all_instances() {
    let mut scene = scene(None, 1);
    let at = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    scene["scene"]["shapes"][0]["instances"] = json!([at(-4.0), at(4.0)]);
    scene["scene"]["shapes"].as_array_mut().unwrap().truncate(1);
    let scratch = scratch(&scene);
    let info = scratch.run(&["info", "s.json", "--json"]).good().stdout();
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(info["shapes"]["instance"], 2, "{info}");
    let args = ["render", "sheet.ply", "--template", "s.json", "--transparent", "-o", "t"];
    let said = scratch.run(&args).good().stderr();
    assert!(!said.contains("outside the camera's view"), "{said}");
    let rows = scratch.rgba("t.exr");
    let column = |x: usize| rows.iter().map(|row| row[x][3]).sum::<f32>();
    let half = |columns: std::ops::Range<usize>| columns.map(column).sum::<f32>();
    assert_eq!([column(0), column(39), column(40), column(79)], [0.0; 4]);
    let halves = [half(0..40), half(40..80)];
    assert!(halves[0] > 5.0 && (halves[0] / halves[1] - 1.0).abs() < 0.5, "{halves:?}");
}

#[test]
fn a_mesh_none_of_whose_copies_is_seen_is_told() {
    let at = |x: f64| json!([[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]);
    for (places, told) in [([99.0, 0.0], false), ([0.0, 99.0], false), ([99.0, 88.0], true)] {
        let mut scene = scene(None, 1);
        scene["scene"]["shapes"][0]["instances"] = json!(places.map(at));
        let scratch = scratch(&scene);
        let said = scratch.run(&["render", "s.json", "-o", "x"]).good().stderr();
        assert_eq!(said.contains("lies outside the camera's view"), told, "{places:?}: {said}");
    }
}
