//! Unit tests of the inverse of a distortion.

use super::*;
use crate::calibration::Model;

fn calibration() -> Calibration {
    Calibration { focal: [900.0, 850.0], principal: [640.5, 350.5], skew: 1.5 }
}

fn radial(model: Model, numerator: [f64; 4]) -> Distortion {
    Distortion { model, numerator, denominator: [0.0; 3], tangential: [0.0; 2] }
}

fn lenses() -> [Distortion; 4] {
    let brown = radial(Model::BrownConrady, [-0.28, 0.09, -0.01, 0.0]);
    let rational = Distortion {
        numerator: [0.8, 0.1, 0.02, 0.0],
        denominator: [1.1, 0.3, 0.01],
        tangential: [1e-3, -2e-3],
        ..brown
    };
    let fisheye = radial(Model::Fisheye, [0.02, -0.01, 0.003, -4e-4]);
    [radial(Model::BrownConrady, [0.0; 4]), brown, rational, fisheye]
}

/// Fits often give a pole and a zero that nearly cancel. The denominator goes down to 0.003.
#[test]
fn a_small_denominator_is_no_fold() {
    let calibration = Calibration { focal: [1080.0; 2], principal: [639.5, 479.5], skew: 0.0 };
    let distortion = Distortion {
        denominator: [-14.2802, 51.1345, 0.0],
        ..radial(Model::BrownConrady, [-14.2807, 51.1446, 0.0, 0.0])
    };
    let inverse = Inverse::new(calibration, distortion, [1280, 960]).unwrap();
    for x in 0..128 {
        let raster = [f64::from(10 * x), 700.0];
        let found = distortion.map(inverse.undistorted(raster)).point;
        let found = inverse.calibration.raster(found);
        assert!((found[0] - raster[0]).abs() < 1e-8 && (found[1] - raster[1]).abs() < 1e-8);
    }
}

#[test]
fn positions_are_inverted_to_a_billionth_of_a_pixel() {
    for distortion in lenses() {
        let inverse = Inverse::new(calibration(), distortion, [1280, 720]).unwrap();
        assert!(inverse.iterations <= 5, "{distortion:?}: {}", inverse.iterations);
        let mut worst = 0.0f64;
        for index in 0..40_000u32 {
            // Weyl sequences cover the frame and 100 pixels around it.
            let at = |step: f64| (f64::from(index) * step).fract();
            let raster = [at(0.754_877_666_2) * 1480.0 - 100.0, at(0.569_840_291) * 920.0 - 100.0];
            let q = inverse.undistorted(raster);
            let found = inverse.calibration.raster(distortion.map(q).point);
            worst = worst.max((found[0] - raster[0]).abs()).max((found[1] - raster[1]).abs());
        }
        assert!(worst < 1e-9, "{distortion:?}: {worst:e}");
    }
}

/// Returns the largest error of the inverse at these positions, in pixels.
fn worst(inverse: &Inverse, positions: impl Iterator<Item = [f64; 2]>) -> f64 {
    let error = |raster: [f64; 2]| {
        let q = inverse.undistorted(raster);
        let found = inverse.calibration.raster(inverse.distortion.map(q).point);
        (found[0] - raster[0]).abs().max((found[1] - raster[1]).abs())
    };
    positions.map(error).fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
}

#[test]
fn the_overscan_is_inverted_as_well_as_the_frame() {
    let focal = 409.452_750_573_891_25;
    let calibration =
        Calibration { focal: [focal; 2], principal: [148.044_662_545_388_6, 120.0], skew: 0.0 };
    let distortion =
        radial(Model::Fisheye, [0.004_050_631_976_537_405, -0.007_170_961_785_573_424, 0.0, 0.0]);
    let inverse = Inverse::new(calibration, distortion, [320, 240]).unwrap();
    inverse.check_overscan(400).unwrap();
    let side = |pixels: u32| (0..=pixels / 16).map(|i| f64::from(16 * i) - 400.0);
    let all = side(1120).flat_map(|x| side(1040).map(move |y| [x, y]));
    let worst = worst(&inverse, all);
    assert!(worst < 1e-9, "{worst:e}");
}

#[test]
fn corners_near_a_fold_are_inverted_exactly() {
    let lens = |focal, principal, tangential, model, k: [f64; 2], size: [u32; 2]| {
        let calibration = Calibration { focal: [focal; 2], principal, skew: 0.0 };
        let distortion = Distortion { tangential, ..radial(model, [k[0], k[1], 0.0, 0.0]) };
        Inverse::new(calibration, distortion, size).unwrap()
    };
    let inverses = [
        lens(
            133.551_222_041_248_7,
            [65.257_947_663_015_61, 50.448_179_975_441_32],
            [0.009_617_073_933_606_956, 0.012_544_388_871_754_662],
            Model::BrownConrady,
            [-0.247_726_271_155_220_75, 0.011_770_663_434_388_116],
            [160, 120],
        ),
        lens(
            34.454_240_018_129_35,
            [33.238_449_099_141, 23.234_385_319_857_77],
            [0.0; 2],
            Model::Fisheye,
            [-0.083_518_024_307_561_68, -0.006_111_040_956_015_321],
            [64, 48],
        ),
    ];
    for inverse in inverses {
        // From 1e-6 to 1 pixel from each corner.
        let steps = || (0..60).map(|i| 10f64.powf(f64::from(i) / 10.0 - 6.0));
        let near = steps().flat_map(|x| steps().map(move |y| [x, y]));
        let [w, h] = inverse.end;
        let all = near.flat_map(|[x, y]| [[x, y], [w - x, y], [x, h - y], [w - x, h - y]]);
        let worst = worst(&inverse, all);
        assert!(worst < 1e-9, "{worst:e} {}", inverse.iterations);
    }
}

#[test]
fn derivatives_are_those_of_the_map() {
    for distortion in lenses() {
        for q in [[0.3, -0.2], [-0.5, 0.4], [0.01, 0.6]] {
            let step = 1e-6;
            let at = |x: f64, y: f64| distortion.map([q[0] + x, q[1] + y]).point;
            let by = |a: [f64; 2], b: [f64; 2], k: usize| (a[k] - b[k]) / (2.0 * step);
            let (right, left) = (at(step, 0.0), at(-step, 0.0));
            let (down, up) = (at(0.0, step), at(0.0, -step));
            let expected =
                [by(right, left, 0), by(down, up, 0), by(right, left, 1), by(down, up, 1)];
            let [xx, xy, yy] = distortion.map(q).derivative;
            for (found, expected) in [xx, xy, xy, yy].into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-8, "{distortion:?} {q:?}");
            }
        }
    }
}

#[test]
fn a_fold_is_found_at_the_radius_where_the_derivative_vanishes() {
    // r + k1 r^3 has its maximum at r = 1 / sqrt(-3 k1).
    for (model, k1) in [(Model::BrownConrady, -0.9), (Model::Fisheye, -0.5)] {
        let distortion = radial(model, [k1, 0.0, 0.0, 0.0]);
        let fold = Inverse::new(calibration(), distortion, [1280, 720]).unwrap_err();
        let radius = (-3.0 * k1).sqrt().recip();
        assert!((fold.radius - radius).abs() < 1e-3 * radius, "{fold:?}, {radius}");
        assert_eq!(distortion.culprit(fold.radius), Some("k1"));
        let [x, y] = calibration().plane(fold.raster);
        let length = (x * x + y * y).sqrt();
        assert!((length - radius * 2.0 / 3.0).abs() < 1e-6, "{fold:?}");
        // A frame within that radius can be inverted.
        let small = Calibration { principal: [100.0, 100.0], ..calibration() };
        assert!(Inverse::new(small, distortion, [200, 200]).is_ok());
        let inverse = Inverse::new(small, distortion, [200, 200]).unwrap();
        assert!(inverse.check_overscan(100).is_ok() && inverse.check_overscan(900).is_err());
    }
}
