//! Views of one scene: each has the bits of a render of its camera alone, and what they share is
//! loaded once.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;

use lightpath::{ErrorKind, Film, LoadedScene, Mesh, Monitor, PictureWriter, Result, Views};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const BALL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/ball.ply");

/// Members of `/camera`, `;` between them.
fn sets(camera: &str) -> Vec<String> {
    let set = |member: &str| format!("/camera/{member}");
    let layers = r#"/output/layers=["Z","P"]"#.to_string();
    ["/spp=2".to_string(), layers].into_iter().chain(camera.split(';').map(set)).collect()
}

fn view(views: &mut Views, camera: &str) -> Result<(Film, PictureWriter)> {
    let sets = sets(camera);
    let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
    views.render(&sets, &Monitor::default())
}

/// Everything of a picture: size, pixels, layers, warnings.
fn content(film: &Film, warnings: &[lightpath::Problem]) -> ([u32; 2], Vec<u32>, Vec<String>) {
    let pixels = film.pixels.as_flattened().iter().map(|value| value.to_bits());
    let words = pixels.chain(film.planes.words.iter().copied()).collect();
    (film.frame, words, warnings.iter().map(ToString::to_string).collect())
}

/// Renders the cameras with one `Views`, and compares each picture with that of a new scene.
fn check(mut views: Views, alone: impl Fn(&[&str]) -> Result<LoadedScene>, cameras: &[&str]) {
    let mut all = Vec::new();
    for camera in cameras {
        let (film, writer) = view(&mut views, camera).expect(camera);
        let sets = sets(camera);
        let loaded = alone(&sets.iter().map(String::as_str).collect::<Vec<_>>()).expect(camera);
        let own = loaded.renderer().and_then(|renderer| renderer.render()).expect(camera);
        let found = content(&film, writer.warnings());
        assert!(found == content(&own, loaded.warnings()), "{camera}: {:?}", writer.warnings());
        assert!(!all.contains(&found.1), "{camera}: the picture of another camera");
        all.push(found.1);
    }
}

fn scene(shapes: &str) -> String {
    format!(
        r#"{{ "camera": {{ "type": "pinhole", "width": 20, "height": 14, "fov": 40,
            "position": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0] }},
          "scene": {{ "lightsources": [
              {{ "type": "arealight", "v0": [2,4,2], "v1": [3,4,2], "v2": [2,4,3], "id": [9,9,9] }}],
            "materials": {{ "clay": {{}} }}, "shapes": [{shapes}] }} }}"#
    )
}

/// Textures, area lights and mirrors.
#[test]
fn views_of_a_scene_file_are_its_pictures() {
    let path = Path::new(ROOT).join("scenes/still-life.json");
    let cameras = [
        "width=20;height=12",
        "width=20;height=12;position=[1,3,5]",
        "width=9;height=17;fov=70",
        // Sees nothing of the scene: a warning that no other view has.
        "width=20;height=12;position=[0,40,0];target=[0,90,1]",
        "width=12;height=12;position=[-2,2,4]",
    ];
    let alone = |sets: &[&str]| LoadedScene::read(&path, sets);
    check(Views::of_file(&path), alone, &cameras);
}

#[test]
fn views_of_a_mesh_from_memory_load_it_once() {
    let ball = Mesh::read(BALL).expect("a mesh");
    let made = Arc::new(AtomicUsize::new(0));
    let make = || -> lightpath::MakeMesh {
        let (ball, made) = (ball.clone(), Arc::clone(&made));
        Box::new(move || {
            made.fetch_add(1, Relaxed);
            Ok(ball.clone())
        })
    };
    let text = scene(r#"{ "type": "sphere", "center": [2,0,0], "radius": 1, "material": {} }"#);
    let in_scene = || Views::of_scene(&text, vec![("ball".into(), "clay".into(), make())]);
    let alone =
        |sets: &[&str]| LoadedScene::with_meshes(&text, sets, vec![("ball", "clay", ball.clone())]);
    let cameras = ["width=16", "position=[3,1,4]", "width=9;height=16", "fov=60"];
    check(in_scene(), alone, &cameras);
    assert_eq!(made.swap(0, Relaxed), 1);

    let placed = [
        "width=16;height=16;position=[0,2,6];target=[0,1,0]",
        "width=16;height=16;position=[5,2,0];target=[0,1,0]",
        "width=20;height=8;position=[5,2,0];target=[0,1,0]",
        r#"width=16;height=16;position=[4,2,2];target=[0,1,0];type=thinlens;aperture=0.3;focaldistance=4"#,
    ];
    let alone = |sets: &[&str]| LoadedScene::of_mesh_in_studio(ball.clone(), sets);
    check(Views::of_mesh(make()), alone, &placed);
    assert_eq!(made.swap(0, Relaxed), 1);
    // A camera without a position is framed by the mesh; another `up` places it anew.
    let framed = [
        "width=16;height=16",
        "width=20;height=10",
        "width=16;height=16;position=[0,2,6];target=[0,1,0]",
        "width=16;height=16;lookat=[0,-1,-1]",
        "width=16;height=16;position=[0,6,2];up=[0,0,1]",
        "width=16;height=16;position=[0,2,6];up=[0,-1,0]",
        "width=16;height=16;position=[1,2,6];target=[0,1,0]",
    ];
    check(Views::of_mesh(make()), alone, &framed);
}

/// On a planet, each camera is the origin of its coordinates.
#[test]
fn views_with_other_origins_are_loaded_again() {
    let text = scene(
        r#"{ "type": "sphere", "center": [0,-6.4e6,0], "radius": 6.4e6, "material": "clay" },
           { "type": "sphere", "center": [0.1,0.3,-9.7], "radius": 1.3, "material": "clay" }"#,
    );
    let alone = |sets: &[&str]| LoadedScene::from_json(&text, sets);
    let cameras = ["position=[0,2,5]", "position=[3.3,1.7,0.1]", "width=9;position=[3.3,1.7,0.1]"];
    check(Views::of_scene(&text, Vec::new()), alone, &cameras);
}

#[test]
fn views_with_other_settings_are_loaded_again() {
    let text = scene(r#"{ "type": "sphere", "center": [0,0,0], "radius": 1, "material": "clay" }"#);
    let mut views = Views::of_scene(&text, Vec::new());
    for set in ["/scene/shapes/0/radius=0.5", "/scene/shapes/0/radius=2", "/spp=3"] {
        let (film, writer) = views.render(&[set], &Monitor::default()).expect(set);
        let loaded = LoadedScene::from_json(&text, &[set]).expect(set);
        let own = loaded.renderer().and_then(|renderer| renderer.render()).expect(set);
        let same = content(&film, writer.warnings()) == content(&own, loaded.warnings());
        assert!(same, "{set}");
    }
}

/// What is kept needs its files no more; only a camera that changes more than itself does.
#[test]
fn views_outlive_their_files_and_errors() {
    let folder = tempfile::tempdir().expect("a folder");
    let [ply, json] = ["ball.ply", "s.json"].map(|name| folder.path().join(name));
    let shape = r#"{ "type": "trimesh", "path": "ball.ply", "material": "clay" }"#;
    std::fs::write(&json, scene(shape)).expect("a file");
    let first = "width=12;height=12;position=[0,1,7]";
    let second = "width=12;height=12;position=[4,1,5]";
    for path in [&json, &ply] {
        std::fs::copy(BALL, &ply).expect("a copy");
        let mut views = Views::of_file(path);
        let interrupted = Monitor::default();
        interrupted.signal.store(2, Relaxed);
        let stopped = |views: &mut Views| {
            let sets = sets(second);
            let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
            let error = views.render(&sets, &interrupted).expect_err("it was stopped");
            assert_eq!(error.kind, ErrorKind::Interrupted(2));
        };
        stopped(&mut views);
        let (before, _) = view(&mut views, first).expect("a picture");
        // Not removed: each scene is checked, and names a file.
        std::fs::write(&ply, "").expect("a file");
        stopped(&mut views);
        let error = view(&mut views, "fov=400").expect_err("a bad camera").to_string();
        assert!(error.contains("fov"), "{error}");
        let (other, _) = view(&mut views, second).expect("a picture");
        let (after, _) = view(&mut views, first).expect("a picture");
        assert!(before.pixels == after.pixels && before.pixels != other.pixels);
        if path == &ply {
            let error = view(&mut views, "width=12;height=12").expect_err("it is framed anew");
            assert!(error.to_string().contains("ball.ply"), "{error}");
        }
    }
}

/// How far positions are rounded depends on the distance of the camera.
#[test]
fn a_warning_of_another_camera_does_not_stay() {
    let text = scene(
        r#"{ "type": "sphere", "center": [0,0,-2], "radius": 1, "material": "clay" },
           { "type": "plane", "v0": [-1000,-1,1000], "v1": [1000,-1,1000], "v2": [1000,-1,-1000],
             "v3": [-1000,-1,-1000], "material": "clay" }"#,
    );
    let mut views = Views::of_scene(&text, Vec::new());
    let output = r#"/output={"layers":["ao"],"aodistance":0.003}"#;
    for (y, warned) in [(0, true), (50, false), (0, true)] {
        let position = format!("/camera/position=[0,{y},0]");
        let sets = [output, &position, &format!("/camera/target=[0,{y},-1]")];
        let (_, writer) = views.render(&sets, &Monitor::default()).expect("a picture");
        let alone = LoadedScene::from_json(&text, &sets).expect("a scene");
        assert_eq!(writer.warnings().len(), alone.warnings().len(), "{:?}", writer.warnings());
        let mut warnings = writer.warnings().iter().chain(alone.warnings());
        let found = warnings.any(|warning| warning.place.contains("aodistance"));
        assert_eq!(found, warned, "{position}");
    }
}
