//! Promises about the package itself: the oldest compiler, the lock file, the licence texts.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

/// `"1.85"` and `"1.85.0"` as numbers that compare.
fn release(version: &str) -> (u64, u64, u64) {
    let mut parts = version
        .split('.')
        .map(|part| part.parse().expect("a number"));
    let mut next = || parts.next().unwrap_or(0);
    (next(), next(), next())
}

#[test]
fn no_dependency_needs_a_newer_compiler_than_we_promise() {
    // Debian 13's own compiler. The lock file decides, so a `cargo update` is checked too.
    let promised = release(env!("CARGO_PKG_RUST_VERSION"));
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--locked",
            "--offline",
            "--format-version",
            "1",
            "--filter-platform",
        ])
        .arg(host())
        .args([
            "--manifest-path",
            concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"),
        ])
        .output()
        .expect("cargo runs");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
    let packages = metadata["packages"].as_array().expect("a list of packages");
    assert!(
        packages.len() > 20,
        "cargo metadata lists only {} packages",
        packages.len()
    );
    let too_new: Vec<String> = packages
        .iter()
        .filter_map(|package| {
            let needed = package["rust_version"].as_str()?;
            (release(needed) > promised).then(|| {
                format!(
                    "{} {} needs Rust {needed}",
                    package["name"], package["version"]
                )
            })
        })
        .collect();
    assert!(too_new.is_empty(), "\n{}\n", too_new.join("\n"));
}

fn host() -> String {
    let output = Command::new("rustc")
        .arg("-vV")
        .output()
        .expect("rustc runs");
    let text = String::from_utf8(output.stdout).expect("text");
    text.lines()
        .find_map(|line| line.strip_prefix("host: "))
        .expect("a host")
        .to_owned()
}

#[test]
fn the_package_carries_its_licences_and_its_lock_file() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in [
        "LICENSE-MIT",
        "LICENSE-APACHE",
        "THIRD_PARTY.md",
        "Cargo.lock",
    ] {
        assert!(root.join(name).is_file(), "{name} is missing");
    }
}
