//! Checks the triangles of a PLY file: drops the invalid ones, counts them and keeps the first
//! errors.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use crate::error::{Error, ErrorKind, Problem, Result};
use crate::math::{cross, sub};
use crate::mesh::arrays::{FaceTextures, Notes};
use crate::mesh::normals::VertexPosition;

/// A face: the name of its element and the index of its row.
type Face = (&'static str, u64);

/// Stands for all texture indices that no file has.
const OTHER_TEXTURES: i64 = i64::MAX;

/// Result of the check of consecutive faces: counts, and the first error of each kind.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub(super) faces: u64,
    pub(super) too_small: u64,
    pub(super) split: u64,
    pub(super) degenerate: u64,
    /// The degenerate triangles between three different points: candidates for stitches.
    pub(super) stitches: Vec<[u32; 3]>,
    /// Number of triangles that use an index out of range or a non-finite vertex. In a cloud of
    /// points, the number of points that are not finite.
    pub(super) unusable: u64,
    /// Number of triangles for each `texnumber` from -1 to the number of files, and for all others
    /// together.
    pub(super) textures: BTreeMap<i64, u64>,
    bad_textures: u64,
    first_bad_texture: Option<(Face, f64)>,
    bad_indices: u64,
    first_bad_index: Option<(Face, i64)>,
    /// Non-finite vertices that triangles use, with repeats.
    bad_vertices: Vec<u32>,
    first_bad_vertex: Option<(Face, u32)>,
}

impl Tally {
    /// Adds the tally of the next faces of the file.
    pub(super) fn add(&mut self, next: Tally) {
        self.faces += next.faces;
        self.too_small += next.too_small;
        self.split += next.split;
        self.degenerate += next.degenerate;
        self.stitches.extend(next.stitches);
        self.unusable += next.unusable;
        for (number, triangles) in next.textures {
            *self.textures.entry(number).or_default() += triangles;
        }
        self.bad_textures += next.bad_textures;
        self.first_bad_texture = self.first_bad_texture.or(next.first_bad_texture);
        self.bad_indices += next.bad_indices;
        self.first_bad_index = self.first_bad_index.or(next.first_bad_index);
        self.bad_vertices.extend(next.bad_vertices);
        self.first_bad_vertex = self.first_bad_vertex.or(next.first_bad_vertex);
    }

    /// Counts a triangle with the `texnumber` `number`, if the file names `files` textures.
    #[inline]
    pub(super) fn count_texture(&mut self, number: i64, files: usize) {
        let known = (-1..files as i64).contains(&number);
        *self.textures.entry(if known { number } else { OTHER_TEXTURES }).or_default() += 1;
    }

    /// Returns the `texnumber` that most triangles have; of equally frequent ones, the lowest. One
    /// that no file has only if there is no other.
    pub(super) fn main_texture(&self) -> Option<i64> {
        let key = |number: i64, count: u64| (number != OTHER_TEXTURES, count, Reverse(number));
        let main = self.textures.iter().max_by_key(|(number, count)| key(**number, **count));
        main.map(|(number, _)| *number)
    }

    pub(super) fn write(&self, notes: &mut Notes) {
        let named = 0..notes.texture_files as i64;
        notes.textures =
            self.textures.keys().filter(|number| named.contains(number)).count() as u64;
        notes.textures_repaired = self.bad_textures;
        notes.faces = self.faces;
        notes.faces_too_small = self.too_small;
        notes.polygons_split = self.split;
        notes.degenerate_dropped = self.degenerate;
        notes.repaired_dropped = self.unusable;
    }

    /// Returns an error if a face selects a texture that the file does not name.
    pub(super) fn texture_verdict(&self, files: usize, name: &str) -> Result<()> {
        let Some(((element, row), number)) = self.first_bad_texture else { return Ok(()) };
        let textures = match files {
            1 => "the file names 1 texture (0)".to_string(),
            n => format!("the file names {n} textures (0 to {})", n - 1),
        };
        let all = self.bad_textures;
        let message = format!(
            "texnumber {number} is out of range: {textures}; numbers out of range in all: {all}"
        );
        Err(Error::invalid(format!("{name}: {element} {row}"), message)
            .help("--repair shows these faces without a texture, as -1 does"))
    }

    /// Returns an error if a face uses an index out of range or a non-finite vertex.
    pub(super) fn verdict<P: VertexPosition>(&mut self, positions: &[P], name: &str) -> Result<()> {
        let mut problems = Vec::new();
        let count = positions.len();
        if let Some(((element, row), value)) = self.first_bad_index {
            let vertices = match count {
                0 => "the file has no vertices".to_string(),
                1 => "the file has 1 vertex (0)".to_string(),
                _ => format!("the file has {count} vertices (0 to {})", count - 1),
            };
            let n = self.bad_indices;
            problems.push(Problem::new(
                format!("{name}: {element} {row}"),
                format!("vertex index {value} is out of range: {vertices}; indices out of range in all: {n}"),
            ));
        }
        if let Some(((element, row), vertex)) = self.first_bad_vertex {
            self.bad_vertices.sort_unstable();
            self.bad_vertices.dedup();
            let n = self.bad_vertices.len();
            let [x, y, z] = positions[vertex as usize].xyz();
            problems.push(Problem::new(
                format!("{name}: vertex {vertex}"),
                format!("({x}, {y}, {z}) is not finite, and {element} {row} uses it; such vertices in all: {n}"),
            ));
        }
        let n = self.unusable;
        let plural = if n == 1 { "triangle that uses" } else { "triangles that use" };
        let help = format!("--repair drops the {n} {plural} them");
        Error::check(ErrorKind::Invalid, problems).map_err(|error| error.help(help))
    }
}

/// Checks triangles against the vertices and counts the results.
pub(super) struct Checker<'a, P> {
    positions: &'a [P],
    element: &'static str,
    pub(super) tally: Tally,
}

impl<'a, P: VertexPosition> Checker<'a, P> {
    pub(super) fn new(positions: &'a [P], element: &'static str) -> Self {
        Self { positions, element, tally: Tally::default() }
    }

    /// Returns the vertex index `value` of row `row` if there is such a vertex, and records the
    /// error otherwise.
    #[inline]
    pub(super) fn vertex(&mut self, row: u64, value: i64) -> Option<u32> {
        // A negative index becomes a huge unsigned one.
        if (value as u64) < self.positions.len() as u64 {
            Some(value as u32)
        } else {
            self.bad_index(row, value);
            None
        }
    }

    /// Returns the texture index `number` of a face, rounded down, if it is in [0, `files`), else
    /// [`FaceTextures::NO_TEXTURE`]. Any other number except -1 is recorded as an error.
    #[inline]
    pub(super) fn texture(&mut self, row: u64, number: f64, files: usize) -> u16 {
        if number >= 0.0 && number < files as f64 {
            return number as u16;
        }
        if number != -1.0 {
            self.tally.bad_textures += 1;
            self.tally.first_bad_texture.get_or_insert(((self.element, row), number));
        }
        FaceTextures::NO_TEXTURE
    }

    #[cold]
    fn bad_index(&mut self, row: u64, value: i64) {
        self.tally.bad_indices += 1;
        self.tally.first_bad_index.get_or_insert(((self.element, row), value));
    }

    /// Returns the triangle if it is valid beyond doubt. Nearly all triangles pass this fast test.
    #[inline(always)]
    pub(super) fn good(&self, corners: [i64; 3]) -> Option<[u32; 3]> {
        let count = self.positions.len() as u64;
        if corners.iter().any(|c| *c as u64 >= count) {
            return None;
        }
        let triangle = corners.map(|c| c as u32);
        let [a, b, c] = triangle.map(|v| self.positions[v as usize].xyz());
        let normal = cross(sub(b, a), sub(c, a));
        // Zero if corners repeat or are collinear. NaN or infinite if a corner is not finite.
        let size = normal[0].abs() + normal[1].abs() + normal[2].abs();
        (size > 0.0 && size < f64::INFINITY).then_some(triangle)
    }

    /// Handles a triangle that fails [`Self::good`]: returns it if it is kept all the same, and
    /// records the reason otherwise.
    #[cold]
    pub(super) fn explain(&mut self, row: u64, corners: [i64; 3]) -> Option<[u32; 3]> {
        let vertices = corners.map(|corner| self.vertex(row, corner));
        self.triangle(row, vertices)
    }

    /// Returns the triangle if it is kept, and records the reason otherwise. `corners` come from
    /// [`Self::vertex`].
    #[inline]
    pub(super) fn triangle(&mut self, row: u64, corners: [Option<u32>; 3]) -> Option<[u32; 3]> {
        let [Some(a), Some(b), Some(c)] = corners else {
            self.tally.unusable += 1;
            return None;
        };
        if a == b || b == c || c == a {
            self.tally.degenerate += 1;
            return None;
        }
        let [pa, pb, pc] = [a, b, c].map(|v| self.positions[v as usize].xyz());
        let normal = cross(sub(pb, pa), sub(pc, pa));
        if normal == [0.0; 3] {
            self.tally.degenerate += 1;
            if pa != pb && pb != pc && pc != pa {
                self.tally.stitches.push([a, b, c]);
            }
            return None;
        }
        // A non-finite corner makes this sum non-finite: infinite or NaN products never cancel out.
        // Huge finite corners can make it infinite, too. So the corners are checked themselves.
        if !(normal[0] + normal[1] + normal[2]).is_finite() && !self.all_finite(row, &[a, b, c]) {
            self.tally.unusable += 1;
            return None;
        }
        Some([a, b, c])
    }

    /// Returns true if all `vertices` are finite. Records those that are not.
    #[cold]
    pub(super) fn all_finite(&mut self, row: u64, vertices: &[u32]) -> bool {
        let mut all = true;
        for &vertex in vertices {
            if self.point(vertex).iter().any(|c| !c.is_finite()) {
                all = false;
                self.tally.bad_vertices.push(vertex);
                self.tally.first_bad_vertex.get_or_insert(((self.element, row), vertex));
            }
        }
        all
    }

    #[inline]
    pub(super) fn point(&self, vertex: u32) -> [f64; 3] {
        self.positions[vertex as usize].xyz()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texture_numbers_that_no_file_has_are_counted_together() {
        let mut tally = Tally::default();
        for number in (-5000..5000).chain([1]) {
            tally.count_texture(number, 3);
        }
        assert_eq!(tally.textures.len(), 5, "-1, 0, 1, 2 and all others");
        assert_eq!(tally.main_texture(), Some(1));
        let mut unknown = Tally::default();
        unknown.count_texture(7, 3);
        assert_eq!(unknown.main_texture(), Some(OTHER_TEXTURES));
    }
}
