//! Colours of faces, alpha, and scalar properties: in all encodings, in bulk, row by row, in
//! streams.

use crate::support::ply_writer::{ALL, Ply, Rows, V, read, read_all};
use lightpath::error::Error;
use lightpath::mesh::{
    ColorChoice, ColorRequest, Colors, Mesh, MeshElement, ReadOptions, Scalars, read_ply_bytes,
};

const XYZ: [&str; 3] = ["float x", "float y", "float z"];
const INDICES: &str = "list uchar int vertex_indices";

/// Vertices on a curve with further properties, whose values follow from the vertex.
fn vertices(count: usize, more: &[&str], value: impl Fn(usize, usize) -> f64) -> Ply {
    let row = |i: usize| {
        let xyz = [i as f64, (i * i) as f64, 0.5].map(V::N);
        xyz.into_iter().chain((0..more.len()).map(|k| V::N(value(i, k)))).collect()
    };
    let rows: Rows = (0..count).map(row).collect();
    Ply::new().element("vertex", &[&XYZ, more].concat(), rows)
}

/// Faces with further properties, whose values follow from the face.
fn with_faces(
    ply: Ply,
    faces: &[&[i64]],
    more: &[&str],
    value: impl Fn(usize, usize) -> f64,
) -> Ply {
    let row = |(i, face): (usize, &&[i64])| {
        let corners = V::L(face.iter().map(|corner| *corner as f64).collect());
        [corners].into_iter().chain((0..more.len()).map(|k| V::N(value(i, k)))).collect()
    };
    let rows: Rows = faces.iter().enumerate().map(row).collect();
    ply.element("face", &[&[INDICES], more].concat(), rows)
}

/// Reads with a request, in every encoding, whole and through a small window. All must agree.
fn requested(ply: &Ply, source: ColorChoice) -> Result<Mesh, Error> {
    let options = ReadOptions::default().color(ColorRequest { source, place: "" });
    let mut first: Option<Mesh> = None;
    for encoding in ALL {
        let bytes = ply.write(encoding);
        let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        std::io::Write::write_all(&mut packed, &bytes).unwrap();
        let packed = packed.finish().unwrap();
        for bytes in [&bytes, &packed] {
            let mut mesh = read_ply_bytes(bytes, "t.ply", options.window(64))?;
            mesh.notes.format = "";
            match &first {
                None => first = Some(mesh),
                Some(first) => assert_eq!(format!("{mesh:?}"), format!("{first:?}")),
            }
        }
    }
    Ok(first.unwrap())
}

fn values(mesh: &Mesh) -> Vec<f64> {
    let all = &mesh.property.as_ref().expect("the property").values;
    (0..all.len()).map(|i| all.get(i)).collect()
}

const RGB: [&str; 3] = ["uchar red", "uchar green", "uchar blue"];

#[test]
fn faces_have_colours_of_every_type() {
    let color = |face: usize, channel: usize| [10.0, 20.0, 30.0][channel] + face as f64;
    for kind in ["uchar", "ushort", "float", "double"] {
        for names in [["red", "green", "blue"], ["r", "g", "b"]] {
            let more = names.map(|name| format!("{kind} {name}"));
            let more: Vec<&str> = more.iter().map(String::as_str).collect();
            // All triangles, read in bulk; with a quad, read row by row.
            for (faces, expected) in [
                (vec![&[0, 1, 2][..], &[1, 2, 3], &[2, 3, 4]], [0, 1, 2].as_slice()),
                (vec![&[0, 1, 2][..], &[1, 2, 3, 4], &[2, 3, 0]], &[0, 1, 1, 2]),
            ] {
                let ply = with_faces(vertices(5, &[], |_, _| 0.0), &faces, &more, color);
                let mesh = read_all(&ply);
                let found: Vec<[f64; 3]> = match mesh.face_colors.expect("colours") {
                    Colors::U8(all) => all.iter().map(|c| c.map(f64::from)).collect(),
                    Colors::U16(all) => all.iter().map(|c| c.map(f64::from)).collect(),
                    Colors::F32(all) => all.iter().map(|c| c.map(f64::from)).collect(),
                };
                let wanted: Vec<_> =
                    expected.iter().map(|f| [0, 1, 2].map(|channel| color(*f, channel))).collect();
                assert_eq!(found, wanted, "{kind}");
                assert!(mesh.colors.is_none());
            }
        }
    }
}

#[test]
fn dropped_triangles_take_their_colours_with_them() {
    // Of no area, a repeat of the first, and of a missing vertex.
    for faces in [
        [&[0, 1, 2][..], &[1, 1, 2], &[2, 0, 1], &[0, 1, 9], &[1, 2, 3]],
        [&[0, 1, 2][..], &[1, 1, 2], &[2, 0, 1], &[0, 1, 9], &[1, 2, 3, 4]],
    ] {
        let more = [&RGB[..], &["float area"]].concat();
        let ply = with_faces(vertices(5, &[], |_, _| 0.0), &faces, &more, |face, _| face as f64);
        for (source, is_property) in
            [(ColorChoice::Any, false), (ColorChoice::Property("area"), true)]
        {
            for encoding in ALL {
                let options = ReadOptions::default().repair(true);
                let options = options.color(ColorRequest { source, place: "" });
                let mesh = read_ply_bytes(&ply.write(encoding), "t.ply", options).unwrap();
                let last = mesh.triangles.len() - 1;
                assert_eq!(mesh.triangles[1], [1, 2, 3]);
                if is_property {
                    assert_eq!(values(&mesh)[..2], [0.0, 4.0]);
                    assert_eq!(values(&mesh)[last], 4.0);
                } else {
                    let Some(Colors::U8(colors)) = &mesh.face_colors else { panic!("colours") };
                    assert_eq!(colors[..2], [[0; 3], [4; 3]]);
                    assert_eq!(colors.len(), mesh.triangles.len());
                }
            }
        }
    }
}

#[test]
fn vertex_colours_come_before_face_colours_and_only_one_kind_is_stored() {
    let ply = vertices(3, &RGB, |i, _| i as f64);
    let ply = with_faces(ply, &[&[0, 1, 2]], &RGB, |_, _| 9.0);
    let has = |source| {
        let mesh = requested(&ply, source).unwrap();
        (mesh.colors.is_some(), mesh.face_colors.is_some(), mesh.property.is_some())
    };
    assert_eq!(has(ColorChoice::Any), (true, false, false));
    assert_eq!(has(ColorChoice::Vertices), (true, false, false));
    assert_eq!(has(ColorChoice::Faces), (false, true, false));
    assert_eq!(has(ColorChoice::Nothing), (false, false, false));
    assert_eq!(has(ColorChoice::Property("red")), (false, false, true));
}

#[test]
fn alpha_is_stored_only_where_it_matters() {
    let more = [&RGB[..], &["uchar alpha"]].concat();
    let alpha = |value: fn(usize) -> f64| {
        let ply = vertices(3, &more, move |i, k| if k == 3 { value(i) } else { 7.0 });
        let mesh = read_all(&ply.faces(&[&[0, 1, 2]]));
        assert!(mesh.colors.is_some());
        (mesh.alpha, mesh.notes.alpha_ignored)
    };
    assert!(matches!(alpha(|_| 255.0), (None, false)));
    assert!(matches!(alpha(|_| 0.0), (None, true)));
    let (Some(Scalars::U8(all)), false) = alpha(|i| 100.0 * i as f64) else { panic!("alpha") };
    assert_eq!(all, [0, 100, 200]);
    // Another type than that of the colours.
    let more = [&RGB[..], &["float alpha"]].concat();
    let mesh = read_all(&vertices(3, &more, |_, _| 1.0).faces(&[&[0, 1, 2]]));
    assert!(mesh.alpha.is_none() && mesh.notes.ignored == ["vertex.alpha"]);
}

#[test]
fn each_triple_of_colours_takes_alpha_by_several_names() {
    let diffuse = ["diffuse_red", "diffuse_green", "diffuse_blue"];
    // `diffuse_alpha` belongs to its own colours only.
    for (rgb, alphas) in [
        (["red", "green", "blue"], ["alpha", "a", "diffuse_alpha"]),
        (["r", "g", "b"], ["a", "alpha", "diffuse_alpha"]),
        (diffuse, ["diffuse_alpha", "alpha", "a"]),
    ] {
        let read = |alphas: &[&str]| {
            let typed = rgb.iter().map(|name| format!("uchar {name}"));
            let typed = typed.chain(alphas.iter().map(|alpha| format!("uchar {alpha}")));
            let typed: Vec<String> = typed.collect();
            let more: Vec<&str> = typed.iter().map(String::as_str).collect();
            read_all(&vertices(3, &more, |_, k| 10.0 * k as f64).faces(&[&[0, 1, 2]]))
        };
        for alpha in alphas {
            let mesh = read(&[alpha]);
            let ignored = alpha == "diffuse_alpha" && rgb != diffuse;
            assert_eq!(mesh.alpha.is_none(), ignored, "{rgb:?} {alpha}");
            assert_eq!(mesh.notes.ignored.is_empty(), !ignored, "{rgb:?} {alpha}");
        }
        // The usual name comes first, wherever it stands.
        let [usual, other, _] = alphas;
        for (pair, value) in [([usual, other], 30), ([other, usual], 40)] {
            let Some(Scalars::U8(all)) = read(&pair).alpha else { panic!("alpha") };
            assert_eq!(all, [value; 3], "{rgb:?} {pair:?}");
        }
    }
}

#[test]
fn scalars_of_every_type_keep_their_values() {
    let kinds = [
        ("char", -7.0),
        ("uchar", 200.0),
        ("short", -300.0),
        ("ushort", 65000.0),
        ("int", -2_000_000_001.0),
        ("uint", 4_000_000_001.0),
        ("float", 0.25),
        ("double", 1_700_000_000.125),
    ];
    for (kind, value) in kinds {
        let property = format!("{kind} quality");
        let of_vertices = vertices(3, &[&property], |i, _| value - (i % 2) as f64);
        let of_vertices = of_vertices.faces(&[&[0, 1, 2]]);
        for name in ["quality", "vertex.quality"] {
            let mesh = requested(&of_vertices, ColorChoice::Property(name)).unwrap();
            assert_eq!(values(&mesh), [value, value - 1.0, value], "{kind}");
            let property = mesh.property.unwrap();
            assert_eq!(
                (property.name.as_str(), property.element),
                ("quality", MeshElement::Vertex)
            );
        }
        let faces: [&[i64]; 2] = [&[0, 1, 2], &[1, 2, 3]];
        let of_faces = with_faces(vertices(4, &[], |_, _| 0.0), &faces, &[&property], |i, _| {
            value - (i % 2) as f64
        });
        let mesh = requested(&of_faces, ColorChoice::Property("quality")).unwrap();
        assert_eq!(values(&mesh), [value, value - 1.0], "{kind}");
        assert_eq!(mesh.property.unwrap().element, MeshElement::Face);
        // Without a request the property is skipped.
        assert_eq!(read_all(&of_vertices).notes.ignored, ["vertex.quality"]);
    }
}

#[test]
fn a_name_with_dots_is_kept_whole() {
    for (property, request) in [("quality.v2", "quality.v2"), ("std.dev.", "vertex.std.dev.")] {
        let declared = format!("float {property}");
        let ply = vertices(3, &[&declared], |i, _| i as f64).faces(&[&[0, 1, 2]]);
        let mesh = requested(&ply, ColorChoice::Property(request)).unwrap();
        assert_eq!(mesh.property.unwrap().name, property);
    }
}

#[test]
fn a_property_that_has_another_use_can_be_shown_too() {
    let more = ["float nx", "float ny", "float nz"];
    let ply = vertices(4, &more, |i, k| (i + k) as f64).faces(&[&[0, 1, 2], &[1, 2, 3]]);
    let mesh = requested(&ply, ColorChoice::Property("y")).unwrap();
    assert_eq!(values(&mesh), [0.0, 1.0, 4.0, 9.0]);
    let mesh = requested(&ply, ColorChoice::Property("nz")).unwrap();
    assert_eq!(values(&mesh), [2.0, 3.0, 4.0, 5.0]);
    assert!(mesh.normals.is_some());
    let ply = with_faces(
        vertices(4, &[], |_, _| 0.0),
        &[&[0, 1, 2], &[1, 2, 3]],
        &["int texnumber"],
        |i, _| i as f64,
    );
    let mesh = requested(&ply, ColorChoice::Property("texnumber")).unwrap();
    assert_eq!(values(&mesh), [0.0, 1.0]);
}

#[test]
fn requests_that_a_file_cannot_meet() {
    let ply = vertices(3, &["float quality", "list uchar float weights"], |_, _| 0.0);
    let mut ply = with_faces(ply, &[&[0, 1, 2]], &["float area"], |_, _| 0.0);
    for row in &mut ply.elements[0].2 {
        row[4] = V::L(vec![1.0]);
    }
    let lists = "its scalar properties are vertex.x, vertex.y, vertex.z, vertex.quality, face.area";
    for (source, message, help) in [
        (ColorChoice::Vertices, "t.ply has no colours of its vertices", lists),
        (ColorChoice::Faces, "t.ply has no colours of its faces", lists),
        (
            ColorChoice::Property("qualty"),
            "t.ply has no scalar property \"qualty\"",
            "did you mean `quality`? its scalar properties are vertex.x",
        ),
        (ColorChoice::Property("weights"), "t.ply has no scalar property \"weights\"", lists),
    ] {
        let error = requested(&ply, source).unwrap_err();
        assert_eq!(error.exit_code(), 2);
        let text = error.to_string();
        assert!(text.contains(&format!("t.ply: {message}")) && text.contains(help), "{text}");
    }
    let options = ReadOptions::default();
    let request = ColorRequest { source: ColorChoice::Faces, place: "s.json:3:9" };
    let bytes = ply.write(ALL[0]);
    let error = read_ply_bytes(&bytes, "t.ply", options.color(request)).unwrap_err().to_string();
    assert!(error.starts_with("error: s.json:3:9: t.ply has no colours"), "{error}");
    assert!(read(&bytes).is_ok());
}

#[test]
fn points_are_read_without_their_faces() {
    let more = [&RGB[..], &["float nx", "float ny", "float nz", "float quality"]].concat();
    let ply = vertices(5, &more, |i, k| (10 * k + i) as f64);
    let with_faces = ply.clone().faces(&[&[0, 1, 2], &[0, 1, 99]]);
    let with_areas = self::with_faces(ply.clone(), &[&[0, 1, 2]], &["float area"], |_, _| 0.0);
    for (ply, has_area) in [(&ply, false), (&with_faces, false), (&with_areas, true)] {
        for encoding in ALL {
            let bytes = ply.write(encoding);
            let options = ReadOptions::default().points(true);
            let mesh = read_ply_bytes(&bytes, "t.ply", options).unwrap();
            assert!(mesh.is_cloud() && mesh.normals.is_none() && mesh.positions.len() == 5);
            let Some(Colors::U8(colors)) = &mesh.colors else { panic!("colours") };
            assert_eq!(colors[4], [4, 14, 24]);
            assert_eq!(mesh.used_vertices(), [true; 5]);
            let color = ColorRequest { source: ColorChoice::Property("quality"), place: "" };
            let mesh = read_ply_bytes(&bytes, "t.ply", options.color(color)).unwrap();
            assert_eq!(values(&mesh), [60.0, 61.0, 62.0, 63.0, 64.0]);
            let color = ColorRequest { source: ColorChoice::Faces, place: "" };
            assert!(read_ply_bytes(&bytes, "t.ply", options.color(color)).is_err());
            let color = ColorRequest { source: ColorChoice::Property("face.area"), place: "" };
            let error = read_ply_bytes(&bytes, "t.ply", options.color(color)).unwrap_err();
            let of_faces = error.to_string().contains("is a property of faces");
            assert_eq!(of_faces, has_area, "{error}");
        }
    }
}

#[test]
fn points_that_are_not_finite_are_refused_or_dropped() {
    let mut ply = vertices(5, &RGB, |i, _| i as f64);
    ply.elements[0].2[1][2] = V::N(f64::NAN);
    ply.elements[0].2[3][0] = V::N(f64::INFINITY);
    for encoding in [ALL[1], ALL[2]] {
        let bytes = ply.write(encoding);
        let options = ReadOptions::default().points(true);
        let error = read_ply_bytes(&bytes, "t.ply", options).unwrap_err();
        let text = error.to_string();
        assert_eq!(error.exit_code(), 2);
        let message = "t.ply: vertex 1: (1, 1, NaN) is not finite; such points in all: 2";
        assert!(text.contains(message) && text.contains("--repair drops the 2"), "{text}");
        let mesh = read_ply_bytes(&bytes, "t.ply", options.repair(true)).unwrap();
        let Some(Colors::U8(colors)) = &mesh.colors else { panic!("colours") };
        assert_eq!(colors[..], [[0; 3], [2; 3], [4; 3]]);
        assert_eq!((mesh.positions.len(), mesh.notes.repaired_dropped), (3, 2));
    }
    let none = Ply::new().element("vertex", &XYZ, Vec::new()).write(ALL[1]);
    let error = read_ply_bytes(&none, "t.ply", ReadOptions::default().points(true)).unwrap_err();
    assert!(error.to_string().contains("t.ply: has no points"), "{error}");
}
