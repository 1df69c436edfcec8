//! Which points lie inside the meshes.

use std::sync::OnceLock;

use glam::DVec3;

use super::batch::{first, fits};
use super::closed;
use super::progress;
use super::scene::RayScene;
use crate::accel::bvh::{Bvh, HalfLine};
use crate::error::{Error, Result};
use crate::geometry::{HalfLineIntersection, half_line};
use crate::monitor::Monitor;
use crate::reserve;

/// Buffers of a thread's share of the points.
#[derive(Default)]
struct Scratch {
    stack: Vec<u32>,
    found: Vec<u32>,
    /// Meshes with an odd number of crossings.
    odd: Vec<usize>,
}

impl RayScene {
    /// For each mesh, whether it is closed: every edge belongs to an even number of faces. Vertices
    /// with equal coordinates count as one.
    ///
    /// # Errors
    /// `Retry` if there is too little memory now; `Interrupted` if the monitor was stopped.
    pub fn closed(&self, monitor: &Monitor) -> Result<&[bool]> {
        known(&self.closed, || {
            let meshes = self.meshes.iter();
            meshes.map(|mesh| closed::is_closed(mesh.as_ref(), monitor)).collect()
        })
        .map(Vec::as_slice)
    }

    /// Returns whether each point lies inside a mesh or on its surface.
    ///
    /// For each closed mesh the answer is exact: the crossings of a half-line are counted without
    /// rounding, from the caller's coordinates in f64. This needs coordinates of points and
    /// vertices that are 0 or at least 1e-70 in magnitude; below that, a sign may be lost. The
    /// meshes that are not closed are taken together. A point is inside them if their winding
    /// number there, in magnitude, is at least 1/2, as [`RayScene::winding_number`] computes it.
    ///
    /// # Errors
    /// `Invalid` for a point with a coordinate that is not finite or beyond 1e18 in magnitude;
    /// `Unsupported` with the backend Embree; `Retry` if there is too little memory now;
    /// `Interrupted` if the monitor was stopped.
    pub fn contains(&self, points: &[[f64; 3]], monitor: &Monitor) -> Result<Vec<bool>> {
        check_points(points)?;
        let bvh = self.bvh()?;
        let mut inside = reserve::filled(false, points.len(), "contains")?;
        let closed = self.closed(monitor)?;
        let corners =
            |primitive: u32| (!closed[self.place(primitive).0]).then(|| self.corners(primitive));
        let open = match closed.contains(&false) {
            true => Some(known(&self.open_multipoles, || bvh.multipoles(&corners, monitor))?),
            false => None,
        };
        let winding = |multipoles, point| bvh.winding(multipoles, point, &corners);
        progress::fill(&mut inside, monitor, |start, inside| {
            let mut scratch = Scratch::default();
            for (i, inside) in inside.iter_mut().enumerate() {
                let point = points[start + i];
                *inside = self.in_closed(&bvh, point, closed, &mut scratch)
                    || open.is_some_and(|open| winding(open, point.into()).abs() >= 0.5);
            }
            Ok(())
        })?;
        Ok(inside)
    }

    /// Returns the winding number of each point, summed over all meshes: 1 inside a closed mesh
    /// whose normals point outward, -1 if they point inward, 0 outside. The error is at most some
    /// 0.005 for each surface near the point: errors of surfaces in each other add up.
    ///
    /// # Errors
    /// The errors of [`RayScene::contains`].
    pub fn winding_number(&self, points: &[[f64; 3]], monitor: &Monitor) -> Result<Vec<f64>> {
        check_points(points)?;
        let mut winding = reserve::filled(0.0, points.len(), "winding number")?;
        let corners = |primitive: u32| Some(self.corners(primitive));
        let bvh = self.bvh()?;
        let multipoles = known(&self.multipoles, || bvh.multipoles(&corners, monitor))?;
        progress::fill(&mut winding, monitor, |start, winding| {
            for (i, winding) in winding.iter_mut().enumerate() {
                *winding = bvh.winding(multipoles, points[start + i].into(), &corners);
            }
            Ok(())
        })?;
        Ok(winding)
    }

    /// Whether a point lies inside a closed mesh, or on a mesh, closed or not.
    fn in_closed(
        &self,
        bvh: &Bvh,
        point: [f64; 3],
        closed: &[bool],
        scratch: &mut Scratch,
    ) -> bool {
        let (p, [min, max]) = (DVec3::from(point), self.bounds);
        if p.cmplt(min).any() || p.cmpgt(max).any() {
            return false;
        }
        // The half-line leaves through the nearest side of the box: it passes the fewest triangles.
        let (up, down) = ((max - p).to_array(), (p - min).to_array());
        let (mut axis, mut upward) = (0, true);
        for k in 0..3 {
            let least = if upward { up[axis] } else { down[axis] };
            if up[k] < least {
                (axis, upward) = (k, true);
            }
            if down[k] < least.min(up[k]) {
                (axis, upward) = (k, false);
            }
        }
        let axes = [(axis + 1) % 3, (axis + 2) % 3, axis];
        let local = p - self.origin();
        let slack = self.slack(local.abs().max_element());
        let start = axes.map(|k| local[k] as f32);
        let start = [start.map(|x| x - slack), start.map(|x| x + slack)];
        let Scratch { stack, found, odd } = scratch;
        found.clear();
        odd.clear();
        bvh.column(&HalfLine { axes, start, upward }, stack, found);
        for &primitive in found.iter() {
            let corners = self.corners(primitive).map(|corner| corner.to_array());
            match half_line(corners, point, axes, upward) {
                HalfLineIntersection::Misses => {}
                HalfLineIntersection::Starts => return true,
                HalfLineIntersection::Crosses => {
                    let (mesh, _) = self.place(primitive);
                    match odd.iter().position(|&other| other == mesh) {
                        Some(at) => drop(odd.swap_remove(at)),
                        None => odd.push(mesh),
                    }
                }
            }
        }
        odd.iter().any(|&mesh| closed[mesh])
    }
}

/// Returns the value of a cell, which `compute` makes if the cell is empty.
///
/// The cell is not locked while `compute` runs; two threads may both compute the value. With a
/// lock, a thread of a pool that waits for others might begin another query, and wait for itself.
fn known<T>(cell: &OnceLock<T>, compute: impl FnOnce() -> Result<T>) -> Result<&T> {
    if let Some(value) = cell.get() {
        return Ok(value);
    }
    let value = compute()?;
    Ok(cell.get_or_init(|| value))
}

/// Checks that all coordinates are finite and at most 1e18 in magnitude.
pub(super) fn check_points(points: &[[f64; 3]]) -> Result<()> {
    match first(points, |&v| !fits(v)) {
        None => Ok(()),
        Some(i) => {
            let message = format!("found {:?}, expected finite numbers up to 1e18", points[i]);
            Err(Error::invalid(format!("points[{i}]"), message))
        }
    }
}
