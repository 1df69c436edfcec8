//! `lightpath submit slurm --dry-run`: the scripts, and what they say. tests/slurm.rs runs them.

mod program;

use program::{PYRAMID, Scratch};

fn scratch(frames: u32) -> Scratch {
    let scratch = Scratch::new();
    for name in ["a", "b", "c"] {
        scratch.write(&format!("{name}.ply"), PYRAMID);
    }
    let turntable = format!(r#"{{ "inputs": ["*.ply"], "turntable": {{ "frames": {frames} }} }}"#);
    scratch.write("job.json", &turntable);
    scratch
}

fn submit(scratch: &Scratch, flags: &[&str]) -> program::Done {
    scratch.run(&[&["submit", "slurm", "job.json", "-o", "out", "--dry-run"], flags].concat())
}

#[test]
fn scripts_share_out_every_frame() {
    let scratch = scratch(24);
    let flags = ["--frames-per-task", "8", "--cpus", "4", "--memory", "3G", "--time", "1:00:00"];
    let done = submit(
        &scratch,
        &[&flags[..], &["--sbatch=--partition=long", "--at-a-time", "5"]].concat(),
    );
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let text = String::from_utf8(scratch.read("out/slurm/frames.sh")).unwrap();
    for line in [
        "#SBATCH --array=0-8%5",
        "#SBATCH --requeue",
        "#SBATCH --cpus-per-task=4",
        "#SBATCH --mem=3072M",
        "#SBATCH --time=1:00:00",
        "#SBATCH --partition=long",
        "first=$((SLURM_ARRAY_TASK_ID * 8))",
        "end=$((first + 8 < 72 ? first + 8 : 72))",
    ] {
        assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
    }
    assert!(text.contains("--resume"), "{text}");
    let said = done.stdout();
    assert!(said.contains("--dependency=afterok:"), "{said}");
    assert!(said.contains("--kill-on-invalid-dep=yes"), "{said}");
    // Bash reads both.
    for name in ["frames.sh", "sheet.sh"] {
        let path = scratch.path("out/slurm").join(name);
        let checked = std::process::Command::new("bash").arg("-n").arg(path).status().unwrap();
        assert!(checked.success(), "{name}");
    }
}

#[test]
fn memory_and_chunks_are_predicted() {
    let scratch = scratch(24);
    let done = submit(&scratch, &["--frame-seconds", "100", "--minutes", "10"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    // Six frames would take ten minutes, and six divide a mesh.
    assert!(done.stderr().contains("12 tasks of 6 frames"), "{}", done.stderr());
    let text = String::from_utf8(scratch.read("out/slurm/frames.sh")).unwrap();
    let memory = text.lines().find_map(|line| line.strip_prefix("#SBATCH --mem=")).unwrap();
    let mib: u64 = memory.trim_end_matches('M').parse().unwrap();
    assert!((60..2000).contains(&mib), "{mib} MiB");
    let done = submit(&scratch, &[]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

#[test]
fn bad_input_is_refused() {
    let scratch = scratch(24);
    scratch.write("scene.json", r#"{ "camera": {} }"#);
    scratch.write("empty.json", r#"{ "inputs": ["nosuch/*.ply"] }"#);
    let cases: &[(&[&str], &str)] = &[
        (&["slurm", "nosuch.json"], "nosuch.json"),
        (&["slurm", "scene.json"], "`inputs`"),
        (&["slurm", "empty.json"], "nosuch"),
        (&["slurm", "job.json", "--cpus", "0"], "--cpus"),
        (&["slurm", "job.json", "--frames-per-task", "0"], "--frames-per-task"),
        (&["slurm", "job.json", "--frames-per-task", "1", "--max-tasks", "10"], "72 tasks"),
        (&["slurm", "job.json", "--frame-seconds", "-1"], "--frame-seconds"),
        (&["slurm", "job.json", "--frame-seconds", "nan"], "--frame-seconds"),
        (&["slurm", "job.json", "--time", "1\n#SBATCH --wrap=x"], "line break"),
        (&["pbs", "job.json"], "pbs"),
    ];
    for (args, text) in cases {
        let done = scratch.run(&[&["submit"], *args, &["--dry-run"]].concat());
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        assert!(done.stderr().contains(text), "{args:?}: {}", done.stderr());
    }
}

#[test]
fn without_slurm_it_says_so() {
    let scratch = scratch(2);
    let mut command = scratch.command(&["submit", "slurm", "job.json", "-o", "out"]);
    let done = program::Done::of(command.env("PATH", "/nowhere"));
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("cannot run sbatch"), "{}", done.stderr());
}
