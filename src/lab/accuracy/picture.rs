//! Draws a small picture of a geometry with a dot at each failure, coloured by its kind.

use glam::DVec3;
use image::{Rgb, RgbImage};

use super::counts::WrongKind;
use crate::accel::bvh::Bvh;
use crate::accel::{Accelerator, BuildOptions};
use crate::error::Result;
use crate::geometry::{Box3, Geometry, Surfaces, TriangleMesh, doubles, refine};
use crate::lab::png;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket, lane};
use crate::simd::Isa;

/// Width and height of a picture in pixels.
const SIZE: [u32; 2] = [192, 144];

/// Number of shades of grey. Few shades keep the files small.
const SHADES: f64 = 12.0;

/// Aspect ratio of a view from which the view is stretched to fill the picture.
const LONG: f64 = 12.0;

/// A shaded view of a geometry in parallel projection.
pub struct ParallelView {
    ground: RgbImage,
    center: DVec3,
    /// Unit vectors of the view: right, down, forward.
    axes: [DVec3; 3],
    /// Half the width and height of the view, in world units.
    half: [f64; 2],
}

impl ParallelView {
    /// Fits the geometry into the picture and shades it.
    ///
    /// # Errors
    /// The errors of [`Bvh::build`].
    pub fn new(geometry: &Geometry, monitor: &Monitor) -> Result<Self> {
        let bounds = bounds(geometry);
        let (center, half) = (bounds.center(), (bounds.max - bounds.min) / 2.0);
        // Flat geometry is seen along its thin axis, other geometry from a corner.
        let thin = half.to_array().iter().position(|&h| h < 0.1 * half.max_element());
        let forward = match thin {
            Some(axis) => {
                let mut v = DVec3::new(0.08, -0.06, 0.04);
                v[axis] = -1.0;
                v
            }
            None => DVec3::new(-0.45, -0.4, -0.8),
        }
        .normalize();
        let up = if forward.y.abs() > 0.9 { DVec3::Z } else { DVec3::Y };
        let right = forward.cross(up).normalize();
        let down = forward.cross(right);
        let reach = |axis: DVec3| axis.abs().dot(half).max(1e-300) * 1.04;
        let (mut x, mut y) = (reach(right), reach(down));
        let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
        if (x / y).max(y / x) < LONG {
            (x, y) = (x.max(y * aspect), y.max(x / aspect));
        }
        let mut view = Self {
            ground: RgbImage::new(SIZE[0], SIZE[1]),
            center,
            axes: [right, down, forward],
            half: [x, y],
        };
        let distance = forward.abs().dot(half) * 2.0;
        let options = BuildOptions { threads: 1, max_bytes: None };
        let tree = Bvh::build(geometry, Isa::Portable, &options, monitor)?;
        view.shade(geometry, &tree, distance);
        Ok(view)
    }

    fn shade(&mut self, geometry: &Geometry, tree: &Bvh, distance: f64) {
        let mut surfaces = Surfaces::EMPTY;
        let [right, down, forward] = self.axes;
        for first in (0..SIZE[0] * SIZE[1]).step_by(LANES) {
            let mut packet = RayPacket::EMPTY;
            let pixel = |i: usize| [(first + i as u32) % SIZE[0], (first + i as u32) / SIZE[0]];
            for i in 0..LANES {
                let [x, y] = pixel(i).map(|n| f64::from(n) + 0.5);
                let x = (x / f64::from(SIZE[0]) * 2.0 - 1.0) * self.half[0];
                let y = (y / f64::from(SIZE[1]) * 2.0 - 1.0) * self.half[1];
                let origin = self.center + right * x + down * y - forward * distance;
                packet.rays.set(i, origin.as_vec3(), forward.as_vec3());
            }
            let active = packet.rays.possible(&Mask::ALL);
            tree.closest(&active, &mut packet, Coherence::Coherent);
            refine(geometry, &packet.hit(&active), &packet, &mut surfaces);
            for i in 0..LANES {
                let [x, y] = pixel(i);
                let seen = packet.hits.geom[i] != NONE;
                let normal = lane(&surfaces.ng, i).as_dvec3();
                // The light comes from above and a little from the right.
                let light = normal.dot((right * 0.35 - down * 0.6 - forward * 0.75).normalize());
                let shade = if seen { shade(light) } else { 250 };
                self.ground.put_pixel(x, y, Rgb([shade; 3]));
            }
        }
    }

    /// Returns the picture with failures as a PNG file.
    pub fn png(&self, places: &[(DVec3, WrongKind)]) -> Vec<u8> {
        let mut image = self.ground.clone();
        for (place, kind) in places {
            let away = *place - self.center;
            let x = (away.dot(self.axes[0]) / self.half[0] + 1.0) / 2.0 * f64::from(SIZE[0]);
            let y = (away.dot(self.axes[1]) / self.half[1] + 1.0) / 2.0 * f64::from(SIZE[1]);
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)] {
                let (x, y) = (x.floor() as i64 + dx, y.floor() as i64 + dy);
                if (0..i64::from(SIZE[0])).contains(&x) && (0..i64::from(SIZE[1])).contains(&y) {
                    image.put_pixel(x as u32, y as u32, Rgb(kind.color()));
                }
            }
        }
        png::encode(&image)
    }
}

/// Grey level for the cosine between normal and light.
fn shade(light: f64) -> u8 {
    let grey = 0.4 + 0.55 * light.clamp(0.0, 1.0);
    ((grey * SHADES).round() / SHADES * 240.0) as u8
}

fn bounds(geometry: &Geometry) -> Box3 {
    let meshes = geometry.meshes.iter().flat_map(TriangleMesh::vertices);
    let points = meshes.chain(geometry.quads.iter().flatten());
    let points = points.map(|&v| Box3::of(&[doubles(v)]));
    let spheres = geometry.spheres.iter().map(|s| Box3::of_sphere(s.center, s.radius));
    let all = Box3::around(points.chain(spheres));
    if all.min.is_finite() { all } else { Box3 { min: DVec3::NEG_ONE, max: DVec3::ONE } }
}
