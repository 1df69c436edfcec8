//! Turns bytes into a small scene and 64 rays, and checks that all instruction sets agree with each
//! other and with the reference. It is the body of the fuzz target in `fuzz/`; a test also runs it
//! on random bytes.

use glam::DVec3;
use lightpath::geometry::{Geometry, Sphere, TriangleMesh};
use lightpath::ray::{LANES, Mask, Rays};

use super::reference;
use super::tiers::{Tiers, put};

/// A source of bytes, followed by endless zeros.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn u8(&mut self) -> u8 {
        match self.0.split_first() {
            Some((&first, rest)) => {
                self.0 = rest;
                first
            }
            None => 0,
        }
    }

    fn below(&mut self, n: usize) -> usize {
        usize::from(self.u8()) % n
    }

    /// Returns a small integer, a fraction of one, or a number of magnitude 2^-60 to 2^60.
    fn number(&mut self, style: u8) -> f32 {
        match style % 4 {
            0 => f32::from(self.u8() as i8 % 8),
            1 => f32::from(i16::from_le_bytes([self.u8(), self.u8()])) / 4096.0,
            2 => {
                let bits = u32::from_le_bytes([self.u8(), self.u8(), self.u8(), self.u8()]);
                let exponent = 127 - 60 + (bits >> 23) % 121;
                f32::from_bits((bits & 0x807f_ffff) | exponent << 23)
            }
            _ => {
                let style = self.u8();
                self.number(style % 3)
            }
        }
    }

    fn point(&mut self, style: u8) -> [f32; 3] {
        [self.number(style), self.number(style), self.number(style)]
    }
}

/// Runs one case. Returns how many of its rays hit something.
///
/// # Panics
/// If any check fails.
pub fn run(bytes: &[u8]) -> usize {
    let mut bytes = Bytes(bytes);
    let (geometry, points) = scene(&mut bytes);
    let tiers = Tiers::new(&geometry);
    let mut found = 0;
    for _ in 0..4 {
        let rays = rays(&mut bytes, &points, geometry.primitive(geometry.spheres_id(), 0));
        let mut active = Mask::ALL;
        if bytes.below(4) == 0 {
            let some = [bytes.u8(), bytes.u8()];
            active.0 = std::array::from_fn(|i| -i32::from((some[i / 8] >> (i % 8)) & 1));
        }
        let active = rays.possible(&active);
        let hits = tiers.trace(&active, &rays);
        found += hits.iter().flatten().count();
        for i in (0..LANES).filter(|&i| active.0[i] != 0) {
            if let Err(wrong) = reference::check(&geometry, &rays, i, hits[i]) {
                panic!("lane {i}, {}: {wrong}\n{geometry:?}", super::tiers::ray(&rays, i));
            }
        }
        between(&mut bytes, &geometry, &tiers, &rays);
    }
    found
}

/// Checks that no ray inside a cone hits anything if an instruction set reports the cone as empty.
fn between(bytes: &mut Bytes, geometry: &Geometry, tiers: &Tiers, rays: &Rays) {
    let corners = 1 + bytes.below(4);
    let mut cone = Rays::EMPTY;
    for i in 0..corners {
        put(&mut cone, i, rays.org.map(|o| o[0]), rays.dir.map(|d| d[i]));
    }
    let in_cone = Mask(std::array::from_fn(|i| -i32::from(i < corners)));
    if cone.possible(&in_cone) != in_cone || tiers.reporting_empty(&in_cone, &cone) == 0 {
        return;
    }
    let mut mixed = Rays::EMPTY;
    for i in 0..LANES {
        let shares: [f64; 4] = std::array::from_fn(|_| f64::from(bytes.u8() % 16));
        let direction = cone.dir.map(|d| (0..corners).map(|k| shares[k] * f64::from(d[k])).sum());
        // Rounded once, at any length within the range of f32.
        let largest = direction.iter().fold(0.0, |most: f64, x: &f64| most.max(x.abs()));
        put(&mut mixed, i, cone.org.map(|o| o[0]), direction.map(|x| (x / largest) as f32));
    }
    let active = mixed.possible(&Mask::ALL);
    let hits = tiers.trace(&active, &mixed);
    if let Some(i) = hits.iter().position(Option::is_some) {
        let (ray, cone) = (super::tiers::ray(&mixed, i), cone.dir.map(|d| d[..corners].to_vec()));
        panic!("{ray} is between {cone:?}, where there is nothing\n{geometry:?}");
    }
}

/// Returns a scene and its points.
fn scene(bytes: &mut Bytes) -> (Geometry, Vec<[f32; 3]>) {
    let style = bytes.u8();
    let mut points: Vec<[f32; 3]> = Vec::new();
    for _ in 0..3 + bytes.below(24) {
        let point = match (bytes.below(4), points.last()) {
            // A few ulp from the previous point.
            (0, Some(&last)) => last.map(|x| f32::from_bits(x.to_bits() ^ bytes.below(4) as u32)),
            _ => bytes.point(style),
        };
        points.push(point);
    }
    let meshes = (0..bytes.below(3))
        .map(|_| {
            let triangles = (0..bytes.below(48))
                .map(|_| [0; 3].map(|_: u32| bytes.below(points.len()) as u32))
                .collect();
            TriangleMesh::new(points.clone(), triangles, false)
        })
        .collect();
    let quads =
        (0..bytes.below(6)).map(|_| [0; 4].map(|_| points[bytes.below(points.len())])).collect();
    let spheres = (0..bytes.below(10))
        .map(|_| Sphere {
            center: DVec3::from(points[bytes.below(points.len())].map(f64::from)),
            radius: f64::from(bytes.number(style)).abs() + 1e-18,
        })
        .collect();
    (Geometry::new(DVec3::ZERO, meshes, quads, spheres).expect("few primitives"), points)
}

/// Returns 16 rays, mostly towards points and mixtures of points. Some leave one of the first
/// `flat` primitives: a ray that leaves a sphere would have to start on it.
fn rays(bytes: &mut Bytes, points: &[[f32; 3]], flat: u32) -> Rays {
    let style = bytes.u8();
    let mut rays = Rays::EMPTY;
    let mut origin = [0.0; 3];
    let mut direction = [0.0, 0.0, 1.0];
    let any = |bytes: &mut Bytes| points[bytes.below(points.len())];
    // Often all rays share one origin or one direction.
    let keeps = bytes.below(4);
    for i in 0..LANES {
        if i == 0 || keeps & 1 == 0 {
            origin = if bytes.below(3) == 0 { any(bytes) } else { bytes.point(style) };
        }
        if i == 0 || keeps & 2 == 0 {
            let (a, b, c) = (any(bytes), any(bytes), any(bytes));
            direction = match bytes.below(8) {
                0 => bytes.point(style),
                1 => [0.0, 1.0, 0.0],
                2 => [f32::from(bytes.u8() as i8 % 2), -1.0, f32::from(bytes.u8() as i8 % 2)],
                3 => [0, 1, 2].map(|k| (a[k] + b[k]) / 2.0 - origin[k]),
                4 | 5 => [0, 1, 2].map(|k| (a[k] + b[k] + c[k]) / 3.0 - origin[k]),
                _ => [0, 1, 2].map(|k| a[k] - origin[k]),
            };
        }
        put(&mut rays, i, origin, direction);
        match bytes.below(8) {
            0 => rays.tfar[i] = 1.0,
            1 => rays.tfar[i] = bytes.number(1).abs(),
            2 => rays.tnear[i] = bytes.number(1).abs(),
            3 if flat > 0 => rays.leaving[i] = u32::from(bytes.u8()) % flat,
            _ => {}
        }
    }
    rays
}
