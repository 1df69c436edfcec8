//! `lightpath bench`: times several backends on the same rays; writes tables, JSON and a page.

pub mod args;
mod page;
pub mod table;

use std::ffi::OsString;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use serde::Serialize;

use crate::error::{Error, ErrorKind, Failures, Problem, Result, printable};
use crate::files;
use crate::lab::ab::TimingPlan;
use crate::lab::backend::{self, TestedBackend};
use crate::lab::baseline::BaselineComparison;
use crate::lab::bench::{BenchSettings, measure};
use crate::lab::growth::Growth;
use crate::lab::rays::RayClass;
use crate::lab::result::{self, BenchReport, RunStamp, SceneResult};
use crate::mesh::ReadOptions;
use crate::monitor::Monitor;
use crate::scene::{Backend, Overrides, Source};
use crate::simd::Isa;
use crate::{memory, studio};

use super::flags::MessageArgs;
use super::load::{self, SceneRequest};
use super::{machine, overrides, print, signals};

use self::args::BenchArgs;

/// Maximum size of a `--baseline` file in MiB.
const MAX_BASELINE_MIB: u64 = 64;
/// Built-in scene for a mesh without a scene.
const SCENE: &str = include_str!("../../../assets/bench.json");

/// Rays, rounds and picture size of `--quick`.
const QUICK: (u64, usize, [u32; 2]) = (1 << 12, 2, [128, 128]);

/// What `--json` writes: the report with all that is derived from it.
#[derive(Serialize)]
struct JsonReport<'a> {
    #[serde(flatten)]
    report: &'a BenchReport,
    growth: Vec<Growth>,
    since_baseline: Option<&'a BaselineComparison>,
}

/// Measures every scene and writes the results. `words` are the program's name and its arguments.
pub fn run(args: &BenchArgs, words: &[OsString]) -> Result<()> {
    let monitor = Arc::new(Monitor::default());
    let settings = settings(args, &monitor)?;
    let then = args.baseline.as_deref().map(read_baseline).transpose()?;
    let command = words.iter().skip(1).map(|part| part.to_string_lossy().into_owned());
    let run = RunStamp { unix_seconds: unix_seconds(), command: command.collect() };
    args.outputs().refuse_overwrites(args.inputs.iter().chain(&args.baseline))?;
    check_inputs(args)?;
    signals::watch(&monitor)?;
    let mut outputs = args.outputs().create()?;
    let mut report = BenchReport {
        version: result::VERSION,
        machine: machine::describe(settings.isa),
        run,
        scenes: Vec::with_capacity(args.inputs.len()),
    };
    let mut shown = print::Report::new(!outputs.is_empty());
    for input in &args.inputs {
        let scene = measure_scene(args, input, &settings, &monitor)?;
        shown.text(&table::scene(&scene))?;
        report.scenes.push(scene);
    }
    shown.text(&table::growth_text(&report))?;
    let name = args.baseline.as_deref().unwrap_or(Path::new("")).display().to_string();
    let since = then.map(|then| BaselineComparison::new(&report, &name, &then));
    if let Some(since) = &since {
        shown.text(&table::since(since))?;
    }
    let all = JsonReport {
        report: &report,
        growth: Growth::fits(&report),
        since_baseline: since.as_ref(),
    };
    outputs.write_json("--json", &all)?;
    outputs.write_json("--save-baseline", &report)?;
    outputs.write("--html", || page::page(&report, since.as_ref()).html())?;
    shown.end()?;
    print::paths(&outputs.written())?;
    check_answers(&report, &settings)
}

/// Returns the current Unix time in seconds, or 0 if the clock is before 1970.
fn unix_seconds() -> u64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// Reports the problems of all scenes and mesh headers before the first measurement.
fn check_inputs(args: &BenchArgs) -> Result<()> {
    let mut failures = Failures::default();
    for input in &args.inputs {
        match studio::is_mesh(input) {
            true => {
                let _ = failures.keep(memory::declared_sizes(input, &ReadOptions::default()));
            }
            false => drop(failures.keep(sized(args).load(Source::File(input)))),
        }
    }
    failures.check()
}

/// Returns the overrides of every scene: the size of its picture.
fn sized(args: &BenchArgs) -> Overrides {
    let mut all = Overrides::default();
    overrides::add_size(&mut all, args.picture.size.or(args.quick.then_some(QUICK.2)));
    all
}

/// Loads a scene, or a mesh in the built-in scene, and measures it.
fn measure_scene(
    args: &BenchArgs,
    input: &Path,
    settings: &BenchSettings,
    monitor: &Monitor,
) -> Result<SceneResult> {
    let name = input.display().to_string();
    let note = |text: &str| args.messages.note(&format!("{}: {text}", printable(&name)));
    note("loading");
    let overrides = sized(args);
    let request = SceneRequest { studio: Some(SCENE), overrides, ..SceneRequest::new(input) };
    let mut job = load::load(request, monitor)?;
    args.outputs().refuse_overwrites(job.inputs(input).iter().chain(&args.baseline))?;
    // All backends get the same geometry, and some trace no instances.
    let world = job.world(monitor, true, note)?;
    let measured = measure(&world, settings, monitor, &note)?;
    Ok(SceneResult { name, hash: job.loaded.hash, ..measured })
}

/// Checks the flags and returns the settings.
fn settings(args: &BenchArgs, monitor: &Monitor) -> Result<BenchSettings> {
    let isa = args.kernels.isa()?;
    let names = args.backends.iter();
    let parsed = names.map(|name| TestedBackend::parse("--backends", name, isa));
    let mut tested_backends = TestedBackend::distinct("--backends", parsed)?;
    if tested_backends.is_empty() {
        tested_backends = ours_against_embree(isa, &args.messages, monitor)?;
    }
    let mut classes = Vec::new();
    for name in &args.classes {
        let class = RayClass::ALL.into_iter().find(|class| class.name() == name);
        classes.push(class.ok_or_else(|| {
            let names = RayClass::ALL.map(RayClass::name).join(", ");
            Error::invalid("--classes", format!("found {name:?}, expected some of {names}"))
        })?);
    }
    if classes.is_empty() {
        classes = RayClass::ALL.to_vec();
    }
    classes.sort_unstable();
    classes.dedup();
    if !(args.seconds.is_finite() && (0.0..=3600.0).contains(&args.seconds)) {
        let message = format!("found {}, expected 0 to 3600", args.seconds);
        return Err(Error::invalid("--seconds", message));
    }
    let (rays, rounds) = match (args.quick, args.rounds) {
        (true, _) => (QUICK.0, Some(QUICK.1)),
        (false, rounds) => (args.rays, rounds.map(usize::from)),
    };
    let plan = |least: usize| match rounds {
        Some(rounds) => TimingPlan { rounds, budget: Duration::ZERO },
        None => TimingPlan { rounds: least, budget: Duration::from_secs_f64(args.seconds) },
    };
    let all = machine::threads(args.threads);
    let mut threads = vec![1, all];
    threads.dedup();
    Ok(BenchSettings {
        tested_backends,
        classes,
        threads,
        rays,
        seed: args.seed.into(),
        isa,
        plan: plan(5),
        slow_plan: plan(3),
    })
}

/// Returns the default backends: `embree` and `bvh`, or `bvh` alone where Embree is missing.
fn ours_against_embree(
    isa: Isa,
    messages: &MessageArgs,
    monitor: &Monitor,
) -> Result<Vec<TestedBackend>> {
    let both = ["embree", "bvh"].map(|name| TestedBackend::parse("--backends", name, isa));
    let both = both.into_iter().collect::<Result<_>>()?;
    let (available, without) = backend::available(both, monitor)?;
    without.iter().for_each(|line| messages.note(line));
    Ok(available)
}

fn read_baseline(path: &Path) -> Result<BenchReport> {
    let place = || path.display().to_string();
    let expected = "a file of `lightpath bench --save-baseline`";
    let text = files::read_within(path, MAX_BASELINE_MIB, expected)?;
    let report: BenchReport = serde_json::from_slice(&text)
        .map_err(|error| Error::invalid(place(), format!("{error}; expected {expected}")))?;
    if report.version != result::VERSION {
        let message = format!("found version {}, expected {}", report.version, result::VERSION);
        return Err(Error::invalid(place(), message).help("save a new baseline"));
    }
    Ok(report)
}

/// Checks that `bvh` gave no wrong answers. Wrong answers of other backends are only reported.
///
/// # Errors
/// `Check`, with one problem per scene and backend.
fn check_answers(report: &BenchReport, settings: &BenchSettings) -> Result<()> {
    let mut problems = Vec::new();
    for scene in &report.scenes {
        for (tested_backend, backend) in settings.tested_backends.iter().zip(&scene.backends) {
            if matches!(tested_backend.backend, Backend::Bvh(_)) && backend.wrong > 0 {
                let message = format!("{}: {} wrong answers", backend.name, backend.wrong);
                problems.push(
                    Problem::new(&scene.name, message)
                        .help("`lightpath crosscheck` names the rays; please report this"),
                );
            }
        }
    }
    Error::check(ErrorKind::Check, problems)
}
