//! The same bytes in every instruction set of our own kernels, for every scene that is shipped and every
//! backend. Embree chooses its own instructions, the same ones in each of these runs.

mod program;

use std::{fs, path::PathBuf};

use program::{Scratch, embree::no_embree};

const TIERS: [&str; 3] = ["portable", "avx2", "avx512"];

/// A scene and the flags that make it small: all its layers, more than one sample.
const SMALL: [&str; 10] = [
    "--size",
    "28x20",
    "--spp",
    "2",
    "--light-samples",
    "2",
    "--aov",
    "all",
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

/// The files of a render; `None` where the machine lacks the instruction set, or Embree.
fn render(scratch: &Scratch, scene: &str, backend: &str, tier: &str) -> Option<[Vec<u8>; 2]> {
    let flags = ["--backend", backend, "--isa", tier, "-o", "x", "--quiet"];
    let lit = fs::read_to_string(scene).unwrap().contains("\"arealight\"");
    let small: Vec<&str> = match lit {
        true => SMALL.to_vec(),
        false => [&SMALL[..4], &SMALL[6..]].concat(),
    };
    let done = scratch.run(&[&["render", scene], &small[..], &flags].concat());
    let said = done.stderr();
    if done.code() == 2 && (said.contains("--isa") || no_embree(&said)) {
        return None;
    }
    assert_eq!(done.code(), 0, "{scene} {backend} {tier}: {said}");
    Some(["x.exr", "x.png"].map(|name| scratch.read(name)))
}

#[test]
fn a_picture_has_the_same_bytes_in_every_instruction_set() {
    let scratch = Scratch::new();
    let (mut compared, scenes) = (0, scenes());
    assert!(scenes.len() > 20, "{scenes:?}");
    for scene in &scenes {
        let scene = scene.to_str().unwrap();
        for backend in ["bvh", "coursework", "brute", "embree"] {
            let made = |tier| Some((tier, render(&scratch, scene, backend, tier)?));
            let made: Vec<_> = TIERS.into_iter().filter_map(made).collect();
            for pair in made.windows(2) {
                let [(a, first), (b, second)] = pair else { continue };
                assert!(first == second, "{scene} by {backend}: {a} and {b} differ");
                compared += 1;
            }
        }
    }
    assert!(compared > 0 || !cfg!(target_arch = "x86_64"), "nothing was compared");
}
