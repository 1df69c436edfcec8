//! Copies columns of rows that all have the same size into arrays.

use rayon::prelude::*;

use super::block::Uniform;
use super::header::PropertyType;
use super::plan::{ATTRIBUTE_ROLE_COUNT, Columns, ROLE_COUNT};
use super::scalar::{Native, Scalar};
use super::table::Table;

/// Minimum number of rows per task.
const GRAIN: usize = 1 << 13;

/// Rows that all have the same size.
pub(super) struct Records<'a> {
    rows: &'a [u8],
    stride: usize,
    big: bool,
    /// Type and offset in a row of each role (x, y, z, normal, ...), of a list those of its items.
    /// They have no meaning for a role without a property, which callers do not read.
    roles: [(Scalar, usize); ROLE_COUNT],
}

impl<'a> Records<'a> {
    /// Returns the rows of `table`. `uniform` tells where they begin and how long one is.
    pub(super) fn new(table: &Table<'a>, columns: &Columns, uniform: &Uniform, big: bool) -> Self {
        let length = table.span.rows as usize * uniform.stride;
        let roles = columns.map(|column| {
            let Some(at) = column else {
                return (Scalar::U8, 0);
            };
            match table.element.properties[at].shape {
                PropertyType::Single(kind) => (kind, uniform.offsets[at]),
                PropertyType::List { item, .. } => (item, uniform.offsets[at]),
            }
        });
        let rows = &table.data[uniform.start..uniform.start + length];
        Self { rows, stride: uniform.stride, big, roles }
    }

    /// Reads `N` roles, from `first` on, into an array with enough capacity. `native` is the PLY
    /// type of `T`. If all these roles have it, values are taken as they are. Otherwise all are
    /// converted by way of f64.
    pub(super) fn columns<const N: usize, T: Native>(
        &self,
        all: &mut Vec<[T; N]>,
        first: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
    ) {
        self.pack(all, first, native, convert, |values| values);
    }

    /// Reads one role as [`Self::columns`] does.
    pub(super) fn column<T: Native>(
        &self,
        all: &mut Vec<T>,
        role: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
    ) {
        self.pack(all, role, native, convert, |[value]| value);
    }

    fn pack<const N: usize, T: Native, O: Send>(
        &self,
        all: &mut Vec<O>,
        first: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
        element: impl Fn([T; N]) -> O + Sync,
    ) {
        let roles: [(Scalar, usize); N] = std::array::from_fn(|i| self.roles[first + i]);
        let (big, at) = (self.big, roles.map(|(_, at)| at));
        let native = roles.iter().all(|(kind, _)| *kind == native);
        let read = |row: &[u8]| match native {
            true => element(at.map(|at| T::take(row, at, big))),
            false => element(roles.map(|(kind, at)| convert(kind.read(row, at, big)))),
        };
        let rows = self.rows.par_chunks_exact(self.stride).with_min_len(GRAIN);
        rows.map(read).collect_into_vec(all);
    }
}

/// Index of the first attribute among all roles.
pub(super) const FIRST_ATTRIBUTE: usize = ROLE_COUNT - ATTRIBUTE_ROLE_COUNT;
