//! The distortion models of OpenCV as one map of a plane, and its derivatives.

use std::f64::consts::PI;

/// How a point of the undistorted plane encodes a direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// The point (x, y) is the direction (x, y, 1): OpenCV's `calib3d`.
    BrownConrady,
    /// The length of the point is the direction's angle to the axis, in radians: OpenCV's
    /// `fisheye`.
    Fisheye,
}

/// A distortion: the map of a point q with r = |q| to
/// `q (1 + a1 r^2 + a2 r^4 + a3 r^6 + a4 r^8) / (1 + b1 r^2 + b2 r^4 + b3 r^6) + tangential`.
///
/// With x right and y down, the tangential part is
/// `(2 p1 x y + p2 (r^2 + 2 x^2), p1 (r^2 + 2 y^2) + 2 p2 x y)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distortion {
    /// How undistorted points encode directions.
    pub model: Model,
    /// Coefficients a1 to a4 of the numerator.
    pub numerator: [f64; 4],
    /// Coefficients b1 to b3 of the denominator.
    pub denominator: [f64; 3],
    /// Coefficients p1 and p2 of the tangential part.
    pub tangential: [f64; 2],
}

/// A point after distortion, and the derivatives there.
#[derive(Debug, Clone, Copy)]
pub struct Mapped {
    /// The distorted point.
    pub point: [f64; 2],
    /// Derivatives dx/dx, dx/dy = dy/dx, dy/dy. The matrix is symmetric.
    pub(super) derivative: [f64; 3],
}

impl Mapped {
    /// Determinant of the matrix of derivatives.
    #[inline(always)]
    fn determinant(&self) -> f64 {
        let [xx, xy, yy] = self.derivative;
        xx * yy - xy * xy
    }

    /// Returns the step of Newton's method towards the point that maps to `target`.
    #[inline(always)]
    pub fn step(&self, target: [f64; 2]) -> [f64; 2] {
        let [xx, xy, yy] = self.derivative;
        let [x, y] = [target[0] - self.point[0], target[1] - self.point[1]];
        let inverse = 1.0 / self.determinant();
        [(yy * x - xy * y) * inverse, (xx * y - xy * x) * inverse]
    }
}

impl Distortion {
    /// Returns the distorted point and the derivatives there.
    #[inline(always)]
    pub fn map(&self, [x, y]: [f64; 2]) -> Mapped {
        let ([a1, a2, a3, a4], [b1, b2, b3]) = (self.numerator, self.denominator);
        let [p1, p2] = self.tangential;
        let s = x * x + y * y;
        let numerator = 1.0 + s * (a1 + s * (a2 + s * (a3 + s * a4)));
        let denominator = 1.0 + s * (b1 + s * (b2 + s * b3));
        // Derivatives by s = r^2.
        let numerator_slope = a1 + s * (2.0 * a2 + s * (3.0 * a3 + s * 4.0 * a4));
        let denominator_slope = b1 + s * (2.0 * b2 + s * 3.0 * b3);
        let factor = numerator / denominator;
        let slope = (numerator_slope - factor * denominator_slope) / denominator;
        let cross = 2.0 * x * y;
        Mapped {
            point: [
                x * factor + p1 * cross + p2 * (s + 2.0 * x * x),
                y * factor + p1 * (s + 2.0 * y * y) + p2 * cross,
            ],
            derivative: [
                factor + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
                cross * slope + 2.0 * p1 * x + 2.0 * p2 * y,
                factor + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
            ],
        }
    }

    /// Returns true if the map is regular and keeps the orientation at the point `q`, and `q` is a
    /// direction: a fisheye's angle must be less than pi.
    pub fn is_regular(&self, q: [f64; 2]) -> bool {
        let s = q[0] * q[0] + q[1] * q[1];
        let [b1, b2, b3] = self.denominator;
        let denominator = 1.0 + s * (b1 + s * (b2 + s * b3));
        let mapped = self.map(q);
        let [xx, _, yy] = mapped.derivative;
        let direction = self.model == Model::BrownConrady || s < PI * PI;
        denominator > 0.0 && mapped.determinant() > 0.0 && xx + yy > 0.0 && direction
    }

    /// Returns the direction of an undistorted point: x right, y down, z forward, of any length.
    #[inline(always)]
    pub fn direction(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        match self.model {
            Model::BrownConrady => [x, y, 1.0],
            Model::Fisheye => {
                let angle = (x * x + y * y).sqrt();
                let (sine, cosine) = angle.sin_cos();
                let factor = if angle == 0.0 { 1.0 } else { sine / angle };
                [x * factor, y * factor, cosine]
            }
        }
    }

    /// OpenCV's name of the coefficient that most reduces the derivative of the map at radius `r`,
    /// so that the map folds back. `None` if no coefficient reduces it.
    pub fn culprit(&self, r: f64) -> Option<&'static str> {
        let s = r * r;
        // Let A and B be numerator and denominator. The terms of `numerator` are those of (r A)'.
        // The terms of `denominator` are those of B - r B', because (r / B)' = (B - r B') / B^2.
        let numerator =
            (1..).zip(self.numerator).map(|(i, a)| f64::from(2 * i + 1) * a * s.powi(i));
        let denominator =
            (1..).zip(self.denominator).map(|(i, b)| f64::from(1 - 2 * i) * b * s.powi(i));
        let tangential = self.tangential.map(|p| -6.0 * p.abs() * r);
        let terms: Vec<f64> = match self.model {
            Model::Fisheye => numerator.collect(),
            Model::BrownConrady => numerator.take(3).chain(denominator).chain(tangential).collect(),
        };
        let names = match self.model {
            Model::Fisheye => &["k1", "k2", "k3", "k4"][..],
            Model::BrownConrady => &["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"],
        };
        let worst = names.iter().zip(terms).min_by(|a, b| a.1.total_cmp(&b.1));
        worst.filter(|(_, term)| *term < 0.0).map(|(name, _)| *name)
    }
}
