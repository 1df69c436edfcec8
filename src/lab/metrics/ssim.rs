//! Structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004) of the luma of two pictures.
//!
//! Window and constants are those of the paper: 11 x 11 Gaussian weights of sigma 1.5, K1 = 0.01,
//! K2 = 0.03, values in [0, 1]. The mean runs over all windows that lie inside the picture.

use super::plane::{ChannelPlane, gaussian};

const RADIUS: usize = 5;
const SIGMA: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Mean SSIM of two 8-bit pictures, 1 for equal ones. `None` if the pictures are smaller than a
/// window.
pub fn ssim(test: &[[u8; 3]], reference: &[[u8; 3]], width: usize) -> Option<f64> {
    let height = test.len() / width.max(1);
    let across = width.checked_sub(2 * RADIUS).filter(|n| *n > 0)?;
    let down = height.checked_sub(2 * RADIUS).filter(|n| *n > 0)?;
    let (x, y) = (ChannelPlane::map(test, width, luma), ChannelPlane::map(reference, width, luma));
    let kernel = gaussian(SIGMA, RADIUS);
    let mean = |plane: &ChannelPlane| plane.convolved(&kernel, &kernel).values;
    let product = |a: &ChannelPlane, b: &ChannelPlane| {
        let values = a.values.iter().zip(&b.values).map(|(a, b)| a * b).collect();
        mean(&ChannelPlane { width, values })
    };
    let (mx, my) = (mean(&x), mean(&y));
    let (xx, yy, xy) = (product(&x, &x), product(&y, &y), product(&x, &y));
    let mut sum = 0.0;
    for row in RADIUS..RADIUS + down {
        for i in row * width + RADIUS..row * width + RADIUS + across {
            let (vx, vy, cov) =
                (xx[i] - mx[i] * mx[i], yy[i] - my[i] * my[i], xy[i] - mx[i] * my[i]);
            let luminance = (2.0 * mx[i] * my[i] + C1) / (mx[i] * mx[i] + my[i] * my[i] + C1);
            sum += luminance * (2.0 * cov + C2) / (vx + vy + C2);
        }
    }
    Some(sum / (across * down) as f64)
}

/// BT.709 luma of an sRGB pixel, in [0, 1].
fn luma([r, g, b]: &[u8; 3]) -> f64 {
    let [r, g, b] = [*r, *g, *b].map(|byte| f64::from(byte) / 255.0);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ssim_of_constant_pictures_in_closed_form() {
        let (a, b) = ([[51; 3]; 144], [[204; 3]; 144]);
        let expected = (2.0 * 0.2 * 0.8 + C1) / (0.2 * 0.2 + 0.8 * 0.8 + C1);
        assert!((ssim(&a, &b, 12).unwrap() - expected).abs() < 1e-12);
        assert!((ssim(&a, &a, 12).unwrap() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn pictures_smaller_than_a_window_have_no_ssim() {
        assert!(ssim(&[[0; 3]; 121], &[[0; 3]; 121], 11).is_some());
        assert_eq!(ssim(&[[0; 3]; 110], &[[0; 3]; 110], 11), None);
        assert_eq!(ssim(&[[0; 3]; 110], &[[0; 3]; 110], 10), None);
        assert_eq!(ssim(&[], &[], 0), None);
    }

    #[test]
    fn ssim_of_an_inverted_pattern_is_negative() {
        let board = |odd: usize| -> Vec<[u8; 3]> {
            (0..400).map(|i| [if (i / 20 + i % 20) % 2 == odd { 255 } else { 0 }; 3]).collect()
        };
        assert!(ssim(&board(0), &board(1), 20).unwrap() < -0.9);
    }
}
