//! Intersection of a ray and a sphere, in f64, stable for tiny, far and huge spheres.

use glam::DVec3;

use super::double_double::DoubleDouble;

/// A sphere, relative to the scene's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre, relative to the scene's origin.
    pub center: DVec3,
    /// Radius, in scene units; above 0.
    pub radius: f64,
}

impl Sphere {
    /// Bounding box, larger than necessary by 3 to 5 times 2^-23 of each coordinate. That exceeds
    /// the rounding of a product of a side and a ray's inverse direction.
    pub fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let below = |x: f32| x - 4.0 * x.abs() * f32::EPSILON - f32::MIN_POSITIVE;
        let lower = (self.center - self.radius).to_array().map(|x| below(x as f32));
        let upper = (self.center + self.radius).to_array().map(|x| -below(-(x as f32)));
        (lower, upper)
    }

    /// Closest ray parameter in (`tnear`, `tfar`) at which `origin + t direction` hits the surface,
    /// or NaN. With `leaving`, the ray starts on this sphere up to rounding: the root of smaller
    /// magnitude is at its origin and does not count.
    ///
    /// The quadratic of Haines et al. 2019, Ray Tracing Gems ch. 7 (eqs. 5 to 10). The discriminant
    /// comes from the vector between the centre and the ray's closest point. The roots have no
    /// cancellation. f64 loses too many digits near the outline, for an origin near the surface of
    /// a large sphere, and for a tiny sphere far away. There the roots are computed again with
    /// twice the bits. Hit and miss are then separated up to some 2^-98 of the squared distance,
    /// and roots are right to single precision. A zero or non-finite direction misses.
    #[inline(always)]
    pub fn intersect(
        &self,
        origin: DVec3,
        direction: DVec3,
        tnear: f64,
        tfar: f64,
        leaving: bool,
    ) -> f64 {
        let (t, sure) = self.intersect_f64(origin, direction, tnear, tfar, leaving);
        if sure { t } else { self.intersect_double_double(origin, direction, tnear, tfar, leaving) }
    }

    /// [`Sphere::intersect`] in f64 alone, and whether that is precise enough. Without branches, so
    /// that 16 rays compile to a few vector instructions.
    #[inline(always)]
    pub fn intersect_f64(
        &self,
        origin: DVec3,
        direction: DVec3,
        tnear: f64,
        tfar: f64,
        leaving: bool,
    ) -> (f64, bool) {
        let f = origin - self.center;
        let a = direction.length_squared();
        let b = -f.dot(direction);
        let closest = f + direction * (b / a);
        let (f2, r2) = (f.length_squared(), self.radius * self.radius);
        let (c, squared) = (f2 - r2, r2 - closest.length_squared());
        let scale = f2.max(r2);
        let unsure =
            (squared.abs() < NEAR_OUTLINE * scale) | (!leaving & (c.abs() < NEAR_SURFACE * scale));
        (root([a, b, c], a * squared, tnear, tfar, leaving), !unsure)
    }

    /// Returns true only if the ray passes beside the sphere or leads away from it;
    /// [`Sphere::intersect`] is NaN then. Needs no division. Conservative: may return false for a
    /// ray that misses.
    ///
    /// In f64, b^2 - a c is right to some 2^-49 of a times the larger of the squares. For an origin
    /// clearly outside, b is clearly not zero for any ray that hits.
    #[inline(always)]
    pub fn surely_missed(&self, origin: DVec3, direction: DVec3) -> bool {
        let f = origin - self.center;
        let (a, b) = (direction.length_squared(), -f.dot(direction));
        let (f2, r2) = (f.length_squared(), self.radius * self.radius);
        let (c, scale) = (f2 - r2, f2.max(r2));
        let beside = a * c - b * b > 2.0 * NEAR_OUTLINE * (a * scale);
        beside | ((c > NEAR_SURFACE * scale) & (b <= 0.0))
    }

    /// [`Sphere::intersect`] with twice the bits.
    #[cold]
    #[inline(never)]
    fn intersect_double_double(
        &self,
        origin: DVec3,
        direction: DVec3,
        tnear: f64,
        tfar: f64,
        leaving: bool,
    ) -> f64 {
        let d = direction.to_array().map(|x| DoubleDouble::sum(x, 0.0));
        let [fx, fy, fz] = [0, 1, 2].map(|k| DoubleDouble::sum(origin[k], -self.center[k]));
        let [dx, dy, dz] = d;
        let a = dx * dx + dy * dy + dz * dz;
        let minus_b = fx * dx + fy * dy + fz * dz;
        let c = fx * fx + fy * fy + fz * fz - DoubleDouble::product(self.radius, self.radius);
        let discriminant = minus_b * minus_b - a * c;
        let abc = [direction.length_squared(), -minus_b.value(), c.value()];
        root(abc, discriminant.value(), tnear, tfar, leaving)
    }
}

/// The first root of a t^2 - 2 b t + c = 0 between `tnear` and `tfar`, or NaN. With `leaving`, the
/// root of smaller magnitude is left out.
#[inline(always)]
fn root([a, b, c]: [f64; 3], discriminant: f64, tnear: f64, tfar: f64, leaving: bool) -> f64 {
    let q = b + b.signum() * discriminant.sqrt();
    let (small, large) = (if leaving { f64::NAN } else { c / q }, q / a);
    let swapped = small > large;
    let (t0, t1) = if swapped { (large, small) } else { (small, large) };
    // A NaN root fails both comparisons and is no hit. A negative discriminant gives one.
    let second = if (t1 > tnear) & (t1 < tfar) { t1 } else { f64::NAN };
    if (t0 > tnear) & (t0 < tfar) { t0 } else { second }
}

/// Limit of f64 for the discriminant, relative to the larger of squared distance and squared
/// radius. The discriminant is right to some 2^-50 of that; below this fraction too few digits are
/// left.
const NEAR_OUTLINE: f64 = 1.0 / (1u64 << 32) as f64;

/// The same limit for the squared distance minus the squared radius.
const NEAR_SURFACE: f64 = 1.0 / (1u64 << 20) as f64;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

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
    fn surely_missed_is_true_beside_and_behind_the_sphere() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let missed = |origin: [f64; 3], direction: [f64; 3]| {
            sphere.surely_missed(origin.into(), direction.into())
        };
        assert!(missed([0.0, 1.0 + 1e-7, -3.0], [0.0, 0.0, 5.0]));
        assert!(missed([0.0, 0.0, 3.0], [0.0, 0.0, 1e-30]));
        assert!(!missed([0.0, 1.0 - 1e-12, -3.0], [0.0, 0.0, 1.0]));
        assert!(!missed([0.0, 1.0 + 1e-12, -3.0], [0.0, 0.0, 1.0]));
        assert!(!missed([0.0; 3], [0.0, 0.0, 1.0]));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// Half of the rays pass near the outline, half of the origins lie near the surface.
        #[test]
        fn surely_missed_never_contradicts_intersect(
            center in prop::array::uniform3(-1.0..1.0f64),
            away in prop::array::uniform3(-1.0..1.0f64),
            direction in prop::array::uniform3(-1.0..1.0f64),
            radius in 1e-6..1.0f64,
            nearness in 0..16i32,
            (outline, surface) in any::<(bool, bool)>(),
        ) {
            let (center, away) = (DVec3::from(center), DVec3::from(away) * 4.0);
            let sphere = Sphere { center, radius };
            let above = 1.0 + 10f64.powi(-nearness);
            let origin = center + if surface { away.normalize() * radius * above } else { away };
            let side = away.cross(direction.into()).normalize();
            let direction = match outline {
                true => center + side * radius * above - origin,
                false => direction.into(),
            };
            for direction in [direction, -direction, direction * 1e-25] {
                if sphere.surely_missed(origin, direction) {
                    prop_assert!(sphere.intersect(origin, direction, 0.0, FAR, false).is_nan());
                }
            }
        }
    }

    #[test]
    fn degenerate_rays_miss() {
        for d in [[0.0; 3], [f64::NAN, 0.0, 1.0], [f64::INFINITY, 0.0, 0.0]] {
            assert!(hit([0.0; 3], 1.0, [0.0, 0.0, -3.0], d).is_nan(), "{d:?}");
        }
    }

    #[test]
    fn a_leaving_ray_hits_only_the_far_side() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let out = sphere.intersect(DVec3::Z, DVec3::new(0.1, 0.0, 1.0), 0.0, FAR, true);
        assert!(out.is_nan());
        let across = sphere.intersect(DVec3::Z, -DVec3::Z, 0.0, FAR, true);
        assert_eq!(across, 2.0);
    }

    #[test]
    fn a_leaving_ray_with_a_rounded_origin_misses_the_near_side() {
        // If f32 is coarser than the sphere, the rounded origin may lie several radii away. A ray
        // that rises from the tangent plane must not enter the sphere.
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let (origin, direction) = (DVec3::new(2.0, 0.0, 1.0), DVec3::new(-1.0, 0.0, 0.1));
        assert!(sphere.intersect(origin, direction, 0.0, FAR, true).is_nan());
    }

    #[test]
    fn an_origin_just_above_a_huge_sphere_hits_it() {
        let sphere = Sphere { center: DVec3::new(0.0, -1e7, 0.0), radius: 1e7 };
        for height in [1.0, 1e-3, 1e-6, 1e-9] {
            let origin = DVec3::new(0.0, height, 0.0);
            let t = sphere.intersect(origin, -DVec3::Y, 0.0, FAR, false);
            assert!((t / height - 1.0).abs() < 1e-7, "{t:e} for {height:e}");
        }
    }

    #[test]
    fn bounds_are_wider_by_a_few_roundings() {
        let sphere = Sphere { center: DVec3::new(2.0, -3.0, 0.5), radius: 1.25 };
        let (lower, upper) = sphere.bounds();
        let exact = [[0.75, -4.25, -0.75], [3.25, -1.75, 1.75]];
        for axis in 0..3 {
            let [low, high] = exact.map(|corner: [f32; 3]| f64::from(corner[axis]));
            let slack = |x: f64| x.abs() * f64::from(f32::EPSILON);
            let (below, above) = (low - f64::from(lower[axis]), f64::from(upper[axis]) - high);
            assert!((3.0 * slack(low)..=5.0 * slack(low)).contains(&below), "{axis} {below:e}");
            assert!((3.0 * slack(high)..=5.0 * slack(high)).contains(&above), "{axis} {above:e}");
        }
        // At zero as well.
        let sphere = Sphere { center: DVec3::ONE, radius: 1.0 };
        assert_eq!(sphere.bounds().0, [-f32::MIN_POSITIVE; 3]);
        let sphere = Sphere { center: -DVec3::ONE, radius: 1.0 };
        assert_eq!(sphere.bounds().1, [f32::MIN_POSITIVE; 3]);
    }

    /// Points on a sphere far from the origin, seen from outside and inside along directions of
    /// any length.
    #[test]
    fn f64_and_twice_the_bits_find_the_same_points() {
        let sphere = Sphere { center: DVec3::new(2.0, -3.0, 0.5), radius: 1.25 };
        let near = DVec3::new(-0.5, 0.75, -0.25).normalize();
        for (origin, length) in [
            (DVec3::new(-4.0, 5.0, -2.0), 3.0),
            (DVec3::new(-4.0, 5.0, -2.0), 0.25),
            (DVec3::new(2.5, -3.25, 1.0), 2.0),
            (DVec3::new(2.5, -3.25, 1.0), 0.5),
        ] {
            let hit = sphere.center + near * sphere.radius;
            let direction = (hit - origin).normalize() * length;
            let expected = (hit - origin).length() / length;
            let (t, sure) = sphere.intersect_f64(origin, direction, 0.0, FAR, false);
            assert!(sure && (t / expected - 1.0).abs() < 1e-14, "{t} {expected}");
            let t = sphere.intersect_double_double(origin, direction, 0.0, FAR, false);
            assert!((t / expected - 1.0).abs() < 1e-14, "{t} {expected}");
            assert!(!sphere.surely_missed(origin, direction));
        }
        let away = DVec3::new(-6.0, 8.0, -2.5);
        assert!(sphere.surely_missed(sphere.center + away, away));
        assert!(sphere.surely_missed(sphere.center + away, away.any_orthogonal_vector()));
    }

    #[test]
    fn f64_is_unsure_only_near_the_outline_and_near_the_surface() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1000.0 };
        let sure = |origin: [f64; 3], direction: DVec3, leaving| {
            sphere.intersect_f64(origin.into(), direction, 0.0, FAR, leaving).1
        };
        // The limits are 5e6 * 2^-32 for the squared distance from the outline, 1e6 * 2^-20 from
        // the surface. Both are rounded.
        for (y, expected) in [(-1e-5, true), (-1e-7, false), (1e-7, false), (1e-5, true)] {
            let origin = [0.0, 1000.0 + y, -2000.0];
            assert_eq!(sure(origin, DVec3::Z, false), expected, "outline {y}");
            assert_eq!(sure(origin, DVec3::Z, true), expected, "outline {y}");
        }
        for (z, expected) in [(-1e-2, true), (-1e-4, false), (1e-4, false), (1e-2, true)] {
            let origin = [0.0, 0.0, 1000.0 + z];
            assert_eq!(sure(origin, -DVec3::Z, false), expected, "surface {z}");
            assert!(sure(origin, -DVec3::Z, true), "leaving {z}");
        }
        assert!(!sure([0.0, 1000.0 + 1e-9, 0.0], DVec3::X, false), "outline and surface");
    }

    #[test]
    fn hits_at_the_ends_of_a_segment_do_not_count() {
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        let t = |near, far| sphere.intersect(DVec3::Z * -3.0, DVec3::Z, near, far, false);
        assert_eq!((t(1.5, 2.5), t(2.5, 4.5)), (2.0, 4.0));
        assert_eq!(t(2.0, 5.0), 4.0);
        assert!(t(0.0, 2.0).is_nan() && t(2.0, 4.0).is_nan() && t(4.0, 5.0).is_nan());
    }

    /// The ray passes at a distance of 1 from a sphere of radius 1000, with squares of 5e6.
    #[test]
    fn rays_close_to_a_large_sphere_are_surely_missed_or_not() {
        let sphere = Sphere { center: DVec3::new(0.0, 0.0, 4.0), radius: 1000.0 };
        for length in [2f64.powi(-10), 1.0, 1024.0] {
            // The limit is 1.2e-6 beside the sphere and 5e-4 above it.
            for (height, expected) in [(1e-5, true), (1e-7, false), (-1e-5, false)] {
                let origin = DVec3::new(0.0, 1000.0 + height, -1996.0);
                assert_eq!(sphere.surely_missed(origin, DVec3::Z * length), expected, "{height}");
            }
            for (height, expected) in [(1e-3, true), (1e-4, false), (-1e-3, false)] {
                let origin = DVec3::new(0.0, 0.0, 1004.0 + height);
                assert_eq!(sphere.surely_missed(origin, DVec3::Z * length), expected, "{height}");
            }
        }
    }
}
