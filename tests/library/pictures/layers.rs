//! Compares layers with the beauty, with each other and with the scene.

use std::{collections::BTreeSet, path::Path};

use crate::support::backends::on_both;
use lightpath::{
    accel::{self, BuildOptions},
    camera,
    film::{Film, ReservedFilm, Window},
    layers::{LayerPlan, MISS_DEPTH, PartialSumsLayout},
    monitor::Monitor,
    render::{RenderContext, render_layers},
    scene::{self, Backend, Scene, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

/// A floor, a glossy ball and a mirror ball in front of a background; a point light in a group of
/// two, an area light without a name; ambient light. On large coordinates, so that P needs the
/// origin.
fn stage(spp: u32) -> Value {
    json!({
        "spp": spp, "nbounces": 3,
        "output": { "layers": ["all"] },
        "camera": { "type": "pinhole", "width": 60, "height": 40, "fov": 45,
            "position": [1000.0, 2.5, 6.0], "lookat": [0.02, -0.3, -1], "up": [0.1, 1, 0] },
        "scene": {
            "backgroundcolor": [0.2, 0.3, 0.5], "ambient": [0.3, 0.2, 0.1],
            "lightsources": [
                { "type": "pointlight", "position": [1003, 6, 3], "id": [4, 4, 3], "is": [1, 2, 3],
                  "group": "key" },
                { "type": "pointlight", "position": [996, 5, 1], "id": [0.5, 1, 2], "group": "key" },
                { "type": "arealight", "v0": [999, 4, 2], "v1": [1001, 4, 2], "v2": [999, 4, 4],
                  "id": [3, 3, 3], "samples": 5 }],
            "materials": {
                "floor": { "kd": 0.8, "ka": 0.5, "kr": 0.2, "diffusecolor": [0.9, 0.8, 0.7] },
                "gloss": { "kd": 0.6, "ks": 0.7, "specularexponent": 20, "ka": 0.3,
                           "diffusecolor": [0.8, 0.2, 0.1] } },
            "shapes": [
                { "type": "plane", "v0": [995, 0, -6], "v1": [1005, 0, -6], "v2": [1005, 0, 4],
                  "v3": [995, 0, 4], "material": "floor" },
                { "type": "sphere", "name": "ball", "center": [999, 1, 0], "radius": 1,
                  "material": "gloss" },
                { "type": "sphere", "center": [1001.2, 1, 0.2], "radius": 1,
                  "material": { "kd": 0.1, "ks": 0.5, "specularexponent": 50, "kr": 0.8 } }]
        }
    })
}

fn checked(scene: &Value) -> Scene {
    let text = scene.to_string();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: Path::new("") };
    scene::load(source, &[]).unwrap().scene
}

struct Rendered {
    film: Film,
    plan: LayerPlan,
}

fn rendered(scene: &Value, window: Option<Window>, threads: usize, isa: Isa) -> Rendered {
    with_overscan(scene, 0, window, threads, isa)
}

fn with_overscan(
    scene: &Value,
    overscan: u32,
    window: Option<Window>,
    threads: usize,
    isa: Isa,
) -> Rendered {
    let scene = checked(scene);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let monitor = Monitor::default();
        let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
        let options = BuildOptions { threads, max_bytes: None };
        let world = world.with_overscan(overscan);
        let backend = match scene.backend {
            Backend::Bvh(_) => Backend::Bvh(isa),
            other => other,
        };
        let accelerator = accel::build(&world.geometry, backend, &options, &monitor).unwrap();
        let plan = LayerPlan::new(&scene);
        let [width, height] = world.frame;
        let window = window.unwrap_or(Window::full(width, height));
        let blank = ReservedFilm::new(world.frame, window, plan.layout.channels.clone());
        let mut film = blank.unwrap().film();
        let accelerator = &*accelerator;
        let context = RenderContext { world: &world, accelerator, isa, monitor: &monitor };
        render_layers(context, &mut film, &plan, None).unwrap();
        Rendered { film, plan }
    })
}

fn all_of(scene: &Value) -> Rendered {
    rendered(scene, None, 1, Isa::detect())
}

impl Rendered {
    fn float(&self, name: &str, pixel: usize) -> f32 {
        let index = self.film.planes.index(name).unwrap_or_else(|| panic!("no channel {name}"));
        self.film.planes.float(index, pixel)
    }

    fn uint(&self, name: &str, pixel: usize) -> u32 {
        self.film.planes.uint(self.film.planes.index(name).unwrap(), pixel)
    }

    /// Returns the sum of layers, and the sum of magnitudes. `half` rounds to half floats.
    fn sum(&self, layers: &[String], axis: usize, pixel: usize, half: bool) -> (f64, f64) {
        let suffix = ["R", "G", "B"][axis];
        let value = |layer: &String| {
            let value = self.float(&format!("{layer}.{suffix}"), pixel);
            f64::from(if half { half::f16::from_f32(value).to_f32() } else { value })
        };
        let values: Vec<f64> = layers.iter().map(value).collect();
        (values.iter().sum(), values.iter().map(|v| v.abs()).sum())
    }

    fn pixels(&self) -> usize {
        self.film.pixels.len()
    }

    fn groups(&self) -> Vec<String> {
        let names = self.plan.layout.channels.iter().filter_map(|c| c.name.strip_suffix(".R"));
        names.filter(|name| name.starts_with("light_")).map(String::from).collect()
    }
}

const COMPONENTS: [&str; 5] = ["diffuse", "specular", "ambient", "reflection", "background"];

#[test]
fn components_and_light_groups_add_up_to_the_beauty() {
    for spp in [1, 4, 16] {
        for (transparent, draws) in
            [(false, None), (true, None), (false, Some(1)), (false, Some(2))]
        {
            let mut scene = stage(spp);
            scene["output"]["transparent"] = json!(transparent);
            if let Some(draws) = draws {
                scene["emittersamples"] = json!(draws);
            }
            let all = all_of(&scene);
            let groups = all.groups();
            assert_eq!(groups.len(), 4, "{groups:?}");
            for layers in [&COMPONENTS.map(String::from)[..], &groups] {
                for pixel in 0..all.pixels() {
                    for axis in 0..3 {
                        let beauty = f64::from(all.film.pixels[pixel][axis]);
                        let (exact, _) = all.sum(layers, axis, pixel, false);
                        let off = (exact - beauty).abs();
                        assert!(off <= 2e-6 * beauty.max(1.0), "{pixel} {axis}: {exact} {beauty}");
                        // Each half float is off by at most half a unit in its last place.
                        let (sum, size) = all.sum(layers, axis, pixel, true);
                        let written = half::f16::from_f32(beauty as f32).to_f64();
                        let bound = (size + beauty) / 2048.0 + 1e-6;
                        assert!((sum - written).abs() <= bound, "{pixel} {axis}: {sum} {written}");
                    }
                }
            }
            let any = |layer: &str| {
                (0..all.pixels()).any(|p| all.sum(&[layer.to_string()], 1, p, false).0 > 0.01)
            };
            for layer in COMPONENTS.into_iter().filter(|l| !(transparent && *l == "background")) {
                assert!(any(layer), "{layer} is black");
            }
        }
    }
}

#[test]
fn layers_do_not_change_the_beauty() {
    for spp in [1, 5, 16] {
        let mut plain = stage(spp);
        plain["output"]["layers"] = json!([]);
        let plain = all_of(&plain);
        assert!(plain.plan.is_empty() && plain.film.planes.words.is_empty());
        assert_eq!(plain.film.pixels, all_of(&stage(spp)).film.pixels);
    }
}

on_both! {
    fn the_same_bits_for_any_threads_tiers_and_crops(backend: Backend) {
        for (spp, draws) in [(1, None), (5, None), (5, Some(1))] {
            let mut scene = stage(spp);
            scene["scene"]["accelerator"] = json!(backend.name());
            if let Some(draws) = draws {
                scene["emittersamples"] = json!(draws);
            }
            let full = all_of(&scene);
            assert_eq!(
                rendered(&scene, None, 3, Isa::Portable).film.planes.words,
                full.film.planes.words
            );
            let window = Window { x0: 13, y0: 7, x1: 47, y1: 35 };
            let crop = rendered(&scene, Some(window), 2, Isa::detect());
            let stride = full.plan.layout.channels.len();
            for y in 0..window.height() as usize {
                let width = window.width() as usize * stride;
                let from = ((y + 7) * 60 + 13) * stride;
                let row = &crop.film.planes.words[y * width..(y + 1) * width];
                assert_eq!(row, &full.film.planes.words[from..from + width]);
            }
        }
    }
}

on_both! {
    fn overscan_keeps_the_frame_and_extends_it(backend: Backend) {
        for spp in [1, 4, 16] {
            let mut scene = stage(spp);
            scene["scene"]["accelerator"] = json!(backend.name());
            let full = all_of(&scene);
            // 60 x 40 and 9 more pixels on every side, with an overscan of whole tiles.
            let window = Window { x0: 32 - 9, y0: 32 - 9, x1: 32 + 60 + 9, y1: 32 + 40 + 9 };
            let wide = with_overscan(&scene, 32, Some(window), 2, Isa::detect());
            let stride = full.plan.layout.channels.len();
            for y in 0..40 {
                let (from, to) = (y * 60, (y + 9) * 78 + 9);
                assert_eq!(wide.film.pixels[to..to + 60], full.film.pixels[from..from + 60]);
                let words = |rendered: &Rendered, first: usize| {
                    rendered.film.planes.words[first * stride..(first + 60) * stride].to_vec()
                };
                assert_eq!(words(&wide, to), words(&full, from));
            }
            // Points in the overscan project into their pixels, too.
            let to_ndc = camera::world_to_ndc(&checked(&scene).camera).unwrap();
            let mut beside = 0;
            for pixel in (0..wide.pixels()).filter(|&pixel| wide.float("Z", pixel) < MISS_DEPTH) {
                let p = ["P.X", "P.Y", "P.Z"].map(|c| f64::from(wide.float(c, pixel)));
                let p = [p[0], p[1], p[2], 1.0];
                let [x, y, _, w]: [f64; 4] =
                    std::array::from_fn(|c| (0..4).map(|r| p[r] * to_ndc[r][c]).sum());
                let column = (pixel % 78) as f64 - 9.0;
                let row = (pixel / 78) as f64 - 9.0;
                let (x, y) = (x / w * 60.0 - column, y / w * 40.0 - row);
                assert!((-0.01..1.01).contains(&x) && (-0.01..1.01).contains(&y), "{pixel}: {x} {y}");
                beside += u32::from(column < 0.0 || row < 0.0 || column >= 60.0 || row >= 40.0);
            }
            assert!(beside > 500, "{beside}");
        }
    }
}

#[test]
fn points_project_into_their_pixels() {
    let all = all_of(&stage(16));
    let camera = checked(&stage(16)).camera;
    let (to_camera, to_ndc) =
        (camera::world_to_camera(&camera), camera::world_to_ndc(&camera).unwrap());
    let times = |p: [f64; 4], m: &[[f64; 4]; 4]| -> [f64; 4] {
        std::array::from_fn(|c| (0..4).map(|r| p[r] * m[r][c]).sum())
    };
    let mut hits = 0;
    for pixel in 0..all.pixels() {
        let z = all.float("Z", pixel);
        if z == MISS_DEPTH {
            assert_eq!(["P.X", "P.Y", "P.Z"].map(|c| all.float(c, pixel)), [0.0; 3]);
            assert_eq!((all.uint("primid.id", pixel), all.uint("objectid.id", pixel)), (0, 0));
            continue;
        }
        hits += 1;
        let p = ["P.X", "P.Y", "P.Z"].map(|c| f64::from(all.float(c, pixel)));
        let p = [p[0], p[1], p[2], 1.0];
        // At 1000, f32 has a precision of 6e-5.
        assert!((times(p, &to_camera)[2] - f64::from(z)).abs() < 2e-4);
        let [x, y, _, w] = times(p, &to_ndc);
        let (x, y) = (x / w * 60.0 - (pixel % 60) as f64, y / w * 40.0 - (pixel / 60) as f64);
        assert!((-0.01..1.01).contains(&x) && (-0.01..1.01).contains(&y), "{pixel}: {x} {y}");
    }
    assert!(hits > 1000 && hits < all.pixels());
}

#[test]
fn ids_name_the_visible_object_and_are_never_blended() {
    let all = all_of(&stage(16));
    let seen: BTreeSet<u32> = (0..all.pixels()).map(|p| all.uint("objectid.id", p)).collect();
    assert_eq!(seen, BTreeSet::from([0, 1, 2, 3]));
    for pixel in 0..all.pixels() {
        // Indices of primitives: first the quad, then the spheres.
        assert_eq!(all.uint("primid.id", pixel), all.uint("objectid.id", pixel));
        assert_eq!(all.float("samples.Y", pixel), 16.0);
    }
}

#[test]
fn normals_and_colours_are_those_of_the_shapes() {
    let all = all_of(&stage(1));
    for pixel in 0..all.pixels() {
        let vector = |layer: &str, names: [&str; 3]| {
            names.map(|c| all.float(&format!("{layer}.{c}"), pixel))
        };
        let n = vector("N", ["X", "Y", "Z"]);
        assert_eq!(n, vector("Ng", ["X", "Y", "Z"]), "nothing is smooth here");
        let albedo = vector("albedo", ["R", "G", "B"]);
        match all.uint("objectid.id", pixel) {
            0 => assert_eq!((n, albedo), ([0.0; 3], [0.0; 3])),
            1 => assert_eq!((n, albedo), ([0.0, 1.0, 0.0], [0.9, 0.8, 0.7])),
            2 => {
                let p = vector("P", ["X", "Y", "Z"]);
                let radius = [p[0] - 999.0, p[1] - 1.0, p[2]];
                for axis in 0..3 {
                    assert!((n[axis] - radius[axis]).abs() < 2e-4, "{n:?} {radius:?}");
                }
                assert_eq!(albedo, [0.8, 0.2, 0.1]);
            }
            _ => assert_eq!(albedo, [1.0; 3]),
        }
    }
}

#[test]
fn a_light_group_scaled_is_the_light_scaled() {
    let before = all_of(&stage(4));
    let mut brighter = stage(4);
    for light in 0..2 {
        for key in ["id", "is"] {
            if let Some(color) = brighter["scene"]["lightsources"][light].get_mut(key) {
                for value in color.as_array_mut().unwrap() {
                    *value = json!(value.as_f64().unwrap() * 2.5);
                }
            }
        }
    }
    let after = all_of(&brighter);
    let others: Vec<String> = before.groups().into_iter().filter(|g| g != "light_key").collect();
    for pixel in 0..before.pixels() {
        for axis in 0..3 {
            let key = before.sum(&["light_key".to_string()], axis, pixel, false).0;
            let relit = 2.5 * key + before.sum(&others, axis, pixel, false).0;
            let expected = f64::from(after.film.pixels[pixel][axis]);
            assert!((relit - expected).abs() <= 4e-6 * expected.max(1.0), "{relit} {expected}");
        }
    }
}

#[test]
fn shadow_layers_hold_the_visible_share_of_a_light() {
    let all = all_of(&stage(1));
    let mut seen = BTreeSet::new();
    for pixel in 0..all.pixels() {
        // Two lights of one sample each, and one light of five.
        let key = all.float("shadow_key.Y", pixel) * 2.0;
        let area = all.float("shadow_3.Y", pixel) * 5.0;
        assert!((key - key.round()).abs() < 1e-6 && (area - area.round()).abs() < 1e-5);
        seen.extend([(0, key.round() as u32), (1, area.round() as u32)]);
        if key == 0.0 && area == 0.0 {
            let lit = ["diffuse".to_string(), "specular".to_string()];
            assert_eq!(all.sum(&lit, 1, pixel, false).0, 0.0);
        }
    }
    assert_eq!(seen.iter().filter(|(light, _)| *light == 0).count(), 3);
    assert_eq!(seen.iter().filter(|(light, _)| *light == 1).count(), 6);
}

#[test]
fn mattes_cover_what_alpha_covers() {
    let mut scene = stage(16);
    scene["output"]["transparent"] = json!(true);
    let all = all_of(&scene);
    for pixel in 0..all.pixels() {
        for kind in ["CryptoObject", "CryptoMaterial"] {
            let mut sum = 0.0;
            let mut last = f32::MAX;
            for rank in 0..6 {
                let channels = [["R", "G"], ["B", "A"]][rank % 2];
                let name = |c: &str| format!("{kind}{:02}.{c}", rank / 2);
                let coverage = all.float(&name(channels[1]), pixel);
                assert!(coverage <= last);
                assert_eq!(coverage == 0.0, all.uint(&name(channels[0]), pixel) == 0);
                (sum, last) = (sum + coverage, coverage);
            }
            assert_eq!(sum, all.film.pixels[pixel][3]);
        }
    }
}

#[test]
fn variance_is_that_of_the_samples() {
    // With one light and no antialiasing except at the edge, most pixels do not vary at all.
    let all = all_of(&stage(16));
    let edge = (0..all.pixels()).filter(|&p| all.float("variance.G", p) > 1e-3).count();
    assert!(edge > 50 && edge < all.pixels() / 2, "{edge}");
    let one = all_of(&stage(1));
    assert!((0..one.pixels()).all(|p| one.float("variance.R", p) == 0.0));
    for pixel in 0..all.pixels() {
        if all.uint("objectid.id", pixel) == 0 {
            assert!(all.float("variance.G", pixel) < 1e-12, "background does not vary");
        }
    }
}

#[test]
fn variance_has_the_divisor_n_minus_1() {
    let scene = stage(16);
    // The balls and their edges.
    let window = Window { x0: 16, y0: 12, x1: 44, y1: 28 };
    let all = rendered(&scene, Some(window), 1, Isa::detect());
    let samples: Vec<Film> = (0..16).map(|k| one_sample(&scene, window, k)).collect();
    let mut varied = 0;
    for pixel in 0..all.pixels() {
        for (axis, name) in ["variance.R", "variance.G", "variance.B"].into_iter().enumerate() {
            let values = samples.iter().map(|film| f64::from(film.pixels[pixel][axis]));
            let mean = values.clone().sum::<f64>() / 16.0;
            let expected = values.map(|value| (value - mean).powi(2)).sum::<f64>() / 15.0;
            let found = f64::from(all.float(name, pixel));
            let bound = 1e-6 * expected + 1e-12 * mean * mean;
            assert!((found - expected).abs() <= bound, "{pixel} {name}: {found} {expected}");
            varied += u32::from(expected > 1e-3);
        }
    }
    assert!(varied > 100, "{varied}");
}

/// Renders one camera sample of the scene's samples, as a part of the picture.
fn one_sample(scene: &Value, window: Window, sample: u32) -> Film {
    let scene = checked(scene);
    let monitor = Monitor::default();
    let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
    let options = BuildOptions { threads: 1, max_bytes: None };
    let accelerator = accel::build(&world.geometry, scene.backend, &options, &monitor).unwrap();
    let plan = LayerPlan::new(&scene);
    let part = PartialSumsLayout::new(&plan.layout, sample..sample + 1);
    let mut film = ReservedFilm::new(world.frame, window, part.channels()).unwrap().film();
    let accelerator = &*accelerator;
    let context =
        RenderContext { world: &world, accelerator, isa: Isa::detect(), monitor: &monitor };
    render_layers(context, &mut film, &plan, Some(&part)).unwrap();
    film
}
