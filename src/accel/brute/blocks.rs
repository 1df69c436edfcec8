//! What spares the oracle from testing everything: boxes around blocks of neighbours.
//!
//! Conservative by a margin far above its rounding, so that it never decides anything.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::accel::lane::Ray;

/// Boxes or items in one block.
const BLOCK: usize = 8;

/// The least widening of a box, relative to its farthest coordinate from the ray's origin.
pub const ROUNDING: f64 = 1.0 / (1u64 << 40) as f64;

/// An axis-parallel box.
#[derive(Debug, Clone, Copy)]
pub struct Box3 {
    pub min: DVec3,
    pub max: DVec3,
}

impl Box3 {
    const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The box of some points.
    pub fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    fn center(&self) -> DVec3 {
        (self.min + self.max) / 2.0
    }

    /// Whether the line of the ray, t in (near, far), may meet the box widened on all sides by
    /// `widen` times its farthest coordinate from the origin.
    ///
    /// The planes move by w = `widen` M, M that coordinate. A difference, a reciprocal and a
    /// product round (u = 2^-53): together less than 4u(M + w), far below w for `widen` >=
    /// [`ROUNDING`]. A NaN (0 times infinity) is dropped and cuts off nothing.
    #[inline(always)]
    fn met(&self, ray: &Ray, inverse: DVec3, widen: f64, [near, far]: [f64; 2]) -> bool {
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

/// Items in Morton order, boxes around each [`BLOCK`] of them, boxes around those, and so on.
pub struct Blocks {
    /// The items, by their numbers in the caller's list.
    order: Vec<u32>,
    /// Lowest first; the last has at most [`BLOCK`] boxes.
    levels: Vec<Vec<Box3>>,
}

impl Blocks {
    /// Blocks of the items of `boxes`.
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

    /// Calls `found` for every item in a block that the ray may meet at t in `range`; boxes are
    /// widened by `widen` (at least [`ROUNDING`]) times their farthest coordinate.
    pub fn each(&self, ray: &Ray, widen: f64, range: [f64; 2], mut found: impl FnMut(u32)) {
        let top = self.levels.len() - 1;
        let query = Query { ray, inverse: ray.direction.recip(), widen, range };
        self.descend(top, 0..self.levels[top].len(), &query, &mut found);
    }

    /// As deep as there are levels: at most eleven.
    fn descend(
        &self,
        level: usize,
        boxes: Range<usize>,
        query: &Query,
        found: &mut impl FnMut(u32),
    ) {
        for index in boxes {
            if !self.levels[level][index].met(query.ray, query.inverse, query.widen, query.range) {
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

    /// Bytes held.
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

/// Interleaves 21 bits of each coordinate.
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
