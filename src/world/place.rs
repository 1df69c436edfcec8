//! Places the mesh of a file in the world, and rounds it to f32 relative to the scene's origin.
//!
//! A vertex p becomes `linear (p - middle) + center - origin`, in f64. `linear` rotates and scales
//! (keys `rotate`, `size`, `fit`). With `fit`, `middle` is the centre of the bounding box in the
//! file, else 0.

use std::path::PathBuf;

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::bounds::Bounds;
use super::colors;
use super::resolution::{CollapseSuspect, Detail, Resolution, ulp};
use crate::error::{Error, Problem, Result};
use crate::geometry::{Sphere, TriangleMesh};
use crate::mesh::{self, Mesh, Positions, Uvs};
use crate::output::legend::Legend;
use crate::parallel::{self, GRAIN};
use crate::reserve::{self, MemoryLimit};
use crate::scene::written::MAX_COORDINATE;
use crate::scene::{Smooth, Trimesh};
use crate::shading::{MeshColors, Shape, UvSource};
use crate::units::counted;

/// Size in bytes of a point: its sphere and the index of its shape.
const POINT_BYTES: usize = size_of::<Sphere>() + size_of::<u32>();

/// A mesh with its transform to world space: `linear (p - middle) + center`.
pub struct PlacedMesh {
    mesh: Mesh,
    colors: Option<MeshColors>,
    legend: Option<Legend>,
    spec: Trimesh,
    /// Rotation and uniform scale.
    linear: DMat3,
    middle: DVec3,
    /// Bounding box of the used vertices in world space, or of their spheres.
    bounds: Bounds,
}

impl PlacedMesh {
    /// Computes the transform and the world bounds of a mesh, and takes the colours that it shows.
    ///
    /// # Errors
    /// A texture without texture coordinates, requested colours or points that the mesh was not
    /// read with, or a coordinate above [`MAX_COORDINATE`].
    pub fn new(
        mut mesh: Mesh,
        spec: &Trimesh,
        textured: bool,
        warnings: &mut Vec<Problem>,
    ) -> Result<Self> {
        warn(&mesh, spec, textured, warnings);
        if textured && mesh.uvs.is_none() {
            return Err(Error::invalid(
                &spec.place,
                format!(
                    "{} has no texture coordinates, but its material has a texture",
                    spec.path.display()
                ),
            )
            .help("give the file `s t` or `u v` vertex properties, or drop `tPath`"));
        }
        if spec.points.is_some() && !mesh.is_cloud() {
            let message = format!("{} was not read as points", spec.path.display());
            return Err(Error::invalid(&spec.place, message));
        }
        let (colors, legend) = colors::take(&mut mesh, spec, textured, warnings)?;
        let used = mesh.used_vertices();
        let in_file = spec.fit.map_or(Bounds::EMPTY, |_| bounds(&mesh, &used, |p| p));
        let (linear, middle) = placement(spec, in_file);
        let offset = spec.center - linear * middle;
        let mut bounds = bounds(&mesh, &used, |p| linear * p + offset);
        if let Some(radius) = spec.points {
            let radius = radius * linear.x_axis.length();
            bounds = Bounds { min: bounds.min - radius, max: bounds.max + radius };
        }
        let furthest = bounds.min.abs().max(bounds.max.abs()).max_element();
        // `!(a <= b)` also refuses NaN.
        if !(furthest <= MAX_COORDINATE) {
            return Err(Error::invalid(
                &spec.place,
                format!(
                    "a coordinate of {} is {furthest:e}, expected at most {MAX_COORDINATE:e}",
                    spec.path.display()
                ),
            ));
        }
        Ok(Self { mesh, colors, legend, spec: spec.clone(), linear, middle, bounds })
    }

    /// Returns the legend of the colour map, if the mesh shows a property.
    pub fn legend(&self) -> Option<&Legend> {
        self.legend.as_ref()
    }

    /// Returns the bounding box of all used vertices in world space, or of their spheres.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Returns the map from vertices of an f32 file to f32 positions relative to `origin`. One
    /// multiplication and one addition are precise enough: f64 has 29 bits more than the
    /// coordinates of the file.
    #[inline(always)]
    fn placed(&self, origin: DVec3) -> impl Fn(DVec3) -> [f32; 3] + Sync + use<> {
        let linear = self.linear;
        let offset = (self.spec.center - origin) - linear * self.middle;
        move |p| (linear * p + offset).as_vec3().to_array()
    }

    /// Returns the map from vertices of an f64 file to f32 positions relative to `origin`. The
    /// differences are computed first, so large coordinates become small before they are rotated,
    /// scaled and rounded.
    #[inline(always)]
    fn placed_exactly(&self, origin: DVec3) -> impl Fn(DVec3) -> [f32; 3] + Sync + use<> {
        let (linear, middle, center) = (self.linear, self.middle, self.spec.center - origin);
        move |p| (linear * (p - middle) + center).as_vec3().to_array()
    }

    /// Returns the largest absolute coordinate of the mesh relative to `origin`, in world units.
    fn reach(&self, origin: DVec3) -> f64 {
        let Bounds { min, max } = self.bounds;
        (min - origin).abs().max((max - origin).abs()).max_element()
    }

    /// Measures the resolution of the mesh in f32 relative to `origin`.
    pub fn resolution(&self, origin: DVec3) -> Resolution {
        let (mesh, spec) = (&self.mesh, &self.spec);
        // The scale is uniform, so any axis gives it.
        let scale = self.linear.x_axis.length();
        let exact = |i: u32| mesh.positions.get(i as usize);
        let (farthest, all) = (self.reach(origin), &mesh.triangles);
        let detail = match mesh.positions {
            Positions::F32(_) => Detail::new(farthest, all, scale, exact, self.placed(origin)),
            Positions::F64(_) => {
                Detail::new(farthest, all, scale, exact, self.placed_exactly(origin))
            }
        };
        Resolution { place: spec.place.clone(), path: spec.path.clone(), detail }
    }

    /// Returns a suspect if the two ends of an edge are likely to round to the same f32 point
    /// relative to `origin`. Cheap: looks at the bounding box and at no edge.
    ///
    /// Every f64 file is a suspect. For an f32 file, two f32 grids are compared: at the mesh's
    /// largest coordinate relative to `origin`, and at its largest coordinate in the file. The file
    /// is a suspect if the first grid is more than two bits coarser. A collapse near the zero of
    /// the file, where its own grid is finer, may be missed.
    pub fn collapse_suspect(&self, origin: DVec3) -> Option<CollapseSuspect> {
        let Trimesh { place, path, center, .. } = &self.spec;
        let scale = self.linear.x_axis.length();
        // The largest coordinate in the file, in world units: the reach from the point of the world
        // where the zero of the file lies.
        let in_file = self.reach(*center - self.linear * self.middle);
        let ulp_there = ulp(self.reach(origin));
        let doubtful = match self.mesh.positions {
            Positions::F64(_) => true,
            Positions::F32(_) => ulp_there > 4.0 * scale * ulp(in_file / scale),
        };
        doubtful.then(|| CollapseSuspect {
            place: place.clone(),
            path: path.clone(),
            ulp: ulp_there,
        })
    }

    /// Returns the place in the scene file and the path of the mesh, for messages.
    pub fn place_and_path(&self) -> (String, PathBuf) {
        (self.spec.place.clone(), self.spec.path.clone())
    }

    /// Returns true if the vertices of the file are f64.
    pub fn is_f64(&self) -> bool {
        matches!(self.mesh.positions, Positions::F64(_))
    }

    /// Returns the number of triangles without area in the file, for the warnings after
    /// [`Self::into_triangles`]. `None` if there are none.
    pub fn without_area(&self) -> Option<WithoutArea> {
        let count = self.mesh.notes.degenerate_dropped;
        let path = || self.spec.path.display().to_string();
        (count > 0).then(|| WithoutArea { path: path(), count })
    }

    /// Checks that the memory of [`Self::into_triangles`] or [`Self::append_spheres`] fits into
    /// `limit`. Returns the limit that is left after it. Computed normals are subtracted, 12 bytes
    /// per vertex; f32 positions replace larger or equal ones. The spheres of a cloud are
    /// subtracted; they replace its positions.
    ///
    /// # Errors
    /// As [`MemoryLimit::check`].
    pub fn fits(&self, limit: MemoryLimit) -> Result<MemoryLimit> {
        limit.check(self.conversion_bytes(), &self.spec.path.display().to_string())?;
        let vertices = self.mesh.positions.len();
        let each = match self.mesh.positions {
            Positions::F32(_) if self.is_cloud() => POINT_BYTES - 12,
            Positions::F64(_) if self.is_cloud() => POINT_BYTES - 24,
            _ if self.spec.smooth != Smooth::Off && self.mesh.normals.is_none() => 12,
            _ => 0,
        };
        Ok(limit.less((each * vertices) as u64))
    }

    /// Returns the mesh relative to `origin`, and moves its normals, texture coordinates and
    /// colours to `shape`. `room` is the limit that [`Self::fits`] left after all meshes; normals
    /// at creases are subtracted from it.
    ///
    /// # Errors
    /// `Retry` (exit code 3) if the system refuses the memory. As [`MemoryLimit::check`], if
    /// normals at creases exceed `room`.
    pub fn into_triangles(
        self,
        origin: DVec3,
        shape: &mut Shape,
        room: &mut Option<MemoryLimit>,
    ) -> Result<TriangleMesh> {
        reserve::probe(self.conversion_bytes(), &self.spec.path.display().to_string())?;
        let (placed, placed_exactly) = (self.placed(origin), self.placed_exactly(origin));
        let Self { mesh, colors, spec, linear, .. } = self;
        let vertices = match mesh.positions {
            Positions::F32(mut all) => {
                parallel::each(all.chunks_mut(GRAIN), |all| {
                    all.iter_mut().for_each(|p| *p = placed(DVec3::from(p.map(f64::from))));
                });
                all
            }
            Positions::F64(all) => {
                // One more, for the padding vertex that `TriangleMesh` adds.
                let mut rounded = vec![[0.0; 3]; all.len() + 1];
                rounded.pop();
                parallel::fill(&mut rounded, |i| placed_exactly(DVec3::from(all[i])));
                rounded
            }
        };
        let name = || spec.path.display().to_string();
        shape.normals = match (spec.smooth, mesh.normals) {
            (Smooth::Off, _) => None,
            (_, Some(normals)) => Some(rotated(normals, linear).into()),
            (Smooth::All, None) => Some(mesh::vertex_normals(&vertices, &mesh.triangles).into()),
            // `flat` is the angle of creases between flat parts, normally smaller than `angle`.
            (Smooth::Below { angle, flat }, None) => {
                let angles = [angle, flat];
                let (faces, stitches) = (&mesh.triangles, &mesh.stitches);
                let memory = (&*name(), *room);
                let all = mesh::creased_normals(&vertices, faces, stitches, angles, memory)?;
                let additional = all.bytes() - 12 * vertices.len() as u64;
                *room = room.map(|room| room.less(additional));
                Some(all)
            }
        };
        shape.uv = match mesh.uvs {
            None => UvSource::None,
            Some(Uvs::PerVertex(uv)) => UvSource::PerVertex(uv),
            Some(Uvs::PerCorner(uv)) => UvSource::PerCorner(uv),
        };
        shape.colors = colors;
        // The last argument is `loop_only`: a linear list of triangles, for `bvh: false`.
        let placed = TriangleMesh::new(vertices, mesh.triangles, !spec.bvh);
        Ok(placed.with_stitches(&mesh.stitches))
    }

    /// Returns true if the mesh is shared by instances.
    pub fn is_shared(&self) -> bool {
        self.spec.transform.is_some()
    }

    /// Returns true if the vertices are drawn as spheres.
    pub fn is_cloud(&self) -> bool {
        self.mesh.is_cloud()
    }

    /// Appends a sphere for every point to `spheres`, relative to `origin`, and sets the colours of
    /// `shape`.
    ///
    /// # Errors
    /// `Retry` (exit code 3) if the system refuses the memory. `Invalid` if the radius in world
    /// units is zero, subnormal or not finite.
    pub fn append_spheres(
        self,
        origin: DVec3,
        shape: &mut Shape,
        spheres: &mut Vec<Sphere>,
    ) -> Result<()> {
        let Self { mesh, colors, spec, linear, middle, .. } = self;
        let radius = spec.points.unwrap_or(0.0) * linear.x_axis.length();
        if !radius.is_normal() {
            let message = format!("found points of radius {radius:e}, expected more than 0");
            return Err(Error::invalid(&spec.place, message));
        }
        let first = spheres.len();
        reserve::exact(spheres, mesh.positions.len(), &spec.path.display().to_string())?;
        let center = spec.center - origin;
        let place = |p: DVec3| Sphere { center: linear * (p - middle) + center, radius };
        let points = (0..mesh.positions.len()).into_par_iter();
        spheres.par_extend(points.map(|i| place(mesh.positions.get(i))));
        // `gather` refuses too many primitives before an index is used.
        shape.first = u32::try_from(first).unwrap_or(u32::MAX);
        shape.colors = colors;
        Ok(())
    }

    /// Returns the memory in bytes that [`PlacedMesh::into_triangles`] or
    /// [`PlacedMesh::append_spheres`] needs in addition to the mesh.
    ///
    /// An f64 file needs f32 positions, 12 bytes per vertex. Computed normals need 20 bytes per
    /// vertex and 12 per triangle: the normals, and a table of the faces around each vertex. The
    /// triangles beside stitches are found in [`mesh::stitching_bytes`].
    fn conversion_bytes(&self) -> u64 {
        let (vertices, triangles) = (self.mesh.positions.len(), self.mesh.triangles.len());
        if self.is_cloud() {
            return (POINT_BYTES * vertices) as u64;
        }
        let rounded = match self.mesh.positions {
            Positions::F32(_) => 0,
            Positions::F64(_) => 12 * vertices,
        };
        let normals = match self.spec.smooth != Smooth::Off && self.mesh.normals.is_none() {
            true => 20 * vertices + 12 * triangles,
            false => 0,
        };
        (rounded + normals) as u64 + mesh::stitching_bytes(self.mesh.stitches.len(), vertices)
    }
}

/// Number of triangles without area in a file. Some of them are kept as stitches
/// ([`TriangleMesh::with_stitches`]), which close T-junctions; the others are dropped.
pub struct WithoutArea {
    path: String,
    /// Dropped triangles and stitches together.
    count: u64,
}

impl WithoutArea {
    /// Returns a warning with the number of dropped triangles, and one with the number of stitches
    /// in the placed `mesh`.
    pub fn warnings(&self, mesh: &TriangleMesh) -> impl Iterator<Item = Problem> {
        let kept = mesh.stitches() as u64;
        let dropped = self.count.saturating_sub(kept);
        let counts = [
            (
                dropped,
                [
                    "degenerate triangle (zero area) was dropped",
                    "degenerate triangles (zero area) were dropped",
                ],
            ),
            (
                kept,
                [
                    "triangle without area is kept: it closes a T-junction",
                    "triangles without area are kept: they close T-junctions",
                ],
            ),
        ];
        let nonzero = counts.into_iter().filter(|(count, _)| *count > 0);
        nonzero.map(|(count, what)| Problem::new(&self.path, counted(count, what)))
    }
}

/// Returns the file's normals, rotated with the mesh and normalised. Zero normals stay zero. A
/// normal that is not finite becomes NaN, with which no normal is interpolated.
fn rotated(mut normals: Vec<[f32; 3]>, linear: DMat3) -> Vec<[f32; 3]> {
    parallel::each(normals.chunks_mut(GRAIN), |normals| {
        for n in normals {
            let turned = linear * DVec3::from(n.map(f64::from));
            *n = turned.normalize_or(turned * 0.0).as_vec3().to_array();
        }
    });
    normals
}

/// Returns `linear` (rotation and uniform scale) and `middle` (the point of the file that is placed
/// at `center`): world = linear (file - middle) + center. `in_file` is the bounding box in the
/// coordinates of the file; only `fit` uses it.
pub fn placement(spec: &Trimesh, in_file: Bounds) -> (DMat3, DVec3) {
    let [x, y, z] = spec.rotate_deg.to_array().map(f64::to_radians);
    let rotation =
        DMat3::from_rotation_z(z) * DMat3::from_rotation_y(y) * DMat3::from_rotation_x(x);
    // Quarter turns are made exact: they only swap and negate coordinates. So the mesh keeps its
    // exact shape.
    let exact = |x: f64| if (x - x.round()).abs() < 1e-15 { x.round() } else { x };
    let rotation = DMat3::from_cols_array(&rotation.to_cols_array().map(exact));
    match spec.fit {
        Some(fit) => (rotation * (fit / extent(spec, in_file) * spec.size), in_file.center()),
        None => (rotation * spec.size, DVec3::ZERO),
    }
}

/// Returns the length that `fit` scales: the longest side of the bounding box of the used vertices.
/// For points at one place, the diameter of their spheres.
pub fn extent(spec: &Trimesh, in_file: Bounds) -> f64 {
    let longest = in_file.longest_side();
    match spec.points {
        Some(radius) if longest == 0.0 => 2.0 * radius,
        _ => longest,
    }
}

fn bounds(mesh: &Mesh, used: &[bool], place: impl Fn(DVec3) -> DVec3 + Sync) -> Bounds {
    Bounds::from_points(used.len(), |i: usize| used[i].then(|| place(mesh.positions.get(i))))
}

fn warn(mesh: &Mesh, spec: &Trimesh, textured: bool, warnings: &mut Vec<Problem>) {
    let notes = &mesh.notes;
    let dropped = [
        (
            notes.duplicates_dropped,
            ["duplicate triangle was dropped", "duplicate triangles were dropped"],
        ),
        (
            notes.repaired_dropped,
            match mesh.is_cloud() {
                true => [
                    "point that is not finite was dropped (--repair)",
                    "points that are not finite were dropped (--repair)",
                ],
                false => [
                    "triangle with a bad vertex was dropped (--repair)",
                    "triangles with bad vertices were dropped (--repair)",
                ],
            },
        ),
        (
            notes.textures_repaired,
            [
                "face with a texnumber out of range is shown without a texture (--repair)",
                "faces with a texnumber out of range are shown without a texture (--repair)",
            ],
        ),
        (
            notes.faces_too_small,
            [
                "face with fewer than three corners was skipped",
                "faces with fewer than three corners were skipped",
            ],
        ),
    ];
    let path = spec.path.display().to_string();
    if notes.textures > 1 && textured {
        let message = format!(
            "its faces use {} textures (texnumber), but one of them is shown on all faces",
            notes.textures
        );
        warnings.push(
            Problem::new(&path, message)
                .help("without `tPath`, the textures that the file names are shown"),
        );
    }
    if notes.alpha_ignored && spec.vertex_colors {
        let message = "the alpha of all its colours is 0; it is ignored";
        warnings.push(Problem::new(&path, message));
    }
    let of_file = spec.vertex_colors && spec.color.is_none() && !textured;
    let is_ignored = |channel: &str| notes.ignored.iter().any(|name| name == channel);
    let unread = ["vertex.red", "vertex.green", "vertex.blue"].into_iter().all(is_ignored);
    if of_file && unread && mesh.colors.is_none() && mesh.face_colors.is_none() {
        let message = "its red, green and blue are not shown: expected the same type for all, \
                       uchar, ushort, float or double";
        warnings.push(Problem::new(&path, message));
    }
    let normals = mesh.normals.as_ref().filter(|_| spec.smooth != Smooth::Off);
    let normals = normals.map_or(0, |all| not_finite(all));
    let shows_image = textured || (spec.color.is_none() && mesh.texture_file.is_some());
    let uvs = match &mesh.uvs {
        Some(Uvs::PerVertex(all)) if shows_image => not_finite(all),
        Some(Uvs::PerCorner(all)) if shows_image => not_finite(all.as_flattened()),
        _ => 0,
    };
    let not_finite = [
        (
            normals,
            [
                "normal is not finite; its triangles are shown flat",
                "normals are not finite; their triangles are shown flat",
            ],
        ),
        (
            uvs,
            [
                "pair of texture coordinates is not finite; its triangles show arbitrary texels",
                "pairs of texture coordinates are not finite; their triangles show arbitrary texels",
            ],
        ),
    ];
    for (count, what) in dropped.into_iter().chain(not_finite).filter(|(count, _)| *count > 0) {
        warnings.push(Problem::new(&path, counted(count, what)));
    }
}

/// Returns the number of rows with a number that is NaN or infinite.
fn not_finite<const N: usize>(rows: &[[f32; N]]) -> u64 {
    let is_bad = |row: &&[f32; N]| !row.iter().all(|x| x.is_finite());
    let counts =
        parallel::map(rows.chunks(GRAIN), |rows| rows.iter().filter(is_bad).count() as u64);
    counts.into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{self, ShapeKind, Source};

    /// Reads a cloud of 3 points as a mesh of the scene.
    fn cloud(vertex: &str) -> PlacedMesh {
        let folder = tempfile::tempdir().unwrap();
        let ply = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty {vertex} x\nproperty {vertex} y\n\
             property {vertex} z\nend_header\n0 0 0\n1 0 0\n0 1 0\n"
        );
        std::fs::write(folder.path().join("cloud.ply"), ply).unwrap();
        let text = br#"{ "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 40,
            "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] }, "scene": { "shapes": [
            { "type": "trimesh", "path": "cloud.ply", "points": 0.1, "material": {} }] } }"#;
        let source = Source::Text { name: "test", text, folder: folder.path() };
        let scene = scene::load(source, &[]).unwrap().scene;
        let ShapeKind::Trimesh(spec) = &scene.shapes[0].kind else { unreachable!() };
        let mesh = mesh::read_ply(&spec.path, mesh::ReadOptions::default().points(true)).unwrap();
        PlacedMesh::new(mesh, spec, false, &mut Vec::new()).unwrap()
    }

    /// The spheres of a cloud replace its positions, and stay when the next cloud is placed.
    #[test]
    fn clouds_share_the_room() {
        for (vertex, replaced) in [("float", 12), ("double", 24)] {
            let cloud = cloud(vertex);
            let spheres = 3 * POINT_BYTES as u64;
            let room = MemoryLimit { bytes: spheres, set_by_user: true };
            let left = cloud.fits(room).unwrap();
            assert_eq!(left.bytes, 3 * replaced);
            assert!(cloud.fits(left).is_err());
        }
    }
}
