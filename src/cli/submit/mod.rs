//! `lightpath submit slurm`: submits a job file as an array job of `lightpath batch --range`, and a
//! second job for the contact sheet.

mod needs;
mod owner;

use std::fs::{self, DirBuilder, Permissions};
use std::io::Write;
use std::os::unix::fs::{DirBuilderExt, MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use clap::{Args, Subcommand, ValueHint};

use crate::batch::{self, Job, LimitKeys};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::farm::{self, Chunks, Slurm, Submission};
use crate::output::atomic::PartFile;
use crate::paths;
use crate::units::{self, parse_bytes};

use self::needs::{Needs, frame_seconds};
use self::owner::check_owner;
use super::{batch as batch_command, print, signals};

/// Arguments of `lightpath submit`.
#[derive(Debug, Args)]
pub struct SubmitArgs {
    #[command(subcommand)]
    pub engine: Engine,
}

/// The system that runs the tasks.
#[derive(Debug, Subcommand)]
pub enum Engine {
    /// Slurm: an array job, and a job for the contact sheet that waits for it
    Slurm(SlurmArgs),
}

/// Arguments of `lightpath submit slurm`.
#[derive(Debug, Args)]
pub struct SlurmArgs {
    /// The job file of `lightpath batch`
    #[arg(value_name = "JOB", value_hint = ValueHint::FilePath)]
    pub job: PathBuf,

    /// Output folder, visible to all nodes [default: the job's, else out]
    #[arg(short, long, value_name = "DIR", value_hint = ValueHint::DirPath)]
    pub output: Option<PathBuf>,

    /// Write the scripts and print the sbatch commands without running them
    #[arg(long)]
    pub dry_run: bool,

    /// Processors per task, and --threads of its renders
    #[arg(long, value_name = "N", default_value = "8", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub cpus: u16,

    /// Memory per task [default: 1.25 times the job's limit of memory, else 2.5 times the predicted
    /// need of the largest input]
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub memory: Option<u64>,

    /// Frames per task [default: as many as take --minutes]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub frames_per_task: Option<u64>,

    /// Target duration of a task
    #[arg(long, value_name = "MINUTES", default_value = "10", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    pub minutes: u16,

    /// Seconds per frame [default: measured from frames of this job in DIR, else estimated from the
    /// rays and triangles of the first input]
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub frame_seconds: Option<f64>,

    /// Maximum number of tasks in the array; Slurm's own limit is MaxArraySize - 1
    #[arg(long, value_name = "N", default_value = "1000", value_parser = clap::value_parser!(u32).range(1..=4_000_000))]
    pub max_tasks: u32,

    /// Maximum number of tasks that run at a time
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub at_a_time: Option<u32>,

    /// Time limit per task, in Slurm's format: 4:00:00
    #[arg(long, value_name = "TIME")]
    pub time: Option<String>,

    /// Additional options of sbatch, repeatable: --sbatch=--partition=cpu
    #[arg(long, value_name = "OPTION", allow_hyphen_values = true)]
    pub sbatch: Vec<String>,
}

/// Parses a positive number of seconds.
fn parse_seconds(text: &str) -> std::result::Result<f64, String> {
    let seconds = text.parse().ok().filter(|s: &f64| *s > 0.0 && s.is_finite());
    seconds.ok_or_else(|| "expected seconds above 0, for example 2.5".to_string())
}

/// Writes the scripts, and submits them unless `--dry-run` is given. `program` is the file that the
/// tasks run; `None` for the program of this process.
pub fn run(args: &SubmitArgs, program: Option<&Path>) -> Result<()> {
    let Engine::Slurm(args) = &args.engine;
    signals::end_at_once()?;
    let (job, limits) = load(args)?;
    batch::check_settings(&job)?;
    let program = self::program(program)?;
    let folder = job.folder.join("slurm");
    let scripts = [("frames.sh", farm::FRAMES_SCRIPT), ("sheet.sh", farm::SHEET_SCRIPT)]
        .map(|(name, text)| (folder.join(name), text));
    // Before any mesh is opened: opening a pipe waits for its writer.
    batch::refuse_files(&job, scripts.iter().map(|(path, _)| path.clone()))?;
    let tasks = batch::tasks(job.inputs.len(), job.frames(), None)?;
    batch::check_lengths(&job, &tasks)?;
    batch::refuse_photographs(&job, &tasks)?;
    batch::refuse_foreign_sheet(&job)?;
    let slurm = plan(args, &job, &limits, &program)?;
    let created = fs::create_dir_all(&job.folder)
        .and_then(|()| DirBuilder::new().recursive(true).mode(0o755).create(&folder));
    created.map_err(|error| Error::io(&folder, "create", &error))?;
    let mut written = Vec::new();
    for (path, text) in &scripts {
        let mut part = PartFile::create(path)?;
        part.fill_by(|file, _| {
            let failed = |error| Error::io(path, "write", &error);
            let data = file.metadata().map_err(failed)?;
            if args.dry_run {
                check_owner(&folder, &data)?;
            }
            file.write_all(text.as_bytes()).map_err(failed)?;
            let not_by_others = Permissions::from_mode(data.mode() & 0o755);
            file.set_permissions(not_by_others).map_err(failed)
        })?;
        written.push(part.commit()?.0);
    }
    let Chunks { frames, per_task } = slurm.chunks;
    print::note(&format!(
        "{} of {}: {} of {}, {} and {} each",
        units::plural(frames as usize, "frame"),
        units::plural(job.inputs.len(), "input"),
        units::plural(slurm.chunks.tasks() as usize, "task"),
        units::plural(per_task as usize, "frame"),
        units::plural(slurm.cpus as usize, "CPU"),
        units::bytes(slurm.memory_mib << 20),
    ));
    print::paths(&written)?;
    let real = folder.canonicalize().map_err(|error| Error::io(&folder, "read", &error))?;
    let script = |name: &str| paths::named(&real.join(name));
    if args.dry_run {
        let frames = slurm.frames().command(&script("frames.sh")?);
        let sheet = slurm.sheet("ID").command(&script("sheet.sh")?);
        return print::text(&format!("{frames}\n{sheet}\n"));
    }
    let array = submit(&slurm.frames())?;
    // Printed before the next step, which may fail.
    print::text(&format!("{array}\n"))?;
    let sheet = slurm.sheet(&array);
    let submitted = submit(&sheet).map_err(|error| {
        let path = script("sheet.sh").ok().filter(|path| {
            fs::metadata(path).is_ok_and(|data| check_owner(&folder, &data).is_ok())
        });
        let by_hand = match path {
            Some(path) => sheet.command(&path),
            None => {
                let words = ["batch", &slurm.job, "-o", &slurm.folder, "--sheet-only"];
                farm::command_line(&slurm.program, &words.map(str::to_string))
            }
        };
        error.help(format!("job {array} renders all frames; only the sheet is missing: {by_hand}"))
    })?;
    print::text(&format!("{submitted}\n"))
}

/// Loads the job and its limits as its tasks will load them.
fn load(args: &SlurmArgs) -> Result<(Job, LimitKeys)> {
    let found = fs::metadata(&args.job);
    found.map_err(|error| Error::io(&args.job, "read", &error))?;
    let job = batch_command::load_job_file(&args.job, args.output.as_deref())?;
    job.ok_or_else(|| {
        let message = "found no `inputs`, expected a job file of `lightpath batch`";
        Error::invalid(args.job.display().to_string(), message).help("lightpath schema job")
    })
}

/// Returns the file that the tasks run.
///
/// # Errors
/// If a file was named that does not exist.
fn program(named: Option<&Path>) -> Result<PathBuf> {
    match named {
        None => {
            std::env::current_exe().map_err(|error| Error::io("lightpath".as_ref(), "find", &error))
        }
        Some(file) if file.is_file() => Ok(file.to_owned()),
        Some(file) => {
            let message = "found no such file, expected the program `lightpath` for the tasks";
            Err(Error::invalid(file.display().to_string(), message)
                .help("run the `lightpath` that pip installed"))
        }
    }
}

fn plan(args: &SlurmArgs, job: &Job, limits: &LimitKeys, program: &Path) -> Result<Slurm> {
    let per_mesh = u64::from(job.frames());
    let frames = batch::index(job.frames(), job.inputs.len(), 0);
    let needs = Needs::of(job, args.cpus)?;
    let measured = || frame_seconds(batch::journal(&job.folder), per_mesh, &needs.camera_rays);
    let frame_seconds = args.frame_seconds.or_else(measured).unwrap_or(needs.frame_seconds);
    let chunks = match args.frames_per_task {
        Some(per_task) => Chunks { frames, per_task: per_task.min(frames) },
        None => {
            let seconds = 60.0 * f64::from(args.minutes);
            Chunks::new(frames, per_mesh, frame_seconds, seconds, u64::from(args.max_tasks))
        }
    };
    if chunks.tasks() > u64::from(args.max_tasks) {
        let message = format!(
            "found {}, which makes {} tasks, expected at most {}",
            chunks.per_task,
            chunks.tasks(),
            args.max_tasks
        );
        return Err(Error::invalid("--frames-per-task", message)
            .help("more frames a task, or --max-tasks if the cluster's MaxArraySize allows it"));
    }
    let options = args.sbatch.iter().map(|option| ("--sbatch", option));
    for (flag, option) in options.chain(args.time.iter().map(|time| ("--time", time))) {
        if option.contains(char::is_control) {
            return Err(Error::invalid(flag, "found a line break or another control character"));
        }
    }
    check_options(&args.sbatch)?;
    if let Some(time) = &args.time {
        check_time(time, chunks.per_task as f64 * frame_seconds)?;
    }
    if args.memory.is_some_and(|memory| memory < needs.peak) {
        print::note(&format!(
            "warning: --memory: the largest input needs about {}, and its task may be killed",
            units::bytes_rounded_up(needs.peak)
        ));
    }
    let folder = absolute(&job.folder)?;
    if folder.contains('\\') {
        let message = "found a backslash, expected a name that Slurm can write logs to";
        return Err(Error::invalid(folder, message).help("choose another folder: -o DIR"));
    }
    let stem = args.job.file_stem().unwrap_or_default().to_string_lossy();
    let safe = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    Ok(Slurm {
        name: format!("lightpath-{}", stem.chars().map(safe).collect::<String>()),
        program: absolute(program)?,
        job: absolute(&args.job)?,
        folder,
        chunks,
        at_a_time: args.at_a_time,
        cpus: args.cpus,
        memory_mib: memory(args, limits, needs.memory())?.div_ceil(1 << 20),
        time: args.time.clone(),
        options: args.sbatch.clone(),
    })
}

/// Options of sbatch whose next word is no value: they take none, or only one after `=`.
const FLAGS: &str = "consolidate-segments contiguous exclusive external get-user-env help hold \
    ignore-pbs nice no-kill no-requeue oom-kill-step overcommit oversubscribe parsable propagate \
    quiet reboot requeue resv-ports share spread-job spread-segments stepmgr test-only usage \
    use-min-nodes verbose version wait x11";
/// The same of one letter. Several may share a dash.
const SHORT_FLAGS: &str = "HOQVWhksuv";

/// Checks that sbatch finds its script behind `words`, the additional options.
///
/// # Errors
/// A word that it would take for the script: one without dashes that is not the value of the option
/// before it. `--`. Another array. A last option that would take what follows for its value.
fn check_options(words: &[String]) -> Result<()> {
    let refused = |word: &String, expected: &str| {
        let message = format!("found {word:?}, expected {expected}");
        Err(Error::invalid("--sbatch", message).help("for example --sbatch=--partition=cpu"))
    };
    let mut takes_value = false;
    for word in words {
        if std::mem::take(&mut takes_value) {
            continue;
        }
        let is_array;
        (takes_value, is_array) = match (word.strip_prefix("--"), word.strip_prefix('-')) {
            // Own options follow, which `--` would end.
            (Some(""), _) | (None, None | Some("")) => return refused(word, "an option of sbatch"),
            (Some(option), _) => {
                let name = option.split('=').next().unwrap_or_default();
                let has_value = option.contains('=') || FLAGS.split(' ').any(|flag| flag == name);
                // sbatch accepts the beginning of a name.
                (!has_value, name.len() > 1 && "array".starts_with(name))
            }
            (None, Some(letters)) => {
                let end = letters.find(|c| !SHORT_FLAGS.contains(c));
                // The rest of the word after such a letter is its value.
                (
                    end == letters.len().checked_sub(1),
                    end.is_some_and(|k| letters[k..].starts_with('a')),
                )
            }
        };
        if is_array {
            return refused(word, "another option: the tasks of the array are chunks of frames");
        }
    }
    match words.last() {
        Some(word) if takes_value => refused(word, "a value after it"),
        _ => Ok(()),
    }
}

/// Checks the time limit of a task, and warns if it is shorter than the task's `seconds` and the
/// minute that Slurm leaves for its end.
///
/// # Errors
/// A text that is no time of Slurm, or a time of at most that minute.
fn check_time(time: &str, seconds: f64) -> Result<()> {
    let refused = |expected: &str| {
        let message = format!("found {time:?}, expected {expected}");
        Err(Error::invalid("--time", message).help("hours, minutes and seconds: 4:00:00"))
    };
    match farm::time_limit(time) {
        None => refused(
            "MINUTES[:SECONDS], HOURS:MINUTES:SECONDS, DAYS-HOURS[:MINUTES[:SECONDS]] \
                         or UNLIMITED",
        ),
        Some(limit) if limit <= farm::SECONDS_TO_END => {
            refused("more than a minute: a task stops one minute before its time limit")
        }
        Some(limit) if limit < seconds + farm::SECONDS_TO_END => {
            print::note(&format!(
                "warning: --time: a task takes about {} and stops one minute before {time}",
                units::duration(seconds)
            ));
            Ok(())
        }
        Some(_) => Ok(()),
    }
}

/// Returns the memory per task in bytes: what the job's own limit lets it take, else `needed`.
///
/// # Errors
/// `--memory` below the job's limit; a limit that is no size.
fn memory(args: &SlurmArgs, limits: &LimitKeys, needed: u64) -> Result<u64> {
    let limit = batch_command::max_memory(limits, batch_command::MEMORY_KEY)?;
    match (args.memory, limit) {
        (Some(memory), Some(limit)) if memory < limit => {
            let message = format!(
                "found {}, expected at least {}: the tasks obey the job's limits/memory",
                units::bytes(memory),
                units::bytes_rounded_up(limit),
            );
            Err(Error::invalid("--memory", message).help("lower limits/memory, or remove it"))
        }
        (Some(memory), _) => Ok(memory),
        // A quarter is the reserve.
        (None, Some(limit)) => Ok(limit.saturating_add(limit / 4)),
        (None, None) => Ok(needed),
    }
}

/// Returns an absolute path as a command-line argument.
///
/// # Errors
/// A name that is not UTF-8 or contains a control character.
fn absolute(path: &Path) -> Result<String> {
    let path = std::path::absolute(path).map_err(|error| Error::io(path, "find", &error))?;
    paths::refuse_control_characters(&path)?;
    paths::named(&path)
}

/// Messages of sbatch if the controller does not answer (Slurm's `slurm_errno.c`). Submitting again
/// may then help.
const UNREACHABLE: [&str; 8] = [
    "Unable to contact slurm controller",
    "Communication connection failure",
    "Socket timed out on send/recv operation",
    "Zero Bytes were transmitted or received",
    "Slurm backup controller in standby mode",
    "Connection refused",
    "DNS SRV lookup failed",
    "Could not establish a configuration source",
];

/// Runs `sbatch`, which reads the script from its standard input: a file may be one that everybody
/// can replace.
fn sbatch(job: &Submission) -> std::io::Result<Output> {
    let mut command = Command::new("sbatch");
    command.args(&job.options).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn()?;
    if let Some(mut stdin) = child.stdin.take() {
        // An `sbatch` that ends without reading it says why.
        let _ = stdin.write_all(job.text().as_bytes());
    }
    child.wait_with_output()
}

/// Submits a job to Slurm and returns its id.
fn submit(job: &Submission) -> Result<String> {
    let output = sbatch(job).map_err(|error| {
        let message = format!("cannot run sbatch: {error}");
        Error::new(ErrorKind::Unsupported, Problem::new("slurm", message))
            .help("run this where Slurm is installed; --dry-run only writes the scripts")
    })?;
    let text = String::from_utf8_lossy(&output.stdout);
    match (output.status.success(), text.trim().split(';').next()) {
        (true, Some(id)) if !id.is_empty() => Ok(id.to_string()),
        _ => {
            let stderr = String::from_utf8_lossy(&output.stderr);
            let stderr = stderr.trim();
            let problem = |what: &str| Problem::new("slurm", format!("{what}: {stderr}"));
            match UNREACHABLE.iter().any(|text| stderr.contains(text)) {
                true => Err(Error::new(ErrorKind::Retry, problem("sbatch reached no controller"))
                    .help(
                        "submit again when `scontrol ping` says UP and `squeue` lists no such job",
                    )),
                false => Err(Error::new(ErrorKind::Invalid, problem("sbatch refused"))),
            }
        }
    }
}
