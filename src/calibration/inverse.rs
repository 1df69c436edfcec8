//! The inverse of a distortion over a frame: a table of first guesses, then Newton's method in f64.

use super::distortion::Distortion;
use super::intrinsics::Calibration;

/// Cells of the table along each side of the frame. The finer tables are for distortions that
/// change much within a cell.
const CELLS: [u32; 3] = [64, 128, 256];

/// Points of each side of the frame from which the check for folds starts.
const BORDER_POINTS: u32 = 32;

/// Number of steps from the principal point to the border, unless Newton's method needs shorter
/// steps.
const STEPS: f64 = 16.0;

/// Number of points along a step at which the map must be regular.
const CHORD_POINTS: u32 = 8;

/// Largest error of the inverse at sampled positions of the table's cells, in pixels.
const TOLERANCE: f64 = 1e-10;

/// Largest number of steps of Newton's method per ray, but for [`CORNER_ITERATIONS`].
const MAX_ITERATIONS: u32 = 12;

/// Largest number of steps of Newton's method per ray, if a corner of the frame is near a fold.
const CORNER_ITERATIONS: u32 = 24;

/// Largest number of steps of Newton's method in [`Inverse::settle`]. Near a fold each step only
/// halves the error.
const SETTLE_ITERATIONS: u32 = 48;

/// Largest error of a point that [`Inverse::settle`] returns, relative to its size.
const SETTLED: f64 = 1e-14;

/// Largest such error that is the rounding of a distortion whose denominator is small, if a step
/// does not make it smaller.
const STALLED: f64 = 1e-12;

/// Number of steps from the frame's border to a position in the overscan.
const OVERSCAN_STEPS: u32 = 16;

/// A place of the frame where a distortion cannot be inverted: it maps two directions to one
/// pixel.
#[derive(Debug, Clone, Copy)]
pub struct Fold {
    /// Raster position of the fold, or of the frame's point that cannot be inverted.
    pub raster: [f64; 2],
    /// Length of the undistorted point at the fold.
    pub radius: f64,
}

/// A distortion that can be inverted over a whole frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Inverse {
    calibration: Calibration,
    distortion: Distortion,
    /// Right and bottom end of the frame in pixels.
    end: [f64; 2],
    /// Number of cells of the table along each side of the frame.
    cells: u32,
    /// Undistorted points at the corners of all cells, row by row.
    nodes: Vec<[f64; 2]>,
    /// Number of steps of Newton's method that every guess within the frame gets.
    iterations: u32,
}

impl Inverse {
    /// Computes the table for a frame of `size` pixels, width and height.
    ///
    /// # Errors
    /// A fold in the frame. Of the folds on lines to its border, the one nearest to the principal
    /// point.
    pub fn new(
        calibration: Calibration,
        distortion: Distortion,
        size: [u32; 2],
    ) -> Result<Self, Fold> {
        let end = size.map(f64::from);
        let (cells, nodes, iterations) = (CELLS[0], Vec::new(), MAX_ITERATIONS);
        let mut inverse = Self { calibration, distortion, end, cells, nodes, iterations };
        inverse.check([0.0, 0.0], end)?;
        let mut counted = Ok(0);
        for cells in CELLS {
            inverse.cells = cells;
            inverse.fill()?;
            counted = inverse.count_iterations();
            if counted.is_ok() {
                break;
            }
        }
        inverse.iterations = counted?;
        Ok(inverse)
    }

    /// Checks a frame with `overscan` more pixels on every side for folds.
    ///
    /// # Errors
    /// As [`Inverse::new`].
    pub fn check_overscan(&self, overscan: u32) -> Result<(), Fold> {
        let more = f64::from(overscan);
        self.check([-more; 2], self.end.map(|end| end + more))
    }

    /// Returns true for the inverse of this distortion over a frame of `size` pixels.
    pub(super) fn is_of(
        &self,
        calibration: Calibration,
        distortion: Distortion,
        size: [u32; 2],
    ) -> bool {
        let same = self.calibration == calibration && self.distortion == distortion;
        same && self.end == size.map(f64::from)
    }

    /// Returns the direction of the ray through a raster position: x right, y down, z forward, of
    /// any length. Right to 1e-9 pixel, but for a millionth of a table's cell at a corner that
    /// lies on a fold.
    #[inline(always)]
    pub fn direction(&self, raster: [f64; 2]) -> [f64; 3] {
        self.distortion.direction(self.undistorted(raster))
    }

    /// Returns the point that the distortion maps to a raster position. The result depends on the
    /// position alone, so that every crop has the same rays.
    #[inline(always)]
    fn undistorted(&self, raster: [f64; 2]) -> [f64; 2] {
        let inside = [0, 1].map(|k| raster[k].max(0.0).min(self.end[k]));
        let mut q = self.guess(inside);
        let target = self.calibration.plane(inside);
        for _ in 0..self.iterations {
            let [x, y] = self.distortion.map(q).step(target);
            q = [q[0] + x, q[1] + y];
        }
        if inside == raster { q } else { self.beyond(inside, raster, q) }
    }

    /// Returns the undistorted point of a position in the overscan, by short steps from `border`.
    /// `q` is the undistorted point of `border`.
    #[cold]
    fn beyond(&self, border: [f64; 2], raster: [f64; 2], mut q: [f64; 2]) -> [f64; 2] {
        for i in 1..=OVERSCAN_STEPS {
            let t = f64::from(i) / f64::from(OVERSCAN_STEPS);
            let at = [0, 1].map(|k| border[k] + (raster[k] - border[k]) * t);
            let target = self.calibration.plane(at);
            // The number of steps within the frame is that for guesses of the table.
            for _ in 0..SETTLE_ITERATIONS {
                if self.error(q, at) <= TOLERANCE {
                    break;
                }
                let [x, y] = self.distortion.map(q).step(target);
                q = [q[0] + x, q[1] + y];
            }
        }
        q
    }

    /// Interpolates the table at a position within the frame: the first guess of Newton's method.
    #[inline(always)]
    fn guess(&self, raster: [f64; 2]) -> [f64; 2] {
        let stride = self.cells as usize + 1;
        let [x, y] = [0, 1].map(|k| raster[k] / self.end[k] * f64::from(self.cells));
        let [i, j] = [x, y].map(|at| (at as u32).min(self.cells - 1));
        let [s, t] = [x - f64::from(i), y - f64::from(j)];
        let first = j as usize * stride + i as usize;
        // The slice is too short only if the table is not filled yet.
        let Some(cell) = self.nodes.get(first..first + stride + 2) else { return [0.0; 2] };
        let ([a, b], [c, d]) = ([cell[0], cell[1]], [cell[stride], cell[stride + 1]]);
        [0, 1].map(|k| {
            let upper = a[k] + (b[k] - a[k]) * s;
            let lower = c[k] + (d[k] - c[k]) * s;
            upper + (lower - upper) * t
        })
    }

    /// Raster position of a corner of a cell.
    fn corner(&self, i: u32, j: u32) -> [f64; 2] {
        [(i, 0), (j, 1)].map(|(at, k)| f64::from(at) / f64::from(self.cells) * self.end[k])
    }

    fn fill(&mut self) -> Result<(), Fold> {
        self.nodes.clear();
        let stride = self.cells + 1;
        for index in 0..stride * stride {
            let (i, j) = (index % stride, index / stride);
            let raster = self.corner(i, j);
            let known = match (i, j) {
                (0, 0) => None,
                (0, _) => self.nodes.get((index - stride) as usize),
                _ => self.nodes.get(index as usize - 1),
            };
            let target = self.calibration.plane(raster);
            let near = known.and_then(|&q| self.settle(q, target));
            // A neighbour may be too far away for Newton's method. Steps from the principal point
            // become as short as needed.
            let q = match near {
                Some(q) => q,
                None => self.walk(raster)?,
            };
            self.nodes.push(q);
        }
        Ok(())
    }

    /// Returns how many steps of Newton's method the positions within the frame need. It tries five
    /// positions in each cell and adds one step for the others.
    ///
    /// # Errors
    /// A fold at a position that needs more than [`MAX_ITERATIONS`] steps.
    fn count_iterations(&self) -> Result<u32, Fold> {
        let mut most = 1;
        for cell in 0..self.cells * self.cells {
            let [x, y] = self.corner(cell % self.cells, cell / self.cells);
            for (s, t) in [(0.5, 0.5), (0.25, 0.25), (0.75, 0.5), (0.5, 0.02), (0.02, 0.5)] {
                let step = |k: usize, at: f64| at / f64::from(self.cells) * self.end[k];
                let raster = [x + step(0, s), y + step(1, t)];
                let count = self.steps(raster, MAX_ITERATIONS);
                most = most.max(count.map_err(|q| self.fold_at(raster, q))?);
            }
        }
        Ok((most + 1).min(MAX_ITERATIONS).max(self.count_at_corners()))
    }

    /// Returns how many steps the positions near the frame's corners need. A fold is nearest there.
    /// A guess that is nearer to it than the position lets the first step go too far.
    fn count_at_corners(&self) -> u32 {
        let mut most = 0;
        for corner in 0..4u32 {
            let inward = |k: usize, by: f64| {
                let by = by / f64::from(self.cells) * self.end[k];
                if corner >> k & 1 == 1 { self.end[k] - by } else { by }
            };
            for halvings in 2..=24 {
                let s = 0.5f64.powi(halvings);
                for [x, y] in [[s, s], [s, 0.0], [0.0, s]] {
                    let count = self.steps([inward(0, x), inward(1, y)], CORNER_ITERATIONS);
                    most = most.max(count.unwrap_or(CORNER_ITERATIONS));
                }
            }
        }
        (most + 1).min(CORNER_ITERATIONS)
    }

    /// Returns the number of steps of Newton's method from the table's guess to a position.
    ///
    /// # Errors
    /// The undistorted point after `limit` steps, if they are too few.
    fn steps(&self, raster: [f64; 2], limit: u32) -> Result<u32, [f64; 2]> {
        let target = self.calibration.plane(raster);
        let mut q = self.guess(raster);
        for count in 0..=limit {
            if self.error(q, raster) <= TOLERANCE {
                return Ok(count);
            }
            if count < limit {
                let [x, y] = self.distortion.map(q).step(target);
                q = [q[0] + x, q[1] + y];
            }
        }
        Err(q)
    }

    /// Distance in pixels between a raster position and the one that an undistorted point maps to,
    /// less what the rounding of f64 explains.
    fn error(&self, q: [f64; 2], raster: [f64; 2]) -> f64 {
        let found = self.calibration.raster(self.distortion.map(q).point);
        let away = |k: usize| (found[k] - raster[k]).abs();
        let size = raster[0].abs().max(raster[1].abs()).max(self.calibration.principal[0].abs());
        let size = size.max(self.calibration.principal[1].abs());
        let error = away(0).max(away(1)) - 16.0 * f64::EPSILON * size;
        // NaN is an error, too.
        if error.is_nan() { f64::INFINITY } else { error }
    }

    /// Applies Newton's method from `q`, a point near the solution. `None` if it does not converge,
    /// or if a point between `q` and the result is not regular.
    fn settle(&self, q: [f64; 2], target: [f64; 2]) -> Option<[f64; 2]> {
        let (mut found, mut last) = (q, f64::INFINITY);
        for _ in 0..SETTLE_ITERATIONS {
            let mapped = self.distortion.map(found);
            let size = [found, target].into_iter().flatten().fold(1e-3, |a: f64, x| a.max(x.abs()));
            let away = |k: usize| (mapped.point[k] - target[k]).abs();
            let error = away(0).max(away(1));
            if error <= SETTLED * size || (error <= STALLED * size && error >= last) {
                let regular = (1..=CHORD_POINTS).all(|i| {
                    let t = f64::from(i) / f64::from(CHORD_POINTS);
                    self.distortion.is_regular([0, 1].map(|k| q[k] + (found[k] - q[k]) * t))
                });
                return regular.then_some(found);
            }
            last = error;
            let [x, y] = mapped.step(target);
            found = [found[0] + x, found[1] + y];
        }
        None
    }

    /// Returns the undistorted point of a raster position. Follows the straight line from the
    /// principal point to the position.
    ///
    /// # Errors
    /// The first fold on this line.
    fn walk(&self, raster: [f64; 2]) -> Result<[f64; 2], Fold> {
        let target = self.calibration.plane(raster);
        let (mut q, mut t, mut step) = ([0.0; 2], 0.0, 1.0 / STEPS);
        while t < 1.0 {
            let next = f64::min(t + step, 1.0);
            match self.settle(q, target.map(|x| x * next)) {
                Some(found) => {
                    (q, t) = (found, next);
                    step = f64::min(2.0 * step, 1.0 / STEPS);
                }
                None if step < 1e-9 => {
                    let [u, v] = self.calibration.principal;
                    let at = [u + (raster[0] - u) * t, v + (raster[1] - v) * t];
                    return Err(self.fold_at(at, q));
                }
                None => step /= 2.0,
            }
        }
        Ok(q)
    }

    /// Checks that a frame has no fold, along lines from the principal point to points of the
    /// border.
    fn check(&self, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> Result<(), Fold> {
        let mut worst: Option<Fold> = None;
        for i in 0..=BORDER_POINTS {
            let t = f64::from(i) / f64::from(BORDER_POINTS);
            let (x, y) = (x0 + (x1 - x0) * t, y0 + (y1 - y0) * t);
            for raster in [[x, y0], [x, y1], [x0, y], [x1, y]] {
                if let Err(fold) = self.walk(raster) {
                    let nearer = worst.is_none_or(|worst| fold.radius < worst.radius);
                    worst = if nearer { Some(fold) } else { worst };
                }
            }
        }
        worst.map_or(Ok(()), Err)
    }

    fn fold_at(&self, raster: [f64; 2], q: [f64; 2]) -> Fold {
        Fold { raster, radius: (q[0] * q[0] + q[1] * q[1]).sqrt() }
    }
}

#[cfg(test)]
mod tests;
