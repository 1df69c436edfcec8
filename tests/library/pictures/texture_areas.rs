//! Textures that are averaged over the area that a sample sees, compared with many samples.

use crate::support::backends;
use crate::support::program::Scratch;
use image::{Rgb, RgbImage};
use lightpath::LoadedScene;
use lightpath::film::{Film, Window};
use lightpath::monitor::Monitor;
use lightpath::scene::{self, Source};
use lightpath::simd::Isa;
use lightpath::world::{LoadOptions, World};
use serde_json::{Value, json};

/// Side of the frame in pixels.
const SIDE: usize = 48;

/// Writes a texture with detail of all sizes: cells, lines and noise.
fn texture(folder: &Scratch) -> std::path::PathBuf {
    let path = folder.path("detail.png");
    let hash = |x: u32, y: u32| {
        let bits =
            (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77)).wrapping_mul(0xc2b2_ae3d);
        (bits >> 24) as u8
    };
    RgbImage::from_fn(1000, 700, |x, y| {
        let cell = if (x / 90 + y / 70) % 2 == 0 { 220 } else { 40 };
        let line = if x % 13 == 0 { 255 } else { cell };
        Rgb([cell / 2 + hash(x, y) / 2, line, hash(x / 3, y / 3)])
    })
    .save(&path)
    .unwrap();
    path
}

/// Linear RGB of all pixels of a textured shape.
fn render(
    shape: &Value,
    filter: &str,
    image: &std::path::Path,
    spp: u32,
    more: &[&str],
) -> Vec<f32> {
    let mut shape = shape.clone();
    shape["material"] = json!({ "kd": 0, "ka": 1, "tPath": image, "filter": filter, "tScale": [3, 3],
                                "wrap": "repeat" });
    let scene = json!({
        "spp": spp,
        "camera": { "type": "pinhole", "width": SIDE, "height": SIDE, "fov": 40,
                    "position": [0, 1, 6], "target": [0, 0, 0], "up": [0, 1, 0] },
        "scene": { "ambient": [1, 1, 1], "shapes": [shape] }
    });
    let loaded = LoadedScene::from_json(&scene.to_string(), more).unwrap();
    let film = loaded.renderer().unwrap().render().unwrap();
    film.pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect()
}

fn rmse(a: &[f32], b: &[f32]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

fn shapes() -> [(&'static str, Value); 4] {
    [
        (
            "wall",
            json!({ "type": "plane", "v0": [-3, -3, 0], "v1": [3, -3, 0], "v2": [3, 3, 0],
                         "v3": [-3, 3, 0] }),
        ),
        (
            "floor",
            json!({ "type": "plane", "v0": [-9, -1, 4], "v1": [9, -1, 4], "v2": [9, -1, -30],
                          "v3": [-9, -1, -30] }),
        ),
        ("sphere", json!({ "type": "sphere", "center": [0, 0, 0], "radius": 1.8 })),
        (
            "triangle",
            json!({ "type": "triangle", "v0": [-4, -3, 1], "v1": [4, -3, -2], "v2": [0, 4, 0] }),
        ),
    ]
}

#[test]
fn the_mean_over_areas_needs_few_samples() {
    let folder = Scratch::new();
    let image = texture(&folder);
    for (name, shape) in shapes() {
        let truth = render(&shape, "bilinear", &image, 1024, &["/seed=9"]);
        let [points, areas] = ["bilinear", "trilinear"]
            .map(|filter| rmse(&render(&shape, filter, &image, 4, &[]), &truth));
        assert!(areas <= 0.5 * points, "{name}: {areas} {points}");
    }
}

#[test]
fn a_mirror_shows_what_is_behind_it_as_sharp_as_its_distance() {
    let folder = Scratch::new();
    let image = texture(&folder);
    let mirror = r#"/scene/shapes/-={"type": "plane", "v0": [-5, -5, -3], "v1": [5, -5, -3],
        "v2": [5, 5, -3], "v3": [-5, 5, -3], "material": {"kd": 0, "kr": 1}}"#;
    let behind = json!({ "type": "plane", "v0": [-30, -30, 9], "v1": [30, -30, 9],
                         "v2": [30, 30, 9], "v3": [-30, 30, 9] });
    let more = [mirror, "/nbounces=1", "/camera/position=[0, 0, 6]"];
    let all = |filter, spp| render(&behind, filter, &image, spp, &more);
    let truth = all("bilinear", 1024);
    assert!(truth.iter().sum::<f32>() > 1.0);
    let [points, areas] = ["bilinear", "trilinear"].map(|filter| rmse(&all(filter, 4), &truth));
    assert!(areas <= 0.5 * points, "{areas} {points}");
}

/// Linear RGB of all pixels of a picture with a camera of its own and one sample a pixel.
fn seen_by(camera: &Value, shapes: &Value, more: &[&str]) -> Vec<f32> {
    let scene = json!({ "camera": camera, "scene": { "ambient": [1, 1, 1], "shapes": shapes } });
    let loaded = LoadedScene::from_json(&scene.to_string(), more).unwrap();
    let film = loaded.renderer().unwrap().render().unwrap();
    film.pixels.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect()
}

/// A wall in the plane z = 0 with the image, averaged over areas.
fn wall(image: &std::path::Path) -> Value {
    json!({ "type": "plane", "v0": [-1, -1, 0], "v1": [1, -1, 0], "v2": [1, 1, 0], "v3": [-1, 1, 0],
            "material": { "kd": 0, "ka": 1, "tPath": image, "filter": "trilinear" } })
}

fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

/// On a wall that is parallel to the picture, every pixel covers the same area, whatever the angle
/// of the lens, and whether a mirror is between.
#[test]
fn a_wall_is_as_sharp_at_the_edges_of_a_wide_picture() {
    let folder = Scratch::new();
    let image = folder.path("noise.png");
    let hash = |x: u32, y: u32| (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77)) >> 24;
    // 4 x 4 texels a pixel.
    let side = 4 * SIDE as u32;
    RgbImage::from_fn(side, side, |x, y| Rgb([hash(x, y) as u8, (x * 37 + y * y) as u8, 9]))
        .save(&image)
        .unwrap();
    let wall = wall(&image);
    let shapes = json!([wall]);
    let orthographic = json!({ "type": "orthographic", "width": SIDE, "height": SIDE,
        "viewwidth": 2, "position": [0, 0, 1], "lookat": [0, 0, -1], "up": [0, 1, 0] });
    let expected = seen_by(&orthographic, &shapes, &[]);
    let spread = largest_difference(&expected, &vec![0.2; expected.len()]);
    assert!(spread > 0.1, "{spread}");
    for fov in [20.0f64, 90.0, 140.0] {
        let distance = 1.0 / (fov.to_radians() / 2.0).tan();
        let mut pinhole = json!({ "type": "pinhole", "width": SIDE, "height": SIDE, "fov": fov,
            "position": [0, 0, distance], "lookat": [0, 0, -1], "up": [0, 1, 0] });
        let off = largest_difference(&seen_by(&pinhole, &shapes, &[]), &expected);
        assert!(off < 1e-3, "{fov}: {off}");
        // A mirror half way to the wall, which is behind the camera.
        pinhole["position"] = json!([0, 0, 0.1 * distance]);
        let z = 0.55 * distance;
        let mirror = json!({ "type": "plane", "v0": [-9, -9, z], "v1": [9, -9, z],
            "v2": [9, 9, z], "v3": [-9, 9, z], "material": { "kd": 0, "kr": 1 } });
        pinhole["lookat"] = json!([0, 0, 1]);
        let mirrored = seen_by(&pinhole, &json!([mirror, wall]), &["/nbounces=1"]);
        // The camera looks the other way, so the picture is the other way round.
        let rows = expected.chunks(3 * SIDE).flat_map(|row| row.chunks(3).rev().flatten().copied());
        let off = largest_difference(&mirrored, &rows.collect::<Vec<_>>());
        assert!(off < 1e-3, "mirror, {fov}: {off}");
    }
}

/// A part of a panorama, and a tile that is made by moving the principal point, show what the whole
/// picture shows there.
#[test]
fn tiles_of_a_picture_by_their_own_cameras_agree_with_it() {
    let folder = Scratch::new();
    let image = texture(&folder);
    let shapes = json!([{ "type": "plane", "v0": [-8, -6, -5], "v1": [8, -6, -5], "v2": [8, 7, -3],
        "v3": [-8, 7, -3],
        "material": { "kd": 0, "ka": 1, "tPath": image, "filter": "trilinear" } }]);
    let rows = |picture: &[f32], from: usize, to: usize, width: usize| {
        picture[3 * from * width..3 * to * width].to_vec()
    };
    let panorama = |rows: usize, latitude: [f64; 2]| {
        json!({ "type": "panorama", "width": 40, "height": rows, "longitude": [-20, 20],
                "latitude": latitude, "position": [0, 0, 0], "lookat": [0, 0, -1], "up": [0, 1, 0] })
    };
    let whole = seen_by(&panorama(180, [-90.0, 90.0]), &shapes, &[]);
    let strip = seen_by(&panorama(12, [42.0, 54.0]), &shapes, &[]);
    assert!(strip.iter().sum::<f32>() > 9.0);
    let off = largest_difference(&rows(&whole, 36, 48, 40), &strip);
    assert!(off < 1e-3, "panorama: {off}");
    let intrinsics = |height: usize, cy: f64| {
        json!({ "type": "intrinsics", "width": SIDE, "height": height, "fx": 20, "fy": 20,
                "cx": 23.5, "cy": cy, "axes": "opengl",
                "camera_to_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]] })
    };
    let whole = seen_by(&intrinsics(SIDE, 23.5), &shapes, &[]);
    let tile = seen_by(&intrinsics(8, 19.5), &shapes, &[]);
    assert!(tile.iter().sum::<f32>() > 9.0);
    let off = largest_difference(&rows(&whole, 4, 12, SIDE), &tile);
    assert!(off < 1e-3, "intrinsics: {off}");
}

#[test]
fn every_backend_has_the_same_bytes() {
    let folder = Scratch::new();
    let image = texture(&folder);
    let (_, shape) = &shapes()[3];
    let [bvh, brute] = ["bvh", "brute"].map(|backend| {
        render(shape, "trilinear", &image, 4, &[&format!("/scene/accelerator={backend}")])
    });
    assert_eq!(bvh, brute);
}

#[test]
fn overscan_does_not_change_the_areas_of_the_frame() {
    let folder = Scratch::new();
    let image = texture(&folder);
    let (_, shape) = &shapes()[1];
    let mut shape = shape.clone();
    shape["material"] = json!({ "kd": 0, "ka": 1, "tPath": image, "filter": "trilinear" });
    let camera = json!({ "type": "panorama", "width": SIDE, "height": SIDE, "longitude": [-20, 60],
                         "latitude": [-80, 10], "position": [0, 1, 6], "lookat": [0, 0, -1],
                         "up": [0, 1, 0] });
    for kind in ["panorama", "pinhole"] {
        let mut camera = camera.clone();
        if kind == "pinhole" {
            camera = json!({ "type": kind, "width": SIDE, "height": SIDE / 2, "fov": 100,
                             "position": [0, 1, 6], "lookat": [0, -0.2, -1], "up": [0, 1, 0] });
        }
        let scene = json!({ "spp": 4, "camera": camera,
                            "scene": { "ambient": [1, 1, 1], "shapes": [shape] } });
        folder.write("s.json", &scene.to_string());
        let loaded = scene::load(Source::File(&folder.path("s.json")), &[]).unwrap().scene;
        let pixels = |overscan: u32| {
            let (world, _) =
                World::load(&loaded, LoadOptions::default(), &Monitor::default()).unwrap();
            let world = world.with_overscan(overscan);
            let [right, bottom] = world.frame_end();
            let window = Window { x0: overscan, y0: overscan, x1: right, y1: bottom };
            let accelerator = backends::build(&world.geometry, loaded.backend);
            let mut film = Film::new(world.frame, window).unwrap();
            let isa = Isa::detect();
            lightpath::render::render(&world, &*accelerator, isa, &mut film, &Monitor::default())
                .unwrap();
            film.pixels.to_vec()
        };
        let frame = pixels(0);
        assert!(frame.iter().any(|pixel| pixel[0] > 0.0));
        assert!(pixels(5) == frame, "{kind}");
    }
}

#[test]
fn all_textures_share_one_limit() {
    let folder = Scratch::new();
    RgbImage::new(64, 64).save(folder.path("own.png")).unwrap();
    RgbImage::new(64, 64).save(folder.path("other.png")).unwrap();
    folder.write(
        "own.ply",
        "ply\nformat ascii 1.0\ncomment TextureFile own.png\nelement vertex 3\nproperty float x\n\
         property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n\
         property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
    );
    let scene = json!({
        "camera": { "type": "pinhole", "width": 8, "height": 8, "fov": 40, "position": [0, 0, 6],
                    "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "shapes": [
            { "type": "trimesh", "path": "own.ply", "material": {} },
            { "type": "sphere", "center": [0, 0, -9], "radius": 1, "material": { "tPath": "other.png" } }
        ] }
    });
    folder.write("s.json", &scene.to_string());
    let loaded = scene::load(Source::File(&folder.path("s.json")), &[]).unwrap().scene;
    let load = |texture_bytes: u64| {
        let options = LoadOptions { texture_bytes: Some(texture_bytes), ..LoadOptions::default() };
        World::load(&loaded, options, &Monitor::default())
    };
    let (world, _) = load(1 << 20).unwrap();
    // While the second texture is decoded, it takes 3 bytes more for each texel.
    let enough = world.texture_bytes() + 3 * 64 * 64;
    assert!(load(enough).is_ok());
    assert!(load(world.texture_bytes() - 1).is_err());
}

#[test]
fn a_texture_seen_from_near_is_the_same_with_either_filter() {
    let folder = Scratch::new();
    let path = folder.path("small.png");
    RgbImage::from_fn(16, 16, |x, y| Rgb([(x * 16) as u8, (y * 16) as u8, 90]))
        .save(&path)
        .unwrap();
    let (_, shape) = &shapes()[0];
    let [bilinear, trilinear] =
        ["bilinear", "trilinear"].map(|filter| render(shape, filter, &path, 4, &[]));
    assert_eq!(bilinear, trilinear);
}

/// The picture of a texture in tiles has the bytes of the picture of a texture in memory.
#[test]
fn a_texture_in_tiles_gives_the_same_picture() {
    let folder = Scratch::new();
    let image = texture(&folder);
    for (filter, (kind, mut shape)) in
        ["nearest", "bilinear", "trilinear"].into_iter().zip(shapes())
    {
        shape["material"] = json!({ "kd": 0, "ka": 1, "tPath": image, "filter": filter });
        let scene = json!({
            "spp": 4,
            "camera": { "type": "pinhole", "width": SIDE, "height": SIDE, "fov": 40,
                        "position": [0, 1, 6], "target": [0, 0, 0], "up": [0, 1, 0] },
            "scene": { "ambient": [1, 1, 1], "shapes": [shape] }
        });
        folder.write("s.json", &scene.to_string());
        let scene = scene::load(Source::File(&folder.path("s.json")), &[]).unwrap().scene;
        let render = |whole_texels| {
            let options = LoadOptions { whole_texels, ..LoadOptions::default() };
            let (world, _) = World::load(&scene, options, &Monitor::default()).unwrap();
            let accelerator = backends::build(&world.geometry, scene.backend);
            let [x1, y1] = world.frame_end();
            let mut film = Film::new(world.frame, Window { x0: 0, y0: 0, x1, y1 }).unwrap();
            let isa = Isa::detect();
            lightpath::render::render(&world, &*accelerator, isa, &mut film, &Monitor::default())
                .unwrap();
            (film.pixels.to_vec(), world.texture_bytes())
        };
        let ((whole, bytes), (tiles, tile_bytes)) = (render(None), render(Some(10_000)));
        assert!(whole.iter().any(|pixel| pixel[0] > 0.0));
        assert!(whole == tiles, "{kind} {filter}");
        assert_ne!(bytes, tile_bytes, "no disk for temporary files");
    }
}
