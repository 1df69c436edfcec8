//! `lightpath batch`: builds a job from flags and a job file, runs it, and reports its events.

pub mod args;
mod progress;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;

use serde_json::json;

use crate::batch::{
    self, BatchOptions, Event, Flags, Job, JobFile, LimitKeys, Outcome, Places, Status,
    TurntableKeys, WrittenInput, sheet,
};
use crate::error::{Error, ErrorKind, Problem, Result, printable};
use crate::monitor::Monitor;
use crate::nearest::nearest;
use crate::output::tonemap::Depth;
use crate::scene::written::{Angles, Name, Point};
use crate::scene::{self, Document, Member, NodeKind};
use crate::studio::{self, Appearance, Template, Turning};
use crate::{memory, paths, units};

use super::progress::{Progress, ProgressMode};
use super::{flags, machine, overrides, print, signals};

use self::args::BatchArgs;

/// JSON pointer of the limit of memory in a job file.
pub const MEMORY_KEY: &str = "/limits/memory";

/// Renders the batch that the arguments describe.
pub fn run(args: &BatchArgs) -> Result<()> {
    let (job, limits) = job(args)?;
    batch::check_settings(&job)?;
    let with_sheet = !args.run.no_sheet && args.frames.range.is_none();
    if with_sheet {
        batch::refuse_foreign_sheet(&job)?;
    }
    if args.run.dry_run {
        machine::default_pool()?;
        return list(&job, args);
    }
    let options = options(args, &limits)?;
    if args.run.sheet_only {
        signals::end_at_once()?;
        let pool = machine::pool(Some(options.threads as u16))?;
        pool.install(|| batch::refuse_sheet(&job))?;
        let memory_limit = options.max_memory.map(memory::limit_for_meshes);
        let memory_limit = memory_limit.or_else(memory::limit_of_machine);
        let problems = pool.install(|| sheet::missing(&job, memory_limit));
        print::paths(&sheet::write(&job, &problems, options.threads, &Monitor::default())?)?;
        return complete(problems);
    }
    let monitor = Arc::new(Monitor::default());
    let status = Arc::new(Status::default());
    signals::watch(&monitor)?;
    let mode = ProgressMode::of(args.progress, args.quiet);
    let progress = Progress::start(mode, progress::meter(&status));
    let say = |text: String| {
        if !args.quiet {
            progress.message(&text);
        }
    };
    let tell = |event: Event| match event {
        Event::Framed { input, camera } => {
            say(format!("framed {}: camera {camera}", printable(input)))
        }
        Event::Warning { input, problem } => say(format!("warning: {}", about(input, problem))),
        Event::Again { reason } => say(format!("again: {}", printable(reason))),
        Event::Frame { outputs } => progress.result(outputs),
        Event::Failed { input, error } => {
            for problem in &error.problems {
                progress.message(&format!("error: {}", about(input, problem)));
            }
        }
    };
    let outcome = batch::run(&job, &options, &monitor, &status, &tell);
    let seconds = progress.elapsed();
    let listed = progress.finish();
    let outcome = outcome?;
    if !args.quiet {
        print::note(&format!(
            "{} rendered, {} kept{}, {}, {}",
            units::plural(outcome.rendered as usize, "frame"),
            units::count(outcome.kept),
            if args.run.no_verify { " without reading them" } else { "" },
            units::plural(outcome.failures.len(), "failure"),
            units::duration(seconds)
        ));
    }
    // A list of paths that is lost does not stop the batch, but its exit code says so.
    let ended = outcome.signal.is_none() && outcome.fatal.is_none();
    let sheet = match with_sheet && ended {
        true => {
            let paths = sheet::write(&job, &[], options.threads, &monitor);
            paths.and_then(|paths| print::paths(&paths))
        }
        false => Ok(()),
    };
    // The signal may have come while the sheet was written.
    let signal = Some(monitor.signal.load(Relaxed)).filter(|signal| *signal != 0);
    verdict(&job, Outcome { signal, ..outcome }, listed.and(sheet))
}

/// Checks that no frame is missing, that each is a frame of the job as it is now, and that none
/// failed after it was made. `problems` has those of each input.
///
/// # Errors
/// `Check`, with the problems of each input that lacks frames or failed.
fn complete(problems: Vec<Vec<Problem>>) -> Result<()> {
    let (inputs, with) = (problems.len(), problems.iter().filter(|all| !all.is_empty()).count());
    let mut problems = problems.concat();
    if !problems.is_empty() {
        let message = format!("{with} of {inputs} inputs lack frames or failed:");
        problems.insert(0, Problem::new("", message));
    }
    let help = "run the batch again with --resume; on a farm, submit the job again";
    Error::check(ErrorKind::Check, problems).map_err(|error| error.help(help))
}

/// Adds the input to the place of a problem, unless it is already there.
fn about(input: &str, problem: &Problem) -> Problem {
    let place = match problem.place.as_str() {
        place if place.contains(input) => place.to_string(),
        "" => input.to_string(),
        place => format!("{input}: {place}"),
    };
    Problem { place, ..problem.clone() }
}

/// Turns the outcome of a run and of its contact sheet into a result. The error lists all failures
/// again.
fn verdict(job: &Job, outcome: Outcome, sheet: Result<()>) -> Result<()> {
    if let (Some(signal), None) = (outcome.signal, &outcome.fatal) {
        let message = "stopped by a signal; finished frames stay";
        let problem = Problem::new("", message).help("continue with --resume");
        return Err(Error::new(ErrorKind::Interrupted(signal), problem));
    }
    // No sheet is written after a fatal error.
    let last = outcome.fatal.clone().map_or(sheet, Err);
    if outcome.failures.is_empty() {
        return last;
    }
    let inputs: BTreeSet<usize> = outcome.failures.iter().map(|(input, _)| *input).collect();
    let message = format!("{} of {} inputs failed:", inputs.len(), job.inputs.len());
    let mut problems = vec![Problem::new("", message)];
    for (input, error) in &outcome.failures {
        let path = job.inputs[*input].path.display().to_string();
        problems.extend(error.problems.iter().map(|problem| about(&path, problem)));
    }
    // A retry of the batch can help only if every failure may be temporary.
    let mut errors = outcome.failures.iter().map(|(_, error)| error).chain(last.as_ref().err());
    let retry = errors.all(|error| error.kind == ErrorKind::Retry);
    let listed = |problem: &Problem| {
        outcome.failures.iter().any(|(_, error)| error.problems.contains(problem))
    };
    let last = last.err().into_iter().flat_map(|error| error.problems);
    problems.extend(last.filter(|problem| !listed(problem)));
    let kind = if retry { ErrorKind::Retry } else { ErrorKind::Check };
    Err(Error { kind: outcome.fatal.map_or(kind, |error| error.kind), problems })
}

/// Returns the limit of memory of a job file in bytes. `place` names the limit in messages.
///
/// # Errors
/// A text that is no size.
pub fn max_memory(limits: &LimitKeys, place: &str) -> Result<Option<u64>> {
    let parse = |Name(text): &Name| {
        units::parse_bytes(text)
            .map_err(|expected| Error::invalid(place, format!("found {text:?}, {expected}")))
    };
    limits.memory.as_ref().map(parse).transpose()
}

fn options(args: &BatchArgs, limits: &LimitKeys) -> Result<BatchOptions> {
    let written = max_memory(limits, MEMORY_KEY)?;
    Ok(BatchOptions {
        threads: machine::threads(args.machine.workers.threads.or(limits.threads)),
        jobs: args.run.jobs.or(limits.jobs).map(usize::from),
        max_memory: args.machine.max_memory.or(written),
        resume: args.run.resume,
        verify: !args.run.no_verify,
        fail_fast: args.run.fail_fast,
        range: args.frames.range.clone(),
    })
}

/// Returns the job from flags and job file, and the limits of the job file.
pub fn job(args: &BatchArgs) -> Result<(Job, LimitKeys)> {
    if args.scene.crop.is_some() {
        let message = "found with `batch`, expected with `render`";
        return Err(Error::invalid("--crop", message));
    }
    let (mut file, document) = match args.inputs.as_slice() {
        [one] => match read_job_file(one)? {
            Some((file, document)) => (file, Some(document)),
            None => (inputs(&args.inputs)?, None),
        },
        several => (inputs(several)?, None),
    };
    let own = args.inputs.first().filter(|_| document.is_some()).map(PathBuf::as_path);
    let looks = apply_flags(args, &mut file)?;
    let limits = file.limits.clone();
    let beside = Flags {
        overrides: overrides::from_flags(&args.scene, &args.machine)?,
        light_samples: args.scene.light_samples,
        repair: args.mesh.reading.repair,
        no_mmap: args.mesh.reading.no_mmap,
        looks,
        turned: args.mesh.placement.up.is_some() || args.mesh.placement.rotate.is_some(),
        file: own.map(Path::to_owned),
        places: Places { document, name_is_flag: args.name.is_some() },
        range: args.frames.range.clone(),
    };
    let mesh_key = file.mesh_key();
    let job = Job::check(file, folder_of(own), beside)?;
    if !has_mesh(&job) {
        let mesh = &args.mesh;
        let given = (&mesh.placement, mesh.template.as_deref(), &mesh.looks);
        flags::refuse_mesh_flags(given, "scenes")?;
    }
    refuse_mesh_key(&job, mesh_key)?;
    Ok((job, limits))
}

/// Loads a job file and its limits as `batch` loads them, with another output folder if one is
/// given. Returns `None` if the file is not a job file.
///
/// # Errors
/// All problems of the job.
pub fn load_job_file(path: &Path, output: Option<&Path>) -> Result<Option<(Job, LimitKeys)>> {
    let Some((mut file, document)) = read_job_file(path)? else { return Ok(None) };
    set_output(&mut file, output)?;
    let limits = file.limits.clone();
    let places = Places { document: Some(document), name_is_flag: false };
    let flags = Flags { file: Some(path.to_owned()), places, ..Flags::default() };
    let mesh_key = file.mesh_key();
    let job = Job::check(file, folder_of(Some(path)), flags)?;
    refuse_mesh_key(&job, mesh_key)?;
    Ok(Some((job, limits)))
}

fn has_mesh(job: &Job) -> bool {
    job.inputs.iter().any(|input| studio::is_mesh(&input.path))
}

/// Refuses a key of the job file that only meshes have, if no input is one.
fn refuse_mesh_key(job: &Job, key: Option<&str>) -> Result<()> {
    match key.filter(|_| !has_mesh(job)) {
        Some(key) => Err(batch::without_mesh(&job.places.at(&format!("/{key}")))),
        None => Ok(()),
    }
}

/// Returns the folder that the paths of a job file are relative to. Without a job file it is the
/// working folder.
fn folder_of(job_file: Option<&Path>) -> &Path {
    job_file.and_then(Path::parent).unwrap_or(Path::new(""))
}

/// Parses a file that has `inputs` as a job, whatever its name is; `None` for any other file. A
/// misspelt `inputs` is an error, if no key tells of a scene. The path of the output folder is
/// then relative to the working folder.
fn read_job_file(path: &Path) -> Result<Option<(JobFile, Document)>> {
    if !path.is_file() || studio::is_mesh(path) {
        return Ok(None);
    }
    let text = Template::file(path)?;
    let document = Document::parse(&text.name, &text.text)?;
    if document.get("/inputs").is_none() && !misspells_inputs(&document) {
        return Ok(None);
    }
    let mut file: JobFile = scene::read_as(&document)?;
    max_memory(&file.limits, &document.place(MEMORY_KEY))?;
    if let Some(folder) = &mut file.output.folder {
        folder.0 = paths::named(&folder_of(Some(path)).join(&folder.0))?;
    }
    Ok(Some((file, document)))
}

/// Returns true for an object without the keys of a scene that has a key similar to `inputs`.
fn misspells_inputs(document: &Document) -> bool {
    let NodeKind::Object(members) = &document.root.kind else { return false };
    let has = |key| document.root.member(key).is_some();
    let is_near = |member: &Member| nearest(&member.key, ["inputs"]).is_some();
    !has("scene") && !has("camera") && members.iter().any(is_near)
}

fn inputs(paths: &[PathBuf]) -> Result<JobFile> {
    let one = |path: &PathBuf| Ok(WrittenInput::Path(Name(paths::named(path)?)));
    let inputs = paths.iter().map(one).collect::<Result<_>>()?;
    Ok(JobFile { inputs, ..JobFile::default() })
}

/// Replaces values of the job file by those of flags. Returns the looks that flags choose.
fn apply_flags(args: &BatchArgs, file: &mut JobFile) -> Result<Appearance> {
    let from_here = |path: &Path| -> Result<Name> {
        let absolute = std::path::absolute(path).map_err(|e| Error::io(path, "find", &e))?;
        Ok(Name(paths::named(&absolute)?))
    };
    let BatchArgs { mesh, frames, .. } = args;
    if let Some(template) = &mesh.template {
        file.template = Some(from_here(template)?);
        (file.studio, file.quality) = (None, None);
    }
    if let Some(cameras) = &frames.cameras {
        file.cameras = Some(from_here(cameras)?);
        (file.turntable, file.margin) = (None, None);
    }
    file.undistort |= frames.undistort;
    let place = &mesh.placement;
    if place.up.is_some() || place.rotate.is_some() {
        file.up = place.up;
        file.rotate = place.rotate.map(Angles);
    }
    file.margin = place.margin.or(file.margin);
    let mut looks = mesh.looks.appearance()?;
    file.smooth = looks.smooth.clone().or(file.smooth.take());
    file.color = looks.color.clone().or(file.color.take());
    file.points = looks.points.or(file.points);
    if let Some(texture) = &mut looks.texture {
        let named = from_here(texture)?;
        *texture = PathBuf::from(&named.0);
        file.texture = Some(named);
    }
    file.quality = looks.quality.or(file.quality);
    if looks.studio.is_some() {
        file.studio = looks.studio;
        file.template = file.template.take().filter(|_| mesh.template.is_some());
    }
    file.ground = if looks.no_ground { Some(false) } else { file.ground };
    set_output(file, args.output.as_deref())?;
    if let Some(name) = &args.name {
        file.output.name = Some(Name(name.clone()));
    }
    file.overscan = args.scene.overscan.unwrap_or(file.overscan);
    let noise = args.sampling.noise.sampling();
    file.noise = noise.noise.or(file.noise);
    file.noiseof = noise.noise_of.or(file.noiseof);
    file.maxspp = noise.max_spp.or(file.maxspp);
    file.output.float |= frames.values.float;
    file.output.multipart |= frames.parts.multipart;
    file.output.cryptosidecar |= frames.crypto_sidecar;
    file.output.strict |= frames.strict;
    file.output.pngbits = frames.png_bits.map(Depth::bits).or(file.output.pngbits);
    if let Some(compression) = frames.values.compression {
        file.output.compression = compression;
    }
    if let Some((above, below)) = frames.fps {
        file.output.fps = Some(Name(format!("{above}/{below}")));
    }
    if let Some(count) = frames.turntable {
        let written = file.turntable.take();
        let written = written.as_ref();
        file.turntable = Some(TurntableKeys {
            frames: count,
            turn: frames.turn.unwrap_or(written.map_or(Turning::Object, |t| t.turn)),
            lights: frames.lights.or(written.and_then(|t| t.lights)),
            start: frames.start.unwrap_or(written.map_or(0.0, |t| t.start)),
            pivot: frames.pivot.map(Point).or(written.and_then(|t| t.pivot)),
        });
        (file.cameras, file.undistort) = (None, frames.undistort);
    }
    Ok(looks)
}

/// Replaces the output folder of the job file by that of `--output`.
fn set_output(file: &mut JobFile, output: Option<&Path>) -> Result<()> {
    if let Some(folder) = output {
        file.output.folder = Some(Name(paths::named(folder)?));
    }
    Ok(())
}

/// Prints the frames of a run, one JSON object per line.
fn list(job: &Job, args: &BatchArgs) -> Result<()> {
    let tasks = batch::tasks(job.inputs.len(), job.frames(), args.frames.range.as_ref())?;
    batch::check_lengths(job, &tasks)?;
    batch::refuse_photographs(job, &tasks)?;
    for task in tasks {
        let files = batch::task_files(job, &task);
        for (frame, outputs) in task.frames.zip(files) {
            let line = json!({
                "index": batch::index(job.frames(), task.input, frame),
                "input": job.inputs[task.input].path.display().to_string(),
                "frame": frame,
                "outputs": outputs.iter().map(|p| p.display().to_string()).collect::<Vec<_>>(),
            });
            print::json(&line)?;
        }
    }
    Ok(())
}
