//! A monitor stops the loading of a scene and the build of its tree, not only the render.

use std::sync::atomic::Ordering::Relaxed;

use lightpath::{ErrorKind, LoadedScene, Mesh, Monitor};

const BALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ball.ply");
const SCENE: &str = r#"{ "camera": { "type": "pinhole", "width": 8, "height": 6, "fov": 40,
    "position": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0] },
  "scene": { "materials": { "clay": {} }, "shapes": [] } }"#;

#[test]
fn a_stopped_monitor_ends_loading_and_building() {
    let (going, stopped) = (Monitor::default(), Monitor::default());
    stopped.signal.store(2, Relaxed);
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("s.json");
    let shape = format!(r#"{{ "type": "trimesh", "path": "{BALL}", "material": "clay" }}"#);
    std::fs::write(&file, SCENE.replace("[] }", &format!("[{shape}] }}"))).expect("a file");
    let mesh = Mesh::read_watched(BALL, &going).expect("a mesh");
    let in_memory = || vec![("ball", "clay", mesh.clone())];
    let load = |way: u32, monitor: &Monitor| match way {
        0 => LoadedScene::read_watched(&file, &[], monitor),
        1 => LoadedScene::with_meshes_watched(SCENE, &[], in_memory(), monitor),
        _ => LoadedScene::in_studio_watched(mesh.clone(), BALL, &[], monitor),
    };
    for way in 0..3 {
        assert_eq!(load(way, &stopped).unwrap_err().kind, ErrorKind::Interrupted(2));
        let loaded = load(way, &going).expect("a scene");
        let error = loaded.renderer_watched(&stopped).unwrap_err();
        assert_eq!(error.kind, ErrorKind::Interrupted(2));
        assert!(loaded.renderer_watched(&going).is_ok());
        assert!(going.done.load(Relaxed) > 0 && going.total.load(Relaxed) == 1000);
    }
    let read = Mesh::read_watched(BALL, &stopped).unwrap_err();
    assert_eq!(read.kind, ErrorKind::Interrupted(2));
}
