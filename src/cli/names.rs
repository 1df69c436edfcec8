//! Names that flags accept as values.

use clap::{ValueEnum, builder::PossibleValue};

use crate::{
    integrate::Relative,
    output::{exr::Compression, tonemap::Depth},
    scene::{Backend, written::Accelerator},
    studio,
};

impl ValueEnum for Compression {
    fn value_variants<'a>() -> &'a [Self] {
        Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let help = match self {
            Self::Zip => "zlib over 16 lines",
            Self::Zips => "zlib over single lines",
            Self::Piz => "Wavelets: good for grain",
            Self::Rle => "Run lengths",
            Self::None => "Not at all",
            Self::Dwaa => "Lossy, small",
        };
        Some(PossibleValue::new(self.name()).help(help))
    }
}

impl ValueEnum for Depth {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Eight, Self::Sixteen]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(match self {
            Self::Eight => "8",
            Self::Sixteen => "16",
        }))
    }
}

impl ValueEnum for Accelerator {
    fn value_variants<'a>() -> &'a [Self] {
        &[Self::Bvh, Self::Embree, Self::Coursework, Self::Brute]
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        let help = match self {
            Self::Bvh => "lightpath's own watertight BVH",
            Self::Embree => "Intel Embree 4",
            Self::Coursework => "The coursework's BVH",
            Self::Brute => "Every primitive: slow, the oracle",
        };
        Some(PossibleValue::new(Backend::from(*self).name()).help(help))
    }
}

/// Names of instruction sets.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum IsaName {
    /// Baseline of the processor architecture
    Portable,
    /// AVX2 and FMA
    Avx2,
    /// AVX-512 F, BW, DQ, VL
    Avx512,
}

/// Names of tone curves.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum ToneName {
    /// Divide by the largest value of the frame
    Max,
    /// Clip at 1
    Clamp,
    /// x / (1 + x)
    Reinhard,
}

/// Names of the pixel samplers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SamplerName {
    /// Owen-scrambled Sobol: stratified
    Sobol,
    /// Uniform and independent: the coursework's
    Random,
}

/// Names of what `--noise` is relative to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum NoiseOf {
    /// Each pixel's own radiance: all pixels get the same relative error
    Pixel,
    /// The frame's mean radiance, and more where a pixel has more samples: the lowest RMSE for the
    /// samples taken
    Picture,
}

impl NoiseOf {
    /// Converts to the renderer's type.
    pub fn relative(self) -> Relative {
        match self {
            Self::Pixel => Relative::Pixel,
            Self::Picture => Relative::Picture,
        }
    }
}

/// Names of the axes of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    /// x is up
    X,
    /// y is up
    Y,
    /// z is up, as in scans and CAD
    Z,
}

impl Axis {
    /// Converts to the studio's type.
    pub fn studio(self) -> studio::Axis {
        match self {
            Self::X => studio::Axis::X,
            Self::Y => studio::Axis::Y,
            Self::Z => studio::Axis::Z,
        }
    }
}

/// Names of the ways to show progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ProgressMode {
    /// A bar on a terminal, else plain
    Auto,
    /// A line every 3 seconds
    Plain,
    /// One JSON object per line
    Json,
    /// Open Job Description, on stdout
    Openjd,
    /// `ALF_PROGRESS 50%` on stdout: Tractor, Deadline
    Alf,
    /// Nothing
    Off,
}

/// Names of what turns on a turntable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TurningName {
    /// The object with all shapes
    Object,
    /// The camera
    Camera,
}

/// Names of what the lights are fixed to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FixedName {
    /// Light falls from the same side in every frame
    Camera,
    /// The lit side turns with the object
    Object,
}

impl TurningName {
    /// Converts to the studio's type.
    pub fn studio(self) -> studio::Turning {
        match self {
            Self::Object => studio::Turning::Object,
            Self::Camera => studio::Turning::Camera,
        }
    }
}

impl FixedName {
    /// Converts to the studio's type.
    pub fn studio(self) -> studio::LightsFollow {
        match self {
            Self::Camera => studio::LightsFollow::Camera,
            Self::Object => studio::LightsFollow::Object,
        }
    }
}

/// Kinds of files that have a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SchemaName {
    /// Scene files
    Scene,
    /// Job files of `batch`
    Job,
}
