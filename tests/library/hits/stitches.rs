//! Triangles without area that close T-junctions. A mesh closed by them stays closed wherever it is
//! placed.

use std::fmt::Write as _;
use std::path::Path;

use crate::support::backends::{self, on_both};
use crate::support::program::Scratch;
use glam::{DVec3, Vec3};
use lightpath::film::{ReservedFilm, Window};
use lightpath::geometry::{Surfaces, refine};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Mask, RayPacket};
use lightpath::render;
use lightpath::scene::{self, Backend, Source};
use lightpath::world::{LoadOptions, World};
use serde_json::{Value, json};

/// Number of points on each edge that are vertices of only one of the edge's two faces.
const BETWEEN: usize = 3;

/// Number of rays per edge, from inside.
const RAYS: usize = 1001;

/// A closed polyhedron around the origin with T-junctions on all edges.
struct Solid {
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// Triangles without area that close the T-junctions.
    stitches: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
}

impl Solid {
    /// Builds a solid from convex faces. Each becomes a fan around its middle. Of the two faces at
    /// an edge, the second one uses the points on the edge. Coordinates are multiples of 4 (BETWEEN
    /// + 1), so everything is exact.
    fn new(corners: &[[f64; 3]], faces: &[&[u32]]) -> Self {
        let mut vertices: Vec<DVec3> = corners.iter().map(|&c| DVec3::from(c)).collect();
        let (mut triangles, mut stitches) = (Vec::new(), Vec::new());
        let mut edges: Vec<[u32; 2]> = Vec::new();
        for face in faces {
            let sum: DVec3 = face.iter().map(|&c| DVec3::from(corners[c as usize])).sum();
            let middle = vertices.len() as u32;
            vertices.push(sum / face.len() as f64);
            for k in 0..face.len() {
                let (a, b) = (face[k], face[(k + 1) % face.len()]);
                if !edges.contains(&[b, a]) {
                    edges.push([a, b]);
                    triangles.push([middle, a, b]);
                    continue;
                }
                let (pa, pb) = (vertices[a as usize], vertices[b as usize]);
                let mut chain = vec![a];
                for i in 1..=BETWEEN {
                    chain.push(vertices.len() as u32);
                    vertices.push(pa + (pb - pa) * (i as f64 / (BETWEEN + 1) as f64));
                }
                chain.push(b);
                triangles.extend(chain.windows(2).map(|pair| [middle, pair[0], pair[1]]));
                // Edge of the other face and chain of this one, joined by a fan without area.
                let fan = chain[1..].windows(2).map(|pair| [a, pair[1], pair[0]]);
                stitches.extend(fan);
            }
        }
        Self { vertices, triangles, stitches, edges }
    }

    fn cube() -> Self {
        let corners: [[f64; 3]; 8] = std::array::from_fn(|k| {
            [0, 1, 2].map(|bit| if k >> bit & 1 == 0 { -48.0 } else { 48.0 })
        });
        let faces: [&[u32]; 6] = [
            &[4, 5, 7, 6],
            &[1, 0, 2, 3],
            &[5, 1, 3, 7],
            &[0, 4, 6, 2],
            &[6, 7, 3, 2],
            &[0, 1, 5, 4],
        ];
        Self::new(&corners, &faces)
    }

    fn tetrahedron() -> Self {
        let corners = [[48., 48., 48.], [48., -48., -48.], [-48., 48., -48.], [-48., -48., 48.]];
        Self::new(&corners, &[&[0, 1, 2], &[0, 2, 3], &[0, 3, 1], &[3, 2, 1]])
    }

    /// Returns true if every edge, including those of stitches, has a triangle on either side.
    fn is_closed(&self) -> bool {
        let mut edges = std::collections::HashMap::new();
        for [a, b, c] in self.triangles.iter().chain(&self.stitches) {
            for (p, q) in [(a, b), (b, c), (c, a)] {
                *edges.entry([p.min(q), p.max(q)]).or_insert(0) += 1;
            }
        }
        edges.values().all(|&n| n == 2)
    }

    /// Writes the mesh, with its stitches among the other faces or without them.
    fn write(&self, path: &Path, stitched: bool, kind: &str) {
        let mut faces = Vec::new();
        for (k, triangle) in self.triangles.iter().enumerate() {
            faces.push(*triangle);
            faces.extend(self.stitches.get(k).filter(|_| stitched));
        }
        let mut text = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty {kind} x\nproperty {kind} y\n\
             property {kind} z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
            self.vertices.len(),
            faces.len()
        );
        for v in &self.vertices {
            writeln!(text, "{} {} {}", v.x, v.y, v.z).unwrap();
        }
        for [a, b, c] in faces {
            writeln!(text, "3 {a} {b} {c}").unwrap();
        }
        std::fs::write(path, text).unwrap();
    }
}

fn load(folder: &Path, mesh: &Value) -> (World, Vec<String>) {
    let mut shape = json!({ "type": "trimesh", "path": "solid.ply", "material": { "ks": 0.3 } });
    shape.as_object_mut().unwrap().extend(mesh.as_object().unwrap().clone());
    let text = json!({
        "camera": { "type": "pinhole", "width": 64, "height": 48, "fov": 90, "position": [0.1, 0.2, 0.3],
                    "target": [1, 2, 1.5], "up": [0, 0, 1] },
        "scene": { "backgroundcolor": [9, 9, 9], "shapes": [shape], "lightsources": [
            { "type": "pointlight", "position": [0.2, -0.1, 0.1], "id": [1, 1, 1] }] }
    })
    .to_string();
    let source = Source::Text { name: "test", text: text.as_bytes(), folder };
    let scene = scene::load(source, &[]).unwrap().scene;
    let (world, warnings) =
        World::load(&scene, LoadOptions::default(), &Monitor::default()).unwrap();
    (world, warnings.iter().map(|warning| warning.to_string()).collect())
}

/// Shoots rays from near the middle at points of the edges. Returns the misses, and the packets
/// that hit a stitch.
fn shoot(world: &World, solid: &Solid, backend: Backend) -> (usize, Vec<(Mask, RayPacket)>) {
    let accelerator = backends::build(&world.geometry, backend);
    let mesh = &world.geometry.meshes[0];
    let at = |v: u32| Vec3::from(mesh.vertices()[v as usize]).as_dvec3();
    let middle =
        solid.vertices.iter().enumerate().fold(DVec3::ZERO, |sum, (v, _)| sum + at(v as u32))
            / solid.vertices.len() as f64;
    let rays: Vec<(DVec3, DVec3)> = solid
        .edges
        .iter()
        .flat_map(|&[a, b]| {
            let (a, b) = (at(a), at(b));
            // Off every plane of symmetry, where differences to the corners are rounded.
            let odd = DVec3::new(0.0123, 0.0377, 0.0711) * (a - b).length() * 0.1;
            let from = (middle + (a - b) * 0.01 + odd).as_vec3().as_dvec3();
            (0..RAYS).map(move |i| (from, a.lerp(b, i as f64 / (RAYS - 1) as f64) - from))
        })
        .collect();
    let (mut missed, mut on_stitches) = (0, Vec::new());
    let ordinary = solid.triangles.len() as u32;
    for rays in rays.chunks(LANES) {
        let mut packet = RayPacket::EMPTY;
        let (mut active, mut stitched) = (Mask::NONE, Mask::NONE);
        for (i, (origin, direction)) in rays.iter().enumerate() {
            active.0[i] = -1;
            for axis in 0..3 {
                packet.rays.org[axis][i] = origin[axis] as f32;
                packet.rays.dir[axis][i] = direction[axis] as f32;
            }
        }
        accelerator.closest(&active, &mut packet, Coherence::Coherent);
        let hit = packet.hit(&active);
        missed += active.without(&hit).count() as usize;
        for i in (0..LANES).filter(|&i| hit.0[i] != 0 && packet.hits.prim[i] >= ordinary) {
            stitched.0[i] = -1;
        }
        if stitched.any() {
            on_stitches.push((stitched, packet));
        }
    }
    (missed, on_stitches)
}

/// Returns odd rotations, and places where single precision rounds.
fn places() -> Vec<Value> {
    let turns = [[13.0, 29.0, 47.0], [0.3, 0.7, 0.1], [90.0, 33.3, 0.0], [-71.0, 5.0, 160.0]];
    let mut places: Vec<Value> = turns.iter().map(|turn| json!({ "rotate": turn })).collect();
    places.push(json!({}));
    places.push(json!({ "rotate": [10, 20, 30], "fit": 0.7, "center": [3, -1, 2] }));
    places.push(json!({ "size": 0.037 }));
    places
}

#[test]
fn the_solids_are_closed() {
    for solid in [Solid::cube(), Solid::tetrahedron()] {
        assert!(solid.is_closed());
        assert_eq!(solid.stitches.len(), BETWEEN * solid.edges.len());
    }
}

#[test]
fn no_ray_leaves_through_a_t_junction() {
    let folder = tempfile::tempdir().unwrap();
    let mut kept = 0;
    for (solid, kind) in [(Solid::cube(), "float"), (Solid::tetrahedron(), "double")] {
        solid.write(&folder.path().join("solid.ply"), true, kind);
        for place in places() {
            let (world, _) = load(folder.path(), &place);
            // Without Embree: its own test leaks for rays aimed at edges.
            for backend in [Backend::default(), Backend::Brute] {
                let (missed, on_stitches) = shoot(&world, &solid, backend);
                let rays = RAYS * solid.edges.len();
                assert_eq!(missed, 0, "{backend:?}, {kind}, {place}: of {rays}");
                kept += on_stitches.len();
            }
        }
    }
    assert!(kept > 0, "the rays find what is between");
}

on_both! {
    /// A mesh that is not moved gives the same picture with and without stitches.
    fn a_mesh_without_rotation_is_unchanged(backend: Backend) {
        let folder = tempfile::tempdir().unwrap();
        let solid = Solid::cube();
        for place in
            [json!({}), json!({ "rotate": [90, 0, 180] }), json!({ "size": 0.25, "smooth": true })]
        {
            let pictures = [true, false].map(|stitched| {
                solid.write(&folder.path().join("solid.ply"), stitched, "float");
                let (world, _) = load(folder.path(), &place);
                let accelerator = backends::build(&world.geometry, backend);
                let window = Window::full(64, 48);
                let mut film = ReservedFilm::new(world.frame, window, Vec::new()).unwrap().film();
                let monitor = Monitor::default();
                render::render(&world, &*accelerator, backend.isa(), &mut film, &monitor).unwrap();
                film.pixels
            });
            assert_eq!(pictures[0], pictures[1], "{place}");
        }
    }
}

/// Normals, box and origin depend only on triangles with an area.
#[test]
fn stitches_change_no_normal_and_no_box() {
    let folder = tempfile::tempdir().unwrap();
    let solid = Solid::cube();
    let place = json!({ "rotate": [13, 29, 47], "fit": 2, "smooth": true });
    let [with, without] = [true, false].map(|stitched| {
        solid.write(&folder.path().join("solid.ply"), stitched, "float");
        load(folder.path(), &place)
    });
    let normals = |world: &World| world.shapes.shapes[0].normals.clone();
    assert_eq!(normals(&with.0), normals(&without.0));
    assert_eq!(with.0.geometry.origin, without.0.geometry.origin);
    let [many, few] = [&with.0, &without.0].map(|world| &world.geometry.meshes[0]);
    assert_eq!(many.vertices(), few.vertices());
    assert_eq!(many.triangles()[..few.triangles().len()], *few.triangles(), "they come last");
    let kept = many.triangles().len() - few.triangles().len();
    assert_eq!(kept, solid.stitches.len());
    let said = with.1.join("\n");
    assert!(said.contains(&format!("{kept} triangles without area are kept")), "{said}");
    assert!(!said.contains("dropped"), "{said}");
    assert_eq!(without.1, Vec::<String>::new());
}

/// The normal of a sliver is noise. A hit on it is shaded as on its neighbour.
#[test]
fn a_hit_on_a_stitch_counts_as_its_neighbour() {
    let folder = tempfile::tempdir().unwrap();
    let solid = Solid::cube();
    solid.write(&folder.path().join("solid.ply"), true, "float");
    let (world, _) = load(folder.path(), &json!({ "rotate": [13, 29, 47] }));
    let (_, on_stitches) = shoot(&world, &solid, Backend::Brute);
    let mut surfaces = Surfaces::EMPTY;
    let mut seen = 0;
    for (hit, mut packet) in on_stitches {
        world.geometry.replace_stitch_hits(&hit, &mut packet);
        refine(&world.geometry, &hit, &packet, &mut surfaces);
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            let prim = packet.hits.prim[i];
            assert!((prim as usize) < solid.triangles.len());
            let [a, b, c] =
                world.geometry.meshes[0].corners(prim).map(|v| Vec3::from(v).as_dvec3());
            let normal = (b - a).cross(c - a).normalize();
            let vector = |of: &[[f32; LANES]; 3]| {
                DVec3::new(of[0][i].into(), of[1][i].into(), of[2][i].into())
            };
            assert!((vector(&surfaces.ng).dot(normal).abs() - 1.0).abs() < 1e-6);
            let (origin, direction) = (vector(&packet.rays.org), vector(&packet.rays.dir));
            let met = origin + direction * f64::from(packet.rays.tfar[i]);
            let off = (vector(&surfaces.position) - met).length();
            assert!(off < 1e-4, "{off}: some ulp of 48");
            seen += 1;
        }
    }
    assert!(seen > 0);
}

/// A line of points away from all other triangles is not a stitch: it closes nothing.
#[test]
fn lonely_lines_are_dropped() {
    let scratch = Scratch::new();
    let ply = "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
               element face 2\nproperty list uchar int vertex_indices\nend_header\n\
               0 0 0\n1 0 0\n0 1 0\n100 0 0\n101 1 1\n102 2 2\n3 0 1 2\n3 3 4 5\n";
    scratch.write("solid.ply", ply);
    let (world, warnings) = load(&scratch.path(""), &json!({ "rotate": [13, 29, 47] }));
    assert_eq!(world.geometry.meshes[0].triangles().len(), 1);
    assert!(warnings.iter().any(|w| w.contains("1 degenerate triangle ")), "{warnings:?}");
    let told = scratch.run(&["info", "solid.ply"]).stdout();
    assert!(told.contains("1 triangle without area dropped"), "{told}");
}

/// A pentagon with a vertex in the middle of an edge, where a triangle ends, and a line of points
/// beside it. `info` counts the triangle that closes the T-junction apart from the line, which is
/// dropped.
#[test]
fn info_counts_stitches_apart_from_dropped_triangles() {
    let scratch = Scratch::new();
    let ply = "ply\nformat ascii 1.0\nelement vertex 10\nproperty double x\nproperty double y\nproperty double z\n\
               element face 3\nproperty list uchar int vertex_indices\nend_header\n\
               0 0 0\n1 0 0\n1 1 0\n0 1 0\n0.5 0 0\n100 0 0\n101 1 1\n102 2 2\n9 9 9\n0 -1 0\n5 0 4 1 2 3\n3 5 6 7\n3 0 4 9\n";
    scratch.write("junction.ply", ply);
    let told = scratch.run(&["info", "junction.ply"]).stdout();
    for line in [
        "  3 triangles\n",
        "  1 triangle without area dropped\n",
        "  1 triangle without area kept: it closes a T-junction\n",
        // Vertices of the line and the last one, not the vertex that only the stitch uses.
        "  4 vertices that no triangle uses\n",
    ] {
        assert!(told.contains(line), "{line}{told}");
    }
    let facts = scratch.run(&["info", "--json", "junction.ply"]).stdout();
    let facts: Value = serde_json::from_str(&facts).expect("JSON");
    let counts =
        ["degenerate_dropped", "stitches", "vertices_unused"].map(|key| facts[key].as_u64());
    assert_eq!(counts, [Some(1), Some(1), Some(4)]);
}
