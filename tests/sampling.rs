//! The plan of dimensions of docs/sampling.md: what is stratified together.

use lightpath::sampler::Sampler;

/// Whether 2^m points have one in each of all rectangles of area 2^-m and power-of-two sides.
fn stratified(points: &[[f32; 2]]) -> bool {
    let m = points.len().ilog2();
    (0..=m).all(|a| {
        let [across, down] = [1u32 << a, 1 << (m - a)];
        let mut met = vec![false; points.len()];
        for [x, y] in points {
            let cell = (x * across as f32) as u32 * down + (y * down as f32) as u32;
            met[cell as usize] = true;
        }
        met.iter().all(|&met| met)
    })
}

#[test]
fn all_light_points_of_a_pixel_are_one_stratified_set() {
    for (spp, samples) in [(1, 16), (4, 4), (16, 16), (64, 4)] {
        for seed in 0..8 {
            let sampler = Sampler::new(seed);
            // The number of a point is that which the renderer gives it.
            let numbers = (0..spp).flat_map(|i| (0..samples).map(move |k| i * samples + k));
            let one: Vec<_> = numbers.map(|index| sampler.light([5, 9], index, 1, 0)).collect();
            assert!(stratified(&one), "{spp} x {samples}");
            // A set for each camera sample, each stratified, is not one.
            let pairs = (0..spp).flat_map(|i| (0..samples).map(move |k| (i, k)));
            let sets: Vec<_> = pairs.map(|(i, k)| sampler.light([i, 7], k, 1, 0)).collect();
            assert!(spp == 1 || !stratified(&sets));
        }
    }
}

#[test]
fn any_aligned_run_of_light_points_is_stratified() {
    let sampler = Sampler::new(4);
    for (first, length) in [(16, 16), (32, 32), (64, 16), (96, 32), (768, 256)] {
        let points: Vec<_> =
            (first..first + length).map(|i| sampler.light([1, 2], i, 0, 0)).collect();
        assert!(stratified(&points), "{length} from {first}");
    }
}

/// Root mean square error over pixels of the volume below a slanted edge through pixel and light.
fn slanted(n: u32, joint: bool) -> f64 {
    let sampler = Sampler::new(11);
    let squares = (0..256).map(|x| {
        let pixel = [x, 3];
        let below = (0..n).filter(|&i| {
            let [x, _, s, _] = sampler.camera(pixel, i);
            x + if joint { s } else { sampler.light(pixel, i, 0, 0)[0] } < 1.0
        });
        (below.count() as f64 / f64::from(n) - 0.5).powi(2)
    });
    (squares.sum::<f64>() / 256.0).sqrt()
}

#[test]
fn pixel_and_single_light_points_are_stratified_together() {
    for n in [64, 256, 1024] {
        let (joint, apart) = (slanted(n, true), slanted(n, false));
        assert!(joint < 0.75 * apart, "{n}: {joint} {apart}");
    }
}

#[test]
fn choices_are_uniform_and_differ_by_all_keys() {
    let sampler = Sampler::new(3);
    let sum: f32 = (0..4096).map(|i| sampler.choice([i, 1], 16, 0, 0)).sum();
    // Standard error 0.0045.
    assert!((sum / 4096.0 - 0.5).abs() < 0.02, "{sum}");
    let one = sampler.choice([1, 2], 3, 0, 0);
    for other in [
        sampler.choice([2, 1], 3, 0, 0),
        sampler.choice([1, 2], 4, 0, 0),
        sampler.choice([1, 2], 3, 1, 0),
        sampler.choice([1, 2], 3, 0, 1),
    ] {
        assert_ne!(one, other);
    }
}
