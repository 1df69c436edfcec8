//! Every layout that a PLY file may have, in all three encodings.

use crate::support::ply_writer::{ALL, Encoding, Ply, V, lists, numbers, points, read, read_all};
use lightpath::mesh::{Colors, Positions, ReadOptions, Uvs, read_ply, read_ply_bytes};

#[test]
fn triangles() {
    let mesh = read_all(&Ply::new().curve(4).faces(&[&[0, 1, 2], &[2, 1, 3]]));
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(points(&mesh)[3], [3.0, 9.0, 0.5]);
    assert!(matches!(mesh.positions, Positions::F32(_)));
    assert!(mesh.normals.is_none() && mesh.uvs.is_none() && mesh.colors.is_none());
    assert_eq!((mesh.notes.faces, mesh.notes.polygons_split, mesh.notes.trailing_bytes), (2, 0, 0));
    assert_eq!(mesh.notes.used, ["vertex.x", "vertex.y", "vertex.z", "face.vertex_indices"]);
    assert!(mesh.notes.ignored.is_empty());
}

#[test]
fn every_count_and_index_type_and_alias() {
    let counts = [
        "char", "uchar", "short", "ushort", "int", "uint", "int8", "uint8", "int16", "uint16",
        "int32", "uint32",
    ];
    for count in counts {
        for item in counts {
            for (name, faces) in [
                ("vertex_indices", vec![&[0, 1, 2][..], &[1, 2, 3]]),
                ("vertex_index", vec![&[0, 1, 2][..], &[3, 2, 1, 0]]),
            ] {
                let property = format!("list {count} {item} {name}");
                let ply = Ply::new().curve(4).element("face", &[&property], lists(&faces));
                let mesh = read_all(&ply);
                assert_eq!(mesh.triangles.len(), faces.iter().map(|f| f.len() - 2).sum::<usize>());
            }
        }
    }
}

#[test]
fn coordinates_of_every_type_in_any_order() {
    for (kind, double) in [
        ("char", false),
        ("uchar", false),
        ("short", false),
        ("ushort", false),
        ("float32", false),
        ("int", true),
        ("uint", true),
        ("float64", true),
    ] {
        let properties = [
            &format!("{kind} z"),
            "uchar flag",
            &format!("{kind} x"),
            "int id",
            &format!("{kind} y"),
        ];
        let rows = numbers(&[[3., 1., 1., 7., 2.], [6., 1., 4., 7., 5.], [9., 1., 7., 7., 100.]]);
        let mesh = read_all(&Ply::new().element("vertex", &properties, rows).faces(&[&[0, 1, 2]]));
        assert_eq!(points(&mesh), [[1., 2., 3.], [4., 5., 6.], [7., 100., 9.]]);
        assert_eq!(matches!(mesh.positions, Positions::F64(_)), double, "{kind}");
        assert_eq!(mesh.notes.ignored, ["vertex.flag", "vertex.id"]);
    }
}

#[test]
fn doubles_keep_their_millimetres() {
    let rows = [
        [4_500_000.001, 500_000.002, 120.003],
        [4_500_001.1, 500_000.0, 120.0],
        [4_500_000.0, 500_001.7, 120.1],
    ];
    let xyz = ["double x", "double y", "double z"];
    let mesh = read_all(&Ply::new().element("vertex", &xyz, numbers(&rows)).faces(&[&[0, 1, 2]]));
    assert_eq!(points(&mesh), rows);
    // A single double is enough.
    let mixed = ["float x", "double y", "float z"];
    let mesh = read_all(
        &Ply::new()
            .element("vertex", &mixed, numbers(&[[1., 0.1, 0.], [2., 0.2, 0.], [1., 0.3, 0.]]))
            .faces(&[&[0, 1, 2]]),
    );
    assert_eq!(points(&mesh)[0], [1.0, 0.1, 0.0]);
}

#[test]
fn polygons_are_split() {
    let l_shape =
        [[0., 0., 0.], [2., 0., 0.], [2., 1., 0.], [1., 1., 0.], [1., 2., 0.], [0., 2., 0.]];
    let xyz = ["float x", "float y", "float z"];
    // The points three times, so that no triangle occurs twice.
    let points = [l_shape; 3].concat();
    let ply = |faces: &[&[i64]]| Ply::new().element("vertex", &xyz, numbers(&points)).faces(faces);
    // Only quads; then quads mixed with a convex pentagon, a concave hexagon, and faces without
    // area.
    let quads = read_all(&ply(&[&[0, 1, 2, 3], &[3, 2, 1, 0]]));
    assert_eq!(quads.triangles, [[0, 1, 2], [0, 2, 3], [3, 2, 1], [3, 1, 0]]);
    assert_eq!(quads.notes.polygons_split, 2);
    let hexagon = &[12, 13, 14, 15, 16, 17][..];
    let mixed = read_all(&ply(&[&[6, 7, 8], &[0, 1, 2, 4, 5], hexagon, &[], &[1], &[2, 99]]));
    assert_eq!(mixed.triangles[..4], [[6, 7, 8], [0, 1, 2], [0, 2, 4], [0, 4, 5]]);
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| points[i as usize]);
        ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
    };
    assert!(mixed.triangles[4..].iter().all(|t| area(t) > 0.0));
    assert_eq!(mixed.triangles[4..].iter().map(area).sum::<f64>(), 3.0);
    let notes = &mixed.notes;
    assert_eq!((notes.faces, notes.polygons_split, notes.faces_too_small), (6, 2, 3));
}

#[test]
fn triangles_without_area_are_dropped_and_counted() {
    let rows = [[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [0., 1., 0.], [0., 0., 0.]];
    let xyz = ["float x", "float y", "float z"];
    let vertices = || Ply::new().element("vertex", &xyz, numbers(&rows));
    for extra in [&[0i64, 1, 3, 3][..], &[0, 1, 3]] {
        let faces = [&[0, 1, 2][..], &[0, 1, 3], &[0, 4, 3], &[1, 1, 3], extra];
        let mesh = read_all(&vertices().faces(&faces));
        assert_eq!(mesh.triangles, [[0, 1, 3]]);
        assert_eq!(mesh.notes.duplicates_dropped, 1);
        assert_eq!(mesh.notes.degenerate_dropped, 3 + u64::from(extra.len() == 4));
    }
    // A tiny triangle is not degenerate.
    let tiny = [[0., 0., 0.], [1e-30, 0., 0.], [0., 1e-30, 0.]];
    let mesh = read_all(&Ply::new().element("vertex", &xyz, numbers(&tiny)).faces(&[&[0, 1, 2]]));
    assert_eq!(mesh.triangles.len(), 1);
}

#[test]
fn duplicate_triangles_are_dropped_and_counted() {
    // The same corners rotated and reversed, also of a quad. The vertices stay.
    let faces = [&[0, 1, 2][..], &[3, 1, 2], &[1, 2, 0], &[2, 1, 0], &[3, 2, 4, 1], &[0, 1, 4]];
    let mesh = read_all(&Ply::new().curve(7).faces(&faces));
    assert_eq!(mesh.triangles, [[0, 1, 2], [3, 1, 2], [3, 2, 4], [3, 4, 1], [0, 1, 4]]);
    assert_eq!(mesh.notes.duplicates_dropped, 2);
    assert_eq!(mesh.used_vertices(), [true, true, true, true, true, false, false]);
}

#[test]
fn the_texture_of_most_triangles_is_used() {
    let face = |corners: [f64; 3], number: f64| {
        vec![V::L(corners.to_vec()), V::L(vec![0.5; 6]), V::N(number)]
    };
    let properties =
        ["list uchar int vertex_indices", "list uchar float texcoord", "int texnumber"];
    let file = |numbers: [f64; 3]| {
        let corners = [[0., 1., 2.], [1., 2., 3.], [2., 3., 4.]];
        let rows = corners.into_iter().zip(numbers).map(|(c, n)| face(c, n)).collect();
        let names = [&b"comment TextureFile a.png"[..], b"comment TextureFile b.png"];
        let named = names.into_iter().fold(Ply::new().curve(5), |ply, name| ply.comment(name));
        named.element("face", &properties, rows)
    };
    let ply = |numbers| read_all(&file(numbers));
    for (numbers, name, textures) in [
        ([0., 0., 0.], "a.png", 1),
        ([1., 1., 1.], "b.png", 1),
        ([1., 0., 1.], "b.png", 2),
        ([-1., 1., -1.], "a.png", 1),
        ([1., 1., -1.], "b.png", 1),
    ] {
        let mesh = ply(numbers);
        assert_eq!(mesh.texture_file.as_deref(), Some(name));
        assert_eq!(mesh.notes.textures, textures);
        assert_eq!(mesh.textures.is_some(), numbers.iter().any(|&number| number != numbers[0]));
        if let Some(found) = mesh.textures {
            assert_eq!(found.files, ["a.png", "b.png"]);
            assert_eq!(found.indices, numbers.map(|n| if n < 0.0 { u16::MAX } else { n as u16 }));
        }
        assert!(mesh.notes.used.contains(&"face.texnumber".to_string()));
    }
    for (numbers, message) in [
        (
            [0., 7., 2.],
            "t.ply: face 1: texnumber 7 is out of range: the file names 2 textures (0 to 1); numbers out of range in all: 2",
        ),
        (
            [1., 1., -2.],
            "t.ply: face 2: texnumber -2 is out of range: the file names 2 textures (0 to 1); numbers out of range in all: 1",
        ),
    ] {
        for encoding in ALL {
            let bytes = file(numbers).write(encoding);
            let error = read(&bytes).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().contains(message), "{error}");
            let options = ReadOptions::default();
            let repaired = read_ply_bytes(&bytes, "t.ply", options.repair(true)).unwrap();
            let found = repaired.textures.expect("several textures").indices;
            assert!(found.contains(&u16::MAX) && found.len() == 3);
            let lost = numbers.iter().filter(|number| !(0.0..2.0).contains(*number)).count();
            assert_eq!(repaired.notes.textures_repaired, lost as u64);
            let kept = [0.0, 1.0].iter().filter(|file| numbers.contains(file)).count();
            assert_eq!(repaired.notes.textures, kept as u64);
            // Without the file's textures, the numbers are not needed.
            let other = read_ply_bytes(&bytes, "t.ply", options.textures(false)).unwrap();
            assert!(other.textures.is_none());
        }
    }
}

#[test]
fn texture_coordinates_under_all_names() {
    for [u, v] in [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]] {
        for kind in ["float", "double"] {
            let properties =
                ["float x", "float y", "float z", &format!("{kind} {v}"), &format!("{kind} {u}")];
            let rows =
                numbers(&[[0., 0., 0., 0.25, 0.5], [1., 0., 0., 0., 1.], [0., 1., 0., 1., 0.]]);
            let mesh =
                read_all(&Ply::new().element("vertex", &properties, rows).faces(&[&[0, 1, 2]]));
            match mesh.uvs {
                Some(Uvs::PerVertex(uvs)) => assert_eq!(uvs, [[0.5, 0.25], [1., 0.], [0., 1.]]),
                other => panic!("{other:?}"),
            }
        }
    }
}

#[test]
fn texture_coordinates_per_face() {
    let face = |corners: &[i64], uvs: &[f64]| {
        vec![
            V::N(7.0),
            V::L(uvs.to_vec()),
            V::L(corners.iter().map(|i| *i as f64).collect()),
            V::N(0.0),
        ]
    };
    let properties = [
        "uchar flags",
        "list uchar float texcoord",
        "list uchar int vertex_indices",
        "int texnumber",
    ];
    let quad = face(&[0, 1, 2, 3], &[0., 0., 0.5, 0., 0.5, 0.5, 0., 0.5]);
    let ply = Ply::new().comment(b"comment TextureFile  my texture.png ").curve(4).element(
        "face",
        &properties,
        vec![quad.clone(), face(&[1, 1, 2], &[1.; 6]), face(&[1, 2, 3], &[])],
    );
    let mesh = read_all(&ply);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [1, 2, 3]]);
    match mesh.uvs {
        Some(Uvs::PerCorner(uvs)) => assert_eq!(
            uvs,
            [[[0., 0.], [0.5, 0.], [0.5, 0.5]], [[0., 0.], [0.5, 0.5], [0., 0.5]], [[0.; 2]; 3]]
        ),
        other => panic!("{other:?}"),
    }
    assert_eq!(mesh.texture_file.as_deref(), Some("my texture.png"));
    assert_eq!(mesh.notes.ignored, ["face.flags"]);
    // If all lists are empty, the mesh has no coordinates.
    let bare = Ply::new().curve(4).element("face", &properties, vec![face(&[1, 2, 3], &[])]);
    assert!(read_all(&bare).uvs.is_none());
}

#[test]
fn normals_and_colours() {
    for (names, kind) in [
        (["red", "green", "blue"], "uchar"),
        (["r", "g", "b"], "ushort"),
        (["diffuse_red", "diffuse_green", "diffuse_blue"], "float"),
        (["red", "green", "blue"], "double"),
    ] {
        let mut properties: Vec<String> =
            ["x", "y", "z", "nx", "ny", "nz"].map(|n| format!("float {n}")).into();
        properties.extend(names.map(|n| format!("{kind} {n}")));
        properties.push("uchar alpha".into());
        let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
        let row = |x: f64, y: f64| [x, y, 0., 0., 0.5, 2., 1., 2., 200., 255.];
        let rows = numbers(&[row(0., 0.), row(1., 0.), row(0., 1.)]);
        let mesh = read_all(&Ply::new().element("vertex", &properties, rows).faces(&[&[0, 1, 2]]));
        assert_eq!(mesh.normals.unwrap(), [[0., 0.5, 2.]; 3]);
        match (kind, mesh.colors.unwrap()) {
            ("uchar", Colors::U8(c)) => assert_eq!(c, [[1, 2, 200]; 3]),
            ("ushort", Colors::U16(c)) => assert_eq!(c, [[1, 2, 200]; 3]),
            ("float" | "double", Colors::F32(c)) => assert_eq!(c, [[1., 2., 200.]; 3]),
            other => panic!("{other:?}"),
        }
        // The alpha has the type of the colours only in the first case; there it is opaque.
        let ignored = mesh.notes.ignored == ["vertex.alpha"];
        assert!(mesh.alpha.is_none() && ignored == (kind != "uchar"));
    }
}

#[test]
fn strips() {
    let strips = lists(&[&[0, 1, 2, 3, -1, 4, 5, 6, 6, 7, -1, -1, 1, 2], &[], &[7, 6, 5]]);
    let ply = Ply::new().curve(8).element("tristrips", &["list int int vertex_indices"], strips);
    let mesh = read_all(&ply);
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [4, 5, 6], [7, 6, 5]]);
    assert_eq!((mesh.notes.faces, mesh.notes.degenerate_dropped), (6, 2));
    // A part of fewer than three indices makes no triangle, so its indices are not checked.
    let short = lists(&[&[0, 1, 2], &[0, 99], &[98, -1, 3, 97, -1, 3, 4, 5]]);
    let ply = Ply::new().curve(8).element("tristrips", &["list int int vertex_indices"], short);
    assert_eq!(read_all(&ply).triangles, [[0, 1, 2], [3, 4, 5]]);
    // Strips beside faces, in the order of the file, with unsigned restarts.
    let strips = lists(&[&[0, 1, 2, u32::MAX as i64, 1, 2, 3]]);
    let both = Ply::new()
        .element("tristrips", &["list uint uint vertex_index"], strips)
        .curve(8)
        .faces(&[&[5, 6, 7]]);
    assert_eq!(read_all(&both).triangles, [[0, 1, 2], [1, 2, 3], [5, 6, 7]]);
}

#[test]
fn other_elements_orders_and_properties() {
    let edges = vec![vec![V::N(1.0), V::L(vec![0.5, 2.0])], vec![V::N(2.0), V::L(vec![])]];
    let face = |value: f64, corners: &[f64]| {
        vec![V::N(value), V::L(corners.to_vec()), V::L(vec![9.0; value as usize])]
    };
    let vertex = |x: f64, list: &[f64]| vec![V::L(list.to_vec()), V::N(x), V::N(x * x), V::N(0.0)];
    let ply = Ply::new()
        .element("edge", &["short a", "list uchar double b"], edges.clone())
        .element("nothing", &[], vec![])
        .element(
            "face",
            &["double quality", "list uchar uint vertex_indices", "list char short tags"],
            vec![face(2.0, &[0., 1., 2.]), face(0.0, &[2., 1., 3.])],
        )
        .element(
            "vertex",
            &["list uint uchar junk", "float x", "float y", "float z"],
            vec![vertex(1., &[]), vertex(2., &[1., 2.]), vertex(3., &[3.]), vertex(4., &[])],
        )
        .element("tail", &["list int8 float64 b"], vec![vec![V::L(vec![1.0; 3])]]);
    let mesh = read_all(&ply);
    assert_eq!(points(&mesh)[2], [3.0, 9.0, 0.0]);
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(
        mesh.notes.ignored,
        ["edge.a", "edge.b", "face.quality", "face.tags", "vertex.junk", "tail.b"]
    );
}

#[test]
fn unusual_headers_are_read() {
    let plain = Ply::new().curve(4).faces(&[&[0, 1, 2]]);
    let fancy = plain
        .clone()
        .comment(b"comment")
        .comment(b"comment \xff\xfe\x00\x01 binary \x80 junk")
        .comment(b"obj_info num_cols 512")
        .comment(b"comment TextureFiles no.png")
        .comment(b" \tcomment TextureFile a.png")
        .comment(b"comment TextureFile b.png");
    for encoding in ALL {
        let mesh = read(&fancy.write(encoding)).unwrap();
        assert_eq!(mesh.texture_file.as_deref(), Some("a.png"));
        // CRLF, also in the data of a text file.
        let bytes = fancy.write(encoding);
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        let (head, data) = bytes.split_at(end);
        let crlf = |bytes: &[u8]| {
            bytes
                .iter()
                .flat_map(|&b| if b == b'\n' { vec![b'\r', b] } else { vec![b] })
                .collect::<Vec<u8>>()
        };
        let mut both = crlf(head);
        both.extend(if encoding == Encoding::Ascii { crlf(data) } else { data.to_vec() });
        let crlf = read(&both).unwrap();
        assert_eq!((crlf.triangles, crlf.texture_file), (mesh.triangles, mesh.texture_file));
        // Bytes that belong to no element.
        let mut long = bytes.clone();
        long.extend(b"4 5 6\n");
        assert_eq!(read(&long).unwrap().notes.trailing_bytes, 6);
    }
}

#[test]
fn unusual_text_is_read() {
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty double y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let body = "\n  1e0 -2.50E+1\t.5 \r\n\n+1 1.e-3 0.1000000000000000000000001\n0 123456789012345678901 -0\n\n \t\n3 0 1 2   ";
    let mesh = read(format!("{head}{body}").as_bytes()).unwrap();
    let expected =
        [[1.0, -25.0, 0.5], [1.0, 0.001, 0.1f32 as f64], [0.0, 123456789012345678901.0, -0.0]];
    assert_eq!(points(&mesh), expected);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
}

#[test]
fn many_rows_in_many_blocks() {
    let rows: Vec<[f64; 3]> =
        (0..60_000).map(|i| [(i % 300) as f64, (i / 300) as f64, (i % 7) as f64 / 3.0]).collect();
    let quads: Vec<Vec<i64>> = (0..59_699)
        .filter(|i| i % 300 != 299)
        .map(|i| match i % 5 {
            0 => vec![i, i + 1, i + 300],
            1 => vec![],
            _ => vec![i, i + 1, i + 301, i + 300],
        })
        .collect();
    let triangles: Vec<Vec<i64>> =
        quads.iter().map(|q| if q.len() < 3 { vec![0, 0, 0] } else { q[..3].to_vec() }).collect();
    for faces in [quads, triangles] {
        let faces: Vec<&[i64]> = faces.iter().map(Vec::as_slice).collect();
        let ply = Ply::new()
            .element("vertex", &["float x", "float y", "float z"], numbers(&rows))
            .faces(&faces);
        let mesh = read_all(&ply);
        let expected: Vec<[u32; 3]> = faces
            .iter()
            .filter(|f| f.len() >= 3 && f[0] != f[1])
            .flat_map(|f| (1..f.len() - 1).map(|i| [f[0] as u32, f[i] as u32, f[i + 1] as u32]))
            .collect();
        assert_eq!(mesh.triangles, expected);
        for (point, row) in points(&mesh).iter().zip(&rows) {
            assert_eq!(*point, row.map(|c| c as f32 as f64));
        }
    }
}

#[test]
fn repair_drops_triangles_with_invalid_vertices_or_indices() {
    let rows = [
        [0., 0., 0.],
        [1., 0., 0.],
        [0., 1., 0.],
        [f64::NAN, 0., 0.],
        [0., f64::INFINITY, 0.],
        [1., 1., 0.],
    ];
    let xyz = ["float x", "float y", "float z"];
    let faces = [
        &[0, 1, 2][..],
        &[0, 1, 3],
        &[1, 4, 2],
        &[0, 1, 9],
        &[-1, 1, 2],
        &[0, 1, 5, 3],
        &[0, 1, 2, 3, 5],
        &[0, 1, 5, 2, 77],
    ];
    for mixed in [true, false] {
        let faces: Vec<&[i64]> = faces.iter().filter(|f| mixed || f.len() == 3).copied().collect();
        let ply = Ply::new().element("vertex", &xyz, numbers(&rows)).faces(&faces);
        for encoding in ALL {
            let mesh =
                read_ply_bytes(&ply.write(encoding), "t.ply", ReadOptions::default().repair(true))
                    .unwrap();
            let kept = if mixed { vec![[0, 1, 2], [0, 1, 5]] } else { vec![[0, 1, 2]] };
            assert_eq!(mesh.triangles, kept);
            assert_eq!(mesh.notes.repaired_dropped, if mixed { 11 } else { 4 });
        }
    }
    // Invalid vertices that no face uses, or only a face without area, do no harm.
    let harmless = Ply::new().element("vertex", &xyz, numbers(&rows)).faces(&[
        &[0, 1, 2],
        &[3, 3, 4],
        &[4, 3],
    ]);
    for encoding in ALL {
        assert_eq!(read(&harmless.write(encoding)).unwrap().triangles.len(), 1);
    }
    // Huge coordinates are finite, though the area is not.
    let huge = [[0., 0., 0.], [1e200, 0., 0.], [0., 1e200, 1e200]];
    let ply = Ply::new()
        .element("vertex", &["double x", "double y", "double z"], numbers(&huge))
        .faces(&[&[0, 1, 2]]);
    assert_eq!(read_all(&ply).triangles.len(), 1);
}

#[test]
fn from_disk_mapped_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    for encoding in ALL {
        std::fs::write(&path, Ply::new().curve(4).faces(&[&[0, 1, 2]]).write(encoding)).unwrap();
        let mapped = read_ply(&path, ReadOptions::default()).unwrap();
        let read = read_ply(&path, ReadOptions::default().mmap(false)).unwrap();
        assert_eq!(format!("{mapped:?}"), format!("{read:?}"));
    }
}

/// Reads positions beyond 4 GiB from a sparse file, of which only the ends are stored.
#[cfg(target_os = "linux")]
#[test]
fn beyond_four_gibibytes() {
    use std::os::unix::fs::FileExt;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sparse.ply");
    let gap = 5u64 << 30;
    let whole =
        Ply::new().element("gap", &["uchar a"], vec![]).curve(4).faces(&[&[0, 1, 2], &[1, 2, 3]]);
    let text = whole.write(Encoding::Little);
    let end = text.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8(text[..end].to_vec())
        .unwrap()
        .replace("element gap 0", &format!("element gap {gap}"));
    let file = std::fs::File::create(&path).unwrap();
    file.write_all_at(header.as_bytes(), 0).unwrap();
    file.write_all_at(&text[end..], header.len() as u64 + gap).unwrap();
    let mesh = read_ply(&path, ReadOptions::default()).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [1, 2, 3]]);
}
