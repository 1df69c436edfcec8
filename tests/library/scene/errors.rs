//! Every kind of error in a scene file: place, message and help.

use std::path::Path;

use lightpath::{
    error::{Error, ErrorKind, Problem},
    scene::{Loaded, Source, load},
};

const CAMERA: &str = r#"{"type": "pinhole", "width": 8, "height": 6, "fov": 40,
  "position": [0, -5, 0], "lookat": [0, 1, 0], "up": [0, 0, 1]}"#;

fn text(text: &[u8], set: &[&str]) -> Result<Loaded, Error> {
    let source =
        Source::Text { name: "s.json", text, folder: Path::new(env!("CARGO_MANIFEST_DIR")) };
    let set: Vec<String> = set.iter().map(|s| s.to_string()).collect();
    load(source, &set)
}

/// Returns a scene on three lines: the camera, then one shape.
fn with(camera: &str, shape: &str) -> String {
    format!("{{\"camera\": {camera},\n\"scene\": {{\"shapes\": [{shape}]}}}}")
}

fn sphere() -> &'static str {
    r#"{"type": "sphere", "center": [0,0,0], "radius": 1, "material": {}}"#
}

/// Returns the only error of a text, printed.
#[track_caller]
fn one(scene: &str) -> String {
    let error = text(scene.as_bytes(), &[]).expect_err("it should be refused");
    assert_eq!(error.problems.len(), 1, "{error}");
    assert_eq!(error.kind, ErrorKind::Invalid);
    error.problems[0].to_string()
}

/// Returns the only error of a valid scene with these overrides, printed.
#[track_caller]
fn set(sets: &[&str]) -> String {
    let scene = with(CAMERA, sphere());
    let error = text(scene.as_bytes(), sets).expect_err("it should be refused");
    assert_eq!(error.problems.len(), 1, "{error}");
    error.problems[0].to_string()
}

#[track_caller]
fn says(message: String, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
}

#[test]
fn a_valid_scene_has_no_problem() {
    let loaded = text(with(CAMERA, sphere()).as_bytes(), &[]).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    assert_eq!(loaded.hash.len(), 64);
}

#[test]
fn not_json() {
    let deep = "[".repeat(100_000);
    let cases: &[(&str, &[&str])] = &[
        ("", &["s.json: found an empty file"]),
        (" \n ", &["s.json: found an empty file"]),
        ("[1, 2", &["s.json:1:6", "found the end of the file, expected a comma or `]`"]),
        ("{\"a\": NaN}", &["s.json:1:7", "found `NaN`, expected a value", "JSON has no NaN"]),
        ("{\"a\": -Infinity}", &["s.json:1:8", "found `Infinity`, expected a digit"]),
        ("{\"a\":\n 0x10}", &["s.json:2:2", "found `0x10`", "decimal"]),
        ("{\"a\": 01}", &["s.json:1:7", "found `01`", "leading zeros"]),
        ("{\"a\": 1.}", &["expected a digit"]),
        ("{\"a\": 1e}", &["expected a digit"]),
        ("{\"a\": 1e+}", &["expected a digit"]),
        ("{\"a\": .5}", &["write 0 before the decimal point"]),
        ("{\"a\": True}", &["found `True`", "lower case"]),
        ("// hello\n{}", &["s.json:1:1", "JSON has no comments"]),
        ("{\"a\": 1,}", &["s.json:1:8", "found a comma after the last item", "remove the comma"]),
        ("{\"a\": 1 \"b\": 2}", &["s.json:1:9", "expected a comma or `}`"]),
        ("[1 2]", &["expected a comma or `]`"]),
        ("{'a': 1}", &["double quotes"]),
        ("{a: 1}", &["found `a`, expected a key in double quotes"]),
        ("{\"a\" 1}", &["expected `:` after the key \"a\""]),
        ("{\"a\": \"b}\n", &["s.json:1:7", "without a closing quote"]),
        ("\"\\x\"", &["found a bad escape"]),
        ("\"\\ud800\"", &["surrogate pair"]),
        ("\"a\tb\"", &["control characters"]),
        ("{} {}", &["s.json:1:4", "expected the end of the file"]),
        (&deep, &["s.json:1:65", "found nesting deeper than 64 levels"]),
    ];
    for (json, parts) in cases {
        says(one(json), parts);
    }
}

#[test]
fn not_utf8() {
    let error = text(b"{\n\"a\": \xff}", &[]).unwrap_err().to_string();
    says(error, &["s.json:2:6", "byte 0xff", "save the file as UTF-8"]);
    says(text(b"\xff\xfe{\0}\0", &[]).unwrap_err().to_string(), &["UTF-16"]);
    let marked = format!("\u{feff}{}", with(CAMERA, sphere()));
    assert!(text(marked.as_bytes(), &[]).is_ok());
}

#[test]
fn structure() {
    let wrong = |from: &str, to: &str| one(&with(&CAMERA.replace(from, to), sphere()));
    assert_eq!(
        wrong("40", "190"),
        "s.json:1:64 (/camera/fov): found 190, expected a number in (0, 180)"
    );
    says(wrong("40", "1e400"), &["(/camera/fov): found 1e400, which is not finite"]);
    says(wrong("40", "\"40\""), &["(/camera/fov): found \"40\", expected a number in (0, 180)"]);
    says(wrong("40", "null"), &["found null, expected a number"]);
    says(
        wrong("\"fov\": 40,", ""),
        &["s.json:1:12 (/camera): missing key `fov`, expected a number in (0, 180)"],
    );
    says(
        wrong("\"fov\": 40", "\"fov\": 40, \"fov\": 41"),
        &[
            "s.json:1:68 (/camera/fov): found the key \"fov\" a second time",
            "the first is at s.json:1:57",
        ],
    );
    says(
        wrong("\"fov\"", "\"comment\": {\"a\": 1, \"a\": 1e999}, \"size\": 2, \"fov\""),
        &["(/camera/size): found the unknown key \"size\", expected `type`, `width`"],
    );
    says(
        wrong("\"fov\": 40", "\"fov\": 40, \"fvo\": 4"),
        &["s.json:1:68 (/camera/fvo): found the unknown key \"fvo\"", "help: did you mean `fov`?"],
    );
    says(
        wrong("pinhole", "pinhol"),
        &[
            "(/camera/type): found \"pinhol\", expected `pinhole`, `thinlens`, `intrinsics`, `orthographic` or `panorama`",
            "did you mean `pinhole`?",
        ],
    );
    says(wrong("8", "0"), &["(/camera/width): found 0, expected an integer in [1, 2147483647]"]);
    says(wrong("8", "1.5"), &["(/camera/width): found 1.5, expected an integer"]);
    says(wrong("8", "-3"), &["found -3"]);
    says(
        wrong("[0, 0, 1]", "[0, 1]"),
        &["s.json:2:54 (/camera/up): found an array of 2, expected an array of 3 numbers"],
    );
    says(wrong("[0, 0, 1]", "[0, 0, true]"), &["(/camera/up/2): found true, expected a number"]);
    says(
        wrong("-5", "-1e300"),
        &["(/camera/position/1): found -1e300, expected a number in [-1e18, 1e18]"],
    );
    says(one("[]"), &["s.json:1:1: found an array of 0, expected an object"]);
}

#[test]
fn shapes() {
    let shape = |json: &str| one(&with(CAMERA, json));
    says(
        shape(r#"{"type": "spere", "center": [0,0,0], "radius": 1, "material": {}}"#),
        &[
            "s.json:3:31 (/scene/shapes/0/type): found \"spere\"",
            "expected `sphere`, `plane`, `triangle` or `trimesh`",
            "did you mean `sphere`?",
        ],
    );
    says(shape(r#"{"material": {}}"#), &["(/scene/shapes/0): missing key `type`"]);
    says(
        shape(r#"{"type": "sphere", "center": [0,0,0], "radius": -1, "material": {}}"#),
        &["/radius): found -1, expected a number in [1e-37, 1e18]"],
    );
    says(
        shape(r#"{"type": "sphere", "center": [0,0,0], "radius": 1}"#),
        &["missing key `material`, expected a string or an object"],
    );
    says(
        shape(r#"{"type": "sphere", "center": [0,0,0], "radius": 1, "material": 3}"#),
        &["found 3, expected a string or an object"],
    );
    says(
        shape(r#"{"type": "sphere", "center": [0,0,0], "radius": 1, "material": {"kd": -1}}"#),
        &["/material/kd): found -1"],
    );
    says(
        shape(
            r#"{"type": "triangle", "v0": [0,0,0], "v1": [0.1,0.1,0.1], "v2": [0.3,0.3,0.3], "material": {}}"#,
        ),
        &["triangle of zero area"],
    );
    let quad = |v: &str| {
        shape(&format!(
            r#"{{"type": "plane", "v0": [0,0,0], "v1": [1,0,0], {v}, "material": {{}}}}"#
        ))
    };
    says(quad(r#""v2": [2,0,0], "v3": [3,0,0]"#), &["quad of zero area"]);
    says(quad(r#""v2": [0,1,0], "v3": [1,1,0]"#), &["quad of zero area", "in order"]);
    says(quad(r#""v2": [1,0,0], "v3": [0,1,0]"#), &["/v2): found v1 equal to v2", "triangle"]);
    // Any of the corners may be the wrong one.
    says(
        quad(r#""v2": [1,1,0.01], "v3": [0,1,0]"#),
        &["(/scene/shapes/0): found corners out of the quad's plane by 2.50e-3"],
    );
    says(
        quad(r#""v2": [0.2,0.2,0], "v3": [0,1,0]"#),
        &["/v2): found a quad that is not convex at v2"],
    );
}

#[test]
fn camera() {
    says(
        set(&["/camera/lookat=[0,0,0]"]),
        &["--set /camera/lookat: found a zero vector", "not a point"],
    );
    says(set(&["/camera/up=[0,0,0]"]), &["--set /camera/up: found a zero vector"]);
    says(set(&["/camera/up=[0,2,1e-7]"]), &["found an up parallel to the view"]);
    assert!(text(with(CAMERA, sphere()).as_bytes(), &["/camera/up=[0,2,1e-5]"]).is_ok());
    let both =
        CAMERA.replace("\"lookat\": [0, 1, 0]", "\"lookat\": [0, 1, 0], \"target\": [0, 0, 0]");
    says(
        one(&with(&both, sphere())),
        &["found both `lookat` (a direction) and `target` (a point)"],
    );
    says(
        one(&with(&CAMERA.replace("\"lookat\": [0, 1, 0],", ""), sphere())),
        &["s.json:1:12 (/camera): missing key `lookat`"],
    );
    let same = CAMERA.replace("\"lookat\": [0, 1, 0]", "\"target\": [0, -5, 0]");
    says(one(&with(&same, sphere())), &["found a target equal to the position"]);
    says(
        set(&["/camera/aperture=1"]),
        &["found `aperture` with type `pinhole`, expected it with type `thinlens` only"],
    );
    says(set(&["/camera/type=thinlens", "/camera/aperture=1"]), &["missing key `focaldistance`"]);
    says(
        set(&["/camera/width=1000000", "/camera/height=1000000"]),
        &["1000000 x 1000000 pixels, whose film alone takes 14901.2 GiB"],
    );
}

/// Returns a scene with a calibrated camera at (0, -5, 0).
fn calibrated(more: &str) -> String {
    let camera =
        format!(r#"{{"type": "intrinsics", "width": 640, "height": 480, "fx": 500, {more}}}"#);
    with(&camera, sphere())
}

const TO_CAMERA: &str = r#""world_to_camera": [[1,0,0,0], [0,0,-1,0], [0,1,0,5], [0,0,0,1]]"#;

#[test]
fn calibrated_cameras() {
    let loaded = text(calibrated(TO_CAMERA).as_bytes(), &[]).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let wrong = |from: &str, to: &str| one(&calibrated(&TO_CAMERA.replace(from, to)));
    let at = "(/camera/world_to_camera): ";
    let skewed =
        "found a matrix that is no rotation: R R^T differs from 1 by 1.0e-2, its rows have";
    says(wrong("[1,0,0,0]", "[1,0.01,0,0]"), &[at, skewed, "expected at most 1e-4"]);
    says(wrong("[1,0,0,0]", "[0,0,0,0]"), &["differs from 1 by 1.0e0"]);
    let scaled = calibrated(r#""camera_to_world": [[2,0,0,0], [0,0,2,0], [0,-2,0,5], [0,0,0,1]]"#);
    let parts = ["/camera_to_world)", "lengths 2.000000, 2.000000", "divide the rotation by"];
    says(one(&scaled), &parts);
    says(wrong("[1,0,0,0]", "[-1,0,0,0]"), &[at, "that mirrors (determinant -1)", "axes"]);
    says(wrong("[0,0,0,1]]", "[0,0,0,2]]"), &[at, "last row [0.0, 0.0, 0.0, 2.0]"]);
    let turned = r#""world_to_camera": [[1,0,0,0], [0,0,1,0], [0,-1,0,0], [0,0,5,1]]"#;
    says(one(&calibrated(turned)), &["the matrix looks transposed"]);
    says(wrong("[1,0,0,0]", "[1,0,0]"), &["/world_to_camera/0): found an array of 3, expected an"]);
    says(wrong(", [0,0,0,1]]", "]"), &[at, "found an array of 3, expected an array of 4 arrays"]);
    says(one(&calibrated(r#""cx": 3"#)), &["missing key `world_to_camera` or `camera_to_world`"]);
    let both = format!("{TO_CAMERA}, {}", TO_CAMERA.replace("world_to_camera", "camera_to_world"));
    says(one(&calibrated(&both)), &["found both `world_to_camera` and `camera_to_world`"]);
    let more = |more: &str| one(&calibrated(&format!("{TO_CAMERA}, {more}")));
    says(more(r#""fy": -500"#), &["(/camera/fy): found -500, expected a number in [0.001, 1e12]"]);
    says(more(r#""axes": "opengk""#), &["(/camera/axes): found \"opengk\"", "`opengl`?"]);
    says(more(r#""fov": 40"#), &["found `fov` with type `intrinsics`, expected it with type"]);
    let lens = |lens: &str| more(&format!(r#""distortion": {{"type": {lens}}}"#));
    says(lens(r#""fisheye", "p1": 0"#), &["found `p1` with type `fisheye`", "`brownconrady` only"]);
    says(lens(r#""fov""#), &["(/camera/distortion/type)", "`brownconrady` or `fisheye`"]);
    // r (1 - 0.9 r^2) is largest at r = 0.6086, where it is 0.4057: 203 pixels.
    says(
        lens(r#""brownconrady", "k1": -0.9, "k2": 1e-3"#),
        &[
            "(/camera/distortion/k1): found a distortion that folds inside the frame, at r = 0.608",
            "pixel (",
        ],
    );
    says(lens(r#""fisheye", "k2": -0.9"#), &["(/camera/distortion/k2): ", "theta = 39."]);
    // 400 pixels from the middle at 50 pixels a radian.
    let around = format!(r#"{TO_CAMERA}, "distortion": {{"type": "fisheye"}}"#);
    let around = text(calibrated(&around).as_bytes(), &["/camera/fx=50"]).unwrap_err();
    says(around.to_string(), &["(/camera/distortion): ", "beyond theta = 180 degrees, at pixel ("]);
    // A bad number is not taken for a fold.
    let fisheye = format!(r#"{TO_CAMERA}, "distortion": {{"type": "fisheye", "k2": -0.01}}"#);
    for bad in ["fx=0", "fy=1e-300", "cx=1e12", "skew=1e9"] {
        let bad = format!("/camera/{bad}");
        let error = text(calibrated(&fisheye).as_bytes(), &[&bad]).unwrap_err();
        assert_eq!(error.problems.len(), 1, "{error}");
        says(error.to_string(), &["expected a number in ["]);
    }
    let far = format!(r#"{TO_CAMERA}, "cx": 900"#);
    let warnings = text(calibrated(&far).as_bytes(), &[]).unwrap().warnings;
    says(warnings[0].to_string(), &["(/camera/cx): found a principal point outside of the frame"]);
    let resized = text(calibrated(TO_CAMERA).as_bytes(), &["/camera/width=320"]).unwrap_err();
    says(resized.to_string(), &["--set /camera/width: found another width", "scale fx, fy"]);
    let sets = ["/camera/width=320", "/camera/height=240", "/camera/fx=250"];
    assert!(text(calibrated(TO_CAMERA).as_bytes(), &sets).is_ok());
}

#[test]
fn panoramas() {
    let panorama = |more: &str| {
        let camera = CAMERA.replace("pinhole", "panorama").replace("\"fov\": 40", more);
        text(with(&camera, sphere()).as_bytes(), &[]).map_err(|error| error.to_string())
    };
    assert!(panorama(r#""longitude": [90, 360]"#).is_ok());
    says(panorama(r#""longitude": [-200, 170]"#).unwrap_err(), &["(/camera/longitude)", "360"]);
    says(panorama(r#""latitude": [10, 10]"#).unwrap_err(), &["(/camera/latitude)", "10 to 10"]);
    says(panorama(r#""latitude": [-91, 10]"#).unwrap_err(), &["(/camera/latitude)", "[-90, 90]"]);
}

#[test]
fn angles_have_bounds() {
    let light = |keys: &str| set(&[&format!("/scene/lightsources=[{{{keys}}}]")]);
    let sun = r#""type": "sun", "id": [1, 1, 1], "elevation": 9"#;
    let wanted = "expected a number in [-1e6, 1e6]";
    says(light(&format!(r#"{sun}, "azimuth": 1e300"#)), &["/azimuth): found 1e300", wanted]);
    says(light(&format!(r#"{sun}, "azimuth": 3, "angle": 180"#)), &["[0, 179]"]);
    let sky = r#""type": "environment", "radiance": [1, 1, 1]"#;
    says(light(&format!(r#"{sky}, "rotation": -1e18"#)), &["/rotation): found -1e18", wanted]);
    for keys in [format!(r#"{sun}, "azimuth": -1e6"#), format!(r#"{sky}, "rotation": 1e6"#)] {
        let lights = format!("/scene/lightsources=[{{{keys}}}]");
        assert!(text(with(CAMERA, sphere()).as_bytes(), &[&lights]).is_ok(), "{keys}");
    }
}

#[test]
fn lights_and_materials_and_files() {
    let area = r#"/scene/lightsources=[{"type":"arealight","v0":[0,0,0],"v1":[1,0,0],"v2":[5,0,0],"id":[1,1,1]}]"#;
    says(
        set(&[area]),
        &["--set /scene/lightsources (/scene/lightsources/0): found an area light of zero area"],
    );
    says(
        set(&[r#"/scene/materials={"gold":{}}"#, "/scene/shapes/0/material=golf"]),
        &[
            "--set /scene/shapes/0/material: found the unknown material \"golf\", expected `gold`",
            "did you mean `gold`?",
        ],
    );
    says(
        set(&[r#"/scene/shapes/0/material/tPath=Cargo.tom"#]),
        &[
            "/scene/shapes/0/material/tPath: found \"Cargo.tom\", expected an image: there is no file",
            "did you mean `Cargo.toml`?",
        ],
    );
    says(set(&["/scene/shapes/0/material/tPath=src"]), &["which is a folder"]);
    let mesh = |path: &str| {
        set(&[&format!(r#"/scene/shapes/-={{"type":"trimesh","path":"{path}","material":{{}}}}"#)])
    };
    says(mesh("a.obj"), &["expected the path of a .ply file", "PLY"]);
    says(mesh("nowhere/a.ply"), &["there is no file", "there is no folder"]);
}

#[test]
fn bad_overrides() {
    says(set(&["camera"]), &["--set camera: found no `=`"]);
    says(set(&["camera/fov=3"]), &["without a leading `/`", "--set /camera/fov=3"]);
    for pointer in ["/scene/materials/a~2b={}", "/scene/materials/a~={}"] {
        says(set(&[pointer]), &["found `~` without 0 or 1", "`~0` stands for `~`"]);
    }
    says(set(&["/scene/shapes/7=3"]), &["found the index `7` into /scene/shapes, an array of 1"]);
    says(set(&["/scene/shapes/00=3"]), &["found the index `00`"]);
    says(set(&["/camera/fov/x=3"]), &["found the key `x` below /camera/fov"]);
    says(set(&["/camera/fov=NaN"]), &["--set /camera/fov: found \"NaN\", expected a number"]);
    says(
        set(&["/camera/foo=1"]),
        &["--set /camera/foo: found the unknown key \"foo\"", "did you mean `fov`?"],
    );
    says(set(&[&format!("{}=1", "/a".repeat(100_000))]), &["deeper than any scene"]);
}

#[test]
fn messages_stay_short_and_harmless() {
    let long = "x".repeat(100_000);
    let key = set(&[&format!("/camera/\u{1b}[31m{long}=1")]);
    assert!(key.len() < 1000 && !key.contains('\u{1b}'), "{key:?}");
    let value = set(&[&format!("/camera/type=\u{1b}[31m{long}")]);
    assert!(value.len() < 1000 && !value.contains('\u{1b}'), "{value:?}");
    let number = set(&[&format!("/camera/fov={}", "9".repeat(100_000))]);
    assert!(number.len() < 1000, "{number:?}");
}

#[test]
fn all_errors_come_in_file_order() {
    let scene = r#"{
  "spp": 0,
  "camera": {"type": "pinhole", "width": 8, "height": 6, "fov": 190,
    "position": [0, -5, 0], "lookat": [0, 0, 0], "up": [0, 0, 1]},
  "scene": {
    "lightsource": [],
    "shapes": [
      {"type": "sphere", "center": [0,0], "radius": 1, "material": "gold"},
      {"type": "triangle", "v0": [0,0,0], "v1": [1,0,0], "v2": [2,0,0], "material": "red"},
      {"type": "trimesh", "path": "missing.ply", "material": {"kx": 1}}
    ],
    "materials": {"gold": {"kd": "x"}}
  }
}"#;
    let error = text(scene.as_bytes(), &["/seed=x"]).unwrap_err();
    let places: Vec<String> = error.problems.iter().map(|p| p.place.clone()).collect();
    let expected = [
        "s.json:2:10 (/spp)",
        "s.json:3:65 (/camera/fov)",
        "s.json:4:39 (/camera/lookat)",
        "s.json:6:5 (/scene/lightsource)",
        "s.json:8:36 (/scene/shapes/0/center)",
        "s.json:9:7 (/scene/shapes/1)",
        "s.json:9:85 (/scene/shapes/1/material)",
        "s.json:10:35 (/scene/shapes/2/path)",
        "s.json:10:63 (/scene/shapes/2/material/kx)",
        "s.json:12:34 (/scene/materials/gold/kd)",
        "--set /seed",
    ];
    assert_eq!(places, expected, "{error}");
}

#[test]
fn common_keys_are_checked_even_if_the_type_is_unknown() {
    for shape in [
        r#"{"type": "cube", "material": {"kd": [1, 1, 1], "kx": 1}, "path": 5}"#,
        // Not a sphere: it has keys of other types.
        r#"{"type": "shpere", "material": {"kd": [1, 1, 1], "kx": 1}, "path": 5}"#,
        r#"{"material": {"kd": [1, 1, 1], "kx": 1}}"#,
    ] {
        let error = text(with(CAMERA, shape).as_bytes(), &[]).unwrap_err();
        let messages: Vec<&str> = error.problems.iter().map(|p| p.message.as_str()).collect();
        assert_eq!(messages.len(), 3, "{error}");
        assert!(messages[0].ends_with("expected `sphere`, `plane`, `triangle` or `trimesh`"));
        assert_eq!(messages[1], "found an array of 3, expected a number in [0, 1e18]");
        assert!(messages[2].starts_with("found the unknown key \"kx\""), "{error}");
    }
}

#[test]
fn sizes_have_a_minimum() {
    let refused = |scene: &str, key: &str| {
        says(one(scene), &[&format!("/{key}): found 1e-40, expected a number in [1e-37, 1e18]")]);
    };
    let sphere = r#"{"type": "sphere", "center": [0,0,0], "radius": SIZE, "material": {}}"#;
    refused(&with(CAMERA, &sphere.replace("SIZE", "1e-40")), "radius");
    for size in ["1e-37", "1e18"] {
        let scene = with(CAMERA, &sphere.replace("SIZE", size));
        assert!(text(scene.as_bytes(), &[]).is_ok(), "{size}");
    }
    for key in ["size", "fit", "points"] {
        let mesh = format!(
            r#"{{"type": "trimesh", "path": "tests/ply/valid/blank-lines.ply", "{key}": 1e-40, "material": {{}}}}"#
        );
        refused(&with(CAMERA, &mesh), key);
    }
    let lens = CAMERA.replace("pinhole\"", "thinlens\", \"aperture\": 0, \"focaldistance\": SIZE");
    refused(&with(&lens.replace("SIZE", "1e-40"), self::sphere()), "focaldistance");
    assert!(text(with(&lens.replace("SIZE", "1e-37"), self::sphere()).as_bytes(), &[]).is_ok());
    let parallel =
        CAMERA.replace("pinhole", "orthographic").replace("\"fov\": 40", "\"viewwidth\": 1e-40");
    refused(&with(&parallel, self::sphere()), "viewwidth");
}

#[test]
fn an_object_with_a_misspelt_type_is_checked_as_the_type_it_means() {
    let errors = |camera: &str, shape: &str| -> Vec<String> {
        let error = text(with(camera, shape).as_bytes(), &[]).unwrap_err();
        let short = |p: &Problem| {
            let message = p.message.split(", expected").next().unwrap();
            format!("{}: {message}", p.place.split(['(', ')']).nth(1).unwrap())
        };
        error.problems.iter().map(short).collect()
    };
    let shape = r#"{"type": "shpere", "cnter": [0,0], "radius": -1, "material": {"kx": 1}}"#;
    assert_eq!(
        errors(CAMERA, shape),
        [
            "/scene/shapes/0: missing key `center`",
            "/scene/shapes/0/type: found \"shpere\"",
            "/scene/shapes/0/cnter: found the unknown key \"cnter\"",
            "/scene/shapes/0/radius: found -1",
            "/scene/shapes/0/material/kx: found the unknown key \"kx\"",
        ]
    );
    let camera = CAMERA.replace("pinhole", "pinhle").replace("\"fov\"", "\"fvo\"");
    assert_eq!(
        errors(&camera, sphere()),
        [
            "/camera: missing key `fov`",
            "/camera/type: found \"pinhle\"",
            "/camera/fvo: found the unknown key \"fvo\"",
        ]
    );
    // Two types have similar names: which keys are missing is not known.
    let light = r#"/scene/lightsources=[{"type": "light", "id": [1, 1, 1]}]"#;
    let error = set(&[light]);
    assert!(error.contains("found \"light\"") && !error.contains("missing key"), "{error}");
}

#[test]
fn names() {
    let name = |name: &str| set(&[&format!("/scene/shapes/0/name={name}")]);
    says(name("\"\""), &["found \"\", expected a string that is not empty"]);
    says(name("\"  \""), &["found \"  \", expected a name that is not blank"]);
    says(name("\"a\\nb\""), &["expected a name without control characters"]);
}

#[test]
fn warnings() {
    let sets = [
        "/camera/position=[0,0.5,0]",
        r#"/scene/materials={"spare":{"tWidth":3,"kr":1}}"#,
        "/nbounces=0",
    ];
    let loaded = text(with(CAMERA, sphere()).as_bytes(), &sets).unwrap();
    let all: Vec<String> = loaded.warnings.iter().map(|p| p.to_string()).collect();
    let all = all.join("\n");
    says(
        all,
        &[
            "found the camera inside the sphere",
            "the material \"spare\", which no shape uses",
            "found `tWidth` without `tPath`",
            "mirrors do not reflect",
        ],
    );
    let light = r#"/scene/lightsources=[{"type":"pointlight","position":[0,0,0.5],"id":[1,1,1]}]"#;
    let loaded = text(with(CAMERA, sphere()).as_bytes(), &[light]).unwrap();
    says(loaded.warnings[0].to_string(), &["found the light inside the sphere"]);
    // Rays that do not hit the sphere pass through it.
    for (kind, warned) in [("camera", [false, true]), ("shadow", [true, false])] {
        let hidden = format!("/scene/shapes/0/visible/{kind}=false");
        for (set, warned) in ["/camera/position=[0,0.5,0]", light].into_iter().zip(warned) {
            let loaded = text(with(CAMERA, sphere()).as_bytes(), &[&hidden, set]).unwrap();
            let told = loaded.warnings.iter().any(|w| w.message.contains("inside the sphere"));
            assert_eq!(told, warned, "{kind} {set}: {:?}", loaded.warnings);
        }
    }
    for (sets, warned) in [
        (&["/scene/shapes/0/pole=y"][..], Some("found `pole` without a texture")),
        (&["/scene/shapes/0/pole=y", r#"/output/layers=["uv"]"#], None),
        (
            &["/scene/shapes/0/material/specularexponent=9"],
            Some("found `specularexponent` without"),
        ),
        (&["/scene/shapes/0/material/specularexponent=9", "/scene/shapes/0/material/ks=0"], None),
        (&["/output/cryptoranks=4"], Some("found `cryptoranks` without cryptomattes")),
        (&["/output/cryptoranks=4", r#"/output/layers=["CryptoMaterial"]"#], None),
    ] {
        let loaded = text(with(CAMERA, sphere()).as_bytes(), sets).unwrap();
        assert_eq!(loaded.warnings.len(), usize::from(warned.is_some()), "{:?}", loaded.warnings);
        says(loaded.warnings.iter().map(|w| w.to_string()).collect(), warned.as_slice());
    }
    for (samples, warned) in [(4, true), (5, false)] {
        let lights = format!(
            r#"/scene/lightsources=[{{"type":"arealight","v0":[3,3,3],"v1":[4,3,3],"v2":[3,3,4],"id":[1,1,1],"samples":{samples}}}]"#
        );
        let sets = [lights.as_str(), "/adaptiveshadows=true"];
        let loaded = text(with(CAMERA, sphere()).as_bytes(), &sets).unwrap();
        let found: Vec<String> = loaded.warnings.iter().map(|p| p.to_string()).collect();
        let expected = "no area light has more than 4 `samples`; every shadow ray is traced";
        assert_eq!(found.iter().any(|text| text.contains(expected)), warned, "{found:?}");
        assert_eq!(found.len(), usize::from(warned), "{found:?}");
    }
}

#[test]
fn files() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let error = load(Source::File(folder), &[]).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Invalid);
    says(error.to_string(), &["found a folder, expected a scene file"]);
    let error = load(Source::File(&folder.join("none.json")), &[]).unwrap_err();
    assert_eq!(error.kind, ErrorKind::Invalid);
    says(error.to_string(), &["none.json: cannot read"]);
    let error = load(Source::File(&folder.join("Cargo.tom")), &[]).unwrap_err();
    says(error.to_string(), &["did you mean `Cargo.toml`?"]);
}

#[test]
fn other_files_are_called_by_their_format() {
    let starts: [(&[u8], &str); 6] = [
        (b"\x89PNG\r\n\x1a\n", "a PNG picture"),
        (b"v/1\x01\x02\0\0\0", "an EXR picture"),
        (b"\xff\xd8\xff\xe0", "a JPEG picture"),
        (b"ply\nformat ascii 1.0\n", "a PLY mesh"),
        (b"\x1f\x8b\x08", "a gzip archive"),
        (b"\x28\xb5\x2f\xfd", "a Zstandard archive"),
    ];
    for (start, name) in starts {
        let error = text(start, &[]).unwrap_err();
        assert_eq!(error.problems.len(), 1);
        let problem = &error.problems[0];
        assert_eq!(problem.place, "s.json");
        assert_eq!(problem.message, format!("found {name}, expected a JSON object"));
        // What may be a mesh gets a way out.
        assert_eq!(problem.help.is_some(), !name.ends_with("picture"));
    }
}

/// Editors store the address of a schema in the file.
#[test]
fn the_address_of_a_schema_is_ignored() {
    let scene = with(CAMERA, sphere());
    let plain = text(scene.as_bytes(), &[]).unwrap();
    let address = r#"{"$schema": "./lightpath.schema.json", "#;
    let with_address = text(scene.replacen('{', address, 1).as_bytes(), &[]).unwrap();
    assert_eq!(with_address.hash, plain.hash);
    assert!(with_address.warnings.is_empty());
    says(one(&scene.replacen('{', r#"{"$schema": 3, "#, 1)), &["/$schema", "expected a string"]);
    let inner = scene.replace(r#""radius""#, r#""$schema": "x", "radius""#);
    says(one(&inner), &["unknown key", "$schema"]);
}
