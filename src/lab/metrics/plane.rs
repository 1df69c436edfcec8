//! One channel of a picture, and its convolution with separable kernels.

use crate::parallel;

/// One channel of a picture, in rows from the top.
#[derive(Debug, Clone)]
pub struct ChannelPlane {
    /// Width in pixels, > 0.
    pub width: usize,
    /// One value for each pixel.
    pub values: Vec<f64>,
}

impl ChannelPlane {
    /// Computes a plane with `value` of each pixel.
    pub fn map<T: Sync>(
        pixels: &[T],
        width: usize,
        value: impl Fn(&T) -> f64 + Sync + Send,
    ) -> Self {
        Self { width, values: parallel::values(pixels.len(), |i| value(&pixels[i])) }
    }

    /// Convolves along x with `row`, then along y with `column`. Both have an odd length.
    ///
    /// Values beyond the border are those of the nearest border pixel. Kernels are not mirrored:
    /// the first weight belongs to the leftmost or topmost pixel.
    pub fn convolved(&self, row: &[f64], column: &[f64]) -> Self {
        self.along_x(row).along_y(column)
    }

    /// Convolves along x: the first half of [`ChannelPlane::convolved`].
    pub fn along_x(&self, kernel: &[f64]) -> Self {
        let (width, radius) = (self.width, kernel.len() / 2);
        let mut values = vec![0.0; self.values.len()];
        let rows = values.chunks_mut(width).zip(self.values.chunks(width));
        parallel::each(rows, |(to, from)| {
            let (first, last) = (from[0], from[width - 1]);
            let mut padded = vec![first; radius];
            padded.extend_from_slice(from);
            padded.resize(width + 2 * radius, last);
            for (offset, weight) in kernel.iter().enumerate() {
                add(to, &padded[offset..], *weight);
            }
        });
        Self { width, values }
    }

    /// Convolves along y: the second half of [`ChannelPlane::convolved`].
    pub fn along_y(&self, kernel: &[f64]) -> Self {
        let (width, radius) = (self.width, kernel.len() / 2);
        let bottom = (self.values.len() / width).saturating_sub(1);
        let mut values = vec![0.0; self.values.len()];
        parallel::each(values.chunks_mut(width).enumerate(), |(y, to)| {
            for (offset, weight) in kernel.iter().enumerate() {
                let from = (y + offset).saturating_sub(radius).min(bottom);
                add(to, &self.values[from * width..], *weight);
            }
        });
        Self { width, values }
    }
}

fn add(to: &mut [f64], from: &[f64], weight: f64) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += weight * from;
    }
}

/// Gaussian weights exp(-x^2 / (2 sigma^2)) at the integers from -radius to radius, with sum 1.
pub fn gaussian(sigma: f64, radius: usize) -> Vec<f64> {
    let weight = |i| (-0.5 * (i as f64 - radius as f64).powi(2) / (sigma * sigma)).exp();
    let weights: Vec<f64> = (0..=2 * radius).map(weight).collect();
    let sum: f64 = weights.iter().sum();
    weights.iter().map(|w| w / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn convolution_of_one_bright_pixel_gives_the_kernel() {
        let mut plane = ChannelPlane { width: 5, values: vec![0.0; 25] };
        plane.values[12] = 1.0;
        let done = plane.convolved(&[1.0, 2.0, 4.0], &[10.0, 100.0, 1000.0]);
        // The pixel to the right of the bright one uses the first weight.
        assert_eq!(done.values[13], 100.0);
        assert_eq!(done.values[11], 400.0);
        assert_eq!(done.values[17], 20.0);
        assert_eq!(done.values[7], 2000.0);
        assert_eq!(done.values[0], 0.0);
    }

    #[test]
    fn a_constant_is_unchanged_up_to_the_border() {
        let plane = ChannelPlane { width: 3, values: vec![2.0; 6] };
        let kernel = gaussian(1.5, 5);
        for value in plane.convolved(&kernel, &kernel).values {
            assert!((value - 2.0).abs() < 1e-14);
        }
    }
}
