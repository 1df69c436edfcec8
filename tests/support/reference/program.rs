//! Runs the renderer as a user would, and reads the EXR that it writes.

use exr::prelude::{ReadChannels, ReadLayers};
use lightpath_reference::Picture;
use std::path::Path;
use std::process::Command;

/// Runs `lightpath render SCENE -o PREFIX` beside the scene, on a backend, and reads `PREFIX.exr`.
pub fn render(scene: &Path, backend: &str) -> Picture {
    let prefix = scene.with_extension("");
    let run = Command::new(env!("CARGO_BIN_EXE_lightpath"))
        .args(["render".as_ref(), scene.as_os_str(), "-o".as_ref(), prefix.as_os_str()])
        .args(["--threads", "2", "--quiet", "--backend", backend])
        .output()
        .expect("the program starts");
    assert!(
        run.status.success(),
        "lightpath render {}: {}\n{}",
        scene.display(),
        run.status,
        String::from_utf8_lossy(&run.stderr)
    );
    let exr = prefix.with_extension("exr");
    assert!(exr.exists(), "lightpath render succeeded without writing {}", exr.display());
    read_exr(&exr)
}

/// Reads the RGBA of the first layer that has it.
pub fn read_exr(path: &Path) -> Picture {
    let file = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| (size.width(), vec![[0.0; 4]; size.area()]),
            |(width, pixels), at, (r, g, b, a): (f32, f32, f32, f32)| {
                pixels[at.y() * *width + at.x()] = [r, g, b, a].map(f64::from);
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let (width, pixels) = file.layer_data.channel_data.pixels;
    Picture { width, height: pixels.len() / width, pixels, deviation: Vec::new() }
}
