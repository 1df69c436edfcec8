//! Colours of meshes against closed forms, in a scene that shows the base colour alone.

use crate::support::backends;
use crate::support::ply_writer::{Encoding, Ply, Rows, V};
use lightpath::{
    error::{Error, Problem},
    film::{Film, Window},
    monitor::Monitor,
    render,
    scene::{self, Backend, Source},
    simd::Isa,
    world::{LoadOptions, World},
};
use serde_json::{Value, json};

const SIDE: u32 = 33;

/// Renders a mesh that fills [-1, 1]^2 of the plane z = 0, seen from z = 4, lit by ambient light.
/// `more` are keys of the mesh.
fn render(ply: &Ply, more: Value) -> Result<(Film, Vec<Problem>), Error> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("m.ply"), ply.write(Encoding::Little)).unwrap();
    for (name, color) in [("red.ppm", "255 0 0"), ("green.ppm", "0 255 0")] {
        let image = format!("P3 1 1 255 {color}");
        std::fs::write(folder.path().join(name), image).unwrap();
    }
    std::fs::write(folder.path().join("pair.ppm"), "P3 2 1 255 0 0 0 128 128 128").unwrap();
    let mut mesh = json!({ "type": "trimesh", "path": "m.ply", "material": { "kd": 0, "ka": 1 } });
    mesh.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let fov = 2.0 * (1f64 / 4.0).atan().to_degrees();
    let scene = json!({
        "camera": { "type": "pinhole", "width": SIDE, "height": SIDE, "fov": fov,
                    "position": [0, 0, 4], "lookat": [0, 0, -1], "up": [0, 1, 0] },
        "scene": { "ambient": [1, 1, 1], "shapes": [mesh] },
    });
    let text = scene.to_string();
    let source = Source::Text { name: "s.json", text: text.as_bytes(), folder: folder.path() };
    let scene = scene::load(source, &[])?.scene;
    let monitor = Monitor::default();
    let (world, warnings) = World::load(&scene, LoadOptions::default(), &monitor)?;
    let accelerator = backends::build(&world.geometry, Backend::Bvh(Isa::detect()));
    let mut film = Film::new(world.frame, Window::full(SIDE, SIDE)).unwrap();
    render::render(&world, &*accelerator, Isa::detect(), &mut film, &monitor).unwrap();
    Ok((film, warnings))
}

/// A square of two triangles, split along the diagonal from (-1, -1) to (1, 1), with properties of
/// its vertices and faces.
fn square(
    of_vertex: &[&str],
    vertex: impl Fn([f64; 2], usize) -> f64,
    of_face: &[&str],
    face: impl Fn(usize, usize) -> f64,
) -> Ply {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let rows: Rows = corners
        .iter()
        .map(|&[x, y]| {
            let more = (0..of_vertex.len()).map(|k| V::N(vertex([x, y], k)));
            [x, y, 0.0].map(V::N).into_iter().chain(more).collect()
        })
        .collect();
    let properties = [&["float x", "float y", "float z"], of_vertex].concat();
    let faces: Rows = [[0.0, 1.0, 2.0], [0.0, 2.0, 3.0]]
        .iter()
        .enumerate()
        .map(|(i, corners)| {
            let more = (0..of_face.len()).map(|k| V::N(face(i, k)));
            [V::L(corners.to_vec())].into_iter().chain(more).collect()
        })
        .collect();
    let of_face = [&["list uchar int vertex_indices"], of_face].concat();
    Ply::new().element("vertex", &properties, rows).element("face", &of_face, faces)
}

/// Compares every pixel with the colour at its point (x, y) of the square. Pixels on the diagonal
/// are left out.
fn check(film: &Film, expected: impl Fn(f64, f64) -> [f64; 3]) {
    let mut compared = 0;
    for (k, pixel) in film.pixels.iter().enumerate() {
        let (i, j) = (k as u32 % SIDE, k as u32 / SIDE);
        let at = |i: u32| 2.0 * (f64::from(i) + 0.5) / f64::from(SIDE) - 1.0;
        let (x, y) = (at(i), -at(j));
        if (x - y).abs() < 1e-6 {
            continue;
        }
        let wanted = expected(x, y);
        for c in 0..3 {
            let difference = (f64::from(pixel[c]) - wanted[c]).abs();
            assert!(difference < 2e-6, "({x}, {y}): {pixel:?}, expected {wanted:?}");
        }
        compared += 1;
    }
    assert_eq!(compared, SIDE * SIDE - SIDE);
}

fn linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// A colour map at `t`: linear light between 257 samples of the crate.
fn mapped(map: colorous::Gradient, t: f64) -> [f64; 3] {
    let sample = |i: f64| {
        let color = map.eval_continuous(i / 256.0);
        [color.r, color.g, color.b].map(|c| linear(f64::from(c) / 255.0))
    };
    let x = 256.0 * t.clamp(0.0, 1.0);
    let (a, b) = (sample(x.floor()), sample(x.ceil()));
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * x.fract())
}

#[test]
fn faces_show_their_colours_and_alpha_fades_to_the_material() {
    let names = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
    let colors = [[200.0, 100.0, 0.0, 255.0], [0.0, 50.0, 255.0, 51.0]];
    let ply = square(&[], |_, _| 0.0, &names, |face, k| colors[face][k]);
    let material = json!({ "kd": 0, "ka": 1, "diffusecolor": [0.5, 1, 2] });
    for more in [json!({}), json!({ "color": "face" })] {
        let mut more = more;
        more["material"] = material.clone();
        let (film, _) = render(&ply, more).unwrap();
        check(&film, |x, y| {
            let [r, g, b, a] = colors[usize::from(y > x)];
            let [r, g, b] = [r, g, b].map(|c| 1.0 + (linear(c / 255.0) - 1.0) * a / 255.0);
            [0.5 * r, g, 2.0 * b]
        });
    }
    let (film, _) = render(&ply, json!({ "vertexcolors": false })).unwrap();
    check(&film, |_, _| [1.0; 3]);
}

#[test]
fn a_property_of_vertices_runs_through_its_map() {
    let ply = square(&["double quality"], |[x, _], _| 1e6 + 3.0 * x, &[], |_, _| 0.0);
    let color = |more: Value| json!({ "color": more });
    let (film, warnings) = render(&ply, color(json!({ "property": "quality" }))).unwrap();
    check(&film, |x, _| mapped(colorous::VIRIDIS, (x + 1.0) / 2.0));
    assert!(warnings.is_empty(), "{warnings:?}");
    let ranged =
        json!({ "property": "vertex.quality", "map": "redblue", "range": [1e6 + 1.5, 1e6] });
    let (film, _) = render(&ply, color(ranged)).unwrap();
    check(&film, |x, _| mapped(colorous::RED_BLUE, 1.0 - 2.0 * x));
}

#[test]
fn a_property_of_faces_and_values_that_are_not_finite() {
    for odd in [f64::NAN, f64::INFINITY] {
        let ply = square(&[], |_, _| 0.0, &["float area"], |face, _| [odd, 0.25][face]);
        let color = json!({ "property": "area", "range": [0, 1], "nan": [0, 0.5, 0] });
        let (film, warnings) = render(&ply, json!({ "color": color })).unwrap();
        let of_second = mapped(colorous::VIRIDIS, 0.25);
        check(&film, |x, y| if y > x { of_second } else { [0.0, 0.5, 0.0] });
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        let found = warning.to_string();
        assert!(found.contains("1 of 2 values of face.area are not finite"), "{found}");
        assert!(found.contains("[0, 0.5, 0]"), "{found}");
    }
}

#[test]
fn problems_name_the_place_in_the_scene() {
    let ply = square(&["float quality"], |_, _| 0.0, &[], |_, _| 0.0);
    for (more, message) in [
        (json!({ "color": { "property": "qality" } }), "did you mean `quality`?"),
        (json!({ "color": { "property": "quality", "map": "virids" } }), "did you mean `viridis`?"),
        (json!({ "color": { "property": "quality", "range": [1, 1] } }), "two different numbers"),
        (json!({ "color": "vertx" }), "did you mean `vertex`?"),
        (json!({ "color": 7 }), "expected `vertex`, `face` or `none` or an object"),
        (json!({ "color": "vertex" }), "m.ply has no colours of its vertices"),
        (json!({ "color": "face", "vertexcolors": false }), "expected one of the two"),
    ] {
        let Err(error) = render(&ply, more) else { panic!("no error: {message}") };
        assert_eq!(error.exit_code(), 2);
        let text = error.to_string();
        assert!(text.contains(message) && text.contains("s.json:1:"), "{text}");
        assert!(text.contains("/scene/shapes/0/color"), "{text}");
    }
}

/// The width of the range overflows, or the difference of a value from its low end.
#[test]
fn the_largest_numbers_have_colours() {
    let max = f64::MAX;
    // Files of maps have -f64::MAX where there are no data.
    for everywhere in [-max, max] {
        let ply = square(&["double q"], |_, _| everywhere, &[], |_, _| 0.0);
        let (film, _) = render(&ply, json!({ "color": { "property": "q" } })).unwrap();
        let end = if everywhere < 0.0 { 0.0 } else { 1.0 };
        check(&film, |_, _| mapped(colorous::VIRIDIS, end));
    }
    let name = |range: Value| {
        let mut color = json!({ "property": "q" });
        if !range.is_null() {
            color["range"] = range;
        }
        json!({ "color": color })
    };
    let ply = square(&["double q"], |[x, _], _| (0.9 * x + 0.05) * max, &[], |_, _| 0.0);
    let shown = |range| render(&ply, name(range)).unwrap().0;
    check(&shown(Value::Null), |x, _| mapped(colorous::VIRIDIS, (x + 1.0) / 2.0));
    for range in [json!([-1, 1]), json!([-1e300, 1e300])] {
        check(&shown(range), |x, _| mapped(colorous::VIRIDIS, (0.9 * x + 0.05) * 1e300));
    }
}

#[test]
fn faces_have_the_textures_of_their_numbers() {
    let shown = |names: &[&str], numbers: [f64; 2]| {
        let ply = square(
            &["float s", "float t"],
            |_, _| 0.5,
            &["int texnumber"],
            |face, _| numbers[face],
        );
        let named = names
            .iter()
            .fold(ply, |ply, name| ply.comment(format!("comment TextureFile {name}").as_bytes()));
        let material = json!({ "kd": 0, "ka": 1, "diffusecolor": [0.25, 0.5, 0.75] });
        render(&named, json!({ "material": material }))
    };
    let (red, green, plain) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.25, 0.5, 0.75]);
    let pair = ["red.ppm", "green.ppm"];
    for (names, numbers, lower, upper) in [
        (&pair[..], [0.0, 1.0], red, green),
        (&pair, [1.0, 0.0], green, red),
        (&pair, [1.0, 1.0], green, green),
        (&pair, [-1.0, 1.0], plain, green),
        (&pair, [-1.0, -1.0], plain, plain),
        (&["red.ppm", "red.ppm", "green.ppm"], [1.0, 2.0], red, green),
        (&["red.ppm", "no.ppm", "none.ppm"], [1.0, 0.0], plain, red),
    ] {
        let (film, warnings) = shown(names, numbers).unwrap();
        check(&film, |x, y| if y > x { upper } else { lower });
        let missing = warnings.iter().filter(|w| w.message.contains("no.ppm")).count();
        let expected = usize::from(names.contains(&"no.ppm"));
        assert_eq!((missing, warnings.len()), (expected, expected), "{warnings:?}");
    }
    let Err(error) = shown(&pair, [0.0, 2.0]) else { panic!("out of range") };
    let error = error.to_string();
    assert!(error.contains("m.ply: face 1: texnumber 2 is out of range"), "{error}");
}

/// A texture of the material hides all of these.
#[test]
fn colours_on_request_hide_the_image_of_the_file() {
    let names = ["float red", "float green", "float blue"];
    let of_vertex = [&["float s", "float t"], &names[..]].concat();
    let vertex = |_: [f64; 2], k: usize| [0.5, 0.5, 0.0, 0.0, 1.0][k];
    let face = |_: usize, k: usize| [1.0, 1.0, 0.0][k];
    let ply = square(&of_vertex, vertex, &names, face);
    let ply = ply.comment(b"comment TextureFile red.ppm");
    let textured = json!({ "kd": 0, "ka": 1, "tPath": "green.ppm" });
    for (more, expected) in [
        (json!({}), [1.0, 0.0, 0.0]),
        (json!({ "color": "none" }), [1.0; 3]),
        (json!({ "color": "vertex" }), [0.0, 0.0, 1.0]),
        (json!({ "color": "face" }), [1.0, 1.0, 0.0]),
        (json!({ "material": textured, "color": "vertex" }), [0.0, 1.0, 0.0]),
    ] {
        let (film, _) = render(&ply, more).unwrap();
        check(&film, |_, _| expected);
    }
}

/// The settings of a material apply to the images of the mesh file, one or several.
#[test]
fn images_of_the_file_have_the_settings_of_the_material() {
    let shown = |names: &[&str], numbers: [f64; 2], settings: Value| {
        let u = |[x, _]: [f64; 2], k| if k == 0 { x + 0.01 } else { 0.5 };
        let ply = square(&["float s", "float t"], u, &["int texnumber"], |face, _| numbers[face]);
        let named = names
            .iter()
            .fold(ply, |ply, name| ply.comment(format!("comment TextureFile {name}").as_bytes()));
        let mut material = json!({ "kd": 0, "ka": 1 });
        material.as_object_mut().unwrap().extend(settings.as_object().unwrap().clone());
        render(&named, json!({ "material": material })).unwrap()
    };
    let texel = |at: f64, repeat: bool| match (2.0 * at).floor() as i32 {
        texel if repeat => texel.rem_euclid(2),
        texel => texel.clamp(0, 1),
    };
    for (key, value) in [("wrap", "repeat"), ("wrap", "clamp"), ("colorspace", "linear")] {
        for (names, numbers) in
            [(&["pair.ppm"][..], [0.0, 0.0]), (&["red.ppm", "pair.ppm"], [1.0, 1.0])]
        {
            let settings = json!({ "filter": "nearest", "tScale": [1.5, 1], key: value });
            let (film, warnings) = shown(names, numbers, settings);
            assert!(warnings.iter().all(|w| w.message.contains("texture files")), "{warnings:?}");
            check(&film, |x, _| {
                let level =
                    [0.0, 128.0 / 255.0][texel(1.5 * (x + 0.01), value != "clamp") as usize];
                [if key == "colorspace" { level } else { linear(level) }; 3]
            });
        }
    }
    // Without an image, each setting is reported once.
    for (names, numbers) in [(&[][..], [0.0, 0.0]), (&["pair.ppm", "red.ppm"], [-1.0, -1.0])] {
        let settings = json!({ "filter": "nearest", "tScale": [2, 1] });
        let (film, warnings) = shown(names, numbers, settings);
        check(&film, |_, _| [1.0; 3]);
        let unused = warnings.iter().filter(|w| w.message.contains("it has no effect"));
        let unused: Vec<String> = unused.map(Problem::to_string).collect();
        assert_eq!(unused.len(), 2, "{warnings:?}");
        assert!(unused[0].contains("`filter` without `tPath`"), "{unused:?}");
    }
}

/// Scanners write NaN for vertices that no photograph saw.
#[test]
fn colours_that_are_not_finite_are_white() {
    let names = ["float red", "float green", "float blue"];
    for bad in [f64::NAN, f64::INFINITY, -3e20] {
        // The upper triangle uses the fourth corner.
        let color = |[x, y]: [f64; 2], k: usize| match (x < 0.0 && y > 0.0, k) {
            (true, 1) => bad,
            _ => 0.25,
        };
        let (film, warnings) = render(&square(&names, color, &[], |_, _| 0.0), json!({})).unwrap();
        let [warning] = &warnings[..] else { panic!("{warnings:?}") };
        assert!(warning.message.starts_with("1 colour is not finite"), "{warning}");
        check(&film, |x, y| [0.25 + 0.75 * ((y - x) / 2.0).max(0.0); 3]);
    }
    // 1e17 is finite, but decoded from sRGB it is 1e41.
    let color = |[x, y]: [f64; 2], _| if x < 0.0 && y > 0.0 { -1e17 } else { 0.0 };
    let ply = square(&names, color, &[], |_, _| 0.0);
    let (film, warnings) = render(&ply, json!({ "vertexcolorspace": "srgb" })).unwrap();
    assert!(warnings[0].message.starts_with("1 colour is not finite or beyond 1e18"));
    check(&film, |x, y| [((y - x) / 2.0).max(0.0); 3]);
    let alpha = ["float red", "float green", "float blue", "float alpha"];
    let color = |[x, y]: [f64; 2], k: usize| match (x < 0.0 && y > 0.0, k) {
        (true, 3) => f64::NAN,
        (false, 3) => 1.0,
        _ => 0.0,
    };
    let (film, warnings) = render(&square(&alpha, color, &[], |_, _| 0.0), json!({})).unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    check(&film, |x, y| [((y - x) / 2.0).max(0.0); 3]);
}
