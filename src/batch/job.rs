//! Turns a job file and the command line's flags into a checked [`Job`], whose inputs all exist.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde_json::{Map, Value};

use crate::error::{Error, Failures, Result};
use crate::output::exr::Sequence;
use crate::output::tonemap::Depth;
use crate::picture::Storage;
use crate::poses::Poses;
use crate::render::sampling::Sampling;
use crate::scene::written::Name;
use crate::scene::{Overrides, escaped};
use crate::studio::{Appearance, Axis, LightsFollow, MARGIN, Template, Turning, Turntable};
use crate::{paths, studio, units};

use super::cameras::poses;
use super::description::{Input as Written, JobFile, TurntableKeys};
use super::flags::Flags;
use super::inputs;
use super::names::{self, NamePattern};
use super::places::Places;

/// Pointer that `--legend` sets. A legend that the whole job asks for is for the inputs that show a
/// property.
pub const LEGEND: &str = "/output/legend";

/// Output folder if none is given.
const FOLDER: &str = "out";

/// A checked batch job: inputs, template, turntable and output settings.
#[derive(Debug)]
pub struct Job {
    /// Scenes and meshes in the order in which they are rendered.
    pub inputs: Vec<JobInput>,
    /// Scene that shows the meshes.
    pub template: Template,
    /// Free space around a mesh at each border, as a fraction of the picture.
    pub margin: f64,
    /// How meshes look: smoothing, texture, colours, points, studio, ground.
    pub looks: Appearance,
    /// Turntable of each input. Without turntable and `poses`, an input has one frame.
    pub turntable: Option<Turntable>,
    /// List of cameras: each input has one frame per camera, in place of a turntable.
    pub poses: Option<Poses>,
    /// A point on the turntable's axis, if the job file sets it.
    pub pivot: Option<DVec3>,
    /// Samples on every area light, sun and environment per shading point, if a flag sets them.
    pub light_samples: Option<u32>,
    /// Drops triangles with invalid vertices.
    pub repair: bool,
    /// Reads mesh files instead of memory-mapping them.
    pub no_mmap: bool,
    /// Format of the pictures: compression, bit depth, parts.
    pub storage: Storage,
    /// A frame with a NaN or infinite pixel fails and is not written.
    pub strict: bool,
    /// Adaptive sampling.
    pub sampling: Sampling,
    /// Pixels that are rendered on every side of the camera's frame.
    pub overscan: u32,
    /// Frame rate in frames per second, as numerator and denominator.
    pub per_second: Option<(i32, u32)>,
    /// Output folder, relative to the working folder.
    pub folder: PathBuf,
    /// Name pattern of the frames within the output folder.
    pub name: NamePattern,
    /// Path of the job file.
    pub job_file: Option<PathBuf>,
    /// Where the job's settings were written.
    pub places: Places,
    /// Other files of the job beside its inputs: the template, the lists of cameras.
    pub files: Vec<PathBuf>,
}

/// A scene or mesh file of a job, with the settings for this file.
#[derive(Debug)]
pub struct JobInput {
    /// Path of the scene or mesh.
    pub path: PathBuf,
    /// Which axis of the mesh points up.
    pub up: Option<Axis>,
    /// Rotation of the mesh in degrees, in place of `up`.
    pub rotate: Option<[f64; 3]>,
    /// Overrides of the scene, in the order in which they are applied.
    pub overrides: Overrides,
    /// True if its legend is one of the whole job: without a property, the input goes without it.
    pub legend_of_job: bool,
}

impl Job {
    /// Checks a job file and returns the job.
    ///
    /// Its paths are relative to `base`; an empty `base` is the working folder. The output folder
    /// is relative to the working folder.
    ///
    /// # Errors
    /// All problems of the job: missing inputs, contradictions, two frames with the same name.
    pub fn check(file: JobFile, base: &Path, flags: Flags) -> Result<Self> {
        let mut failures = Failures::default();
        let mut found = Vec::new();
        let template = match &file.template {
            Some(path) => Template::file(&base.join(&path.0)),
            None => Ok(Template::studio(file.studio.unwrap_or_default())),
        };
        for (i, written) in file.inputs.iter().enumerate() {
            let files = input(written, &file, base, (&flags, template.as_ref().ok()), i);
            found.extend(failures.keep(files).into_iter().flatten());
        }
        let template = failures.keep(template);
        let poses = failures.keep(poses(&file, base, &flags)).flatten();
        let frames = file.turntable.as_ref().map_or(1, |turntable| turntable.frames);
        let frames = poses.as_ref().map_or(frames, |poses| poses.list.len() as u32);
        let pattern = match &file.output.name {
            Some(name) => name.0.as_str(),
            None if file.cameras.is_some() => NamePattern::IMAGES,
            None if file.turntable.is_some() => NamePattern::FRAMES,
            None => NamePattern::STILL,
        };
        let images = poses.iter().flat_map(|poses| &poses.list);
        let images: Vec<String> = images.map(|pose| pose.image.clone()).collect();
        let places = &flags.places;
        let name_place = places.at("/output/name");
        let name = NamePattern::parse(&name_place, pattern);
        // Without names, the list of cameras could not be read. That error is already kept.
        let named = |name: NamePattern| match file.cameras.is_some() && images.is_empty() {
            true => Ok(name),
            false => name.with_images(&name_place, images),
        };
        let name = failures.keep(name.and_then(named));
        if name.as_ref().is_some_and(NamePattern::has_image) {
            let bad_name = poses.as_ref().and_then(|poses| poses.bad_name.clone());
            failures.keep(bad_name.map_or(Ok(()), Err));
        }
        if let Some(name) = &name {
            for (number, input) in found.iter().enumerate() {
                failures.keep(name.check(&input.path, number));
            }
            let paths: Vec<&Path> = found.iter().map(|input| input.path.as_path()).collect();
            failures.keep(names::distinct(&name_place, (name, pattern), &paths, frames));
        }
        let both = file.up.is_some() && file.rotate.is_some();
        if both {
            let message = "found with `rotate`, expected one of the two";
            failures.keep::<()>(Err(Error::invalid(places.at("/up"), message)));
        }
        let rate = file.output.fps.as_ref().and_then(|Name(rate)| {
            let rate = units::parse_rate(rate);
            failures.keep(rate.map_err(|message| Error::invalid(places.at("/output/fps"), message)))
        });
        let depth = match file.output.pngbits {
            None | Some(8) => Depth::Eight,
            Some(16) => Depth::Sixteen,
            Some(bits) => {
                let message = format!("found {bits}, expected 8 or 16");
                let place = places.at("/output/pngbits");
                failures.keep::<()>(Err(Error::invalid(place, message)));
                Depth::Eight
            }
        };
        if let Some(Name(folder)) = &file.output.folder {
            failures.keep(paths::refuse_control_characters(Path::new(folder)));
        }
        failures.check()?;
        let (Some(template), Some(name)) = (template, name) else {
            return Err(Error::invalid("job", "cannot be read"));
        };
        let files = file.template.as_ref().map(|path| base.join(&path.0));
        let cameras = poses.iter().flat_map(|poses| poses.files.clone()).collect::<Vec<_>>();
        Ok(Self {
            inputs: found,
            template,
            margin: file.margin.unwrap_or(MARGIN),
            looks: Appearance {
                smooth: file.smooth,
                texture: file.texture.as_ref().map(|path| base.join(&path.0)),
                no_ground: file.ground == Some(false),
                quality: file.quality,
                studio: file.studio,
                color: file.color,
                points: file.points,
            },
            pivot: file.turntable.as_ref().and_then(|t| t.pivot).map(|pivot| pivot.vec()),
            turntable: file.turntable.as_ref().map(turntable),
            light_samples: flags.light_samples,
            repair: flags.repair,
            no_mmap: flags.no_mmap,
            storage: Storage {
                float: file.output.float,
                compression: file.output.compression,
                multipart: file.output.multipart,
                depth,
                crypto_sidecar: file.output.cryptosidecar,
            },
            strict: file.output.strict,
            sampling: Sampling {
                noise: file.noise,
                noise_of: file.noiseof,
                max_spp: file.maxspp,
                time: None,
            },
            overscan: file.overscan,
            per_second: rate,
            // Without `/.` at its end, which cannot be created.
            folder: file
                .output
                .folder
                .map_or(FOLDER.into(), |Name(folder)| Path::new(&folder).components().collect()),
            name,
            job_file: flags.file,
            places: flags.places,
            files: files.into_iter().chain(cameras).collect(),
            poses,
        })
    }

    /// Returns the number of frames per input.
    pub fn frames(&self) -> u32 {
        match &self.poses {
            Some(poses) => poses.list.len() as u32,
            None => self.turntable.map_or(1, |turntable| turntable.frames),
        }
    }

    /// Returns frame index and frame rate for the EXR header. There is no index if an input has
    /// one frame. A list of cameras is no sequence: its pictures have names, and stay what they are
    /// when others join or leave the list.
    pub fn sequence(&self, frame: u32) -> Sequence {
        let numbered = (self.frames() > 1 && self.poses.is_none()).then_some(frame);
        Sequence {
            frame: numbered.and_then(|frame| i32::try_from(frame).ok()),
            per_second: self.per_second,
        }
    }

    /// Returns the name of an input's first frame, which no other input has. Unlike the path of the
    /// input, it does not depend on how the input is given.
    pub fn identity(&self, input: usize) -> String {
        self.name.of(&self.inputs[input].path, input, 0).display().to_string()
    }

    /// Returns the path of a frame's files without the ending.
    pub fn prefix(&self, input: usize, frame: u32) -> PathBuf {
        self.folder.join(self.name.of(&self.inputs[input].path, input, frame))
    }
}

/// Returns the files of one entry of `inputs`. Overrides are applied in this order: the job's, the
/// entry's, the flags'. Later ones win.
fn input(
    written: &Written,
    file: &JobFile,
    base: &Path,
    (flags, template): (&Flags, Option<&Template>),
    number: usize,
) -> Result<Vec<JobInput>> {
    let none = Map::new();
    let (path, up, rotate, camera, set) = match written {
        Written::Path(path) => (path, None, None, &none, &none),
        Written::Entry(e) => (&e.path, e.up, e.rotate, &e.camera, &e.set),
    };
    let mut overrides = common(file, &flags.places)?;
    let entry = format!("/inputs/{number}");
    let own = patches(camera, set, &entry, &flags.places)?;
    let legend_of_job = match (flags.overrides.value(LEGEND), own.value(LEGEND)) {
        (Some(legend), _) => legend == true,
        (None, Some(_)) => false,
        (None, None) => overrides.value(LEGEND).is_some_and(|legend| legend == true),
    };
    overrides.append(own);
    let place = match flags.file {
        Some(_) => flags.places.at(&entry),
        None => "INPUT".to_string(),
    };
    let files = inputs::expand(&place, &path.0, base)?;
    if (up.is_some() || rotate.is_some()) && !files.iter().any(|file| studio::is_mesh(file)) {
        let key = if up.is_some() { "up" } else { "rotate" };
        return Err(without_mesh(&flags.places.at(&format!("{entry}/{key}"))));
    }
    // An entry's own `up` or `rotate` replaces both of the job's.
    let (up, rotate) = match (up, rotate) {
        (None, None) => (file.up, file.rotate),
        (Some(_), Some(_)) => {
            let message = "found `up` and `rotate`, expected one of the two";
            return Err(Error::invalid(place, message));
        }
        own if !flags.turned => own,
        _ => (file.up, file.rotate),
    };
    overrides.flags_follow();
    let one = |path: PathBuf| {
        let mut overrides = overrides.clone();
        if let (Some(template), true) = (template, studio::is_mesh(&path)) {
            // The mesh itself reports the error of a template without a trimesh.
            let _ = studio::flags_win(&flags.looks, flags.turned, template, &mut overrides);
        }
        overrides.append(flags.overrides.clone());
        let rotate = rotate.map(|angles| angles.0);
        JobInput { path, up, rotate, overrides, legend_of_job }
    };
    Ok(files.into_iter().map(one).collect())
}

/// Returns the error of the key `place`, which only meshes have, with scenes.
pub fn without_mesh(place: &str) -> Error {
    let message = "found with scenes, expected with a .ply file";
    Error::invalid(place, message).help("a scene sets this itself, and in its trimesh")
}

/// Returns the overrides that the job applies to every scene.
///
/// # Errors
/// Those of [`patches`].
fn common(file: &JobFile, places: &Places) -> Result<Overrides> {
    let mut all = Overrides::default();
    if let Some([width, height]) = file.size {
        all.flag(places.at("/size"), "/camera/width", Some(width));
        all.flag(places.at("/size"), "/camera/height", Some(height));
    }
    let layers = file.layers.as_ref();
    let layers = layers.map(|names| names.iter().map(|n| n.0.clone()).collect::<Vec<String>>());
    all.flag(places.at("/layers"), "/output/layers", layers);
    all.flag(places.at("/cryptoranks"), "/output/cryptoranks", file.cryptoranks);
    all.append(patches(&file.camera, &file.set, "", places)?);
    Ok(all)
}

/// Returns the overrides of the keys `camera` and `set` of the job, or of the entry `at`, in the
/// order of the file.
///
/// # Errors
/// `Invalid` for a `lookat` and a `target` in one object: one of them would have no effect.
fn patches(
    camera: &Map<String, Value>,
    set: &Map<String, Value>,
    at: &str,
    places: &Places,
) -> Result<Overrides> {
    for (keys, object, prefix) in [(camera, "camera", ""), (set, "set", "/camera/")] {
        let [lookat, target] = ["lookat", "target"].map(|key| format!("{prefix}{key}"));
        if keys.contains_key(&lookat) && keys.contains_key(&target) {
            let place = places.at(&format!("{at}/{object}/{}", escaped(&target)));
            let message =
                "found both `lookat` (a direction) and `target` (a point), expected exactly one";
            return Err(Error::invalid(place, message).help("remove one of them"));
        }
    }
    let mut all = Overrides::default();
    for (key, value) in camera {
        let place = places.at(&format!("{at}/camera/{}", escaped(key)));
        all.flag(place, &format!("/camera/{key}"), Some(value.clone()));
    }
    for (pointer, value) in set {
        let place = places.at(&format!("{at}/set/{}", escaped(pointer)));
        all.flag(place, pointer, Some(value.clone()));
    }
    Ok(all)
}

fn turntable(keys: &TurntableKeys) -> Turntable {
    let lights = keys.lights.unwrap_or(match keys.turn {
        Turning::Object => LightsFollow::Camera,
        Turning::Camera => LightsFollow::Object,
    });
    Turntable { frames: keys.frames, turn: keys.turn, lights, start_deg: keys.start }
}
