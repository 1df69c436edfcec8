//! Closed forms of pixels, in plain scalar arithmetic and without tracing a ray.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

type V = [f64; 3];

fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn minus(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn unit(a: V) -> V {
    a.map(|x| x / dot(a, a).sqrt())
}

fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A unit sphere at the origin under one white point light of `id` and `is` 1, seen from
/// (0, 0, `eye`) with the lens towards -z.
pub struct LitSphere {
    /// Distance of the camera from the centre, > 1.
    pub eye: f64,
    /// Position of the light.
    pub light: V,
    pub kd: f64,
    pub ks: f64,
    pub specularexponent: f64,
    /// 0, 1 or 2: the light is divided by d to this power.
    pub falloff: i32,
}

impl LitSphere {
    /// Returns the radiance along the camera ray of picture plane coordinates (px, py) ("Camera"),
    /// for a diffuse colour of 1; `None` if the ray misses. It is "Shading" with the hit of the
    /// line (0, 0, eye) + t (px, py, -1) on the unit sphere written out.
    pub fn radiance(&self, px: f64, py: f64) -> Option<f64> {
        let r2 = px * px + py * py;
        // (1 + r2) t^2 - 2 eye t + eye^2 - 1 = 0, the smaller root
        let quarter = self.eye * self.eye - (1.0 + r2) * (self.eye * self.eye - 1.0);
        if quarter < 0.0 {
            return None;
        }
        let t = (self.eye - quarter.sqrt()) / (1.0 + r2);
        let n = [t * px, t * py, self.eye - t]; // the hit point, and the normal there
        let to_light = minus(self.light, n);
        let d = dot(to_light, to_light).sqrt();
        let (l, v) = (unit(to_light), unit([-px, -py, 1.0]));
        let cosine = dot(n, l);
        if cosine <= 0.0 {
            return Some(0.0); // the only thing that can shade a convex body is itself
        }
        let half = unit([l[0] + v[0], l[1] + v[1], l[2] + v[2]]);
        let highlight = dot(n, half).max(0.0).powf(self.specularexponent);
        Some((self.kd * cosine + self.ks * highlight) / d.powi(self.falloff))
    }
}

/// The picture plane coordinates (px, py) of the centre of pixel (i, j) ("Camera").
pub fn plane_coordinates(i: usize, j: usize, (w, h): (usize, usize), fov_deg: f64) -> (f64, f64) {
    let (width, height) = (w as f64, h as f64);
    let tan = (fov_deg / 2.0).to_radians().tan();
    let px = (2.0 * (i as f64 + 0.5) / width - 1.0) * (width / height) * tan;
    (px, (1.0 - 2.0 * (j as f64 + 0.5) / height) * tan)
}

/// Lambert's formula: the irradiance at `point` with unit normal `n` from a polygon of uniform
/// radiance 1. The whole polygon is above the horizon and lit towards the point.
///
/// `E = 1/2 sum over the edges of angle(a, b) n.unit(a x b)`, with a and b the edge's ends as seen
/// from the point. The polygon's order decides only the sign, which is dropped.
pub fn polygon_irradiance(point: V, n: V, corners: &[V]) -> f64 {
    let mut sum = 0.0;
    for k in 0..corners.len() {
        let a = unit(minus(corners[k], point));
        let b = unit(minus(corners[(k + 1) % corners.len()], point));
        let angle = dot(a, b).clamp(-1.0, 1.0).acos();
        sum += angle * dot(n, unit(cross(a, b)));
    }
    (sum / 2.0).abs()
}

/// Radiance that a mirror reflects in front of another one, both with coefficient `kr` and their
/// own light `glow`, after `nbounces` bounces: a geometric sum.
pub fn facing_mirrors(glow: f64, kr: f64, nbounces: i32) -> f64 {
    glow * (1.0 - kr.powi(nbounces + 1)) / (1.0 - kr)
}

/// Returns a point of the unit sphere by longitude and latitude (rad) about the given pole.
/// "Texture coordinates" of a sphere there are [`lonlat_uv`].
pub fn lonlat_point(longitude: f64, latitude: f64, pole: char) -> V {
    let q = [latitude.cos() * longitude.sin(), -latitude.cos() * longitude.cos(), latitude.sin()];
    match pole {
        'x' => [q[2], q[0], q[1]], // q = (p.y, p.z, p.x)
        'y' => [q[1], q[2], q[0]], // q = (p.z, p.x, p.y)
        _ => q,
    }
}

/// Texture coordinates of [`lonlat_point`]; longitude in (-pi, pi), latitude in [-pi/2, pi/2].
pub fn lonlat_uv(longitude: f64, latitude: f64) -> (f64, f64) {
    debug_assert!(longitude.abs() < PI && latitude.abs() <= FRAC_PI_2);
    (0.5 + longitude / TAU, 0.5 - latitude / PI)
}
