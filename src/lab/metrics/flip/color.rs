//! Colour spaces of FLIP: D65 white, sRGB primaries as exact fractions.

use glam::{DMat3, DVec3, dvec3};

/// Matrix from linear BT.709 RGB in [0, 1] to CIE XYZ.
fn xyz_from_rgb() -> DMat3 {
    let rows = [
        dvec3(10_135_552.0, 8_788_810.0, 4_435_075.0) / 24_577_794.0,
        dvec3(2_613_072.0, 8_788_810.0, 887_015.0) / 12_288_897.0,
        dvec3(1_425_312.0, 8_788_810.0, 70_074_185.0) / 73_733_382.0,
    ];
    DMat3::from_cols(rows[0], rows[1], rows[2]).transpose()
}

/// Conversions between colour spaces, with their matrices and white point.
#[derive(Debug, Clone, Copy)]
pub struct Spaces {
    xyz_from_rgb: DMat3,
    rgb_from_xyz: DMat3,
    white: DVec3,
}

impl Spaces {
    pub fn new() -> Self {
        let xyz_from_rgb = xyz_from_rgb();
        let white = xyz_from_rgb * DVec3::ONE;
        Self { xyz_from_rgb, rgb_from_xyz: xyz_from_rgb.inverse(), white }
    }

    /// Converts linear RGB to YCxCz: opponent colours that are linear in light.
    pub fn opponent(&self, rgb: DVec3) -> DVec3 {
        let p = self.xyz_from_rgb * rgb / self.white;
        dvec3(116.0 * p.y - 16.0, 500.0 * (p.x - p.y), 200.0 * (p.y - p.z))
    }

    /// Converts YCxCz back to linear RGB, clamped to the unit cube.
    pub fn clamped_rgb(&self, opponent: DVec3) -> DVec3 {
        let y = (opponent.x + 16.0) / 116.0;
        let p = dvec3(y + opponent.y / 500.0, y, y - opponent.z / 200.0);
        (self.rgb_from_xyz * (p * self.white)).clamp(DVec3::ZERO, DVec3::ONE)
    }

    /// Converts linear RGB to CIELAB with the Hunt effect: a and b are multiplied by L / 100.
    pub fn hunt_lab(&self, rgb: DVec3) -> DVec3 {
        let p = self.xyz_from_rgb * rgb / self.white;
        let [x, y, z] = p.to_array().map(lab_curve);
        let (l, a, b) = (116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z));
        dvec3(l, 0.01 * l * a, 0.01 * l * b)
    }
}

fn lab_curve(t: f64) -> f64 {
    let delta: f64 = 6.0 / 29.0;
    if t > delta.powi(3) { t.cbrt() } else { t / (3.0 * delta * delta) + 4.0 / 29.0 }
}

/// HyAB distance of two colours, for large differences (Abasi, Amani Tehran, Fairchild 2020).
pub fn hyab(a: DVec3, b: DVec3) -> f64 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_and_black_are_known_and_conversions_invert() {
        let spaces = Spaces::new();
        assert!((spaces.white - dvec3(0.950428545, 1.0, 1.088900371)).abs().max_element() < 1e-8);
        assert!((spaces.hunt_lab(DVec3::ONE) - dvec3(100.0, 0.0, 0.0)).length() < 1e-10);
        assert!(spaces.hunt_lab(DVec3::ZERO).length() < 1e-10);
        let rgb = dvec3(0.2, 0.7, 0.1);
        assert!((spaces.clamped_rgb(spaces.opponent(rgb)) - rgb).length() < 1e-12);
    }
}
