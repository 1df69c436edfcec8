//! Which points see each other.

use glam::DVec3;

use super::inside::check_points;
use super::progress;
use super::scene::RayScene;
use crate::accel::bvh::Bvh;
use crate::error::{Error, Result};
use crate::geometry::segment_crosses;
use crate::monitor::Monitor;
use crate::ray::{Mask, Rays};
use crate::reserve;
use crate::units::plural;

impl RayScene {
    /// Returns whether each of `points` is visible from the point of `from` with the same index, or
    /// from the only point of `from`.
    ///
    /// The answer is exact: the segment between the points is tested without rounding. This needs
    /// coordinates that are 0 or at least 1e-70 in magnitude. The segment is blocked by a face that
    /// it passes through, edges and vertices included. A face whose plane contains one of the two
    /// points does not block it. So vertices and other points of the surface do not hide
    /// themselves. Points less than some 1e-38 apart always see each other.
    ///
    /// # Errors
    /// `Invalid` for a point that is not finite or beyond 1e18, or another number of points in
    /// `from`. Also those of [`RayScene::all_hits`].
    pub fn visible(
        &self,
        points: &[[f64; 3]],
        from: &[[f64; 3]],
        monitor: &Monitor,
    ) -> Result<Vec<bool>> {
        check_points(points)?;
        check_points(from).map_err(|mut error| {
            error.problems.iter_mut().for_each(|p| p.place = p.place.replacen("points", "from", 1));
            error
        })?;
        if from.len() != points.len() && from.len() != 1 {
            let (found, count) = (from.len(), points.len());
            let expected = if count == 1 { "1".into() } else { format!("1 or {count}") };
            let message = format!("found {}, expected {expected}", plural(found, "point"));
            return Err(Error::invalid("from", message));
        }
        let mut visible = reserve::filled(false, points.len(), "visible")?;
        let bvh = self.bvh()?;
        progress::fill(&mut visible, monitor, |first, visible| {
            for (i, visible) in visible.iter_mut().enumerate() {
                let from = from[if from.len() == 1 { 0 } else { first + i }];
                *visible = !self.is_blocked(&bvh, from, points[first + i]);
            }
            Ok(())
        })?;
        Ok(visible)
    }

    fn is_blocked(&self, bvh: &Bvh, from: [f64; 3], to: [f64; 3]) -> bool {
        let (start, way) = (DVec3::from(from) - self.origin(), DVec3::from(to) - DVec3::from(from));
        let mut rays = Rays::EMPTY;
        rays.set(0, start.as_vec3(), way.as_vec3());
        rays.tfar[0] = 1.0;
        let mut lane = Mask::NONE;
        lane.0[0] = -1;
        // Two points that are equal, or too near to each other for f32, see each other.
        if !rays.possible(&lane).any() {
            return false;
        }
        bvh.any_near(&rays, &mut |primitive| {
            segment_crosses(self.corners(primitive).map(|corner| corner.to_array()), from, to)
        })
    }
}
