//! Tests a leaf of spheres, or of an instance, against a packet. The tests are separate kernels,
//! because most scenes have no spheres.

use super::instance::{AnyInInstance, ClosestInInstance};
use super::{Bits, Packet};
use crate::accel::bvh::hits::ClosestHits;
use crate::accel::bvh::simd::Tier;
use crate::accel::bvh::single::just_beyond;
use crate::geometry::Sphere;
use crate::ray::{LANES, NONE};
use crate::simd::Kernel;

impl<T: Tier> Packet<'_, T> {
    /// Updates the closest hits of the rays in `entering` with a leaf of spheres.
    #[inline(never)]
    pub fn closest_in_spheres(&mut self, index: usize, entering: u32, best: &mut ClosestHits) {
        self.tier.run(Closest { packet: self, index, entering, best });
    }

    /// Tests the rays in `entering` against a leaf of spheres. Adds occluded rays to `occluded`.
    #[inline(never)]
    pub fn any_in_spheres(&mut self, index: usize, entering: u32, occluded: &mut [i32; LANES]) {
        self.tier.run(Any { packet: self, index, entering, occluded });
    }

    /// Returns origin and direction of a ray in f64, unscaled.
    #[inline(always)]
    fn ray64(&self, i: usize) -> ([f64; 3], [f64; 3]) {
        let ([ox, oy, oz], [dx, dy, dz]) = (&self.rays.org, &self.rays.dir);
        (
            [f64::from(ox[i]), f64::from(oy[i]), f64::from(oz[i])],
            [f64::from(dx[i]), f64::from(dy[i]), f64::from(dz[i])],
        )
    }

    /// Returns sphere `id`, its scene-wide primitive index, and the rays in `entering` that may hit
    /// it, as bits. Returns `None` if no ray may hit the sphere, and for an unused slot.
    #[inline(always)]
    fn candidate(&self, id: u32, entering: u32) -> Option<(Sphere, u32, u32)> {
        let sphere = *self.geometry.spheres.get(id as usize)?;
        let mut missed = [0.0f32; LANES];
        for i in 0..LANES {
            let (origin, direction) = self.ray64(i);
            let misses = sphere.surely_missed(origin.into(), direction.into());
            missed[i] = if misses { 1.0 } else { 0.0 };
        }
        for _ in 0..entering.count_ones() {
            self.tier.count_sphere_test();
        }
        let maybe = entering & self.tier.at_most(&missed, &[0.0; LANES]);
        let primitive = self.geometry.primitive(self.geometry.spheres_id(), id);
        (maybe != 0).then_some((sphere, primitive, maybe))
    }

    /// Returns t of the first hit of each ray with a sphere in (`tnear`, `tfar`); NaN for a miss.
    /// Lanes outside `rays` hold any value.
    #[inline(always)]
    fn sphere_hits(
        &self,
        (sphere, primitive): (&Sphere, u32),
        rays: u32,
        tfar: &[f64; LANES],
    ) -> [f64; LANES] {
        let (mut t, mut is_sure) = ([0.0; LANES], [0.0f32; LANES]);
        for i in 0..LANES {
            let (origin, direction) = self.ray64(i);
            let tnear = f64::from(self.rays.tnear[i]);
            let leaving = self.rays.leaving[i] == primitive;
            let (at, sure) =
                sphere.intersect_f64(origin.into(), direction.into(), tnear, tfar[i], leaving);
            t[i] = at;
            is_sure[i] = if sure { 1.0 } else { 0.0 };
        }
        for i in Bits(rays & self.tier.at_most(&is_sure, &[0.0; LANES])) {
            let (origin, direction) = self.ray64(i);
            let tnear = f64::from(self.rays.tnear[i]);
            let leaving = self.rays.leaving[i] == primitive;
            t[i] = sphere.intersect(origin.into(), direction.into(), tnear, tfar[i], leaving);
        }
        t
    }
}

struct Closest<'s, 'a, T> {
    packet: &'s mut Packet<'a, T>,
    index: usize,
    entering: u32,
    best: &'s mut ClosestHits,
}

impl<T: Tier> Kernel for Closest<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { packet, index, entering, best } = self;
        for id in packet.tree.spheres[index].0 {
            if let Some(instance) = packet.geometry.instance_in_leaf(id) {
                ClosestInInstance { packet, instance, entering, best }.run();
                continue;
            }
            let Some((sphere, primitive, maybe)) = packet.candidate(id, entering) else { continue };
            let mut tfar = [0.0; LANES];
            for i in 0..LANES {
                tfar[i] = just_beyond(best.t[i]);
            }
            let t = packet.sphere_hits((&sphere, primitive), maybe, &tfar);
            for i in Bits(maybe) {
                let equal = t[i] == best.t[i] && primitive < best.primitive[i];
                let closer = t[i] < best.t[i] || (equal && best.primitive[i] != NONE);
                if closer && t[i] < f64::from(packet.rays.tfar[i]) {
                    (best.t[i], best.primitive[i]) = (t[i], primitive);
                    (best.weights[0][i], best.weights[1][i], best.weights[2][i]) = (0.0, 0.0, 1.0);
                    best.second_half[i] = 0;
                    packet.tfar[i] = packet.query.tfar_for_hit(i, t[i]);
                }
            }
        }
    }
}

struct Any<'s, 'a, T> {
    packet: &'s mut Packet<'a, T>,
    index: usize,
    entering: u32,
    occluded: &'s mut [i32; LANES],
}

impl<T: Tier> Kernel for Any<'_, '_, T> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { packet, index, entering, occluded } = self;
        for id in packet.tree.spheres[index].0 {
            if let Some(instance) = packet.geometry.instance_in_leaf(id) {
                AnyInInstance { packet, instance, entering, occluded }.run();
                continue;
            }
            let Some((sphere, primitive, maybe)) = packet.candidate(id, entering) else { continue };
            let mut tfar = [0.0; LANES];
            for i in 0..LANES {
                tfar[i] = f64::from(packet.rays.tfar[i]);
            }
            let t = packet.sphere_hits((&sphere, primitive), maybe, &tfar);
            for i in Bits(maybe) {
                if t[i] < tfar[i] {
                    occluded[i] = -1;
                }
            }
        }
    }
}
