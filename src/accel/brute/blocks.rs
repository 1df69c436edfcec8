//! A tree of bounding boxes that culls primitives for `brute`, the backend that decides hits
//! without rounding.
//!
//! The box test is conservative. Every box is widened by far more than the rounding error of the
//! test, so a primitive that the ray hits is never culled.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::accel::lane::LaneRay;
use crate::geometry::{Box3, slabs_meet};
use crate::parallel;

/// Number of neighbouring items, or of neighbouring boxes of one level, that share a box.
const BLOCK: usize = 8;

/// Minimum widening of a box, in units of max |corner - ray origin| over its corners and axes. It
/// is far above the rounding error of the box test. Callers must not pass less.
pub const ROUNDING: f64 = 1.0 / (1u64 << 40) as f64;

/// A tree of boxes over items in Morton order. The lowest level has a box around every [`BLOCK`]
/// items, each further level a box around every [`BLOCK`] boxes of the level below.
pub struct Blocks {
    /// Indices into the caller's list of items, in Morton order.
    order: Vec<u32>,
    /// Boxes of each level, the lowest level first. The last level has at most [`BLOCK`] boxes.
    levels: Vec<Vec<Box3>>,
}

impl Blocks {
    /// Builds the tree over items with these boxes.
    pub fn new(boxes: &[Box3]) -> Self {
        let all = Box3::around(boxes.iter().copied());
        // Along an axis without extent, infinity times 0 gives NaN, which casts to 0. A centre on
        // the upper bound wraps to 0 in `morton`. The order affects only speed.
        let scale = (DVec3::ONE / (all.max - all.min)).max(DVec3::ZERO) * f64::from(1 << 21);
        let mut order = parallel::values(boxes.len(), |item| {
            (morton((boxes[item].center() - all.min) * scale), item as u32)
        });
        order.par_sort_unstable();
        let order: Vec<u32> = order.into_iter().map(|(_, item)| item).collect();
        let items = |block: &[u32]| Box3::around(block.iter().map(|&item| boxes[item as usize]));
        let mut levels = vec![order.chunks(BLOCK).map(items).collect::<Vec<_>>()];
        while levels[levels.len() - 1].len() > BLOCK {
            let below = levels[levels.len() - 1].chunks(BLOCK);
            levels.push(below.map(|block| Box3::around(block.iter().copied())).collect());
        }
        Self { order, levels }
    }

    /// Returns the same tree with `names[i]` in place of each item `i`.
    pub fn renamed(mut self, names: &[u32]) -> Self {
        self.order.iter_mut().for_each(|item| *item = names[*item as usize]);
        self
    }

    /// Calls `candidate` with all items of every box of the lowest level that the ray may hit at a
    /// t in `range`. The caller tests the items themselves.
    ///
    /// Every box is widened by `widen` times its largest |corner - ray origin|, over all corners
    /// and axes. `widen` must be at least [`ROUNDING`].
    pub fn each(&self, ray: &LaneRay, widen: f64, range: [f64; 2], mut candidate: impl FnMut(u32)) {
        let top = self.levels.len() - 1;
        let query = BlockQuery { ray, inverse: ray.direction.recip(), widen, range };
        self.descend(top, 0..self.levels[top].len(), &query, &mut candidate);
    }

    /// Visits `boxes` of one level and the levels below. Recursion is at most ten levels deep: 2^32
    /// items give levels of 2^29, 2^26, and so on to 2^2 boxes.
    fn descend(
        &self,
        level: usize,
        boxes: Range<usize>,
        query: &BlockQuery,
        candidate: &mut impl FnMut(u32),
    ) {
        for index in boxes {
            if !query.may_hit(&self.levels[level][index]) {
                continue;
            }
            let first = index * BLOCK;
            match level.checked_sub(1) {
                None => {
                    let end = self.order.len().min(first + BLOCK);
                    self.order[first..end].iter().for_each(|&item| candidate(item));
                }
                Some(below) => {
                    let end = self.levels[below].len().min(first + BLOCK);
                    self.descend(below, first..end, query, candidate);
                }
            }
        }
    }

    /// Returns the bytes that the order and all boxes hold.
    pub fn bytes(&self) -> u64 {
        let boxes: usize = self.levels.iter().map(|level| size_of_val(&level[..])).sum();
        (size_of_val(&self.order[..]) + boxes) as u64
    }
}

struct BlockQuery<'a> {
    ray: &'a LaneRay,
    inverse: DVec3,
    widen: f64,
    range: [f64; 2],
}

impl BlockQuery<'_> {
    /// Returns whether the ray may hit the widened box at a t in the range.
    ///
    /// Let M be the largest |corner - ray origin| over all corners and axes. Every plane of the box
    /// moves outwards by w = `widen` M. The difference, the reciprocal and the product have
    /// rounding errors. Together they are equivalent to a shift of the plane by less than 4u(M +
    /// w), u = 2^-53. That is far below w for `widen` >= [`ROUNDING`].
    ///
    /// 0 times infinity gives NaN: the ray runs parallel to a widened plane and lies in it. `min`
    /// and `max` drop the NaN, and the other plane may then reject the box. That is right, because
    /// the ray passes the box itself at a distance of w. If w is 0, both values are NaN and reject
    /// nothing.
    #[inline(always)]
    fn may_hit(&self, bounds: &Box3) -> bool {
        let (min, max) = (bounds.min - self.ray.origin, bounds.max - self.ray.origin);
        let w = min.abs().max(max.abs()).max_element() * self.widen;
        slabs_meet((min - w) * self.inverse, (max + w) * self.inverse, self.range)
    }
}

/// Morton code of a point: interleaves the low 21 bits of each coordinate's integer part.
fn morton(p: DVec3) -> u64 {
    let spread = |x: f64| {
        let mut x = x as u64 & 0x1f_ffff;
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            x = (x | (x << shift)) & mask;
        }
        x
    };
    spread(p.x) | (spread(p.y) << 1) | (spread(p.z) << 2)
}
