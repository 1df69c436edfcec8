//! Converts vertex rows into arrays: in bulk if binary rows all have the same size, else row by
//! row.

use super::attributes::{Attributes, Capacity, RowAttributes};
use super::block::Uniform;
use super::context::ReadContext;
use super::header::PropertyType;
use super::plan::{ROLE_COUNT, SCALAR, Step, VertexPlan};
use super::records::{FIRST_ATTRIBUTE, Records};
use super::row::{Row, RowResult};
use super::scalar::Scalar;
use super::table::{Reader, RowConsumer, Table};
use crate::error::Result;
use crate::mesh::arrays::Positions;

/// Number of vertices to reserve memory for after the last one. Embree reads 16 bytes from every
/// vertex of 12 bytes, so a padding vertex is appended later.
const SPARE: usize = 1;

/// The arrays of element `vertex`.
pub(super) struct PlyVertices {
    pub(super) positions: Positions,
    pub(super) normals: Option<Vec<[f32; 3]>>,
    pub(super) uvs: Option<Vec<[f32; 2]>>,
    pub(super) attributes: Attributes,
}

impl PlyVertices {
    /// Returns the size in bytes of one vertex, summed over all arrays except the attributes.
    fn each(&self) -> u64 {
        let position = match &self.positions {
            Positions::F32(_) => 12,
            Positions::F64(_) => 24,
        };
        let normal = if self.normals.is_some() { 12 } else { 0 };
        let uv = if self.uvs.is_some() { 8 } else { 0 };
        position + normal + uv
    }

    /// Returns the size in bytes of all arrays.
    pub(super) fn bytes(&self) -> u64 {
        self.each() * self.positions.len() as u64 + self.attributes.bytes()
    }

    /// Reserves memory for `count` vertices in total.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub(super) fn reserve(
        &mut self,
        count: usize,
        plan: &VertexPlan,
        context: &ReadContext,
    ) -> Result<()> {
        let each = self.each() + plan.attributes.bytes();
        context.fits(each.saturating_mul(count as u64))?;
        let spare = count.saturating_add(SPARE);
        self.reserve_all(Capacity::Total(spare), context)
    }

    /// Reserves memory in every array.
    fn reserve_all(&mut self, capacity: Capacity, context: &ReadContext) -> Result<()> {
        match &mut self.positions {
            Positions::F32(all) => capacity.reserve(all, context)?,
            Positions::F64(all) => capacity.reserve(all, context)?,
        }
        if let Some(all) = &mut self.normals {
            capacity.reserve(all, context)?;
        }
        if let Some(all) = &mut self.uvs {
            capacity.reserve(all, context)?;
        }
        self.attributes.reserve(capacity, context)
    }

    /// Appends the next vertices of the file, which were read with the same plan.
    ///
    /// # Errors
    /// If there is not enough memory.
    pub(super) fn append(&mut self, next: PlyVertices, context: &ReadContext) -> Result<()> {
        let count = next.positions.len();
        context.fits(self.bytes().saturating_add(next.bytes()))?;
        self.reserve_all(Capacity::Additional(count), context)?;
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
        self.attributes.append(next.attributes);
        Ok(())
    }
}

impl PlyVertices {
    /// Keeps the vertices for whose index `keep` returns true. Only for points: normals and texture
    /// coordinates are not changed, and points have none.
    pub(super) fn retain(&mut self, keep: impl Fn(usize) -> bool) {
        let mut at = 0;
        let mut next = || {
            at += 1;
            keep(at - 1)
        };
        match &mut self.positions {
            Positions::F32(all) => all.retain(|_| next()),
            Positions::F64(all) => all.retain(|_| next()),
        }
        self.attributes.retain(keep);
    }
}

/// Reads the arrays that `plan` selects.
pub(super) fn read(table: &Table, plan: &VertexPlan) -> Result<PlyVertices> {
    match (&table.span.uniform, table.big) {
        (Some(uniform), Some(big)) => {
            let vertices = in_bulk(table, plan, uniform, big)?;
            table.context.check().map(|()| vertices)
        }
        _ => row_by_row(table, plan),
    }
}

fn in_bulk(table: &Table, plan: &VertexPlan, uniform: &Uniform, big: bool) -> Result<PlyVertices> {
    let records = Records::new(table, &plan.columns, uniform, big);
    let mut all = empty(plan);
    all.reserve(table.span.rows as usize, plan, &table.context)?;
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
    all.attributes.fill(&records);
    Ok(all)
}

/// Returns the arrays that `plan` selects, without a vertex.
fn empty(plan: &VertexPlan) -> PlyVertices {
    PlyVertices {
        positions: match plan.double {
            true => Positions::F64(Vec::new()),
            false => Positions::F32(Vec::new()),
        },
        normals: plan.normals.then(Vec::new),
        uvs: plan.uvs.then(Vec::new),
        attributes: Attributes::new(&plan.attributes),
    }
}

fn row_by_row(table: &Table, plan: &VertexPlan) -> Result<PlyVertices> {
    let mut all = empty(plan);
    all.reserve(table.span.rows as usize, plan, &table.context)?;
    let read = |reader: &mut Reader| {
        let (points, others, attributes) = (Vec::new(), Vec::new(), Vec::new());
        let mut part = BlockVertices { plan, points, others, attributes };
        // The rows are known to be in the file, so their number is limited by its size.
        let rows = reader.rows() as usize;
        part.points.reserve_exact(rows);
        if plan.normals || plan.uvs {
            part.others.reserve_exact(rows);
        }
        if plan.attributes.any() {
            part.attributes.reserve_exact(rows);
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

impl PlyVertices {
    fn append_block(&mut self, part: &BlockVertices) {
        let Self { positions, normals, uvs, attributes } = self;
        match positions {
            Positions::F32(all) => all.extend(part.points.iter().map(|p| p.map(|c| c as f32))),
            Positions::F64(all) => all.extend_from_slice(&part.points),
        }
        let others = part.others.iter();
        if let Some(all) = normals {
            all.extend(others.clone().map(|v| [v[0], v[1], v[2]]));
        }
        if let Some(all) = uvs {
            all.extend(others.map(|v| [v[3], v[4]]));
        }
        part.attributes.iter().for_each(|row| attributes.push(row));
    }
}

/// The vertices of one block of rows.
struct BlockVertices<'a> {
    plan: &'a VertexPlan,
    points: Vec<[f64; 3]>,
    /// Normal and texture coordinates. Empty if neither is read.
    others: Vec<[f32; 5]>,
    attributes: Vec<RowAttributes>,
}

impl RowConsumer for BlockVertices<'_> {
    fn take<R: Row>(&mut self, values: &mut R, _: u64) -> RowResult<()> {
        let mut roles = [0.0; ROLE_COUNT];
        for step in &self.plan.steps {
            match *step {
                Step::Value(kind, role) => roles[role] = values.number(kind)?,
                Step::Texnumber(kind, _) => values.skip(kind, 1)?,
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
        if self.attributes.capacity() > 0 {
            roles[SCALAR] = roles[self.plan.attributes.scalar_role];
            self.attributes.push(std::array::from_fn(|i| roles[FIRST_ATTRIBUTE + i]));
        }
        Ok(())
    }
}
