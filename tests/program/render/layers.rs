//! Layers through the program: names, files, refusals.

use std::collections::BTreeMap;

use crate::support::program::{Done, Scratch};

const SCENE: &str = r#"{
  "spp": 4,
  "camera": { "type": "pinhole", "width": 40, "height": 24, "fov": 40,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.3],
    "lightsources": [
      { "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3], "name": "sun" },
      { "type": "pointlight", "position": [-2, 3, 4], "id": [1, 1, 1], "name": "sun" }],
    "materials": { "chalk": {} },
    "shapes": [{ "type": "sphere", "name": "ball", "center": [0, 0, 0], "radius": 1, "material": "chalk" }]
  }
}"#;

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch
}

fn render(scratch: &Scratch, flags: &[&str]) -> Done {
    scratch.run(&[&["render", "s.json", "--quiet"], flags].concat())
}

fn channels(scratch: &Scratch, file: &str) -> BTreeMap<String, String> {
    let done = scratch.run(&["info", "--json", file]);
    let value: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
    let channels = value["parts"][0]["channels"].as_array().unwrap();
    let text = |value: &serde_json::Value| value.as_str().unwrap().to_string();
    channels.iter().map(|pair| (text(&pair[0]), text(&pair[1]))).collect()
}

#[test]
fn a_flag_and_the_scene_select_the_same_layers() {
    let scratch = scratch();
    assert_eq!(render(&scratch, &["--aov", "Z,N,primid", "-o", "a"]).code(), 0);
    let set = r#"/output/layers=["primid","N","Z"]"#;
    assert_eq!(render(&scratch, &["--set", set, "-o", "b", "--threads", "2"]).code(), 0);
    let expected = [
        ("A", "f16"),
        ("B", "f16"),
        ("G", "f16"),
        ("N.X", "f16"),
        ("N.Y", "f16"),
        ("N.Z", "f16"),
        ("R", "f16"),
        ("Z", "f32"),
        ("primid.id", "u32"),
    ];
    let found = channels(&scratch, "a.exr");
    assert_eq!(found, expected.map(|(a, b)| (a.to_string(), b.to_string())).into());
    assert_eq!(scratch.read("a.png"), scratch.read("b.png"));
    assert_eq!(found, channels(&scratch, "b.exr"));
    // The same request gives the same bytes, for any number of threads.
    assert_eq!(render(&scratch, &["--aov", "Z,N,primid", "-o", "c", "--threads", "2"]).code(), 0);
    assert_eq!(scratch.read("a.exr"), scratch.read("c.exr"));
}

#[test]
fn unknown_layers_are_refused_with_the_nearest() {
    let scratch = scratch();
    let done = render(&scratch, &["--aov", "Z,albeod,depth"]);
    assert_eq!(done.code(), 2);
    for text in ["--aov", "\"albeod\"", "`albedo`", "`Z`"] {
        assert!(done.stderr().contains(text), "{}", done.stderr());
    }
    assert_eq!(scratch.names(), ["s.json"]);
}

#[test]
fn an_empty_layer_has_one_error() {
    for layers in ["", "N,,Z"] {
        let done = render(&scratch(), &["--aov", layers]);
        assert_eq!(done.code(), 2);
        let said = done.stderr();
        assert!(said.contains("found \"\", expected a string that is not empty"), "{said}");
        assert_eq!(said.matches("error: ").count(), 1, "{said}");
    }
}

#[test]
fn lights_that_share_a_name_are_told_apart_only_where_it_matters() {
    let scratch = scratch();
    let done = render(&scratch, &["--aov", "light"]);
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("light_sun"), "{}", done.stderr());
    assert!(done.stderr().contains("`group`"), "{}", done.stderr());
    assert_eq!(render(&scratch, &["--aov", "components"]).code(), 0);
}

#[test]
fn lossy_compression_and_layers_of_more_bits_exclude_each_other() {
    let scratch = scratch();
    for layer in ["P", "distance", "variance", "samples"] {
        let done = render(&scratch, &["--aov", layer, "--compression", "dwaa"]);
        assert_eq!(done.code(), 2);
        let expected = format!("--compression: found dwaa with {layer}: ");
        assert!(done.stderr().contains(&expected), "{}", done.stderr());
    }
    // The depth is not called R, G, B or Y.
    let bright = ["--set", "/scene/backgroundcolor=[1e5,0,0]", "--aov", "Z", "--float"];
    let run = |flags: &[&str]| {
        scratch.run(&[&["render", "s.json", "-o", "b"], &bright[..], flags].concat()).good()
    };
    let said = run(&["--compression", "dwaa"]).stderr();
    assert!(
        said.contains("than dwaa can hold and were clamped to 50000 in the EXR, the first at x 0"),
        "{said}"
    );
    assert_eq!(scratch.floats("b.exr")["Z"][0], 1e30);
    assert!(!run(&[]).stderr().contains("clamped"));
    let done = render(&scratch, &["--aov", "cryptomatte", "--compression", "dwaa"]);
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("ids"), "{}", done.stderr());
    for name in ["zip", "zips", "piz", "rle", "none"] {
        let done = render(&scratch, &["--aov", "cryptomatte", "--compression", name, "-o", name]);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        // `info` has the names of the flag.
        assert_eq!(part(&scratch, &format!("{name}.exr"), 0)["compression"], name);
    }
    assert_eq!(render(&scratch, &["--compression", "dwaa", "-o", "d"]).code(), 0);
}

#[test]
fn a_sidecar_holds_the_names() {
    let scratch = scratch();
    let flags = ["--aov", "cryptomatte", "-o", "x", "--crypto-sidecar"];
    let done = render(&scratch, &flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let text = String::from_utf8(scratch.read("x.CryptoObject.json")).unwrap();
    let names: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(names.as_object().unwrap().keys().collect::<Vec<_>>(), ["ball"]);
    let info = scratch.run(&["info", "x.exr"]).stdout();
    assert!(info.contains("manif_file: x.CryptoMaterial.json"), "{info}");
    assert!(!info.contains("/manifest"), "{info}");
    let expected = ["s.json", "x.CryptoMaterial.json", "x.CryptoObject.json", "x.exr", "x.png"];
    assert_eq!(scratch.names(), expected);
}

#[test]
fn layers_as_pictures() {
    let scratch = scratch();
    let done = render(&scratch, &["--aov", "Z,CryptoObject", "-o", "x", "--png-layer", "all"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert_eq!(scratch.names(), ["s.json", "x.CryptoObject.png", "x.Z.png", "x.exr", "x.png"]);
    let done = render(&scratch, &["--aov", "Z", "--png-layer", "N"]);
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("--aov N"), "{}", done.stderr());
}

#[test]
fn non_finite_values_are_reported_and_fail_with_strict() {
    let scratch = scratch();
    // The light is finite, its product with the material is not.
    let set = "/scene/lightsources/0/id=[1e18, 1, 1]";
    let more = r#"/scene/materials/chalk={"kd": 1e6, "diffusecolor": [1e18, 1, 1]}"#;
    let flags = ["render", "s.json", "--set", set, "--set", more, "--aov", "diffuse", "-o", "x"];
    let done = scratch.run(&flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stderr().contains("NaN or infinite"), "{}", done.stderr());
    assert!(done.stderr().contains(" in R"), "{}", done.stderr());
    let done = scratch.run(&[&flags[..], &["--strict"]].concat());
    assert_eq!(done.code(), 1, "{}", done.stderr());
    assert!(done.stderr().contains("--strict"), "{}", done.stderr());
    assert_eq!(scratch.names(), ["s.json", "x.exr", "x.png"]);

    // Parts keep these values for `merge`.
    let tiles = ["1/2", "2/2"].map(|tile| {
        let name = format!("{}.exr", &tile[..1]);
        let done = scratch.run(&[&flags[..6], &["-o", &name, "--tile", tile]].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
        name
    });
    scratch.run(&[&flags[..6], &["-o", "whole"]].concat()).good();
    let done = scratch.run(&["merge", &tiles[0], &tiles[1], "-o", "merged", "--strict"]);
    assert_eq!(done.code(), 1, "{}", done.stderr());
    assert!(done.stderr().contains("NaN or infinite"), "{}", done.stderr());
    for file in ["exr", "png"] {
        assert!(scratch.read(&format!("merged.{file}")) == scratch.read(&format!("whole.{file}")));
    }

    let set = "/scene/lightsources/0/id=[1e6, 1, 1]";
    let flags = ["render", "s.json", "--set", set, "--aov", "diffuse", "-o", "x", "--strict"];
    let done = scratch.run(&flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stderr().contains("clamped to 65504"), "{}", done.stderr());
    let done = scratch.run(&[&flags[..], &["--float"]].concat());
    assert!(!done.stderr().contains("clamped"), "{}", done.stderr());
    assert!(channels(&scratch, "x.exr").values().all(|kind| kind == "f32"));
}

#[test]
fn a_preview_shows_its_own_layer() {
    let scratch = scratch();
    let render = |groups: [&str; 2], layers: &str| {
        let set = |i: usize| format!("/scene/lightsources/{i}/group={}", groups[i]);
        let sets = [set(0), set(1)];
        let flags = ["--set", &sets[0], "--set", &sets[1], "--aov", "light", "-o", "x"];
        let done = render(&scratch, &[&flags[..], &["--png-layer", layers]].concat());
        assert_eq!(done.code(), 0, "{}", done.stderr());
    };
    render(["other", "key"], "light_key");
    let expected = scratch.read("x.light_key.png");
    render(["key00", "key"], "light_key,light_key00");
    assert!(scratch.read("x.light_key.png") == expected);
    assert!(scratch.read("x.light_key00.png") != expected);
}

/// Columns from the left: a near square, a tilted one, a far one, nothing.
#[test]
fn previews_show_depths_directions_ids_and_colours() {
    use serde_json::json;
    let scratch = Scratch::new();
    let quad = |x: f64, [left, right]: [f64; 2], color: [f64; 3]| {
        json!({ "type": "plane", "v0": [x, 1, left], "v1": [x + 1.0, 1, right],
                "v2": [x + 1.0, -1, right], "v3": [x, -1, left],
                "material": { "diffusecolor": color } })
    };
    let scene = json!({
        "camera": { "type": "orthographic", "width": 4, "height": 2, "viewwidth": 4,
                    "position": [0, 0, 9], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "shapes": [quad(-2.0, [1.0, 1.0], [0.5, 0.2, 0.0]),
                              quad(-1.0, [0.0, -1.0], [0.5, 0.2, 0.0]),
                              quad(0.0, [-3.0, -3.0], [1.0, 2.0, 0.1])] } });
    scratch.write("s.json", &scene.to_string());
    let layers = ["--aov", "Z,N,albedo,objectid", "--png-layer", "all", "-o", "x"];
    assert_eq!(render(&scratch, &layers).code(), 0);
    let row = |layer: &str| {
        let image = image::open(scratch.path(&format!("x.{layer}.png"))).unwrap().to_rgb8();
        [0, 1, 2, 3].map(|x| image.get_pixel(x, 0).0)
    };
    let black = [0; 3];
    assert_eq!(row("Z"), [[255; 3], [169; 3], [26; 3], black]);
    let (towards, tilted) = ([128, 128, 255], [218, 128, 218]);
    assert_eq!(row("N"), [towards, tilted, towards, black]);
    assert_eq!(row("albedo"), [[188, 124, 0], [188, 124, 0], [255, 255, 89], black]);
    let ids = row("objectid");
    assert!(ids[0] != ids[1] && ids[1] != ids[2] && ids[2] != ids[0] && ids[3] == black);
    assert!(ids[..3].iter().flatten().all(|value| *value >= 64), "{ids:?}");
}

/// Returns the `info` of a part.
fn part(scratch: &Scratch, file: &str, index: usize) -> serde_json::Value {
    let done = scratch.run(&["info", "--json", file]);
    let value: serde_json::Value = serde_json::from_str(&done.stdout()).unwrap();
    value["parts"][index].clone()
}

#[test]
fn a_part_for_every_layer() {
    let scratch = scratch();
    let flags = ["--aov", "Z,N,light_ambient,cryptomatte", "-o", "x", "--multipart"];
    assert_eq!(render(&scratch, &flags).code(), 0);
    let names = |i: usize| part(&scratch, "x.exr", i)["name"].clone();
    let expected = ["rgba", "N", "light_ambient", "Z", "CryptoObject", "CryptoMaterial"];
    for (i, name) in expected.into_iter().enumerate() {
        assert_eq!(names(i), name);
        let attributes = &part(&scratch, "x.exr", i)["attributes"];
        assert_eq!(attributes["lightpath:spp"], "4", "every part says it all");
    }
    assert!(names(6).is_null());
    assert_eq!(part(&scratch, "x.exr", 3)["channels"], serde_json::json!([["Z", "f32"]]));
    let ranks = part(&scratch, "x.exr", 4)["channels"].as_array().unwrap().len();
    assert_eq!(ranks, 12);
    // Other threads give the same bytes.
    let again = [&flags[..3], &["y", "--multipart", "--threads", "2"]].concat();
    assert_eq!(render(&scratch, &again).code(), 0);
    assert_eq!(scratch.read("x.exr"), scratch.read("y.exr"));
}

#[test]
fn overscan_is_data_beside_the_frame() {
    let scratch = scratch();
    assert_eq!(render(&scratch, &["-o", "x", "--overscan", "5"]).code(), 0);
    let x = part(&scratch, "x.exr", 0);
    assert_eq!(x["display_window"], serde_json::json!([0, 0, 40, 24]));
    assert_eq!(x["data_window"], serde_json::json!([-5, -5, 50, 34]));
    let done = render(&scratch, &["--overscan", "5", "--crop", "0", "0", "1", "1"]);
    assert_eq!(done.code(), 2);
    let done = render(&scratch, &["--overscan", "60000", "--size", "30000x30000"]);
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("--overscan"), "{}", done.stderr());
}

/// A sphere beyond the frame is the brightest thing. The legend keeps its place, too.
#[test]
fn the_frame_of_a_png_is_the_same_with_overscan() {
    let scratch = scratch();
    scratch.write(
        "m.ply",
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
         property float z\nproperty float heat\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 2\n0 1 0 3\n3 0 1 2\n",
    );
    let lamp = "/scene/shapes/-={\"type\": \"sphere\", \"center\": [-3.2, 0, 0], \"radius\": 0.5, \
        \"material\": {\"kd\": 50}}";
    let mesh = ["m.ply", "--color", "heat", "--legend", "--size", "160x120"];
    for args in [&["s.json", "--set", lamp][..], &mesh] {
        for (name, overscan) in [("x", "0"), ("y", "24")] {
            let more = ["-o", name, "--quiet", "--overscan", overscan];
            scratch.run(&[&["render"], args, &more].concat()).good();
        }
        let [x, y] = ["x.png", "y.png"]
            .map(|name| image::load_from_memory(&scratch.read(name)).unwrap().to_rgb8());
        let inside = image::imageops::crop_imm(&y, 24, 24, x.width(), x.height()).to_image();
        assert!(x == inside, "{args:?}");
        assert!(y.pixels().any(|pixel| !x.pixels().any(|other| other == pixel)), "{args:?}");
    }
}

#[test]
fn one_stream_holds_one_kind_of_text() {
    let scratch = scratch();
    for mode in ["openjd", "alf"] {
        let done = render(&scratch, &["-o", "x", "--json", "--progress", mode]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        assert!(done.stderr().contains("--progress: found with --json"), "{}", done.stderr());
    }
    assert!(!scratch.path("x.exr").exists());
}

/// The fisheye folds some 20 pixels beyond the frame.
#[test]
fn overscan_ends_where_a_distortion_folds() {
    let scratch = Scratch::new();
    let camera = r#""camera": { "type": "intrinsics", "width": 96, "height": 64, "fx": 30, "fy": 30,
        "cx": 40.3, "cy": 35.1, "world_to_camera": [[1,0,0,0], [0,-1,0,0], [0,0,-1,4], [0,0,0,1]],
        "distortion": { "type": "fisheye", "k1": 0.02, "k2": -0.005, "k3": 0.0003 } },"#;
    let (start, rest) = SCENE.split_once(r#""camera""#).unwrap();
    let (_, scene) = rest.split_once("},").unwrap();
    scratch.write("s.json", &format!("{start}{camera}{scene}"));
    for overscan in ["0", "1", "8"] {
        let flags = ["-o", overscan, "--overscan", overscan, "--aov", "Z,N"];
        let done = render(&scratch, &flags);
        assert_eq!((done.code(), done.stderr()), (0, String::new()), "{overscan}");
        assert!(
            scratch.floats(&format!("{overscan}.exr")).values().flatten().all(|v| v.is_finite())
        );
    }
    let rows = |name: &str| scratch.rgba(name);
    let (frame, wide) = (rows("0.exr"), rows("8.exr"));
    assert!(frame.iter().zip(&wide[8..]).all(|(row, wide)| row[..] == wide[8..8 + row.len()]));
    let done = render(&scratch, &["--overscan", "60"]);
    assert_eq!(done.code(), 2);
    assert!(
        done.stderr().contains("--overscan: found 60, but the distortion"),
        "{}",
        done.stderr()
    );
}

#[test]
fn options_without_effect_are_told() {
    let scratch = scratch();
    let said = |flags: &[&str]| {
        let common = ["render", "s.json", "-o", "x", "--spp", "1"];
        scratch.run(&[&common[..], flags].concat()).good().stderr()
    };
    let cases: [(&[&str], &[&str], &str); 3] = [
        (&["--crypto-sidecar"], &["--aov", "cryptomatte"], "--crypto-sidecar: found without"),
        (&["--crypto-ranks", "4"], &["--aov", "CryptoObject"], "--crypto-ranks: found"),
        (&["--png-layer", "all"], &["--aov", "Z"], "--png-layer: found without layers"),
    ];
    for (flags, layers, expected) in cases {
        let warning = said(flags);
        assert!(warning.contains(&format!("warning: {expected}")), "{warning}");
        let none = said(&[flags, layers].concat());
        assert!(!none.contains("warning"), "{none}");
    }
}

#[test]
fn the_header_names_the_origin_of_a_picture() {
    let scratch = scratch();
    let flags = ["-o", "x", "--frame", "-7", "--fps", "23.976"];
    assert_eq!(render(&scratch, &flags).code(), 0);
    let attributes = part(&scratch, "x.exr", 0)["attributes"].clone();
    assert_eq!(attributes["imageCounter"], "-7");
    assert_eq!(attributes["framesPerSecond"], "24000/1001");
    assert_eq!(attributes["lightpath:seed"], "0");
    assert_eq!(attributes["lightpath:version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(attributes["lightpath:sceneHash"].as_str().unwrap().len(), 64);
    for name in ["software", "chromaticities", "lightpath:backend"] {
        assert!(attributes[name].is_string(), "{name}");
    }
    assert!(attributes["lightpath:isa"].is_null());
    assert!(attributes["renderTimeSeconds"].is_null());
    assert_eq!(render(&scratch, &["-o", "y", "--record-time"]).code(), 0);
    let attributes = part(&scratch, "y.exr", 0)["attributes"].clone();
    let seconds: f64 = attributes["renderTimeSeconds"].as_str().unwrap().parse().unwrap();
    assert!((0.0..600.0).contains(&seconds), "{seconds}");
    assert!(attributes["imageCounter"].is_null());
    assert_eq!(render(&scratch, &["--fps", "fast"]).code(), 2);
}

#[test]
fn pngs_of_sixteen_bits() {
    let scratch = scratch();
    let depth = |name: &str| {
        let bytes = scratch.read(name);
        // Bit depth of the IHDR, which is the first chunk.
        bytes[24]
    };
    assert_eq!(render(&scratch, &["-o", "x", "--png-bits", "16"]).code(), 0);
    assert_eq!(render(&scratch, &["-o", "y"]).code(), 0);
    assert_eq!([depth("x.png"), depth("y.png")], [16, 8]);
    assert_eq!(render(&scratch, &["--png-bits", "12"]).code(), 2);
}

#[test]
fn the_library_warns_of_values_that_a_file_does_not_hold() {
    let scratch = Scratch::with(SCENE);
    let bright =
        r#"/scene/lightsources=[{"type":"pointlight","position":[0,3,4],"id":[1e6,1e6,1e6]}]"#;
    let scene = lightpath::LoadedScene::read(scratch.path("s.json"), &[bright]).unwrap();
    let renderer = scene.renderer().unwrap();
    let film = renderer.render().unwrap();
    let warnings = |writer: lightpath::PictureWriter| {
        let written = writer.write(&film, scratch.path("x")).unwrap();
        written.warnings.iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    assert_eq!(warnings(renderer.writer().float(true)), [""; 0]);
    let [warning] = &warnings(renderer.writer())[..] else { panic!("expected one warning") };
    let said = scratch.run(&["render", "s.json", "-o", "y", "--set", bright]).stderr();
    assert!(said.contains(&format!("warning: {warning}")), "{warning}\n{said}");
}

#[test]
fn the_library_writes_what_the_program_writes() {
    let scratch = Scratch::new();
    let output =
        r#""spp": 4, "output": { "layers": ["Z", "N", "cryptomatte"], "cryptoranks": 4 },"#;
    let text = SCENE.replace(r#""spp": 4,"#, output);
    scratch.write("s.json", &text);
    assert_eq!(render(&scratch, &["-o", "program"]).code(), 0);
    let scene = lightpath::LoadedScene::from_json(&text, &[]).unwrap();
    let renderer = scene.renderer().unwrap();
    renderer.write(&renderer.render().unwrap(), scratch.path("library")).unwrap();
    assert!(scratch.read("library.png") == scratch.read("program.png"));
    let writer = renderer.writer().float(true);
    writer.write(&renderer.render().unwrap(), scratch.path("floats")).unwrap();
    assert_eq!(render(&scratch, &["-o", "program_floats", "--float"]).code(), 0);
    assert_eq!(scratch.channels("floats.exr"), scratch.channels("program_floats.exr"));
    assert_ne!(scratch.channels("floats.exr"), scratch.channels("library.exr"));
    let [library, program] = ["library", "program"].map(|n| part(&scratch, &format!("{n}.exr"), 0));
    assert!(library["attributes"]["lightpath:sceneHash"].is_string());
    assert_eq!(library, program);
    assert_eq!(
        library["attributes"]["lightpath:backend"].as_str().unwrap().split(' ').next(),
        Some("bvh")
    );
}

/// Coordinates of a national grid need doubles: the header's matrices and the layer `P` are floats.
#[test]
fn the_camera_is_in_the_header_in_doubles() {
    let scratch = scratch();
    let (east, north) = (412_345.678, 5_123_456.789_012_3);
    let ball = format!("/scene/shapes/0/center=[{east},{north},0]");
    let pose = format!(r#""position":[{east},{north},4],"lookat":[0,0,-3],"up":[0,1,0]"#);
    let keys = [
        r#""type":"orthographic","viewwidth":0.1"#,
        r#""type":"pinhole","fov":1.1"#,
        r#""type":"thinlens","fov":1.1,"aperture":0.7,"focaldistance":4.2"#,
        r#""type":"panorama","longitude":[-30.1,30.0],"latitude":[-20.0,20.0]"#,
    ];
    for keys in keys {
        let camera = format!(r#"/camera={{{keys},"width":40,"height":24,{pose}}}"#);
        let sets = ["--set", &ball, "--set", &camera];
        let done =
            scratch.run(&[&["render", "s.json", "-o", "a", "--aov", "P,Z"], &sets[..]].concat());
        let told = done.stderr();
        assert!(told.contains("warning: scene: the layer `P` has steps of 5.0e-1"), "{told}");
        let info = scratch.run(&["info", "a.exr", "--json"]).stdout();
        let info: serde_json::Value = serde_json::from_str(&info).unwrap();
        let written = &info["parts"][0]["attributes"]["lightpath:camera"];
        let written: serde_json::Value = serde_json::from_str(written.as_str().unwrap()).unwrap();
        let mut asked: serde_json::Value =
            serde_json::from_str(camera.strip_prefix("/camera=").unwrap()).unwrap();
        for key in ["width", "height"] {
            asked.as_object_mut().unwrap().remove(key);
        }
        for (key, value) in asked.as_object().unwrap() {
            let numbers = |value: &serde_json::Value| match value {
                serde_json::Value::Array(all) => all.iter().map(|x| x.as_f64()).collect(),
                one => vec![one.as_f64()],
            };
            let same = written[key] == *value || numbers(&written[key]) == numbers(value);
            assert!(same, "{key}: {written}");
        }
        assert_eq!(written.as_object().unwrap().len(), asked.as_object().unwrap().len());
    }
    // Without the layer there is no warning.
    let sets = ["--set", &ball, "--set", &format!("/camera/position=[{east},{north},4]")];
    let done = scratch.run(&[&["render", "s.json", "-o", "a", "--aov", "Z"], &sets[..]].concat());
    assert!(!done.stderr().contains("the layer `P`"), "{}", done.stderr());
}
