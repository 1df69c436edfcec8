//! Calibrated, orthographic and panoramic cameras, compared with the projections of OpenCV's
//! documentation. These run forward, from points to pixels, and share no code with the cameras.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use lightpath::{
    accel::{self, BuildOptions},
    camera::{self, Camera},
    film::{Film, ReservedFilm, Window},
    layers::LayerPlan,
    monitor::Monitor,
    render::{RenderContext, render_layers},
    scene::{self, Backend, Scene, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

use crate::support::backends::on_both;

const SIZE: [usize; 2] = [96, 72];

/// Position of a camera and its axes as rows: x right, y down, z forward.
struct Pose {
    rotation: DMat3,
    position: DVec3,
}

impl Pose {
    fn new(axis: DVec3, angle: f64, position: DVec3) -> Self {
        Self {
            rotation: DMat3::from_quat(DQuat::from_axis_angle(axis.normalize(), angle)),
            position,
        }
    }

    /// Camera coordinates of a point in the world.
    fn seen(&self, p: DVec3) -> DVec3 {
        self.rotation * (p - self.position)
    }

    /// Keys of a camera whose pose is a matrix: all four ways to write it.
    fn matrix(&self, way: usize) -> Value {
        let flip = if way % 2 == 1 { -1.0 } else { 1.0 };
        // OpenGL turns the camera's y and z.
        let rows = [DVec3::X, DVec3::Y * flip, DVec3::Z * flip]
            .map(|axis| self.rotation.transpose() * axis);
        let axes = if way % 2 == 1 { "opengl" } else { "opencv" };
        let last = [0.0, 0.0, 0.0, 1.0];
        if way < 2 {
            let row = |r: DVec3| [r.x, r.y, r.z, -r.dot(self.position)];
            let [a, b, c] = rows.map(row);
            return json!({ "axes": axes, "world_to_camera": [a, b, c, last] });
        }
        let row = |k: usize| [rows[0][k], rows[1][k], rows[2][k], self.position[k]];
        json!({ "axes": axes, "camera_to_world": [row(0), row(1), row(2), last] })
    }

    /// Keys of a camera with directions.
    fn directions(&self) -> Value {
        let [_, y, z] = [0, 1, 2].map(|k| self.rotation.row(k));
        json!({ "position": self.position.to_array(), "lookat": (z * 3.0).to_array(),
                "up": (-y * 0.5).to_array() })
    }
}

/// A camera: its keys without the pose, and its projection of camera coordinates to OpenCV's
/// pixels.
struct Lens {
    name: &'static str,
    keys: Value,
    project: fn(DVec3) -> [f64; 2],
}

const FX: f64 = 71.0;
const FY: f64 = 64.0;
const CX: f64 = 44.25;
const CY: f64 = 37.5;

/// `cv2.projectPoints` with k1, k2, p1, p2, k3, k4, k5, k6.
fn project_points(p: DVec3, d: [f64; 8]) -> [f64; 2] {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = d;
    let (x, y) = (p.x / p.z, p.y / p.z);
    let r2 = x * x + y * y;
    let radial = (1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3))
        / (1.0 + k4 * r2 + k5 * r2.powi(2) + k6 * r2.powi(3));
    let xd = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let yd = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    [FX * xd + CX, FY * yd + CY]
}

/// `cv2.fisheye.projectPoints`, with the angle of directions behind the camera, too.
fn project_fisheye(p: DVec3, [k1, k2, k3, k4]: [f64; 4]) -> [f64; 2] {
    let r = p.x.hypot(p.y);
    let theta = r.atan2(p.z);
    let t2 = theta * theta;
    let distorted = theta * (1.0 + k1 * t2 + k2 * t2.powi(2) + k3 * t2.powi(3) + k4 * t2.powi(4));
    let scale = if r > 0.0 { distorted / r } else { 0.0 };
    [28.0 * scale * p.x + CX, 27.0 * scale * p.y + CY]
}

const BARREL: [f64; 8] = [-0.23, 0.05, 1.2e-3, -2e-3, -0.004, 0.0, 0.0, 0.0];
const RATIONAL: [f64; 8] = [0.9, 0.12, -1e-3, 8e-4, 0.03, 1.1, 0.35, 0.02];
const KANNALA: [f64; 4] = [0.03, -0.01, 0.004, -3e-4];

fn brown(d: [f64; 8]) -> Value {
    let [k1, k2, p1, p2, k3, k4, k5, k6] = d;
    json!({ "type": "brownconrady", "k1": k1, "k2": k2, "k3": k3, "k4": k4, "k5": k5, "k6": k6,
            "p1": p1, "p2": p2 })
}

fn calibrated(
    name: &'static str,
    distortion: Option<Value>,
    project: fn(DVec3) -> [f64; 2],
) -> Lens {
    let mut keys = json!({ "type": "intrinsics", "fx": FX, "fy": FY, "cx": CX, "cy": CY });
    if let Some(distortion) = distortion {
        keys["distortion"] = distortion;
    }
    Lens { name, keys, project }
}

fn lenses() -> Vec<Lens> {
    let mut skewed = calibrated("skew", None, |p| {
        let (x, y) = (p.x / p.z, p.y / p.z);
        [FX * x + 2.5 * y + CX, FY * y + CY]
    });
    skewed.keys["skew"] = json!(2.5);
    let [k1, k2, k3, k4] = KANNALA;
    let fisheye = json!({ "type": "fisheye", "k1": k1, "k2": k2, "k3": k3, "k4": k4 });
    let mut fisheye = calibrated("fisheye", Some(fisheye), |p| project_fisheye(p, KANNALA));
    fisheye.keys["fx"] = json!(28.0);
    fisheye.keys["fy"] = json!(27.0);
    vec![
        calibrated("intrinsics", None, |p| project_points(p, [0.0; 8])),
        skewed,
        calibrated("barrel", Some(brown(BARREL)), |p| project_points(p, BARREL)),
        calibrated("rational", Some(brown(RATIONAL)), |p| project_points(p, RATIONAL)),
        fisheye,
        Lens {
            name: "orthographic",
            keys: json!({ "type": "orthographic", "viewwidth": 4.8 }),
            // 20 pixels per unit.
            project: |p| [p.x * 20.0 + 48.0 - 0.5, p.y * 20.0 + 36.0 - 0.5],
        },
        Lens {
            name: "panorama",
            keys: json!({ "type": "panorama" }),
            project: |p| {
                let (longitude, latitude) = (p.x.atan2(p.z), (-p.y).atan2(p.x.hypot(p.z)));
                let u = (longitude.to_degrees() + 180.0) / 360.0 * 96.0;
                [u - 0.5, (90.0 - latitude.to_degrees()) / 180.0 * 72.0 - 0.5]
            },
        },
        Lens {
            name: "part of a panorama",
            keys: json!({ "type": "panorama", "longitude": [-30, 66], "latitude": [-20, 52] }),
            project: |p| {
                let (longitude, latitude) = (p.x.atan2(p.z), (-p.y).atan2(p.x.hypot(p.z)));
                [longitude.to_degrees() + 30.0 - 0.5, 52.0 - latitude.to_degrees() - 0.5]
            },
        },
    ]
}

fn pose() -> Pose {
    Pose::new(DVec3::new(0.8, -0.5, 0.3), 2.1, DVec3::new(0.4, -0.3, 0.7))
}

/// A scene with a camera: the inside of a cube, and three spheres.
fn scene(lens: &Lens, way: usize) -> Value {
    let pose = pose();
    let mut camera = lens.keys.clone();
    let more = match camera["type"] == "intrinsics" {
        true => pose.matrix(way),
        false => pose.directions(),
    };
    camera.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    camera["width"] = json!(SIZE[0]);
    camera["height"] = json!(SIZE[1]);
    let corner = |i: usize| [1, 2, 4].map(|bit| if i & bit == 0 { -4.0 } else { 4.5 });
    let faces =
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let mut shapes: Vec<Value> = Vec::new();
    for [a, b, c, d] in faces.map(|face| face.map(corner)) {
        shapes.push(json!({ "type": "plane", "v0": a, "v1": b, "v2": c, "v3": d, "material": {} }));
    }
    for center in [[1.5, 1.0, -2.0], [-2.0, 0.5, 1.0], [0.5, -2.5, 0.0]] {
        shapes.push(json!({ "type": "sphere", "center": center, "radius": 0.8, "material": {} }));
    }
    json!({ "camera": camera, "output": { "layers": ["P", "Z", "primid"] },
            "scene": { "ambient": [1, 1, 1], "shapes": shapes } })
}

fn checked(scene: &Value) -> Scene {
    let text = scene.to_string();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: Path::new("") };
    scene::load(source, &[]).unwrap_or_else(|error| panic!("{error}")).scene
}

fn rendered(
    scene: &Value,
    backend: Backend,
    overscan: u32,
    window: Option<Window>,
) -> (Film, Scene) {
    let scene = checked(scene);
    let monitor = Monitor::default();
    let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).unwrap();
    let world = world.with_overscan(overscan);
    let options = BuildOptions { threads: 1, max_bytes: None };
    let accelerator = accel::build(&world.geometry, backend, &options, &monitor).unwrap();
    let plan = LayerPlan::new(&scene);
    let [width, height] = world.frame;
    let window = window.unwrap_or(Window::full(width, height));
    let blank = ReservedFilm::new(world.frame, window, plan.layout.channels.clone());
    let mut film = blank.unwrap().film();
    let isa = Isa::detect();
    let accelerator = &*accelerator;
    let context = RenderContext { world: &world, accelerator, isa, monitor: &monitor };
    render_layers(context, &mut film, &plan, None).unwrap();
    (film, scene)
}

/// The rays through any raster position hit the points that OpenCV projects there.
#[test]
fn rays_go_through_the_points_that_project_to_them() {
    let pose = pose();
    for lens in lenses() {
        for way in 0..4 {
            let scene = checked(&scene(&lens, way));
            let camera = Camera::new(&scene.camera, DVec3::ZERO);
            let mut worst = 0.0f64;
            for i in 0..2000u32 {
                let at = |step: f64| (f64::from(i) * step).fract();
                // Without the poles and the seam of a panorama.
                let raster = [0.3 + at(0.754_877_666) * 95.4, 0.3 + at(0.569_840_291) * 71.4];
                let (origin, direction) = match camera.general_projection() {
                    Some(projection) => projection.exact_ray(raster),
                    None => {
                        let (o, d) = camera.pinhole_ray(raster[0] as f32, raster[1] as f32);
                        (o.as_dvec3(), d.as_dvec3())
                    }
                };
                // In units of the world, whatever the length of the direction.
                let point = origin + direction.normalize() * (0.5 + f64::from(i % 7));
                let [u, v] = (lens.project)(pose.seen(point));
                let error = (u + 0.5 - raster[0]).abs().max((v + 0.5 - raster[1]).abs());
                worst = worst.max(error);
            }
            // A pinhole's ray is rounded to f32, and so is the position here.
            let most = if camera.general_projection().is_some() { 1e-9 } else { 5e-5 };
            assert!(worst <= most, "{}: {worst:e}", lens.name);
        }
    }
}

on_both! {
    /// The points of the layer P project to the centres of their pixels. Z is their depth, or their
    /// distance.
    fn points_of_a_picture_project_to_their_pixels(backend: Backend) {
        let pose = pose();
        for (way, lens) in lenses().iter().enumerate() {
            let (film, _) = rendered(&scene(lens, way % 4), backend, 0, None);
            let channel = |name: &str| film.planes.index(name).unwrap();
            let [x, y, z] = ["P.X", "P.Y", "P.Z"].map(channel);
            let (depth, id) = (channel("Z"), channel("primid.id"));
            let distance = ["fisheye", "panorama", "part of a panorama"].contains(&lens.name);
            let (mut hits, mut seen) = (0, std::collections::BTreeSet::new());
            for pixel in 0..SIZE[0] * SIZE[1] {
                seen.insert(film.planes.uint(id, pixel));
                if film.planes.uint(id, pixel) == 0 {
                    continue;
                }
                hits += 1;
                let p = [x, y, z].map(|c| f64::from(film.planes.float(c, pixel)));
                let p = pose.seen(DVec3::from(p));
                let [u, v] = (lens.project)(p);
                let (i, j) = ((pixel % SIZE[0]) as f64, (pixel / SIZE[0]) as f64);
                let error = (u - i).abs().max((v - j).abs());
                assert!(error < 1e-3, "{}: {error:e} at {i} {j}", lens.name);
                let expected = if distance { p.length() } else { p.z };
                let found = f64::from(film.planes.float(depth, pixel));
                assert!((found - expected).abs() < 1e-5, "{}: {found} {expected}", lens.name);
            }
            assert!(hits > 6000 || lens.name == "orthographic" && hits > 4000, "{hits}");
            assert!(seen.len() >= 3, "{}: {seen:?}", lens.name);
        }
    }
}

/// A crop has the pixels of the frame, and overscan leaves them as they are and shows what lies
/// beyond.
#[test]
fn crops_and_overscan_keep_the_frame() {
    let pose = pose();
    for lens in lenses().iter().filter(|lens| !lens.name.contains("panorama")) {
        let scene = scene(lens, 0);
        let backend = checked(&scene).backend;
        let full = rendered(&scene, backend, 0, None).0;
        let crop = Window { x0: 37, y0: 21, x1: 61, y1: 50 };
        let cut = rendered(&scene, backend, 0, Some(crop)).0;
        let beyond = Window { x0: 32 - 5, y0: 32 - 5, x1: 32 + 96 + 5, y1: 32 + 72 + 5 };
        let wide = rendered(&scene, backend, 32, Some(beyond)).0;
        let stride = full.planes.words.len() / (SIZE[0] * SIZE[1]);
        let row = |film: &Film, first: usize, count: usize| {
            film.planes.words[first * stride..(first + count) * stride].to_vec()
        };
        for y in 0..72 {
            assert!(row(&full, y * 96, 96) == row(&wide, (y + 5) * 106 + 5, 96), "{}", lens.name);
        }
        for y in 21..50 {
            assert!(row(&full, y * 96 + 37, 24) == row(&cut, (y - 21) * 24, 24), "{}", lens.name);
        }
        let [x, y, z] = ["P.X", "P.Y", "P.Z"].map(|name| wide.planes.index(name).unwrap());
        let id = wide.planes.index("primid.id").unwrap();
        for pixel in (0..106 * 82).filter(|&pixel| wide.planes.uint(id, pixel) > 0) {
            let p = [x, y, z].map(|c| f64::from(wide.planes.float(c, pixel)));
            let [u, v] = (lens.project)(pose.seen(DVec3::from(p)));
            let (i, j) = ((pixel % 106) as f64 - 5.0, (pixel / 106) as f64 - 5.0);
            let error = (u - i).abs().max((v - j).abs());
            assert!(error < 1e-3, "{}: {error:e} at {i} {j}", lens.name);
        }
    }
}

/// OpenEXR's attributes, by their definitions, for points of the picture.
#[test]
fn header_attributes_project_as_the_camera_does() {
    let pose = pose();
    for lens in lenses() {
        let camera = checked(&scene(&lens, 0)).camera;
        let to_camera = camera::world_to_camera(&camera);
        let to_ndc = camera::world_to_ndc(&camera);
        let linear = ["intrinsics", "skew", "orthographic"].contains(&lens.name);
        assert_eq!(to_ndc.is_some(), linear, "{}", lens.name);
        let screen = camera::screen(&camera);
        for q in [DVec3::new(0.3, -0.2, 1.0), DVec3::new(-1.5, 0.7, 4.0), DVec3::new(2.0, 3.0, 5.0)]
        {
            let p = pose.rotation.transpose() * q + pose.position;
            let times = |m: &[[f64; 4]; 4]| -> [f64; 4] {
                let p = [p.x, p.y, p.z, 1.0];
                std::array::from_fn(|c| (0..4).map(|r| p[r] * m[r][c]).sum())
            };
            let [x, y, z, _] = times(&to_camera);
            assert!((DVec3::new(x, -y, z) - q).length() < 1e-12);
            let [u, v] = (lens.project)(q);
            if let Some(to_ndc) = &to_ndc {
                let [x, y, _, w] = times(to_ndc);
                assert!((x / w * 96.0 - 0.5 - u).abs() < 1e-9, "{}", lens.name);
                assert!((y / w * 72.0 - 0.5 - v).abs() < 1e-9, "{}", lens.name);
            }
            if lens.name == "intrinsics" {
                // The screen window is a rectangle at distance 1; its height follows from the
                // frame's shape and the pixel's.
                let height = screen.width * 72.0 / 96.0 / screen.pixel_aspect;
                let column = ((x / z - screen.center[0]) / screen.width + 0.5) * 96.0;
                let row = ((screen.center[1] - y / z) / height + 0.5) * 72.0;
                assert!((column - 0.5 - u).abs() < 1e-9 && (row - 0.5 - v).abs() < 1e-9);
            }
        }
        let distorted = ["barrel", "rational"].contains(&lens.name);
        let aspect = if linear || distorted { FY / FX } else { 27.0 / 28.0 };
        let calibrated = lens.keys["type"] == "intrinsics";
        assert_eq!(screen.pixel_aspect, if calibrated { aspect } else { 1.0 }, "{}", lens.name);
        let described: Value = serde_json::from_str(&camera::described(&camera)).unwrap();
        for (key, value) in
            [("position", camera.position), ("lookat", camera.lookat), ("up", camera.up)]
        {
            assert_eq!(described[key], json!(value.to_array()), "{}: {key}", lens.name);
        }
    }
}

/// A mesh outside of the view causes the warning, one inside does not.
#[test]
fn shapes_outside_of_the_view_are_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("p.ply"), crate::support::program::PYRAMID).unwrap();
    let pose = pose();
    for lens in lenses() {
        for (place, outside) in [([0.2, 0.1, 2.2], false), ([0.2, 9.0, 2.2], true)] {
            let mut scene = scene(&lens, 0);
            let center = pose.rotation.transpose() * DVec3::from(place) + pose.position;
            scene["scene"]["shapes"] = json!([{ "type": "trimesh", "path": "p.ply", "fit": 0.1,
                "center": center.to_array(), "material": {} }]);
            let text = scene.to_string();
            let source =
                Source::Text { name: "s.json", text: text.as_bytes(), folder: folder.path() };
            let scene = scene::load(source, &[]).unwrap().scene;
            let (_, warnings) =
                World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap();
            let told = warnings.iter().any(|w| w.message.contains("outside the camera's view"));
            let bounded = ["intrinsics", "skew", "orthographic"].contains(&lens.name);
            assert_eq!(told, outside && bounded, "{} {warnings:?}", lens.name);
        }
    }
}

/// Rays from the edge of a lens reach points beside the frustum of its middle.
#[test]
fn a_thin_lens_sees_beside_its_frustum() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("p.ply"), crate::support::program::PYRAMID).unwrap();
    for (center, outside) in [([0.7, 0.0, -1.0], false), ([0.7, 0.0, 1.0], true)] {
        let scene = json!({
            "camera": { "type": "thinlens", "width": 32, "height": 32, "fov": 10, "aperture": 2,
                        "focaldistance": 10, "position": [0, 0, 0], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": { "shapes": [{ "type": "trimesh", "path": "p.ply", "fit": 0.2,
                                    "center": center, "material": {} }] } });
        let text = scene.to_string();
        let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: folder.path() };
        let scene = scene::load(source, &[]).unwrap().scene;
        let options = LoadOptions::default();
        let (_, warnings) = World::load(&scene, options, &Monitor::default()).unwrap();
        let told = warnings.iter().any(|w| w.message.contains("outside the camera's view"));
        assert_eq!(told, outside, "{warnings:?}");
    }
}
