//! Flags that several commands have, in groups for `#[command(flatten)]`. Each flag is declared
//! once, so its help and its checks are the same everywhere.

use std::path::{Path, PathBuf};

use clap::{ArgAction, Args, ValueHint};

use crate::error::{Error, Result};
use crate::integrate::Relative;
use crate::output::ValueCounts;
use crate::output::exr::Compression;
use crate::picture;
use crate::render::sampling::Sampling;
use crate::scene::written::{AcceleratorName, ColorMap, MeshColorDescription};
use crate::scene::{SamplerKind, ToneOperator};
use crate::simd::Isa;
use crate::studio::{Appearance, Axis, Quality, Studio, smooth};
use crate::threads::Pool;
use crate::units::{parse_angles, parse_bytes, parse_margin, parse_size, parse_smooth, parse_two};

use super::{machine, print};

/// Flags that change the scene.
#[derive(Debug, Args)]
#[command(next_help_heading = "Scene (overrides values of the file)")]
pub struct SceneArgs {
    #[command(flatten)]
    pub picture: SizeArgs,

    /// Camera samples per pixel
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub spp: Option<u32>,

    /// Samples on every area light, sun and environment per shading point
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub light_samples: Option<u32>,

    /// Number of lights that each shading point draws, in place of all: for scenes of many lights
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub emitter_samples: Option<u32>,

    /// Trace a quarter of an area light's shadow rays first, and the rest only if these disagree or
    /// a randomly drawn point contradicts them: fewer rays, the same mean
    #[arg(long)]
    pub adaptive_shadows: bool,

    /// Maximum number of mirror bounces after the primary ray
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub nbounces: Option<u32>,

    /// Seed of all random choices
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub seed: Option<i64>,

    /// How sample points are chosen
    #[arg(long, value_name = "NAME")]
    pub sampler: Option<SamplerKind>,

    /// Exposure of the PNG in stops
    #[arg(long, value_name = "STOPS", allow_negative_numbers = true)]
    pub exposure: Option<f64>,

    /// Tone curve of the PNG
    #[arg(long, value_name = "OP")]
    pub tonemap: Option<ToneOperator>,

    /// Full vertical angle of view in degrees
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub fov: Option<f64>,

    /// Backend that traces the rays [default: the scene's, else bvh]
    #[arg(long, value_name = "NAME")]
    pub backend: Option<AcceleratorName>,

    /// Write coverage to alpha instead of 1, without the background; the studio's ground then only
    /// shows the shadows on it
    #[arg(long)]
    pub transparent: bool,

    /// Draw the colour map of --color PROPERTY into the PNG, with ticks and the property's name
    #[arg(long)]
    pub legend: bool,

    /// Layers of the EXR: Z, distance, P, N, Ng, Ncam, facing, albedo, uv, ao, diffuse, specular,
    /// ambient, reflection, background (components: these five), light_GROUP (light: of all
    /// groups), shadow_GROUP (shadow), variance, samples, primid, objectid, cryptomatte; or all but
    /// ao: all
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub aov: Option<Vec<String>>,

    /// Number of objects that one pixel of a cryptomatte can hold: 2, 4... 16 [default: 6]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub crypto_ranks: Option<i64>,

    /// Set any value of the scene; VALUE is JSON, or else a string; repeatable, wins over flags
    #[arg(long, value_name = "/json/pointer=VALUE")]
    pub set: Vec<String>,

    /// Render only these pixels, from the top left; X1 and Y1 are excluded
    #[arg(long, action = ArgAction::Set, num_args = 4, allow_negative_numbers = true, conflicts_with = "overscan", value_names = ["X0", "Y0", "X1", "Y1"])]
    pub crop: Option<Vec<u32>>,

    /// Render PX more pixels on every side of the frame; the EXR's display window stays the frame
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(..=65536))]
    pub overscan: Option<u32>,
}

/// Flags for an error of the picture, which decides the number of samples of each pixel.
#[derive(Debug, Args)]
pub struct NoiseArgs {
    /// Take more samples where the relative standard error around a pixel is above TARGET, e.g.
    /// 0.02. Every pixel gets at least --spp samples, rounded up to a power of two, and at least 16
    /// (with adaptive shadows 32)
    #[arg(long, value_name = "TARGET", allow_negative_numbers = true)]
    pub noise: Option<f64>,

    /// What TARGET is relative to: the pixel or the whole picture [default: pixel]
    #[arg(long, value_name = "OF")]
    pub noise_of: Option<Relative>,

    /// Maximum number of samples per pixel with --noise or --time, a power of two [default: 4096
    /// with --noise, else 65536]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub max_spp: Option<u32>,
}

impl NoiseArgs {
    /// Returns the adaptive sampling that the flags ask for.
    pub fn sampling(&self) -> Sampling {
        let Self { noise, noise_of, max_spp } = *self;
        Sampling { noise, noise_of, max_spp, time: None }
    }
}

/// Flags for the look of meshes.
#[derive(Debug, Args)]
pub struct LookArgs {
    /// Interpolate normals of the .ply across edges of at most DEGREES, across all edges or none
    /// [default: the template's; in the studio 57, between flat parts 44]
    #[arg(long, value_name = "DEGREES|all|off", value_parser = parse_smooth, allow_negative_numbers = true)]
    pub smooth: Option<f64>,

    /// Image for the texture coordinates of the .ply
    #[arg(long, value_name = "FILE", value_hint = ValueHint::FilePath)]
    pub texture: Option<PathBuf>,

    /// Colours of the .ply: of its vertices, of its faces, none, or a numeric property of them (see
    /// `info`) through a colour map [default: vertex, else face]
    #[arg(long, value_name = "vertex|face|none|PROPERTY")]
    pub color: Option<String>,

    /// Colour map of --color PROPERTY [default: viridis]
    #[arg(long, value_name = "NAME", requires = "color")]
    pub color_map: Option<ColorMap>,

    /// Numbers at the ends of the colour map [default: those of the .ply]
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_two, allow_hyphen_values = true, requires = "color")]
    pub color_range: Option<[f64; 2]>,

    /// Draw every vertex of the .ply as a sphere of this radius, in the units of the file, in place
    /// of its faces
    #[arg(long, value_name = "RADIUS", allow_negative_numbers = true)]
    pub points: Option<f64>,

    /// Light of the built-in studio [default: lamps]
    #[arg(long, value_name = "NAME")]
    pub studio: Option<Studio>,

    /// Short for --studio clay
    #[arg(long, conflicts_with = "studio")]
    pub clay: bool,

    /// Camera samples of the built-in studio; --spp wins
    #[arg(long, value_name = "NAME")]
    pub quality: Option<Quality>,

    /// Remove the plane named `ground`; without this flag, --transparent keeps its shadows in the
    /// studio
    #[arg(long)]
    pub no_ground: bool,
}

impl LookArgs {
    /// Converts the flags to [`Appearance`].
    ///
    /// # Errors
    /// A colour map or range for colours that the file stores.
    pub fn appearance(&self) -> Result<Appearance> {
        let mut color = self.color.as_deref().map(MeshColorDescription::from_name);
        match &mut color {
            Some(MeshColorDescription::Property(color)) => {
                color.map = self.color_map.unwrap_or(color.map);
                color.range = self.color_range;
            }
            Some(MeshColorDescription::Stored(_)) => {
                let flags = [
                    ("--color-map", self.color_map.is_some()),
                    ("--color-range", self.color_range.is_some()),
                ];
                if let Some((flag, _)) = flags.into_iter().find(|(_, given)| *given) {
                    let found = self.color.as_deref().unwrap_or_default();
                    let message = format!("found with --color {found}, expected --color PROPERTY");
                    return Err(Error::invalid(flag, message));
                }
            }
            None => {}
        }
        Ok(Appearance {
            smooth: self.smooth.map(smooth),
            texture: self.texture.clone(),
            no_ground: self.no_ground,
            quality: self.quality,
            studio: self.studio.or(self.clay.then_some(Studio::Clay)),
            color,
            points: self.points,
        })
    }
}

/// Refuses flags that apply only to a mesh without a scene. `found` names the inputs, none of which
/// is a mesh.
///
/// # Errors
/// The first of these flags that was given.
pub fn refuse_mesh_flags(
    (placement, template, looks): (&PlacementArgs, Option<&Path>, &LookArgs),
    found: &str,
) -> Result<()> {
    let flags = [
        ("--up", placement.up.is_some()),
        ("--rotate", placement.rotate.is_some()),
        ("--margin", placement.margin.is_some()),
        ("--template", template.is_some()),
        ("--smooth", looks.smooth.is_some()),
        ("--texture", looks.texture.is_some()),
        ("--color", looks.color.is_some()),
        ("--points", looks.points.is_some()),
        ("--no-ground", looks.no_ground),
        ("--quality", looks.quality.is_some()),
        ("--studio", looks.studio.is_some()),
        ("--clay", looks.clay),
    ];
    let Some((flag, _)) = flags.into_iter().find(|(_, given)| *given) else {
        return Ok(());
    };
    let message = format!("found with {found}, expected with a .ply file");
    Err(Error::invalid(flag, message).help(
        "a scene sets camera, lights and materials, and in its trimesh `rotate`, `smooth`, `color`, \
         `points`",
    ))
}

/// Flags for threads, instruction set and memory.
#[derive(Debug, Args)]
#[command(next_help_heading = "Machine")]
pub struct MachineArgs {
    #[command(flatten)]
    pub workers: WorkerArgs,

    /// Use the fast mode of `embree`: a little faster, may miss hits on shared edges
    #[arg(long)]
    pub fast: bool,

    /// Instruction set of `bvh` and of shading [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<Isa>,

    /// Refuse or stop rather than use more memory, e.g. 8G or 512MiB (G = GiB = 2^30)
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub max_memory: Option<u64>,
}

/// The number of worker threads.
#[derive(Debug, Args)]
pub struct WorkerArgs {
    /// Worker threads [default: SLURM_CPUS_PER_TASK, else all that this process may use]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

impl WorkerArgs {
    /// Starts a pool of the worker threads.
    ///
    /// # Errors
    /// `Retry` if the system cannot start that many.
    pub fn pool(&self) -> Result<Pool> {
        machine::pool(self.threads)
    }
}

/// The instruction set of the kernels.
#[derive(Debug, Args)]
pub struct KernelArgs {
    /// Instruction set of our own kernels [default: the best of this machine]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<Isa>,
}

impl KernelArgs {
    /// Returns the instruction set of `--isa`, or the best of this machine.
    ///
    /// # Errors
    /// `Unsupported` if this machine or this build lacks it.
    pub fn isa(&self) -> Result<Isa> {
        self.isa.map_or(Ok(Isa::detect()), |isa| isa.supported("--isa"))
    }
}

/// How much a command without a progress display prints to stderr.
#[derive(Debug, Args)]
pub struct MessageArgs {
    /// Only errors on stderr
    #[arg(long)]
    pub quiet: bool,
}

impl MessageArgs {
    /// Prints a message to stderr unless `--quiet` is given.
    pub fn note(&self, text: &str) {
        if !self.quiet {
            print::note(text);
        }
    }
}

/// The size of the picture.
#[derive(Debug, Args)]
pub struct SizeArgs {
    /// Picture size in pixels
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
}

/// Overrides of a scene for commands without the flags of [`SceneArgs`].
#[derive(Debug, Args)]
pub struct SetArgs {
    /// Set any value of the scene; VALUE is JSON, or else a string; repeatable
    #[arg(long, value_name = "/json/pointer=VALUE")]
    pub set: Vec<String>,
}

/// Flags for the placement of a mesh without a scene.
#[derive(Debug, Args)]
pub struct PlacementArgs {
    /// Which axis of the .ply points up [default: y]
    #[arg(long, value_name = "AXIS")]
    pub up: Option<Axis>,

    /// Rotate the .ply by degrees about its x, then y, then z axis, in place of --up
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_angles, allow_hyphen_values = true, conflicts_with = "up")]
    pub rotate: Option<[f64; 3]>,

    /// Free space around the mesh at each border, as a fraction of the picture [default: 0.08]
    #[arg(long, value_name = "FRACTION", value_parser = parse_margin, allow_negative_numbers = true)]
    pub margin: Option<f64>,
}

/// Flags for reading mesh files.
#[derive(Debug, Args)]
pub struct MeshReadArgs {
    /// Drop triangles that use missing or non-finite vertices instead of refusing the mesh
    #[arg(long)]
    pub repair: bool,

    /// Read mesh files instead of mapping them into memory
    #[arg(long)]
    pub no_mmap: bool,
}

/// Flags for the values in EXR files.
#[derive(Debug, Args)]
pub struct ExrArgs {
    /// Store 32-bit floats in the EXR instead of 16-bit floats
    #[arg(long)]
    pub float: bool,

    /// Compression of the EXR; dwaa is lossy
    #[arg(long, value_name = "NAME")]
    pub compression: Option<Compression>,
}

/// The division of EXR files into parts.
#[derive(Debug, Args)]
pub struct MultipartArgs {
    /// Write one part of the EXR per layer
    #[arg(long)]
    pub multipart: bool,
}

/// Flags for the files of one picture, which share a prefix.
#[derive(Debug, Args)]
pub struct PrefixArgs {
    /// Write the object names of cryptomattes to PREFIX.CryptoObject.json and
    /// PREFIX.CryptoMaterial.json instead of the EXR's header
    #[arg(long)]
    pub crypto_sidecar: bool,

    /// Fail (exit code 1) if a pixel is NaN or infinite; the files are written all the same
    #[arg(long)]
    pub strict: bool,
}

impl PrefixArgs {
    /// Checks the values that were written, if `--strict` was given.
    ///
    /// # Errors
    /// `Check` if some are NaN or infinite.
    pub fn check(&self, values: &ValueCounts) -> Result<()> {
        match self.strict {
            true => picture::check_finite(values, "--strict"),
            false => Ok(()),
        }
    }
}
