//! Every instruction set of our own kernels gives the same bytes for every shipped scene, for
//! tracing and shading. Only `bvh` uses both; shading is the same beside other backends.

use std::{fs, path::PathBuf};

use crate::support::program::Scratch;
use lightpath::simd::Isa;

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

/// Returns the files of a render.
fn render(scratch: &Scratch, scene: &str, isa: Isa) -> [Vec<u8>; 2] {
    let tier = isa.to_string().to_lowercase().replace('-', "");
    let flags = ["--backend", "bvh", "--isa", &tier, "-o", "x", "--quiet"];
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
    scratch.run(&[&["render", scene], &small[..], &flags].concat()).good();
    ["x.exr", "x.png"].map(|name| scratch.read(name))
}

#[test]
fn a_picture_has_the_same_bytes_in_every_instruction_set() {
    let scratch = Scratch::new();
    let scenes = scenes();
    assert!(scenes.len() > 20, "{scenes:?}");
    for scene in &scenes {
        let scene = scene.to_str().unwrap();
        let portable = render(&scratch, scene, Isa::Portable);
        for isa in Isa::available().filter(|&isa| isa != Isa::Portable) {
            assert!(render(&scratch, scene, isa) == portable, "{scene}: {isa} differs");
        }
    }
}
