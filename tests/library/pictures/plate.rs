//! Shapes for composites: visibility by kind of ray, holdouts and shadow catchers, on every
//! backend.

use std::path::Path;

use crate::support::backends;
use crate::support::errors::worse;
use lightpath::{
    film::{Film, ReservedFilm, Window},
    layers::{LayerPlan, MISS_DEPTH},
    monitor::Monitor,
    render::{RayCounts, RenderContext, render_layers},
    scene::{self, Backend, Source, written::AcceleratorName},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

/// Width and height of the pictures.
const SIZE: [usize; 2] = [48, 40];

/// The backends of this build: `embree` only if the library was there when it was compiled.
fn all_backends() -> Vec<Backend> {
    let embree = cfg!(lightpath_embree).then_some(AcceleratorName::Embree);
    let own = [AcceleratorName::Bvh, AcceleratorName::Coursework, AcceleratorName::Brute];
    own.into_iter().chain(embree).map(Backend::from).collect()
}

struct Picture {
    film: Film,
    counts: RayCounts,
}

impl Picture {
    fn new(scene: &Value, backend: Backend) -> Self {
        let text = scene.to_string();
        let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: Path::new("") };
        let scene = scene::load(source, &[]).unwrap().scene;
        let monitor = Monitor::default();
        let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
        let accelerator = backends::build(&world.geometry, backend);
        let plan = LayerPlan::new(&scene);
        let [width, height] = world.frame;
        let window = Window::full(width, height);
        let blank = ReservedFilm::new(world.frame, window, plan.layout.channels.clone());
        let (mut film, isa) = (blank.unwrap().film(), Isa::detect());
        let accelerator = &*accelerator;
        let context = RenderContext { world: &world, accelerator, isa, monitor: &monitor };
        let counts = render_layers(context, &mut film, &plan, None).unwrap();
        Self { film, counts }
    }

    fn float(&self, channel: &str, pixel: usize) -> f32 {
        let index = self.film.planes.index(channel);
        self.film.planes.float(index.unwrap_or_else(|| panic!("no {channel}")), pixel)
    }

    fn object(&self, pixel: usize) -> u32 {
        self.film.planes.uint(self.film.planes.index("objectid.id").unwrap(), pixel)
    }

    fn pixels(&self) -> std::ops::Range<usize> {
        0..self.film.pixels.len()
    }

    /// Returns whether all channels of a pixel are the same in another picture.
    fn same(&self, other: &Self, pixel: usize) -> bool {
        let count = self.film.planes.channels.len();
        let words = |film: &Film| film.planes.words[pixel * count..][..count].to_vec();
        let beauty = |film: &Film| film.pixels[pixel].map(f32::to_bits);
        beauty(&self.film) == beauty(&other.film) && words(&self.film) == words(&other.film)
    }
}

/// Luminance of BT.709.
fn luminance(pixel: &[f32; 4]) -> f64 {
    let [r, g, b] = [0, 1, 2].map(|axis| f64::from(pixel[axis]));
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// A shape of each kind between a floor and a mirror at the back, under a point light and an area
/// light. The ends of the scene belong to the walls, so that the origin does not depend on the
/// other shapes. Shapes 3 to 6 are those in between.
fn room(spp: u32) -> Value {
    json!({
        "spp": spp, "nbounces": 1,
        "output": { "layers": ["Z", "N", "albedo", "objectid", "primid", "light", "shadow",
                               "components", "cryptomatte"], "transparent": true },
        "camera": { "type": "pinhole", "width": SIZE[0], "height": SIZE[1], "fov": 52,
            "position": [0.3, 2.4, 7], "target": [0, 0.8, 0], "up": [0, 1, 0] },
        "scene": {
            "backgroundcolor": [0.1, 0.2, 0.3], "ambient": [0.2, 0.2, 0.1],
            "lightsources": [
                { "type": "pointlight", "position": [2, 6, 4], "id": [4, 4, 3], "name": "point" },
                { "type": "arealight", "v0": [-4, 5, 2], "v1": [-3, 5, 2], "v2": [-4, 5, 3],
                  "id": [2, 3, 4], "samples": 6, "name": "area" }],
            "materials": { "plain": { "kd": 0.8, "ka": 0.5, "diffusecolor": [0.9, 0.6, 0.4] },
                           "mirror": { "kd": 0.2, "kr": 0.8 } },
            "shapes": [
                { "type": "plane", "v0": [-5, 0, -4], "v1": [5, 0, -4], "v2": [5, 0, 5],
                  "v3": [-5, 0, 5], "material": "plain", "name": "floor" },
                { "type": "plane", "v0": [-5, 0, -4], "v1": [-5, 4, -4], "v2": [5, 4, -4],
                  "v3": [5, 0, -4], "material": "mirror" },
                { "type": "sphere", "center": [-1.8, 0.7, 0.3], "radius": 0.6,
                  "material": "plain" },
                { "type": "plane", "v0": [-0.9, 0.2, 0], "v1": [0.1, 0.2, 0.3],
                  "v2": [0.1, 1.3, 0.3], "v3": [-0.9, 1.3, 0], "material": "plain" },
                { "type": "triangle", "v0": [0.4, 0.2, 0.4], "v1": [1.3, 0.3, 0], "v2": [0.8, 1.4, 0],
                  "material": "plain" },
                { "type": "trimesh", "path": "assets/octahedron.ply", "fit": 1.4,
                  "center": [2.1, 0.9, -0.4], "material": "plain" },
                // One shape of every kind, except the mesh, is never hidden.
                { "type": "sphere", "center": [-3, 0.5, 1], "radius": 0.4, "material": "plain" },
                { "type": "triangle", "v0": [2.5, 0.2, 2], "v1": [3.2, 0.2, 2], "v2": [3, 1, 2],
                  "material": "plain" }]
        }
    })
}

/// The indices of the shapes that the tests hide, in [`room`].
const HIDDEN: std::ops::Range<usize> = 2..6;

fn without(mut scene: Value, shape: usize) -> Value {
    scene["scene"]["shapes"].as_array_mut().unwrap().remove(shape);
    scene
}

fn with(mut scene: Value, shape: usize, key: &str, value: Value) -> Value {
    scene["scene"]["shapes"][shape][key] = value;
    scene
}

#[test]
fn a_shape_that_no_ray_can_hit_is_not_there() {
    let nothing = json!({ "camera": false, "shadow": false, "reflection": false });
    for backend in all_backends() {
        for shape in HIDDEN {
            let hidden = Picture::new(&with(room(1), shape, "visible", nothing.clone()), backend);
            let gone = Picture::new(&without(room(1), shape), backend);
            assert_eq!(hidden.counts, gone.counts, "{} {shape}", backend.name());
            assert_eq!(hidden.film.pixels, gone.film.pixels, "{} {shape}", backend.name());
        }
    }
}

#[test]
fn each_kind_of_ray_has_its_own_shapes() {
    for backend in all_backends() {
        let plain = Picture::new(&room(1), backend);
        let mut darker = 0;
        for shape in HIDDEN {
            let name = format!("{} {shape}", backend.name());
            let gone = Picture::new(&without(room(1), shape), backend);
            let hidden = |kind: &str| {
                Picture::new(&with(room(1), shape, "visible", json!({ kind: false })), backend)
            };
            let [camera, shadow, reflection] = ["camera", "shadow", "reflection"].map(hidden);
            let own = shape as u32 + 1;
            // Shapes after the one that is gone have lower numbers there.
            let number = |object: u32| if object >= own { object + 1 } else { object };
            let (mut through, mut brighter, mut mirrored) = (0, 0, 0);
            for pixel in plain.pixels() {
                let (first, behind) = (plain.object(pixel), number(gone.object(pixel)));
                // The camera sees what is behind, in the shadow and in the mirror of the shape.
                assert_eq!(camera.object(pixel), behind, "{name}");
                assert_eq!(camera.float("Z", pixel), gone.float("Z", pixel), "{name}");
                if first != own {
                    assert!(camera.same(&plain, pixel), "{name} {pixel}");
                } else {
                    through += 1;
                }
                // Shadows only: what the mirror shows is lit without them, too.
                assert_eq!(shadow.object(pixel), first, "{name}");
                for light in ["shadow_point.Y", "shadow_area.Y"] {
                    let [here, there] = [&shadow, &plain].map(|p| p.float(light, pixel));
                    assert!(here >= there, "{name} {pixel} {light}: {here} {there}");
                    brighter += u32::from(here > there);
                    if first == behind {
                        assert_eq!(here, gone.float(light, pixel), "{name} {pixel} {light}");
                    }
                    // An invisible shape still shadows.
                    let seen = camera.float(light, pixel);
                    darker += u32::from(first == own && seen < gone.float(light, pixel));
                }
                // Mirrors only: direct light is that of the plain picture.
                for axis in ["R", "G", "B"] {
                    let [direct, mirror] = ["diffuse", "reflection"].map(|n| format!("{n}.{axis}"));
                    assert_eq!(reflection.float(&direct, pixel), plain.float(&direct, pixel));
                    let [here, there] =
                        [&reflection, &plain].map(|p| p.float(&mirror, pixel).to_bits());
                    mirrored += u32::from(here != there);
                }
            }
            let found = [through, brighter, mirrored];
            assert!(found.iter().all(|&count| count > 0), "{name}: {found:?}");
        }
        assert!(darker > 0, "{}", backend.name());
    }
}

#[test]
fn kinds_of_rays_do_not_cost_rays() {
    let visible = json!({ "camera": true, "shadow": true, "reflection": true });
    let [plain, written] = [room(4), with(room(4), 3, "visible", visible)]
        .map(|s| Picture::new(&s, AcceleratorName::Bvh.into()));
    assert_eq!(plain.counts, written.counts);
    assert!(plain.pixels().all(|pixel| plain.same(&written, pixel)));
}

#[test]
fn a_holdout_cuts_all_layers_and_nothing_else() {
    for backend in all_backends() {
        let [plain, cut] = [room(1), with(room(1), 2, "holdout", json!(true))]
            .map(|scene| Picture::new(&scene, backend));
        let opaque = with(room(1), 2, "holdout", json!(true));
        let opaque = {
            let mut scene = opaque;
            scene["output"]["transparent"] = json!(false);
            Picture::new(&scene, backend)
        };
        let mut holes = 0;
        for pixel in plain.pixels() {
            if plain.object(pixel) != 3 {
                assert!(cut.same(&plain, pixel), "{} {pixel}", backend.name());
                continue;
            }
            holes += 1;
            assert_eq!(cut.film.pixels[pixel], [0.0; 4]);
            // Also in front of a background that is not transparent.
            assert_eq!(opaque.film.pixels[pixel], [0.0; 4]);
            for (i, channel) in cut.film.planes.channels.iter().enumerate() {
                let word = cut.film.planes.uint(i, pixel);
                let miss = if channel.name == "Z" { MISS_DEPTH.to_bits() } else { 0 };
                assert_eq!(word, miss, "{} {pixel}", channel.name);
            }
        }
        assert!(holes > 20);
    }
}

/// The floor as a shadow catcher, compared with two pictures of a white floor: with and without the
/// shadows of all other shapes, which camera rays pass through.
#[test]
fn alpha_of_a_catcher_is_what_the_shadows_take() {
    for (backend, adaptive, few) in all_backends()
        .into_iter()
        .map(|backend| (backend, false, 40))
        .chain([(AcceleratorName::Bvh.into(), true, 40), (AcceleratorName::Bvh.into(), false, 1)])
    {
        let stage = || {
            let mut scene = room(1);
            scene["adaptiveshadows"] = json!(adaptive);
            // Point light, area light of 40 points, area light of 40 points or one.
            scene["scene"]["lightsources"][1]["samples"] = json!(40);
            let more = json!({ "type": "arealight", "v0": [3, 7, -2], "v1": [4, 7, -2],
                "v2": [3, 7, -1], "id": [2, 1, 1], "is": [1, 1, 2], "samples": few, "name": "one" });
            scene["scene"]["lightsources"].as_array_mut().unwrap().push(more);
            scene["scene"]["materials"]["floor"] = json!({ "kd": 0.6, "ks": 0.3, "specularexponent": 8, "ka": 0.4,
                        "diffusecolor": [0.3, 0.5, 0.1] });
            scene["scene"]["shapes"][0]["material"] = json!("floor");
            scene
        };
        let white = |shadow: bool, points: u32| {
            let mut scene = stage();
            scene["scene"]["lightsources"][2]["samples"] = json!(points);
            scene["scene"]["materials"]["floor"]["diffusecolor"] = json!([1, 1, 1]);
            for shape in 1..8 {
                scene = with(scene, shape, "visible", json!({ "camera": false, "shadow": shadow }));
            }
            Picture::new(&scene, backend)
        };
        let (shadowed, lit) = (white(true, few), white(false, few));
        // The own points of a light give the expectation of its light, unless they are too few.
        let (mean, tolerance) = match few {
            1 => (&white(false, 1024), 0.02),
            _ => (&lit, 0.0),
        };
        let caught = Picture::new(&with(stage(), 0, "shadow_catcher", json!(true)), backend);
        let plain = Picture::new(&stage(), backend);
        let (mut dark, mut partly, mut full) = (0, 0, 0);
        for pixel in caught.pixels() {
            // Adaptive shadows decide about the 16 pixels of a packet together.
            let block = |at: usize| [at % SIZE[0] / 4, at / SIZE[0] / 4];
            let mut packet = caught.pixels().filter(|&other| block(other) == block(pixel));
            if adaptive && packet.any(|other| caught.object(other) != 1) {
                continue;
            }
            if caught.object(pixel) != 1 {
                let beauty = |p: &Picture| p.film.pixels[pixel][3];
                assert_eq!(beauty(&caught), beauty(&plain));
                assert_eq!(caught.float("shadow_area.A", pixel), 0.0);
                continue;
            }
            let [r, g, b, alpha] = caught.film.pixels[pixel];
            assert_eq!([r, g, b], [0.0; 3]);
            let light = |picture: &Picture| luminance(&picture.film.pixels[pixel]);
            let expected = (light(&lit) - light(&shadowed)) / light(mean);
            let limit = 2e-6 + tolerance * expected;
            assert!((f64::from(alpha) - expected).abs() < limit, "{pixel}: {alpha} {expected}");
            // No rounding where nothing is in the way.
            assert!(shadowed.film.pixels[pixel] != lit.film.pixels[pixel] || alpha == 0.0);
            dark += u32::from(alpha > 0.8);
            partly += u32::from(alpha > 0.0 && alpha <= 0.8);
            full += u32::from(alpha == 0.0);
            let layers = ["point", "area", "one"].map(|name| format!("shadow_{name}"));
            let parts: f32 =
                layers.iter().map(|name| caught.float(&format!("{name}.A"), pixel)).sum();
            assert!((parts - alpha).abs() < 1e-6, "{pixel}: {parts} {alpha}");
            for name in layers {
                let visible = format!("{name}.Y");
                assert_eq!(caught.float(&visible, pixel), plain.float(&visible, pixel));
            }
            for channel in [
                "albedo.R",
                "diffuse.G",
                "specular.B",
                "ambient.R",
                "light_point.R",
                "light_area.G",
                "light_one.B",
                "light_ambient.G",
                "reflection.R",
            ] {
                assert_eq!(caught.float(channel, pixel), 0.0, "{channel}");
            }
            assert_eq!(caught.float("N.Y", pixel), 1.0);
        }
        assert!(partly > 20 && full > 200, "{dark} {partly} {full}");
    }
}

#[test]
fn a_catcher_without_light_has_no_alpha() {
    let mut scene = with(room(4), 0, "shadow_catcher", json!(true));
    // All lights are below the floor.
    scene["scene"]["lightsources"] = json!([
        { "type": "pointlight", "position": [0, -3, 0], "id": [1, 1, 1] },
        { "type": "arealight", "v0": [0, -5, 0], "v1": [1, -5, 0], "v2": [0, -5, 1],
          "id": [1, 1, 1], "samples": 5 }]);
    let picture = Picture::new(&scene, AcceleratorName::Bvh.into());
    let floor = |pixel: &usize| picture.float("N.Y", *pixel) == 1.0;
    let floor: Vec<usize> = picture.pixels().filter(floor).collect();
    assert!(floor.len() > 100);
    assert!(floor.iter().all(|&pixel| picture.film.pixels[pixel] == [0.0; 4]));
}

/// A foreground over a plate is the picture with the plate as the ground's texture, where light
/// and surface are white.
///
/// The camera looks straight down, so that each pixel of the ground is one texel. The ground
/// reflects the same share of light from all directions: `ks` 1 and exponent 0.
#[test]
fn a_foreground_over_a_plate_is_the_textured_picture() {
    let folder = tempfile::tempdir().unwrap();
    let [width, height] = SIZE;
    let path = folder.path().join("plate.ppm");
    let texel = |i: usize| [i * 37 % 256, i * 91 % 199 + 40, i * 53 % 251].map(|v| v as u8);
    let texels: Vec<[u8; 3]> = (0..width * height).map(texel).collect();
    let mut ppm = format!("P6\n{width} {height}\n255\n").into_bytes();
    ppm.extend(texels.as_flattened());
    std::fs::write(&path, ppm).unwrap();

    let stage = |textured: bool| {
        let mut ground = json!({ "kd": 0, "ks": 1, "specularexponent": 0 });
        if textured {
            ground["tPath"] = json!(path.to_str().unwrap());
            (ground["filter"], ground["wrap"]) = (json!("nearest"), json!("clamp"));
        }
        // At distance 2 with 90 degrees, the frame is 4 high.
        let (x, z) = (2.0 * width as f64 / height as f64, 2.0);
        json!({
            "spp": 64,
            "output": { "transparent": !textured },
            "camera": { "type": "pinhole", "width": width, "height": height, "fov": 90,
                "position": [0, 2, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] },
            "scene": {
                "attenuation": "none",
                "lightsources": [{ "type": "arealight", "v0": [-3, 6, -3], "v1": [-1, 6, -3],
                    "v2": [-3, 6, -1], "id": [1, 1, 1], "samples": 4 }],
                "shapes": [
                    { "type": "plane", "v0": [-x, 0, -z], "v1": [x, 0, -z], "v2": [x, 0, z],
                      "v3": [-x, 0, z], "material": ground, "shadow_catcher": !textured },
                    { "type": "sphere", "center": [0.2, 0.5, -0.1], "radius": 0.4,
                      "material": { "diffusecolor": [0.8, 0.5, 0.2] } },
                    { "type": "triangle", "v0": [-1, 0.6, 0.2], "v1": [-0.6, 0.6, 1],
                      "v2": [-0.2, 0.9, 0.8], "material": {} }]
            }
        })
    };
    let linear = |byte: u8| {
        let x = f64::from(byte) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    };
    let half = |x: f64| f64::from(half::f16::from_f64(x).to_f32());
    let foreground = Picture::new(&stage(false), AcceleratorName::Bvh.into());
    let textured = Picture::new(&stage(true), AcceleratorName::Bvh.into());
    let (mut worst, mut edges, mut penumbra) = (0f64, 0, 0);
    for pixel in foreground.pixels() {
        let [r, g, b, alpha] = foreground.film.pixels[pixel].map(f64::from);
        edges += u32::from(alpha > 0.0 && r > 0.0);
        penumbra += u32::from(alpha > 0.05 && alpha < 0.95);
        for (axis, value) in [r, g, b].into_iter().enumerate() {
            // The over operator on the values that the EXR holds.
            let over = half(value) + (1.0 - half(alpha)) * linear(texels[pixel][axis]);
            let expected = f64::from(textured.film.pixels[pixel][axis]);
            worst = worse(worst, (over - expected).abs());
        }
    }
    // Two values of at most 1 were rounded to half, each by at most 2^-12.
    assert!(worst <= 2.0 / 4096.0 + 1e-5, "{worst}");
    assert!(edges > 30 && penumbra > 100, "{edges} {penumbra}");
}
