//! `trimesh`: placing, normals, colours and coordinates of a PLY ("Shapes", trimesh).

use super::geometry::{Contact, Ray, face_normal, triangle};
use super::json::{need_number, number_or, switch_or, vec3_or, word_or};
use super::ply::{self, Element};
use super::texture::srgb_to_linear;
use super::tree::Tree;
use glam::{DVec2, DVec3};
use serde_json::Value;
use std::path::Path;

/// A mesh in world space.
pub struct Mesh {
    vertices: Vec<DVec3>,
    triangles: Vec<[usize; 3]>,
    /// Unit vertex normals, with `smooth` only.
    normals: Option<Vec<DVec3>>,
    /// Linear vertex colours.
    colors: Option<Vec<DVec3>>,
    /// File coordinates (v up) of each triangle's corners.
    coordinates: Option<Vec<[DVec2; 3]>>,
    tree: Tree,
}

impl Mesh {
    /// Loads the PLY of a `trimesh` shape and applies, in this order, fit, rotate, size, center.
    pub fn load(shape: &Value, folder: &Path) -> Mesh {
        let file = ply::read(&folder.join(word_or(shape, "path", "")));
        let (vertex, face) = (&file["vertex"], &file["face"]);
        let positions = vectors(vertex, ["x", "y", "z"]).expect("x y z");
        let (triangles, origins) = split_faces(face);
        let vertices = place(shape, &positions, &triangles);
        let normals = switch_or(shape, "smooth", false).then(|| {
            vectors(vertex, ["nx", "ny", "nz"]).map_or_else(
                || vertex_normals(&vertices, &triangles),
                |file| file.iter().map(|n| rotate(shape, *n).normalize()).collect(),
            )
        });
        let colors = if switch_or(shape, "vertexcolors", true) {
            vertex_colors(vertex, shape)
        } else {
            None
        };
        let coordinates = coordinates(vertex, face, &triangles, &origins);
        let corners = |part: usize| triangles[part].map(|k: usize| vertices[k]);
        let tree = Tree::build(&corners, (0..triangles.len()).collect());
        Mesh { tree, vertices, triangles, normals, colors, coordinates }
    }

    /// The corners of a triangle.
    pub fn corners(&self, part: usize) -> [DVec3; 3] {
        self.triangles[part].map(|k| self.vertices[k])
    }

    /// The unit vertex normals at a triangle's corners, with `smooth`.
    pub fn corner_normals(&self, part: usize) -> Option<[DVec3; 3]> {
        self.normals.as_ref().map(|n| self.triangles[part].map(|k| n[k]))
    }

    /// The interpolated linear vertex colour, if the mesh has any.
    pub fn color(&self, contact: &Contact) -> Option<DVec3> {
        let colors = self.colors.as_ref()?;
        let corners = self.triangles[contact.part].map(|k| colors[k]);
        Some((0..3).map(|k| contact.weights[k] * corners[k]).sum())
    }

    /// "File coordinates have v up, so the lookup uses 1 - v".
    pub fn uv(&self, contact: &Contact) -> DVec2 {
        let corners = self.coordinates.as_ref().expect("texture coordinates")[contact.part];
        let st: DVec2 = (0..3).map(|k| contact.weights[k] * corners[k]).sum();
        DVec2::new(st.x, 1.0 - st.y)
    }

    /// The nearest contact with t in (0, `limit`), triangle `left` excepted.
    pub fn hit(&self, ray: &Ray, limit: f64, left: Option<usize>) -> Option<Contact> {
        let mut best: Option<Contact> = None;
        self.tree.visit(ray, &mut |part| {
            let limit = best.map_or(limit, |b| b.t);
            if left != Some(part) {
                if let Some((t, weights)) = triangle(ray, &self.corners(part), limit) {
                    best = Some(Contact { t, part, weights });
                }
            }
        });
        best
    }
}

/// Three scalar columns of the vertices as vectors, if all are there.
fn vectors(vertex: &Element, names: [&str; 3]) -> Option<Vec<DVec3>> {
    let columns = vertex.columns(names)?;
    let read = |row: &Vec<Vec<f64>>| DVec3::from_array(columns.map(|c| row[c][0]));
    Some(vertex.rows.iter().map(read).collect())
}

/// "Quads are split 0-1-2, 0-2-3": the triangles, and for each its face and corner numbers.
type Origin = (usize, [usize; 3]);
fn split_faces(face: &Element) -> (Vec<[usize; 3]>, Vec<Origin>) {
    let column = face.column(&["vertex_indices", "vertex_index"]).expect("vertex_indices");
    let (mut triangles, mut origins) = (Vec::new(), Vec::new());
    for (f, row) in face.rows.iter().enumerate() {
        let polygon = &row[column];
        assert!(matches!(polygon.len(), 3 | 4), "only triangles and quads here");
        for k in 1..polygon.len() - 1 {
            let corners = [0, k, k + 1];
            triangles.push(corners.map(|c| polygon[c] as usize));
            origins.push((f, corners));
        }
    }
    (triangles, origins)
}

/// `fit`, then `rotate`, then `center + size * p`.
fn place(shape: &Value, positions: &[DVec3], triangles: &[[usize; 3]]) -> Vec<DVec3> {
    let used = || triangles.iter().flatten().map(|k| positions[*k]);
    let low = used().fold(DVec3::INFINITY, DVec3::min);
    let high = used().fold(DVec3::NEG_INFINITY, DVec3::max);
    let fit = shape.get("fit").map(|_| need_number(shape, "fit"));
    let size = number_or(shape, "size", 1.0);
    let center = vec3_or(shape, "center", DVec3::ZERO);
    let move_one = |p: &DVec3| {
        let fitted = match fit {
            Some(fit) => (*p - (low + high) / 2.0) * (fit / (high - low).max_element()),
            None => *p,
        };
        center + size * rotate(shape, fitted)
    };
    positions.iter().map(move_one).collect()
}

/// `rotate`: right-handed, about the x, then the y, then the z axis.
fn rotate(shape: &Value, p: DVec3) -> DVec3 {
    let angles = vec3_or(shape, "rotate", DVec3::ZERO);
    let (sx, cx) = angles.x.to_radians().sin_cos();
    let (sy, cy) = angles.y.to_radians().sin_cos();
    let (sz, cz) = angles.z.to_radians().sin_cos();
    let p = DVec3::new(p.x, cx * p.y - sx * p.z, sx * p.y + cx * p.z);
    let p = DVec3::new(cy * p.x + sy * p.z, p.y, -sy * p.x + cy * p.z);
    DVec3::new(cz * p.x - sz * p.y, sz * p.x + cz * p.y, p.z)
}

/// "the normalised sum over faces of area x corner angle x face normal"; the faces are the
/// triangles after splitting.
fn vertex_normals(vertices: &[DVec3], triangles: &[[usize; 3]]) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; vertices.len()];
    for indices in triangles {
        let v = indices.map(|k| vertices[k]);
        let area = (v[1] - v[0]).cross(v[2] - v[0]).length() / 2.0;
        for k in 0..3 {
            let (one, two) = (v[(k + 1) % 3] - v[k], v[(k + 2) % 3] - v[k]);
            sums[indices[k]] += area * one.angle_between(two) * face_normal(&v);
        }
    }
    sums.into_iter().map(DVec3::normalize_or_zero).collect()
}

/// "integer colours are divided by their type's maximum and decoded from sRGB, float ones are
/// linear; `vertexcolorspace` overrides".
fn vertex_colors(vertex: &Element, shape: &Value) -> Option<Vec<DVec3>> {
    let raw = vectors(vertex, ["red", "green", "blue"])?;
    let column = vertex.column(&["red"])?;
    let (maximum, default_space) = match vertex.properties[column].1.as_str() {
        "uchar" | "uint8" => (255.0, "srgb"),
        "ushort" | "uint16" => (65535.0, "srgb"),
        "float" | "float32" | "double" | "float64" => (1.0, "linear"),
        other => panic!("vertex colours as {other}"),
    };
    let srgb = word_or(shape, "vertexcolorspace", default_space) == "srgb";
    let decode = |x: f64| {
        if srgb { srgb_to_linear(x / maximum) } else { x / maximum }
    };
    Some(raw.iter().map(|c| DVec3::from_array(c.to_array().map(decode))).collect())
}

/// Texture coordinates per vertex (`s t`, `u v`, `texture_u texture_v` or `texture_s texture_t`),
/// or per corner (the list `texcoord` of the faces).
fn coordinates(
    vertex: &Element,
    face: &Element,
    triangles: &[[usize; 3]],
    origins: &[Origin],
) -> Option<Vec<[DVec2; 3]>> {
    if let Some(column) = face.column(&["texcoord"]) {
        let of_face = |(f, corners): &Origin| {
            let list = &face.rows[*f][column];
            corners.map(|c| DVec2::new(list[2 * c], list[2 * c + 1]))
        };
        return Some(origins.iter().map(of_face).collect());
    }
    let pairs = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
    let [s, t] = pairs.into_iter().find_map(|pair| vertex.columns(pair))?;
    let of_vertex = |k: usize| DVec2::new(vertex.rows[k][s][0], vertex.rows[k][t][0]);
    Some(triangles.iter().map(|t| t.map(of_vertex)).collect())
}
