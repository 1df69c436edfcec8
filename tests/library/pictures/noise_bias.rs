//! `--noise` has no bias: means over seeds are compared with a reference, for slits, grates, wires
//! and glints from fully open to one part in 10,000. Adaptive shadows give no negative light; the
//! tests of `src/integrate/adaptive_shadows.rs` show that they have no bias.

use std::{ops::Range, path::Path};

use lightpath::{
    accel::{self, Accelerator, BuildOptions},
    film::{Film, Window},
    integrate::Relative,
    layers::LayerPlan,
    monitor::Monitor,
    render::{self, Adaptive, RenderContext},
    scene::{self, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

/// Width and height of the picture in pixels.
const SIDE: u32 = 16;

/// Kind of obstacle or light in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// One gap in a sheet between light and floor.
    Slit,
    /// Many gaps, as wide as the slit relative to their distance.
    Grate,
    /// One bar between light and floor.
    Wire,
    /// Small bright balls on a lit floor.
    Glint,
}

/// A bar from x = `a` to `b` at height 2, as long as the scene.
fn bar(a: f64, b: f64) -> Value {
    json!({ "type": "plane", "v0": [a, 2, 6], "v1": [b, 2, 6], "v2": [b, 2, -6], "v3": [a, 2, -6],
            "material": { "ka": 0 } })
}

/// A floor below a square light. `open` is the share of the light that a slit or grate lets through
/// or a wire covers, or the share of a pixel that a glint covers.
fn scene(kind: Kind, open: f64) -> Value {
    let mut shapes = match kind {
        Kind::Slit if open < 1.0 => vec![bar(-6.0, -open / 2.0), bar(open / 2.0, 6.0)],
        Kind::Grate if open < 1.0 => {
            let gap = 0.25 * open / 2.0;
            (-24..24).map(f64::from).map(|k| bar(k / 4.0 + gap, (k + 1.0) / 4.0 - gap)).collect()
        }
        Kind::Slit | Kind::Grate => Vec::new(),
        Kind::Wire => vec![bar(-open / 2.0, open / 2.0)],
        Kind::Glint => (0..81)
            .map(|i| {
                let (x, z, radius) = (f64::from(i % 9), f64::from(i / 9), 0.07 * open.sqrt());
                json!({ "type": "sphere", "radius": radius, "material": { "ka": 1, "kd": 0 },
                        "center": [0.27 * x - 1.1 + 0.013 * z, radius, 0.27 * z - 1.1] })
            })
            .collect(),
    };
    shapes.push(json!({ "type": "plane", "material": { "kd": 0.8 }, "v0": [-8, 0, 8],
                        "v1": [8, 0, 8], "v2": [8, 0, -8], "v3": [-8, 0, -8] }));
    json!({ "camera": { "type": "pinhole", "width": SIDE, "height": SIDE, "fov": 40,
                        "position": [0, 1.6, 2.4], "target": [0, 0, 0], "up": [0, 1, 0] },
            "scene": { "ambient": [20, 20, 20], "shapes": shapes,
                       "lightsources": [{ "type": "arealight", "id": [3, 3, 3], "samples": 1,
                                          "v0": [-1, 4, -1], "v1": [1, 4, -1], "v2": [-1, 4, 1] }] } })
}

/// Calls `work` with the world of a scene and its accelerator.
fn with_world<T>(scene: &Value, work: impl FnOnce(&mut World, &dyn Accelerator) -> T) -> T {
    let text = scene.to_string();
    let source = Source::Text { name: "scene", text: text.as_bytes(), folder: Path::new(".") };
    let scene = scene::load(source, &[]).unwrap().scene;
    let monitor = Monitor::default();
    let (mut world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
    let geometry = world.geometry.clone();
    let options = BuildOptions { threads: 2, max_bytes: None };
    let accelerator = accel::build(&geometry, scene.backend, &options, &monitor).unwrap();
    work(&mut world, accelerator.as_ref())
}

fn film(world: &World) -> Film {
    let [width, height] = world.frame;
    Film::new(world.frame, Window::full(width, height)).unwrap()
}

/// Returns the mean of a list and its standard error.
fn mean(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    [mean, (variance / n).sqrt()]
}

/// Returns the mean radiance of a film.
fn level(film: &Film) -> f64 {
    let sum: f64 = film.pixels.iter().flat_map(|p| &p[..3]).map(|&v| f64::from(v)).sum();
    sum / (3 * film.pixels.len()) as f64
}

/// Returns the mean radiance and its standard error, over plain pictures with `spp` samples.
fn plain(
    world: &mut World,
    accelerator: &dyn Accelerator,
    spp: u32,
    seeds: Range<i64>,
) -> [f64; 2] {
    world.spp = spp;
    let mut film = film(world);
    let levels: Vec<f64> = seeds
        .map(|seed| {
            world.seed = seed;
            render::render(world, accelerator, Isa::detect(), &mut film, &Monitor::default())
                .unwrap();
            level(&film)
        })
        .collect();
    mean(&levels)
}

/// Returns the same for pictures with a noise target, and the mean number of samples.
fn adaptive(
    world: &mut World,
    accelerator: &dyn Accelerator,
    noise: f64,
    relative: Relative,
    seeds: Range<i64>,
) -> ([f64; 2], f64) {
    let adaptive = Adaptive { first: 16, most: 1024, noise: Some(noise), relative, time: None };
    let (plan, mut film) = (LayerPlan::default(), film(world));
    world.spp = adaptive.most;
    let (isa, monitor) = (Isa::detect(), Monitor::default());
    let mut samples = 0.0;
    let levels: Vec<f64> = seeds
        .clone()
        .map(|seed| {
            world.seed = seed;
            let context = RenderContext { world, accelerator, isa, monitor: &monitor };
            let done = render::render_adaptive(context, &mut film, &plan, adaptive);
            samples += done.unwrap().1.mean;
            level(&film)
        })
        .collect();
    (mean(&levels), samples / (seeds.end - seeds.start) as f64)
}

/// Returns the relative bias and z, the bias over its standard error.
fn bias([found, error]: [f64; 2], [truth, exact]: [f64; 2]) -> [f64; 2] {
    [(found - truth) / truth, (found - truth) / error.hypot(exact)]
}

/// Seeds of the references, apart from those of the measured pictures.
const REFERENCE: Range<i64> = 1000..1032;

#[test]
fn the_mean_of_a_picture_does_not_depend_on_when_its_pixels_stop() {
    let worst = [
        (Kind::Slit, 0.1, 0.3, Relative::Pixel),
        (Kind::Slit, 0.01, 0.1, Relative::Picture),
        (Kind::Slit, 0.01, 0.3, Relative::Pixel),
        (Kind::Grate, 0.1, 0.3, Relative::Pixel),
        (Kind::Glint, 0.1, 0.1, Relative::Picture),
        (Kind::Glint, 0.5, 0.1, Relative::Pixel),
    ];
    for (kind, open, noise, relative) in worst {
        let ([off, z], samples) = with_world(&scene(kind, open), |world, accelerator| {
            let truth = plain(world, accelerator, 2048, REFERENCE);
            let (found, samples) = adaptive(world, accelerator, noise, relative, 0..96);
            (bias(found, truth), samples)
        });
        let case = format!("{kind:?} {open}, {noise} of {relative:?}");
        eprintln!("{case}: {samples:.1} samples, bias {off:.1e}, z {z:.1}");
        assert!(off.abs() <= 1e-3 || z.abs() <= 3.0, "{case}: bias {off:.1e}, z {z:.1}");
        // Adaptive sampling has taken more than the first pass.
        assert!(samples > 16.5, "{case}: {samples}");
    }
}

/// Prints the table of docs/notebook/sampling.md. It takes some minutes:
/// `cargo test --release --test library noise_bias -- --ignored --nocapture`.
#[test]
#[ignore = "256 seeds of 216 cases"]
fn the_table_of_biases() {
    println!("| scene | part | target | of | samples | RMS over seeds | bias | z |");
    println!("|---|---|---|---|---|---|---|---|");
    for kind in [Kind::Slit, Kind::Grate, Kind::Wire, Kind::Glint] {
        for open in [1.0, 0.5, 0.1, 0.05, 0.01, 0.003, 0.001, 0.0005, 0.0001] {
            with_world(&scene(kind, open), |world, accelerator| {
                let truth = plain(world, accelerator, 1 << 13, REFERENCE);
                for noise in [0.02, 0.1, 0.3] {
                    for relative in [Relative::Pixel, Relative::Picture] {
                        let (found, samples) =
                            adaptive(world, accelerator, noise, relative, 0..256);
                        let [off, z] = bias(found, truth);
                        let spread = found[1] * 16.0 / truth[0];
                        println!(
                            "| {kind:?} | {open} | {noise} | {relative:?} | {samples:.1} | {spread:.2e} | {off:.1e} | {z:.1} |"
                        );
                    }
                }
            });
        }
    }
}

/// A ball over a glossy floor. Its near light casts a shadow and has another colour for specular
/// light.
fn penumbra() -> Value {
    json!({ "nbounces": 1,
            "camera": { "type": "pinhole", "width": 36, "height": 24, "fov": 45,
                        "position": [0, 2, 4], "target": [0, 0, 0], "up": [0, 1, 0] },
            "scene": { "attenuation": "quadratic",
                       "lightsources": [{ "type": "arealight", "id": [9, 6, 1], "is": [1, 4, 9],
                                          "v0": [-1, 2, -1], "v1": [1, 2, -1], "v2": [-1, 2, 1] }],
                       "shapes": [
        { "type": "sphere", "center": [0, 0.5, 0], "radius": 0.4,
          "material": { "kd": 0.6, "ks": 0.6, "specularexponent": 60, "kr": 0.2 } },
        { "type": "sphere", "center": [0.1, 1.6, -0.3], "radius": 0.03, "material": {} },
        { "type": "plane", "v0": [-8, 0, 8], "v1": [8, 0, 8], "v2": [8, 0, -8], "v3": [-8, 0, -8],
          "material": { "kd": 0.8, "ks": 0.5, "specularexponent": 80 } }] } })
}

/// The dark edge of a penumbra: of the light's points, most pixels see none of the first.
fn dark_edge() -> Value {
    json!({ "spp": 4,
            "camera": { "type": "pinhole", "width": 32, "height": 32, "fov": 12, "up": [0, 1, 0],
                        "position": [-1.9, 3, -0.5], "target": [-0.45, 0, -0.45] },
            "scene": { "lightsources": [
        { "type": "arealight", "v0": [-1, 5, -1], "v1": [1, 5, -1], "v2": [-1, 5, 1],
          "id": [1, 1, 1] }], "shapes": [
        { "type": "plane", "v0": [-9, 0, 9], "v1": [9, 0, 9], "v2": [9, 0, -9], "v3": [-9, 0, -9],
          "material": { "kd": 0.5, "ks": 0.3 } },
        { "type": "sphere", "center": [0, 1.5, 0], "radius": 0.8, "visible": { "camera": false },
          "material": {} }] } })
}

/// The light of a negative colour is that of the colour, taken away.
#[test]
fn adaptive_shadows_take_negative_light_away() {
    for mut scene in [penumbra(), dark_edge()] {
        let mut picture = |sign: f64| {
            scene["adaptiveshadows"] = json!(true);
            let light = &mut scene["scene"]["lightsources"][0];
            light["samples"] = json!(32);
            light["id"] = json!([9.0 * sign, 6.0, 1.0 * sign]);
            light["is"] = json!([1.0 * sign, 4.0, 9.0 * sign]);
            with_world(&scene, |world, accelerator| {
                let mut film = film(world);
                let (isa, monitor) = (Isa::detect(), Monitor::default());
                render::render(world, accelerator, isa, &mut film, &monitor).unwrap();
                film.pixels
            })
        };
        let (light, taken) = (picture(1.0), picture(-1.0));
        assert!(light.iter().any(|pixel| pixel[0] > 0.1));
        for (light, taken) in light.iter().zip(&taken) {
            let [r, g, b, _] = *light;
            assert_eq!(taken[..3], [-r, g, -b]);
        }
    }
}

#[test]
fn adaptive_shadows_never_make_light_negative() {
    for samples in [8, 16, 64] {
        for sampler in ["sobol", "random"] {
            let mut scene = penumbra();
            scene["sampler"] = json!(sampler);
            scene["scene"]["lightsources"][0]["samples"] = json!(samples);
            scene["adaptiveshadows"] = json!(true);
            let lowest = with_world(&scene, |world, accelerator| {
                let mut film = film(world);
                let lowest = (0..64).map(|seed| {
                    world.seed = seed;
                    let (isa, monitor) = (Isa::detect(), Monitor::default());
                    render::render(world, accelerator, isa, &mut film, &monitor).unwrap();
                    film.pixels.iter().flat_map(|p| &p[..3]).fold(f32::INFINITY, |a, &b| a.min(b))
                });
                lowest.fold(f32::INFINITY, f32::min)
            });
            assert!(lowest >= 0.0, "{samples} points of {sampler}: {lowest}");
        }
    }
}

/// Point lights over a floor, of which each shading point draws one: the error of a pixel falls as
/// with independent samples. Planned for stratified ones, it was 0.87 of the target here, and up to
/// 1.35 in scenes/many-lights.json.
#[test]
fn drawn_lights_reach_the_target() {
    let lights: Vec<Value> = (0..40u32)
        .map(|i| {
            let [x, y, z] = [5, 11, 17].map(|k| f64::from(i * k % 41) / 41.0);
            json!({ "type": "pointlight", "id": [1.0, x, z],
                    "position": [4.0 * x - 2.0, 0.5 + y, 4.0 * z - 2.0] })
        })
        .collect();
    let mut scene = scene(Kind::Wire, 0.5);
    scene["scene"]["lightsources"] = json!(lights);
    scene["scene"]["attenuation"] = json!("quadratic");
    let truth = with_world(&scene, |world, accelerator| {
        world.spp = 256;
        let mut film = film(world);
        let (isa, monitor) = (Isa::detect(), Monitor::default());
        render::render(world, accelerator, isa, &mut film, &monitor).unwrap();
        film.pixels
    });
    scene["emittersamples"] = json!(1);
    let target = 0.02;
    let (mut sum, mut pixels, mut samples) = (0.0, 0, 0.0);
    with_world(&scene, |world, accelerator| {
        let (isa, monitor, relative) = (Isa::detect(), Monitor::default(), Relative::Pixel);
        let adaptive =
            Adaptive { first: 16, most: 4096, noise: Some(target), relative, time: None };
        world.spp = adaptive.most;
        let mut film = film(world);
        for seed in 0..8 {
            world.seed = seed;
            let context = RenderContext { world, accelerator, isa, monitor: &monitor };
            let plan = LayerPlan::default();
            let done = render::render_adaptive(context, &mut film, &plan, adaptive).unwrap();
            samples += done.1.mean / 8.0;
            for (found, truth) in film.pixels.iter().zip(&truth) {
                let squares =
                    |of: &dyn Fn(usize) -> f32| (0..3).map(|k| of(k).powi(2)).sum::<f32>();
                let off = squares(&|k| found[k] - truth[k]) / squares(&|k| truth[k]);
                (sum, pixels) = (sum + f64::from(off), pixels + 1);
            }
        }
    });
    let error = (sum / f64::from(pixels)).sqrt() / target;
    eprintln!("{samples:.1} samples, error {error:.2} of the target");
    assert!(samples > 100.0 && (0.3..0.7).contains(&error), "{samples} {error}");
}
