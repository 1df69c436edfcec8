//! The part of a picture that the page shows: the part with the largest error.

use super::super::metrics::ValueErrors;

/// Largest width and height of the part, in pixels.
const SIZE: [usize; 2] = [176, 132];

/// A rectangular part of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// Column and row of the top left pixel.
    pub corner: [usize; 2],
    /// Width and height in pixels.
    pub size: [usize; 2],
}

impl Crop {
    /// Finds the part with the largest relative error (relmse), among parts that overlap by half.
    pub fn of_largest_error(values: &[f32], reference: &[f32], width: usize) -> Self {
        let height = values.len() / 3 / width.max(1);
        let size = [SIZE[0].min(width), SIZE[1].min(height)];
        let mut best = (-1.0, Self { corner: [0; 2], size });
        // The last parts end at the edges of the picture, so they may overlap by more than half.
        let places = |whole: usize, part: usize| {
            (0..=whole - part).step_by((part / 2).max(1)).chain([whole - part])
        };
        for y in places(height, size[1]) {
            for x in places(width, size[0]) {
                let crop = Self { corner: [x, y], size };
                let [a, b] = [values, reference].map(|v| crop.cut(v, width));
                let error = ValueErrors::of(&a, &b).relmse;
                // NaN and infinities count as the largest error.
                let error = if error.is_finite() { error } else { f64::INFINITY };
                if error > best.0 {
                    best = (error, crop);
                }
            }
        }
        best.1
    }

    /// The values of the part, three for each pixel.
    pub fn cut(&self, values: &[f32], width: usize) -> Vec<f32> {
        let ([x, y], [across, down]) = (self.corner, self.size);
        let rows = (y..y + down).map(|row| 3 * (row * width + x));
        rows.flat_map(|first| &values[first..first + 3 * across]).copied().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_part_contains_the_error() {
        let (width, height) = (500, 300);
        let reference = vec![0.5; 3 * width * height];
        let mut values = reference.clone();
        for y in 250..280 {
            for x in 430..470 {
                values[3 * (y * width + x) + 1] = 0.9;
            }
        }
        let crop = Crop::of_largest_error(&values, &reference, width);
        let [x, y] = crop.corner;
        assert!(x <= 430 && x + crop.size[0] >= 470 && y <= 250 && y + crop.size[1] >= 280);
        let cut = crop.cut(&values, width);
        assert_eq!(cut.len(), 3 * crop.size[0] * crop.size[1]);
        assert_eq!(cut.iter().filter(|v| **v == 0.9).count(), 30 * 40);
        let small = Crop::of_largest_error(&[0.0; 12], &[0.0; 12], 2);
        assert_eq!(small.size, [2, 2]);
    }
}
