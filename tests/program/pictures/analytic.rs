//! Pictures with pixels in closed form, compared with the reference tracer (to 1e-9) and with the
//! renderer (to the precision of a half-float EXR, or of its own samples).

use crate::support::reference::analytic::{
    LitSphere, facing_mirrors, lonlat_point, lonlat_uv, plane_coordinates, polygon_irradiance,
};
use crate::support::reference::{assets, program};
use lightpath_reference::{self as reference, Density, Picture, scene::Scene};
use serde_json::{Value, json};
use std::path::Path;

/// Half floats round to within 2^-11 = 4.9e-4 of a value. The rest is f32 arithmetic.
const HALF: f64 = 6e-4;

/// The reference works in f64 throughout.
const EXACT: f64 = 1e-9;

/// A renderer under test. Each closed form is checked against all of them.
#[derive(Clone, Copy, PartialEq)]
enum Painter {
    Reference,
    /// The program on a backend.
    Renderer(&'static str),
}
use Painter::{Reference, Renderer};

impl Painter {
    /// Draws a scene given as JSON. The 5 x 5 texture `cells.png` and the 2 x 2 texture `ramp.png`
    /// lie beside it.
    fn draw(self, scene: &Value) -> Picture {
        let folder = tempfile::tempdir().expect("a temporary folder");
        write_textures(folder.path());
        let path = folder.path().join("scene.json");
        std::fs::write(&path, scene.to_string()).expect("scene.json");
        match self {
            Reference => reference::render(&Scene::load(&path), Density::default()),
            Renderer(backend) => program::render(&path, backend),
        }
    }

    /// Returns the relative tolerance of a value without random choices.
    fn tolerance(self) -> f64 {
        if self == Reference { EXACT } else { HALF }
    }
}

/// Writes `cells.png`, five columns by five rows of different colours, and `ramp.png`, where red is
/// 0 on the left and 1 on the right, green 0 at the top and 1 at the bottom.
fn write_textures(folder: &Path) {
    let cells = image::RgbImage::from_fn(5, 5, |i, j| image::Rgb(assets::texel(i, j)));
    cells.save(folder.join("cells.png")).expect("cells.png");
    let ramp = image::RgbImage::from_fn(2, 2, |i, j| image::Rgb([255 * i as u8, 255 * j as u8, 0]));
    ramp.save(folder.join("ramp.png")).expect("ramp.png");
}

/// Returns the linear colour of the texel of `cells.png` at (u, v) in [0, 1], nearest, clamped.
fn cell(u: f64, v: f64) -> [f64; 3] {
    let index = |x: f64| (5.0 * x).floor().clamp(0.0, 4.0) as u32;
    assets::texel(index(u), index(v)).map(|x| f64::from(x) / 255.0)
}

/// Returns a material that shows its texture unchanged: `colour = ka * ambient * base`.
fn glowing(texture: &str, filter: &str) -> Value {
    json!({ "kd": 0, "ka": 1, "tPath": texture, "filter": filter, "colorspace": "linear" })
}

/// A pinhole picture of `shapes` in white ambient light on a black background.
fn glowing_scene(camera: Value, shapes: Value) -> Value {
    json!({ "camera": camera, "scene": { "ambient": [1, 1, 1], "shapes": shapes } })
}

/// The camera at (0, 0, 1) that sees exactly [-1, 1]^2 of the plane z = 0, x right, y up.
fn facing_square(size: usize) -> Value {
    json!({ "type": "pinhole", "width": size, "height": size, "fov": 90,
            "position": [0, 0, 1], "lookat": [0, 0, -2], "up": [0, 1, 0] })
}

/// Asserts a pixel's colour to a relative tolerance (absolute below 0.01).
fn assert_pixel(picture: &Picture, (i, j): (usize, usize), expected: [f64; 3], tolerance: f64) {
    let actual = picture.at(i, j);
    for c in 0..3 {
        let right = (actual[c] - expected[c]).abs() <= tolerance * expected[c].abs().max(0.01);
        assert!(right, "pixel ({i}, {j}): {actual:?}, expected {expected:?}");
    }
}

/// Checks every pixel of a picture of the square [-1, 1]^2 against the texel at `uv(x, y)`. `None`
/// excludes a pixel outside the shape or too near an edge.
fn assert_square(painter: Painter, shape: Value, uv: &dyn Fn(f64, f64) -> Option<(f64, f64)>) {
    let picture = painter.draw(&glowing_scene(facing_square(32), json!([shape])));
    let mut checked = 0;
    for j in 0..32 {
        for i in 0..32 {
            let (x, y) = plane_coordinates(i, j, (32, 32), 90.0);
            if let Some((u, v)) = uv(x, y) {
                assert_pixel(&picture, (i, j), cell(u, v), painter.tolerance());
                checked += 1;
            }
        }
    }
    assert!(checked > 100, "only {checked} pixels were on the shape");
}

/// Checks "Shading" and "Camera" on a unit sphere, for every falloff and pixel.
fn lit_sphere(painter: Painter) {
    for (falloff, word) in ["none", "linear", "quadratic"].into_iter().enumerate() {
        let (eye, light) = (4.0, [3.0, 2.0, 5.0]);
        let (kd, ks, specularexponent) = (0.75, 0.5, 20.0);
        let scene = json!({
            "camera": { "type": "pinhole", "width": 33, "height": 31, "fov": 35,
                        "position": [0, 0, eye], "lookat": [0, 0, -1], "up": [0, 1, 0] },
            "scene": {
                "attenuation": word,
                "lightsources": [{ "type": "pointlight", "position": light, "id": [1, 1, 1] }],
                "shapes": [{ "type": "sphere", "center": [0, 0, 0], "radius": 1, "material":
                    { "kd": kd, "ks": ks, "specularexponent": specularexponent } }],
            }
        });
        let picture = painter.draw(&scene);
        let sphere = LitSphere { eye, light, kd, ks, specularexponent, falloff: falloff as i32 };
        for j in 0..31 {
            for i in 0..33 {
                let (px, py) = plane_coordinates(i, j, (33, 31), 35.0);
                let expected = sphere.radiance(px, py).unwrap_or(0.0);
                assert_pixel(&picture, (i, j), [expected; 3], painter.tolerance());
            }
        }
    }
}

/// A mirror shows `kr` times the background, and black once its bounces are used up.
fn mirror_of_background(painter: Painter) {
    let background = [0.25, 0.5, 1.5];
    for (nbounces, kr) in [(0, 0.0), (1, 0.5), (4, 0.5)] {
        let scene = json!({
            "nbounces": nbounces,
            "camera": facing_square(8),
            "scene": { "backgroundcolor": background, "shapes": [{
                "type": "plane", "v0": [-3, 3, 0], "v1": [3, 3, 0], "v2": [3, -3, 0], "v3": [-3, -3, 0],
                "material": { "kd": 0, "kr": 0.5 } }] }
        });
        let picture = painter.draw(&scene);
        for (i, j) in [(0, 0), (7, 0), (3, 4), (7, 7)] {
            // Half floats hold these products exactly.
            assert_pixel(&picture, (i, j), background.map(|b| kr * b), EXACT);
        }
    }
}

/// Between two glowing mirrors, the bounces add up to a geometric sum.
fn mirrors_face_to_face(painter: Painter) {
    let wall = |z: f64| {
        json!({ "type": "plane", "v0": [-90, 90, z], "v1": [90, 90, z], "v2": [90, -90, z],
                "v3": [-90, -90, z], "material": { "kd": 0, "ka": 0.5, "kr": 0.75 } })
    };
    for nbounces in [0, 1, 2, 7] {
        let mut scene = glowing_scene(facing_square(4), json!([wall(0.0), wall(2.0)]));
        scene["nbounces"] = json!(nbounces);
        let expected = facing_mirrors(0.5, 0.75, nbounces);
        let picture = painter.draw(&scene);
        assert_pixel(&picture, (1, 2), [expected; 3], painter.tolerance());
        assert_pixel(&picture, (3, 0), [expected; 3], painter.tolerance());
    }
}

/// Checks "Lights": a lambertian area light with `id = radiance * area / pi`, quadratic, kd = 1
/// gives a diffuse plane `irradiance / pi`, which Lambert's polygon formula gives exactly.
fn lambertian_light(painter: Painter) {
    const SAMPLES: usize = 4096;
    let corners = [[-0.5, 1.7, -0.6], [0.7, 1.9, -0.5]];
    let e = [1.2, 0.2, 0.1];
    let h = [0.0, -0.4, 0.8]; // e.h = 0
    let at = |s: f64, t: f64| std::array::from_fn(|c| corners[0][c] + s * e[c] + t * h[c]);
    let apex: [f64; 3] = at(0.8, 1.0); // v2 leans along the base: only its height counts
    let normal_y: f64 = e[2] * h[0] - e[0] * h[2];
    assert!(normal_y < 0.0, "the light faces the plane below");
    let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let radiance = 3.0;
    let id = radiance * length(e) * length(h) / std::f64::consts::PI;
    let scene = json!({
        "camera": { "type": "pinhole", "width": 32, "height": 32, "fov": 90,
                    "position": [0, 1, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] },
        "scene": {
            "attenuation": "quadratic",
            "lightsources": [{ "type": "arealight", "emission": "lambertian", "samples": SAMPLES,
                "v0": corners[0], "v1": corners[1], "v2": apex, "id": [id, id, id] }],
            "shapes": [{ "type": "plane", "v0": [-9, -1, -9], "v1": [9, -1, -9], "v2": [9, -1, 9],
                "v3": [-9, -1, 9], "material": {} }],
        }
    });
    let picture = painter.draw(&scene);
    let quad = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
    let mut ratios = 0.0;
    for j in 0..32 {
        for i in 0..32 {
            let (px, py) = plane_coordinates(i, j, (32, 32), 90.0);
            let point = [2.0 * px, -1.0, -2.0 * py];
            let irradiance = radiance * polygon_irradiance(point, [0.0, 1.0, 0.0], &quad);
            let ratio = picture.at(i, j)[0] * std::f64::consts::PI / irradiance;
            // Everywhere on this plane the integrand's deviation over the light is below 0.4 of its
            // mean; the reference checks this. So 4096 samples leave an error of 0.63%, and the
            // test allows five times that. The reference's own grid has a far smaller error.
            let tolerance = if painter != Reference { 5.0 * 0.4 / 64.0 } else { 1e-3 };
            if let Some(noise) = picture.deviation.get(j * 32 + i) {
                assert!(noise[0] * 64.0 < 0.4 * picture.at(i, j)[0], "({i}, {j}): {noise:?}");
            }
            assert!(
                (ratio - 1.0).abs() < tolerance,
                "pixel ({i}, {j}): {ratio} of the form factor"
            );
            ratios += ratio / 1024.0;
        }
    }
    // The mean of 1024 pixels has 1/32 of the noise: 0.02%. The test allows five times that.
    assert!((ratios - 1.0).abs() < 1e-3, "on average {ratios} of the form factor");
}

/// Checks "Texture coordinates" of a plane: v3 is (0, 1), v2 is (1, 1), v0 is (0, 0).
fn plane_uv(painter: Painter) {
    let shape = json!({ "type": "plane", "v0": [-1, 1, 0], "v1": [1, 1, 0], "v2": [1, -1, 0],
                        "v3": [-1, -1, 0], "material": glowing("cells.png", "nearest") });
    assert_square(painter, shape, &|x, y| Some(((x + 1.0) / 2.0, (1.0 - y) / 2.0)));
}

/// Checks "Texture coordinates" of a triangle whose apex lies over the base or past its end. u runs
/// from v1's side to v0's over the whole range along the base, v from the base to the apex.
fn triangle_uv(painter: Painter) {
    for (apex, range) in [(0.4, 2.0), (2.5, 3.5)] {
        let shape = json!({ "type": "triangle", "v0": [-1, -1, 0], "v1": [1, -1, 0],
            "v2": [apex, 1, 0], "material": glowing("cells.png", "nearest") });
        assert_square(painter, shape, &|x, y| {
            let v = (y + 1.0) / 2.0;
            let (left, right) = (-1.0 + v * (apex + 1.0), 1.0 + v * (apex - 1.0));
            let inside = x > left + 0.01 && x < right - 0.01;
            inside.then_some((1.0 - (x + 1.0) / range, v))
        });
    }
}

/// Checks "Texture coordinates" of a sphere at points of known longitude and latitude.
fn sphere_uv(painter: Painter) {
    for pole in ["z", "x", "y"] {
        for (longitude, latitude) in
            [(0.0, 0.1), (1.0, 0.0), (2.9, -0.7), (-1.3, 1.2), (-2.8, -1.4)]
        {
            let point = lonlat_point(longitude, latitude, pole.chars().next().expect("a pole"));
            let camera = json!({ "type": "pinhole", "width": 3, "height": 3, "fov": 1,
                "position": point.map(|x| 3.0 * x), "target": [0, 0, 0], "up": [0.6, -0.5, 0.7] });
            let shape = json!({ "type": "sphere", "center": [0, 0, 0], "radius": 1, "pole": pole,
                "material": glowing("cells.png", "nearest") });
            let picture = painter.draw(&glowing_scene(camera, json!([shape])));
            let (u, v) = lonlat_uv(longitude, latitude);
            assert_pixel(&picture, (1, 1), cell(u, v), painter.tolerance());
        }
    }
}

/// Checks "Texture coordinates" of a trimesh: `s t` per vertex and `texcoord` per face, with v up
/// in the file.
fn mesh_uv(painter: Painter) {
    let per_vertex = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        property float s\nproperty float t\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n\
        -1 -1 0 0 0\n1 -1 0 1 0\n1 1 0 1 1\n-1 1 0 0 1\n4 0 1 2 3\n";
    let per_face = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
        element face 2\nproperty list uchar int vertex_indices\n\
        property list uchar float texcoord\nend_header\n\
        -1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0 0 1 1 0 1\n";
    for body in [per_vertex, per_face] {
        let file = tempfile::Builder::new().suffix(".ply").tempfile().expect("a temporary file");
        std::fs::write(file.path(), format!("ply\nformat ascii 1.0\n{body}")).expect("the mesh");
        let shape = json!({ "type": "trimesh", "path": file.path(),
                            "material": glowing("cells.png", "nearest") });
        assert_square(painter, shape, &|x, y| {
            // With some renderers, a ray along the diagonal may slip between the triangles.
            ((x - y).abs() > 0.01).then_some(((x + 1.0) / 2.0, (1.0 - y) / 2.0))
        });
    }
}

/// Checks "Camera" with an oblique view: a ramp perpendicular to the view shows each ray's (px,
/// py).
fn camera_rays(painter: Painter) {
    let (root2, distance, half_width) = (2f64.sqrt(), 2.0, 4.0);
    let position = [1.0, 2.0, 3.0];
    let z = [2.0 / 3.0, -1.0 / 3.0, 2.0 / 3.0];
    let x = [-1.0 / root2, 0.0, 1.0 / root2]; // normalize(z x (0, 1, 0))
    let y = [1.0, 4.0, 1.0].map(|c| c / (3.0 * root2)); // x x z
    let corner = |a: f64, b: f64| -> [f64; 3] {
        std::array::from_fn(|c| position[c] + distance * z[c] + half_width * (a * x[c] + b * y[c]))
    };
    let camera = json!({ "type": "pinhole", "width": 40, "height": 30, "fov": 60,
        "position": position, "lookat": [4, -2, 4], "up": [0, 7, 0] });
    let shape = json!({ "type": "plane", "v0": corner(-1.0, 1.0), "v1": corner(1.0, 1.0),
        "v2": corner(1.0, -1.0), "v3": corner(-1.0, -1.0),
        "material": glowing("ramp.png", "bilinear") });
    let picture = painter.draw(&glowing_scene(camera, json!([shape])));
    for j in 0..30 {
        for i in 0..40 {
            let (px, py) = plane_coordinates(i, j, (40, 30), 60.0);
            let along = |p: f64| 0.5 + distance * p / (2.0 * half_width); // u, or v
            let ramp = |u: f64| (u - 0.25) / 0.5; // texel centres are at 1/4 and 3/4
            let expected = [ramp(along(px)), ramp(along(-py)), 0.0];
            assert_pixel(&picture, (i, j), expected, painter.tolerance());
        }
    }
}

/// Defines one test per closed form and painter.
macro_rules! closed_forms {
    ($($case:ident)*) => {
        mod the_reference { $(#[test] fn $case() { super::$case(super::Reference) })* }
        mod the_renderer { $(#[test] fn $case() { super::$case(super::Renderer("bvh")) })* }
        mod the_renderer_with_embree { $(
            #[test]
            #[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
            fn $case() { super::$case(super::Renderer("embree")) }
        )* }
    };
}
closed_forms! {
    lit_sphere mirror_of_background mirrors_face_to_face lambertian_light
    plane_uv triangle_uv sphere_uv mesh_uv camera_rays
}
