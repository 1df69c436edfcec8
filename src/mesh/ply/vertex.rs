//! Vertex rows into arrays: in bulk from records of one size, else row by row.

use rayon::prelude::*;

use super::block::Uniform;
use super::header::Shape;
use super::plan::{ColorType, ROLES, Step, VertexPlan};
use super::row::{Row, Values};
use super::scalar::{Native, Scalar};
use super::table::{Sink, Table};
use crate::error::Result;
use crate::mesh::{Colors, Positions};

/// Fewest vertices that are worth a task.
const GRAIN: usize = 1 << 13;

/// Room for the unused vertex that accelerators want behind the last one.
const SPARE: usize = 1;

/// The arrays of element `vertex`.
pub(super) struct Vertices {
    pub(super) positions: Positions,
    pub(super) normals: Option<Vec<[f32; 3]>>,
    pub(super) uvs: Option<Vec<[f32; 2]>>,
    pub(super) colors: Option<Colors>,
}

/// Reads the arrays that `plan` asks for.
pub(super) fn read(table: &Table, plan: &VertexPlan) -> Result<Vertices> {
    match (&table.span.uniform, table.big) {
        (Some(uniform), Some(big)) => Ok(in_bulk(table, plan, uniform, big)),
        _ => row_by_row(table, plan),
    }
}

/// Rows of one size.
struct Records<'a> {
    rows: &'a [u8],
    stride: usize,
    big: bool,
    /// Type and offset of each role.
    roles: [(Scalar, usize); ROLES],
}

fn in_bulk(table: &Table, plan: &VertexPlan, uniform: &Uniform, big: bool) -> Vertices {
    let length = table.element.count as usize * uniform.stride;
    let roles = plan.columns.map(|column| {
        let Some(at) = column else {
            return (Scalar::U8, 0);
        };
        match table.element.properties[at].shape {
            Shape::Single(kind) => (kind, uniform.offsets[at]),
            Shape::List { item, .. } => (item, uniform.offsets[at]),
        }
    });
    let rows = &table.data[uniform.start..uniform.start + length];
    let records = Records { rows, stride: uniform.stride, big, roles };
    Vertices {
        positions: if plan.double {
            Positions::F64(records.columns(0, Scalar::F64, |v| v))
        } else {
            Positions::F32(records.columns(0, Scalar::F32, |v| v as f32))
        },
        normals: plan.normals.then(|| records.columns(3, Scalar::F32, |v| v as f32)),
        uvs: plan.uvs.then(|| records.columns(6, Scalar::F32, |v| v as f32)),
        colors: plan.colors.map(|kind| match kind {
            ColorType::U8 => Colors::U8(records.columns(8, Scalar::U8, |v| v as u8)),
            ColorType::U16 => Colors::U16(records.columns(8, Scalar::U16, |v| v as u16)),
            ColorType::F32 => Colors::F32(records.columns(8, Scalar::F32, |v| v as f32)),
        }),
    }
}

impl Records<'_> {
    /// `N` roles from `first` on as an array: copied where they are stored as `T`, whose name is
    /// `native`, else converted one by one.
    fn columns<const N: usize, T: Native>(
        &self,
        first: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
    ) -> Vec<[T; N]> {
        let roles: [(Scalar, usize); N] = std::array::from_fn(|i| self.roles[first + i]);
        let big = self.big;
        let rows = self.rows.par_chunks_exact(self.stride).with_min_len(GRAIN);
        let mut all = Vec::with_capacity(rows.len() + SPARE);
        if roles.iter().all(|(kind, _)| *kind == native) {
            let at = roles.map(|(_, at)| at);
            rows.map(|row| at.map(|at| T::take(row, at, big))).collect_into_vec(&mut all);
        } else {
            let read = |row| roles.map(|(kind, at)| convert(kind.read(row, at, big)));
            rows.map(read).collect_into_vec(&mut all);
        }
        all
    }
}

fn row_by_row(table: &Table, plan: &VertexPlan) -> Result<Vertices> {
    let parts = table.blocks(|reader| {
        let mut part = Part { plan, points: Vec::new(), others: Vec::new() };
        // The rows are in the file: as many as its bytes allow.
        let rows = reader.rows() as usize;
        part.points.reserve_exact(rows);
        if plan.normals || plan.uvs || plan.colors.is_some() {
            part.others.reserve_exact(rows);
        }
        reader.feed(&mut part)?;
        Ok(part)
    })?;
    let count = table.element.count as usize;
    Ok(Vertices {
        positions: if plan.double {
            Positions::F64(join(&parts, count, |part| part.points.iter().copied()))
        } else {
            Positions::F32(join(&parts, count, |p| p.points.iter().map(|v| v.map(|c| c as f32))))
        },
        normals: plan
            .normals
            .then(|| join(&parts, count, |p| p.others.iter().map(|v| [v[0], v[1], v[2]]))),
        uvs: plan.uvs.then(|| join(&parts, count, |p| p.others.iter().map(|v| [v[3], v[4]]))),
        colors: plan.colors.map(|kind| match kind {
            ColorType::U8 => Colors::U8(colors(&parts, count, |c| c as u8)),
            ColorType::U16 => Colors::U16(colors(&parts, count, |c| c as u16)),
            ColorType::F32 => Colors::F32(colors(&parts, count, |c| c)),
        }),
    })
}

/// The vertices of one block of rows.
struct Part<'a> {
    plan: &'a VertexPlan,
    points: Vec<[f64; 3]>,
    /// Normal, texture coordinate, colour (integers up to 16 bits are exact).
    others: Vec<[f32; ROLES - 3]>,
}

impl Sink for Part<'_> {
    fn take<R: Row>(&mut self, values: &mut R, _: u64) -> Values<()> {
        let mut roles = [0.0; ROLES];
        for step in &self.plan.steps {
            match *step {
                Step::Value(kind, role) => roles[role] = values.number(kind)?,
                Step::Skip(kind) => values.skip(kind, 1)?,
                Step::SkipList { count, item }
                | Step::Corners { count, item }
                | Step::Texcoords { count, item } => {
                    let count = values.count(count)?;
                    values.skip(item, count)?;
                }
            }
        }
        self.points.push([roles[0], roles[1], roles[2]]);
        if self.others.capacity() > 0 {
            self.others.push(std::array::from_fn(|i| roles[3 + i] as f32));
        }
        Ok(())
    }
}

fn join<'a, T, I: Iterator<Item = T>>(
    parts: &'a [Part<'a>],
    count: usize,
    values: impl Fn(&'a Part<'a>) -> I,
) -> Vec<T> {
    let mut all = Vec::with_capacity(count + SPARE);
    for part in parts {
        all.extend(values(part));
    }
    all
}

fn colors<T>(parts: &[Part], count: usize, convert: impl Fn(f32) -> T + Copy) -> Vec<[T; 3]> {
    join(parts, count, |p| p.others.iter().map(move |v| [v[5], v[6], v[7]].map(convert)))
}
