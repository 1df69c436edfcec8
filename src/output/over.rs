//! Composites a picture over a plate (a background image), for the PNG.

use crate::parallel;

/// Composites premultiplied `pixels` over the opaque `plate` with the over operator. The result has
/// alpha 1.
pub fn over(pixels: &[[f32; 4]], plate: &[[f32; 3]]) -> Vec<[f32; 4]> {
    parallel::values(pixels.len(), |i| {
        let ([r, g, b, alpha], [x, y, z]) = (pixels[i], plate[i]);
        let rest = 1.0 - alpha;
        [r + rest * x, g + rest * y, b + rest * z, 1.0]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alpha_covers_the_plate() {
        let pixels = [[0.5, 0.0, 0.25, 0.5], [0.0; 4], [2.0, 3.0, 4.0, 1.0]];
        let plate = [[0.5, 1.0, 2.0]; 3];
        let expected = [[0.75, 0.5, 1.25, 1.0], [0.5, 1.0, 2.0, 1.0], [2.0, 3.0, 4.0, 1.0]];
        assert_eq!(over(&pixels, &plate), expected);
    }
}
