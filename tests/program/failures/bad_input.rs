//! Bad input to the program gives one clear message and the right exit code, without a panic, an
//! output or a part file, and with little memory. The tables here are those of
//! docs/notebook/bad-input.md.

use std::{fs, os::unix::process::CommandExt, process::Command};

use crate::support::program::{PYRAMID, Refusals, Table, skipped};

const SCENE: &str = r#"{
  "camera": { "type": "pinhole", "width": 8, "height": 6, "fov": 40,
              "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }],
    "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }]
  }
}"#;

fn scene(from: &str, to: &str) -> Vec<u8> {
    let changed = SCENE.replacen(from, to, 1);
    assert_ne!(changed, SCENE, "{from}");
    changed.into_bytes()
}

fn shape(json: &str) -> Vec<u8> {
    scene(r#"{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material": {} }"#, json)
}

/// An instance of a good mesh, with other keys and the rows of its matrix.
fn instance(keys: &str, rows: &str) -> Vec<u8> {
    shape(&format!(
        r#"{{ "type": "trimesh", "path": "good.ply", {keys}"material": {{}}, "instances": [[{rows}]] }}"#
    ))
}

fn scene_rows() -> Vec<(&'static str, Vec<u8>)> {
    let area = r#""lightsources": [{ "type": "arealight", "v0": [0,0,0], "v1": [1,0,0], "v2": [5,0,0], "id": [1,1,1] }"#;
    let light =
        r#""lightsources": [{ "type": "pointlight", "position": [2, 3, 4], "id": [3, 3, 3] }"#;
    let flat = r#"{ "type": "plane", "v0": [0,0,0], "v1": [1,0,0], "v2": [2,0,0], "v3": [3,0,0], "material": {} }"#;
    let size = |w: &str, h: &str| {
        scene(r#""width": 8, "height": 6"#, &format!(r#""width": {w}, "height": {h}"#))
    };
    vec![
        ("empty scene file", vec![]),
        ("cut scene file", SCENE.as_bytes()[..200].to_vec()),
        ("not UTF-8", b"{\"a\": \xff}".to_vec()),
        ("unknown key", scene("\"fov\"", "\"fvo\": 1, \"fov\"")),
        ("missing key", scene("\"fov\": 40,", "")),
        ("wrong type", scene("40", "\"40\"")),
        ("NaN", scene("40", "NaN")),
        ("number beyond f64", scene("40", "1e400")),
        ("duplicate key", scene("\"fov\": 40", "\"fov\": 40, \"fov\": 40")),
        ("width 0", size("0", "6")),
        ("picture too large", size("1000000", "1000000")),
        ("fov 0", scene("40", "0")),
        ("fov 180", scene("40", "180")),
        ("zero view direction", scene("[0, 0, -1]", "[0, 0, 0]")),
        ("up parallel to the view", scene("[0, 1, 0]", "[0, 0, 7]")),
        ("zero-area light", scene(light, area)),
        ("zero-area plane", shape(flat)),
        ("negative radius", scene("\"radius\": 1", "\"radius\": -1")),
        ("unknown material name", scene("\"material\": {}", "\"material\": \"gold\"")),
        ("unknown kind of shape", scene("\"type\": \"sphere\"", "\"type\": \"mesh\"")),
        ("missing texture", scene("\"material\": {}", "\"material\": { \"tPath\": \"no.png\" }")),
        (
            "texture that is no image",
            scene("\"material\": {}", "\"material\": { \"tPath\": \"text.png\" }"),
        ),
        (
            "texture that ends early",
            scene("\"material\": {}", "\"material\": { \"tPath\": \"cut.png\" }"),
        ),
        (
            "texture larger than memory",
            scene("\"material\": {}", "\"material\": { \"tPath\": \"huge.ppm\" }"),
        ),
        (
            "texture on a mesh without UV",
            shape(
                r#"{ "type": "trimesh", "path": "good.ply", "material": { "tPath": "good.png" } }"#,
            ),
        ),
        ("missing mesh", shape(r#"{ "type": "trimesh", "path": "no.ply", "material": {} }"#)),
        (
            "broken mesh in a scene",
            shape(r#"{ "type": "trimesh", "path": "text.ply", "material": {} }"#),
        ),
        (
            "shapes too far apart",
            shape(
                r#"{ "type": "sphere", "center": [1e18, 0, 0], "radius": 1e18, "material": {} },
                   { "type": "sphere", "center": [-1e18, 0, 0], "radius": 1e18, "material": {} }"#,
            ),
        ),
        ("singular instance", instance("", "[1,2,3,0],[2,4,6,0],[0,0,1,0],[0,0,0,1]")),
        ("nearly singular instance", instance("", "[1,0,0,0],[0,1e-9,0,0],[0,0,1,0],[0,0,0,1]")),
        ("transposed instance", instance("", "[1,0,0,0],[0,1,0,0],[0,0,1,0],[5,0,0,1]")),
        ("instance scaled to nothing", instance("", "[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]")),
        ("instance with three rows", instance("", "[1,0,0,0],[0,1,0,0],[0,0,1,0]")),
        (
            "no instances",
            shape(r#"{ "type": "trimesh", "path": "good.ply", "material": {}, "instances": [] }"#),
        ),
        (
            "instances of points",
            instance(r#""points": 1, "#, "[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]"),
        ),
        (
            "instance beyond all sizes",
            instance(r#""size": 1e17, "#, "[1e3,0,0,0],[0,1e3,0,0],[0,0,1e3,0],[0,0,0,1]"),
        ),
        (
            "mesh beyond all sizes",
            shape(
                r#"{ "type": "trimesh", "path": "good.ply", "size": 1e18, "center": [1e18, 0, 0], "material": {} }"#,
            ),
        ),
    ]
}

/// Makes a folder with the files that the rows name.
fn refusals() -> Refusals {
    let refusals = Refusals::new();
    let scratch = &refusals.scratch;
    scratch.write("good.json", SCENE);
    scratch.write("good.ply", PYRAMID);
    scratch.write("text.ply", "hello");
    scratch.write("text.png", "hello");
    scratch.write("huge.ppm", "P6 100000 100000 255\n0123456789");
    fs::create_dir(scratch.path("folder")).unwrap();
    let image = image::RgbImage::from_pixel(9, 9, image::Rgb([1, 2, 3]));
    image.save(scratch.path("good.png")).unwrap();
    let whole = scratch.read("good.png");
    fs::write(scratch.path("cut.png"), &whole[..whole.len() - 25]).unwrap();
    refusals
}

#[test]
fn scenes() {
    let refusals = refusals();
    let mut table = Table::new("Scenes");
    table.add("missing file", &refusals.render("s.json", &[]));
    table.add("folder instead of a file", &refusals.render("folder", &[]));
    for (what, bytes) in scene_rows() {
        table.add(what, &refusals.file("s.json", &bytes));
    }
    table.add("mesh of another format", &refusals.file("scan.obj", b"# a mesh\nv 0 0 0\n"));
    table.add("endless file", &refusals.render("/dev/zero", &[]));
    table.check();
}

#[test]
fn an_absurdly_large_scene_gives_a_warning() {
    let refusals = refusals();
    for radius in ["1e13", "1e-13"] {
        let bytes = scene("\"radius\": 1", &format!("\"radius\": {radius}"));
        fs::write(refusals.scratch.path("s.json"), bytes).unwrap();
        let done = refusals.run(&["info", "s.json"]);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        assert!(done.stderr().contains("warning: scene: found a scene of size 2.0e"));
    }
}

#[test]
fn flags() {
    let refusals = refusals();
    let rows: &[(&str, &str, &[&str])] = &[
        ("unknown flag", "good.json", &["--colour"]),
        ("flag without its value", "good.json", &["--spp"]),
        ("value out of range", "good.json", &["--fov", "180"]),
        ("override of nothing", "good.json", &["--set", "/camera/fvo=3"]),
        ("crop outside of the frame", "good.json", &["--crop", "0", "0", "9", "6"]),
        ("empty crop", "good.json", &["--crop", "3", "3", "3", "6"]),
        (
            "`--fast` with a backend that has no fast mode",
            "good.json",
            &["--fast", "--backend", "brute"],
        ),
        ("`--up` with a scene", "good.json", &["--up", "z"]),
        ("`--color` with a scene", "good.json", &["--color", "face"]),
        ("`--points` with a scene", "good.json", &["--points", "1"]),
        ("`--template` with a scene", "good.json", &["--template", "good.json"]),
        ("template without a mesh to replace", "good.ply", &["--template", "good.json"]),
        ("missing template", "good.ply", &["--template", "no.json"]),
        ("endless template", "good.ply", &["--template", "/dev/zero"]),
        ("statistics into a missing folder", "good.json", &["--stats", "no/s.json"]),
        ("scene saved into a missing folder", "good.json", &["--write-scene", "no/s.json"]),
    ];
    let mut table = Table::new("Command line");
    for (what, file, flags) in rows {
        table.add(what, &refusals.render(file, flags));
    }
    table.add("two outputs", &refusals.render("good.json", &["-o", "out/y"]));
    table.check();
}

#[test]
fn output_folders() {
    let refusals = refusals();
    refusals.scratch.write("a-file", "");
    fs::create_dir(refusals.scratch.path("taken.png")).unwrap();
    let mut table = Table::new("Output");
    for (what, prefix) in [
        ("folder missing", "no/x"),
        ("file instead of the folder", "a-file/x"),
        ("folder where a file should be", "taken"),
        ("folder that takes no files", "/proc/x"),
    ] {
        table.add(what, &refusals.run(&["render", "good.json", "-o", prefix]));
    }
    assert!(!refusals.scratch.names().iter().any(|name| name.contains("part")));
    table.check();
}

#[test]
fn a_slash_after_a_file_name_is_refused_before_the_render() {
    let refusals = refusals();
    let done = refusals.run(&["render", "good.json", "-o", "out/x", "--stats", "out/s.json/"]);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("a slash at the end"), "{}", done.stderr());
    assert!(!refusals.scratch.path("out/x.exr").exists());
}

/// The output folder belongs to another user. A test run by root runs the program as nobody.
#[test]
fn a_folder_without_write_permission() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    let refusals = refusals();
    let mode = |name: &str, bits| {
        let permissions = fs::Permissions::from_mode(bits);
        fs::set_permissions(refusals.scratch.path(name), permissions).unwrap();
    };
    mode("", 0o755);
    mode("out", 0o555);
    let mut command = refusals.command(&["render", "good.json", "-o", "out/x"]);
    if fs::metadata(refusals.scratch.path("")).unwrap().uid() == 0 {
        command.uid(65534).gid(65534);
    }
    let done = refusals.of(&mut command);
    mode("out", 0o755);
    if done.code() == 126 {
        return skipped(&format!("nobody cannot run the program: {}", done.stderr()));
    }
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().starts_with("error: out: cannot write out/x.exr: Permission denied"));
}

/// Mounts a disk of 8 KiB in a private namespace, if this user may.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk() {
    let refusals = refusals();
    let script = "mount -t tmpfs -o size=8k none out || exit 99; \"$0\" \"$@\"; code=$?; ls -A out; exit $code";
    let mut command = Command::new("unshare");
    command.args(["--map-root-user", "--mount", "sh", "-c", script]);
    command.arg(env!("CARGO_BIN_EXE_lightpath"));
    command.args(["render", "good.json", "-o", "out/x", "--size", "600x400"]);
    command.current_dir(refusals.scratch.path(""));
    let done = refusals.of(&mut command);
    if done.stderr().contains("unshare") || done.code() == 99 {
        return skipped(&done.stderr());
    }
    assert_eq!(done.code(), 3, "{}", done.stderr());
    assert!(done.stderr().contains("No space left on device"), "{}", done.stderr());
    assert_eq!(done.stdout(), "", "nothing is left on the disk");
}

/// Writes text polygons of `corners` corners. The header does not show how many triangles they
/// have.
fn polygons(faces: usize, corners: usize) -> String {
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {corners}\nproperty float x\nproperty float y\n\
         property float z\nelement face {faces}\nproperty list int int vertex_indices\nend_header\n"
    );
    for i in 0..corners {
        let (sin, cos) = (i as f64 / corners as f64 * std::f64::consts::TAU).sin_cos();
        text += &format!("{cos} {sin} 0\n");
    }
    // Each polygon starts at another corner, so no triangle occurs twice.
    for face in 0..faces {
        let indices: Vec<String> =
            (0..corners).map(|i| ((face + i) % corners).to_string()).collect();
        text += &format!("{corners} {}\n", indices.join(" "));
    }
    text
}

#[test]
fn memory() {
    let refusals = refusals();
    refusals.scratch.write("polygons.ply", &polygons(60, 1000));
    let scene = shape(r#"{ "type": "trimesh", "path": "polygons.ply", "material": {} }"#);
    fs::write(refusals.scratch.path("polygons.json"), scene).unwrap();
    let done = refusals.render("polygons.json", &["--max-memory", "34M"]);
    let mut table = Table::new("Memory");
    table.add(
        "`--max-memory` below what the headers promise",
        &refusals.render("good.json", &["--max-memory", "1M"]),
    );
    table.add(
        "`--max-memory` below what a mesh promises",
        &refusals.render("good.ply", &["--max-memory", "1M"]),
    );
    table.add("`--max-memory` reached while the accelerator is built", &done);
    table.add(
        "no memory for the picture",
        &refusals.render("good.json", &["--size", "30000x30000"]),
    );
    table.check();
}

/// The memory that the message names is sufficient.
#[test]
fn the_memory_named_in_the_message_suffices() {
    let refusals = refusals();
    for file in ["good.json", "good.ply"] {
        let said = refusals.render(file, &["--max-memory", "20M"]).stderr();
        let mut least =
            said.split("at least ").nth(1).unwrap().split(':').next().unwrap().to_string();
        let done = loop {
            let args = ["render", file, "-o", "x", "--size", "8x6", "--max-memory", &least];
            let done = refusals.run(&args);
            // The picture and the accelerator need memory besides the mesh.
            match done.stderr().split("at least ").nth(1) {
                Some(more) => least = more.split(':').next().unwrap().to_string(),
                None => break done,
            }
        };
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }
}

#[cfg(feature = "embree")]
mod embree {
    use super::*;
    use crate::support::program::{Done, skipped_outside_ci};

    const FILE: &str = env!("LIGHTPATH_EMBREE_FILE");

    /// Renders with `lib/` as the first folder in the library path.
    fn render(refusals: &Refusals) -> Done {
        let args = ["render", "good.json", "-o", "out/x", "--backend", "embree"];
        let mut command = refusals.command(&args);
        refusals.of(command.env("LD_LIBRARY_PATH", refusals.scratch.path("lib")))
    }

    /// A library that cannot be loaded hides the real one. All commands that do not use it must
    /// still work.
    #[test]
    fn commands_that_do_not_use_embree_work_without_it() {
        let scratch = crate::support::program::Scratch::with(SCENE);
        fs::create_dir(scratch.path("lib")).unwrap();
        fs::write(scratch.path("lib").join(FILE), "not a library").unwrap();
        let run = |args: &str| {
            let args: Vec<&str> = args.split(' ').collect();
            let mut command = scratch.command(&args);
            Done::of(command.env("LD_LIBRARY_PATH", scratch.path("lib")))
        };
        for args in [
            "render s.json",
            "render p.ply --size 20x15 --spp 1",
            "render s.json --isa portable --max-memory 1G",
            "batch s.json p.ply --size 20x15 --spp 1 -o out --quiet",
            "info s.json p.ply",
            "converge s.json --spp 1,2 --repeats 2 --budget 20 --quiet",
        ] {
            let said = run(args).good().stderr();
            assert!(!said.contains("mbree"), "{args}: {said}");
        }
        for args in [
            "bench p.ply --quick --classes primary",
            "crosscheck s.json --rays 100 --no-picture",
            "accuracy --case nearly",
        ] {
            let said = run(args).good().stderr();
            assert!(said.contains("without `embree`"), "{args}: {said}");
        }
        for args in
            ["bench p.ply --quick --classes primary --quiet", "accuracy --case nearly --quiet"]
        {
            assert_eq!(run(args).good().stderr(), "", "{args}");
        }
        let version = run("--version --verbose").good().stdout();
        assert!(version.contains("embree: not available"), "{version}");
        let asked = run("render s.json --backend embree -o lib/x");
        assert_eq!(asked.code(), 2, "{}", asked.stderr());
    }

    /// Shortens the loader's message, which differs between C libraries.
    fn shortened(done: &Done) -> Done {
        let text = done.stderr().replace(FILE, "libembree4.so.4");
        let start = "cannot load libembree4.so.4: ";
        let text = match text.find(start) {
            Some(at) => format!("{}...", &text[..at + start.len()]),
            None => text,
        };
        done.saying(text)
    }

    /// Compiles a library whose functions return `values`, or else zero.
    fn compile(path: &std::path::Path, names: &[&str], values: &[(&str, &str)]) -> bool {
        let mut code = String::from("static int something;\n");
        for name in names {
            let value = values.iter().find(|(n, _)| n == name).map_or("0", |(_, value)| value);
            code += &format!("void *{name}(void) {{ return (void *)({value}); }}\n");
        }
        let source = path.with_extension("c");
        fs::write(&source, code).unwrap();
        let mut cc = Command::new("cc");
        cc.args(["-shared", "-fPIC", "-o"]).arg(path).arg(&source);
        let compiled = cc.output().is_ok_and(|output| output.status.success());
        fs::remove_file(source).unwrap();
        compiled
    }

    #[test]
    fn the_library_is_missing_or_wrong() {
        let refusals = refusals();
        fs::create_dir(refusals.scratch.path("lib")).unwrap();
        let path = refusals.scratch.path("lib").join(FILE);
        let mut table = Table::new("Embree");
        fs::write(&path, "not a library").unwrap();
        let unloadable = render(&refusals);
        // The next step of a user of a package, and of one of a checkout.
        for word in ["libembree4-4", "make setup"] {
            assert!(unloadable.stderr().contains(word), "{}", unloadable.stderr());
        }
        table.add("no library, or one that does not load", &shortened(&unloadable));
        // Every function that the program declares.
        let source = include_str!("../../../src/accel/embree/ffi.rs");
        let names: Vec<&str> = source.split('"').filter(|name| name.starts_with("rtc")).collect();
        assert!(names.len() > 20, "{names:?}");
        if !compile(&path, &[], &[]) {
            return skipped_outside_ci("no C compiler");
        }
        table.add("a library that is not Embree 4", &shortened(&render(&refusals)));
        let version = |number| [("rtcNewDevice", "&something"), ("rtcGetDeviceProperty", number)];
        compile(&path, &names, &version("40200"));
        table.add("Embree too old", &render(&refusals));
        compile(&path, &names, &version("50000"));
        table.add("Embree too new", &render(&refusals));
        compile(&path, &names, &[("rtcGetDeviceError", "5")]);
        table.add("a processor that Embree cannot use", &render(&refusals));
        compile(&path, &names, &[("rtcGetDeviceError", "4")]);
        table.add("no memory for Embree's device", &render(&refusals));
        table.check();
    }
}

/// Memory is 16 bytes of film and 4 or 8 bytes of PNG per pixel.
#[test]
fn a_deeper_png_is_predicted() {
    let refusals = refusals();
    for (bits, film) in [("8", "film 19.1 MiB"), ("16", "film 22.9 MiB")] {
        let flags = ["--size", "1000x1000", "--png-bits", bits, "--max-memory", "20M"];
        let said = refusals.render("good.json", &flags).stderr();
        assert!(said.contains(film), "{said}");
    }
}
