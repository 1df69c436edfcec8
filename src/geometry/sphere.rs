//! Ray against sphere, in f64, stable for tiny, far and huge spheres.

use glam::DVec3;

/// A sphere relative to the scene's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Relative to the scene's origin.
    pub center: DVec3,
    /// > 0
    pub radius: f64,
}

impl Sphere {
    /// A box around the sphere, one to two ulp larger than need be.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let below = |x: f32| x - x.abs() * f32::EPSILON - f32::MIN_POSITIVE;
        let lower = (self.center - self.radius).to_array().map(|x| below(x as f32));
        let upper = (self.center + self.radius).to_array().map(|x| -below(-(x as f32)));
        (lower, upper)
    }

    /// The closest parameter t in (`tnear`, `tfar`) at which `origin + t direction` meets the
    /// surface, or NaN. `leaving`: the ray starts on this sphere, so the root at its origin is
    /// the origin itself and does not count.
    ///
    /// The quadratic of Haines et al. 2019, Ray Tracing Gems ch. 7 (eqs. 5 to 10): the
    /// discriminant from the vector between the centre and the ray's closest point, the roots
    /// without cancellation. A zero or non-finite direction misses.
    #[inline(always)]
    pub fn intersect(
        &self,
        origin: DVec3,
        direction: DVec3,
        tnear: f64,
        tfar: f64,
        leaving: bool,
    ) -> f64 {
        let f = origin - self.center;
        let a = direction.length_squared();
        let b = -f.dot(direction);
        let closest = f + direction * (b / a);
        let discriminant = self.radius * self.radius - closest.length_squared();
        let q = b + b.signum() * (a * discriminant).sqrt();
        let (mut t0, mut t1) = if leaving {
            // One root is the origin, t = 0; their sum is 2 b / a.
            (f64::NAN, 2.0 * b / a)
        } else {
            let c = f.length_squared() - self.radius * self.radius;
            (c / q, q / a)
        };
        if t0 > t1 {
            (t0, t1) = (t1, t0);
        }
        let hit = |t: f64| t > tnear && t < tfar;
        // A NaN root fails both comparisons and is no hit.
        if !(discriminant >= 0.0 || leaving) {
            f64::NAN
        } else if hit(t0) {
            t0
        } else if hit(t1) {
            t1
        } else {
            f64::NAN
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FAR: f64 = f64::INFINITY;

    fn hit(center: [f64; 3], radius: f64, o: [f64; 3], d: [f64; 3]) -> f64 {
        let sphere = Sphere { center: center.into(), radius };
        sphere.intersect(o.into(), d.into(), 0.0, FAR, false)
    }

    #[test]
    fn both_roots_from_outside_and_inside() {
        assert_eq!(hit([0.0; 3], 1.0, [0.0, 0.0, -3.0], [0.0, 0.0, 1.0]), 2.0);
        assert_eq!(hit([0.0; 3], 1.0, [0.0; 3], [0.0, 0.0, 2.0]), 0.5);
        assert!(hit([0.0; 3], 1.0, [0.0, 0.0, 3.0], [0.0, 0.0, 1.0]).is_nan());
        assert!(hit([0.0; 3], 1.0, [0.0, 2.0, -3.0], [0.0, 0.0, 1.0]).is_nan());
    }

    #[test]
    fn tiny_and_far_or_huge_and_near() {
        let t = hit([0.0, 0.0, 1e5], 1e-3, [0.0; 3], [0.0, 0.0, 1.0]);
        assert!((t - (1e5 - 1e-3)).abs() < 1e-10, "{t}");
        let t = hit([0.0, -1e7, 0.0], 1e7, [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]);
        assert!((t - 1.0).abs() < 1e-8, "{t}");
    }

    #[test]
    fn degenerate_rays_miss() {
        for d in [[0.0; 3], [f64::NAN, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0]] {
            assert!(hit([0.0; 3], 1.0, [0.0, 0.0, -3.0], d).is_nan(), "{d:?}");
        }
    }

    #[test]
    fn a_ray_that_leaves_meets_only_the_other_side() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let out = sphere.intersect(DVec3::Z, DVec3::new(0.1, 0.0, 1.0), 0.0, FAR, true);
        assert!(out.is_nan());
        let across = sphere.intersect(DVec3::Z, -DVec3::Z, 0.0, FAR, true);
        assert_eq!(across, 2.0);
    }
}
