//! Reads bytes as a job file in a folder that has a mesh, a scene and a list of cameras. The result
//! must be an error with a message, or a job whose frames stay in the output folder.

use std::path::Path;

use lightpath::batch::{Flags, Job, JobFile, Task, WrittenInput, predict};
use lightpath::scene::{Document, read_as};

use super::inputs;

/// Writes the files that a job may name.
pub fn prepare(folder: &Path) {
    let mesh = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    let files = [
        ("a.ply", mesh),
        ("b.json", include_str!("../../../scenes/fig01a-sphere.json")),
        ("cameras.txt", "1 PINHOLE 64 48 50 50 32 24\n"),
        ("images.txt", "1 1 0 0 0 0 0 1 1 first.png\n\n2 1 0 0 0 0 0 2 1 second/third.png\n\n"),
    ];
    for (name, text) in files {
        inputs::write(&folder.join(name), text.as_bytes());
    }
}

/// Runs one input in a prepared folder.
pub fn run(folder: &Path, text: &[u8]) {
    if let Err(error) = check(folder, text) {
        inputs::check_error(&error);
    }
}

fn check(folder: &Path, text: &[u8]) -> lightpath::Result<()> {
    let document = Document::parse("job.json", text)?;
    let file: JobFile = read_as(&document)?;
    let inputs = file.inputs.iter().map(|input| match input {
        WrittenInput::Path(path) => &path.0,
        WrittenInput::Entry(entry) => &entry.path.0,
    });
    // A pattern could search the whole machine.
    let mut named = inputs.chain(file.template.iter().chain(&file.cameras).map(|name| &name.0));
    if !named.all(|name| inputs::is_inside(Path::new(name))) {
        return Ok(());
    }
    let job = Job::check(file, folder, Flags::default())?;
    let frames = job.frames();
    assert!(frames > 0);
    for input in 0..job.inputs.len() {
        // The scene of an input may have an error that the job does not show.
        let all = Task { input, frames: 0..frames };
        if let Err(error) = predict(&job, &all) {
            inputs::check_error(&error);
        }
        for frame in [0, frames - 1] {
            let path = job.prefix(input, frame);
            assert!(inputs::is_inside(
                path.strip_prefix(&job.folder).expect("a file of the folder")
            ));
        }
    }
    Ok(())
}
