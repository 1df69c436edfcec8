//! Renders one input of a batch, a mesh or a scene: reads it, builds its accelerator, renders its
//! frames in parallel, and drops it. Frames with another origin of coordinates follow, with another
//! world of the same input.

use std::collections::BTreeSet;
use std::mem::take;
use std::path::PathBuf;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use serde_json::Value;

use crate::accel::{self, Accelerator, BuildInfo, BuildOptions};
use crate::error::{Error, Problem, Result};
use crate::film::{Film, ReservedFilm};
use crate::layers::LayerPlan;
use crate::memory::{self, Budget};
use crate::mesh::Mesh;
use crate::output::ValueCounts;
use crate::paths;
use crate::picture::{self, PictureFiles, PictureHeader, Storage};
use crate::render::{
    RayCounts, RenderContext, checked_overscan, render_adaptive, render_layers, sampling,
};
use crate::reserve::MemoryLimit;
use crate::scene::{Backend, CheckedCamera, Scene, ToneOperator};
use crate::threads::lock;
use crate::world::{ContentHashes, LoadOptions, World};

use super::file_hashes::sum_of;
use super::journal::{FrameRecord, JournalRecord, MeshRecord, seen_from};
use super::origins::{self, Group};
use super::resume::Resume;
use super::scene::{self, Frame, Ready};
use super::status::Event;
use super::tasks::Task;
use super::workers::{Run, Share, guarded, together};

/// What all frames of an input share, whatever their origin of coordinates.
struct Input<'a> {
    /// Index among the tasks of the run.
    number: usize,
    task: &'a Task,
    path: &'a str,
    /// The input without its mesh.
    ready: &'a Ready,
    /// Memory limit of the mesh arrays.
    memory_limit: Option<MemoryLimit>,
    budget: Option<Budget>,
    /// Predicted bytes of all films at a time.
    film_bytes: u64,
    /// Maximum number of films at a time.
    films: u64,
    /// Hashes of the files; `None` if one of them is a pipe.
    contents: Option<ContentHashes>,
    /// Cameras of all frames.
    cameras: Vec<CheckedCamera>,
    /// Camera for the journal.
    camera: Value,
    /// Warnings about frames that have been reported.
    told: Mutex<BTreeSet<String>>,
}

/// A loaded input with its accelerator, shared by all frames with its origin.
struct Built<'a> {
    input: &'a Input<'a>,
    /// Maximum number of films at a time.
    films: u64,
    world: &'a World,
    accelerator: &'a dyn Accelerator,
    info: BuildInfo,
}

impl Run<'_> {
    /// Renders the frames of a task, given with its index among the tasks of the run. `left` counts
    /// the frames that are neither rendered nor kept if an error is returned.
    ///
    /// # Errors
    /// Errors that concern all frames of this input.
    pub fn mesh(
        &self,
        (number, task): (usize, &Task),
        path: &str,
        share: Share,
        left: &mut u64,
    ) -> Result<()> {
        let Share { prediction, films, bytes: share } = share;
        let began = Instant::now();
        let job = self.job;
        let monitor = self.monitor.part();
        let machine = || memory::machine_limit_for(prediction.peak_bytes);
        let memory_limit =
            self.options.max_memory.map(|_| memory::limit_for_meshes(share)).or_else(machine);
        let reading = || scene::read(job, &job.inputs[task.input], memory_limit, &monitor);
        let mut ready = self.loading.install(reading)?;
        let mut contents = ContentHashes::default();
        let resume = match self.options.resume {
            true => Resume::Keep(self.hashes.as_ref()),
            false => Resume::Nothing,
        };
        let looking = || ready.frames((job, task), resume, &self.settings, &mut contents, &monitor);
        let (frames, kept) = self.loading.install(looking)?;
        let plan = LayerPlan::new(&ready.loaded.scene);
        for prefix in task.frames.clone().map(|frame| job.prefix(task.input, frame)) {
            self.sweep_frame(&PictureFiles::names(&prefix, &plan, job.storage));
        }
        *left = frames.len() as u64;
        self.kept(task.input, kept).inspect_err(|error| self.end(error.clone()))?;
        let Some(first) = frames.first() else { return Ok(()) };
        let (mesh, warnings) = (take(&mut ready.mesh), take(&mut ready.warnings));
        let posed = job.poses.as_ref().map(|_| ready.frame(job, first.number)).transpose()?;
        let loaded = posed.as_ref().unwrap_or(&ready.loaded);
        let camera = loaded.description.to_json()["camera"].clone();
        if !mesh.is_empty() && job.poses.is_none() {
            (self.tell)(Event::Framed { input: path, camera: &camera });
        }
        let mut messages = self.warn(path, &warnings);
        if loaded.scene.tonemap.operator == ToneOperator::Max {
            messages.extend(self.warn_of_flicker(path, &job.inputs[task.input]));
        }
        let film_bytes = prediction.film_bytes.saturating_mul(films);
        let budget = self.options.max_memory.map(|_| Budget::new(share, prediction)).transpose()?;
        let hashed = frames.iter().all(|frame| frame.hash.is_some());
        let input = Input {
            number,
            task,
            path,
            ready: &ready,
            memory_limit,
            budget,
            film_bytes,
            films,
            contents: hashed.then_some(contents),
            cameras: frames.iter().map(|frame| frame.camera.clone()).collect(),
            camera,
            told: Mutex::default(),
        };
        let world = self.load(&input, &loaded.scene, mesh, &mut messages)?;
        let cameras = input.cameras.iter();
        let views: Vec<_> = cameras.map(|camera| world.view(&loaded.scene, camera)).collect();
        let (here, others) = origins::groups(&views, job.poses.is_none());
        self.group(&input, (world, loaded.scene.backend), (&here, &frames), began, &mut messages)?;
        for group in others.iter().take_while(|_| !self.stopped()) {
            let again = || self.load_again(&input, (group, &frames), &mut messages);
            if let Err(error) = guarded(again) {
                for &frame in &group.frames {
                    self.failed(task.input, Some(frames[frame].number), 1, error.clone());
                }
            }
        }
        Ok(())
    }

    /// Loads the input with another origin than before, and renders the frames of this origin.
    fn load_again(
        &self,
        input: &Input,
        (group, frames): (&Group, &[Frame]),
        messages: &mut Vec<String>,
    ) -> Result<()> {
        let began = Instant::now();
        if input.contents.is_none() {
            let message = "found a mesh or an image from a pipe, which cannot be read again for \
                           the origin of coordinates of another camera";
            return Err(Error::invalid(input.path, message).help("save it as a file"));
        }
        let scene = input.ready.frame(self.job, frames[group.frames[0]].number)?.scene;
        let world = self.load(input, &scene, Vec::new(), messages)?;
        self.group(input, (world, scene.backend), (group, frames), began, messages)
    }

    /// Loads a scene of the input, with the meshes that are in memory already. Reports warnings
    /// that are new, and adds them to `messages`.
    fn load(
        &self,
        input: &Input,
        scene: &Scene,
        ready: Vec<(PathBuf, Mesh)>,
        messages: &mut Vec<String>,
    ) -> Result<World> {
        let options = LoadOptions {
            repair: self.job.repair,
            no_mmap: self.job.no_mmap,
            ready,
            memory_limit: input.memory_limit,
            texture_bytes: input.budget.as_ref().map(Budget::for_textures),
            cameras: input.cameras.clone(),
            ..LoadOptions::default()
        };
        let monitor = self.monitor.part();
        let loading = || World::load(scene, options, &monitor);
        let (world, mut warnings) = self.loading.install(loading)?;
        self.refuse_if_output(&world.read)?;
        if let Some(contents) = &input.contents {
            contents.check(&world.read)?;
        }
        warnings.retain(|warning| !messages.contains(&warning.to_string()));
        messages.extend(self.warn(input.path, &warnings));
        Ok(world)
    }

    /// Builds the accelerator of a world, and renders the frames that share it. `began` is when
    /// loading began.
    fn group(
        &self,
        input: &Input,
        (world, backend): (World, Backend),
        (group, frames): (&Group, &[Frame]),
        began: Instant,
        messages: &mut Vec<String>,
    ) -> Result<()> {
        if group.frames.is_empty() {
            return Ok(());
        }
        messages.extend(self.warn(input.path, group.warning().as_slice()));
        let load_s = began.elapsed().as_secs_f64();
        let world_bytes = world.mesh_bytes() + world.texture_bytes();
        let budget = input.budget.as_ref();
        let options = BuildOptions {
            threads: self.options.threads,
            max_bytes: budget.map(|budget| budget.for_accelerator(world_bytes)),
        };
        let monitor = self.monitor.part();
        let building = || {
            if budget.is_none() {
                let (threads, primitives) = (self.options.threads, world.primitives());
                memory::ensure_build_fits(backend, threads, primitives, input.film_bytes)?;
            }
            accel::build(&world.geometry, backend, &options, &monitor)
        };
        let accelerator = self.loading.install(building)?;
        let info = accelerator.info();
        let films = match budget {
            Some(budget) => budget.films(world_bytes + info.bytes, input.films)?,
            None => input.films,
        };
        let (path, name) = self.named(input.task.input);
        let record = MeshRecord {
            input: path,
            name,
            triangles: world.triangles(),
            load_s,
            build_s: began.elapsed().as_secs_f64() - load_s,
            bytes: world_bytes + info.bytes,
            camera: input.camera.clone(),
            warnings: messages.clone(),
        };
        let noted = self.journal.add(&JournalRecord::Mesh(record));
        noted.inspect_err(|error| self.end(error.clone()))?;
        let accelerator = accelerator.as_ref();
        let frames: Vec<&Frame> = group.frames.iter().map(|&frame| &frames[frame]).collect();
        self.frames(&Built { input, films, world: &world, accelerator, info }, &frames);
        Ok(())
    }

    /// Renders frames on one thread per film. That is one more than frames are rendered at a time,
    /// if memory allows it: a frame can then be written while the next frames are traced.
    fn frames(&self, built: &Built, frames: &[&Frame]) {
        let next = AtomicUsize::new(0);
        let work = || {
            let mut film = None;
            while let Some(frame) = frames.get(next.fetch_add(1, Relaxed)) {
                if let Err(error) = guarded(|| self.frame(built, frame, &mut film)) {
                    self.failed(built.input.task.input, Some(frame.number), 1, error);
                }
                if self.stopped() {
                    return;
                }
            }
        };
        together(frames.len().min(built.films as usize), work);
    }

    fn frame(&self, built: &Built, frame: &Frame, film: &mut Option<Film>) -> Result<()> {
        // Made again here, while another frame is traced.
        let scene = &built.input.ready.frame(self.job, frame.number)?.scene;
        let plan = LayerPlan::new(scene);
        let (overscan, window) = checked_overscan(self.job.overscan, &scene.camera)?;
        let mut world = built.world.frame_of(scene).with_overscan(overscan);
        let adaptive = sampling::adaptive(&self.job.sampling, scene)?;
        if let Some(adaptive) = adaptive {
            (world.spp, world.area_spp) = (adaptive.most, adaptive.first);
        }
        let size = [scene.camera.width, scene.camera.height];
        let monitor = Arc::new(self.monitor.part());
        let permit = self.permits.take(built.input.number);
        if self.stopped() {
            return Ok(());
        }
        if let Some(reason) = &frame.again {
            (self.tell)(Event::Again { reason });
        }
        let files = create(frame, &plan, self.job.storage)
            .inspect_err(|error| self.end_if_shared(error))?;
        let film = match film {
            Some(film) if film.frame == size => film,
            film => {
                // Its memory must be free before the new one takes its own.
                *film = None;
                let blank = ReservedFilm::new(size, window, plan.layout.channels.clone())?;
                // Otherwise the film would need memory beside the memory that the build has freed.
                memory::release_freed();
                film.insert(self.pool.install(|| blank.film()))
            }
        };
        film.overscan = overscan;
        self.status.began(&monitor);
        let began = Instant::now();
        let (isa, accelerator) = (scene.backend.isa(), built.accelerator);
        let context = RenderContext { world: &world, accelerator, isa, monitor: &monitor };
        let counts = self.pool.install(|| match adaptive {
            Some(adaptive) => render_adaptive(context, film, &plan, adaptive).map(|(rays, _)| rays),
            None => render_layers(context, film, &plan, None),
        });
        let render_s = began.elapsed().as_secs_f64();
        drop(permit);
        let written = counts.map(|counts| {
            let more = adaptive.as_ref().map(sampling::attributes).unwrap_or_default();
            let spp = sampling::spp(adaptive.as_ref(), scene);
            let says = PictureHeader {
                more: &more,
                spp: Some(&spp),
                backend_version: &built.info.version,
                scene_hash: frame.hash.as_deref(),
                sequence: self.job.sequence(frame.number),
                legend: built.world.legend.as_ref(),
                fingerprint: frame.fingerprint.as_deref(),
                ..PictureHeader::default()
            };
            let storage = self.job.storage;
            let write = || {
                if self.job.strict {
                    let name = paths::with_ending(&frame.prefix, ".exr").display().to_string();
                    let counts = ValueCounts::count(film, |_, _| f32::MAX);
                    let help = "without --strict, NaN is written as 0 and infinity is clamped";
                    picture::check_finite(&counts, &name).map_err(|error| error.help(help))?;
                }
                picture::write(files, film, scene, says, storage, &monitor)
            };
            (counts, self.pool.install(write))
        });
        self.status.ended(&monitor);
        let (counts, written) = written?;
        let (written, oddities) = match written {
            Err(error) => {
                self.end_if_shared(&error);
                return Err(error);
            }
            Ok(written) => written,
        };
        let write_s = began.elapsed().as_secs_f64() - render_s;
        let warnings = self.warn_once(built.input, &picture::oddity_warnings(&oddities));
        // Somebody may have moved a frame as soon as it had its name: its open file is read.
        let (paths, open): (Vec<_>, Vec<_>) = written.into_iter().unzip();
        let xxh3 = open.into_iter().zip(&paths).map(|(file, path)| sum_of(file, path));
        let xxh3 = xxh3.collect::<Result<_>>();
        let xxh3 = xxh3.inspect_err(|error| self.end_if_shared(error))?;
        self.finished(&counts);
        let (input, name) = self.named(built.input.task.input);
        let record = FrameRecord {
            index: frame.index,
            input,
            name,
            frame: frame.number,
            outputs: paths
                .iter()
                .map(|path| seen_from(path, &self.job.folder).to_owned())
                .collect(),
            xxh3,
            again: frame.again.clone(),
            fingerprint: frame.fingerprint.clone(),
            render_s,
            write_s,
            rays: by_class(&counts),
            peak_bytes: memory::peak_bytes(),
            warnings,
        };
        let noted = self.journal.add(&JournalRecord::Frame(record));
        noted.inspect_err(|error| self.end(error.clone()))?;
        (self.tell)(Event::Frame { outputs: &paths });
        Ok(())
    }

    /// Reports the warnings of a frame that no other frame of the input had: the pictures of a
    /// turntable often share theirs. Returns the texts of all.
    fn warn_once(&self, input: &Input, problems: &[Problem]) -> Vec<String> {
        for problem in problems {
            if lock(&input.told).insert(problem.to_string()) {
                self.warn(input.path, std::slice::from_ref(problem));
            }
        }
        problems.iter().map(Problem::to_string).collect()
    }
}

/// Creates the part files of a frame and their folder.
fn create(frame: &Frame, plan: &LayerPlan, storage: Storage) -> Result<PictureFiles> {
    if let Some(folder) = frame.prefix.parent() {
        std::fs::create_dir_all(folder).map_err(|error| Error::io(folder, "create", &error))?;
    }
    PictureFiles::create(&frame.prefix, plan, storage)
}

fn by_class(counts: &RayCounts) -> std::collections::BTreeMap<String, u64> {
    let RayCounts { primary, shadow, reflection, .. } = *counts;
    let all = [("primary", primary), ("shadow", shadow), ("reflection", reflection)];
    all.map(|(name, count)| (name.to_string(), count)).into()
}
