//! `crosscheck` through the program: reports, saved findings, replays and exit codes.

use crate::support::program::{Done, PYRAMID, Scratch};
use serde_json::Value;

/// A pyramid and a sphere above a mirror. `coursework` and `brute` need no library.
const SCENE: &str = r#"{
  "nbounces": 1, "seed": 3,
  "camera": { "type": "pinhole", "width": 24, "height": 16, "fov": 50,
              "position": [0, 1, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "pointlight", "position": [2, 5, 4], "id": [3, 3, 3] }],
    "shapes": [
      { "type": "trimesh", "path": "pyramid.ply", "material": {} },
      { "type": "sphere", "center": [1.5, 1, 0], "radius": 0.5, "material": { "kr": 0.3 } },
      { "type": "plane", "v0": [-4, 0, 4], "v1": [4, 0, 4], "v2": [4, 0, -4], "v3": [-4, 0, -4],
        "material": { "kr": 0.4 } }
    ]
  }
}"#;

fn scratch() -> Scratch {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    scratch.write("pyramid.ply", PYRAMID);
    scratch
}

fn check(scratch: &Scratch, flags: &[&str]) -> Done {
    let command = ["crosscheck", "s.json", "--backends", "coursework,brute", "--rays", "3000"];
    scratch.run(&[&command, flags].concat())
}

#[test]
fn a_scene_is_checked_by_kind_of_ray() {
    let scratch = scratch();
    let done = check(&scratch, &["--threads", "2"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let text = done.stdout();
    for expected in [
        "coursework (",
        "brute (",
        "primary",
        "shadow-point",
        "mirror",
        "vertex",
        "box-face",
        "plain loop",
        "picture of brute",
    ] {
        assert!(text.contains(expected), "{expected}: {text}");
    }
    assert_eq!(scratch.names(), ["pyramid.ply", "s.json"]);
}

#[test]
fn the_tree_of_our_own_backend_is_validated() {
    let scratch = scratch();
    // `--backend` is an alias.
    let flags = ["crosscheck", "s.json", "--backend", "bvh,brute", "--rays", "500", "--no-picture"];
    let done = scratch.run(&flags);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stdout().contains("the tree of bvh is valid: "), "{}", done.stdout());
    let report: Value =
        serde_json::from_str(&scratch.run(&[&flags[..], &["--json"]].concat()).stdout()).unwrap();
    assert!(report["tree"]["valid"].as_str().unwrap().contains("leaves"), "{report}");
}

#[test]
fn the_report_is_json_and_does_not_depend_on_threads() {
    let scratch = scratch();
    let done = check(&scratch, &["--json", "--threads", "1"]);
    let report: Value = serde_json::from_str(&done.stdout()).unwrap();
    assert_eq!(report["seed"], 3);
    assert_eq!(report["failures"], Value::Array(vec![]));
    assert!(report["rays"].as_u64().unwrap() > 1000);
    assert_eq!(report["plain_loop"]["wrong"], 0);
    assert!(report["plain_loop"]["rays"].as_u64().unwrap() > 1000);
    let brute = &report["backends"][1];
    assert_eq!(brute["total"]["rays"], brute["total"]["agree"]);
    assert_eq!(report["pictures"][0]["pixels"], 24 * 16);
    assert_eq!(check(&scratch, &["--json", "--threads", "2"]).stdout(), done.stdout());
    let other = check(&scratch, &["--json", "--seed", "4", "--no-picture"]);
    let other: Value = serde_json::from_str(&other.stdout()).unwrap();
    assert_eq!((&other["seed"], &other["pictures"]), (&Value::from(4), &Value::Array(vec![])));
}

/// Writes a file with a finding about `brute`, edited by `edit`. The finding is invented: `brute`
/// is never wrong.
fn saved(scratch: &Scratch, edit: impl Fn(&mut Value)) {
    let done = check(scratch, &["--save", "found.json"]);
    assert_eq!(done.stdout().lines().last(), Some("found.json"));
    let mut file: Value = serde_json::from_slice(&scratch.read("found.json")).unwrap();
    file["findings"] = serde_json::json!([{
        "backend": "brute", "against": "oracle", "verdict": "leak", "mode": "coherent",
        "source": "vertex", "shadow": false, "lane": 3,
        "answer": { "says": "miss" }, "truth": { "says": "hit", "geom": 0, "prim": 1, "t": 1.0 },
        "packet": [{ "lane": 3, "origin": [0.0, 1.0, 5.0], "direction": [0.0, 0.0, -1.0],
                     "tnear": 0.0, "tfar": null, "leaving": null }]
    }]);
    edit(&mut file);
    scratch.write("found.json", &file.to_string());
}

#[test]
fn saved_findings_are_replayed() {
    let scratch = scratch();
    saved(&scratch, |_| {});
    let done = scratch.run(&["crosscheck", "--replay", "found.json"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    assert!(done.stdout().contains("brute right: agree"), "{}", done.stdout());
    let done = scratch.run(&["crosscheck", "--replay", "found.json", "--json"]);
    let replayed: Value = serde_json::from_str(&done.stdout()).unwrap();
    assert_eq!(replayed["replayed"][0]["verdict"], "agree");
    // The scene's mesh is also found from another folder.
    scratch.write("sub/x", "");
    let done = scratch
        .command(&["crosscheck", "--replay", "../found.json"])
        .current_dir(scratch.path("sub"))
        .output();
    assert!(done.unwrap().status.success());
}

#[test]
fn broken_files_are_refused_with_their_place() {
    let scratch = scratch();
    type Edit = fn(&mut Value);
    let cases: [(Edit, &str); 6] = [
        (|f| f["findings"][0]["lane"] = 2.into(), "lane 2, which has no ray"),
        (|f| f["findings"][0]["packet"][0]["lane"] = 16.into(), "expected 0 to 15"),
        (|f| f["findings"][0]["packet"][0]["direction"] = vec![0; 3].into(), "without direction"),
        (|f| f["findings"][0]["packet"][0]["leaving"] = 99.into(), "leaves none of the"),
        (|f| f["findings"][0]["backend"] = "gpu".into(), "unknown backend `gpu`"),
        (|f| f["extra"] = 1.into(), "unknown field"),
    ];
    for (edit, expected) in cases {
        saved(&scratch, edit);
        let done = scratch.run(&["crosscheck", "--replay", "found.json"]);
        assert_eq!(done.code(), 2, "{expected}: {}", done.stderr());
        assert!(done.stderr().contains(expected), "{expected}: {}", done.stderr());
        assert!(done.stderr().contains("found.json") && done.stdout().is_empty());
    }
}

#[test]
fn bad_use_exits_2_before_the_work() {
    let scratch = scratch();
    let cases: &[(&[&str], &str)] = &[
        (&["crosscheck"], "required"),
        (&["crosscheck", "missing.json"], "missing.json"),
        (&["crosscheck", "s.json", "--backends", "brute"], "two or more"),
        (&["crosscheck", "s.json", "--backends", "brute,brute"], "two or more"),
        (&["crosscheck", "s.json", "--backends", "gpu,brute"], "possible values"),
        (&["crosscheck", "s.json", "--rays", "0"], "--rays"),
        (&["crosscheck", "s.json", "--isa", "sse9"], "possible values"),
        (&["crosscheck", "s.json", "--save", "missing/x.json"], "no such folder"),
        (&["crosscheck", "s.json", "--save", "pyramid.ply"], "would overwrite"),
        (&["crosscheck", "s.json", "--replay", "x.json"], "cannot be used with"),
        (&["crosscheck", "--replay", "x.json"], "x.json"),
        (&["crosscheck", "--replay", "s.json"], "crosscheck --save"),
    ];
    for (args, expected) in cases {
        let done = scratch.run(args);
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        assert!(done.stderr().contains(expected), "{args:?}: {}", done.stderr());
        assert_eq!(done.stdout(), "", "{args:?}");
    }
    assert_eq!(scratch.names(), ["pyramid.ply", "s.json"]);
}
