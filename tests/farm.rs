//! Farms in earnest: Slurm's own daemons with nodes that die, and Open Job Description's own runner. Both are
//! skipped, and say so, where these are not installed.

mod program;

use std::{
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

use program::{Done, PYRAMID, Scratch};

const FRAMES: usize = 60;

fn root() -> PathBuf {
    env!("CARGO_MANIFEST_DIR").into()
}

fn has(program: &str) -> bool {
    let found = Command::new("sh").args(["-c", "command -v \"$0\"", program]).output();
    found.is_ok_and(|output| output.status.success())
}

fn skipped(what: &str, how: &str) {
    // Past the test harness, which hides what passing tests print.
    let _ = Command::new("sh")
        .args(["-c", "printf '\\n*** SKIPPED: %s ***\\n' \"$0\" >&2", &format!("{what}; {how}")])
        .status();
}

/// A turntable of one mesh.
fn scratch(size: &str, spp: u32) -> Scratch {
    let scratch = Scratch::new();
    scratch.write("pyramid.ply", PYRAMID);
    let (width, height) = size.split_once('x').unwrap();
    let job = format!(
        r#"{{ "inputs": ["pyramid.ply"], "turntable": {{ "frames": {FRAMES} }},
             "set": {{ "/spp": {spp}, "/camera/width": {width}, "/camera/height": {height},
                       "/scene/accelerator": "bvh" }} }}"#
    );
    scratch.write("job.json", &job);
    scratch
}

/// All pictures of a folder, by name.
fn pictures(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        found.push((name, std::fs::read(path).unwrap()));
    }
    found.sort();
    found
}

#[track_caller]
fn same_pictures(scratch: &Scratch, farm: &str) {
    // By the same name: what a picture says of its scene has the paths in it.
    let job = scratch.path("job.json").display().to_string();
    let done = scratch.run(&["batch", &job, "-o", "one", "--quiet"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let (one, farm) =
        (pictures(&scratch.path("one/pyramid")), pictures(&scratch.path(farm).join("pyramid")));
    let names =
        |all: &[(String, Vec<u8>)]| all.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    // Nothing is missing, and nothing half is left beside it.
    assert_eq!(names(&one), names(&farm));
    assert_eq!(one.len(), 2 * FRAMES, "{:?}", names(&one));
    assert!(one == farm, "a picture differs from that of one machine");
}

/// A cluster that ends with the test.
struct Cluster {
    folder: tempfile::TempDir,
}

impl Cluster {
    fn run(&self, args: &[&str]) -> Done {
        let mut command = Command::new(root().join("scripts/slurm_cluster.sh"));
        // Other clusters may run on this machine: of another checkout's tests.
        let port = 20_000 + std::process::id() % 2_000 * 10;
        command.env("SLURM_CLUSTER", self.state()).env("SLURM_CLUSTER_PORT", port.to_string());
        Done::of(command.args(args))
    }

    #[track_caller]
    fn ok(&self, args: &[&str]) {
        let done = self.run(args);
        assert_eq!(done.code(), 0, "{args:?}: {}{}", done.stdout(), done.stderr());
    }

    fn state(&self) -> PathBuf {
        self.folder.path().join("slurm")
    }

    fn slurm(&self, program: &str, args: &[&str]) -> String {
        let mut command = Command::new(program);
        let output = command.args(args).env("SLURM_CONF", self.state().join("slurm.conf")).output();
        String::from_utf8_lossy(&output.unwrap().stdout).into_owned()
    }

    fn wait_for(&self, what: &str, seconds: u64, done: impl Fn() -> bool) {
        let start = Instant::now();
        while !done() {
            assert!(
                start.elapsed() < Duration::from_secs(seconds),
                "{what}: {}",
                self.slurm("squeue", &[])
            );
            std::thread::sleep(Duration::from_millis(200));
        }
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        self.run(&["down"]);
    }
}

#[test]
fn a_cluster_that_loses_nodes_loses_no_frame() {
    let programs = ["slurmctld", "slurmd", "sbatch", "munged", "unshare", "nsenter"];
    let is_root = Command::new("id").arg("-u").output().is_ok_and(|o| o.stdout == b"0\n");
    if let Some(missing) = programs.into_iter().find(|program| !has(program)) {
        return skipped(
            &format!("the cluster test: there is no {missing}"),
            "apt-get install slurmctld slurmd slurm-client munge",
        );
    }
    if !is_root {
        return skipped("the cluster test: not root", "run the tests as root");
    }
    let cluster = Cluster { folder: tempfile::tempdir().unwrap() };
    let scratch = scratch("160x120", 24);
    cluster.ok(&["up", "3", "2"]);
    let mut command = scratch.command(&[
        "submit",
        "slurm",
        "job.json",
        "-o",
        "farm",
        "--frames-per-task",
        "1",
        "--cpus",
        "1",
        "--memory",
        "200M",
    ]);
    let done = Done::of(command.env("SLURM_CONF", cluster.state().join("slurm.conf")));
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let finished = || {
        let names = std::fs::read_dir(scratch.path("farm/pyramid")).into_iter().flatten();
        let names = names.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
        names.filter(|name| name.ends_with(".png")).count()
    };
    // In the middle, one node dies with its tasks, and of another the daemon alone.
    cluster.wait_for("no frame is finished", 300, || finished() >= 8);
    // Tasks that have just begun are under way when the node dies.
    let begun = |node: &str| {
        let times = cluster.slurm("squeue", &["-h", "-t", "R", "-w", node, "-o", "%M"]);
        times.lines().any(|time| ["0:00", "0:01"].contains(&time.trim()))
    };
    cluster.wait_for("no task on n2", 300, || begun("n2"));
    cluster.ok(&["kill-node", "2"]);
    cluster.wait_for("no more frames", 300, || finished() >= 12);
    cluster.wait_for("no task on n3", 300, || begun("n3"));
    cluster.ok(&["kill-slurmd", "3"]);
    let at_the_kills = finished();
    assert!(at_the_kills < FRAMES, "the nodes died too late");
    cluster.wait_for("Slurm does not notice", 120, || {
        let down = cluster.slurm("sinfo", &["-h", "-t", "down,no_respond", "-o", "%D"]);
        down.split_whitespace().filter_map(|n| n.parse::<u32>().ok()).sum::<u32>() >= 2
    });
    cluster.ok(&["start-node", "2"]);
    cluster.ok(&["start-node", "3"]);
    cluster.ok(&["wait", "600"]);
    // The sheet came after all tasks had ended well.
    assert!(scratch.path("farm/index.html").is_file(), "{}", logs(&scratch));
    let restarts =
        std::fs::read_to_string(cluster.state().join("slurmctld.log")).unwrap_or_default();
    assert!(restarts.contains("equeue"), "no task was requeued: the kills hit nothing\n{restarts}");
    same_pictures(&scratch, "farm");
}

fn logs(scratch: &Scratch) -> String {
    let mut text = String::new();
    for entry in std::fs::read_dir(scratch.path("farm/slurm")).into_iter().flatten().flatten() {
        text += &format!("\n{}:\n", entry.path().display());
        text += &std::fs::read_to_string(entry.path()).unwrap_or_default();
    }
    text
}

#[test]
fn the_openjd_template_is_valid_and_runs() {
    if !has("openjd") {
        return skipped(
            "the Open Job Description test: there is no openjd",
            "pip install openjd-cli",
        );
    }
    let template = root().join("farm/openjd-template.yaml");
    let checked = Done::of(Command::new("openjd").arg("check").arg(&template));
    assert_eq!(checked.code(), 0, "{}{}", checked.stdout(), checked.stderr());
    let scratch = scratch("32x24", 1);
    let parameter = |name: &str, value: &str| ["-p".to_string(), format!("{name}={value}")];
    let program = env!("CARGO_BIN_EXE_lightpath");
    let path = |name: &str| scratch.path(name).display().to_string();
    let mut command = Command::new("openjd");
    command.arg("run").arg(&template).args(["--step", "Sheet", "--run-dependencies"]);
    for (name, value) in [
        ("Job", path("job.json").as_str()),
        ("Output", path("farm").as_str()),
        ("Frames", "0-59"),
        ("FramesPerTask", "7"),
        ("Lightpath", program),
    ] {
        command.args(parameter(name, value));
    }
    let done = Done::of(command.env_remove("SLURM_CPUS_PER_TASK"));
    assert_eq!(done.code(), 0, "{}{}", done.stdout(), done.stderr());
    assert!(done.stdout().contains("openjd_progress: 100"), "{}", done.stdout());
    assert!(scratch.path("farm/index.html").is_file());
    same_pictures(&scratch, "farm");
}
