//! Makes a scene of bytes and renders it in several ways. All must give the same bits: the tree and
//! the backend `brute`, the best and the portable instruction set, the whole frame and a crop.
//! Between the tree and `brute`, a pixel may differ if a ray of it passes an outline, or hits two
//! surfaces at the same depth, within the error bound of the tree's test.

use std::path::Path;

use lightpath::accel::{self, Accelerator, BuildOptions};
use lightpath::film::{Film, ReservedFilm, Window};
use lightpath::layers::LayerPlan;
use lightpath::monitor::Monitor;
use lightpath::render::{Adaptive, RayCounts, RenderContext, render_adaptive, render_layers};
use lightpath::scene::{Backend, Source, load};
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use serde_json::{Map, Value, json};

use super::inputs;
use super::witness::Witness;

/// Meshes that scenes use: a solid, one with edges that match no other, needles, coplanar faces
/// twice, and faces with normals that disagree.
const MESHES: [(&str, &str); 4] = [
    (
        "solid.ply",
        "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
         property float s\nproperty float t\nproperty float quality\nelement face 6\n\
         property list uchar int vertex_indices\nend_header\n\
         -1 0 -1 255 0 0 0 0 1\n1 0 -1 0 255 0 1 0 2\n1 0 1 0 0 255 1 1 nan\n\
         -1 0 1 9 99 200 0 1 4\n0 1 0 255 255 255 0.5 0.5 5\n\
         3 0 1 2\n3 0 2 3\n3 0 4 1\n3 1 4 2\n3 2 4 3\n3 3 4 0\n",
    ),
    (
        "joints.ply",
        "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\n\
         property float z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n\
         0 0 0\n2 0 0\n0.7 0 0\n0 1.3 0.1\n1.9 1.1 0.3\n0.6 -1 0.2\n1.5 -1.2 0.4\n\
         3 0 1 3\n3 1 4 3\n3 0 2 1\n3 0 5 2\n3 2 5 6\n3 2 6 1\n",
    ),
    (
        "needles.ply",
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty double x\nproperty double y\n\
         property double z\nproperty double nx\nproperty double ny\nproperty double nz\n\
         element face 4\nproperty list uchar int vertex_indices\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n\
         -1 0 0 0 0 1\n1 0 0 0 1 0\n1 1e-7 0 0 0 -1\n-1 1 1e-6 0 0 0\n0 -1 0.5 1 0 0\n\
         1e-9 1 -1 0 1 1\n3 0 1 2 255 0 0\n3 0 2 3 0 255 0\n3 0 1 4 0 0 255\n3 3 4 5 9 9 9\n",
    ),
    (
        "twice.ply",
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n\
         property float z\nelement face 5\nproperty list uchar int vertex_indices\nend_header\n\
         -1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n\
         4 0 1 2 3\n4 4 5 6 7\n3 0 1 3\n3 6 5 4\n3 0 5 2\n",
    ),
];

/// An image with dark, bright and saturated texels.
const IMAGE: &str = "P3 4 2 255 0 0 0 255 255 255 255 0 0 0 255 0 9 9 9 0 0 255 128 64 32 1 2 3\n";

/// Writes the files that scenes name.
pub fn prepare(folder: &Path) {
    for (name, text) in MESHES.into_iter().chain([("image.ppm", IMAGE)]) {
        inputs::write(&folder.join(name), text.as_bytes());
    }
}

/// What the picture of an input shows.
#[derive(Debug, Default)]
pub struct Shown {
    /// Number of shadow rays: those of surfaces that a light may reach.
    pub shadow_rays: u64,
    /// True if any pixel is brighter than black.
    pub light: bool,
}

/// Runs one input in a prepared folder. Returns `None` for bytes that make no valid scene.
pub fn run(folder: &Path, bytes: &[u8]) -> Option<Shown> {
    let mut bytes = Bytes(bytes.iter());
    let written = scene(&mut bytes);
    let text = serde_json::to_vec_pretty(&written).expect("JSON");
    let loaded = match load(Source::Text { name: "f.json", text: &text, folder }, &[]) {
        Ok(loaded) => loaded,
        Err(error) => {
            inputs::check_error(&error);
            return None;
        }
    };
    let scene = loaded.scene;
    let world = match World::load(&scene, LoadOptions::default(), &Monitor::default()) {
        Ok((world, _)) => world,
        Err(error) => {
            inputs::check_error(&error);
            return None;
        }
    };
    let plan = LayerPlan::new(&scene);
    let adaptive = (world.spp > 16 && bytes.flag()).then(|| Adaptive {
        first: 16,
        most: world.spp,
        noise: Some(0.05),
        relative: Default::default(),
        time: None,
    });
    let [width, height] = world.frame;
    let whole = Window::full(width, height);
    let [x0, y0] = [bytes.below(width), bytes.below(height)];
    let [x1, y1] = [x0 + 1 + bytes.below(width - x0), y0 + 1 + bytes.below(height - y0)];
    let crop = Window { x0, y0, x1, y1 };

    let best = Isa::detect();
    let picture = |backend: Backend, isa: Isa, window: Window| {
        let accelerator = build(&world, backend);
        render(&world, &plan, adaptive, accelerator.as_ref(), isa, window)
    };
    let (first, rays) = picture(Backend::Bvh(best), best, whole);
    check(&first, &text);
    // Renders the pixel again on the tree, beside the oracle.
    let explained = |x: u32, y: u32| {
        let tree = build(&world, Backend::Bvh(best));
        let witness = Witness::new(&world.geometry, tree.as_ref());
        let pixel = Window { x0: x, y0: y, x1: x + 1, y1: y + 1 };
        render(&world, &plan, adaptive, &witness, best, pixel);
        let verdicts = witness.verdicts();
        !verdicts.is_empty() && verdicts.iter().all(|verdict| !verdict.is_wrong())
    };
    for (backend, isa, window) in [
        (Backend::Bvh(Isa::Portable), Isa::Portable, whole),
        (Backend::Brute, best, whole),
        (Backend::Bvh(best), best, crop),
    ] {
        let (other, _) = picture(backend, isa, window);
        let allowed = |x, y| backend == Backend::Brute && explained(x, y);
        same_where_both_are(&first, &other, allowed, &format!("{backend:?} {window:?}"), &text);
    }
    let light = first.pixels.iter().any(|pixel| pixel[..3].iter().any(|&value| value > 0.0));
    Some(Shown { shadow_rays: rays.shadow, light })
}

fn build(world: &World, backend: Backend) -> Box<dyn Accelerator + '_> {
    let options = BuildOptions { threads: 1, max_bytes: None };
    accel::build(&world.geometry, backend, &options, &Monitor::default()).expect("a tree")
}

fn render(
    world: &World,
    plan: &LayerPlan,
    adaptive: Option<Adaptive>,
    accelerator: &dyn Accelerator,
    isa: Isa,
    window: Window,
) -> (Film, RayCounts) {
    let monitor = &Monitor::default();
    let channels = plan.layout.channels.clone();
    let mut film = ReservedFilm::new(world.frame, window, channels).expect("memory").film();
    let context = RenderContext { world, accelerator, isa, monitor };
    let rays = match adaptive {
        Some(adaptive) => render_adaptive(context, &mut film, plan, adaptive).map(|(rays, _)| rays),
        None => render_layers(context, &mut film, plan, None),
    };
    (film, rays.expect("a picture"))
}

/// The values of a scene are moderate, so those of its picture are finite. The terms of the light
/// add up to it.
fn check(film: &Film, text: &[u8]) {
    let text = || String::from_utf8_lossy(text);
    let channels =
        |layer: &str| ["R", "G", "B"].map(|color| film.planes.index(&format!("{layer}.{color}")));
    let parts = ["diffuse", "specular", "ambient", "reflection", "background"].map(channels);
    for (i, pixel) in film.pixels.iter().enumerate() {
        assert!(pixel.iter().all(|value| value.is_finite()), "pixel {i} is {pixel:?}\n{}", text());
        for (color, &value) in pixel[..3].iter().enumerate() {
            let terms = parts.map(|part| Some(f64::from(film.planes.float(part[color]?, i))));
            let [Some(a), Some(b), Some(c), Some(d), Some(e)] = terms else { continue };
            let terms = [a, b, c, d, e];
            let (sum, size) = (terms.iter().sum::<f64>(), terms.map(f64::abs).iter().sum::<f64>());
            let difference = (sum - f64::from(value)).abs();
            assert!(difference <= 1e-5 * size, "pixel {i}: {value}, terms {terms:?}\n{}", text());
        }
    }
    for (k, channel) in film.planes.channels.iter().enumerate() {
        for i in 0..film.pixels.len() {
            let nan =
                channel.kind != lightpath::ChannelKind::Uint && film.planes.float(k, i).is_nan();
            // The parts of a matte are hashes.
            let hash = channel.name.starts_with("Crypto");
            assert!(hash || !nan, "pixel {i}, {}\n{}", channel.name, text());
        }
    }
}

/// Checks that the pixels of a window have the bits of the whole frame, but for those that are
/// `allowed` to differ.
fn same_where_both_are(
    whole: &Film,
    other: &Film,
    allowed: impl Fn(u32, u32) -> bool,
    what: &str,
    text: &[u8],
) {
    let Window { x0, y0, .. } = other.window;
    let words = whole.planes.channels.len();
    for (j, pixel) in other.pixels.iter().enumerate() {
        let [x, y] = [j as u32 % other.window.width(), j as u32 / other.window.width()];
        let i = ((y0 + y) * whole.window.width() + x0 + x) as usize;
        let bits = |pixel: &[f32; 4]| pixel.map(f32::to_bits);
        let words = |film: &Film, i: usize| film.planes.words[i * words..(i + 1) * words].to_vec();
        let same = bits(&whole.pixels[i]) == bits(pixel) && words(whole, i) == words(other, j);
        assert!(
            same || allowed(x0 + x, y0 + y),
            "{what}: pixel {x}, {y} is {pixel:?} {:?}, expected {:?} {:?}\n{}",
            words(other, j),
            whole.pixels[i],
            words(whole, i),
            String::from_utf8_lossy(text)
        );
    }
}

/// The bytes of an input, followed by zeros.
struct Bytes<'b>(std::slice::Iter<'b, u8>);

impl Bytes<'_> {
    fn next(&mut self) -> u8 {
        self.0.next().copied().unwrap_or(0)
    }

    fn below(&mut self, end: u32) -> u32 {
        u32::from(self.next()) % end
    }

    fn flag(&mut self) -> bool {
        self.next() & 1 == 1
    }

    fn one_of<T: Copy>(&mut self, values: &[T]) -> T {
        values[self.below(values.len() as u32) as usize]
    }

    /// A number from -4 to 4. Half of them are multiples of 1/32, so that places coincide; the
    /// others are a little beside one.
    fn coordinate(&mut self) -> f64 {
        let coarse = f64::from(self.next() as i8) / 32.0;
        let fine = self.next();
        if fine < 128 { coarse } else { coarse + 2f64.powi(-i32::from(fine % 32)) / 32.0 }
    }

    fn point(&mut self) -> [f64; 3] {
        [self.coordinate(), self.coordinate(), self.coordinate()]
    }

    /// A number from 0 to 1.
    fn share(&mut self) -> f64 {
        f64::from(self.next()) / 255.0
    }

    fn color(&mut self) -> [f64; 3] {
        [self.share(), self.share(), self.share()]
    }

    /// Light; some of it is negative.
    fn light(&mut self) -> [f64; 3] {
        let factor = self.one_of(&[1.0, 4.0, 30.0, -0.5]);
        self.color().map(|value| factor * value)
    }

    /// Sets a key of an object in half of the cases.
    fn perhaps(&mut self, object: &mut Value, key: &str, value: impl FnOnce(&mut Self) -> Value) {
        if self.flag() {
            let value = value(self);
            object[key] = value;
        }
    }
}

fn scene(bytes: &mut Bytes) -> Value {
    let spp = bytes.one_of(&[1, 1, 2, 3, 4, 16, 64]);
    let mut scene = json!({ "spp": spp, "camera": camera(bytes) });
    bytes.perhaps(&mut scene, "nbounces", |b| b.below(4).into());
    bytes.perhaps(&mut scene, "seed", |b| b.next().into());
    bytes.perhaps(&mut scene, "sampler", |b| b.one_of(&["sobol", "random"]).into());
    bytes.perhaps(&mut scene, "adaptiveshadows", |b| b.flag().into());
    bytes.perhaps(&mut scene, "emittersamples", |b| (1 + b.below(3)).into());
    let mut output = json!({});
    let layers = [
        "all",
        "ao",
        "Z",
        "N",
        "P",
        "uv",
        "albedo",
        "components",
        "light",
        "shadow",
        "cryptomatte",
        "variance",
        "primid",
        "objectid",
        "samples",
        "Ncam",
        "facing",
    ];
    let chosen = (0..bytes.below(5)).map(|_| bytes.one_of(&layers));
    let mut chosen: Vec<&str> = chosen.collect();
    chosen.sort_unstable();
    chosen.dedup();
    output["layers"] = json!(chosen);
    bytes.perhaps(&mut output, "transparent", |b| b.flag().into());
    if chosen.contains(&"ao") {
        output["aosamples"] = (1 + bytes.below(4)).into();
        bytes.perhaps(&mut output, "aodistance", |b| (0.01 + 3.0 * b.share()).into());
    }
    scene["output"] = output;
    let mut contents = json!({});
    bytes.perhaps(&mut contents, "backgroundcolor", |b| json!(b.color()));
    bytes.perhaps(&mut contents, "ambient", |b| json!(b.color()));
    bytes.perhaps(&mut contents, "attenuation", |b| {
        b.one_of(&["none", "linear", "quadratic"]).into()
    });
    contents["lightsources"] = (0..bytes.below(4)).map(|_| light(bytes)).collect();
    contents["shapes"] = (0..1 + bytes.below(5)).map(|_| shape(bytes)).collect();
    scene["scene"] = contents;
    scene
}

fn camera(bytes: &mut Bytes) -> Value {
    let kind =
        bytes.one_of(&["pinhole", "pinhole", "thinlens", "orthographic", "panorama", "intrinsics"]);
    let mut camera =
        json!({ "type": kind, "width": 1 + bytes.below(20), "height": 1 + bytes.below(18) });
    if kind == "intrinsics" {
        camera["fx"] = (4.0 + 20.0 * bytes.share()).into();
        let [x, y, z] = [bytes.coordinate(), bytes.coordinate(), 3.0 + bytes.share()];
        camera["world_to_camera"] =
            json!([[1, 0, 0, x / 4.0], [0, -1, 0, y / 4.0], [0, 0, -1, z], [0, 0, 0, 1]]);
        bytes.perhaps(&mut camera, "distortion", |b| match b.flag() {
            true => json!({ "type": "fisheye", "k1": 0.1 * b.share() }),
            false => {
                json!({ "type": "brownconrady", "k1": 0.1 * b.share(), "p1": 0.01 * b.share() })
            }
        });
        return camera;
    }
    camera["position"] = json!(bytes.point());
    let mut target = bytes.point().map(|x| x / 4.0);
    if bytes.flag() {
        target = [0.0; 3];
    }
    camera["target"] = json!(target);
    camera["up"] = json!(bytes.one_of(&[[0, 1, 0], [0, 0, 1], [1, 2, 3]]));
    match kind {
        "orthographic" => camera["viewwidth"] = (0.5 + 6.0 * bytes.share()).into(),
        "panorama" => {}
        _ => camera["fov"] = (1.0 + 120.0 * bytes.share()).into(),
    }
    if kind == "thinlens" {
        camera["aperture"] = bytes.share().into();
        camera["focaldistance"] = (0.1 + 5.0 * bytes.share()).into();
    }
    camera
}

fn light(bytes: &mut Bytes) -> Value {
    let kind = bytes.one_of(&["pointlight", "arealight", "sun", "directional", "environment"]);
    let mut light = json!({ "type": kind });
    bytes.perhaps(&mut light, "group", |b| b.one_of(&["a", "b"]).into());
    bytes.perhaps(&mut light, "is", |b| json!(b.light()));
    let samples = 1 + bytes.below(5);
    match kind {
        "pointlight" => light["position"] = json!(bytes.point()),
        "arealight" => {
            for corner in ["v0", "v1", "v2"] {
                light[corner] = json!(bytes.point());
            }
            bytes.perhaps(&mut light, "emission", |b| b.one_of(&["uniform", "lambertian"]).into());
        }
        "environment" => {
            if bytes.flag() {
                light["image"] = "image.ppm".into();
                bytes.perhaps(&mut light, "rotation", |b| (90.0 * b.coordinate()).into());
            }
            bytes.perhaps(&mut light, "visible", |b| b.flag().into());
        }
        _ => light["direction"] = json!(bytes.point()),
    }
    if kind == "sun" {
        light["angle"] = (90.0 * bytes.share()).into();
    }
    light[if kind == "environment" { "radiance" } else { "id" }] = json!(bytes.light());
    if !matches!(kind, "pointlight" | "directional") {
        light["samples"] = samples.into();
    }
    light
}

fn shape(bytes: &mut Bytes) -> Value {
    let kind = bytes.one_of(&["sphere", "plane", "triangle", "trimesh", "trimesh"]);
    let mut shape = json!({ "type": kind, "material": material(bytes) });
    match kind {
        "sphere" => {
            shape["center"] = json!(bytes.point());
            shape["radius"] = (0.01 + 2.0 * bytes.share()).into();
            bytes.perhaps(&mut shape, "pole", |b| b.one_of(&["x", "y", "z"]).into());
        }
        "plane" => {
            let (corner, a, b) = (bytes.point(), bytes.point(), bytes.point());
            let at = |s: f64, t: f64| -> [f64; 3] {
                std::array::from_fn(|i| corner[i] + s * a[i] + t * b[i])
            };
            for (name, s, t) in
                [("v0", 0.0, 0.0), ("v1", 1.0, 0.0), ("v2", 1.0, 1.0), ("v3", 0.0, 1.0)]
            {
                shape[name] = json!(at(s, t));
            }
        }
        "triangle" => {
            for name in ["v0", "v1", "v2"] {
                shape[name] = json!(bytes.point());
            }
        }
        _ => mesh(bytes, &mut shape),
    }
    match bytes.below(12) {
        0 => shape["holdout"] = true.into(),
        1 | 2 => shape["shadow_catcher"] = true.into(),
        3 | 4 => {
            let seen =
                ["camera", "shadow", "reflection"].map(|ray| (ray.into(), bytes.flag().into()));
            shape["visible"] = Value::Object(Map::from_iter(seen));
        }
        _ => {}
    }
    shape
}

fn mesh(bytes: &mut Bytes, shape: &mut Value) {
    shape["path"] = bytes.one_of(&MESHES).0.into();
    shape["center"] = json!(bytes.point().map(|x| x / 2.0));
    bytes.perhaps(shape, "size", |b| (0.1 + 3.0 * b.share()).into());
    bytes.perhaps(shape, "rotate", |b| json!(b.point().map(|x| 90.0 * x)));
    bytes.perhaps(shape, "fit", |b| (0.1 + 3.0 * b.share()).into());
    bytes.perhaps(shape, "smooth", |b| match b.below(3) {
        0 => true.into(),
        1 => json!({ "angle": 1.0 + 179.0 * b.share() }),
        _ => json!({ "angle": 60.0, "flat": 30.0 }),
    });
    if shape["path"] == "solid.ply" {
        bytes.perhaps(shape, "color", |b| match b.flag() {
            true => b.one_of(&["vertex", "none"]).into(),
            false => json!({ "property": "quality", "map": b.one_of(&["turbo", "greys"]) }),
        });
    }
    bytes.perhaps(shape, "instances", |b| {
        let copies = (0..1 + b.below(4)).map(|_| {
            let at = b.point();
            let mut matrix = [
                [1.0, 0.0, 0.0, at[0]],
                [0.0, 1.0, 0.0, at[1]],
                [0.0, 0.0, 1.0, at[2]],
                [0.0, 0.0, 0.0, 1.0],
            ];
            for row in 0..3 {
                if b.flag() {
                    matrix[row][b.below(3) as usize] += b.coordinate() / 4.0;
                }
            }
            json!(matrix)
        });
        copies.collect()
    });
}

fn material(bytes: &mut Bytes) -> Value {
    let mut material = json!({ "diffusecolor": bytes.color() });
    for key in ["kd", "ks", "ka", "kr"] {
        bytes.perhaps(&mut material, key, |b| b.share().into());
    }
    bytes.perhaps(&mut material, "specularexponent", |b| b.one_of(&[0.0, 1.0, 7.5, 300.0]).into());
    if bytes.below(3) == 0 {
        material["tPath"] = "image.ppm".into();
        bytes.perhaps(&mut material, "filter", |b| {
            b.one_of(&["bilinear", "nearest", "trilinear"]).into()
        });
        bytes.perhaps(&mut material, "wrap", |b| b.one_of(&["repeat", "clamp"]).into());
        bytes.perhaps(&mut material, "tScale", |b| json!([b.coordinate(), b.coordinate()]));
    }
    material
}
