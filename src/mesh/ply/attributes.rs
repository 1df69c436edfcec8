//! The optional arrays of vertices or of triangles: colours, their alpha, one scalar, and indices
//! of textures.

use super::context::ReadContext;
use super::plan::{ATTRIBUTE_ROLE_COUNT, AttributePlan, SCALAR};
use super::records::{FIRST_ATTRIBUTE, Records};
use super::scalar::Scalar;
use crate::error::Result;
use crate::mesh::arrays::{Colors, Scalars};
use crate::reserve;

/// Role of the first channel of a colour.
const COLOR: usize = FIRST_ATTRIBUTE;
/// Role of the alpha of a colour.
const ALPHA: usize = FIRST_ATTRIBUTE + 3;

/// The values of one row: colour (3), alpha, scalar, index of a texture. Values that are not read
/// are ignored.
pub(super) type RowAttributes = [f64; ATTRIBUTE_ROLE_COUNT];

/// Arrays with one entry per vertex or per triangle. Arrays that are not read are `None`.
#[derive(Debug, Default)]
pub(super) struct Attributes {
    pub(super) colors: Option<Colors>,
    pub(super) alpha: Option<Scalars>,
    pub(super) scalars: Option<Scalars>,
    /// For each triangle, the index of its texture.
    pub(super) textures: Option<Vec<u16>>,
}

/// A number of elements to reserve in an array.
#[derive(Clone, Copy)]
pub(super) enum Capacity {
    /// This many elements in total.
    Total(usize),
    /// This many elements more than there are.
    Additional(usize),
}

impl Capacity {
    pub(super) fn reserve<T>(&self, all: &mut Vec<T>, context: &ReadContext) -> Result<()> {
        match *self {
            Self::Total(count) => {
                reserve::exact(all, count.saturating_sub(all.len()), context.name)
            }
            Self::Additional(count) => reserve::growing(all, count, context.name),
        }
    }
}

/// Evaluates `$do` once for each array that is there, bound to `$all`.
macro_rules! each_array {
    ($attributes:expr, $all:ident => $do:expr) => {{
        let Attributes { colors, alpha, scalars, textures } = $attributes;
        if let Some($all) = textures {
            $do
        }
        match colors {
            Some(Colors::U8($all)) => $do,
            Some(Colors::U16($all)) => $do,
            Some(Colors::F32($all)) => $do,
            None => {}
        }
        for values in [alpha, scalars].into_iter().flatten() {
            match values {
                Scalars::U8($all) => $do,
                Scalars::U16($all) => $do,
                Scalars::F32($all) => $do,
                Scalars::F64($all) => $do,
            }
        }
    }};
}

impl Attributes {
    /// Returns the arrays that `plan` selects, empty.
    pub(super) fn new(plan: &AttributePlan) -> Self {
        let scalars = |kind| match kind {
            Scalar::U8 => Scalars::U8(Vec::new()),
            Scalar::U16 => Scalars::U16(Vec::new()),
            Scalar::F32 | Scalar::I8 | Scalar::I16 => Scalars::F32(Vec::new()),
            Scalar::F64 | Scalar::I32 | Scalar::U32 => Scalars::F64(Vec::new()),
        };
        Self {
            colors: plan.colors.map(|kind| match kind {
                Scalar::U8 => Colors::U8(Vec::new()),
                Scalar::U16 => Colors::U16(Vec::new()),
                _ => Colors::F32(Vec::new()),
            }),
            alpha: plan.alpha.map(scalars),
            scalars: plan.scalar.map(scalars),
            textures: (plan.textures > 0).then(Vec::new),
        }
    }

    /// Returns the size in bytes of all arrays.
    pub(super) fn bytes(&self) -> u64 {
        let mut sum = 0;
        each_array!(self, all => sum += size_of_val(&all[..]) as u64);
        sum
    }

    pub(super) fn reserve(&mut self, capacity: Capacity, context: &ReadContext) -> Result<()> {
        each_array!(self, all => capacity.reserve(all, context)?);
        Ok(())
    }

    /// Appends the next rows of the file, which were read with the same plan.
    pub(super) fn append(&mut self, next: Attributes) {
        if let (Some(all), Some(next)) = (&mut self.textures, next.textures) {
            all.extend(next);
        }
        match (&mut self.colors, next.colors) {
            (Some(Colors::U8(all)), Some(Colors::U8(next))) => all.extend(next),
            (Some(Colors::U16(all)), Some(Colors::U16(next))) => all.extend(next),
            (Some(Colors::F32(all)), Some(Colors::F32(next))) => all.extend(next),
            _ => {}
        }
        for (all, next) in [(&mut self.alpha, next.alpha), (&mut self.scalars, next.scalars)] {
            match (all, next) {
                (Some(Scalars::U8(all)), Some(Scalars::U8(next))) => all.extend(next),
                (Some(Scalars::U16(all)), Some(Scalars::U16(next))) => all.extend(next),
                (Some(Scalars::F32(all)), Some(Scalars::F32(next))) => all.extend(next),
                (Some(Scalars::F64(all)), Some(Scalars::F64(next))) => all.extend(next),
                _ => {}
            }
        }
    }

    /// Appends the values of one row.
    #[inline]
    pub(super) fn push(&mut self, row: &RowAttributes) {
        let &[r, g, b, alpha, scalar, texture] = row;
        if let Some(all) = &mut self.textures {
            all.push(texture as u16);
        }
        let rgb = [r, g, b];
        match &mut self.colors {
            Some(Colors::U8(all)) => all.push(rgb.map(|c| c as u8)),
            Some(Colors::U16(all)) => all.push(rgb.map(|c| c as u16)),
            Some(Colors::F32(all)) => all.push(rgb.map(|c| c as f32)),
            None => {}
        }
        for (all, value) in [(&mut self.alpha, alpha), (&mut self.scalars, scalar)] {
            match all {
                Some(Scalars::U8(all)) => all.push(value as u8),
                Some(Scalars::U16(all)) => all.push(value as u16),
                Some(Scalars::F32(all)) => all.push(value as f32),
                Some(Scalars::F64(all)) => all.push(value),
                None => {}
            }
        }
    }

    /// Reads all rows in bulk, into arrays with enough capacity.
    pub(super) fn fill(&mut self, records: &Records) {
        match &mut self.colors {
            Some(Colors::U8(all)) => records.columns(all, COLOR, Scalar::U8, |v| v as u8),
            Some(Colors::U16(all)) => records.columns(all, COLOR, Scalar::U16, |v| v as u16),
            Some(Colors::F32(all)) => records.columns(all, COLOR, Scalar::F32, |v| v as f32),
            None => {}
        }
        for (all, role) in [(&mut self.alpha, ALPHA), (&mut self.scalars, SCALAR)] {
            match all {
                Some(Scalars::U8(all)) => records.column(all, role, Scalar::U8, |v| v as u8),
                Some(Scalars::U16(all)) => records.column(all, role, Scalar::U16, |v| v as u16),
                Some(Scalars::F32(all)) => records.column(all, role, Scalar::F32, |v| v as f32),
                Some(Scalars::F64(all)) => records.column(all, role, Scalar::F64, |v| v),
                None => {}
            }
        }
    }

    /// Keeps the entries for which `keep` returns true.
    pub(super) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        each_array!(self, all => {
            let mut at = 0;
            all.retain(|_| {
                at += 1;
                keep(at - 1)
            });
        });
    }

    /// Drops the alpha if all values are 1, or if all are 0. In the second case it returns true:
    /// the program that wrote the file never set alpha.
    pub(super) fn drop_plain_alpha(&mut self) -> bool {
        let all = |value: f64| match &self.alpha {
            None => false,
            Some(Scalars::U8(all)) => all.iter().all(|a| f64::from(*a) == 255.0 * value),
            Some(Scalars::U16(all)) => all.iter().all(|a| f64::from(*a) == 65535.0 * value),
            Some(Scalars::F32(all)) => all.iter().all(|a| f64::from(*a) == value),
            Some(Scalars::F64(all)) => all.iter().all(|a| *a == value),
        };
        let (opaque, zero) = (all(1.0), all(0.0));
        if opaque || zero {
            self.alpha = None;
        }
        zero
    }
}
