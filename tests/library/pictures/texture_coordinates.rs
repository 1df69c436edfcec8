//! The texel that a camera ray sees, on every kind of shape, compared with f64 arithmetic on the
//! ray and the formulas of docs/guide/scene-format.md.

use std::fmt::Write as _;
use std::path::Path;

use crate::support::backends::{self, on_both};
use glam::{DVec2, DVec3};
use image::{Rgb, RgbImage};
use lightpath::film::{Film, ReservedFilm, Window};
use lightpath::layers::LayerPlan;
use lightpath::monitor::Monitor;
use lightpath::render::{RenderContext, render_layers};
use lightpath::scene::{self, Backend, Source};
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use serde_json::{Value, json};

/// Texels along each side of the image.
const TEXELS: u32 = 8;

/// Rays whose point is nearer than this to a texel's edge, in texels, are not counted.
const EDGE: f64 = 1e-5;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;

/// A camera ray in world space.
struct Ray {
    origin: DVec3,
    direction: DVec3,
}

/// (u, v) of the shape where the ray hits it, with v down, before `tScale`; `None` for a miss.
type HitValidator = dyn Fn(&Ray) -> Option<DVec2>;

/// A scene with the shape, lit only by ambient light.
fn scene(shape: Value, scale: DVec2, camera: &Value) -> Value {
    let mut shape = shape;
    shape["material"] = json!({
        "ka": 1, "kd": 0, "tPath": "texels.png", "tScale": scale.to_array(),
        "filter": "nearest", "wrap": "repeat", "colorspace": "linear"
    });
    json!({
        "nbounces": 0, "camera": camera, "output": { "layers": ["uv"] },
        "scene": { "ambient": [1, 1, 1], "backgroundcolor": [2, 2, 2], "shapes": [shape] }
    })
}

fn camera(position: [f64; 3], lookat: [f64; 3], fov: f64) -> Value {
    json!({ "type": "pinhole", "width": WIDTH, "height": HEIGHT, "fov": fov,
            "position": position, "lookat": lookat, "up": [0.03, 1, 0.01] })
}

fn render(world: &World, plan: &LayerPlan, backend: Backend) -> Film {
    let (monitor, isa) = (Monitor::default(), Isa::detect());
    let accelerator = backends::build(&world.geometry, backend);
    let window = Window::full(WIDTH, HEIGHT);
    let blank = ReservedFilm::new(world.frame, window, plan.layout.channels.clone());
    let mut film = blank.unwrap().film();
    let context = RenderContext { world, accelerator: &*accelerator, isa, monitor: &monitor };
    render_layers(context, &mut film, plan, None).unwrap();
    film
}

/// Renders the scene and compares texels and the layer `uv` with the truth; then compares the layer
/// alone for the same shape without a texture.
fn judge(backend: Backend, folder: &Path, scene: &Value, scale: DVec2, truth: &HitValidator) {
    let texels = RgbImage::from_fn(TEXELS, TEXELS, |i, j| Rgb([20 * i as u8, 20 * j as u8, 0]));
    texels.save(folder.join("texels.png")).unwrap();
    let mut plain = scene.clone();
    plain["scene"]["shapes"][0]["material"] = json!({});
    for (scene, textured) in [(scene, true), (&plain, false)] {
        let text = scene.to_string();
        let source = Source::Text { name: "test", text: text.as_bytes(), folder };
        let scene = scene::load(source, &[]).unwrap().scene;
        let (world, _) = World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap();
        let film = render(&world, &LayerPlan::new(&scene), backend);
        compare(&world, &film, textured.then_some(scale), truth, &format!("textured: {textured}"));
    }
}

fn compare(world: &World, film: &Film, scale: Option<DVec2>, truth: &HitValidator, case: &str) {
    let [u, v, a] = ["uv.U", "uv.V", "uv.A"].map(|name| film.planes.index(name).unwrap());
    let (mut hits, mut compared, mut missed) = (0, 0, 0);
    let (mut wrong, mut off) = (Vec::new(), Vec::new());
    for pixel in 0..(WIDTH * HEIGHT) as usize {
        let (x, y) = (pixel as u32 % WIDTH, pixel as u32 / WIDTH);
        let (origin, direction) = world.camera.pinhole_ray(x as f32 + 0.5, y as f32 + 0.5);
        let origin = origin.as_dvec3() + world.geometry.origin;
        let at = truth(&Ray { origin, direction: direction.as_dvec3() });
        let stored = [u, v, a].map(|channel| film.planes.float(channel, pixel));
        let Some(at) = at else {
            missed += usize::from(stored == [0.0; 3]);
            continue;
        };
        let near = |value: f32, exact: f64| {
            (f64::from(value) - exact).abs() <= f64::from(f32::EPSILON) * exact.abs() + 1e-13
        };
        // The layer's v points up.
        if !(near(stored[0], at.x) && near(stored[1], 1.0 - at.y) && stored[2] == 1.0) {
            off.push((x, y, stored, at));
        }
        hits += 1;
        let Some(scale) = scale else { continue };
        let texel = at * scale * f64::from(TEXELS);
        let edge = (texel - texel.round()).abs().min_element();
        if edge < EDGE {
            continue;
        }
        compared += 1;
        let expected = texel.floor().rem_euclid(DVec2::splat(TEXELS.into())).to_array();
        let [red, green, ..] = film.pixels[pixel];
        let found = [red, green].map(|value| (f64::from(value) * 255.0 / 20.0).round());
        if found != expected {
            wrong.push((x, y, found, expected));
        }
    }
    assert!(hits > WIDTH * HEIGHT / 2, "{case}: {hits} rays hit");
    let misses = (WIDTH * HEIGHT) as usize - hits as usize;
    assert_eq!(missed, misses, "{case}: rays that miss have no coordinates");
    assert!(
        scale.is_none() || compared > hits - hits / 100,
        "{case}: {compared} of {hits} compared"
    );
    assert!(wrong.is_empty(), "{case}: {} of {compared}, as {:?}", wrong.len(), wrong[0]);
    assert!(off.is_empty(), "{case}: {} uv are off, as {:?}", off.len(), off[0]);
}

/// Returns the hit point on a triangle and its barycentric weights.
fn triangle(ray: &Ray, [a, b, c]: [DVec3; 3]) -> Option<(DVec3, [f64; 3])> {
    let normal = (b - a).cross(c - a);
    let t = (a - ray.origin).dot(normal) / ray.direction.dot(normal);
    let point = ray.origin + t * ray.direction;
    let weight = |p: DVec3, q: DVec3| (q - p).cross(point - p).dot(normal) / normal.dot(normal);
    let weights = [weight(b, c), weight(c, a), weight(a, b)];
    (t > 0.0 && weights.iter().all(|&w| w >= 0.0)).then_some((point, weights))
}

/// Checks tiles of 2 m on a plane of side `side` metres, seen near its far corner.
fn far_tiles(backend: Backend, side: f64) {
    let folder = tempfile::tempdir().unwrap();
    let [v0, v1, v2, v3] =
        [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[x, z]| DVec3::new(x, 0.0, z));
    let shape = json!({ "type": "plane", "v0": v0.to_array(), "v1": v1.to_array(),
                        "v2": v2.to_array(), "v3": v3.to_array() });
    // 90 % of the way from v3, the origin of (u, v), at a coordinate that single precision holds.
    let near = (0.9 * side).floor() + 0.25;
    let camera = camera([near, 1.75, side - near], [0.3, -1.0, 0.9], 50.0);
    let scale = DVec2::splat(side / 2.0);
    let truth = move |ray: &Ray| {
        let t = -ray.origin.y / ray.direction.y;
        let p = ray.origin + t * ray.direction - v3;
        let (a, b) = (v2 - v3, v0 - v3);
        (t > 0.0).then(|| DVec2::new(p.dot(a) / a.dot(a), 1.0 - p.dot(b) / b.dot(b)))
    };
    judge(backend, folder.path(), &scene(shape, scale, &camera), scale, &truth);
}

on_both! {
    fn tiles_of_2_m_on_a_plane_of_10_km(backend: Backend) {
        far_tiles(backend, 8192.0);
    }
}

on_both! {
    fn tiles_of_2_m_on_a_plane_of_100_km(backend: Backend) {
        far_tiles(backend, 131_072.0);
    }
}

on_both! {
    fn tiles_on_a_large_triangle(backend: Backend) {
        let folder = tempfile::tempdir().unwrap();
        let corners = [DVec3::ZERO, DVec3::X * 65536.0, DVec3::new(-8192.0, 0.0, 65536.0)];
        let [v0, v1, v2] = corners.map(|v| v.to_array());
        let shape = json!({ "type": "triangle", "v0": v0, "v1": v1, "v2": v2 });
        let camera = camera([20000.25, 1.75, 30000.5], [0.3, -1.0, -0.9], 50.0);
        let scale = DVec2::splat(32768.0);
        let truth = move |ray: &Ray| {
            let (p, _) = triangle(ray, corners)?;
            // The base runs along x from -8192 to 65536, the height along z.
            Some(DVec2::new(1.0 - (p.x + 8192.0) / 73728.0, p.z / 65536.0))
        };
        judge(backend, folder.path(), &scene(shape, scale, &camera), scale, &truth);
    }
}

/// Checks the pole seen from `height` above it, where a circle of latitude is as short as a texel.
fn pole(backend: Backend, height: f64, scale: DVec2, pole: &str, up: DVec3) {
    let folder = tempfile::tempdir().unwrap();
    let shape = json!({ "type": "sphere", "center": [0.5, -0.25, 2.0], "radius": 1, "pole": pole });
    let center = DVec3::new(0.5, -0.25, 2.0);
    let eye = center + up * (1.0 + height);
    let mut camera = camera(eye.to_array(), (-up).to_array(), 60.0);
    camera["up"] = json!([0.3, 0.5, 0.7]);
    let turned = move |p: DVec3| if up == DVec3::X { DVec3::new(p.y, p.z, p.x) } else { p };
    let truth = move |ray: &Ray| {
        let f = ray.origin - center;
        let (b, a) = (f.dot(ray.direction), ray.direction.length_squared());
        // f.f - 1 without cancellation: the eye is on the axis.
        let c = height * (2.0 + height);
        let root = b * b - a * c;
        let t = c / (-b + root.sqrt());
        let p = turned(f + t * ray.direction);
        let u = 0.5 + p.x.atan2(-p.y) / std::f64::consts::TAU;
        let v = 0.5 - p.z.atan2(p.x.hypot(p.y)) / std::f64::consts::PI;
        (root > 0.0).then_some(DVec2::new(u, v))
    };
    judge(backend, folder.path(), &scene(shape, scale, &camera), scale, &truth);
}

on_both! {
    fn the_pole_of_a_sphere_seen_from_close_by(backend: Backend) {
        // 1.2e-4, which single precision holds above 1.
        let height = 1.0 / 8192.0;
        pole(backend, height, DVec2::new(8.0, 1.0), "z", DVec3::Z);
        pole(backend, height, DVec2::new(8.0, 65536.0), "z", DVec3::Z);
        pole(backend, height, DVec2::new(8.0, 65536.0), "x", DVec3::X);
    }
}

on_both! {
    fn a_mesh_with_coordinates_up_to_5000(backend: Backend) {
        let folder = tempfile::tempdir().unwrap();
        let mut ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                       property float z\nproperty float s\nproperty float t\nelement face 2\n\
                       property list uchar int vertex_indices\nend_header\n"
            .to_owned();
        let corners = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        // Odd values of single precision: flipping must not round them.
        let odd = |x: f64| f64::from((x * 1.234_567) as f32);
        let uv = corners.map(|[x, z]| DVec2::new(odd(1012.3 * x + 0.1), odd(-1007.7 * z - 0.3)));
        for ([x, z], uv) in corners.iter().zip(uv) {
            writeln!(ply, "{x} 0 {z} {:?} {:?}", uv.x, uv.y).unwrap();
        }
        let faces = [[0, 1, 2], [0, 2, 3]];
        for [a, b, c] in faces {
            writeln!(ply, "3 {a} {b} {c}").unwrap();
        }
        std::fs::write(folder.path().join("mesh.ply"), ply).unwrap();
        let shape = json!({ "type": "trimesh", "path": "mesh.ply" });
        let camera = camera([3.25, 0.002, 3.125], [0.3, -1.0, -0.9], 50.0);
        let truth = move |ray: &Ray| {
            faces.iter().find_map(|face| {
                let at = face.map(|k| DVec3::new(corners[k][0], 0.0, corners[k][1]));
                let (_, w) = triangle(ray, at)?;
                let sum = w[0] * uv[face[0]] + w[1] * uv[face[1]] + w[2] * uv[face[2]];
                Some(DVec2::new(sum.x, 1.0 - sum.y))
            })
        };
        judge(backend, folder.path(), &scene(shape, DVec2::ONE, &camera), DVec2::ONE, &truth);
    }
}
