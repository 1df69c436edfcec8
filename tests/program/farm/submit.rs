//! `lightpath submit slurm`: arguments of `sbatch` for any names. `cluster.rs` runs them.

use std::process::Command;

use crate::support::program::{self, PYRAMID, Scratch};

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

/// Returns the commands that a dry run prints.
fn commands(said: &str) -> Vec<&str> {
    said.lines().filter(|line| line.starts_with("sbatch ")).collect()
}

#[test]
fn scripts_distribute_every_frame() {
    let scratch = scratch(24);
    let flags = ["--frames-per-task", "8", "--cpus", "4", "--memory", "3G", "--time", "1:00:00"];
    let done = submit(
        &scratch,
        &[&flags[..], &["--sbatch=--partition=long", "--at-a-time", "5"]].concat(),
    );
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let said = done.stdout();
    let [frames, sheet] = [commands(&said)[0], commands(&said)[1]];
    let shared = ["--cpus-per-task=4", "--mem=3072M", "--time=1:00:00", "--partition=long"];
    for option in shared.into_iter().chain(["--array=0-8%5", "--requeue"]) {
        assert!(frames.replace('\'', "").contains(&format!(" {option} ")), "{option}: {said}");
    }
    assert!(frames.ends_with(" 72 8"), "{said}");
    assert!(sheet.contains(" --dependency=afterany:ID "), "{said}");
    // Bash can parse both scripts.
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
    // Six frames would take ten minutes, and six divides a mesh.
    assert!(done.stderr().contains("12 tasks of 6 frames"), "{}", done.stderr());
    let said = done.stdout();
    let memory = said.split(' ').find_map(|word| word.strip_prefix("--mem=")).unwrap();
    let mib: u64 = memory.trim_end_matches('M').parse().unwrap();
    assert!((60..2000).contains(&mib), "{mib} MiB");
    let done = submit(&scratch, &[]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
}

/// A task obeys the limits of its job, so its memory covers them.
#[test]
fn the_memory_of_a_task_covers_the_limit_of_the_job() {
    let scratch = scratch(2);
    let job = |limits: &str| {
        scratch.write("job.json", &format!(r#"{{ "inputs": ["*.ply"], "limits": {limits} }}"#));
    };
    job(r#"{ "memory": "8G", "jobs": 4 }"#);
    let memory = |flags: &[&str]| {
        let said = submit(&scratch, flags).good().stdout();
        said.split(' ').find_map(|word| word.strip_prefix("--mem=").map(str::to_owned)).unwrap()
    };
    assert_eq!(memory(&[]), "10240M");
    assert_eq!(memory(&["--memory", "9G"]), "9216M");
    for (limits, flags, message) in [
        (r#"{ "memory": "8G" }"#, &["--memory", "1G"][..], "--memory: found 1.0 GiB, expected at"),
        (r#"{ "memory": "lots" }"#, &[], "(/limits/memory): found \"lots\""),
    ] {
        job(limits);
        let done = submit(&scratch, flags);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        assert!(done.stderr().contains(message), "{}", done.stderr());
    }
}

#[test]
fn frames_of_a_preview_say_nothing_about_the_time() {
    let scratch = scratch(24);
    let journal = |primary: u32, name: &str| {
        let frame = serde_json::json!({
            "event": "frame", "index": 0, "input": "a.ply", "frame": 0, "outputs": [],
            "render_s": 300.0, "write_s": 0.0, "rays": { "primary": primary }, "peak_bytes": 1,
            "warnings": [],
        });
        scratch.write(&format!("out/{name}"), &format!("{frame}\n"));
    };
    let set = r#"{ "inputs": ["*.ply"], "turntable": { "frames": 24 }, "size": [96, 54],
                   "set": { "/spp": 2 } }"#;
    scratch.write("job.json", set);
    // Frames of five minutes: tasks of two. Journals of ranges count, too.
    journal(96 * 54 * 2, "batch.0-5.jsonl");
    let said = submit(&scratch, &[]).good().stderr();
    assert!(said.contains("36 tasks of 2 frames"), "{said}");
    journal(48 * 27, "batch.0-5.jsonl");
    let said = submit(&scratch, &[]).good().stderr();
    assert!(said.contains("1 task of 72 frames"), "{said}");
    // What `render` traces of 27 x 27 pixels: packets of 4 x 4 of the overscan are whole.
    journal(35 * 35, "batch.0-5.jsonl");
    scratch.write(
        "job.json",
        r#"{ "inputs": ["*.ply"], "turntable": { "frames": 24 }, "size": [23, 23], "overscan": 2,
             "set": { "/spp": 1 } }"#,
    );
    let said = submit(&scratch, &[]).good().stderr();
    assert!(said.contains("36 tasks of 2 frames"), "{said}");
}

#[test]
fn time_and_memory_below_the_plan_are_told() {
    let scratch = scratch(24);
    let told = |flags: &[&str]| submit(&scratch, flags).good().stderr();
    let plan = ["--frame-seconds", "100", "--minutes", "10"];
    let said = told(&[&plan[..], &["--time", "0:05:00"]].concat());
    assert!(said.contains("warning: --time: a task takes about 10"), "{said}");
    let said = told(&[&plan[..], &["--time", "1:00:00", "--memory", "10M"]].concat());
    assert!(said.contains("warning: --memory: the largest input needs about"), "{said}");
    let said = told(&[&plan[..], &["--time", "1:00:00", "--memory", "4G"]].concat());
    assert!(!said.contains("warning"), "{said}");
}

/// Runs the script of a task in the template of Open Job Description with a program that ends with
/// each exit code.
#[test]
fn bad_inputs_do_not_fail_the_task_of_open_job_description() {
    let template = include_str!("../../../farm/openjd-template.yaml");
    let script = template.split("data: |\n").nth(1).unwrap();
    let script: Vec<&str> = script.lines().take_while(|line| line.starts_with("    ")).collect();
    let scratch = Scratch::new();
    scratch.write("run.sh", &script.join("\n"));
    for (ended, expected) in [(0, 0), (1, 0), (2, 2), (3, 3), (137, 137)] {
        scratch.write("program", &format!("#!/bin/sh\necho \"$@\"\nexit {ended}\n"));
        let program = scratch.path("program");
        assert!(Command::new("chmod").arg("+x").arg(&program).status().unwrap().success());
        let mut bash = Command::new("bash");
        bash.arg(scratch.path("run.sh")).arg("4-7").arg(program).args(["job.json", "out dir"]);
        let done = program::Done::of(&mut bash);
        assert_eq!(done.code(), expected, "{ended}: {}", done.stderr());
        let said = "batch job.json -o out dir --range 4..8 --resume --progress openjd\n";
        assert_eq!(done.stdout(), said);
    }
    // The last step renders nothing.
    let sheet = template.split("- name: Sheet").nth(1).unwrap();
    assert!(sheet.contains("--sheet-only") && !sheet.contains("--resume"), "{sheet}");
}

/// Runs the script of a task with a program that ends with each exit code, and a Slurm that prints
/// what it is asked for.
#[test]
fn a_task_runs_again_only_where_another_try_may_help() {
    let scratch = scratch(1);
    submit(&scratch, &[]).good();
    scratch.write("bin/program", "#!/bin/sh\nexit \"$ENDED\"\n");
    scratch.write("bin/scontrol", "#!/bin/sh\necho \"$@\" >&2\n");
    scratch.write("bin/sleep", "#!/bin/sh\n");
    let bin = scratch.path("bin");
    assert!(Command::new("chmod").args(["-R", "+x"]).arg(&bin).status().unwrap().success());
    let path = format!("{}:{}", bin.display(), std::env::var("PATH").unwrap());
    let task = |ended: i32, restarts: &str| {
        let mut bash = Command::new("bash");
        bash.arg(scratch.path("out/slurm/frames.sh")).arg(bin.join("program"));
        bash.args(["job.json", "out", "100", "8"]).env("PATH", &path);
        bash.env("SLURM_ARRAY_JOB_ID", "77").env("SLURM_ARRAY_TASK_ID", "4");
        bash.env("SLURM_RESTART_COUNT", restarts).env("ENDED", ended.to_string());
        let done = program::Done::of(bash.env_remove("SLURM_CPUS_PER_TASK"));
        (done.code(), done.stderr())
    };
    let asked = |said: &str| said.to_string();
    for (ended, code) in [(0, 0), (1, 0), (2, 2)] {
        assert_eq!(task(ended, "0"), (code, asked("")), "{ended}");
    }
    for ended in [3, 129, 130, 131, 137, 143, 152] {
        assert_eq!(task(ended, "2"), (ended, asked("requeue 77_4\n")), "{ended}");
    }
    assert_eq!(task(3, ""), (3, asked("requeue 77_4\n")), "a first try");
    assert_eq!(task(3, "3"), (3, asked("")), "three more tries are enough");
}

#[test]
fn a_task_has_a_thread_per_processor() {
    let scratch = scratch(1);
    scratch.write("program", "#!/bin/sh\necho \"$@\"\n");
    let program = scratch.path("program");
    let made = std::process::Command::new("chmod").arg("+x").arg(&program).status().unwrap();
    assert!(made.success());
    submit(&scratch, &[]).good();
    for script in ["frames.sh", "sheet.sh"] {
        let run = |cpus: Option<&str>| {
            let mut bash = std::process::Command::new("bash");
            bash.arg(scratch.path("out/slurm").join(script)).arg(&program);
            bash.args(["job.json", "out", "4", "2"]).env("SLURM_ARRAY_TASK_ID", "0");
            match cpus {
                Some(cpus) => bash.env("SLURM_CPUS_PER_TASK", cpus),
                None => bash.env_remove("SLURM_CPUS_PER_TASK"),
            };
            program::Done::of(&mut bash).good().stdout()
        };
        assert!(run(Some("3")).ends_with(" --threads 3\n"), "{script}");
        assert!(!run(None).contains("--threads"), "{script}");
    }
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
        (&["slurm", "job.json", "--time", "blah"], "--time: found \"blah\", expected MINUTES"),
        (&["slurm", "job.json", "--time", "1"], "expected more than a minute"),
        (&["pbs", "job.json"], "pbs"),
    ];
    for (args, text) in cases {
        let done = scratch.run(&[&["submit"], *args, &["--dry-run"]].concat());
        assert_eq!(done.code(), 2, "{args:?}: {}", done.stderr());
        assert!(done.stderr().contains(text), "{args:?}: {}", done.stderr());
    }
}

/// Whoever can change the folder could replace a script between its writing and `sbatch`.
#[test]
fn a_folder_of_scripts_that_others_can_change_is_refused() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = scratch(2);
    submit(&scratch, &[]).good();
    let folder = scratch.path("out/slurm");
    let mode = std::fs::metadata(&folder).unwrap().permissions().mode();
    assert_eq!(mode & 0o022, 0);
    let refused = || {
        let done = submit(&scratch, &[]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        let said = done.stderr();
        assert!(said.contains("out/slurm: found a folder that others can change"), "{said}");
        assert!(commands(&done.stdout()).is_empty());
    };
    std::fs::set_permissions(&folder, PermissionsExt::from_mode(0o777)).unwrap();
    refused();
    std::fs::remove_dir_all(&folder).unwrap();
    std::os::unix::fs::symlink("../elsewhere", &folder).unwrap();
    std::fs::create_dir(scratch.path("elsewhere")).unwrap();
    refused();
    assert!(scratch.path("elsewhere").read_dir().unwrap().next().is_none());
    std::fs::remove_file(&folder).unwrap();
    let out = scratch.path("out");
    let set_mode = |mode| std::fs::set_permissions(&out, PermissionsExt::from_mode(mode)).unwrap();
    set_mode(0o777);
    let done = submit(&scratch, &[]);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    let message = "out: found a folder that others can change (mode 777), expected one of your own";
    assert!(done.stderr().contains(message), "{}", done.stderr());
    // In a sticky folder, others cannot rename what is in it.
    set_mode(0o1777);
    submit(&scratch, &[]).good();
    // Scripts that all could write were there before.
    let script = folder.join("frames.sh");
    std::fs::set_permissions(&script, PermissionsExt::from_mode(0o666)).unwrap();
    submit(&scratch, &[]).good();
    assert_eq!(std::fs::metadata(&script).unwrap().permissions().mode() & 0o022, 0);
}

/// In a folder of all, somebody else may change the scripts at any time. `sbatch` does not read
/// them there.
#[test]
fn scripts_that_others_change_are_not_submitted() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = scratch(2);
    std::fs::create_dir_all(scratch.path("out/slurm")).unwrap();
    let text = "#!/bin/bash\nfor name in frames sheet; do echo changed >out/slurm/$name.sh; done\n\
                cat >>submitted\necho 7\n";
    scratch.write("bin/sbatch", text);
    for (path, mode) in [("bin/sbatch", 0o755), ("out", 0o777), ("out/slurm", 0o777)] {
        let path = scratch.path(path);
        std::fs::set_permissions(path, PermissionsExt::from_mode(mode)).unwrap();
    }
    let mut command = scratch.command(&["submit", "slurm", "job.json", "-o", "out"]);
    let path = format!("{}:/usr/bin:/bin", scratch.path("bin").display());
    let said = program::Done::of(command.env("PATH", path)).good().stdout();
    assert!(said.ends_with("\n7\n7\n"), "{said}");
    let scripts = ["frames", "sheet"].map(|name| {
        let path = format!("{}/farm/slurm-{name}.sh", env!("CARGO_MANIFEST_DIR"));
        std::fs::read_to_string(path).unwrap()
    });
    let submitted = String::from_utf8(scratch.read("submitted")).unwrap();
    let (arguments, rest): (Vec<_>, Vec<_>) =
        submitted.split_inclusive('\n').partition(|line| line.starts_with("set -- "));
    assert_eq!(rest.concat(), scripts.concat());
    assert!(arguments.iter().all(|line| line.contains("/job.json ")), "{arguments:?}");
    assert_eq!(arguments.len(), 2);
}

#[test]
fn a_missing_slurm_is_reported() {
    let scratch = scratch(2);
    let mut command = scratch.command(&["submit", "slurm", "job.json", "-o", "out"]);
    let done = program::Done::of(command.env("PATH", "/nowhere"));
    assert_eq!(done.code(), 2);
    assert!(done.stderr().contains("cannot run sbatch"), "{}", done.stderr());
}

/// Names with a meaning for a shell, for `#SBATCH` lines or for Slurm's own file names.
const HOSTILE: [&str; 8] = [
    "$(touch pwned)",
    "`touch pwned`",
    "a; touch pwned;",
    "it's \"quoted\" #x",
    "100%j %A_%a %%",
    "$HOME ~ * ? [a-z] {a,b}",
    "& | < > ( ) ! =",
    " -o x ",
];

/// Makes a folder with an `sbatch` that runs its script at once, as task 0 of an array.
fn slurm_of_one_task(scratch: &Scratch) -> std::ffi::OsString {
    use std::os::unix::fs::PermissionsExt;
    let text = "#!/bin/bash\nwhile [[ $1 == -* ]]; do shift; done\n\
                SLURM_ARRAY_JOB_ID=1 SLURM_ARRAY_TASK_ID=0 bash \"$@\" >&2 && echo 1\n";
    scratch.write("bin/sbatch", text);
    let executable = std::fs::Permissions::from_mode(0o755);
    std::fs::set_permissions(scratch.path("bin/sbatch"), executable).unwrap();
    let mut path = scratch.path("bin").into_os_string();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap_or_default());
    path
}

#[test]
fn names_are_never_run() {
    let scratch = scratch(1);
    let job = r#"{ "inputs": ["*.ply"], "size": [16, 12],
                   "set": { "/spp": 1 } }"#;
    scratch.write("job.json", job);
    let path = slurm_of_one_task(&scratch);
    for name in HOSTILE {
        std::fs::create_dir(scratch.path(name)).unwrap();
        for file in ["job.json", "a.ply", "b.ply", "c.ply"] {
            std::fs::copy(scratch.path(file), scratch.path(name).join(file)).unwrap();
        }
        let (job, out) = (format!("./{name}/job.json"), format!("./{name}/$(touch pwned)"));
        let mut dry = scratch.command(&["submit", "slurm", &job, "-o", &out, "--dry-run"]);
        let dry = program::Done::of(dry.env("PATH", &path));
        assert_eq!(dry.code(), 0, "{name}: {}", dry.stderr());
        // Runs the printed commands in a shell, as a user would paste them.
        let commands = format!("set -e\n{}", commands(&dry.stdout()).join("\n"));
        let mut shell = std::process::Command::new("bash");
        shell.current_dir(scratch.path("")).args(["-c", &commands]).env("PATH", &path);
        let ran = program::Done::of(&mut shell);
        assert_eq!(ran.code(), 0, "{name}: {commands}{}", ran.stderr());
        assert_eq!(ran.stdout(), "1\n1\n", "{name}: {commands}");
        for file in ["a.exr", "b.exr", "c.exr", "index.html"] {
            assert!(scratch.path(&out).join(file).is_file(), "{name}: {file}: {}", ran.stderr());
        }
        std::fs::remove_dir_all(scratch.path(&out)).unwrap();
        let mut real = scratch.command(&["submit", "slurm", &job, "-o", &out]);
        let real = program::Done::of(real.env("PATH", &path));
        assert_eq!(real.code(), 0, "{name}: {}", real.stderr());
        assert!(scratch.path(&out).join("index.html").is_file(), "{name}: {}", real.stderr());
    }
    let mut expected = vec!["a.ply", "b.ply", "bin", "c.ply", "job.json"];
    expected.extend(HOSTILE);
    expected.sort_unstable();
    assert_eq!(scratch.names(), expected);
}

#[test]
fn any_name_reaches_the_task_unchanged() {
    use proptest::{
        prelude::*,
        test_runner::{Config, TestRng, TestRunner},
    };
    let scratch = scratch(1);
    let path = slurm_of_one_task(&scratch);
    // Replaces the task by a program that prints its arguments.
    scratch.write("bin/sbatch", "#!/bin/bash\nprintf '%s\\n' \"$@\" >&2\n");
    let name = "[ -\\[\\]-~\u{e9}\u{20ac}]{1,12}";
    let config = Config { cases: 48, failure_persistence: None, ..Config::default() };
    let random = TestRng::deterministic_rng(config.rng_algorithm);
    let mut runner = TestRunner::new_with_rng(config, random);
    let ran = runner.run(&name.prop_filter("a path", |name| !name.contains('/')), |name| {
        let out = scratch.path("").join(format!("x{name}x"));
        let out = out.to_str().unwrap();
        let mut dry = scratch.command(&["submit", "slurm", "job.json", "-o", out, "--dry-run"]);
        let dry = program::Done::of(dry.env("PATH", &path));
        prop_assert_eq!(dry.code(), 0, "{}", dry.stderr());
        let said = dry.stdout();
        let mut shell = std::process::Command::new("bash");
        let shell = shell.args(["-c", &commands(&said).join("\n")]).env("PATH", &path);
        let words = program::Done::of(shell).stderr();
        let log = format!("--output={}/slurm/%A_%a.log", out.replace('%', "%%"));
        for word in [out, &format!("{out}/slurm/frames.sh"), &format!("{out}/slurm/sheet.sh"), &log]
        {
            prop_assert!(words.lines().any(|found| found == word), "{word:?} is not in\n{words}");
        }
        Ok(())
    });
    ran.unwrap();
}

#[test]
fn a_word_that_is_no_option_of_sbatch_is_refused() {
    let scratch = scratch(1);
    for word in ["--sbatch=partition", "--sbatch=", "--sbatch=-"] {
        let done = scratch.run(&["submit", "slurm", "job.json", word, "--dry-run"]);
        assert_eq!(done.code(), 2, "{}", done.stderr());
        assert!(done.stderr().contains("expected an option of sbatch"), "{}", done.stderr());
    }
    // A word may be the value of the option before it, if that has none.
    let run = |words: &[&str]| submit(&scratch, words);
    let said = run(&["--sbatch=-p", "--sbatch=cpu"]).good().stdout();
    assert!(commands(&said).iter().all(|command| command.contains(" -p cpu ")), "{said}");
    for words in [["--sbatch=--partition=cpu", "--sbatch=x"], ["--sbatch=x", "--sbatch=-p"]] {
        assert_eq!(run(&words).code(), 2, "{words:?}");
    }
    assert_eq!(run(&["--sbatch=-p", "--sbatch=cpu", "--sbatch=x"]).code(), 2);
    // Options that take no value, or have theirs in the same word.
    for first in ["--exclusive", "--hold", "-pcpu", "-H", "-HQ", "-HQpcpu"] {
        let first = format!("--sbatch={first}");
        assert_eq!(run(&[&first, "--sbatch=x"]).code(), 2, "{first}");
        assert_eq!(run(&[&first]).code(), 0, "{first}");
    }
    for first in ["-Hp", "--partition", "--exclude"] {
        let first = format!("--sbatch={first}");
        assert_eq!(run(&[&first, "--sbatch=x"]).code(), 0, "{first}");
        // Without its value, it would take the script.
        let done = run(&[&first]);
        let said = done.stderr();
        assert!(done.code() == 2 && said.contains("expected a value after it"), "{said}");
    }
    for word in ["--", "--array=0-3", "--arr=0-3", "-a0-3", "-Ha0-3", "-a"] {
        assert_eq!(run(&[&format!("--sbatch={word}")]).code(), 2, "{word}");
    }
    // A value may look like them.
    for value in ["--", "-about", "--array"] {
        let done = run(&["--sbatch=--comment", &format!("--sbatch={value}")]);
        assert_eq!(done.code(), 0, "{value}: {}", done.stderr());
    }
    assert_eq!(run(&["--sbatch=--account=film", "--sbatch=-Afilm"]).code(), 0);
}

#[test]
fn the_sheet_waits_for_the_frames_whatever_these_wait_for() {
    let scratch = scratch(1);
    let said = submit(&scratch, &["--sbatch=--dependency=afterok:77"]).good().stdout();
    let [frames, sheet] = commands(&said).try_into().expect("two commands");
    // Of two equal options sbatch takes the last.
    let last = |command: &str| {
        let found = command.split(' ').rfind(|word| word.starts_with("--dependency="));
        found.expect("a dependency").to_string()
    };
    assert_eq!(last(frames), "--dependency=afterok:77", "{said}");
    assert!(last(sheet).starts_with("--dependency=afterany:"), "{said}");
}

#[test]
fn names_that_slurm_cannot_use_are_refused() {
    let scratch = scratch(1);
    let long = format!(r#"{{ "inputs": ["a.ply"], "output": {{ "name": "{:x>240}" }} }}"#, "");
    scratch.write("long.json", &long);
    let done = scratch.run(&["submit", "slurm", "long.json", "-o", "out", "--dry-run"]);
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("choose a shorter name"), "{}", done.stderr());
    assert!(!scratch.path("out").exists());
    for (name, said) in [
        ("a\nb", "a\\nb: found a control character"),
        ("a\u{1b}[2Jb", "found a control character"),
        ("a\\b", "found a backslash"),
    ] {
        let done = scratch.run(&["submit", "slurm", "job.json", "-o", name, "--dry-run"]);
        assert_eq!(done.code(), 2, "{name:?}: {}", done.stderr());
        assert!(done.stderr().contains(said), "{name:?}: {}", done.stderr());
        assert!(!scratch.path(name).exists(), "{name:?}");
        let folder = name.replace('\\', "\\\\").replace('\n', "\\n").replace('\u{1b}', "\\u001b");
        let job = format!(r#"{{ "inputs": ["*.ply"], "output": {{ "folder": "{folder}" }} }}"#);
        scratch.write("named.json", &job);
        let done = scratch.run(&["submit", "slurm", "named.json", "--dry-run"]);
        assert_eq!(done.code(), 2, "{name:?}: {}", done.stderr());
    }
}

/// A refusal by the controller needs a change. A controller that does not answer may answer later.
#[test]
fn a_controller_out_of_reach_is_worth_a_retry() {
    let scratch = scratch(2);
    let path = format!("{}:{}", scratch.path("bin").display(), std::env::var("PATH").unwrap());
    let failed = "sbatch: error: Batch job submission failed: ";
    let cases = [
        ("Unable to contact slurm controller (connect failure)", 3),
        ("Socket timed out on send/recv operation", 3),
        ("Invalid partition name specified", 2),
    ];
    for (said, code) in cases {
        scratch.write("bin/sbatch", &format!("#!/bin/sh\necho '{failed}{said}' >&2\nexit 1\n"));
        let program = scratch.path("bin/sbatch");
        let made = std::process::Command::new("chmod").arg("+x").arg(program).status().unwrap();
        assert!(made.success());
        let mut command = scratch.command(&["submit", "slurm", "job.json", "-o", "out"]);
        let done = program::Done::of(command.env("PATH", &path));
        assert_eq!(done.code(), code, "{}", done.stderr());
        assert!(done.stderr().contains(said), "{}", done.stderr());
    }
    // The frames are submitted, the sheet is not: to submit all again would render twice.
    let once =
        "#!/bin/sh\nif [ -e once ]; then echo refused >&2; exit 1; fi\ntouch once\necho 77\n";
    scratch.write("bin/sbatch", once);
    let mut command = scratch.command(&["submit", "slurm", "job.json", "-o", "out"]);
    let done = program::Done::of(command.env("PATH", &path));
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stdout().lines().any(|line| line == "77"), "{}", done.stdout());
    let help = "job 77 renders all frames; only the sheet is missing: sbatch ";
    assert!(done.stderr().contains(help), "{}", done.stderr());
    // A script that everybody may change is not named.
    std::fs::remove_file(scratch.path("once")).unwrap();
    let folder = scratch.path("out/slurm");
    std::fs::set_permissions(&folder, std::os::unix::fs::PermissionsExt::from_mode(0o777)).unwrap();
    let done = program::Done::of(command.env("PATH", &path));
    assert_eq!(done.code(), 2, "{}", done.stderr());
    assert!(done.stderr().contains("the sheet is missing: /"), "{}", done.stderr());
    assert!(done.stderr().contains("/out --sheet-only"), "{}", done.stderr());
}
