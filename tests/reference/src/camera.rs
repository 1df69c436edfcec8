//! Camera rays ("Camera"), with the random samples replaced by a dense regular set.

use super::Density;
use super::geometry::Ray;
use super::json::{need_number, need_vec3, number_or, vec3};
use glam::DVec3;
use serde_json::Value;

/// The camera of a scene.
pub struct Camera {
    /// Picture width, px.
    pub width: usize,
    /// Picture height, px.
    pub height: usize,
    position: DVec3,
    x: DVec3,
    y: DVec3,
    z: DVec3,
    tan_half_fov: f64,
    aperture: f64,
    focaldistance: f64,
}

impl Camera {
    /// `Z = normalize(lookat), X = normalize(Z x up), Y = X x Z`.
    pub fn read(json: &Value) -> Self {
        let position = need_vec3(json, "position");
        let view = match json.get("lookat") {
            Some(direction) => vec3(direction),
            None => need_vec3(json, "target") - position,
        };
        let z = view.normalize();
        let x = z.cross(need_vec3(json, "up")).normalize();
        let thin = json["type"] == "thinlens";
        Camera {
            width: need_number(json, "width") as usize,
            height: need_number(json, "height") as usize,
            position,
            x,
            y: x.cross(z),
            z,
            tan_half_fov: (need_number(json, "fov") / 2.0).to_radians().tan(),
            aperture: if thin { number_or(json, "aperture", 0.0) } else { 0.0 },
            focaldistance: if thin { need_number(json, "focaldistance") } else { 1.0 },
        }
    }

    /// Moves the camera, keeping its attitude.
    pub fn shift(&mut self, by: DVec3) {
        self.position += by;
    }

    /// Returns all rays whose mean is pixel (i, j): one through its centre for `spp` 1, else one
    /// through the centre of each cell of a regular grid, times the points on the lens.
    pub fn rays(&self, i: usize, j: usize, spp: usize, density: Density) -> Vec<Ray> {
        let cells = if spp > 1 { density.pixel } else { 1 };
        let lens = if self.aperture > 0.0 { density.lens } else { 1 };
        let mut rays = Vec::with_capacity(cells * cells * lens);
        for b in 0..cells {
            for a in 0..cells {
                let sx = (a as f64 + 0.5) / cells as f64;
                let sy = (b as f64 + 0.5) / cells as f64;
                for _ in 0..lens {
                    let point = lens_point(rays.len());
                    rays.push(self.ray(i as f64 + sx, j as f64 + sy, point));
                }
            }
        }
        rays
    }

    /// Returns the ray through the point (x, y) of the picture in pixels, and (lx, ly) of the unit
    /// lens.
    fn ray(&self, x_px: f64, y_px: f64, (lx, ly): (f64, f64)) -> Ray {
        let (width, height) = (self.width as f64, self.height as f64);
        let px = (2.0 * x_px / width - 1.0) * (width / height) * self.tan_half_fov;
        let py = (1.0 - 2.0 * y_px / height) * self.tan_half_fov;
        let through = px * self.x + py * self.y + self.z;
        let focus = self.position + self.focaldistance * through;
        let origin = self.position + self.aperture / 2.0 * (lx * self.x + ly * self.y);
        Ray { origin, direction: (focus - origin).normalize() }
    }
}

/// Returns the k-th of an even set of points in the unit disk: the plane's additive recurrence by
/// powers of the plastic number, mapped to the disk with equal areas. Any run of consecutive points
/// covers the whole disk, so lens and pixel are covered together.
fn lens_point(k: usize) -> (f64, f64) {
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let s = (0.5 + k as f64 / PLASTIC).fract();
    let t = (0.5 + k as f64 / (PLASTIC * PLASTIC)).fract();
    let (sin, cos) = (std::f64::consts::TAU * t).sin_cos();
    (s.sqrt() * cos, s.sqrt() * sin)
}
