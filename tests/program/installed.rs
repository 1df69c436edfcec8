//! `scripts/install.sh`, which `make install` and the packages use.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use crate::support::program::{Done, Scratch, lightpath, names_in};

/// Installs the tested program under a strict umask, in a folder whose name has a space.
fn install(scratch: &Scratch, speaker: &str) -> Done {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    Done::of(
        Command::new("bash")
            .args(["-c", "umask 077; exec \"$0\" \"$1\""])
            .args([root.join("scripts/install.sh"), scratch.path("to here")])
            .env("BINARY", env!("CARGO_BIN_EXE_lightpath"))
            .env("SPEAKER", speaker)
            .env("EMBREE", scratch.path("the embree")),
    )
}

#[test]
fn all_users_can_read_an_installation_that_loads_no_library_from_elsewhere() {
    let scratch = Scratch::new();
    let embree = scratch.path("the embree");
    fs::create_dir(&embree).unwrap();
    for (file, link) in [
        ("libembree4.so.4.4.0", "libembree4.so.4"),
        ("libtbb-1a.so.12", "libtbb.so.12"),
        ("libother.so.4", "libtbb.so"),
    ] {
        fs::write(embree.join(file), file).unwrap();
        std::os::unix::fs::symlink(file, embree.join(link)).unwrap();
    }
    install(&scratch, env!("CARGO_BIN_EXE_lightpath")).good();
    let to = scratch.path("to here");
    let mode = |name: &str| fs::metadata(to.join(name)).unwrap().permissions().mode() & 0o777;
    let manual = "share/man/man1/lightpath.1";
    assert_eq!(["", "share/man", "bin/lightpath", manual].map(mode), [0o755, 0o755, 0o755, 0o644]);
    assert!(fs::read_to_string(to.join(manual)).unwrap().contains("lightpath"));
    // By the names that the loader asks for; a second name of a file stays a link.
    let libraries = to.join("lib/lightpath");
    assert_eq!(names_in(&libraries), ["libembree4.so.4", "libtbb-1a.so.12", "libtbb.so.12"]);
    assert_eq!(
        fs::read_to_string(libraries.join("libembree4.so.4")).unwrap(),
        "libembree4.so.4.4.0"
    );
    assert!(!libraries.join("libembree4.so.4").is_symlink());
    assert_eq!(
        fs::read_link(libraries.join("libtbb.so.12")).unwrap().to_str(),
        Some("libtbb-1a.so.12")
    );

    // A run path would be for all libraries, and relative to the program.
    for program in [Path::new(env!("CARGO_BIN_EXE_lightpath")), &to.join("bin/lightpath")] {
        let bytes = fs::read(program).unwrap();
        let origin = b"$ORIGIN";
        assert!(!bytes.windows(origin.len()).any(|at| at == origin), "{}", program.display());
    }
}

/// The library here is none, so the message names the file that was opened.
#[test]
fn an_installation_loads_its_own_embree_while_nobody_else_can_change_it() {
    use std::io::Write;
    let scratch = Scratch::new();
    fs::create_dir(scratch.path("the embree")).unwrap();
    scratch.write("the embree/libembree4.so.4", "no library");
    install(&scratch, env!("CARGO_BIN_EXE_lightpath")).good();
    let to = scratch.path("to here").canonicalize().unwrap();
    let (program, folder) = (to.join("bin/lightpath"), to.join("lib/lightpath"));
    let opened = format!("cannot load {}", folder.join("libembree4.so.4").display());
    let command = |args: &[&str]| {
        let mut command = Command::new(&program);
        command.args(args).env_remove("LD_LIBRARY_PATH");
        command
    };
    let version = || Done::of(&mut command(&["--version", "--verbose"])).good().stdout();
    assert!(version().contains(&opened), "{}", version());
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o777)).unwrap();
    assert!(!version().contains(&opened), "{}", version());
    fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).unwrap();
    // An upgrade may replace the program while it runs.
    let mut render = command(&["render", "-", "-o", "x", "--backend", "embree"]);
    render.current_dir(&to).stdin(std::process::Stdio::piped());
    let mut child = render.stderr(std::process::Stdio::piped()).spawn().unwrap();
    fs::remove_file(&program).unwrap();
    let scene = r#"{ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 40,
                                 "position": [0, 0, 5], "target": [0, 0, 0], "up": [0, 1, 0] },
                     "scene": { "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1,
                                             "material": {} }] } }"#;
    child.stdin.take().unwrap().write_all(scene.as_bytes()).unwrap();
    let done = child.wait_with_output().unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(said.contains(&opened), "{said}");
}

/// The guide's links lead to installed files, but for the notebook, pictures and examples in Rust.
#[test]
fn an_installed_guide_is_whole_and_goes_with_the_rest() {
    let scratch = Scratch::new();
    install(&scratch, env!("CARGO_BIN_EXE_lightpath")).good();
    let to = scratch.path("to here");
    let doc = to.join("share/doc/lightpath");
    let mut links = 0;
    for page in names_in(&doc.join("docs/guide")) {
        let text = fs::read_to_string(doc.join("docs/guide").join(&page)).unwrap();
        for (_, rest) in text.match_indices("](").map(|(at, _)| text.split_at(at + 2)) {
            let link = rest.split([')', '#']).next().unwrap();
            // The template is in share/lightpath/farm.
            let absent = [
                "http",
                "../notebook/",
                "../images/",
                "../README.md",
                "../../examples/",
                "../../farm/",
            ];
            if !link.is_empty() && !absent.iter().any(|start| link.starts_with(start)) {
                assert!(doc.join("docs/guide").join(link).is_file(), "{page}: {link}");
                links += 1;
            }
        }
    }
    assert!(links > 50, "{links} links");
    let scene = doc.join("scenes/still-life.json");
    lightpath(&["info", scene.to_str().unwrap()]).good();
    let removed = Command::new("make")
        .args(["--no-print-directory", "uninstall", "DESTDIR="])
        .arg(format!("PREFIX={}", to.display()))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(removed.status.success(), "{}", String::from_utf8_lossy(&removed.stderr));
    let left = Command::new("find").arg(&to).args(["!", "-type", "d"]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&left.stdout), "");
}

#[test]
fn a_failed_installation_leaves_nothing() {
    let scratch = Scratch::new();
    assert_ne!(install(&scratch, "false").code(), 0);
    fs::create_dir(scratch.path("the embree")).unwrap();
    let done = install(&scratch, env!("CARGO_BIN_EXE_lightpath"));
    assert!(done.stderr().contains("no libembree4.so.4 in "), "{}", done.stderr());
    assert_eq!(scratch.names(), ["the embree"]);
}
