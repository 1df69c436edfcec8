//! Vertex rows into arrays: in bulk from records of one size, else row by row.

use rayon::prelude::*;

use super::block::Uniform;
use super::header::Shape;
use super::plan::{ColorType, ROLES, Step, VertexPlan};
use super::row::{Row, Values};
use super::scalar::{Native, Scalar};
use super::table::{Reader, Sink, Table};
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

impl Vertices {
    /// Makes room for `count` vertices in all.
    pub(super) fn reserve(&mut self, count: usize) {
        fn room<T>(all: &mut Vec<T>, count: usize) {
            all.reserve_exact((count + SPARE).saturating_sub(all.len()));
        }
        match &mut self.positions {
            Positions::F32(all) => room(all, count),
            Positions::F64(all) => room(all, count),
        }
        if let Some(all) = &mut self.normals {
            room(all, count);
        }
        if let Some(all) = &mut self.uvs {
            room(all, count);
        }
        match &mut self.colors {
            Some(Colors::U8(all)) => room(all, count),
            Some(Colors::U16(all)) => room(all, count),
            Some(Colors::F32(all)) => room(all, count),
            None => {}
        }
    }

    /// Adds vertices that follow in the file, read by the same plan.
    pub(super) fn append(&mut self, next: Vertices) {
        match (&mut self.positions, next.positions) {
            (Positions::F32(all), Positions::F32(next)) => all.extend(next),
            (Positions::F64(all), Positions::F64(next)) => all.extend(next),
            _ => unreachable!("one plan, one type"),
        }
        if let (Some(all), Some(next)) = (&mut self.normals, next.normals) {
            all.extend(next);
        }
        if let (Some(all), Some(next)) = (&mut self.uvs, next.uvs) {
            all.extend(next);
        }
        match (&mut self.colors, next.colors) {
            (Some(Colors::U8(all)), Some(Colors::U8(next))) => all.extend(next),
            (Some(Colors::U16(all)), Some(Colors::U16(next))) => all.extend(next),
            (Some(Colors::F32(all)), Some(Colors::F32(next))) => all.extend(next),
            _ => {}
        }
    }
}

/// Reads the arrays that `plan` asks for.
pub(super) fn read(table: &Table, plan: &VertexPlan) -> Result<Vertices> {
    match (&table.span.uniform, table.big) {
        (Some(uniform), Some(big)) => {
            let vertices = in_bulk(table, plan, uniform, big);
            table.job.check().map(|()| vertices)
        }
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
    let length = table.span.rows as usize * uniform.stride;
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
    let mut all = Arrays::new(plan, table.span.rows as usize);
    let read = |reader: &mut Reader| {
        let mut part = Part { plan, points: Vec::new(), others: Vec::new() };
        // The rows are in the file: as many as its bytes allow.
        let rows = reader.rows() as usize;
        part.points.reserve_exact(rows);
        if plan.normals || plan.uvs || plan.colors.is_some() {
            part.others.reserve_exact(rows);
        }
        reader.feed(&mut part)?;
        Ok(part)
    };
    table.blocks(read, |part| all.append(&part))?;
    Ok(all.0)
}

/// The arrays that blocks are added to.
struct Arrays(Vertices);

impl Arrays {
    fn new(plan: &VertexPlan, count: usize) -> Self {
        let mut vertices = Vertices {
            positions: match plan.double {
                true => Positions::F64(Vec::new()),
                false => Positions::F32(Vec::new()),
            },
            normals: plan.normals.then(Vec::new),
            uvs: plan.uvs.then(Vec::new),
            colors: plan.colors.map(|kind| match kind {
                ColorType::U8 => Colors::U8(Vec::new()),
                ColorType::U16 => Colors::U16(Vec::new()),
                ColorType::F32 => Colors::F32(Vec::new()),
            }),
        };
        vertices.reserve(count);
        Self(vertices)
    }

    fn append(&mut self, part: &Part) {
        let Vertices { positions, normals, uvs, colors } = &mut self.0;
        match positions {
            Positions::F32(all) => all.extend(part.points.iter().map(|p| p.map(|c| c as f32))),
            Positions::F64(all) => all.extend_from_slice(&part.points),
        }
        let others = part.others.iter();
        if let Some(all) = normals {
            all.extend(others.clone().map(|v| [v[0], v[1], v[2]]));
        }
        if let Some(all) = uvs {
            all.extend(others.clone().map(|v| [v[3], v[4]]));
        }
        let colour = others.map(|v| [v[5], v[6], v[7]]);
        match colors {
            Some(Colors::U8(all)) => all.extend(colour.map(|v| v.map(|c| c as u8))),
            Some(Colors::U16(all)) => all.extend(colour.map(|v| v.map(|c| c as u16))),
            Some(Colors::F32(all)) => all.extend(colour),
            None => {}
        }
    }
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
                Step::Skip(kind) | Step::Texnumber(kind) => values.skip(kind, 1)?,
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
