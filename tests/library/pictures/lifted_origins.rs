//! Shadow rays from the lifted origins P' of smooth meshes keep the direction of light that has no
//! place: of suns, of environments and of ambient occlusion.

use lightpath::LoadedScene;
use lightpath::film::Film;
use lightpath::scene::Backend;
use serde_json::{Value, json};

use crate::support::backends::on_both;

/// Width of the picture in pixels; it shows x and y from -1 to 1.
const SIZE: usize = 64;

/// A coarse ball. The normals of its corners are the axes.
pub const OCTAHEDRON: &str = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\n\
    property float y\nproperty float z\nelement face 8\nproperty list uchar int vertex_indices\n\
    end_header\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n3 0 2 4\n3 2 1 4\n3 1 3 4\n3 3 0 4\n\
    3 2 0 5\n3 1 2 5\n3 3 1 5\n3 0 3 5\n";

/// A smooth octahedron, seen along -z, with `others` and `lights`.
fn render(others: &[Value], lights: Value, output: Value, backend: Backend) -> Film {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("octahedron.ply");
    std::fs::write(&path, OCTAHEDRON).unwrap();
    let mut shapes = others.to_vec();
    shapes.push(json!({ "type": "trimesh", "path": path, "smooth": true, "material": {} }));
    let scene = json!({
        "spp": 1,
        "camera": { "type": "orthographic", "width": SIZE, "height": SIZE, "viewwidth": 2,
                    "position": [0, 0, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "output": output,
        "scene": { "shapes": shapes, "lightsources": lights }
    });
    let backend = format!("/scene/accelerator={}", backend.name());
    let loaded = LoadedScene::from_json(&scene.to_string(), &[&backend]).unwrap();
    loaded.renderer().unwrap().render().unwrap()
}

/// Returns x and y of the middles of all pixels that the octahedron covers, apart from its edge.
fn covered() -> impl Iterator<Item = (usize, [f64; 2])> {
    let at = |i: usize| (i as f64 + 0.5) / 32.0 - 1.0;
    let all = (0..SIZE * SIZE).map(move |pixel| (pixel, [at(pixel % SIZE), -at(pixel / SIZE)]));
    all.filter(|(_, [x, y])| 1.0 - x.abs() - y.abs() > 0.05)
}

fn value(film: &Film, layer: &str, pixel: usize) -> f32 {
    film.planes.float(film.planes.index(layer).expect("the layer"), pixel)
}

/// A wall between the light and what has x > 0.4. P' is where x + |x| (1 - |x|) sign x is above.
fn check_shadow_of_wall(backend: Backend) {
    let wall = json!({ "type": "plane", "v0": [0.4, -1.1, 2], "v1": [1.1, -1.1, 2],
        "v2": [1.1, 1.1, 2], "v3": [0.4, 1.1, 2], "material": {}, "visible": { "camera": false } });
    // Makes the scene larger, and shadows nothing.
    let far = json!({ "type": "sphere", "center": [0, 0, -20], "radius": 0.01, "material": {} });
    for light in [
        json!({ "type": "directional", "direction": [0, 0, -1], "id": [1, 1, 1] }),
        json!({ "type": "sun", "angle": 0, "direction": [0, 0, -1], "id": [1, 1, 1] }),
        json!({ "type": "sun", "angle": 0.01, "direction": [0, 0, -1], "id": [1, 1, 1], "samples": 4 }),
    ] {
        for others in [&[wall.clone()][..], &[wall.clone(), far.clone()]] {
            let output = json!({ "layers": ["shadow"] });
            let film = render(others, json!([light]), output, backend);
            let mut dark = 0;
            for (pixel, [x, _]) in covered() {
                let start = x + x * (1.0 - x.abs());
                let lit = value(&film, "shadow_1.Y", pixel) > 0.0;
                assert!(lit == (start <= 0.4) || (start - 0.4).abs() < 1e-3, "{light} {start}");
                dark += usize::from(!lit);
            }
            assert!(dark > 100, "{dark}");
        }
    }
}

/// Nothing is near the faces of a convex body, however short the rays are.
fn check_convex_body(backend: Backend) {
    for distance in [1e-3, 0.05, 0.2, 10.0] {
        let output = json!({ "layers": ["ao"], "aodistance": distance, "aosamples": 64 });
        let film = render(&[], json!([]), output, backend);
        for (pixel, at) in covered() {
            assert_eq!(value(&film, "ao.Y", pixel), 1.0, "{distance} {at:?}");
        }
    }
}

on_both! {
    fn a_wall_throws_the_same_shadow_in_a_larger_scene(backend: Backend) {
        check_shadow_of_wall(backend);
    }

    fn a_smooth_convex_body_is_not_occluded(backend: Backend) {
        check_convex_body(backend);
    }
}
