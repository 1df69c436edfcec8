//! Converts vertex rows into arrays: in bulk if all records have one size, else row by row.

use rayon::prelude::*;

use super::block::Uniform;
use super::context::ReadContext;
use super::header::PropertyType;
use super::plan::{ColorType, ROLES, Step, VertexPlan};
use super::row::{Row, RowResult};
use super::scalar::{Native, Scalar};
use super::table::{Reader, RowConsumer, Table};
use crate::error::Result;
use crate::mesh::{Colors, Positions};
use crate::reserve;

/// Minimum number of vertices per task.
const GRAIN: usize = 1 << 13;

/// Number of unused vertices after the last one. Embree reads 16 bytes from every vertex.
const SPARE: usize = 1;

/// The arrays of element `vertex`.
pub(super) struct Vertices {
    pub(super) positions: Positions,
    pub(super) normals: Option<Vec<[f32; 3]>>,
    pub(super) uvs: Option<Vec<[f32; 2]>>,
    pub(super) colors: Option<Colors>,
}

impl Vertices {
    /// Size in bytes of one vertex, summed over all arrays.
    fn each(&self) -> u64 {
        let position = match &self.positions {
            Positions::F32(_) => 12,
            Positions::F64(_) => 24,
        };
        let colour = match &self.colors {
            Some(Colors::U8(_)) => 3,
            Some(Colors::U16(_)) => 6,
            Some(Colors::F32(_)) => 12,
            None => 0,
        };
        let normal = if self.normals.is_some() { 12 } else { 0 };
        let uv = if self.uvs.is_some() { 8 } else { 0 };
        position + normal + uv + colour
    }

    /// Size in bytes of all arrays.
    pub(super) fn bytes(&self) -> u64 {
        self.each() * self.positions.len() as u64
    }

    /// Reserves memory for `count` vertices in total.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub(super) fn reserve(&mut self, count: usize, job: &ReadContext) -> Result<()> {
        job.fits(self.each().saturating_mul(count as u64))?;
        let spare = count.saturating_add(SPARE);
        self.reserve_all(&Capacity::Total(spare), job)
    }

    /// Reserves memory in every array.
    fn reserve_all(&mut self, capacity: &Capacity, job: &ReadContext) -> Result<()> {
        match &mut self.positions {
            Positions::F32(all) => capacity.reserve(all, job)?,
            Positions::F64(all) => capacity.reserve(all, job)?,
        }
        if let Some(all) = &mut self.normals {
            capacity.reserve(all, job)?;
        }
        if let Some(all) = &mut self.uvs {
            capacity.reserve(all, job)?;
        }
        match &mut self.colors {
            Some(Colors::U8(all)) => capacity.reserve(all, job),
            Some(Colors::U16(all)) => capacity.reserve(all, job),
            Some(Colors::F32(all)) => capacity.reserve(all, job),
            None => Ok(()),
        }
    }

    /// Appends the next vertices of the file, which were read with the same plan.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub(super) fn append(&mut self, next: Vertices, job: &ReadContext) -> Result<()> {
        let count = next.positions.len();
        job.fits(self.bytes().saturating_add(next.bytes()))?;
        self.reserve_all(&Capacity::Additional(count), job)?;
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
        Ok(())
    }
}

/// A number of elements to reserve in an array.
enum Capacity {
    /// This many elements in total.
    Total(usize),
    /// This many elements more than there are.
    Additional(usize),
}

impl Capacity {
    fn reserve<T>(&self, all: &mut Vec<T>, job: &ReadContext) -> Result<()> {
        match *self {
            Self::Total(count) => reserve::exact(all, count.saturating_sub(all.len()), job.name),
            Self::Additional(count) => reserve::growing(all, count, job.name),
        }
    }
}

/// Reads the arrays that `plan` selects.
pub(super) fn read(table: &Table, plan: &VertexPlan) -> Result<Vertices> {
    match (&table.span.uniform, table.big) {
        (Some(uniform), Some(big)) => {
            let vertices = in_bulk(table, plan, uniform, big)?;
            table.job.check().map(|()| vertices)
        }
        _ => row_by_row(table, plan),
    }
}

/// Rows that all have the same size.
struct Records<'a> {
    rows: &'a [u8],
    stride: usize,
    big: bool,
    /// Type and offset of each role.
    roles: [(Scalar, usize); ROLES],
}

fn in_bulk(table: &Table, plan: &VertexPlan, uniform: &Uniform, big: bool) -> Result<Vertices> {
    let length = table.span.rows as usize * uniform.stride;
    let roles = plan.columns.map(|column| {
        let Some(at) = column else {
            return (Scalar::U8, 0);
        };
        match table.element.properties[at].shape {
            PropertyType::Single(kind) => (kind, uniform.offsets[at]),
            PropertyType::List { item, .. } => (item, uniform.offsets[at]),
        }
    });
    let rows = &table.data[uniform.start..uniform.start + length];
    let records = Records { rows, stride: uniform.stride, big, roles };
    let mut all = empty(plan);
    all.reserve(table.span.rows as usize, &table.job)?;
    match &mut all.positions {
        Positions::F64(all) => records.columns(all, 0, Scalar::F64, |v| v),
        Positions::F32(all) => records.columns(all, 0, Scalar::F32, |v| v as f32),
    }
    if let Some(all) = &mut all.normals {
        records.columns(all, 3, Scalar::F32, |v| v as f32);
    }
    if let Some(all) = &mut all.uvs {
        records.columns(all, 6, Scalar::F32, |v| v as f32);
    }
    match &mut all.colors {
        Some(Colors::U8(all)) => records.columns(all, 8, Scalar::U8, |v| v as u8),
        Some(Colors::U16(all)) => records.columns(all, 8, Scalar::U16, |v| v as u16),
        Some(Colors::F32(all)) => records.columns(all, 8, Scalar::F32, |v| v as f32),
        None => {}
    }
    Ok(all)
}

/// The arrays that `plan` selects, without a vertex.
fn empty(plan: &VertexPlan) -> Vertices {
    Vertices {
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
    }
}

impl Records<'_> {
    /// Reads `N` roles, from `first` on, into an array with enough capacity. Values that are stored
    /// as type `T`, called `native`, are copied. All others are converted one by one.
    fn columns<const N: usize, T: Native>(
        &self,
        all: &mut Vec<[T; N]>,
        first: usize,
        native: Scalar,
        convert: impl Fn(f64) -> T + Sync,
    ) {
        let roles: [(Scalar, usize); N] = std::array::from_fn(|i| self.roles[first + i]);
        let big = self.big;
        let rows = self.rows.par_chunks_exact(self.stride).with_min_len(GRAIN);
        if roles.iter().all(|(kind, _)| *kind == native) {
            let at = roles.map(|(_, at)| at);
            rows.map(|row| at.map(|at| T::take(row, at, big))).collect_into_vec(all);
        } else {
            let read = |row| roles.map(|(kind, at)| convert(kind.read(row, at, big)));
            rows.map(read).collect_into_vec(all);
        }
    }
}

fn row_by_row(table: &Table, plan: &VertexPlan) -> Result<Vertices> {
    let mut all = empty(plan);
    all.reserve(table.span.rows as usize, &table.job)?;
    let read = |reader: &mut Reader| {
        let mut part = BlockVertices { plan, points: Vec::new(), others: Vec::new() };
        // The rows are known to be in the file, so their number is limited by its size.
        let rows = reader.rows() as usize;
        part.points.reserve_exact(rows);
        if plan.normals || plan.uvs || plan.colors.is_some() {
            part.others.reserve_exact(rows);
        }
        reader.feed(&mut part)?;
        Ok(part)
    };
    let take = |part| {
        all.append_block(&part);
        Ok(())
    };
    table.blocks(read, take)?;
    Ok(all)
}

impl Vertices {
    fn append_block(&mut self, part: &BlockVertices) {
        let Self { positions, normals, uvs, colors } = self;
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
struct BlockVertices<'a> {
    plan: &'a VertexPlan,
    points: Vec<[f64; 3]>,
    /// Normal, texture coordinate, colour. Integers of up to 16 bits are exact in `f32`.
    others: Vec<[f32; ROLES - 3]>,
}

impl RowConsumer for BlockVertices<'_> {
    fn take<R: Row>(&mut self, values: &mut R, _: u64) -> RowResult<()> {
        let mut roles = [0.0; ROLES];
        for step in &self.plan.steps {
            match *step {
                Step::Value(kind, role) => roles[role] = values.number(kind)?,
                Step::Texnumber(kind) => values.skip(kind, 1)?,
                Step::Corners { count, item } | Step::Texcoords { count, item } => {
                    values.skip_property(PropertyType::List { count, item })?;
                }
                Step::Skip(shape) => values.skip_property(shape)?,
            }
        }
        self.points.push([roles[0], roles[1], roles[2]]);
        if self.others.capacity() > 0 {
            self.others.push(std::array::from_fn(|i| roles[3 + i] as f32));
        }
        Ok(())
    }
}
