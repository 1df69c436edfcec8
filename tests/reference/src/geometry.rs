//! Intersection of rays with shapes, and the position of hits on them ("Shapes", "Texture
//! coordinates").

use super::mesh::Mesh;
use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

/// A ray; the direction is unit length.
#[derive(Clone, Copy)]
pub struct Ray {
    pub origin: DVec3,
    pub direction: DVec3,
}

impl Ray {
    /// The point at distance `t`.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + t * self.direction
    }
}

/// A shape of the scene.
pub enum Shape {
    Sphere { center: DVec3, radius: f64, pole: char },
    Plane([DVec3; 4]),
    Triangle([DVec3; 3]),
    Mesh(Mesh),
}

/// A hit of a ray on a shape.
#[derive(Clone, Copy)]
pub struct Contact {
    /// Distance along the ray.
    pub t: f64,
    /// Triangle of a mesh; 0 for the other shapes.
    pub part: usize,
    /// Barycentric weights of the three corners (triangles and meshes).
    pub weights: [f64; 3],
}

/// Minimum distance to a sphere that the ray just left, relative to its radius. f64 places a hit
/// point within some 1e-15 of it.
const SPHERE_SKIN: f64 = 1e-9;

impl Shape {
    /// Returns the nearest contact with t in (0, `limit`). `left` is the part of this shape on
    /// which the ray starts, if any. A flat part cannot be hit again, and a sphere only at its
    /// other root.
    pub fn hit(&self, ray: &Ray, limit: f64, left: Option<usize>) -> Option<Contact> {
        let whole = |t: f64| Contact { t, part: 0, weights: [0.0; 3] };
        match self {
            Shape::Sphere { center, radius, .. } => {
                // A ray that starts on the surface does not hit it there.
                let least = if left.is_some() { SPHERE_SKIN } else { 1e-12 } * radius;
                sphere(ray, *center, *radius, least, limit).map(whole)
            }
            Shape::Plane(_) | Shape::Triangle(_) if left.is_some() => None,
            Shape::Plane(corners) => quad(ray, corners, limit).map(whole),
            Shape::Triangle(corners) => {
                triangle(ray, corners, limit).map(|(t, weights)| Contact { t, part: 0, weights })
            }
            Shape::Mesh(mesh) => mesh.hit(ray, limit, left),
        }
    }

    /// Returns the unit geometric normal at a contact point; it may face either way.
    pub fn normal(&self, point: DVec3, contact: &Contact) -> DVec3 {
        match self {
            Shape::Sphere { center, .. } => (point - center).normalize(),
            Shape::Plane([v0, v1, _, v3]) => (v1 - v0).cross(v3 - v0).normalize(),
            Shape::Triangle(corners) => face_normal(corners),
            Shape::Mesh(mesh) => face_normal(&mesh.corners(contact.part)),
        }
    }

    /// "Texture coordinates": (u, v) at a contact point, v down.
    pub fn uv(&self, point: DVec3, contact: &Contact) -> DVec2 {
        match self {
            Shape::Sphere { center, radius, pole } => sphere_uv((point - center) / *radius, *pole),
            Shape::Plane([v0, _, v2, v3]) => {
                let (a, b, p) = (v2 - v3, v0 - v3, point - v3);
                DVec2::new(p.dot(a) / a.dot(a), 1.0 - p.dot(b) / b.dot(b))
            }
            Shape::Triangle(corners) => triangle_uv(point, corners),
            Shape::Mesh(mesh) => mesh.uv(contact),
        }
    }
}

/// The smallest root of |o + t d - c|^2 = r^2 in (`least`, `limit`).
fn sphere(ray: &Ray, center: DVec3, radius: f64, least: f64, limit: f64) -> Option<f64> {
    let to_center = center - ray.origin;
    let middle = to_center.dot(ray.direction);
    let miss = to_center - middle * ray.direction;
    let half_chord_squared = radius * radius - miss.dot(miss);
    if half_chord_squared < 0.0 {
        return None;
    }
    let half_chord = half_chord_squared.sqrt();
    [middle - half_chord, middle + half_chord].into_iter().find(|t| *t > least && *t < limit)
}

/// Distance along the ray to the plane through `corner` with the given normal.
fn plane_distance(ray: &Ray, corner: DVec3, normal: DVec3, limit: f64) -> Option<f64> {
    let t = (corner - ray.origin).dot(normal) / ray.direction.dot(normal);
    (t > 0.0 && t < limit).then_some(t) // a parallel ray gives NaN or infinity: no hit
}

/// A convex quad: in its plane, and on the inner side of all four edges.
fn quad(ray: &Ray, v: &[DVec3; 4], limit: f64) -> Option<f64> {
    let normal = (v[1] - v[0]).cross(v[3] - v[0]);
    let t = plane_distance(ray, v[0], normal, limit)?;
    let point = ray.at(t);
    let inside = (0..4).all(|k| {
        let edge = v[(k + 1) % 4] - v[k];
        edge.cross(point - v[k]).dot(normal) >= 0.0
    });
    inside.then_some(t)
}

/// A triangle: in its plane, with no negative barycentric weight.
pub fn triangle(ray: &Ray, v: &[DVec3; 3], limit: f64) -> Option<(f64, [f64; 3])> {
    let normal = (v[1] - v[0]).cross(v[2] - v[0]);
    let t = plane_distance(ray, v[0], normal, limit)?;
    let point = ray.at(t);
    let opposite = |a: DVec3, b: DVec3| (b - a).cross(point - a).dot(normal) / normal.dot(normal);
    let weights = [opposite(v[1], v[2]), opposite(v[2], v[0]), opposite(v[0], v[1])];
    weights.iter().all(|w| *w >= 0.0).then_some((t, weights))
}

/// The unit normal of a triangle.
pub fn face_normal(v: &[DVec3; 3]) -> DVec3 {
    (v[1] - v[0]).cross(v[2] - v[0]).normalize()
}

/// Sphere: `u = 0.5 + atan2(p.x, -p.y)/(2 pi)`, `v = 0.5 - asin(p.z)/pi`, after the `pole` turn.
fn sphere_uv(p: DVec3, pole: char) -> DVec2 {
    let p = match pole {
        'x' => DVec3::new(p.y, p.z, p.x),
        'y' => DVec3::new(p.z, p.x, p.y),
        _ => p,
    };
    DVec2::new(0.5 + p.x.atan2(-p.y) / TAU, 0.5 - p.z.clamp(-1.0, 1.0).asin() / PI)
}

/// Triangle: `u = 1 - ((P - v0).e/|e| - m)/(M - m)`, `v = (P - v0).h/|h|^2`.
fn triangle_uv(point: DVec3, v: &[DVec3; 3]) -> DVec2 {
    let e = v[1] - v[0];
    let side = v[2] - v[0];
    let h = side - e * (side.dot(e) / e.dot(e));
    let along = |p: DVec3| (p - v[0]).dot(e) / e.length();
    let stops = v.map(along);
    let low = stops.into_iter().fold(f64::INFINITY, f64::min);
    let high = stops.into_iter().fold(f64::NEG_INFINITY, f64::max);
    let u = 1.0 - (along(point) - low) / (high - low);
    DVec2::new(u, (point - v[0]).dot(h) / h.dot(h))
}
