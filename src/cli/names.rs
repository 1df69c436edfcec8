//! Words that flags take.

use clap::ValueEnum;

use crate::studio;

/// Names of compressions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CompressionName {
    /// zlib over 16 lines
    Zip,
    /// zlib over single lines
    Zips,
    /// Wavelets: good for grain
    Piz,
    /// Run lengths
    Rle,
    /// Not at all
    None,
    /// Lossy, small
    Dwaa,
}

/// Names of the instruction sets.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum IsaName {
    /// What every processor of this kind has
    Portable,
    /// AVX2 and FMA
    Avx2,
    /// AVX-512 F, BW, DQ, VL
    Avx512,
}

/// Names of the tone curves.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum ToneName {
    /// Divide by the largest value of the frame
    Max,
    /// Clip at 1
    Clamp,
    /// x / (1 + x)
    Reinhard,
}

/// Names of the backends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// Intel Embree 4
    Embree,
    /// lightpath's own BVH
    Bvh,
    /// The coursework's BVH
    Coursework,
    /// Every primitive: slow, the oracle
    Brute,
}

/// An axis of a mesh file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    /// x is up
    X,
    /// y is up
    Y,
    /// z is up, as scanners and CAD have it
    Z,
}

impl Axis {
    /// As the studio has it.
    pub fn studio(self) -> studio::Axis {
        match self {
            Self::X => studio::Axis::X,
            Self::Y => studio::Axis::Y,
            Self::Z => studio::Axis::Z,
        }
    }
}

/// How progress is shown.
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

/// What turns on a turntable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TurningName {
    /// The object with all shapes
    Object,
    /// The camera
    Camera,
}

/// What lights stay with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FixedName {
    /// Light falls from the same side in every frame
    Camera,
    /// The lit side turns with the object
    Object,
}

impl TurningName {
    /// As the studio has it.
    pub fn studio(self) -> studio::Turning {
        match self {
            Self::Object => studio::Turning::Object,
            Self::Camera => studio::Turning::Camera,
        }
    }
}

impl FixedName {
    /// As the studio has it.
    pub fn studio(self) -> studio::Fixed {
        match self {
            Self::Camera => studio::Fixed::Camera,
            Self::Object => studio::Fixed::Object,
        }
    }
}

/// Files that have a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SchemaName {
    /// Scene files
    Scene,
    /// Job files of `batch`
    Job,
}
