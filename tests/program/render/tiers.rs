//! Every instruction set of our own kernels gives the same bytes for every shipped scene, for
//! tracing and shading. Only `bvh` uses both; shading is the same beside other backends.

use std::path::{Path, PathBuf};
use std::{fs, process::Command};

use crate::support::program::{Done, Scratch};
use crate::support::reference::assets;
use lightpath::simd::Isa;
use rayon::prelude::*;

/// Flags that make a scene small, with all its layers and more than one sample.
const SMALL: [&str; 10] = [
    "--size",
    "28x20",
    "--spp",
    "2",
    "--light-samples",
    "2",
    "--aov",
    "all,ao",
    "--compression",
    "none",
];

fn scenes() -> Vec<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut scenes: Vec<PathBuf> =
        files.filter(|path| path.extension().is_some_and(|end| end == "json")).collect();
    scenes.sort();
    scenes
}

/// Returns the files of a render by a program: its path, or a command that runs it, word by word.
fn render(scratch: &Scratch, program: &[&str], scene: &Path, tier: &str) -> [Vec<u8>; 2] {
    let flags = ["--backend", "bvh", "--isa", tier, "-o", "x", "--quiet"];
    let text = fs::read_to_string(scene).unwrap();
    let lit = text.contains("\"arealight\"");
    let mut small: Vec<&str> = match lit {
        true => SMALL.to_vec(),
        false => [&SMALL[..4], &SMALL[6..]].concat(),
    };
    if text.contains("\"intrinsics\"") {
        // Intrinsics belong to one size.
        small.splice(..2, ["--crop", "380", "300", "408", "320"]);
    }
    let mut command = Command::new(program[0]);
    command.args(&program[1..]).arg("render").arg(scene).args(small).args(flags);
    Done::of(command.current_dir(scratch.path("")).env_remove("SLURM_CPUS_PER_TASK")).good();
    ["x.exr", "x.png"].map(|name| scratch.read(name))
}

const OWN: &str = env!("CARGO_BIN_EXE_lightpath");

fn name(isa: Isa) -> String {
    isa.to_string().to_lowercase().replace('-', "")
}

#[test]
fn a_picture_has_the_same_bytes_in_every_instruction_set() {
    let scratch = Scratch::new();
    let scenes = scenes();
    assert!(scenes.len() > 20, "{scenes:?}");
    for scene in &scenes {
        let portable = render(&scratch, &[OWN], scene, "portable");
        for isa in Isa::available().filter(|&isa| isa != Isa::Portable) {
            let found = render(&scratch, &[OWN], scene, &name(isa));
            assert!(found == portable, "{}: {isa} differs", scene.display());
        }
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
    scenes.par_iter().for_each(|scene| {
        let scratch = Scratch::new();
        let [own, _] = render(&scratch, &[OWN], scene, &name(Isa::detect()));
        let mut files = tiers.split_whitespace().map(|tier| render(&scratch, &other, scene, tier));
        let first = files.next().unwrap();
        for found in files {
            assert!(found == first, "{}: two instruction sets differ", scene.display());
        }
        // C libraries differ in the last bits of sines and powers.
        let differing = own.iter().zip(&first[0]).filter(|(a, b)| a != b).count();
        assert_eq!(own.len(), first[0].len());
        assert!(differing * 1000 < own.len(), "{}: {differing} bytes differ", scene.display());
    });
}
