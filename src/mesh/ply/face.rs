//! Converts faces and strips to triangles. Faces are read in bulk if all are triangles, in binary
//! rows of equal size and without texture data. Otherwise they are read one by one.

use super::attributes::{Attributes, Capacity};
use super::block::Uniform;
use super::check::{Checker, Tally};
use super::context::ReadContext;
use super::faces::PlyFaces;
use super::header::PropertyType;
use super::plan::{FacePlan, ROLE_COUNT, SCALAR, Step, TEXTURE};
use super::polygon;
use super::records::{FIRST_ATTRIBUTE, Records};
use super::row::{Fault, Row, RowResult};
use super::scalar::{Native, Scalar};
use super::table::{Reader, RowConsumer, Table};
use crate::error::Result;
use crate::mesh::normals::VertexPosition;
use crate::parallel::{self, GRAIN};
use crate::reserve;
use crate::units::plural;

/// Marks a dropped triangle in the bulk path. No mesh has a vertex with this index.
const DROPPED: [u32; 3] = [u32::MAX; 3];

/// Reads the faces of `table`, checks them and splits polygons into triangles.
pub(super) fn read<P: VertexPosition>(
    table: &Table,
    plan: &FacePlan,
    positions: &[P],
) -> Result<PlyFaces> {
    if let (Some(uniform), Some(big), false) = (&table.span.uniform, table.big, plan.strips) {
        if uniform.lengths[plan.corners] == 3 && !plan.texcoords && !plan.texnumbers {
            let faces = all_triangles(table, plan, uniform, big, positions)?;
            return table.context.check().map(|()| faces);
        }
    }
    let mut all = PlyFaces { attributes: Attributes::new(&plan.attributes), ..PlyFaces::default() };
    let read = |reader: &mut Reader| {
        let mut part = BlockFaces::new(plan, table.context, positions);
        reader.feed(&mut part)?;
        Ok(part.finish())
    };
    table.blocks(read, |part| all.append(part, &table.context))?;
    Ok(all)
}

/// Reads an element in which every face is a triangle, every row has the same size, and no texture
/// data is read.
fn all_triangles<P: VertexPosition>(
    table: &Table,
    plan: &FacePlan,
    uniform: &Uniform,
    big: bool,
    positions: &[P],
) -> Result<PlyFaces> {
    let item = match table.element.properties[plan.corners].shape {
        PropertyType::List { item, .. } | PropertyType::Single(item) => item,
    };
    let at = uniform.offsets[plan.corners];
    let mut faces = match item {
        Scalar::I32 => copy::<i32, P>(table, uniform, at, big, positions),
        Scalar::U32 => copy::<u32, P>(table, uniform, at, big, positions),
        Scalar::I16 => copy::<i16, P>(table, uniform, at, big, positions),
        Scalar::U16 => copy::<u16, P>(table, uniform, at, big, positions),
        Scalar::I8 => copy::<i8, P>(table, uniform, at, big, positions),
        _ => copy::<u8, P>(table, uniform, at, big, positions),
    }?;
    if plan.attributes.any() {
        let mut attributes = Attributes::new(&plan.attributes);
        let count = faces.triangles.len();
        let bytes = plan.attributes.bytes().saturating_mul(count as u64);
        table.context.fits(faces.bytes().saturating_add(bytes))?;
        attributes.reserve(Capacity::Total(count), &table.context)?;
        attributes.fill(&Records::new(table, &plan.columns, uniform, big));
        if faces.tally.degenerate + faces.tally.unusable > 0 {
            attributes.retain(|i| faces.triangles[i] != DROPPED);
        }
        faces.attributes = attributes;
    }
    if faces.tally.degenerate + faces.tally.unusable > 0 {
        faces.triangles.retain(|triangle| *triangle != DROPPED);
    }
    Ok(faces)
}

/// Copies and checks the triangles of all rows. Their three indices of type `T` start at byte `at`
/// of the row. Triangles to drop become [`DROPPED`].
fn copy<T: Native + Into<i64>, P: VertexPosition>(
    table: &Table,
    uniform: &Uniform,
    at: usize,
    big: bool,
    positions: &[P],
) -> Result<PlyFaces> {
    // `layout` has found these rows in the file.
    let count = table.span.rows as usize;
    let stride = uniform.stride;
    let rows = &table.data[uniform.start..uniform.start + count * stride];
    let mut triangles = reserve::filled([0u32; 3], count, table.context.name)?;
    let blocks = triangles.chunks_mut(GRAIN).zip(rows.chunks(GRAIN * stride)).enumerate();
    let tallies = parallel::map(blocks, |(block, (triangles, rows))| {
        let mut checker = Checker::new(positions, "face");
        if table.context.stopped() {
            return checker.tally;
        }
        let first = table.span.first + (block * GRAIN) as u64;
        for (i, (triangle, bytes)) in
            triangles.iter_mut().zip(rows.chunks_exact(stride)).enumerate()
        {
            let items = &bytes[at..at + 3 * size_of::<T>()];
            let corner = |i: usize| T::take(items, i * size_of::<T>(), big).into();
            let corners = [corner(0), corner(1), corner(2)];
            *triangle = match checker.good(corners) {
                Some(good) => good,
                None => checker.explain(first + i as u64, corners).unwrap_or(DROPPED),
            };
        }
        checker.tally
    });
    let mut tally = Tally::default();
    tallies.into_iter().for_each(|next| tally.add(next));
    tally.faces = count as u64;
    Ok(PlyFaces { triangles, tally, ..PlyFaces::default() })
}

/// Minimum number of corners of a polygon whose memory is reserved before it is split.
const LARGE_POLYGON: usize = 1 << 16;
/// Bytes per corner while a polygon is split: its vertex index, its point (in f64, relative to the
/// first corner, and in 2D), a triangle.
const SPLIT_BYTES: u64 = 4 + 24 + 24 + 16 + 12;

/// Appends to a list whose length comes from the file. A lack of memory is a [`Fault`].
#[inline]
fn push<T>(all: &mut Vec<T>, value: T, context: ReadContext) -> RowResult<()> {
    if all.len() == all.capacity() {
        let bytes = 2 * size_of_val(all.as_slice()) as u64;
        let lack = |_| Fault::Memory(Box::new(reserve::lack(bytes, context.name)));
        all.try_reserve(1).map_err(lack)?;
    }
    all.push(value);
    Ok(())
}

/// Reads the faces of one block of rows.
struct BlockFaces<'a, P> {
    plan: &'a FacePlan,
    context: ReadContext<'a>,
    checker: Checker<'a, P>,
    triangles: Vec<[u32; 3]>,
    uvs: Vec<[[f32; 2]; 3]>,
    any_uvs: bool,
    attributes: Attributes,
    /// The `texnumber` of the current face. The fields below belong to the current face, too.
    texture: Option<i64>,
    corners: Vec<Option<u32>>,
    texcoords: Vec<f32>,
    roles: [f64; ROLE_COUNT],
    points: Vec<[f64; 3]>,
    split: Vec<[u32; 3]>,
}

impl<'a, P: VertexPosition> BlockFaces<'a, P> {
    fn new(plan: &'a FacePlan, context: ReadContext<'a>, positions: &'a [P]) -> Self {
        let element = if plan.strips { "tristrips" } else { "face" };
        Self {
            plan,
            context,
            checker: Checker::new(positions, element),
            triangles: Vec::new(),
            uvs: Vec::new(),
            any_uvs: false,
            attributes: Attributes::new(&plan.attributes),
            texture: None,
            corners: Vec::new(),
            texcoords: Vec::new(),
            roles: [0.0; ROLE_COUNT],
            points: Vec::new(),
            split: Vec::new(),
        }
    }

    fn finish(self) -> PlyFaces {
        let uvs = self.any_uvs.then_some(self.uvs);
        let (triangles, attributes) = (self.triangles, self.attributes);
        PlyFaces { triangles, uvs, attributes, tally: self.checker.tally }
    }

    /// Adds the triangles of the current face, after its row has been read.
    fn face(&mut self, row: u64) -> RowResult<()> {
        self.checker.tally.faces += 1;
        let count = self.corners.len();
        if count < 3 {
            self.checker.tally.too_small += 1;
            return Ok(());
        }
        if !self.texcoords.is_empty() && self.texcoords.len() != 2 * count {
            let found = self.texcoords.len();
            return Err(Fault::Bad(format!(
                "texcoord has {} for {count} corners; expected {} or none",
                plural(found, "value"),
                2 * count
            )));
        }
        self.checker.tally.split += u64::from(count > 3);
        if count > 4 {
            return self.polygon(row);
        }
        self.emit(row, [0, 1, 2]);
        if count == 4 {
            self.emit(row, [0, 2, 3]);
        }
        Ok(())
    }

    /// Reserves the memory in which a polygon of `count` corners is split. Small polygons are not
    /// checked: the check would take longer than the splitting.
    fn reserve_split(&mut self, count: usize) -> RowResult<()> {
        if count < LARGE_POLYGON {
            return Ok(());
        }
        let bytes = SPLIT_BYTES * count as u64;
        let ready = self.context.fits(bytes).and_then(|()| {
            reserve::growing(&mut self.triangles, count, self.context.name)?;
            if self.plan.texcoords {
                reserve::growing(&mut self.uvs, count, self.context.name)?;
            }
            reserve::probe(bytes, self.context.name)
        });
        ready.map_err(|error| Fault::Memory(Box::new(error)))
    }

    fn polygon(&mut self, row: u64) -> RowResult<()> {
        let count = self.corners.len();
        self.reserve_split(count)?;
        let vertices: Vec<u32> = self.corners.iter().flatten().copied().collect();
        let finite = self.checker.all_finite(row, &vertices);
        if !finite || vertices.len() < count {
            self.checker.tally.unusable += count as u64 - 2;
            return Ok(());
        }
        self.points.clear();
        self.points.extend(vertices.iter().map(|v| self.checker.point(*v)));
        let mut split = std::mem::take(&mut self.split);
        if !polygon::split(&self.points, &mut split) {
            return Err(Fault::Bad(format!(
                "a polygon of {count} corners that is not convex; the most is {}",
                polygon::MAX_CONCAVE
            )));
        }
        for corners in &split {
            self.emit(row, *corners);
        }
        self.split = split;
        Ok(())
    }

    /// Adds the triangle of three corners of the face, if it is valid.
    #[inline]
    fn emit(&mut self, row: u64, corners: [u32; 3]) {
        let vertices = corners.map(|c| self.corners[c as usize]);
        let Some(triangle) = self.checker.triangle(row, vertices) else {
            return;
        };
        self.triangles.push(triangle);
        if self.plan.attributes.any() {
            self.attributes.push(&std::array::from_fn(|i| self.roles[FIRST_ATTRIBUTE + i]));
        }
        if let Some(number) = self.texture {
            self.checker.tally.count_texture(number, self.plan.texture_files);
        }
        if self.plan.texcoords {
            let uv = |c: u32| {
                let at = 2 * c as usize;
                match self.texcoords.get(at..at + 2) {
                    Some(&[u, v]) => [u, v],
                    _ => [0.0; 2],
                }
            };
            self.any_uvs |= !self.texcoords.is_empty();
            self.uvs.push(corners.map(uv));
        }
    }

    /// Reads a strip of `count` corners. Every corner from the third on forms a triangle with the
    /// two before it. Every second triangle is reversed, so that all have the same orientation. The
    /// index -1 starts a new strip; in `uint` it is 4294967295.
    fn strip<R: Row>(
        &mut self,
        values: &mut R,
        count: u64,
        item: Scalar,
        row: u64,
    ) -> RowResult<()> {
        // The first two indices are checked when a third one makes a triangle of them.
        let (mut first, mut before, mut seen) = ([0; 2], [None; 2], 0u64);
        for _ in 0..count {
            let value = values.number(item)? as i64;
            if value == -1 || item == Scalar::U32 && value == u32::MAX as i64 {
                seen = 0;
                continue;
            }
            seen += 1;
            if seen < 3 {
                first[seen as usize - 1] = value;
                continue;
            }
            if seen == 3 {
                before = first.map(|value| self.checker.vertex(row, value));
            }
            let vertex = self.checker.vertex(row, value);
            let [a, b] = if seen % 2 == 1 { before } else { [before[1], before[0]] };
            self.checker.tally.faces += 1;
            if let Some(triangle) = self.checker.triangle(row, [a, b, vertex]) {
                push(&mut self.triangles, triangle, self.context)?;
            }
            before = [before[1], vertex];
        }
        Ok(())
    }
}

impl<P: VertexPosition> RowConsumer for BlockFaces<'_, P> {
    fn take<R: Row>(&mut self, values: &mut R, row: u64) -> RowResult<()> {
        let plan = self.plan;
        self.texcoords.clear();
        for step in &plan.steps {
            match *step {
                Step::Corners { count, item } if plan.strips => {
                    let count = values.count(count)?;
                    self.strip(values, count, item, row)?;
                }
                Step::Corners { count, item } => {
                    let count = values.count(count)?;
                    self.corners.clear();
                    for _ in 0..count {
                        let value = values.number(item)? as i64;
                        // A face with fewer than three corners is skipped, so its indices are not
                        // checked.
                        let corner = match count {
                            0..3 => None,
                            _ => self.checker.vertex(row, value),
                        };
                        push(&mut self.corners, corner, self.context)?;
                    }
                }
                Step::Texcoords { count, item } => {
                    for _ in 0..values.count(count)? {
                        push(&mut self.texcoords, values.number(item)? as f32, self.context)?;
                    }
                }
                Step::Texnumber(kind, role) => {
                    let number = values.number(kind)?;
                    self.texture = Some(number as i64);
                    if plan.attributes.textures > 0 {
                        let number = self.checker.texture(row, number, plan.attributes.textures);
                        self.roles[TEXTURE] = number.into();
                    }
                    if let Some(role) = role {
                        self.roles[role] = number;
                    }
                }
                Step::Value(kind, role) => self.roles[role] = values.number(kind)?,
                Step::Skip(shape) => values.skip_property(shape)?,
            }
        }
        self.roles[SCALAR] = self.roles[plan.attributes.scalar_role];
        if plan.strips { Ok(()) } else { self.face(row) }
    }
}
