//! Rules for the package itself: oldest compiler, lock file, licence texts, width of comments.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::rust_files;

/// Converts `"1.85"` and `"1.85.0"` to numbers that compare.
fn release(version: &str) -> (u64, u64, u64) {
    let mut parts = version.split('.').map(|part| part.parse().expect("a number"));
    let mut next = || parts.next().unwrap_or(0);
    (next(), next(), next())
}

#[test]
fn no_dependency_needs_a_newer_compiler_than_we_promise() {
    // The promised version is that of Debian 13's compiler. The lock file decides, so a `cargo
    // update` is checked, too.
    let promised = release(env!("CARGO_PKG_RUST_VERSION"));
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--locked", "--offline", "--format-version", "1", "--filter-platform"])
        .arg(host())
        .args(["--manifest-path", concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml")])
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
    let packages = metadata["packages"].as_array().expect("a list of packages");
    assert!(packages.len() > 20, "cargo metadata lists only {} packages", packages.len());
    let too_new: Vec<String> = packages
        .iter()
        .filter_map(|package| {
            let needed = package["rust_version"].as_str()?;
            (release(needed) > promised)
                .then(|| format!("{} {} needs Rust {needed}", package["name"], package["version"]))
        })
        .collect();
    assert!(too_new.is_empty(), "\n{}\n", too_new.join("\n"));
}

fn host() -> String {
    let output = Command::new("rustc").arg("-vV").output().expect("rustc runs");
    let text = String::from_utf8(output.stdout).expect("text");
    text.lines().find_map(|line| line.strip_prefix("host: ")).expect("a host").to_owned()
}

#[test]
fn the_package_carries_its_licences_and_its_lock_file() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "THIRD_PARTY.md", "Cargo.lock"] {
        assert!(root.join(name).is_file(), "{name} is missing");
    }
}

#[test]
fn every_crate_that_is_compiled_in_is_named_with_its_licence() {
    let root = env!("CARGO_MANIFEST_DIR");
    let crates = |manifest: &str| {
        let output = Command::new(env!("CARGO"))
            .args(["tree", "--locked", "--offline", "-e", "normal", "--prefix", "none"])
            .args(["--format", "{p}|{l}", "--manifest-path", &format!("{root}/{manifest}")])
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text")
    };
    let tree = crates("Cargo.toml");
    let table = fs::read_to_string(format!("{root}/THIRD_PARTY.md")).expect("a table");
    let texts = fs::read_to_string(format!("{root}/THIRD_PARTY_LICENSES.txt")).expect("texts");
    let texts: BTreeSet<&str> = texts.lines().flat_map(|line| line.split(", ")).collect();
    let all = [tree.as_str(), &crates("python/Cargo.toml")].concat();
    let without_text: Vec<String> = all
        .lines()
        .filter_map(|line| line.split('|').next()?.split_once(" v"))
        .map(|(name, rest)| format!("{name} {}", rest.split(' ').next().unwrap_or_default()))
        .filter(|crate_| !crate_.starts_with("lightpath") && !texts.contains(crate_.as_str()))
        .collect();
    assert!(
        without_text.is_empty(),
        "not in THIRD_PARTY_LICENSES.txt: {without_text:?}: run scripts/licences.py"
    );
    let missing: Vec<String> = tree
        .lines()
        .filter_map(name_and_licence)
        .filter(|(name, licence)| {
            let is_row = |row: &str| {
                row.starts_with(&format!("| {licence} |")) && row.contains(&format!("`{name}`"))
            };
            *name != env!("CARGO_PKG_NAME") && !table.lines().any(is_row)
        })
        .map(|(name, licence)| format!("{name}: {licence}"))
        .collect();
    assert!(tree.lines().count() > 20 && missing.is_empty(), "not in THIRD_PARTY.md: {missing:?}");
}

/// `make lint` compiles the fuzz targets into the target folder of the program. Another version or
/// profile would compile crates twice.
#[test]
fn the_fuzz_targets_share_crates() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |file: &str| fs::read_to_string(root.join(file)).expect("a file");
    let versions = |file: &str| -> BTreeSet<(String, String)> {
        let value = |line: Option<&str>| line?.split('"').nth(1).map(str::to_owned);
        let lock = read(file);
        let packages = lock.split("[[package]]\n").skip(1);
        packages
            .filter_map(|package| {
                let mut lines = package.lines();
                Some((value(lines.next())?, value(lines.next())?))
            })
            .collect()
    };
    let profile = |file: &str| {
        let manifest = read(file);
        let (_, rest) = manifest.split_once("[profile.release.package]\n").expect("a profile");
        rest.split("\n\n").next().map(str::to_owned)
    };
    let ours = versions("Cargo.lock");
    let others: Vec<(String, String)> = versions("fuzz/Cargo.lock")
        .into_iter()
        .filter(|(name, _)| ours.iter().any(|(other, _)| other == name))
        .filter(|package| !ours.contains(package))
        .collect();
    assert!(others.is_empty(), "fuzz/Cargo.lock: not the versions of Cargo.lock: {others:?}");
    assert_eq!(profile("fuzz/Cargo.toml"), profile("Cargo.toml"));
}

/// `make test` compiles the library once for the program and the Python package. Where a crate had
/// other features with only one of them, it and all that depend on it would be compiled twice.
#[test]
fn the_python_package_shares_the_library() {
    let features = |package: &str| -> BTreeSet<String> {
        let output = Command::new(env!("CARGO"))
            .args(["tree", "--locked", "--offline", "-e", "normal,build", "--prefix", "none"])
            .args(["--no-dedupe", "--format", "{p}|{f}", "--package", package])
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .output()
            .expect("cargo runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("text").lines().map(str::to_owned).collect()
    };
    let ours = features("lightpath");
    let theirs = features("lightpath-python");
    let alone: Vec<&String> = ours.difference(&theirs).collect();
    assert!(ours.len() > 100 && alone.is_empty(), "other features for the package: {alone:?}");
}

/// One version is released: that of the program, and of the Python package made with it.
#[test]
fn the_python_package_has_the_version_of_the_program() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let manifest = fs::read_to_string(root.join("python/Cargo.toml")).expect("a manifest");
    let expected = concat!("version = \"", env!("CARGO_PKG_VERSION"), "\"");
    let version = manifest.lines().find(|line| line.starts_with("version = "));
    assert_eq!(version, Some(expected));
}

/// Splits a line such as `glob v0.3.4|MIT OR Apache-2.0 (*)`. Old crates write `/` for `OR`.
fn name_and_licence(line: &str) -> Option<(&str, String)> {
    let (package, licence) = line.split_once('|')?;
    let licence = licence.trim_end_matches(" (*)").replace('/', " OR ");
    Some((package.split(' ').next()?, licence))
}

/// rustfmt wraps code at 100 columns, but not comments.
#[test]
fn comments_are_as_wide_as_code() {
    let mut complaints = Vec::new();
    for file in ["src", "tests", "benches", "examples"].into_iter().flat_map(rust_files) {
        let text = fs::read_to_string(&file).expect("a source file");
        for (line, number) in text.lines().zip(1..) {
            if line.trim_start().starts_with("//") && line.chars().count() > 100 {
                complaints.push(format!(
                    "{}:{number}: {} columns",
                    file.display(),
                    line.chars().count()
                ));
            }
        }
    }
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

/// Finds syntax that is newer than our oldest compiler. clippy only finds newer functions.
#[test]
fn no_syntax_is_newer_than_the_oldest_compiler() {
    let mut complaints = Vec::new();
    for file in ["src", "tests", "benches", "examples"].into_iter().flat_map(rust_files) {
        let text = fs::read_to_string(&file).expect("a source file");
        let lines: Vec<&str> = text.lines().map(str::trim).collect();
        for (index, line) in lines.iter().enumerate() {
            if let Some(what) = newer(line, &lines[..index], &lines[index + 1..]) {
                complaints.push(format!("{}:{}: {what}", file.display(), index + 1));
            }
        }
    }
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

fn newer(line: &str, before: &[&str], after: &[&str]) -> Option<&'static str> {
    let opens_let = |line: &str| {
        ["if let ", "while let ", "} else if let ", "else if let "]
            .iter()
            .any(|start| line.starts_with(start))
    };
    if line.starts_with("#[target_feature") {
        let function = after.iter().find(|line| !line.starts_with("#[") && !line.starts_with("//"));
        if function.is_none_or(|line| !line.contains("unsafe fn ")) {
            return Some("a safe function with #[target_feature] needs Rust 1.86: make it unsafe");
        }
    }
    // `if let` and `&&` in one condition. rustfmt starts a line with `&&` if the condition is long.
    let chain = line.starts_with("&& let ")
        || line.starts_with("&& ")
            && before
                .iter()
                .rev()
                .find(|line| !line.starts_with("&& "))
                .is_some_and(|line| opens_let(line) && !line.ends_with('{'));
    if chain || line.starts_with("if ") && line.contains(concat!(" &&", " let ")) {
        return Some("`let` beside `&&` in a condition needs Rust 1.88");
    }
    if line.contains(concat!("::Invalid", "Filename")) {
        return Some(concat!("ErrorKind::Invalid", "Filename needs Rust 1.87"));
    }
    None
}

/// Only `src/cli/` and `src/main.rs` belong to the program. Any other code would print or exit
/// inside other people's programs.
#[test]
fn the_library_neither_prints_nor_exits() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let files = rust_files("src");
    let of_program = |file: &Path| file.starts_with(src.join("cli")) || file == src.join("main.rs");
    assert!(
        files.iter().any(|file| of_program(file)) && files.iter().any(|file| !of_program(file))
    );
    let mut complaints = Vec::new();
    for file in files.iter().filter(|file| !of_program(file)) {
        let text = fs::read_to_string(file).expect("a source file");
        for (index, line) in text.lines().enumerate() {
            if let Some(word) = prints_or_exits(line) {
                complaints.push(format!("{}:{}: {word}", file.display(), index + 1));
            }
        }
    }
    assert!(complaints.is_empty(), "only src/cli may do this:\n{}\n", complaints.join("\n"));
    let caught =
        ["  println!(\"x\");", "std::process::exit(1)", "let e = io::stderr();", "dbg!(x)"];
    assert!(caught.iter().all(|line| prints_or_exits(line).is_some()));
    assert_eq!(prints_or_exits("// println!(\"x\")"), None);
}

fn prints_or_exits(line: &str) -> Option<&'static str> {
    let code = line.split("//").next().unwrap_or_default();
    let words = [
        "println!",
        "eprintln!",
        "print!",
        "eprint!",
        "dbg!",
        "process::exit",
        "process::abort",
        "stdout()",
        "stderr()",
        "panic::set_hook",
    ];
    words.into_iter().find(|word| code.contains(word))
}
