//! Vertex normals that are split at creases. A crease is an edge whose two faces differ in
//! direction by more than a given angle.
//!
//! The faces around a vertex fall into groups. Two faces that share an edge at the vertex are in
//! one group if the edge is no crease, or if edges without a crease lead around the vertex from one
//! face to the other. There are two angles. The smaller one applies only where the groups that it
//! produces are few and flat. So at 45 degrees the edges of a chamfer are creases, and edges
//! between the bumps of a scan at the same angle are not. Each group has its own normal, with the
//! weights of [`vertex_normals`](super::vertex_normals).

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::normals::{CHUNK, CornerBatch, Fan, VertexPosition, unit, vertex_normals};
use super::stitched_edges::{self, StitchedEdges, first};
use super::vertex_faces::VertexFaces;
use crate::error::Result;
use crate::math::{dot, sub};
use crate::parallel;
use crate::reserve::{self, MemoryLimit};

/// Unit normals of a smooth mesh: per vertex, and at creases per corner.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Normals {
    /// One normal per vertex, then the additional normals at creases.
    all: Vec<[f32; 3]>,
    /// `None` if there are no creases: every normal then belongs to a vertex.
    creases: Option<Corners>,
}

/// The triangles that have a corner with an additional normal.
#[derive(Debug, Clone, PartialEq)]
struct Corners {
    /// One bit per triangle, set if the triangle is marked.
    marked: Vec<u64>,
    /// Number of marked triangles before each word.
    before: Vec<u32>,
    /// For each marked triangle, the indices of its three corner normals.
    normals: Vec<[u32; 3]>,
}

impl From<Vec<[f32; 3]>> for Normals {
    /// Takes one normal per vertex.
    fn from(all: Vec<[f32; 3]>) -> Self {
        Self { all, creases: None }
    }
}

impl Normals {
    /// Returns the normals at the three corners of the triangle with this index and these vertex
    /// indices.
    #[inline(always)]
    pub fn of(&self, triangle: u32, vertices: [u32; 3]) -> [[f32; 3]; 3] {
        let numbers = self.creases.as_ref().and_then(|creases| creases.of(triangle));
        numbers.unwrap_or(vertices).map(|number| self.all[number as usize])
    }

    /// Returns the normals with `map` applied to each.
    #[must_use]
    pub fn mapped(&self, map: impl Fn([f32; 3]) -> [f32; 3]) -> Self {
        Self { all: self.all.iter().map(|&normal| map(normal)).collect(), ..self.clone() }
    }

    /// Returns the size in bytes of all arrays.
    pub fn bytes(&self) -> u64 {
        let creases = self.creases.as_ref().map_or(0, |creases| {
            size_of_val(&creases.marked[..])
                + size_of_val(&creases.before[..])
                + size_of_val(&creases.normals[..])
        });
        (size_of_val(&self.all[..]) + creases) as u64
    }
}

impl Corners {
    fn of(&self, triangle: u32) -> Option<[u32; 3]> {
        let (word, bit) = (triangle as usize / 64, triangle % 64);
        let marked = self.marked[word];
        let below = (marked & ((1 << bit) - 1)).count_ones();
        (marked >> bit & 1 != 0).then(|| self.normals[(self.before[word] + below) as usize])
    }
}

/// A corner with an additional normal.
struct Split {
    triangle: u32,
    vertex: u32,
    /// Index of the normal among the additional ones of the same chunk of vertices.
    normal: u32,
}

/// Returns the normals of a mesh, split at creases.
///
/// An edge is a crease if its two faces differ by more than the first of `degrees`. Between flat
/// parts, it is a crease if they differ by more than the smaller of the two. Both angles are in
/// (0, 180]. The result is the same for any number of threads.
///
/// `stitches` are triangles without area that close T-junctions. The edges on their two sides count
/// as one edge.
///
/// Noise needs far more memory than a smooth mesh: up to 120 bytes per triangle, beside 12 per
/// vertex and the table of faces. All but the 12 bytes per vertex is counted against `limit`.
///
/// Runs in the caller's rayon pool.
///
/// # Errors
/// `Retry` if there is no memory for the normals; as `MemoryLimit::check`. `name` is the mesh's
/// name for the message.
///
/// # Panics
/// If a triangle has an index beyond `positions`.
pub fn creased_normals<P: VertexPosition>(
    positions: &[P],
    triangles: &[[u32; 3]],
    stitches: &[[u32; 3]],
    degrees: [f64; 2],
    (name, limit): (&str, Option<MemoryLimit>),
) -> Result<Normals> {
    // A scene cannot hold so many triangles, so their creases do not matter.
    if triangles.len() > u32::MAX as usize {
        return Ok(vertex_normals(positions, triangles).into());
    }
    let faces = VertexFaces::new(positions.len(), triangles);
    let stitched = StitchedEdges::new(positions, stitches, name)?;
    let mut all = Vec::new();
    reserve::exact(&mut all, positions.len(), name)?;
    all.resize(positions.len(), [0.0f32; 3]);
    let check = |bytes: u64| limit.map_or(Ok(()), |limit| limit.check(bytes, name));
    let (table, held) = (faces.bytes(), AtomicU64::new(0));
    let results = parallel::try_map(all.chunks_mut(CHUNK).enumerate(), |(chunk, normals)| {
        let (mut batch, mut around) = (CornerBatch::default(), Around::new(degrees));
        let (mut splits, mut more) = (Vec::<Split>::new(), Vec::new());
        let vertices = chunk * CHUNK..chunk * CHUNK + normals.len();
        batch.each_vertex((positions, triangles), &faces, vertices, |vertex, fan| {
            let normal = &mut normals[vertex - chunk * CHUNK];
            *normal = unit(fan.sum(0..fan.len()));
            if fan.is_within(*normal, around.half) {
                return;
            }
            if around.has_crease(&fan, *normal) {
                let number = vertex as u32;
                let here = (triangles, number, faces.of(vertex), stitched.at(number));
                *normal = around.split(&fan, here, &mut splits, &mut more);
            }
        });
        splits.shrink_to_fit();
        more.shrink_to_fit();
        let bytes = (size_of_val(&splits[..]) + size_of_val(&more[..])) as u64;
        let before = held.fetch_add(bytes, Relaxed);
        check(table + before + bytes).map(|()| (splits, more))
    })?;
    drop(faces);
    let mut creases = None;
    let corners: usize = results.iter().map(|(splits, _)| splits.len()).sum();
    if corners > 0 {
        let additional = results.iter().map(|(_, more)| more.len()).sum();
        // The lists above are released before the table of corners is made.
        let entries = corners.min(triangles.len()) + triangles.len().div_ceil(64);
        let beside = (12 * entries as u64).max(held.into_inner());
        check(12 * (corners + additional) as u64 + beside)?;
        let mut found = Vec::new();
        reserve::exact(&mut found, corners, name)?;
        reserve::exact(&mut all, additional, name)?;
        for (splits, more) in results {
            let first = all.len() as u32;
            found.extend(splits.iter().map(|s| (s.triangle, s.vertex, first + s.normal)));
            all.extend(more);
        }
        found.par_sort_unstable();
        creases = Some(Corners::new(triangles, &found, name)?);
    }
    Ok(Normals { all, creases })
}

impl Corners {
    /// Builds the table from `found`: sorted tuples of triangle, vertex and index of the normal.
    fn new(triangles: &[[u32; 3]], found: &[(u32, u32, u32)], name: &str) -> Result<Self> {
        let words = triangles.len().div_ceil(64);
        let mut marked = reserve::filled(0u64, words, name)?;
        let mut normals: Vec<[u32; 3]> = Vec::new();
        let of_one = |a: &(u32, u32, u32), b: &(u32, u32, u32)| a.0 == b.0;
        reserve::exact(&mut normals, found.chunk_by(of_one).count(), name)?;
        for corners in found.chunk_by(of_one) {
            let triangle = corners[0].0 as usize;
            marked[triangle / 64] |= 1 << (triangle % 64);
            let vertices = triangles[triangle];
            normals.push(vertices.map(|vertex| {
                let own = corners.iter().find(|corner| corner.1 == vertex);
                own.map_or(vertex, |corner| corner.2)
            }));
        }
        let mut before = reserve::filled(0u32, words, name)?;
        let mut count = 0;
        for (before, marked) in before.iter_mut().zip(&marked) {
            *before = count;
            count += marked.count_ones();
        }
        Ok(Self { marked, before, normals })
    }
}

/// Maximum number of later faces at the same edge with which each face is compared. Without it, an
/// edge with many faces would take quadratic time. Similar faces that are farther apart in the list
/// are joined only through faces between them.
const MAX_COMPARED_AT_EDGE: usize = 8;

/// All triangles, the index of one vertex, its faces in file order, and its [`StitchedEdges`].
type Here<'a> = (&'a [[u32; 3]], u32, &'a [u32], &'a [[u32; 3]]);

/// Maximum number of flat parts that meet at a vertex, as at the corner of a block. More parts are
/// noise.
const MAX_FLAT_PARTS: usize = 3;

/// A part is flat if all its faces are within this many degrees of its normal.
const FLAT_DEGREES: f64 = 5.0;

/// Working memory to group the faces around one vertex.
struct Around {
    /// Maximum squared distance between the unit normals of the two faces of a smooth edge: in
    /// general, and between flat parts. Cosines of small angles would all round to 1.
    max_distance: [f64; 2],
    /// Cosine of half the smaller angle. If all faces are this close to one normal, no two of them
    /// differ by more than the smaller angle, so there is no crease.
    half: f64,
    normals: Vec<[f32; 3]>,
    /// The other two vertices of each face, with the position of the face in the list of faces
    /// around the vertex; sorted.
    edges: Vec<(u32, usize)>,
    /// For each face, another face of its group; the first face of a group has its own position.
    group: Vec<usize>,
    /// First face of the group, and the face; sorted. Both are positions in the list of faces.
    members: Vec<(usize, usize)>,
    /// The normals of the groups, in the order of their first faces.
    parts: Vec<[f32; 3]>,
}

impl Around {
    fn new([angle, flat]: [f64; 2]) -> Self {
        // An edge at exactly the given angle is smooth, however the normals are rounded.
        let distance = |degrees: f64| {
            let exact = (2.0 * (0.5 * degrees.to_radians()).sin()).powi(2);
            exact + 2e-6f64.min(0.1 * exact)
        };
        let max_distance = [distance(angle), distance(flat.min(angle))];
        let half = (0.5 * flat.min(angle)).to_radians().cos() + 1e-6;
        let (normals, edges, group) = (vec![], vec![], vec![]);
        let (members, parts) = (vec![], vec![]);
        Self { max_distance, half, normals, edges, group, members, parts }
    }

    /// Stores the normal of each face. Returns false if there is certainly no crease.
    fn has_crease(&mut self, fan: &Fan, normal: [f32; 3]) -> bool {
        self.normals.clear();
        self.normals.extend(fan.normals().map(unit));
        let near = |face: &[f32; 3]| cosine(*face, normal) >= self.half || is_zero(*face);
        !self.normals.iter().all(near)
    }

    /// Groups the faces and returns the normal of the first group; zero if there is no group. Adds
    /// the normals of the other groups to `more`, and their corners to `splits`.
    fn split(
        &mut self,
        fan: &Fan,
        (triangles, vertex, faces, stitched): Here,
        splits: &mut Vec<Split>,
        more: &mut Vec<[f32; 3]>,
    ) -> [f32; 3] {
        self.edges.clear();
        for (place, &face) in faces.iter().enumerate() {
            let others = triangles[face as usize].into_iter().filter(|&other| other != vertex);
            self.edges.extend(others.map(|other| (other, place)));
        }
        if !stitched.is_empty() {
            stitched_edges::join(stitched, &mut self.edges);
        }
        self.edges.sort_unstable();
        let [all, flat] = self.max_distance;
        self.divide(fan, flat);
        if flat < all && !self.is_flat() {
            self.divide(fan, all);
        }
        let groups = self.members.chunk_by(|a, b| a.0 == b.0);
        for (members, &normal) in groups.zip(&self.parts).skip(1) {
            let normal_of = |&(_, place): &(usize, usize)| Split {
                triangle: faces[place],
                vertex,
                normal: more.len() as u32,
            };
            splits.extend(members.iter().map(normal_of));
            more.push(normal);
        }
        self.parts.first().copied().unwrap_or_default()
    }

    /// Groups the faces and computes the normals of the groups. An edge is smooth if the squared
    /// distance of its faces' normals is at most `max_distance`.
    fn divide(&mut self, fan: &Fan, max_distance: f64) {
        self.group.clear();
        self.group.extend(0..self.normals.len());
        for edge in self.edges.chunk_by(|a, b| a.0 == b.0) {
            for (i, &(_, a)) in edge.iter().enumerate() {
                for &(_, b) in edge[i + 1..].iter().take(MAX_COMPARED_AT_EDGE) {
                    let normals = [self.normals[a], self.normals[b]];
                    // A face without area has no direction. It counts as perpendicular to others.
                    let distance = match normals.into_iter().any(is_zero) {
                        true => 2.0,
                        false => squared_distance(normals[0], normals[1]),
                    };
                    if distance <= max_distance {
                        let (a, b) = (first(&mut self.group, a), first(&mut self.group, b));
                        self.group[a.max(b)] = a.min(b);
                    }
                }
            }
        }
        self.members.clear();
        // A face with zero area belongs to no group: it has no direction. It is never visible.
        for place in (0..self.normals.len()).filter(|&place| !is_zero(self.normals[place])) {
            self.members.push((first(&mut self.group, place), place));
        }
        self.members.sort_unstable();
        self.parts.clear();
        for members in self.members.chunk_by(|a, b| a.0 == b.0) {
            self.parts.push(unit(fan.sum(members.iter().map(|&(_, place)| place))));
        }
    }

    /// Returns true if at most [`MAX_FLAT_PARTS`] groups meet and all of them are flat.
    fn is_flat(&self) -> bool {
        if self.parts.len() > MAX_FLAT_PARTS {
            return false;
        }
        let near = FLAT_DEGREES.to_radians().cos();
        let mut groups = self.members.chunk_by(|a, b| a.0 == b.0).zip(&self.parts);
        groups.all(|(members, &part)| {
            members.iter().all(|&(_, place)| cosine(self.normals[place], part) >= near)
        })
    }
}

fn cosine(a: [f32; 3], b: [f32; 3]) -> f64 {
    dot(a.map(f64::from), b.map(f64::from))
}

fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let difference = sub(a.map(f64::from), b.map(f64::from));
    dot(difference, difference)
}

fn is_zero(normal: [f32; 3]) -> bool {
    normal == [0.0; 3]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;
    use crate::math::cross;

    /// A cube with shared vertices, two triangles per side, facing outwards.
    fn cube() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let corner = |k: u32| [0, 1, 2].map(|axis| (k >> axis & 1) as f32 * 2.0 - 1.0);
        let sides =
            [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        ((0..8).map(corner).collect(), triangles.collect())
    }

    /// A blunt cone around the z axis with `sides` sides and height `slope`.
    fn cone(sides: u32, slope: f32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let rim = (0..sides).map(|k| {
            let angle = k as f32 / sides as f32 * std::f32::consts::TAU;
            [angle.cos(), angle.sin(), 0.0]
        });
        let positions: Vec<_> = std::iter::once([0.0, 0.0, slope]).chain(rim).collect();
        let triangles = (0..sides).map(|k| [0, 1 + k, 1 + (k + 1) % sides]);
        (positions, triangles.collect())
    }

    fn of(normals: &Normals, triangles: &[[u32; 3]], k: usize) -> [[f32; 3]; 3] {
        normals.of(k as u32, triangles[k])
    }

    #[test]
    fn a_cube_is_flat_shaded_below_90_degrees_and_smooth_from_90_on() {
        let (positions, triangles) = cube();
        for degrees in [1.0, 45.0, 89.0] {
            let normals =
                creased_normals(&positions, &triangles, &[], [degrees; 2], ("", None)).unwrap();
            for (k, triangle) in triangles.iter().enumerate() {
                let [a, b, c] = triangle.map(|v| positions[v as usize].xyz());
                let flat = unit(cross(sub(b, a), sub(c, a)));
                assert_eq!(of(&normals, &triangles, k), [flat; 3], "{degrees}");
            }
        }
        for degrees in [90.0, 180.0] {
            let normals =
                creased_normals(&positions, &triangles, &[], [degrees; 2], ("", None)).unwrap();
            assert!(normals.creases.is_none());
            assert_eq!(normals.all, vertex_normals(&positions, &triangles));
        }
    }

    #[test]
    fn faces_are_grouped_through_their_neighbours() {
        let (positions, triangles) = cone(24, 2.0);
        let normals = creased_normals(&positions, &triangles, &[], [30.0; 2], ("", None)).unwrap();
        assert!(normals.creases.is_none(), "opposite faces are 127 degrees apart");
        assert!(of(&normals, &triangles, 7)[0][2] > 0.999);
        // Every edge is a crease: each corner at the tip has the normal of its face.
        let normals = creased_normals(&positions, &triangles, &[], [5.0; 2], ("", None)).unwrap();
        let tips: Vec<_> = (0..24).map(|k| of(&normals, &triangles, k)[0]).collect();
        assert!((0..24).all(|k| tips[k] != tips[(k + 1) % 24] && tips[k][2] < 0.6));
        assert!(normals.bytes() > 25 * 12 + 24 * 12);
    }

    #[test]
    fn a_face_without_area_joins_no_fold() {
        // A fold of 80 degrees, with a collapsed face along its edge.
        let [y, x] = [1.9696, 0.3473];
        let positions =
            [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.0; 3], [-2.0, 0.0, 0.0], [x, y, 0.0f32]];
        let triangles = [[0, 3, 1], [0, 1, 2], [0, 2, 4], [2, 1, 4]];
        for (degrees, folded) in [(75.0, true), (89.0, true), (90.0, false)] {
            let normals =
                creased_normals(&positions, &triangles, &[], [degrees; 2], ("", None)).unwrap();
            let at = |k| of(&normals, &triangles, k)[0];
            assert_eq!(at(0) != at(2), folded, "{degrees}");
        }
    }

    /// The cosine of 0.08 degrees is 1 but for a millionth.
    #[test]
    fn small_angles_are_told_apart() {
        for fold in [0.003f64, 0.03, 0.3] {
            let rise = fold.to_radians().tan() as f32;
            let positions = [[0.0; 3], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [1.0, 0.0, rise]];
            let triangles = [[0, 1, 2], [1, 0, 3]];
            for (factor, folded) in [(0.9, true), (1.0, false), (1.1, false)] {
                let normals =
                    creased_normals(&positions, &triangles, &[], [fold * factor; 2], ("", None))
                        .unwrap();
                assert_eq!(normals.creases.is_some(), folded, "{fold} {factor}");
            }
        }
    }

    /// Two walls with a fold of 12 degrees between them, over a floor. The edge of the left wall
    /// has a vertex of the right wall in its middle.
    #[test]
    fn stitches_join_the_faces_beside_them() {
        let (y, x) = 12f32.to_radians().sin_cos();
        let positions =
            [[0.0; 3], [0.0, 3.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [x, 0.0, -y]];
        let triangles = [[0, 1, 3], [0, 4, 2], [2, 4, 1], [3, 0, 4]];
        for (stitches, joined) in [(&[][..], false), (&[[0, 2, 1]], true), (&[[2, 1, 0]], true)] {
            let normals =
                creased_normals(&positions, &triangles, stitches, [30.0; 2], ("", None)).unwrap();
            let at = |k| of(&normals, &triangles, k)[0];
            assert_eq!(at(0) == at(1), joined, "{stitches:?}");
            assert_eq!(of(&normals, &triangles, 3)[1], [0.0, 1.0, 0.0]);
        }
    }

    #[test]
    fn one_crease_marks_only_the_triangles_at_it() {
        // A strip of ten squares with one fold of 60 degrees, between the fifth and the sixth.
        let at = |k: u32| match k.checked_sub(5) {
            None => [k as f32, 0.0],
            Some(beyond) => [5.0 + 0.5 * beyond as f32, 0.75f32.sqrt() * beyond as f32],
        };
        let row = |k: u32, y: f32| [at(k)[0], y, at(k)[1]];
        let positions: Vec<_> = (0..=10).flat_map(|k| [row(k, 0.0), row(k, 1.0)]).collect();
        let squares = (0..10).map(|k| 2 * k);
        let triangles: Vec<_> =
            squares.flat_map(|a| [[a, a + 2, a + 1], [a + 1, a + 2, a + 3]]).collect();
        let normals = creased_normals(&positions, &triangles, &[], [40.0; 2], ("", None)).unwrap();
        let creases = normals.creases.as_ref().unwrap();
        let marked: Vec<u32> = (0..20).filter(|&k| creases.of(k).is_some()).collect();
        assert_eq!(
            marked,
            [10, 11],
            "only the two triangles beyond the fold have additional normals"
        );
        let tilt = |k: usize| of(&normals, &triangles, k).map(|n| (n[2] * 1e3).round() / 1e3);
        assert_eq!(
            (tilt(8), tilt(9), tilt(10), tilt(11)),
            ([1.0; 3], [1.0; 3], [0.5; 3], [0.5; 3])
        );
    }

    /// At (55, 30) degrees the 45-degree ridge between the flat sides of a roof is a crease. Among
    /// bumps the same angles give fewer creases than (30, 30).
    #[test]
    fn the_smaller_angle_applies_only_between_flat_parts() {
        let size = 8;
        let field = |height: fn(i32, i32) -> f32| {
            let cells = (0..size).flat_map(|j| (0..size).map(move |i| (i, j)));
            let positions: Vec<_> = (0..=size)
                .flat_map(|j| (0..=size).map(move |i| [i as f32, j as f32, height(i, j)]))
                .collect();
            let triangles: Vec<[u32; 3]> = cells
                .flat_map(|(i, j)| {
                    let a = (j * (size + 1) + i) as u32;
                    let (b, c, d) = (a + 1, a + size as u32 + 2, a + size as u32 + 1);
                    [[a, b, c], [a, c, d]]
                })
                .collect();
            [[55.0, 30.0], [30.0, 30.0], [55.0, 55.0]].map(|angles| {
                let results =
                    creased_normals(&positions, &triangles, &[], angles, ("", None)).unwrap();
                results.creases.map_or(0, |creases| creases.normals.len())
            })
        };
        // Rises by 22.5 degrees, then falls by 22.5 degrees.
        let roof = |i: i32, _: i32| (4 - (i - 4).abs()) as f32 * 0.414_213_57;
        assert_eq!(
            field(roof),
            [16, 16, 0],
            "both triangles of each square on one side of the ridge are marked"
        );
        let bumps = |i: i32, j: i32| ((i * i * 31 + j * j * 17 + i * j * 7) % 7) as f32 * 0.07;
        let [bumpy, sharp, blunt] = field(bumps);
        assert!(blunt == 0 && bumpy < sharp, "{bumpy}, {sharp}, {blunt}");
    }

    /// At most three parts meet, and each is flat to 5 degrees.
    #[test]
    fn more_parts_or_bent_ones_are_not_flat() {
        // The normals at the middle of a fan of triangles, of which the first corner is the middle.
        let middles = |positions: &[[f32; 3]], triangles: &[[u32; 3]]| {
            let normals =
                creased_normals(positions, triangles, &[], [55.0, 30.0], ("", None)).unwrap();
            (0..triangles.len()).map(|k| of(&normals, triangles, k)[0]).collect::<Vec<_>>()
        };
        // Pyramids, neighbouring faces of which are 40 degrees apart.
        for (sides, slope, creased) in [(3, 0.215, true), (4, 0.39, false)] {
            let (positions, triangles) = cone(sides, slope);
            let tips = middles(&positions, &triangles);
            assert_eq!(tips[0] != tips[1], creased, "{sides}: {tips:?}");
        }
        // A roof with a ridge of 40 degrees. Each of its sides has two faces, `bend` away from
        // their mean.
        for (bend, creased) in [(4.8f32, true), (5.2, false)] {
            let slope = 0.37f32;
            let fall = bend.to_radians().tan() * slope.hypot(1.0);
            let positions = [
                [0.0; 3],
                [1.0, 0.0, -slope],
                [0.0, 1.0, -fall],
                [-1.0, 0.0, -slope],
                [0.0, -1.0, -fall],
            ];
            let [a, b, c, d] =
                middles(&positions, &[[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])[..]
            else {
                unreachable!()
            };
            assert_eq!(([a, b] == [d, c], a != b), (true, creased), "{bend}");
        }
    }

    #[test]
    fn memory_for_creases_is_limited() {
        let (positions, triangles) = cone(3000, 2.0);
        let make = |bytes| {
            let limit = Some(MemoryLimit { bytes, set_by_user: true });
            creased_normals(&positions, &triangles, &[], [0.01; 2], ("m.ply", limit))
        };
        let table = VertexFaces::new(positions.len(), &triangles).bytes();
        // Each vertex of the rim has one additional normal, and the tip 2999.
        let lists = 12 * (3000 + 2999) * 2;
        assert_eq!(make(table + lists - 1).unwrap_err().kind, ErrorKind::Limit);
        let made = make(table + 3 * lists).unwrap();
        assert_eq!(made.all.len(), 3001 + 3000 + 2999);
    }

    #[test]
    fn degenerate_meshes_give_the_same_finite_normals_for_any_number_of_threads() {
        let (positions, mut triangles) = cone(3000, 0.3);
        triangles.extend([[0, 0, 1], [5, 6, 5], [7, 7, 7], [0, 2, 1], [1, 2, 0]]);
        let make = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let results = pool
                .install(|| creased_normals(&positions, &triangles, &[], [20.0; 2], ("", None)))
                .unwrap();
            (0..triangles.len()).map(|k| of(&results, &triangles, k)).collect::<Vec<_>>()
        };
        let one = make(1);
        assert!(one.iter().flatten().flatten().all(|x| x.is_finite()));
        for threads in [2, 5] {
            assert!(make(threads) == one, "{threads} threads");
        }
    }
}
