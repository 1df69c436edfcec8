//! The eight number types of PLY: names, sizes and how their bytes are read.
//!
//! Every value of every type is exact in `f64`. So the general paths carry only `f64`, and the bulk
//! paths read the native type.

use serde::Serialize;

/// A number type of PLY. It is written out under its classic name; `int8`, `float32` etc. are
/// aliases.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Scalar {
    /// Signed 8-bit: `char` or `int8`.
    #[serde(rename = "char")]
    I8,
    /// Unsigned 8-bit: `uchar` or `uint8`.
    #[serde(rename = "uchar")]
    U8,
    /// Signed 16-bit: `short` or `int16`.
    #[serde(rename = "short")]
    I16,
    /// Unsigned 16-bit: `ushort` or `uint16`.
    #[serde(rename = "ushort")]
    U16,
    /// Signed 32-bit: `int` or `int32`.
    #[serde(rename = "int")]
    I32,
    /// Unsigned 32-bit: `uint` or `uint32`.
    #[serde(rename = "uint")]
    U32,
    /// Single precision: `float` or `float32`.
    #[serde(rename = "float")]
    F32,
    /// Double precision: `double` or `float64`.
    #[serde(rename = "double")]
    F64,
}

/// The valid type names, for error messages.
pub(super) const NAMES: &str = "char uchar short ushort int uint float double (or int8 uint8 \
     int16 uint16 int32 uint32 float32 float64)";

impl Scalar {
    /// Parses the name of a type.
    pub(super) fn parse(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Returns the classic name of the type, such as `uchar`.
    pub fn name(self) -> &'static str {
        match self {
            Self::I8 => "char",
            Self::U8 => "uchar",
            Self::I16 => "short",
            Self::U16 => "ushort",
            Self::I32 => "int",
            Self::U32 => "uint",
            Self::F32 => "float",
            Self::F64 => "double",
        }
    }

    /// Returns the size in bytes of one value in a binary file.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Returns true if this type can represent `value`, a number from an ASCII file.
    pub(super) fn holds(self, value: f64) -> bool {
        let (low, high) = match self {
            Self::I8 => (i8::MIN as f64, i8::MAX as f64),
            Self::U8 => (0.0, u8::MAX as f64),
            Self::I16 => (i16::MIN as f64, i16::MAX as f64),
            Self::U16 => (0.0, u16::MAX as f64),
            Self::I32 => (i32::MIN as f64, i32::MAX as f64),
            Self::U32 => (0.0, u32::MAX as f64),
            Self::F32 | Self::F64 => return true,
        };
        // NaN fails both comparisons, so no integer type holds it.
        value >= low && value <= high && (value as i64) as f64 == value
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
