//! Conservative query of what the frustum around the rays of a packet contains.

use super::{Bits, Packet};
use crate::accel::Cone;
use crate::accel::bvh::leaves::{Leaf, Leaves};
use crate::accel::bvh::simd::Tier;

impl<T: Tier> Packet<'_, T> {
    /// Returns which primitives may lie inside the frustum. A triangle counts as outside if all its
    /// corners lie outside one plane of the frustum. A leaf of spheres counts as inside if the
    /// frustum overlaps its box.
    ///
    /// The result also holds for every ray inside the cone that the rays of the packet span, if all
    /// rays share one origin:
    ///
    /// - The direction of such a ray is a sum of the packet's directions with factors >= 0. Its
    ///   slope is a quotient of linear functions of the factors. So its extremes are at the
    ///   corners: the slope lies between those of the packet's rays.
    /// - Rounding moves the slope of such a ray and that of a ray of the packet by at most 3u each
    ///   (u = 2^-24). At a vertex v, seen from the origin o, this is 6u max|v - o|. The frustum's
    ///   slack has 120u left for it.
    #[inline(always)]
    pub fn contents(&self) -> Cone {
        let frustum = (&self.frustum, self.end_depth);
        let mut contents = Cone::Empty;
        for leaf in Leaves::new(self.tier, self.tree, frustum) {
            let Leaf::Triangles(index, triangles) = leaf else { return Cone::Any };
            for slot in Bits(triangles) {
                let primitive = self.tree.indices().of(&self.tree.blocks[index], slot);
                if contents != Cone::Empty && contents != Cone::Primitive(primitive) {
                    return Cone::Any;
                }
                contents = Cone::Primitive(primitive);
            }
        }
        contents
    }
}
