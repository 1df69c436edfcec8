//! Reads bytes as a job file in a folder that has a mesh, a scene and a list of cameras. The result
//! must be an error with a message, or a job whose frames stay in the output folder. Bytes that
//! begin as a file that the program writes are read as this: as the journal of a batch that has
//! made no frame, as a baseline of `bench`, or as the findings of `crosscheck`.

use std::fs;
use std::path::Path;

use lightpath::batch::sheet;
use lightpath::batch::{Flags, Job, JobFile, Task, WrittenInput, predict};
use lightpath::lab::baseline::BaselineComparison;
use lightpath::lab::crosscheck::Finding;
use lightpath::lab::result::BenchReport;
use lightpath::scene::{Document, read_as};

use super::inputs;

/// Begins a journal.
const EVENT: &[u8] = br#"{"event""#;
/// Begins a baseline.
const BASELINE: &[u8] = br#"{"version""#;
/// Begins a list of findings.
const FINDINGS: &[u8] = br#"[{"backend""#;
/// The job of the journals.
const BATCH: &str = r#"{ "inputs": ["a.ply"], "size": [8, 6], "turntable": { "frames": 3 },
    "output": { "folder": "out" } }"#;

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
    fs::create_dir_all(folder.join("out")).expect("space for a temporary folder");
}

/// Runs one input in a prepared folder.
pub fn run(folder: &Path, text: &[u8]) {
    if text.starts_with(EVENT) {
        return journal(folder, text);
    }
    if text.starts_with(BASELINE) {
        baseline(text);
        return;
    }
    if text.starts_with(FINDINGS) {
        findings(text);
        return;
    }
    if let Err(error) = check(folder, text) {
        inputs::check_error(&error);
    }
}

/// Whatever a journal says, frames without files are missing.
fn journal(folder: &Path, text: &[u8]) {
    inputs::write(&folder.join("out/batch.jsonl"), text);
    let document = Document::parse("job.json", BATCH.as_bytes()).expect("valid JSON");
    let file = read_as(&document).expect("a valid job file");
    let job = Job::check(file, folder, Flags::default()).expect("a valid job");
    let [problems] = &sheet::missing(&job, None)[..] else { panic!("one input") };
    let said = problems.first().expect("a problem").to_string();
    assert!(said.contains("all frames are missing"), "{said}");
}

/// Compares a baseline with itself: the machine is the same, whatever the timings are. Returns the
/// number of shared timings; `None` if the file cannot be read.
pub fn baseline(text: &[u8]) -> Option<usize> {
    let report: BenchReport = serde_json::from_slice(text).ok()?;
    let compared = BaselineComparison::new(&report, "baseline.json", &report);
    assert!(compared.machine_differences.is_none());
    serde_json::to_string(&compared).expect("a comparison is JSON");
    Some(compared.changes.len())
}

/// Restores the packets of findings. Each has the ray whose answer was wrong. Returns their number;
/// `None` if the file cannot be read.
pub fn findings(text: &[u8]) -> Option<usize> {
    let findings: Vec<Finding> = serde_json::from_slice(text).ok()?;
    let restores = |finding: &&Finding| match finding.case() {
        Ok(case) => {
            assert_ne!(case.packet.active.0[finding.lane], 0);
            true
        }
        Err(message) => {
            assert!(message.starts_with("found "), "{message}");
            false
        }
    };
    Some(findings.iter().filter(restores).count())
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
