//! The eight number types of PLY: names, sizes and how their bytes are read.
//!
//! Every value of every type is exact in `f64`, so the general paths carry only `f64`. The bulk
//! paths read the native type.

use serde::Serialize;

/// A number type of PLY. It is serialised as its classic name; `int8`, `float32` etc. are aliases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "&'static str")]
pub enum Scalar {
    /// Signed 8-bit: `char` or `int8`.
    I8,
    /// Unsigned 8-bit: `uchar` or `uint8`.
    U8,
    /// Signed 16-bit: `short` or `int16`.
    I16,
    /// Unsigned 16-bit: `ushort` or `uint16`.
    U16,
    /// Signed 32-bit: `int` or `int32`.
    I32,
    /// Unsigned 32-bit: `uint` or `uint32`.
    U32,
    /// Single precision: `float` or `float32`.
    F32,
    /// Double precision: `double` or `float64`.
    F64,
}

/// The valid type names, for error messages.
pub(super) const NAMES: &str = "char uchar short ushort int uint float double (or int8 uint8 \
     int16 uint16 int32 uint32 float32 float64)";

/// For each type, in the order of [`Scalar`]: name, alias, size in bytes, and range if it is an
/// integer.
const TYPES: [(Scalar, &str, &str, usize, [f64; 2]); 8] = [
    (Scalar::I8, "char", "int8", 1, [i8::MIN as f64, i8::MAX as f64]),
    (Scalar::U8, "uchar", "uint8", 1, [0.0, u8::MAX as f64]),
    (Scalar::I16, "short", "int16", 2, [i16::MIN as f64, i16::MAX as f64]),
    (Scalar::U16, "ushort", "uint16", 2, [0.0, u16::MAX as f64]),
    (Scalar::I32, "int", "int32", 4, [i32::MIN as f64, i32::MAX as f64]),
    (Scalar::U32, "uint", "uint32", 4, [0.0, u32::MAX as f64]),
    (Scalar::F32, "float", "float32", 4, [0.0; 2]),
    (Scalar::F64, "double", "float64", 8, [0.0; 2]),
];

impl Scalar {
    /// Returns the type with this name or alias.
    pub(super) fn parse(word: &[u8]) -> Option<Self> {
        let named = |name: &str| name.as_bytes() == word;
        TYPES.iter().find(|of| named(of.1) || named(of.2)).map(|of| of.0)
    }

    /// Returns the classic name of the type, such as `uchar`.
    pub fn name(self) -> &'static str {
        TYPES[self as usize].1
    }

    /// Returns the size in bytes of one value in a binary file.
    #[inline]
    pub(super) fn size(self) -> usize {
        TYPES[self as usize].3
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Returns true if this type can represent `value`, a number from an ASCII file. A float type
    /// can represent every value, rounded.
    pub(super) fn holds(self, value: f64) -> bool {
        let (.., [low, high]) = TYPES[self as usize];
        // NaN fails both comparisons, so no integer type holds it.
        !self.is_integer() || value >= low && value <= high && (value as i64) as f64 == value
    }

    /// Reads the value at byte `at`. The caller has checked that it ends inside `bytes`.
    #[inline]
    pub(super) fn read(self, bytes: &[u8], at: usize, big: bool) -> f64 {
        match self {
            Self::I8 => bytes[at] as i8 as f64,
            Self::U8 => bytes[at] as f64,
            Self::I16 => i16::take(bytes, at, big) as f64,
            Self::U16 => u16::take(bytes, at, big) as f64,
            Self::I32 => i32::take(bytes, at, big) as f64,
            Self::U32 => u32::take(bytes, at, big) as f64,
            Self::F32 => f32::take(bytes, at, big) as f64,
            Self::F64 => f64::take(bytes, at, big),
        }
    }
}

impl From<Scalar> for &'static str {
    fn from(kind: Scalar) -> Self {
        kind.name()
    }
}

/// A native number that can be read from bytes in either byte order.
pub(super) trait Native: Copy + Send + Sync {
    /// Reads the value at byte `at`. Panics if it does not end inside `bytes`.
    fn take(bytes: &[u8], at: usize, big: bool) -> Self;
}

macro_rules! native {
    ($($t:ty),*) => {$(
        impl Native for $t {
            #[inline(always)]
            fn take(bytes: &[u8], at: usize, big: bool) -> Self {
                let mut raw = [0; size_of::<$t>()];
                raw.copy_from_slice(&bytes[at..at + size_of::<$t>()]);
                if big { <$t>::from_be_bytes(raw) } else { <$t>::from_le_bytes(raw) }
            }
        }
    )*};
}
native!(i8, u8, i16, u16, i32, u32, f32, f64);
