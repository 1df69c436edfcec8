//! Conservative test whether the frustum around the rays of a packet contains anything.

use super::Packet;
use crate::accel::bvh::leaves::Leaves;
use crate::accel::bvh::simd::Tier;

impl<T: Tier> Packet<'_, T> {
    /// Returns false only if no primitive lies inside the frustum. A triangle counts as outside if
    /// all its corners lie outside one plane of the frustum. A leaf of spheres counts as inside if
    /// the frustum overlaps its box.
    ///
    /// The result also holds for every ray inside the cone that the rays of the packet span, if all
    /// rays share one origin:
    ///
    /// - The direction of such a ray is a sum of the packet's directions with factors >= 0. Its
    ///   slope is a quotient of linear functions of the factors. So its extremes are at the
    ///   corners: the slope lies between those of the packet's rays.
    /// - Rounding moves the slope of such a ray and that of a ray of the packet by at most 3u each
    ///   (u = 2^-24). At a vertex v, seen from the origin o, this is 6u max|v - o|. The frustum's
    ///   slack has some 20u left for it.
    #[inline(always)]
    pub fn may_contain_anything(&self) -> bool {
        let frustum = (&self.frustum, self.end_depth);
        Leaves::new(self.tier, self.tree, frustum).next().is_some()
    }
}
