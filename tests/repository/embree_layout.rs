//! Compares the structures that are passed to Embree with Embree's own headers: a C program prints
//! every size, alignment and offset. It is compiled if there were headers (`EMBREE_DIR/include`,
//! else the system's) when the test was. What it printed for those of 4.3.3 and 4.4.0, the same, is
//! kept.
use std::{env, fmt::Write, process::Command};

use lightpath::accel::embree::LAYOUTS;

/// Returns a C program that prints the table of [`ours`].
fn program() -> String {
    let mut text = String::from(
        "#include <embree4/rtcore.h>\n#include <stddef.h>\n#include <stdio.h>\nint main(void) {\n",
    );
    for (name, _, _, members) in LAYOUTS {
        let size = "%zu align %zu\\n";
        let values = format!("sizeof(struct {name}), _Alignof(struct {name})");
        writeln!(text, "  printf(\"{name} size {size}\", {values});").unwrap();
        for (member, _) in *members {
            let value = format!("offsetof(struct {name}, {member})");
            writeln!(text, "  printf(\"{name}.{member} %zu\\n\", {value});").unwrap();
        }
    }
    text + "  return 0;\n}\n"
}

fn ours() -> String {
    let mut text = String::new();
    for (name, size, align, members) in LAYOUTS {
        writeln!(text, "{name} size {size} align {align}").unwrap();
        for (member, offset) in *members {
            writeln!(text, "{name}.{member} {offset}").unwrap();
        }
    }
    text
}

#[test]
fn structures_lie_as_in_embree_4_3_and_4_4() {
    assert_eq!(ours(), include_str!("../data/embree-layouts.txt"), "left: Rust, right: C");
}

#[test]
#[cfg_attr(not(lightpath_embree_headers), ignore = "needs Embree's headers")]
fn structures_lie_as_the_c_headers_say() {
    let include = env!("LIGHTPATH_EMBREE_HEADERS");
    let folder = tempfile::tempdir().unwrap();
    let (source, binary) = (folder.path().join("layout.c"), folder.path().join("layout"));
    std::fs::write(&source, program()).unwrap();
    let compiler = env::var("CC").unwrap_or_else(|_| "cc".into());
    let compiled = Command::new(compiler)
        .args(["-I", include])
        .arg(&source)
        .arg("-o")
        .arg(&binary)
        .output()
        .expect("a C compiler");
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let printed = Command::new(&binary).output().unwrap();
    let theirs = String::from_utf8(printed.stdout).unwrap();
    assert_eq!(ours(), theirs, "left: Rust, right: {}", include);
    assert!(theirs.lines().count() > 60);
}
