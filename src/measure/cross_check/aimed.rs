//! Rays that are hard to answer, and random ones: seeded, aimed at a scene's own primitives.

use glam::DVec3;

use super::plan::Source;
use crate::accel::lane::Ray;
use crate::geometry::{Geometry, GeometryKind};
use crate::measure::rays::Recorded;
use crate::ray::{LANES, Mask, NONE, Rays};

/// SplitMix64 (Steele et al. 2014).
pub struct Random(u64);

impl Random {
    /// The sequence of `index` under a seed.
    pub fn new(seed: u64, index: u64) -> Self {
        let mut first = Self(seed);
        let start = first.bits();
        Self(start ^ index.wrapping_mul(0xd134_2543_de82_ef95))
    }

    /// 64 random bits.
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let x = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In 0..n.
    fn below(&mut self, n: u32) -> u32 {
        ((u128::from(self.bits()) * u128::from(n)) >> 64) as u32
    }

    fn sign(&mut self) -> f64 {
        if self.bits() >> 63 == 0 { 1.0 } else { -1.0 }
    }

    /// In [-1, 1)^3.
    fn cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// On the unit sphere.
    fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.cube();
            if (1e-4..=1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }
}

/// Aims rays at a geometry.
pub struct Aim<'g> {
    geometry: &'g Geometry,
    center: DVec3,
    /// Half the sides of the scene's box.
    half: DVec3,
}

impl<'g> Aim<'g> {
    /// `None` without any primitive.
    pub fn new(geometry: &'g Geometry) -> Option<Self> {
        let points = |primitive| corners(geometry, primitive);
        let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for primitive in 0..*geometry.bases().last()? {
            for p in points(primitive) {
                (min, max) = (min.min(p), max.max(p));
            }
        }
        let (center, half) = ((min + max) / 2.0, (max - min) / 2.0);
        center.is_finite().then_some(Self { geometry, center, half })
    }

    /// A packet of rays of one kind.
    pub fn packet(&self, source: Source, random: &mut Random) -> Recorded {
        let mut rays = Rays::EMPTY;
        for i in 0..LANES {
            let ray = self.ray(source, random);
            for axis in 0..3 {
                rays.org[axis][i] = ray.origin[axis] as f32;
                rays.dir[axis][i] = ray.direction[axis] as f32;
            }
            (rays.tnear[i], rays.tfar[i]) = (ray.tnear as f32, ray.tfar as f32);
            rays.leaving[i] = ray.leaving;
        }
        let active = rays.possible(&Mask([-1; LANES]));
        Recorded { active, rays }
    }

    /// Somewhere in the scene's box, made `times` as large.
    fn somewhere(&self, times: f64, random: &mut Random) -> DVec3 {
        self.center + self.half * times * random.cube()
    }

    fn ray(&self, source: Source, random: &mut Random) -> Ray {
        let count = self.geometry.bases().last().copied().unwrap_or(1);
        let corners = corners(self.geometry, random.below(count));
        let corner = corners[random.below(corners.len() as u32) as usize];
        let next = corners[random.below(corners.len() as u32) as usize];
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let inside = middle.lerp(corner, random.unit()).lerp(next, random.unit() * 0.5);
        let rounded = |v: DVec3| v.as_vec3().as_dvec3();
        let from = rounded(self.somewhere(2.0, random));
        let (origin, direction) = match source {
            Source::Random => (self.somewhere(1.5, random), random.direction()),
            Source::Vertex => {
                if random.bits() % 2 == 0 {
                    (from, corner - from)
                } else {
                    // Small whole numbers, so that the ray runs through the corner exactly where
                    // the coordinates allow.
                    let step = rounded((random.cube() * 4.0).round())
                        * 2f64.powi(random.below(6) as i32 - 3);
                    (corner - step, step)
                }
            }
            Source::Edge => {
                let target = rounded(corner.lerp(next, random.unit()));
                (from, target - from)
            }
            Source::Axis => {
                let axis = random.below(3) as usize;
                let mut direction = DVec3::ZERO;
                direction[axis] = random.sign();
                let mut origin = if random.bits() % 4 == 0 { inside } else { corner };
                origin[axis] = self.somewhere(2.0, random)[axis];
                (origin, direction)
            }
            Source::BoxFace => {
                let axis = random.below(3) as usize;
                let (mut origin, mut direction) =
                    (from.lerp(inside, random.unit()), random.direction());
                origin[axis] = corner[axis];
                if random.bits() % 2 == 0 {
                    direction[axis] = 0.0 * random.sign();
                }
                if random.bits() % 4 == 0 {
                    direction[(axis + 1) % 3] = 0.0;
                }
                (origin, direction)
            }
            Source::Far => {
                let away = random.direction() * self.half.max_element().max(f64::MIN_POSITIVE);
                let origin = rounded(inside + away * 10f64.powf(1.0 + 5.0 * random.unit()));
                (origin, inside - origin)
            }
            Source::Tiny => {
                let least = 10f64.powf(-30.0 - 7.0 * random.unit());
                let direction = (inside - from).normalize_or(DVec3::X) * least;
                (from, direction)
            }
            Source::Scene(_) => (from, inside - from),
        };
        Ray { origin, direction, tnear: 0.0, tfar: f64::INFINITY, leaving: NONE }
    }
}

/// Gives the rays of a packet ends before and behind what they are aimed at, t = 1.
pub fn end(packet: &mut Recorded, random: &mut Random) {
    let ends = [0.5, 0.999, 1.5, f32::INFINITY];
    packet.rays.tfar = std::array::from_fn(|_| ends[random.below(4) as usize]);
}

/// Points of a primitive to aim at.
fn corners(geometry: &Geometry, primitive: u32) -> Vec<DVec3> {
    let geom = geometry.bases().partition_point(|&base| base <= primitive) - 1;
    let prim = primitive - geometry.bases()[geom];
    let corner = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    match geometry.kind(geom as u32) {
        GeometryKind::Mesh(mesh) => geometry.meshes[mesh].corners(prim).map(corner).to_vec(),
        GeometryKind::Quads => geometry.quads[prim as usize].map(corner).to_vec(),
        GeometryKind::Spheres => {
            let sphere = &geometry.spheres[prim as usize];
            let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
            axes.map(|axis| sphere.center + axis * sphere.radius).to_vec()
        }
    }
}
