//! Predicts how much memory an accelerator will need.
//!
//! Embree's figures are measured: two small generated meshes are built, and Embree's memory monitor
//! returns the bytes of each. A line through the two gives the bytes for any number of triangles.
//! Bytes per triangle vary little from mesh to mesh: 65 to 71 for bunny, spot and generated meshes
//! of 16 thousand to 18 million triangles.

use super::accelerator::{BuildInfo, BuildOptions};
use super::footprint::MemoryFootprint;
use super::geometry_ref::GeometryRef;
use super::part::build_embree;
use crate::error::Result;
use crate::geometry::{Geometry, TriangleMesh, Unseen};
use crate::monitor::Monitor;
use crate::scene::Backend;

/// Rows of the two generated meshes. A mesh of n rows has 4 n^2 triangles.
///
/// Both are built in some 20 ms. They are large compared with the blocks in which Embree allocates.
const ROWS: [u32; 2] = [64, 128];

/// Bytes of the files that `make setup` installs, rounded up: Embree 4.4.0 has 39.9 million bytes,
/// TBB 4.2 million.
const EMBREE_LIBRARY_BYTES: u64 = 44 << 20;

/// Returns the memory of `backend` with `threads` build threads. Embree is measured, in the
/// caller's rayon pool.
///
/// # Errors
/// Those of [`super::build`] if Embree is measured; else none.
pub fn memory_footprint(backend: Backend, threads: usize) -> Result<MemoryFootprint> {
    match backend {
        Backend::Embree(mode) => {
            let options = BuildOptions { threads, max_bytes: None };
            measure(|geometry| {
                let all = (GeometryRef::Borrowed(geometry), &Unseen::NONE);
                Ok(build_embree(all, mode, &options, &Monitor::default())?.info())
            })
        }
        Backend::Bvh(_) => Ok(MemoryFootprint::BVH),
        Backend::Coursework => Ok(MemoryFootprint::COURSEWORK),
        Backend::Brute => Ok(MemoryFootprint::BRUTE),
    }
}

fn measure(build: impl Fn(&Geometry) -> Result<BuildInfo>) -> Result<MemoryFootprint> {
    let build = |rows| {
        let geometry = bumpy_sphere(rows);
        Ok((geometry.meshes[0].triangles().len() as f64, build(&geometry)?))
    };
    let [few, many] = ROWS;
    Ok(MemoryFootprint::through([build(few)?, build(many)?], EMBREE_LIBRARY_BYTES))
}

/// Returns a bumpy sphere without symmetry, of `4 rows^2` triangles, with holes at the poles.
fn bumpy_sphere(rows: u32) -> Geometry {
    let columns = 2 * rows;
    let vertex = |row: u32, column: u32| {
        let latitude = (f64::from(row) + 0.5) / f64::from(rows + 1) * std::f64::consts::PI;
        let longitude = f64::from(column) / f64::from(columns) * std::f64::consts::TAU;
        let radius = 1.0 + 0.1 * (7.0 * longitude).sin() * (9.0 * latitude + longitude).sin();
        let ((s, c), (x, z)) = (latitude.sin_cos(), longitude.sin_cos());
        [radius * s * x, radius * c, radius * s * z].map(|v| v as f32)
    };
    let vertices = (0..=rows).flat_map(|r| (0..columns).map(move |c| vertex(r, c))).collect();
    let quads = (0..rows).flat_map(|row| {
        (0..columns).map(move |column| {
            let next = (column + 1) % columns;
            let at = |row: u32, column: u32| row * columns + column;
            [at(row, column), at(row + 1, column), at(row, next), at(row + 1, next)]
        })
    });
    let triangles = quads.flat_map(|[a, b, c, d]| [[a, b, c], [c, b, d]]).collect();
    let mesh = TriangleMesh::new(vertices, triangles, false);
    // Cannot fail: the limit is 2^32 - 2 primitives.
    Geometry::new(glam::DVec3::ZERO, vec![mesh], Vec::new(), Vec::new()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::PrimitiveCounts;

    #[test]
    fn a_linear_footprint_is_recovered_from_two_builds() {
        let build = |geometry: &Geometry| {
            let n = geometry.meshes[0].triangles().len() as u64;
            Ok(BuildInfo { bytes: 1000 + 64 * n, peak_bytes: 2000 + 100 * n, ..Default::default() })
        };
        let footprint = measure(build).unwrap();
        assert_eq!(footprint.built_bytes(PrimitiveCounts::new(1_000_000)), 64_001_000);
        assert_eq!(footprint.peak_bytes(PrimitiveCounts::new(10)), 3000);
        assert_eq!(footprint.peak_bytes(PrimitiveCounts::new(0)), 0);
        assert_eq!(footprint.peak_bytes(PrimitiveCounts::new(u64::MAX)), u64::MAX);
    }
}
