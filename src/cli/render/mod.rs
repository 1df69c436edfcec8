//! `lightpath render`: loads a scene, builds the accelerator, renders, writes the files, and times
//! each stage.

pub mod args;
mod dataset;
pub mod layers;
mod options;
pub mod part;
mod plate;
pub mod progress;
mod stats;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use serde_json::json;

use crate::accel::{self, Accelerator, BuildInfo, BuildOptions};
use crate::error::{Error, Problem, Result};
use crate::files::FileSet;
use crate::film::{Film, ReservedFilm};
use crate::layers::LayerPlan;
use crate::memory::{self, Budget};
use crate::mesh::Mesh;
use crate::monitor::Monitor;
use crate::output::atomic::PartFile;
use crate::output::{Outputs, ValueCounts};
use crate::picture::{self, PictureHeader};
use crate::render::{
    RayCounts, RenderContext, SampleCounts, render_adaptive, render_layers, sampling,
};
use crate::studio;
use crate::world::{ContentHashes, LoadOptions, MissingImage, Sources, World, fingerprint};

use super::load::{self, SceneJob};
use super::outputs::{self, TextOutputs};
use super::progress::{Progress, ProgressMode};
use super::{machine, print, signals, version};

use self::args::{RenderArgs, ReportArgs};
use self::options::RenderOptions;
use self::stats::{MemoryStats, RayStats, Seconds, Stats};

/// Flags that name output files.
const OUTPUT_FLAGS: &str = "-o PREFIX, --stats FILE, --write-scene FILE";

/// All output files, created before the render so that a bad output folder is found at once.
struct RenderFiles {
    picture: picture::PictureFiles,
    previews: Vec<(String, PartFile)>,
    dataset: dataset::DatasetFiles,
    /// Files of `--stats` and `--write-scene`.
    texts: TextOutputs,
    /// Text of `--write-scene`.
    scene: String,
}

impl RenderFiles {
    fn create(options: &RenderOptions, job: &SceneJob) -> Result<Self> {
        let RenderOptions { args, prefix, plan, storage, previews, .. } = options;
        let saved = args.mesh.write_scene.as_ref().map(|target| load::saved(job, target));
        Ok(Self {
            scene: saved.transpose()?.unwrap_or_default(),
            picture: picture::PictureFiles::create(prefix, plan, *storage)?,
            previews: layers::open_previews(previews.clone())?,
            dataset: options.dataset.create()?,
            texts: options.text_files().create()?,
        })
    }
}

/// Renders one scene or mesh.
pub fn run(args: &RenderArgs) -> Result<()> {
    let start = Instant::now();
    if args.report.json {
        ProgressMode::refuse_beside_json(args.report.progress)?;
    }
    let monitor = Arc::new(Monitor::default());
    let pool = args.machine.workers.pool()?;
    let threads = pool.0.current_num_threads();
    let mut job = pool.install(|| load::load(options::request(args)?, &monitor))?;
    let ready = std::mem::take(&mut job.ready);
    let options = pool.install(|| RenderOptions::resolve(args, &job, threads))?;
    job.warnings.extend(options.warnings());
    let Sources { files, missing } = job.sources(&args.input);
    let inputs = files.iter().chain(&args.mesh.template).chain(&args.files.plate.over);
    let mut taken: FileSet = inputs.collect();
    missing.iter().for_each(|MissingImage { mesh, image }| taken.add_missing(image, mesh));
    taken.refuse_all(options.outputs(), &format!("choose another name: {OUTPUT_FLAGS}"))?;
    if args.output.is_none() && studio::is_mesh(&args.input) {
        refuse_images_of_scan(&options)?;
    }
    // Before this point a signal ends the process at once: no file exists yet that it must remove.
    signals::watch(&monitor)?;
    let files = RenderFiles::create(&options, &job)?;
    let mode = ProgressMode::of(args.report.progress, args.report.quiet);
    let run = RenderRun {
        job: &job,
        threads,
        monitor: &monitor,
        progress: Progress::start(mode, progress::meter(&monitor)),
        options,
        start,
    };
    let (stats, paths, oddities) = pool.install(|| run.all(files, ready))?;
    report(&args.report, &stats, &paths)?;
    args.files.prefix.check(&oddities)
}

/// Refuses to replace `NAME.png`, `NAME.albedo.png` or `NAME.semantic.png` beside `NAME.ply` unless
/// a render has made it: scanners and tools for data sets write images under such names. A render
/// leaves `NAME.exr`, too.
fn refuse_images_of_scan(options: &RenderOptions) -> Result<()> {
    let [exr, png] = Outputs::names(&options.prefix);
    let previews = options.previews.iter().map(|(_, path)| path);
    let mut pngs = std::iter::once(&png).chain(previews).chain(&options.dataset.ids);
    let Some(png) = pngs.find(|png| png.is_file()).filter(|_| !exr.exists()) else {
        return Ok(());
    };
    let message = "would be overwritten, and no render has made it: its .exr is missing";
    Err(Error::invalid(png.display().to_string(), message).help("choose another name: -o PREFIX"))
}

/// State shared by the stages of a render.
struct RenderRun<'a> {
    job: &'a SceneJob,
    options: RenderOptions<'a>,
    threads: usize,
    monitor: &'a Monitor,
    progress: Progress,
    start: Instant,
}

impl RenderRun<'_> {
    /// Runs all stages, from reading meshes to writing files. Consumes the progress bar, so later
    /// messages appear below it.
    fn all(
        self,
        files: RenderFiles,
        ready: Vec<(PathBuf, Mesh)>,
    ) -> Result<(Stats, Vec<PathBuf>, ValueCounts)> {
        self.warn(&self.job.warnings);
        let scene = &self.job.loaded.scene;
        let part = &self.options.part;
        let frame = [scene.camera.width, scene.camera.height];
        let blank = ReservedFilm::new(frame, part.window, part.channels())?;
        let budget = self.options.budget.as_ref();
        let reading = &self.options.args.mesh.reading;
        let options = LoadOptions {
            repair: reading.repair,
            no_mmap: reading.no_mmap,
            ready,
            memory_limit: budget.map(Budget::for_meshes).or_else(memory::limit_of_machine),
            texture_bytes: budget.map(Budget::for_textures),
            ..LoadOptions::default()
        };
        let mut contents = ContentHashes::default();
        let (loaded, hash) = rayon::join(
            || World::load(scene, options, self.monitor),
            || fingerprint(&self.job.loaded, reading.repair, &mut contents),
        );
        let (world, warnings) = loaded?;
        let mut world = world.with_overscan(part.overscan);
        let hash = hash?;
        if hash.is_some() {
            contents.check(&world.read)?;
        }
        // A mesh from a pipe names its texture only when it is read.
        outputs::refuse_overwrites(world.read.paths(), self.options.outputs(), OUTPUT_FLAGS)?;
        self.warn(&warnings);
        let loaded = self.start.elapsed().as_secs_f64();

        let world_bytes = world.mesh_bytes() + world.texture_bytes();
        if budget.is_none() {
            let film = memory::film_bytes(part.window, part.channels().len());
            memory::ensure_build_fits(scene.backend, self.threads, world.primitives(), film)?;
        }
        let options = BuildOptions {
            threads: self.threads,
            max_bytes: budget.map(|budget| budget.for_accelerator(world_bytes)),
        };
        let accelerator = accel::build(&world.geometry, scene.backend, &options, self.monitor)?;
        let info = accelerator.info();
        if let Some(budget) = budget {
            budget.check_film(world_bytes + info.bytes)?;
        }
        // Otherwise the film would need memory beside the memory that the build has freed.
        memory::release_freed();
        let mut film = blank.film();
        film.overscan = world.overscan;
        let built = self.start.elapsed().as_secs_f64();

        let counting = self.options.dataset.counting_plan(&self.options.plan, &world)?;
        let plan = counting.as_ref().unwrap_or(&self.options.plan);
        if let Some(adaptive) = self.options.adaptive {
            (world.spp, world.area_spp) = (adaptive.most, adaptive.first);
        }
        let (counts, taken) = self.trace(&world, accelerator.as_ref(), &mut film, plan)?;
        let rendered = self.start.elapsed().as_secs_f64();

        let mut stats = self.stats(&info);
        stats.triangles = world.triangles();
        stats.memory.mesh_bytes = world.mesh_bytes();
        stats.memory.texture_bytes = world.texture_bytes();
        stats.rays = RayStats { counts, false_hits: accelerator.false_hits() };
        stats.samples = taken;
        stats.seconds = Seconds {
            load: loaded,
            build: built - loaded,
            render: rendered - built,
            ..Seconds::default()
        };
        let seen = (plan, &world);
        let (paths, oddities) =
            self.write(files, (&film, seen), &info, hash.as_deref(), &mut stats)?;
        Ok((stats, paths, oddities))
    }

    /// Renders the film. Also returns the sample counts if adaptive sampling varies them.
    fn trace(
        &self,
        world: &World,
        accelerator: &dyn Accelerator,
        film: &mut Film,
        plan: &LayerPlan,
    ) -> Result<(RayCounts, Option<SampleCounts>)> {
        let (isa, monitor) = (self.job.loaded.scene.backend.isa(), self.monitor);
        let context = RenderContext { world, accelerator, isa, monitor };
        if let Some(adaptive) = self.options.adaptive {
            let (counts, taken) = render_adaptive(context, film, plan, adaptive)?;
            return Ok((counts, Some(taken)));
        }
        let counts = render_layers(context, film, plan, self.options.part.raw.as_ref())?;
        Ok((counts, None))
    }

    /// Returns the statistics that are known before the first ray.
    fn stats(&self, info: &BuildInfo) -> Stats {
        let loaded = &self.job.loaded;
        Stats {
            backend: loaded.scene.backend.name().to_string(),
            threads: self.threads,
            versions: version::versions(&info.version),
            cpu: machine::cpu(),
            isa: format!("{} rays, {} shading", info.isa, loaded.scene.backend.isa()),
            scene_hash: loaded.hash.clone(),
            seed: loaded.scene.seed,
            memory: MemoryStats {
                accelerator_bytes: info.bytes,
                accelerator_peak_bytes: info.peak_bytes,
                ..MemoryStats::default()
            },
            ..Stats::default()
        }
    }

    fn write(
        &self,
        files: RenderFiles,
        (film, (plan, world)): (&Film, (&LayerPlan, &World)),
        info: &BuildInfo,
        hash: Option<&str>,
        stats: &mut Stats,
    ) -> Result<(Vec<PathBuf>, ValueCounts)> {
        let started = Instant::now();
        let (options, scene) = (&self.options, &self.job.loaded.scene);
        let legend = world.legend.as_ref();
        let part = options.part.attribute(options.storage, scene, info, (hash, legend))?;
        let mut more: Vec<(String, String)> = part.into_iter().collect();
        more.extend(options.adaptive.as_ref().map(sampling::attributes).unwrap_or_default());
        let spp = sampling::spp(options.adaptive.as_ref(), scene);
        let behind = options.plate.as_ref().map(|plate| plate.pixels(film.window));
        let says = PictureHeader {
            more: &more,
            backend_version: &info.version,
            scene_hash: hash,
            spp: Some(&spp),
            over: behind.as_deref(),
            exact: options.part.exact,
            sequence: options.args.files.sequence(),
            render_seconds: options.args.files.record_time.then_some(stats.seconds.render as f32),
            legend,
            ..PictureHeader::default()
        };
        let RenderFiles { mut picture, previews, dataset, mut texts, scene: saved } = files;
        let mut previews = layers::write_previews(film, previews, |part| picture.add(part))?;
        let seen = (plan, world, scene);
        previews.extend(dataset.write(film, seen, |part| picture.add(part))?);
        let (written, oddities) =
            picture::write(picture, film, scene, says, options.file_storage(), self.monitor)?;
        let mut paths: Vec<_> = written.into_iter().map(|(path, _)| path).collect();
        self.warn(&picture::oddity_warnings(&oddities));
        paths.extend(previews);
        texts.write("--write-scene", || saved)?;
        stats.seconds.write = started.elapsed().as_secs_f64();
        stats.seconds.total = self.start.elapsed().as_secs_f64();
        stats.memory.peak_bytes = memory::peak_bytes();
        texts.write_json("--stats", stats)?;
        paths.extend(texts.written());
        Ok((paths, oddities))
    }

    fn warn(&self, warnings: &[Problem]) {
        if !self.options.args.report.quiet {
            for warning in warnings {
                self.progress.message(&format!("warning: {warning}"));
            }
        }
    }
}

fn report(args: &ReportArgs, stats: &Stats, paths: &[PathBuf]) -> Result<()> {
    if !args.quiet {
        print::note(&stats.summary());
    }
    if args.json {
        let mut value = json!(stats);
        value["outputs"] = paths.iter().map(|path| path.display().to_string()).collect();
        return print::json(&value);
    }
    print::paths(paths)
}
