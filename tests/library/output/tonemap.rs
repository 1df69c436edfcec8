//! Compares the tone operators with values computed by hand from docs/guide/scene-format.md.

use lightpath::{
    output::tonemap::{Curve, Depth, to_samples},
    scene::{ToneOperator, Tonemap},
};

fn map(operator: ToneOperator, exposure: f32, srgb: bool, pixels: &[[f32; 4]]) -> Vec<u8> {
    let tonemap = Tonemap { operator, exposure, srgb };
    to_samples(pixels, &Curve::new(pixels, &tonemap, false), false, Depth::Eight)
}

#[test]
fn clamp_scales_then_clips() {
    let pixels = [[0.1, 0.25, 3.0, 1.0]];
    assert_eq!(map(ToneOperator::Clamp, 0.0, false, &pixels), [26, 64, 255]);
    // x 2 : 0.2 * 255 = 51, 0.5 * 255 = 127.5 -> 128
    assert_eq!(map(ToneOperator::Clamp, 1.0, false, &pixels), [51, 128, 255]);
    assert_eq!(map(ToneOperator::Clamp, -1.0, false, &pixels), [13, 32, 255]);
}

#[test]
fn max_divides_by_the_largest_channel_then_exposes() {
    let pixels = [[1.0, 2.0, 4.0, 1.0], [0.4, 0.0, 0.0, 1.0]];
    assert_eq!(map(ToneOperator::Max, 0.0, false, &pixels), [64, 128, 255, 26, 0, 0]);
    assert_eq!(map(ToneOperator::Max, 1.0, false, &pixels), [128, 255, 255, 51, 0, 0]);
}

#[test]
fn black_stays_black() {
    let black = [[0.0, 0.0, 0.0, 1.0]; 2];
    assert_eq!(map(ToneOperator::Max, 3.0, true, &black), [0; 6]);
}

#[test]
fn alpha_is_not_a_channel_of_the_maximum() {
    assert_eq!(map(ToneOperator::Max, 0.0, false, &[[0.5, 0.25, 0.0, 1.0]]), [255, 128, 0]);
}

#[test]
fn reinhard_exposes_then_compresses() {
    // 1/(1+1) = 0.5; 3/(1+3) = 0.75; 0
    let pixels = [[1.0, 3.0, 0.0, 1.0]];
    assert_eq!(map(ToneOperator::Reinhard, 0.0, false, &pixels), [128, 191, 0]);
    // 2/3, 6/7
    assert_eq!(map(ToneOperator::Reinhard, 1.0, false, &pixels), [170, 219, 0]);
}

#[test]
fn srgb_follows_the_operator() {
    // 0.5 -> 0.735357 -> 187.5 -> 188; 0.002 -> 0.02584 -> 6.6 -> 7; 0.2140411 -> 0.5 -> 127.5
    let pixels = [[0.5, 0.002, 0.2142, 1.0]];
    assert_eq!(map(ToneOperator::Clamp, 0.0, true, &pixels), [188, 7, 128]);
    assert_eq!(map(ToneOperator::Reinhard, 0.0, true, &[[1.0; 4]]), [188; 3]);
}

#[test]
fn negative_and_non_finite_values() {
    let odd = [[-2.0, f32::NAN, f32::INFINITY, 1.0]];
    for operator in [ToneOperator::Clamp, ToneOperator::Reinhard, ToneOperator::Max] {
        assert_eq!(map(operator, 0.0, false, &odd), [0, 0, 255], "{operator:?}");
    }
}

#[test]
fn maximum_of_a_transparent_picture_is_of_its_straight_colour() {
    let tonemap = Tonemap { operator: ToneOperator::Max, exposure: 0.0, srgb: false };
    let pixels = [[0.5, 0.25, 0.0, 0.25], [1.0, 0.0, 0.0, 1.0], [0.0; 4]];
    let bytes = to_samples(&pixels, &Curve::new(&pixels, &tonemap, true), true, Depth::Eight);
    assert_eq!(bytes, [255, 128, 0, 64, 128, 0, 0, 255, 0, 0, 0, 0]);
}
