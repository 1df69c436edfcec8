//! Names that flags accept as values.

use clap::ValueEnum;
use clap::builder::PossibleValue;

use crate::integrate::Relative;
use crate::output::exr::Compression;
use crate::output::tonemap::Depth;
use crate::scene::written::AcceleratorName;
use crate::scene::{SamplerKind, ToneOperator};
use crate::simd::Isa;
use crate::studio::{Axis, LightsFollow, Quality, Studio, Turning};

/// Gives the values of a type names on the command line, and help for each name.
macro_rules! names {
    ($type:ty: $($value:ident = $name:literal $(, $help:literal)?;)+) => {
        impl ValueEnum for $type {
            fn value_variants<'a>() -> &'a [Self] {
                &[$(Self::$value),+]
            }

            fn to_possible_value(&self) -> Option<PossibleValue> {
                Some(match self {
                    $(Self::$value => PossibleValue::new($name)$(.help($help))?,)+
                })
            }
        }
    };
}

names! { Compression:
    Zip = "zip", "zlib over 16 lines";
    Zips = "zips", "zlib over single lines";
    Piz = "piz", "Wavelets: good for grain";
    Rle = "rle", "Run lengths";
    None = "none", "No compression";
    Dwaa = "dwaa", "Lossy, small";
}

names! { Depth:
    Eight = "8";
    Sixteen = "16";
}

names! { AcceleratorName:
    Bvh = "bvh", "lightpath's own watertight BVH";
    Embree = "embree", "Intel Embree 4";
    Coursework = "coursework", "The coursework's BVH";
    Brute = "brute", "Every primitive: slow, the oracle";
}

names! { Isa:
    Portable = "portable", "Baseline of the processor architecture";
    Neon = "neon", "64-bit ARM";
    Avx2 = "avx2", "AVX2 and FMA";
    Avx512 = "avx512", "AVX-512 F, BW, DQ, VL";
}

names! { ToneOperator:
    Max = "max", "Divide by the largest value of the frame";
    Clamp = "clamp", "Clip at 1";
    Reinhard = "reinhard", "x / (1 + x)";
}

names! { SamplerKind:
    Sobol = "sobol", "Owen-scrambled Sobol: stratified";
    Random = "random", "Uniform and independent: the coursework's";
}

// What `--noise` is relative to.
names! { Relative:
    Pixel = "pixel", "Each pixel's own radiance: all pixels get the same relative error";
    Picture = "picture", "The frame's mean radiance, with a larger error where a pixel has more \
        samples: the lowest RMSE for the samples taken";
}

names! { Studio:
    Lamps = "lamps", "A key lamp and a fill lamp";
    Soft = "soft", "Light from all sides, and a large sun";
    Clay = "clay", "Light from all sides on grey clay, without the colours of the .ply";
}

names! { Quality:
    Draft = "draft", "1 sample a pixel";
    Normal = "normal", "4: the default";
    Final = "final", "16";
}

names! { Axis:
    X = "x", "x is up";
    Y = "y", "y is up";
    Z = "z", "z is up, as in scans and CAD";
}

names! { Turning:
    Object = "object", "The object with all shapes";
    Camera = "camera", "The camera";
}

names! { LightsFollow:
    Camera = "camera", "Light falls from the same side in every frame";
    Object = "object", "The lit side turns with the object";
}

/// Kinds of files that have a schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum SchemaName {
    /// Scene files
    Scene,
    /// Job files of `batch`
    Job,
}
