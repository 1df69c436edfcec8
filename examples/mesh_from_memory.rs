//! Renders a mesh that exists only in memory: cargo run --release --example mesh_from_memory

use lightpath::{LoadedScene, Mesh, Positions};

fn main() -> lightpath::Result<()> {
    let scene = r#"{ "spp": 16,
             "camera": { "type": "pinhole", "width": 320, "height": 240, "fov": 40,
                         "position": [1, 2, 4], "target": [0, 0.4, 0], "up": [0, 1, 0] },
             "scene": { "backgroundcolor": [0.1, 0.1, 0.15],
                        "lightsources": [{ "type": "pointlight", "position": [3, 5, 4], "id": [5, 5, 5] }],
                        "materials": { "clay": { "diffusecolor": [0.8, 0.4, 0.3] } },
                        "shapes": [] } }"#;
    // A tetrahedron.
    let positions = vec![[-1.0, 0.0, -0.6], [1.0, 0.0, -0.6], [0.0, 0.0, 1.1], [0.0, 1.6, 0.0]];
    let triangles = vec![[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]];
    let mesh = Mesh::new(Positions::F32(positions), triangles)?;

    let scene = LoadedScene::with_meshes(scene, &[], vec![("tetrahedron", "clay", mesh)])?;
    let renderer = scene.renderer()?;
    let film = renderer.render()?;
    renderer.write(&film, "tetrahedron")?;
    Ok(())
}
