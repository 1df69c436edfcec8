//! Focal lengths, principal point and skew: raster positions to points of the image plane.

/// The intrinsics of a camera. Raster positions are in pixels from the top left corner of the
/// frame, so the centre of the first pixel is (0.5, 0.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// Focal lengths in pixels, horizontal and vertical, > 0.
    pub focal: [f64; 2],
    /// Raster position of the principal point.
    pub principal: [f64; 2],
    /// Entry (0, 1) of the camera matrix, in pixels.
    pub skew: f64,
}

impl Calibration {
    /// Returns the point of the image plane at distance 1 that a raster position shows, x right, y
    /// down. With a distortion that is the distorted point.
    #[inline(always)]
    pub fn plane(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let y = (v - self.principal[1]) / self.focal[1];
        [(u - self.principal[0] - self.skew * y) / self.focal[0], y]
    }

    /// Returns the raster position of a point of the image plane: the inverse of
    /// [`Calibration::plane`].
    pub fn raster(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let u = self.focal[0] * x + self.skew * y + self.principal[0];
        [u, self.focal[1] * y + self.principal[1]]
    }
}
