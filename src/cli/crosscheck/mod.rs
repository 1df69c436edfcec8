//! `lightpath crosscheck`: compares every backend's answers, ray by ray, with the oracle's.

pub mod args;
mod text;

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::accel::brute::Brute;
use crate::accel::bvh::Bvh;
use crate::accel::coursework::Coursework;
use crate::accel::lane::LaneRay;
use crate::accel::{Accelerator, BuildOptions, Visits};
use crate::error::{Error, ErrorKind, Result, printable};
use crate::files;
use crate::lab::answer::Answer;
use crate::lab::backend::{BuiltBackend, TestedBackend};
use crate::lab::crosscheck::{CrossCheck, Finding, TreeReport, check_rays, compare_pictures};
use crate::lab::verdict::{Verdict, judge};
use crate::monitor::Monitor;
use crate::scene::{self, Backend, Scene, Source, Visible, written};
use crate::simd::Isa;
use crate::world::{LoadOptions, World};

use super::load::{self, SceneRequest};
use super::outputs::OutputFlags;
use super::progress::{Progress, ProgressMode};
use super::render::progress as render_progress;
use super::{overrides, print, signals};

use self::args::CrosscheckArgs;

/// Maximum size of a `--replay` file in MiB.
const MAX_REPLAY_MIB: u64 = 64;

/// Content of a `--save` file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Saved {
    /// The scene with overrides. Its paths are relative to the folder of the saved file.
    scene: Value,
    findings: Vec<Finding>,
}

/// Checks a scene, or replays the findings of an earlier check.
pub fn run(args: &CrosscheckArgs) -> Result<()> {
    let monitor = Arc::new(Monitor::default());
    let isa = args.kernels.isa()?;
    let backends = backends(args.backends.as_deref(), isa)?;
    args.workers.pool()?.install(|| match (&args.replay, &args.input) {
        (Some(file), _) => replay(args, file, isa, &monitor),
        (None, Some(input)) => check(args, input, backends, isa, &monitor),
        (None, None) => Err(Error::invalid("", "no scene given")),
    })
}

/// Converts backend names and drops duplicates; `None` if no names are given.
///
/// # Errors
/// A single backend: there is nothing to compare it with.
fn backends(
    names: Option<&[written::AcceleratorName]>,
    isa: Isa,
) -> Result<Option<Vec<TestedBackend>>> {
    let Some(names) = names else { return Ok(None) };
    let mut backends: Vec<TestedBackend> = Vec::new();
    for name in names {
        let name = Backend::from(*name).name();
        let backend = TestedBackend::parse("--backends", name, isa)?;
        if !backends.contains(&backend) {
            backends.push(backend);
        }
    }
    if let [only] = &backends[..] {
        let message = format!("found `{}` alone, expected two or more backends", only.name);
        return Err(Error::invalid("--backends", message).help("--backends embree,bvh"));
    }
    Ok(Some(backends))
}

/// Returns all backends that can be compared. `bvh` uses the kernels of `isa`.
fn all_backends(isa: Isa) -> Result<Vec<TestedBackend>> {
    let names = ["embree", "bvh", "coursework", "brute"];
    names.into_iter().map(|name| TestedBackend::parse("--backends", name, isa)).collect()
}

/// Returns the scene that the arguments ask for.
fn request<'a>(args: &CrosscheckArgs, input: &'a Path) -> SceneRequest<'a> {
    let mut request = SceneRequest::new(input);
    let all = &mut request.overrides;
    overrides::add_size(all, args.picture.size);
    all.flag("--spp", "/spp", args.spp);
    all.flag("--seed", "/seed", args.seed);
    overrides::add_sets(all, &args.overrides.set);
    request
}

/// Accelerators of all backends over one geometry.
struct Built<'g> {
    oracle: Brute<'g>,
    coursework: Option<Coursework<'g>>,
    bvh: Option<Bvh<'g>>,
    embree: Option<Box<dyn Accelerator + 'g>>,
    order: Vec<TestedBackend>,
}

impl<'g> Built<'g> {
    /// Builds the backends `asked` for; for `None`, all that can run here. The oracle is always
    /// built.
    fn new(
        world: &'g World,
        asked: Option<Vec<TestedBackend>>,
        isa: Isa,
        monitor: &Monitor,
    ) -> Result<Self> {
        let skip = asked.is_none();
        let threads = rayon::current_num_threads();
        let options = BuildOptions { threads, max_bytes: None };
        let geometry = &world.geometry;
        let oracle = Brute::build(geometry, &options, monitor)?;
        let (mut coursework, mut bvh, mut embree, mut order) = (None, None, None, Vec::new());
        let wanted = asked.map_or_else(|| all_backends(isa), Ok)?;
        for tested in wanted {
            match tested.backend {
                Backend::Brute => {}
                Backend::Coursework => {
                    coursework = Some(Coursework::build(geometry, &options, monitor)?);
                }
                Backend::Bvh(isa) => bvh = Some(Bvh::build(geometry, isa, &options, monitor)?),
                Backend::Embree(_) => match tested.build(geometry, threads, monitor) {
                    Ok(accelerator) => embree = Some(accelerator),
                    Err(error) if skip && error.kind == ErrorKind::Unsupported => {
                        print::note(&format!("without `{}`: {error}", tested.name));
                        continue;
                    }
                    Err(error) => return Err(error),
                },
            }
            order.push(tested);
        }
        Ok(Self { oracle, coursework, bvh, embree, order })
    }

    fn built_backends(&self) -> Vec<BuiltBackend<'_>> {
        let accelerator = |backend: Backend| -> Option<&dyn Accelerator> {
            Some(match backend {
                Backend::Brute => &self.oracle,
                Backend::Coursework => self.coursework.as_ref()?,
                Backend::Bvh(_) => self.bvh.as_ref()?,
                Backend::Embree(_) => &**self.embree.as_ref()?,
            })
        };
        let built = self.order.iter().map(|tested| (tested, accelerator(tested.backend)));
        built
            .filter_map(|(tested, built)| Some(BuiltBackend { tested, accelerator: built? }))
            .collect()
    }
}

fn check(
    args: &CrosscheckArgs,
    input: &Path,
    backends: Option<Vec<TestedBackend>>,
    isa: Isa,
    monitor: &Arc<Monitor>,
) -> Result<()> {
    let mut job = load::load(request(args, input), monitor)?;
    let outputs = OutputFlags(vec![("--save FILE.json", &args.save)]);
    outputs.refuse_overwrites(job.inputs(input))?;
    let saved = args.save.as_ref().map(|path| load::saved(&job, path)).transpose()?;
    signals::watch(monitor)?;
    let progress = Progress::start(ProgressMode::Auto, render_progress::meter(monitor));
    let mut outputs = outputs.create()?;
    show_all(&mut job.loaded.scene);
    // All backends get the same geometry, and some trace no instances.
    let world = job.world(monitor, true, |text| progress.message(text))?;
    let built = Built::new(&world, backends, isa, monitor)?;
    let built_backends = built.built_backends();
    let check = CrossCheck {
        world: &world,
        oracle: &built.oracle,
        built_backends: &built_backends,
        coursework: built.coursework.as_ref(),
        rays: args.rays,
        seed: job.loaded.scene.seed,
    };
    let mut report = check_rays(&check, monitor)?;
    report.tree = built.bvh.as_ref().map(|bvh| TreeReport::from(bvh.validate()));
    if !args.no_picture {
        report.pictures = compare_pictures(&check, isa, monitor)?;
    }
    drop(progress);
    // Before the report, which stdout may not take. If it fails, the report is printed all the
    // same.
    let written = saved.map(|text| {
        let scene = serde_json::from_str(&text).unwrap_or_default();
        outputs.write_json("--save", &Saved { scene, findings: report.findings.clone() })
    });
    if args.json {
        let mut value = json!(report);
        value["failures"] = report.failures().into();
        print::json(&value)?;
    } else {
        print::text(&text::report(&report))?;
    }
    written.transpose()?;
    if !args.json {
        print::paths(&outputs.written())?;
    }
    Error::failed("crosscheck", report.failures())
}

/// A finding that was traced again.
#[derive(Serialize)]
struct Replayed<'f> {
    finding: &'f Finding,
    answer: Answer,
    truth: Answer,
    verdict: Verdict,
}

/// Makes every shape visible to all kinds of rays: the oracle has one set of primitives.
fn show_all(scene: &mut Scene) {
    scene.shapes.iter_mut().for_each(|shape| shape.visible = Visible::default());
}

fn replay(args: &CrosscheckArgs, file: &Path, isa: Isa, monitor: &Arc<Monitor>) -> Result<()> {
    let place = file.display().to_string();
    let saved = read(file)?;
    if saved.findings.is_empty() {
        print::note(&format!("{}: no wrong answers in this file", printable(&place)));
    }
    let text = saved.scene.to_string();
    let folder = file.parent().unwrap_or(Path::new(""));
    let name = format!("{place}: scene");
    let source = Source::Text { name: &name, text: text.as_bytes(), folder };
    let mut loaded = scene::load(source, &[])?;
    show_all(&mut loaded.scene);
    signals::watch(monitor)?;
    let options = LoadOptions { copy_instances: true, ..LoadOptions::default() };
    let (world, _) = World::load(&loaded.scene, options, monitor)?;
    let needed = all_backends(isa)?
        .into_iter()
        .filter(|b| saved.findings.iter().any(|f| f.backend == b.name));
    let built = Built::new(&world, Some(needed.collect()), isa, monitor)?;
    let built_backends = built.built_backends();
    let primitives = *world.geometry.bases().last().unwrap_or(&0);
    let mut results = Vec::new();
    for (index, finding) in saved.findings.iter().enumerate() {
        monitor.check()?;
        let wrong =
            |message: String| Error::invalid(format!("{place} (/findings/{index})"), message);
        let case = finding.case().map_err(wrong)?;
        let backend = built_backends.iter().find(|b| b.tested.name == finding.backend);
        let backend = backend
            .ok_or_else(|| wrong(format!("found the unknown backend `{}`", finding.backend)))?;
        if finding.packet.iter().any(|ray| ray.leaving.is_some_and(|p| p >= primitives)) {
            return Err(wrong(format!(
                "found a ray that leaves none of the {primitives} primitives"
            )));
        }
        let ray = LaneRay::of(&case.packet.rays, finding.lane);
        results.push(match (&built.coursework, finding.against.as_str()) {
            (Some(coursework), "plain loop") => {
                let of = |hit| Answer::of_hit(hit, false);
                let answer = of(coursework.closest_hit(&ray, &mut Visits::default()));
                let truth = of(coursework.plain_loop(&ray));
                let verdict = if answer == truth { Verdict::Agree } else { finding.verdict };
                Replayed { finding, answer, truth, verdict }
            }
            _ => {
                let answer = case.answers(backend.accelerator, finding.mode)[finding.lane];
                let truth = Answer::truth(&built.oracle, &ray, case.shadow);
                let verdict =
                    judge(&built.oracle, &ray, truth, answer, backend.tested.error_factor());
                Replayed { finding, answer, truth, verdict }
            }
        });
    }
    if args.json {
        print::json(&json!({ "replayed": results }))?;
    } else {
        let line = |r: &Replayed| text::finding(r.finding, r.verdict, r.answer, r.truth);
        print::text(&results.iter().map(line).collect::<String>())?;
    }
    let still = results.iter().filter(|r| r.verdict.is_wrong() && r.finding.fails()).count();
    let all = results.len();
    let failure = (still > 0).then(|| format!("{still} of {all} answers are still wrong"));
    Error::failed("crosscheck", failure)
}

fn read(file: &Path) -> Result<Saved> {
    let place = file.display().to_string();
    let expected = "a file of `crosscheck --save`";
    let bytes = files::read_within(file, MAX_REPLAY_MIB, expected)?;
    serde_json::from_slice(&bytes)
        .map_err(|error| Error::invalid(&place, format!("{error}, expected {expected}")))
}
