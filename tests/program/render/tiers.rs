//! Every instruction set of our own kernels gives the same bytes for every shipped scene, for
//! tracing and shading. Only `bvh` uses both; shading is the same beside other backends.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, process::Command};

use crate::support::program::{Done, Scratch};
use crate::support::reference::assets;
use lightpath::simd::Isa;
use rayon::prelude::*;

/// Flags that make a scene small, with all its layers and more than one sample.
const SMALL: [&str; 8] =
    ["--size", "28x20", "--spp", "2", "--aov", "all,ao", "--compression", "none"];

fn scenes() -> Vec<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut scenes: Vec<PathBuf> =
        files.filter(|path| path.extension().is_some_and(|end| end == "json")).collect();
    scenes.sort();
    scenes
}

/// The flags of a scene.
fn flags(scene: &Path) -> Vec<&'static str> {
    let (text, mut flags) = (fs::read_to_string(scene).unwrap(), SMALL.to_vec());
    if text.contains("\"arealight\"") {
        flags.extend(["--light-samples", "2"]);
    }
    if text.contains("\"intrinsics\"") {
        // Intrinsics belong to one size.
        flags.splice(..2, ["--crop", "380", "300", "408", "320"]);
    }
    flags
}

fn name_of(scene: &Path) -> &str {
    scene.file_stem().unwrap().to_str().unwrap()
}

/// Returns the files of scenes, by name, as a program renders them: its path, or a command that
/// runs it, word by word. An emulator translates the program once a process, so a process has all
/// scenes of the same flags.
fn render(program: &[&str], scenes: &[PathBuf], tier: &str) -> BTreeMap<String, Vec<u8>> {
    let scratch = Scratch::new();
    fs::create_dir(scratch.path("x")).unwrap();
    let mut by_flags = BTreeMap::<_, Vec<_>>::new();
    scenes.iter().for_each(|scene| by_flags.entry(flags(scene)).or_default().push(scene));
    let run = |command: &[&str], flags: &[&str], scenes: &[&PathBuf]| {
        let mut process = Command::new(program[0]);
        process.args(&program[1..]).args(command).args(flags).args(scenes);
        process.args(["--backend", "bvh", "--isa", tier, "--quiet"]);
        process.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK");
        Done::of(&mut process).good();
    };
    for (flags, scenes) in by_flags {
        if flags.contains(&"--crop") {
            // A batch has no crops.
            for scene in scenes {
                run(&["render", "-o", &format!("x/{}", name_of(scene))], &flags, &[scene]);
            }
        } else {
            run(&["batch", "-o", "x", "--no-sheet"], &flags, &scenes);
        }
    }
    let files = scenes.iter().map(|scene| name_of(scene));
    let files = files.flat_map(|name| ["exr", "png"].map(|end| format!("{name}.{end}")));
    files.map(|file| (file.clone(), scratch.read(&format!("x/{file}")))).collect()
}

const OWN: &str = env!("CARGO_BIN_EXE_lightpath");

fn name(isa: Isa) -> String {
    isa.to_string().to_lowercase().replace('-', "")
}

/// Compares the files of two instruction sets.
fn compare(found: &BTreeMap<String, Vec<u8>>, first: &BTreeMap<String, Vec<u8>>, tier: &str) {
    assert_eq!(found.len(), first.len());
    for ((name, found), first) in found.iter().zip(first.values()) {
        assert!(found == first, "{name}: {tier} differs");
    }
}

#[test]
fn a_picture_has_the_same_bytes_in_every_instruction_set() {
    let scenes = scenes();
    assert!(scenes.len() > 20, "{scenes:?}");
    let portable = render(&[OWN], &scenes, "portable");
    for isa in Isa::available().filter(|&isa| isa != Isa::Portable) {
        compare(&render(&[OWN], &scenes, &name(isa)), &portable, &name(isa));
    }
}

/// `LIGHTPATH_OTHER` is a command that runs the program of another machine, for example
/// `qemu-aarch64-static target/aarch64-unknown-linux-musl/release/lightpath`. `LIGHTPATH_TIERS` are
/// its instruction sets.
#[test]
#[ignore = "needs a program of another machine: scripts/aarch64.sh"]
fn a_picture_is_the_same_on_another_machine_in_every_instruction_set() {
    let [other, tiers] =
        ["LIGHTPATH_OTHER", "LIGHTPATH_TIERS"].map(|name| std::env::var(name).expect(name));
    let other: Vec<&str> = other.split_whitespace().collect();
    let staged = Scratch::new();
    assets::write_all(&staged.path(""));
    let mut scenes = scenes();
    for name in ["arealights", "lens", "meshes", "shapes", "textures"] {
        let stored = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/reference");
        let scene = staged.path(&format!("{name}.json"));
        fs::copy(stored.join(format!("{name}.json")), &scene).unwrap();
        scenes.push(scene);
    }
    let tiers: Vec<&str> = tiers.split_whitespace().collect();
    let files: Vec<_> = tiers.par_iter().map(|tier| render(&other, &scenes, tier)).collect();
    let first = &files[0];
    tiers.iter().zip(&files).skip(1).for_each(|(tier, found)| compare(found, first, tier));
    let own = render(&[OWN], &scenes, &name(Isa::detect()));
    // C libraries differ in the last bits of sines and powers.
    for ((name, own), other) in
        own.iter().zip(first.values()).filter(|(own, _)| own.0.ends_with("exr"))
    {
        let differing = own.iter().zip(other).filter(|(a, b)| a != b).count();
        assert_eq!(own.len(), other.len());
        assert!(differing * 1000 < own.len(), "{name}: {differing} bytes differ");
    }
}
