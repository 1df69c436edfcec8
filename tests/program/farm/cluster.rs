//! Real farm software: Slurm's own daemons with nodes that die, and Open Job Description's own
//! runner. Tests are skipped with a message if these are not installed.

use std::{
    net::TcpListener,
    path::{Path, PathBuf},
    process::Command,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
    time::{Duration, Instant},
};

use crate::support::program::{Done, PYRAMID, Scratch, names_in, send, skipped};

const FRAMES: usize = 60;

fn root() -> PathBuf {
    env!("CARGO_MANIFEST_DIR").into()
}

fn has(program: &str) -> bool {
    let found = Command::new("sh").args(["-c", "command -v \"$0\"", program]).output();
    found.is_ok_and(|output| output.status.success())
}

/// A job with a turntable of one mesh.
fn scratch(size: &str, spp: u32, frames: usize) -> Scratch {
    let scratch = Scratch::new();
    scratch.write("pyramid.ply", PYRAMID);
    let (width, height) = size.split_once('x').unwrap();
    let job = format!(
        r#"{{ "inputs": ["pyramid.ply"], "turntable": {{ "frames": {frames} }},
             "set": {{ "/spp": {spp}, "/camera/width": {width}, "/camera/height": {height} }} }}"#
    );
    scratch.write("job.json", &job);
    scratch
}

/// Returns all pictures of a folder, by name.
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
fn same_pictures(scratch: &Scratch, farm: &str, frames: usize) {
    // No frame is missing, and no partial file is left.
    let named = (0..frames).flat_map(|n| ["exr", "png"].map(|end| format!("pyramid.{n:04}.{end}")));
    let made = pictures(&scratch.path(farm).join("pyramid"));
    assert!(
        made.iter().map(|(name, _)| name.clone()).eq(named),
        "{:?}",
        names_in(&scratch.path(farm))
    );
    // Uses the same path to the job, because a picture's header contains paths of the scene.
    let job = scratch.path("job.json").display().to_string();
    // Every file has the bytes that its journal knows.
    let done = scratch.run(&["batch", &job, "-o", farm, "--resume", "--no-sheet"]).good();
    let kept = format!("0 frames rendered, {frames} kept");
    assert!(done.stderr().contains(&kept), "{}", done.stderr());
    // Those that were rendered about when the nodes died have the bytes of one machine.
    let end = frames.min(20);
    let count = end.min(8);
    let range = format!("{}..{end}", end - count);
    scratch.run(&["batch", &job, "-o", "one", "--range", &range, "--no-sheet", "--quiet"]).good();
    let one = pictures(&scratch.path("one/pyramid"));
    assert_eq!(one.len(), 2 * count, "{range}");
    assert!(one.iter().all(|picture| made.contains(picture)), "a picture differs");
}

/// A cluster that ends with the test.
struct Cluster {
    folder: tempfile::TempDir,
    port: u32,
}

impl Cluster {
    /// Starts a cluster of `nodes` nodes with `cpus` processors each. Returns `None` with a message
    /// if there is no Slurm.
    fn up(nodes: &str, cpus: &str) -> Option<Self> {
        static CLUSTERS: AtomicU32 = AtomicU32::new(0);
        let programs = ["slurmctld", "slurmd", "sbatch", "munged", "unshare", "nsenter"];
        if let Some(missing) = programs.into_iter().find(|program| !has(program)) {
            skipped(&format!(
                "a test with Slurm: there is no {missing}; \
                 apt-get install slurmctld slurmd slurm-client munge"
            ));
            return None;
        }
        let is_root = Command::new("id").arg("-u").output().is_ok_and(|o| o.stdout == b"0\n");
        if !is_root {
            skipped("a test with Slurm: not root; run the tests as root");
            return None;
        }
        // Other clusters may run on this machine: from other checkouts' tests, or from this
        // program. The ports lie below those that the system gives to others.
        let number = CLUSTERS.fetch_add(1, Relaxed);
        let places = (0..1_200).map(|k| (std::process::id() * 3 + number + 7 * k) % 1_200);
        let free = |port: &u32| {
            (*port..*port + 10).all(|port| TcpListener::bind(("0.0.0.0", port as u16)).is_ok())
        };
        let port = places.map(|place| 20_000 + 10 * place).find(free).unwrap();
        let cluster = Self { folder: tempfile::tempdir().unwrap(), port };
        cluster.ok(&["up", nodes, cpus]);
        Some(cluster)
    }

    /// Submits `job` in tasks of one processor.
    #[track_caller]
    fn submit(&self, scratch: &Scratch, job: &str, folder: &str, per_task: &str) {
        let args = ["submit", "slurm", job, "-o", folder, "--frames-per-task", per_task];
        let args = [&args[..], &["--cpus", "1", "--memory", "200M"]].concat();
        let mut command = scratch.command(&args);
        let done = Done::of(command.env("SLURM_CONF", self.state().join("slurm.conf")));
        assert_eq!(done.code(), 0, "{}", done.stderr());
    }

    fn run(&self, args: &[&str]) -> Done {
        let mut command = Command::new(root().join("scripts/slurm_cluster.sh"));
        let port = self.port.to_string();
        command.env("SLURM_CLUSTER", self.state()).env("SLURM_CLUSTER_PORT", port);
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
    let Some(cluster) = Cluster::up("3", "2") else { return };
    let scratch = scratch("160x120", 120, FRAMES);
    cluster.submit(&scratch, "job.json", "farm", "2");
    let finished = || {
        let names = std::fs::read_dir(scratch.path("farm/pyramid")).into_iter().flatten();
        let names = names.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
        names.filter(|name| name.ends_with(".png")).count()
    };
    // In mid-run, one node dies with its tasks; on another only the daemon dies.
    cluster.wait_for("no frame is finished", 300, || finished() >= 8);
    // Tasks that have just begun are still running when the node dies.
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
    // The sheet was written after all tasks had ended successfully.
    assert!(scratch.path("farm/index.html").is_file(), "{}", logs(&scratch, "farm"));
    let restarts =
        std::fs::read_to_string(cluster.state().join("slurmctld.log")).unwrap_or_default();
    assert!(restarts.contains("equeue"), "no task was requeued: the kills hit nothing\n{restarts}");
    same_pictures(&scratch, "farm", FRAMES);
}

/// Returns the processes of this program and of its tasks' shells that Slurm runs, for one task.
fn processes_of(cluster: &Cluster, task: u32) -> Vec<(u32, String)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").unwrap().flatten() {
        let Ok(pid) = entry.file_name().to_string_lossy().parse::<u32>() else { continue };
        let environment = std::fs::read(entry.path().join("environ")).unwrap_or_default();
        let has = |text: String| environment.split(|&b| b == 0).any(|v| v == text.as_bytes());
        let ours = has(format!("SLURM_CONF={}", cluster.state().join("slurm.conf").display()))
            && has(format!("SLURM_ARRAY_TASK_ID={task}"));
        let name = std::fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
        // slurmstepd belongs to Slurm.
        if ours && ["lightpath", "slurm_script", "bash"].contains(&name.trim()) {
            found.push((pid, name.trim().to_string()));
        }
    }
    found
}

/// Simulates the kernel when memory runs out: it kills the program first, and with control groups
/// the whole task with its shell.
#[test]
fn a_task_out_of_memory_runs_again_and_the_sheet_lists_missing_frames() {
    let Some(cluster) = Cluster::up("1", "2") else { return };
    let frames = 4;
    let scratch = scratch("320x240", 64, frames);
    cluster.submit(&scratch, "job.json", "farm", "1");
    let kill = |process: u32| send("KILL", process);
    let running = |task: u32, name: &str| {
        let all = processes_of(&cluster, task);
        all.into_iter().find(|(_, known)| known == name).map(|(pid, _)| pid)
    };
    let first = std::cell::Cell::new(None);
    cluster.wait_for("task 0 does not begin", 120, || {
        first.set(running(0, "lightpath"));
        first.get().is_some()
    });
    kill(first.get().unwrap());
    cluster.wait_for("task 3 does not begin", 120, || running(3, "lightpath").is_some());
    let shells = processes_of(&cluster, 3);
    // The shell first: it must not notice that its child dies.
    for (pid, _) in shells.iter().filter(|(_, name)| name != "lightpath") {
        kill(*pid);
    }
    for (pid, _) in shells.iter().filter(|(_, name)| name == "lightpath") {
        kill(*pid);
    }
    cluster.ok(&["wait", "300"]);
    let there =
        |frame: u32| scratch.path(&format!("farm/pyramid/pyramid.{frame:04}.exr")).is_file();
    // The first task was retried. Slurm knows nothing of the last one but its end.
    assert_eq!([0, 1, 2, 3].map(there), [true, true, true, false], "{}", logs(&scratch, "farm"));
    let page = String::from_utf8(scratch.read("farm/index.html")).unwrap();
    assert!(page.contains("3 of 4 frames"), "{page}");
    let said = logs(&scratch, "farm");
    assert!(said.contains("pyramid.ply: frame 3 is missing"), "{said}");
    let ended = cluster.slurm("scontrol", &["show", "job", "-o"]);
    let sheet = ended.lines().find(|line| line.contains("-sheet ")).unwrap_or_default();
    assert!(sheet.contains("JobState=FAILED") && sheet.contains("ExitCode=1:0"), "{ended}");
    // A second submission renders only the missing frame.
    cluster.submit(&scratch, "job.json", "farm", "1");
    cluster.ok(&["wait", "300"]);
    same_pictures(&scratch, "farm", frames);
}

#[test]
fn names_reach_slurm_unchanged() {
    let Some(cluster) = Cluster::up("1", "2") else { return };
    let scratch = scratch("16x12", 1, 4);
    for folder in
        ["a b", "$(touch pwned)`touch pwned`", "it's \"x\" #y; touch pwned", "%j %A_%a 100%% %"]
    {
        std::fs::create_dir(scratch.path(folder)).unwrap();
        for file in ["job.json", "pyramid.ply"] {
            std::fs::copy(scratch.path(file), scratch.path(folder).join(file)).unwrap();
        }
        let (job, farm) = (format!("./{folder}/job.json"), format!("./{folder}/farm"));
        cluster.submit(&scratch, &job, &farm, "2");
        cluster.ok(&["wait", "120"]);
        let log = names_in(&scratch.path(&farm).join("slurm"));
        let logs = log.iter().filter(|name| name.ends_with(".log")).count();
        assert_eq!(logs, 3, "{folder}: {log:?}");
        assert!(scratch.path(&farm).join("index.html").is_file(), "{folder}: {log:?}");
        assert_eq!(pictures(&scratch.path(&farm).join("pyramid")).len(), 8, "{folder}");
    }
    let names = scratch.names();
    assert!(!names.contains(&"pwned".to_string()) && names.len() == 6, "{names:?}");
}

fn logs(scratch: &Scratch, farm: &str) -> String {
    let mut text = String::new();
    for entry in std::fs::read_dir(scratch.path(farm).join("slurm")).into_iter().flatten().flatten()
    {
        text += &format!("\n{}:\n", entry.path().display());
        text += &std::fs::read_to_string(entry.path()).unwrap_or_default();
    }
    text
}

#[test]
fn the_openjd_template_is_valid_and_runs() {
    if !has("openjd") {
        return skipped(
            "the Open Job Description test: there is no openjd; pip install openjd-cli",
        );
    }
    let template = root().join("farm/openjd-template.yaml");
    let checked = Done::of(Command::new("openjd").arg("check").arg(&template));
    assert_eq!(checked.code(), 0, "{}{}", checked.stdout(), checked.stderr());
    let scratch = scratch("32x24", 1, FRAMES);
    let path = |name: &str| scratch.path(name).display().to_string();
    let done = openjd("Sheet", &path("job.json"), &path("farm"), "0-59", "7");
    assert_eq!(done.code(), 0, "{}{}", done.stdout(), done.stderr());
    assert!(done.stdout().contains("openjd_progress: 100"), "{}", done.stdout());
    assert!(scratch.path("farm/index.html").is_file());
    same_pictures(&scratch, "farm", FRAMES);
    // Names stay literal, whatever a shell would make of them.
    for folder in ["$(touch pwned)", "`touch pwned`", "\"; touch pwned; \"", "it's # & | *"] {
        std::fs::create_dir(scratch.path(folder)).unwrap();
        for file in ["job.json", "pyramid.ply"] {
            std::fs::copy(scratch.path(file), scratch.path(folder).join(file)).unwrap();
        }
        let farm = format!("{folder}/farm");
        let job = path(&format!("{folder}/job.json"));
        let done = openjd("Frames", &job, &path(&farm), "0-3", "2");
        assert_eq!(done.code(), 0, "{folder}: {}{}", done.stdout(), done.stderr());
        let made = names_in(&scratch.path(&farm).join("pyramid"));
        assert_eq!(made.len(), 8, "{folder}: {made:?}: {}", done.stdout());
        let done = openjd("Sheet", &job, &path(&farm), "4-59", "20");
        assert_eq!(done.code(), 0, "{folder}: {}{}", done.stdout(), done.stderr());
        same_names(&scratch.path("farm/pyramid"), &scratch.path(&farm).join("pyramid"));
    }
    let names = scratch.names();
    assert!(!names.contains(&"pwned".to_string()), "{names:?}");
    assert!(!Path::new("pwned").exists());
}

/// Runs a step and its dependencies with `openjd run`.
fn openjd(step: &str, job: &str, output: &str, frames: &str, per_task: &str) -> Done {
    let mut command = Command::new("openjd");
    command.arg("run").arg(root().join("farm/openjd-template.yaml"));
    command.args(["--step", step, "--run-dependencies"]);
    for (name, value) in [
        ("Job", job),
        ("Output", output),
        ("Frames", frames),
        ("FramesPerTask", per_task),
        ("Lightpath", env!("CARGO_BIN_EXE_lightpath")),
    ] {
        command.args(["-p".to_string(), format!("{name}={value}")]);
    }
    Done::of(command.env_remove("SLURM_CPUS_PER_TASK"))
}

/// Asserts that both folders have the same names.
#[track_caller]
fn same_names(one: &Path, other: &Path) {
    assert_eq!(names_in(one), names_in(other));
}
