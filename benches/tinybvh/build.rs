//! Compiles `src/shim.cpp` with the header `tiny_bvh.h` that the crate tinybvh-rs ships.

use std::path::PathBuf;
use std::process::Command;
use std::{env, fs};

fn main() {
    println!("cargo::rerun-if-changed=src/shim.cpp");
    println!("cargo::rerun-if-changed=Cargo.lock");
    // Where `make setup` puts Embree.
    let embree = format!("{}/../../vendor/embree", env!("CARGO_MANIFEST_DIR"));
    println!("cargo::rustc-link-arg=-Wl,-rpath,{embree}");
    let include = header_folder();
    let text = fs::read_to_string(include.join("tiny_bvh.h")).expect("tiny_bvh.h");
    let number = |what: &str| {
        let name = format!("TINY_BVH_VERSION_{what}");
        let mut lines = text.lines().filter_map(|line| line.strip_prefix("#define "));
        let value = lines.find_map(|line| line.strip_prefix(&name));
        value.expect("its version").trim().to_string()
    };
    let version = ["MAJOR", "MINOR", "SUB"].map(number).join(".");
    println!("cargo::rustc-env=TINYBVH_VERSION={version}");
    cc::Build::new()
        .cpp(true)
        .std("c++20")
        .opt_level(3)
        .flag("-march=native")
        .define("NDEBUG", None)
        .warnings(false)
        .include(include)
        .file("src/shim.cpp")
        .compile("tinybvh_shim");
}

/// Returns the folder into which cargo unpacked the crate's `ffi/tinybvh`.
fn header_folder() -> PathBuf {
    let cargo = env::var_os("CARGO").expect("cargo runs this");
    let output = Command::new(cargo)
        .args(["metadata", "--locked", "--format-version", "1"])
        .output()
        .expect("cargo metadata");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let packages = all["packages"].as_array().expect("packages");
    let package = packages.iter().find(|package| package["name"] == "tinybvh-rs");
    let manifest = package.and_then(|p| p["manifest_path"].as_str()).expect("tinybvh-rs");
    PathBuf::from(manifest).with_file_name("ffi").join("tinybvh")
}
