//! A mesh alone in the studio: settings decide which data of its file are read.

use lightpath::error::Error;
use lightpath::mesh::{Colors, Scalars};
use lightpath::monitor::Monitor;
use lightpath::{Film, LoadedScene, Mesh, Views};

/// A square of two triangles. Vertices are blue, faces green.
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
    property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
    property float q\nelement face 2\nproperty list uchar int vertex_indices\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n\
    -1 0 0 0 0 255 3\n1 0 0 0 0 255 3\n1 2 0 0 0 255 3\n-1 2 0 0 0 255 3\n\
    3 0 1 2 0 255 0\n3 0 2 3 0 255 0\n";

/// Returns the albedo in the middle of the picture.
fn albedo(film: &Film) -> [f32; 3] {
    let of = |name| film.planes.float(film.planes.index(name).unwrap(), 16 * 8 + 8);
    ["albedo.R", "albedo.G", "albedo.B"].map(of)
}

fn sets<'a>(more: &'a [&'a str]) -> Vec<&'a str> {
    let small = ["/camera/width=16", "/camera/height=16", "/spp=1", r#"/output/layers=["albedo"]"#];
    small.iter().chain(more).copied().collect()
}

#[test]
fn settings_decide_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("both.ply");
    std::fs::write(&path, PLY).unwrap();
    let read = |more: &[&str]| {
        let mut views = Views::of_file(&path);
        views.render(&sets(more), &Monitor::default()).unwrap().0
    };
    assert_eq!(albedo(&read(&[])), [0.0, 0.0, 1.0]);
    assert_eq!(albedo(&read(&["/scene/shapes/0/color=face"])), [0.0, 1.0, 0.0]);
    let property = r#"/scene/shapes/0/color={"property":"q","range":[0,3],"map":"greys"}"#;
    assert_eq!(albedo(&read(&[property])), [0.0; 3]);
    read(&["/scene/shapes/0/points=0.1"]);
    std::fs::write(
        &path,
        PLY.split_inclusive("element face").next().unwrap().replace(
            "element face",
            "end_header\n0 0 0 0 0 255 3\n1 0 0 0 0 255 3\n0 1 0 0 0 255 3\n0 0 1 0 0 255 3\n",
        ),
    )
    .unwrap();
    read(&["/scene/shapes/0/points=0.1"]);
}

#[test]
fn meshes_from_memory_have_what_the_settings_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("both.ply");
    std::fs::write(&path, PLY).unwrap();
    let show = |change: fn(&mut Mesh), more: &str| -> Result<[f32; 3], Error> {
        let mut mesh = Mesh::read(&path).unwrap();
        change(&mut mesh);
        let loaded = LoadedScene::of_mesh_in_studio(mesh, &sets(&[more]))?;
        loaded.renderer()?.render().map(|film| albedo(&film))
    };
    let refused = |change: fn(&mut Mesh), more: &str, message: &str| {
        let error = show(change, more).unwrap_err().to_string();
        assert!(error.contains(message), "{error}");
    };
    let face = "/scene/shapes/0/color=face";
    refused(|_| {}, face, "has no colours of its faces");
    refused(|_| {}, r#"/scene/shapes/0/color={"property":"q"}"#, "without its property \"q\"");
    refused(|_| {}, "/scene/shapes/0/points=0.1", "was not read as points");
    refused(|mesh| mesh.colors = None, "/scene/shapes/0/color=vertex", "no colours of its vert");
    // Alpha belongs to the colours of the vertices: the mesh has more triangles than alphas.
    let both = |mesh: &mut Mesh| {
        let triangles = mesh.triangles.repeat(9);
        mesh.face_colors = Some(Colors::U8(vec![[0, 255, 0]; triangles.len()]));
        mesh.triangles = triangles;
        mesh.alpha = Some(Scalars::U8(vec![51; 4]));
    };
    assert_eq!(show(both, face).unwrap(), [0.0, 1.0, 0.0]);
    let faded = show(both, "/scene/shapes/0/color=vertex").unwrap();
    assert!((faded[0] - 0.8).abs() < 1e-6 && faded[2] == 1.0, "{faded:?}");
}
