//! Environments of an image, compared with closed forms and with other lights.

use std::f64::consts::{PI, TAU};
use std::path::PathBuf;

use crate::support::program::Scratch;
use glam::DVec3;
use image::{Rgb, Rgb32FImage};
use lightpath::monitor::Monitor;
use lightpath::scene::{self, Source};
use lightpath::world::{LoadOptions, World};
use lightpath::{LoadedScene, error::Error};
use serde_json::{Value, json};

/// Width of the images; they are half as high.
const WIDTH: u32 = 360;

/// Direction of a place in the image, in texels.
fn direction(x: f64, y: f64) -> DVec3 {
    let (sin, cos) = ((x / f64::from(WIDTH) - 0.5) * TAU).sin_cos();
    let (around, up) = (2.0 * y / f64::from(WIDTH) * PI).sin_cos();
    DVec3::new(around * sin, up, -around * cos)
}

/// Sides of the parts of a texel whose mean is the texel: it has a share of an edge.
const EDGES: u32 = 8;
/// For skies whose mean over a texel is that of its middle, and where such edges do not matter.
const MIDDLES: u32 = 1;

/// Writes an image whose texels are the means of a function of directions over `parts` x `parts`
/// places.
fn write(
    folder: &Scratch,
    name: &str,
    parts: u32,
    radiance: impl Fn(DVec3) -> [f64; 3],
) -> PathBuf {
    let image = Rgb32FImage::from_fn(WIDTH, WIDTH / 2, |x, y| {
        let mut sum = [0.0; 3];
        for part in 0..parts * parts {
            let at = |first: u32, part: u32| {
                f64::from(first) + (f64::from(part) + 0.5) / f64::from(parts)
            };
            let sent = radiance(direction(at(x, part % parts), at(y, part / parts)));
            sum = [0, 1, 2].map(|axis| sum[axis] + sent[axis]);
        }
        Rgb(sum.map(|sum| (sum / f64::from(parts * parts)) as f32))
    });
    let path = folder.path(name);
    image.save(&path).unwrap();
    path
}

fn environment(image: &std::path::Path) -> Value {
    json!({ "type": "environment", "image": image, "samples": 4, "name": "sky" })
}

fn load(
    camera: &Value,
    light: Value,
    shapes: &[Value],
    more: &[&str],
) -> Result<LoadedScene, Error> {
    let scene = json!({ "camera": camera, "scene": { "lightsources": [light], "shapes": shapes } });
    LoadedScene::from_json(&scene.to_string(), more)
}

/// Pixels with alpha.
fn with_alpha(camera: &Value, light: Value, shapes: &[Value], more: &[&str]) -> Vec<[f64; 4]> {
    let film = load(camera, light, shapes, more).unwrap().renderer().unwrap().render().unwrap();
    film.pixels.iter().map(|pixel| pixel.map(f64::from)).collect()
}

fn render(camera: &Value, light: Value, shapes: &[Value], more: &[&str]) -> Vec<[f64; 3]> {
    with_alpha(camera, light, shapes, more).iter().map(|&[r, g, b, _]| [r, g, b]).collect()
}

/// Looks at the ground's point at x = z = 0 from below any wall.
fn down() -> Value {
    json!({ "type": "orthographic", "width": 1, "height": 1, "viewwidth": 1e-4,
            "position": [0, 0.01, 0], "lookat": [0, -1, 0], "up": [0, 0, -1] })
}

fn quad(corners: [[f64; 3]; 4]) -> Value {
    let [v0, v1, v2, v3] = corners;
    json!({ "type": "plane", "v0": v0, "v1": v1, "v2": v2, "v3": v3,
            "material": { "kd": 1, "ks": 0.4, "specularexponent": 8 } })
}

fn ground() -> Value {
    quad([[-9.0, 0.0, -9.0], [9.0, 0.0, -9.0], [9.0, 0.0, 9.0], [-9.0, 0.0, 9.0]])
}

/// Mean over 64 seeds of the pixel that sees the first of `shapes`, and its standard error.
fn mean_pixel(light: &Value, shapes: &[Value], spp: u32) -> ([f64; 4], [f64; 4]) {
    let (mut sum, mut squares) = ([0.0; 4], [0.0; 4]);
    let spp = format!("/spp={spp}");
    for seed in 0..64 {
        let seed = format!("/seed={seed}");
        let [value] = with_alpha(&down(), light.clone(), shapes, &[&spp, &seed])[..] else {
            unreachable!()
        };
        for channel in 0..4 {
            sum[channel] += value[channel] / 64.0;
            squares[channel] += value[channel] * value[channel] / 64.0;
        }
    }
    let error =
        |channel: usize| ((squares[channel] - sum[channel] * sum[channel]).max(0.0) / 63.0).sqrt();
    (sum, [0, 1, 2, 3].map(error))
}

/// Mean over 64 seeds of the ground's light, and its standard error.
fn means(light: &Value, shapes: &[Value], spp: u32) -> ([f64; 3], [f64; 3]) {
    let ([r, g, b, _], [of_r, of_g, of_b, _]) =
        mean_pixel(light, &[&[ground()], shapes].concat(), spp);
    ([r, g, b], [of_r, of_g, of_b])
}

fn assert_equal(
    what: &str,
    (a, error_a): ([f64; 3], [f64; 3]),
    (b, error_b): ([f64; 3], [f64; 3]),
) {
    for axis in 0..3 {
        let error = error_a[axis].hypot(error_b[axis]) + 1e-5 * b[axis];
        assert!((a[axis] - b[axis]).abs() <= 3.0 * error, "{what}: {a:?} {b:?} +- {error}");
    }
}

/// A unit vector with this azimuth and elevation in degrees.
fn towards(azimuth: f64, elevation: f64) -> DVec3 {
    let ((east, north), (up, side)) =
        (azimuth.to_radians().sin_cos(), elevation.to_radians().sin_cos());
    DVec3::new(side * east, up, -side * north)
}

#[test]
fn a_white_body_vanishes_in_an_image_of_one_radiance() {
    let folder = Scratch::new();
    let image = write(&folder, "flat.exr", MIDDLES, |_| [0.7; 3]);
    let camera = json!({ "type": "pinhole", "width": 48, "height": 48, "fov": 50,
                         "position": [0.3, 0.4, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] });
    let ball = json!({ "type": "sphere", "center": [0, 0, 0], "radius": 1.2, "material": {} });
    for backend in ["bvh", "embree", "brute"] {
        let backend = format!("/scene/accelerator={backend}");
        for pixel in render(&camera, environment(&image), std::slice::from_ref(&ball), &[&backend])
        {
            assert!(pixel.iter().all(|value| (value - 0.7).abs() < 1e-6), "{pixel:?}");
        }
    }
}

#[test]
fn a_disc_painted_into_the_sky_is_a_sun() {
    let folder = Scratch::new();
    let half = 6f64.to_radians();
    let sun = json!({ "type": "sun", "azimuth": 130, "elevation": 40, "angle": 12, "samples": 16,
                      "id": [1, 2, 3] });
    // The light of the disc is id = radiance * solid angle / pi.
    let scale = 1.0 / (2.0 * (1.0 - half.cos()));
    let disc = |d: DVec3| {
        let inside = d.dot(towards(130.0, 40.0)) > half.cos();
        if inside { [1.0, 2.0, 3.0].map(|color| color * scale) } else { [0.0; 3] }
    };
    // Its penumbra covers the point.
    let wall = quad([[0.5, 0.0, 0.1], [0.5, 0.0, 9.0], [0.5, 0.45, 9.0], [0.5, 0.45, 0.1]]);
    let image = write(&folder, "sun.exr", EDGES, disc);
    for shapes in [&[][..], &[wall]] {
        assert_equal("disc", means(&environment(&image), shapes, 16), means(&sun, shapes, 16));
    }
    let mut turned = environment(&image);
    turned["rotation"] = json!(90);
    let sun = json!({ "type": "sun", "azimuth": 220, "elevation": 40, "angle": 12, "samples": 16,
                      "id": [1, 2, 3] });
    assert_equal("rotation", means(&turned, &[], 16), means(&sun, &[], 16));
}

#[test]
fn light_of_every_direction_has_its_cosine() {
    let folder = Scratch::new();
    // Bright and dim parts, so that both kinds of directions count. Red only from below.
    check_cosine(&folder, EDGES, |d| {
        let bright = if d.dot(towards(10.0, 70.0)) > 0.9 { 20.0 } else { 0.2 };
        [if d.y < 0.0 { 5.0 } else { 0.0 }, bright, (1.0 + d.x) * bright]
    });
    // So smooth that all directions follow the cosine.
    check_cosine(&folder, MIDDLES, |d| {
        [if d.y < 0.0 { 0.5 } else { 0.0 }, 1.0 + 2.0 * d.y.max(0.0), 2.0 + d.x]
    });
}

/// Compares the ground's light with a sum over directions. The sky's red comes only from below.
fn check_cosine(folder: &Scratch, parts: u32, sky: impl Fn(DVec3) -> [f64; 3]) {
    let image = write(folder, "sky.exr", parts, &sky);
    let mut expected = [0.0; 3];
    let steps = 4;
    for y in 0..steps * WIDTH / 4 {
        for x in 0..steps * WIDTH {
            let at = |k: u32| (f64::from(k) + 0.5) / f64::from(steps);
            let d = direction(at(x), at(y));
            let angle = (TAU / f64::from(steps * WIDTH)).powi(2) * (1.0 - d.y * d.y).sqrt();
            let sent = sky(d);
            expected = [0, 1, 2].map(|axis| expected[axis] + sent[axis] * d.y * angle / PI);
        }
    }
    let mut light = environment(&image);
    light["is"] = json!([0, 0, 0]);
    let found = means(&light, &[], 16);
    assert_eq!(found.0[0], 0.0);
    // The sum above has an error of its own at the edge of the bright part.
    assert_equal("sky", found, (expected, expected.map(|sum| 2e-4 * sum)));
}

#[test]
fn cameras_and_mirrors_see_the_image_unless_it_is_hidden() {
    let folder = Scratch::new();
    let sky = |d: DVec3| [1.0 + d.x, 2.0 + d.y, 3.0 + d.z];
    let image = write(&folder, "sky.exr", MIDDLES, sky);
    let ball = json!({ "type": "sphere", "center": [0, -90, 0], "radius": 1, "material": {} });
    let around = json!({ "type": "panorama", "width": 72, "height": 36, "position": [0, 0, 0],
                         "lookat": [0, 0, -1], "up": [0, 1, 0] });
    let mut light = environment(&image);
    light["radiance"] = json!([2, 1, 1]);
    let seen = render(&around, light.clone(), std::slice::from_ref(&ball), &["/spp=64"]);
    for (pixel, value) in seen.iter().enumerate() {
        let (x, y) = ((pixel % 72) as f64 + 0.5, (pixel / 72) as f64 + 0.5);
        let [r, g, b] = sky(direction(x * f64::from(WIDTH) / 72.0, y * f64::from(WIDTH) / 72.0));
        let expected = [2.0 * r, g, b];
        let off = [0, 1, 2].map(|axis| (value[axis] - expected[axis]).abs());
        assert!(off.iter().all(|&off| off < 0.02) || y > 34.0, "{x} {y}: {value:?} {expected:?}");
    }
    light["rotation"] = json!(90);
    let turned = render(&around, light.clone(), std::slice::from_ref(&ball), &["/spp=64"]);
    let [middle, right] = [36, 54].map(|x| 18 * 72 + x);
    assert!((turned[right][2] - seen[middle][2]).abs() < 0.02);
    let hidden = render(&around, light, &[ball], &["/scene/lightsources/0/visible=false"]);
    assert!(hidden[..72 * 18].iter().all(|pixel| *pixel == [0.0; 3]));
    // A mirror at 45 degrees shows what is above.
    let mirror = json!({ "type": "plane", "v0": [-1, -1, -3], "v1": [1, -1, -3], "v2": [1, 1, -5],
                         "v3": [-1, 1, -5], "material": { "kd": 0, "kr": 1 } });
    let ahead = json!({ "type": "pinhole", "width": 1, "height": 1, "fov": 1, "position": [0, 0, 0],
                        "lookat": [0, 0, -1], "up": [0, 1, 0] });
    let seen = render(&ahead, environment(&image), &[mirror], &["/nbounces=1", "/spp=4"]);
    assert!((seen[0][1] - 3.0).abs() < 0.01, "{seen:?}");
}

#[test]
fn groups_and_components_add_up_with_an_image() {
    let folder = Scratch::new();
    let image = write(&folder, "sky.exr", MIDDLES, |d| {
        [1.0 + d.x, 2.0 + d.y, if d.y > 0.8 { 9.0 } else { 0.1 }]
    });
    let camera = json!({ "type": "pinhole", "width": 32, "height": 24, "fov": 60,
                         "position": [0, 2, 4], "target": [0, 0, 0], "up": [0, 1, 0] });
    let ball = json!({ "type": "sphere", "center": [0, 1, 0], "radius": 1,
                       "material": { "ks": 0.3, "kr": 0.2, "specularexponent": 20 } });
    let layers = r#"/output/layers=["diffuse", "specular", "reflection", "background", "light"]"#;
    for more in [&["/spp=1"][..], &["/spp=16", "/scene/lightsources/0/samples=1"]] {
        let more = [more, &["/nbounces=2", layers]].concat();
        let loaded = load(&camera, environment(&image), &[ground(), ball.clone()], &more);
        let film = loaded.unwrap().renderer().unwrap().render().unwrap();
        let sum = |names: &[&str], pixel: usize| -> f64 {
            let value =
                |name: &&str| f64::from(film.planes.float(film.planes.index(name).unwrap(), pixel));
            names.iter().map(value).sum()
        };
        for (pixel, beauty) in film.pixels.iter().enumerate() {
            let components =
                sum(&["diffuse.G", "specular.G", "reflection.G", "background.G"], pixel);
            let groups = sum(&["light_sky.G", "light_background.G"], pixel);
            for all in [components, groups] {
                let off = (all - f64::from(beauty[1])).abs();
                assert!(off < 1e-5 * all.max(1.0), "{all} {beauty:?}");
            }
        }
    }
}

/// One direction for each of 16 camera samples shares their sequence, and 64 are reordered.
#[test]
fn one_direction_for_each_sample_has_the_same_mean() {
    let folder = Scratch::new();
    let image = write(&folder, "sky.exr", MIDDLES, |d| {
        [1.5 + d.x, 1.0 + d.z * d.y, if d.dot(towards(20.0, 50.0)) > 0.98 { 40.0 } else { 0.2 }]
    });
    let light = |samples: u32| {
        let mut light = environment(&image);
        light["samples"] = json!(samples);
        light
    };
    let wall = quad([[0.5, 0.0, -9.0], [0.5, 0.0, 9.0], [0.5, 2.0, 9.0], [0.5, 2.0, -9.0]]);
    for shapes in [&[][..], &[wall]] {
        let many = means(&light(64), shapes, 1);
        for spp in [16, 64] {
            assert_equal(&format!("{spp}"), means(&light(1), shapes, spp), many);
        }
    }
}

#[test]
fn an_image_takes_its_light_off_shadow_catchers() {
    let folder = Scratch::new();
    let image =
        write(&folder, "sky.exr", MIDDLES, |d| [1.0, 2.0, if d.y > 0.8 { 9.0 } else { 0.1 }]);
    let mut light = environment(&image);
    light["samples"] = json!(1);
    let mut ground = ground();
    ground["shadow_catcher"] = json!(true);
    // Nothing stands on the ground, so no light is taken: alpha is 0.
    let camera = down();
    let scene = json!({ "camera": camera, "spp": 16,
                        "scene": { "lightsources": [light], "shapes": [ground] } });
    let loaded = LoadedScene::from_json(&scene.to_string(), &[]).unwrap();
    let film = loaded.renderer().unwrap().render().unwrap();
    assert_eq!(film.pixels, [[0.0; 4]]);
}

/// Alpha is the share of the light that a ball takes: white ground shows how much that is.
#[test]
fn alpha_of_catchers_is_the_share_of_distant_light_that_a_ball_takes() {
    let folder = Scratch::new();
    let image = write(&folder, "sky.exr", MIDDLES, |d| {
        let bright = if d.dot(towards(10.0, 70.0)) > 0.9 { 20.0 } else { 0.2 };
        [1.0 + d.x, bright, 0.5]
    });
    let sun = |angle: u32, samples: u32| {
        json!({ "type": "sun", "azimuth": 10, "elevation": 70, "angle": angle, "samples": samples,
                "id": [1, 2, 3] })
    };
    let sky = json!({ "type": "environment", "radiance": [3, 2, 1], "samples": 16 });
    let directional =
        json!({ "type": "directional", "direction": [-0.5, -1.2, 0.3], "id": [1, 2, 3] });
    let ball =
        json!({ "type": "sphere", "center": [0.5, 1.2, -0.3], "radius": 0.5, "material": {} });
    let mut catcher = ground();
    catcher["shadow_catcher"] = json!(true);
    let mut partly = 0;
    for light in [environment(&image), sun(60, 1), sun(60, 16), sky, directional] {
        let luminance = |[r, g, b]: [f64; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let [with, without] = [&[ball.clone()][..], &[]]
            .map(|balls| means(&light, balls, 64))
            .map(|(mean, error)| (luminance(mean), luminance(error)));
        let share = 1.0 - with.0 / without.0;
        let (pixel, errors) = mean_pixel(&light, &[catcher.clone(), ball.clone()], 64);
        assert_eq!(pixel[..3], [0.0; 3]);
        let error = errors[3] + (with.1 + without.1) / without.0;
        let off = (pixel[3] - share).abs();
        // The guide promises 2 %.
        assert!(off <= 3.0 * error + 0.01 * share, "{light}: {} {share} +- {error}", pixel[3]);
        assert!(error < 0.01, "{light}: {error}");
        partly += u32::from(share > 0.05 && share < 0.9);
    }
    assert_eq!(partly, 4);
}

#[test]
fn odd_images_and_unused_keys_are_warned_of() {
    let folder = Scratch::new();
    let warnings = |light: Value, more: &[&str]| -> Vec<String> {
        let loaded = load(&down(), light, &[ground()], more).unwrap();
        loaded.warnings().iter().map(ToString::to_string).collect()
    };
    let path = folder.path("odd.exr");
    Rgb32FImage::from_pixel(5, 5, Rgb([0.0; 3])).save(&path).unwrap();
    let all = warnings(environment(&path), &[]).join(" ");
    assert!(all.contains("5 x 5") && all.contains("is black"), "{all}");
    Rgb32FImage::from_pixel(2, 1, Rgb([1.0; 3])).save(&path).unwrap();
    assert_eq!(warnings(environment(&path), &[]), [""; 0]);
    let even = json!({ "type": "environment", "radiance": [1, 1, 1], "rotation": 20 });
    let all = warnings(even, &["/output/aodistance=2"]).join(" ");
    assert!(all.contains("`rotation`") && all.contains("`aodistance`"), "{all}");
}

#[test]
fn an_image_above_the_limit_of_memory_is_refused_by_its_header() {
    let folder = Scratch::new();
    let path = folder.path("sky.exr");
    Rgb32FImage::from_pixel(64, 32, Rgb([1.0; 3])).save(&path).unwrap();
    let scene = json!({ "camera": down(),
                        "scene": { "lightsources": [environment(&path)], "shapes": [ground()] } });
    folder.write("s.json", &scene.to_string());
    let loaded = scene::load(Source::File(&folder.path("s.json")), &[]).unwrap().scene;
    let load = |texture_bytes: u64| {
        let options = LoadOptions { texture_bytes: Some(texture_bytes), ..LoadOptions::default() };
        World::load(&loaded, options, &Monitor::default())
    };
    // Floats of the image, and 4 bytes a texel to sample it.
    let needed = 64 * 32 * 16;
    assert!(load(needed).is_ok());
    let error = load(needed - 1).unwrap_err();
    assert!(error.to_string().contains("--max-memory leaves") && error.exit_code() == 2, "{error}");
}

/// Other PNGs are sRGB.
#[test]
fn a_png_of_linear_values_is_as_bright_as_it_says() {
    let folder = Scratch::new();
    let path = folder.path("sky.png");
    let around = json!({ "type": "panorama", "width": 8, "height": 4, "position": [0, 0, 0],
                         "lookat": [0, 0, -1], "up": [0, 1, 0] });
    for (gamma, expected) in [(Some(1.0), 0.2), (None, (0.255f64 / 1.055).powf(2.4))] {
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 8, 4);
        if let Some(gamma) = gamma {
            encoder.set_source_gamma(png::ScaledFloat::new(gamma));
        }
        encoder.write_header().unwrap().write_image_data(&[51; 8 * 4]).unwrap();
        let seen = render(&around, environment(&path), &[], &[])[8 + 3];
        assert!(seen.iter().all(|value| (value - expected).abs() < 1e-6), "{gamma:?}: {seen:?}");
    }
}

/// Editors write XMP texts of many kilobytes, more than a small image needs.
#[test]
fn an_image_may_have_metadata() {
    let folder = Scratch::new();
    let path = folder.path("sky.png");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 64, 32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.add_itxt_chunk("XML:com.adobe.xmp".into(), "x".repeat(1 << 17)).unwrap();
    encoder.write_header().unwrap().write_image_data(&[200; 3 * 64 * 32]).unwrap();
    load(&down(), environment(&path), &[ground()], &[]).unwrap();
}

#[test]
fn images_that_are_no_radiance_are_refused() {
    let folder = Scratch::new();
    let camera = down();
    let reason = |light: Value| match load(&camera, light, &[ground()], &[]) {
        Ok(loaded) => loaded.renderer().err().map(|error| error.to_string()).unwrap_or_default(),
        Err(error) => error.to_string(),
    };
    for (value, expected) in [(f32::NAN, "NaN"), (f32::INFINITY, "infinite"), (-1.0, "negative")] {
        let path = folder.path("bad.exr");
        let image = Rgb32FImage::from_fn(4, 2, |x, y| {
            Rgb(if (x, y) == (3, 1) { [1.0, value, 1.0] } else { [1.0; 3] })
        });
        image.save(&path).unwrap();
        let found = reason(environment(&path));
        assert!(found.contains("(3, 1)") && found.contains(expected), "{found}");
    }
    let found = reason(environment(&folder.path("none.exr")));
    assert!(found.contains("there is no file"), "{found}");
    let found = reason(json!({ "type": "environment" }));
    assert!(found.contains("`radiance` or `image`"), "{found}");
}
