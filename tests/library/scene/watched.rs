//! A monitor stops the loading of a scene and the build of its tree, not only the render.

use std::sync::atomic::Ordering::Relaxed;

use lightpath::{ErrorKind, LoadedScene, Mesh, Monitor, Renderer};

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

/// A renderer that a service keeps, without the scene that it was made of.
fn renderer(sets: &[&str]) -> Renderer {
    LoadedScene::from_json(SCENE, sets).and_then(|scene| scene.renderer()).expect("a renderer")
}

#[test]
fn a_stopped_writer_leaves_no_file() {
    let (renderer, stopped) = (renderer(&[]), Monitor::default());
    let film = renderer.render().expect("a film");
    stopped.signal.store(15, Relaxed);
    let folder = tempfile::tempdir().expect("a folder");
    let error = renderer.writer().write_watched(&film, folder.path().join("a"), &stopped);
    assert_eq!(error.unwrap_err().kind, ErrorKind::Interrupted(15));
    assert_eq!(std::fs::read_dir(folder.path()).expect("a folder").count(), 0);
}

#[test]
fn a_film_with_the_channels_of_another_scene_is_not_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let deep = renderer(&[r#"/output/layers=["Z"]"#]);
    let film = deep.render().expect("a film");
    let error = renderer(&[]).write(&film, folder.path().join("a")).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Invalid);
    assert!(error.to_string().contains("found the channels [Z], expected []"), "{error}");
    assert!(deep.write(&film.clone(), folder.path().join("a")).is_ok());
}

/// The system would lend 164 GiB, and kill what touches them all.
#[test]
fn a_film_beyond_the_memory_of_the_machine_is_refused() {
    let machine = std::fs::read_to_string("/proc/meminfo").expect("the machine's memory");
    let kib = |line: &str| line.split_whitespace().nth(1)?.parse::<u64>().ok();
    let of = |name: &str| {
        machine.lines().find(|line| line.starts_with(name)).and_then(kib).expect("a number")
    };
    if of("MemTotal:") + of("SwapTotal:") > 160 << 20 {
        eprintln!("this machine has the memory");
        return;
    }
    let layers = r#"/output/layers=["P","N","albedo","variance","CryptoObject","CryptoMaterial"]"#;
    let huge = renderer(&["/camera/width=32768", "/camera/height=32768", layers]);
    let error = huge.render().unwrap_err();
    assert_eq!(error.kind, ErrorKind::Retry);
    assert!(error.to_string().contains("the machine has"), "{error}");
}
