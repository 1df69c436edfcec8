//! Bounding boxes around blocks of neighbouring primitives: the oracle skips blocks that a ray
//! cannot hit.
//!
//! The boxes are conservative: they are widened by far more than the box test rounds. So they never
//! decide a hit.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::accel::lane::Ray;

/// Number of boxes or items in one block.
const BLOCK: usize = 8;

/// Smallest widening of a box, relative to its largest coordinate as seen from the ray's origin.
pub const ROUNDING: f64 = 1.0 / (1u64 << 40) as f64;

#[derive(Debug, Clone, Copy)]
pub struct Box3 {
    pub min: DVec3,
    pub max: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The bounding box of `points`.
    pub fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn center(&self) -> DVec3 {
        (self.min + self.max) / 2.0
    }

    /// Returns whether the ray may hit the widened box at a t between `near` and `far`.
    ///
    /// Let M be the largest coordinate of the box as seen from the ray's origin. Every plane of the
    /// box moves outwards by w = `widen` M. A difference, a reciprocal and a product round, by less
    /// than 4u(M + w) together (u = 2^-53). That is far below w for `widen` >= [`ROUNDING`]. A NaN
    /// (0 times infinity) is dropped by `min` and `max` and rejects no box.
    #[inline(always)]
    fn may_hit(&self, ray: &Ray, inverse: DVec3, widen: f64, [near, far]: [f64; 2]) -> bool {
        let (min, max) = (self.min - ray.origin, self.max - ray.origin);
        let w = min.abs().max(max.abs()).max_element() * widen;
        let first = ((min - w) * inverse).to_array();
        let second = ((max + w) * inverse).to_array();
        let (mut near, mut far) = (near, far);
        for (a, b) in first.into_iter().zip(second) {
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        near <= far
    }
}

/// A tree of boxes: items in Morton order, a box around each [`BLOCK`] of them, a box around each
/// [`BLOCK`] of those boxes, and so on.
pub struct Blocks {
    /// Indices into the caller's list of items, in Morton order.
    order: Vec<u32>,
    /// Boxes of each level, from the items upwards. The last level has at most [`BLOCK`] boxes.
    levels: Vec<Vec<Box3>>,
}

impl Blocks {
    /// Builds the tree over items with these boxes.
    pub fn new(boxes: &[Box3]) -> Self {
        let all = boxes.iter().fold(Box3::EMPTY, |all, &b| all.union(b));
        let scale = (DVec3::ONE / (all.max - all.min)).max(DVec3::ZERO) * f64::from(1 << 21);
        let mut order: Vec<(u64, u32)> = (0..boxes.len() as u32)
            .into_par_iter()
            .map(|item| (morton((boxes[item as usize].center() - all.min) * scale), item))
            .collect();
        order.par_sort_unstable();
        let order: Vec<u32> = order.into_iter().map(|(_, item)| item).collect();
        let items = |block: &[u32]| {
            block.iter().fold(Box3::EMPTY, |all, &item| all.union(boxes[item as usize]))
        };
        let mut levels = vec![order.chunks(BLOCK).map(items).collect::<Vec<_>>()];
        while levels[levels.len() - 1].len() > BLOCK {
            let below = levels[levels.len() - 1].chunks(BLOCK);
            let level = below.map(|block| block.iter().fold(Box3::EMPTY, |all, &b| all.union(b)));
            levels.push(level.collect());
        }
        Self { order, levels }
    }

    /// Calls `found` for every item in a block that the ray may hit at a t in `range`.
    ///
    /// Boxes are widened by `widen` times their largest coordinate as seen from the ray's origin;
    /// `widen` is at least [`ROUNDING`].
    pub fn each(&self, ray: &Ray, widen: f64, range: [f64; 2], mut found: impl FnMut(u32)) {
        let top = self.levels.len() - 1;
        let query = Query { ray, inverse: ray.direction.recip(), widen, range };
        self.descend(top, 0..self.levels[top].len(), &query, &mut found);
    }

    /// Visits `boxes` of one level and the levels below. Recursion is at most eleven levels deep.
    fn descend(
        &self,
        level: usize,
        boxes: Range<usize>,
        query: &Query,
        found: &mut impl FnMut(u32),
    ) {
        for index in boxes {
            if !self.levels[level][index].may_hit(
                query.ray,
                query.inverse,
                query.widen,
                query.range,
            ) {
                continue;
            }
            let first = index * BLOCK;
            match level.checked_sub(1) {
                None => {
                    let end = self.order.len().min(first + BLOCK);
                    self.order[first..end].iter().for_each(|&item| found(item));
                }
                Some(below) => {
                    let end = self.levels[below].len().min(first + BLOCK);
                    self.descend(below, first..end, query, found);
                }
            }
        }
    }

    /// Bytes that the order and all boxes hold.
    pub fn bytes(&self) -> u64 {
        let boxes: usize = self.levels.iter().map(|level| size_of_val(&level[..])).sum();
        (size_of_val(&self.order[..]) + boxes) as u64
    }
}

struct Query<'a> {
    ray: &'a Ray,
    inverse: DVec3,
    widen: f64,
    range: [f64; 2],
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
