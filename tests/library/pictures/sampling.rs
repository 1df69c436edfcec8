//! The sampling dimensions of docs/guide/sampling.md: which of them are stratified together, and
//! that the renderer uses them so.

use std::path::Path;

use crate::support::errors::worse;
use lightpath::{
    accel::{self, BuildOptions},
    film::{Film, Window},
    monitor::Monitor,
    render,
    sampler::Sampler,
    scene::{self, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

/// Returns true if 2^m points have one point in each rectangle of area 2^-m with power-of-two
/// sides.
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
            // Numbers a point as the renderer does.
            let numbers = (0..spp).flat_map(|i| (0..samples).map(move |k| i * samples + k));
            let one: Vec<_> = numbers.map(|index| sampler.light([5, 9], index, 1, 0)).collect();
            assert!(stratified(&one), "{spp} x {samples}");
            // The set of each camera sample is stratified, but all sets together are not.
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

/// Returns the RMS error over pixels of the volume below a slanted edge through pixel and light.
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
    let all: Vec<[f64; 2]> = (0..4096).map(|i| sampler.choices([i, 1], 16, 0, 0)).collect();
    let mean = |value: fn(&[f64; 2]) -> f64| all.iter().map(value).sum::<f64>() / 4096.0;
    // Standard errors 0.0045, 0.0045 and 0.0013.
    for off in [mean(|c| c[0]) - 0.5, mean(|c| c[1]) - 0.5] {
        assert!(off.abs() < 0.02, "{off}");
    }
    let product = mean(|c| (c[0] - 0.5) * (c[1] - 0.5));
    assert!(product.abs() < 0.005, "{product}");
    let one = sampler.choices([1, 2], 3, 0, 0);
    for other in [
        sampler.choices([2, 1], 3, 0, 0),
        sampler.choices([1, 2], 4, 0, 0),
        sampler.choices([1, 2], 3, 1, 0),
        sampler.choices([1, 2], 3, 0, 1),
    ] {
        assert_ne!(one, other);
    }
}

const SIDE: u32 = 8;
const SPP: u32 = 16;
const SEED: i64 = 5;

/// A white plane z = 0, of which the camera at (0, 0, 1) sees [-1, 1]^2. It has a blue point light
/// and two area lights of one point per sample, a red one before a green one, each over [-0.5,
/// 0.5]^2 at z = 0.25.
fn lit_plane() -> Value {
    let square = |id: [i32; 3], samples: u32| {
        json!({ "type": "arealight", "v0": [-0.5, -0.5, 0.25], "v1": [0.5, -0.5, 0.25], "v2": [0.5, 0.5, 0.25],
                "id": id, "samples": samples })
    };
    json!({
        "spp": SPP, "seed": SEED,
        "camera": { "type": "pinhole", "width": SIDE, "height": SIDE, "fov": 90,
                    "position": [0, 0, 1], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": {
            "attenuation": "quadratic",
            "lightsources": [{ "type": "pointlight", "position": [0, 0, 0.25], "id": [0, 0, 1] },
                             square([1, 0, 0], 1), square([0, 1, 0], 1)],
            "shapes": [{ "type": "plane", "v0": [-9, -9, 0], "v1": [9, -9, 0], "v2": [9, 9, 0],
                         "v3": [-9, 9, 0], "material": { "kd": 1, "diffusecolor": [1, 1, 1] } }],
        }
    })
}

fn rendered(scene: &Value) -> Vec<[f32; 4]> {
    let (text, monitor, isa) = (scene.to_string(), Monitor::default(), Isa::detect());
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: Path::new("") };
    let scene = scene::load(source, &[]).unwrap().scene;
    let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
    let options = BuildOptions { threads: 1, max_bytes: None };
    let accelerator = accel::build(&world.geometry, scene.backend, &options, &monitor).unwrap();
    let mut film = Film::new(world.frame, Window::full(SIDE, SIDE)).unwrap();
    render::render(&world, &*accelerator, isa, &mut film, &monitor).unwrap();
    film.pixels.to_vec()
}

/// Returns the mean over a pixel's camera samples of the light's contribution, for the points (s,
/// t) of `square`.
fn mean(pixel: [u32; 2], square: impl Fn(u32) -> [f32; 2]) -> f64 {
    mean_of(SPP, pixel, square)
}

/// [`mean`] of `spp` camera samples.
fn mean_of(spp: u32, pixel: [u32; 2], square: impl Fn(u32) -> [f32; 2]) -> f64 {
    let sum: f64 = (0..spp)
        .map(|i| {
            let [x, y, ..] = Sampler::new(SEED).camera(pixel, i).map(f64::from);
            let across = 2.0 * (f64::from(pixel[0]) + x) / f64::from(SIDE) - 1.0;
            let up = 1.0 - 2.0 * (f64::from(pixel[1]) + y) / f64::from(SIDE);
            let [s, t] = square(i).map(f64::from);
            let (dx, dy, dz) = (s - 0.5 - across, t - 0.5 - up, 0.25);
            let d2: f64 = dx * dx + dy * dy + dz * dz;
            // N.L / d^2
            dz / d2.sqrt() / d2
        })
        .sum();
    sum / f64::from(spp)
}

#[test]
fn the_renderer_takes_single_light_points_from_the_camera_s_sequence() {
    let pixels = rendered(&lit_plane());
    let sampler = Sampler::new(SEED);
    // Largest relative difference over all pixels, for points of the expected source and of
    // another.
    let (mut own, mut other) = ([0f64; 3], [0f64; 2]);
    for (pixel, found) in (0..SIDE * SIDE).map(|k| [k % SIDE, k / SIDE]).zip(&pixels) {
        let joint = mean(pixel, |i| {
            let [_, _, s, t] = sampler.camera(pixel, i);
            [s, t]
        });
        let of_light = |light: u32| mean(pixel, |i| sampler.light(pixel, i, light, 0));
        let difference = |c: usize, expected: f64| (f64::from(found[c]) / expected - 1.0).abs();
        // The point light has number 0. The first area light takes the camera's sequence, though it
        // is not the first light.
        let expected = [joint, of_light(2), mean(pixel, |_| [0.5; 2])];
        for c in 0..3 {
            own[c] = own[c].max(difference(c, expected[c]));
        }
        other[0] = other[0].max(difference(0, of_light(1)));
        other[1] = other[1].max(difference(1, joint));
    }
    assert!(own.iter().all(|&worst| worst < 1e-4), "{own:?}");
    // The points of any other sequence give large differences.
    assert!(other.iter().all(|&worst| worst > 0.05), "{other:?}");
}

#[test]
fn lights_of_several_points_have_sequences_of_their_own() {
    const POINTS: u32 = 4;
    let mut scene = lit_plane();
    scene["scene"]["lightsources"][1]["samples"] = json!(POINTS);
    let sampler = Sampler::new(SEED);
    let mut worst = [0f64; 2];
    for (pixel, found) in (0..SIDE * SIDE).map(|k| [k % SIDE, k / SIDE]).zip(rendered(&scene)) {
        let of = |number: u32| {
            mean(pixel, |i| sampler.light(pixel, i * POINTS + number, 1, 0)) / f64::from(POINTS)
        };
        let expected: f64 = (0..POINTS).map(of).sum();
        // The first area light has several points, so the other one does not take the camera's
        // sequence either.
        let single = mean(pixel, |i| sampler.light(pixel, i, 2, 0));
        for (c, expected) in [expected, single].into_iter().enumerate() {
            worst[c] = worse(worst[c], (f64::from(found[c]) / expected - 1.0).abs());
        }
    }
    assert!(worst.iter().all(|&worst| worst < 1e-4), "{worst:?}");
}

/// With a lens, with less than 16 camera samples and after a mirror, single points of the first
/// area light are from a sequence of its own, too.
#[test]
fn the_camera_s_sequence_is_shared_only_without_lens_from_16_samples_on_and_before_mirrors() {
    let mut lens = lit_plane();
    // The plane is in focus, so rays from all points of the lens meet there.
    lens["camera"]["type"] = json!("thinlens");
    lens["camera"]["aperture"] = json!(0.2);
    lens["camera"]["focaldistance"] = json!(1);
    let mut few = lit_plane();
    few["spp"] = json!(8);
    // The mirror image of this camera is that of the other scenes, but for left and right.
    let mut mirrored = lit_plane();
    mirrored["nbounces"] = json!(1);
    mirrored["camera"]["position"] = json!([0, 0, 0.5]);
    mirrored["camera"]["lookat"] = json!([0, 0, 1]);
    let mirror = json!({ "type": "plane", "v0": [-9, -9, 0.75], "v1": [9, -9, 0.75], "v2": [9, 9, 0.75],
                         "v3": [-9, 9, 0.75], "material": { "kd": 0, "kr": 1 } });
    mirrored["scene"]["shapes"].as_array_mut().unwrap().push(mirror);
    let sampler = Sampler::new(SEED);
    for (case, scene, spp, bounce) in
        [("lens", lens, SPP, 0), ("few", few, 8, 0), ("mirror", mirrored, SPP, 1)]
    {
        let (mut own, mut joint) = ([0f64; 2], 0f64);
        for (pixel, found) in (0..SIDE * SIDE).map(|k| [k % SIDE, k / SIDE]).zip(rendered(&scene)) {
            // The lights lie symmetrically, so a mirrored place has mirrored light points.
            let flip = |s: f32| if bounce == 1 { 1.0 - s } else { s };
            let of = |point: &dyn Fn(u32) -> [f32; 2]| {
                mean_of(spp, pixel, |i| {
                    let [s, t] = point(i);
                    [flip(s), t]
                })
            };
            for (c, light) in [1, 2].into_iter().enumerate() {
                let expected = of(&|i| sampler.light(pixel, i, light, bounce));
                own[c] = worse(own[c], (f64::from(found[c]) / expected - 1.0).abs());
            }
            let expected = of(&|i| {
                let [_, _, s, t] = sampler.camera(pixel, i);
                [s, t]
            });
            joint = worse(joint, (f64::from(found[0]) / expected - 1.0).abs());
        }
        assert!(own.iter().all(|&worst| worst < 1e-4) && joint > 0.05, "{case}: {own:?} {joint}");
    }
}
