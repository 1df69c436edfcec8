//! Copies columns of rows that all have the same size into arrays.

use super::block::Uniform;
use super::header::PropertyType;
use super::plan::{ATTRIBUTE_ROLE_COUNT, Columns, ROLE_COUNT};
use super::scalar::{Native, Scalar};
use super::table::Table;
use crate::error::Result;
use crate::parallel::{self, GRAIN};
use crate::reserve;

/// Rows that all have the same size.
pub(super) struct Records<'a> {
    /// Name of the file, for errors.
    name: &'a str,
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
        Self { name: table.context.name, rows, stride: uniform.stride, big, roles }
    }

    /// Reads `N` roles, from `first` on, in place of what `all` has, with its capacity. `native` is
    /// the PLY type of `T`. If all these roles have it, values are taken as they are. Otherwise all
    /// are converted by way of f64.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub(super) fn columns<const N: usize, T: Native>(
        &self,
        all: &mut Vec<[T; N]>,
        first: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
    ) -> Result<()> {
        self.pack(all, first, native, convert, |values| values)
    }

    /// Reads one role as [`Self::columns`] does.
    pub(super) fn column<T: Native>(
        &self,
        all: &mut Vec<T>,
        role: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
    ) -> Result<()> {
        self.pack(all, role, native, convert, |[value]| value)
    }

    fn pack<const N: usize, T: Native, O: Clone + Send>(
        &self,
        all: &mut Vec<O>,
        first: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
        element: impl Fn([T; N]) -> O + Sync,
    ) -> Result<()> {
        let roles: [(Scalar, usize); N] = std::array::from_fn(|i| self.roles[first + i]);
        let (big, at) = (self.big, roles.map(|(_, at)| at));
        let native = roles.iter().all(|(kind, _)| *kind == native);
        // With its capacity: a mesh adds a vertex. Freed first: only one of the two has room.
        let capacity = std::mem::take(all).capacity();
        *all = reserve::filled(element([T::default(); N]), capacity, self.name)?;
        all.truncate(self.rows.len() / self.stride);
        let tasks = all.chunks_mut(GRAIN).zip(self.rows.chunks(GRAIN * self.stride));
        parallel::each(tasks, |(all, rows)| {
            let rows = all.iter_mut().zip(rows.chunks_exact(self.stride));
            if native {
                rows.for_each(|(to, row)| *to = element(at.map(|at| T::take(row, at, big))));
            } else {
                let read = |row| element(roles.map(|(kind, at)| convert(kind.read(row, at, big))));
                rows.for_each(|(to, row)| *to = read(row));
            }
        });
        Ok(())
    }
}

/// Index of the first attribute among all roles.
pub(super) const FIRST_ATTRIBUTE: usize = ROLE_COUNT - ATTRIBUTE_ROLE_COUNT;
