//! Shadow rays of one area light from all lanes of a packet, sorted by where they end.
//!
//! Rays towards the same part of a light visit the same part of the tree. So the rays of up to 16
//! light points per lane are traced in the order of the light's cells. Each lane's sum still runs
//! over its points in order, so its bits do not depend on the order of tracing.

use crate::accel::Accelerator;
use crate::ray::{Coherence, LANES, Mask, Rays};
use crate::shading::{Lanes, Lanes3, LightWeights};

/// Most light points per lane in a batch.
pub const POINTS: usize = 16;

/// Rays of a batch.
const RAYS: usize = POINTS * LANES;

/// The shadow rays of up to [`POINTS`] light points per lane.
pub struct LightBatch {
    /// By light point: the rays from all lanes.
    pub rays: [Rays; POINTS],
    /// By light point: the light that arrives if nothing occludes it.
    pub weights: [LightWeights; POINTS],
    /// By light point of an environment map: its colour, by lane.
    pub colors: [Lanes3; POINTS],
    /// By light point: the lanes that have a ray.
    pub active: [Mask; POINTS],
    /// By light point: the lanes whose ray [`LightBatch::trace`] traces.
    pub waiting: [Mask; POINTS],
    /// By light point: its cell, by lane.
    cells: [[u8; LANES]; POINTS],
    /// Waiting rays, as point * 16 + lane, in the order of their cells.
    order: [u8; RAYS],
    packet: Rays,
}

impl LightBatch {
    /// A batch without rays.
    pub const EMPTY: Self = Self {
        rays: [Rays::EMPTY; POINTS],
        weights: [const { LightWeights::EMPTY }; POINTS],
        colors: [[[0.0; LANES]; 3]; POINTS],
        active: [Mask::NONE; POINTS],
        waiting: [Mask::NONE; POINTS],
        cells: [[0; LANES]; POINTS],
        order: [0; RAYS],
        packet: Rays::EMPTY,
    };

    /// Marks the rays of a light point as waiting. `square` is the place of the light point in the
    /// unit square, by lane. `columns` and `rows` divide the light into at most [`POINTS`] cells.
    #[inline(always)]
    pub fn queue(&mut self, point: usize, [s, t]: &[Lanes; 2], [columns, rows]: [u32; 2]) {
        self.waiting[point] = self.active[point];
        let cells = &mut self.cells[point];
        for i in 0..LANES {
            let (x, y) = ((s[i] * columns as f32) as u32, (t[i] * rows as f32) as u32);
            // Each column runs against the one before it, so that the next cell is a neighbour.
            let y = if x & 1 != 0 { rows - 1 - y } else { y };
            cells[i] = (x * rows + y) as u8;
        }
    }

    /// Traces the waiting rays of the first `points` light points. `tfar` becomes -inf where a ray
    /// is occluded.
    #[inline(always)]
    pub fn trace(&mut self, points: usize, accelerator: &dyn Accelerator) {
        let count = self.sort(points.min(POINTS));
        for first in (0..count).step_by(LANES) {
            let places = &self.order[first..count.min(first + LANES)];
            let mut active = Mask::NONE;
            for (i, place) in places.iter().enumerate() {
                let (rays, lane) = (&self.rays[usize::from(place >> 4)], usize::from(place & 15));
                for axis in 0..3 {
                    self.packet.org[axis][i] = rays.org[axis][lane];
                    self.packet.dir[axis][i] = rays.dir[axis][lane];
                }
                self.packet.tnear[i] = rays.tnear[lane];
                self.packet.tfar[i] = rays.tfar[lane];
                self.packet.leaving[i] = rays.leaving[lane];
                active.0[i] = -1;
            }
            accelerator.occluded(&active, &mut self.packet, Coherence::Coherent);
            for (i, place) in places.iter().enumerate() {
                let (point, lane) = (usize::from(place >> 4), usize::from(place & 15));
                self.rays[point].tfar[lane] = self.packet.tfar[i];
            }
        }
    }

    /// Sorts the waiting rays by cell. Returns their number.
    #[inline(always)]
    fn sort(&mut self, points: usize) -> usize {
        let mut ends = [0u16; POINTS];
        for point in 0..points {
            for i in 0..LANES {
                let cell = usize::from(self.cells[point][i]) % POINTS;
                ends[cell] += u16::from(self.waiting[point].0[i] != 0);
            }
        }
        let mut begin = 0;
        for end in &mut ends {
            (*end, begin) = (begin, begin + *end);
        }
        for point in 0..points {
            for i in 0..LANES {
                let cell = usize::from(self.cells[point][i]) % POINTS;
                let waiting = self.waiting[point].0[i] != 0;
                // Without a branch: half of the rays of a silhouette do not wait.
                let place = usize::from(ends[cell]) % RAYS;
                self.order[place] =
                    if waiting { (point * LANES + i) as u8 } else { self.order[place] };
                ends[cell] += u16::from(waiting);
            }
        }
        usize::from(begin)
    }
}

/// Columns and rows that divide a light of `points` points into nearly square cells, no more than
/// points and no more than [`POINTS`].
#[inline(always)]
pub fn grid(points: u32) -> [u32; 2] {
    match points {
        0..=1 => [1, 1],
        2..=3 => [2, 1],
        4..=5 => [2, 2],
        6..=8 => [3, 2],
        9..=11 => [3, 3],
        12..=15 => [4, 3],
        _ => [4, 4],
    }
}
