//! Shadow rays from 16 points to 16 light points, and the Blinn-Phong light that arrives.

use glam::Vec3;

use super::points::{Lanes, Lanes3, ShadowPoints, lane, set_lane};
use crate::geometry::NONE;
use crate::math::pow;
use crate::ray::{LANES, Mask, Rays};
use crate::scene::Falloff;

/// Weights of a light's diffuse and specular colours at 16 points, including falloff.
#[derive(Debug, Clone)]
pub struct LightWeights {
    /// kd (N.L) emission / falloff
    pub diffuse: Lanes,
    /// ks max(0, N.H)^exponent emission / falloff
    pub specular: Lanes,
}

impl LightWeights {
    /// Weights of zero: no light.
    pub const EMPTY: Self = Self { diffuse: [0.0; LANES], specular: [0.0; LANES] };
}

/// Creates shadow rays from `points` to the light points `q`, and the weights of the light that
/// arrives if nothing occludes them. Returns the lanes that can receive light: N.L > 0, and the
/// emitter shines towards the point. `glossy`: whether any ks > 0.
///
/// docs/guide/scene-format.md defines the terms. A ray's parameter is 0 at its origin and 1 at the
/// light. The ray ends before 1 by the relative rounding error of its end points. So a surface at
/// the light itself does not occlude it.
#[inline(always)]
pub fn light_rays(
    points: &ShadowPoints,
    q: &Lanes3,
    normal: Option<Vec3>,
    falloff: Falloff,
    glossy: bool,
    rays: &mut Rays,
    weights: &mut LightWeights,
) -> Mask {
    let mut active = Mask::NONE;
    let (linear, quadratic) = (falloff == Falloff::Linear, falloff == Falloff::Quadratic);
    let emitted = normal.unwrap_or(Vec3::ZERO);
    let uniform = if normal.is_some() { 0.0 } else { 1.0 };
    for i in 0..LANES {
        let q = lane(q, i);
        let to_light = q - lane(&points.position, i);
        let d2 = to_light.dot(to_light);
        let d = d2.sqrt();
        let inverse = 1.0 / d;
        let l = to_light * inverse;
        let n = lane(&points.n, i);
        let cosine = n.dot(l);
        let emission = uniform + (-l.dot(emitted)).max(0.0);
        let divided = if quadratic { 1.0 / d2 } else { 1.0 };
        let weight = emission * if linear { inverse } else { divided };
        weights.diffuse[i] = points.kd[i] * cosine * weight;
        // The weight only; `specular` below multiplies it by the rest.
        weights.specular[i] = points.ks[i] * weight;
        let on = (cosine > 0.0) & (d2 > 0.0) & (emission > 0.0);
        active.0[i] = points.hit.0[i] & -i32::from(on);

        let origin = lane(&points.origin, i);
        let direction = q - origin;
        set_lane(&mut rays.org, i, origin);
        set_lane(&mut rays.dir, i, direction);
        rays.tnear[i] = 0.0;
        rays.tfar[i] = end(origin, q, direction);
        // A lifted origin may have its own facet between itself and a light below the facet's
        // horizon. In all other cases a planar primitive cannot shadow its own point.
        let own_counts = (points.lifted.0[i] != 0) & (l.dot(lane(&points.ng, i)) < 0.0);
        rays.leaving[i] = if own_counts { NONE } else { points.primitive[i] };
    }
    if glossy {
        specular(points, q, weights);
    }
    active
}

/// Parameter at which the shadow ray to the light point `q` ends.
#[inline(always)]
fn end(origin: Vec3, q: Vec3, direction: Vec3) -> f32 {
    let scale = origin.abs().max_element() + q.abs().max_element();
    let ulps = 4.0 * f32::EPSILON * (1.0 + scale / direction.abs().max_element());
    // A light nearer than its own rounding must not end the ray before its start.
    (1.0 - ulps).max(0.0)
}

/// Parameter at which rays from lifted origins to a light beyond the scene end. Without a lift, 1
/// is outside of the scene. P' is at most L / sqrt(3) from P, where L is the longest edge of the
/// facet: the weighted distances from its corners are at most the root of the sum over i < j of
/// w_i w_j L^2.
pub const BEYOND: f32 = 1.6;

/// Gives the `rays` of [`light_rays`] the direction in which the light points `q` are seen from
/// the surface, where a lifted origin is elsewhere. For light whose directions, not points, are
/// given. `beyond`: whether the light is beyond the scene; otherwise the rays keep their length.
#[inline(always)]
pub fn keep_directions(points: &ShadowPoints, q: &Lanes3, beyond: bool, rays: &mut Rays) {
    if !points.lifted.any() {
        return;
    }
    for i in (0..LANES).filter(|&i| points.lifted.0[i] != 0) {
        let (q, origin) = (lane(q, i), lane(&points.origin, i));
        let direction = q - lane(&points.position, i);
        set_lane(&mut rays.dir, i, direction);
        rays.tfar[i] = if beyond { BEYOND } else { end(origin, q, direction) };
    }
}

/// Largest exponent for which N.H is computed in single precision. Near 1 its steps are 6e-8, so
/// the relative error of the power is 6e-5.
const MAX_SINGLE_EXPONENT: f32 = 1024.0;

/// Multiplies the specular weights by max(0, N.H)^exponent; H is the unit half vector.
#[inline(always)]
fn specular(points: &ShadowPoints, q: &Lanes3, weights: &mut LightWeights) {
    if points.exponent.iter().fold(0.0, |max: f32, exponent| max.max(*exponent))
        > MAX_SINGLE_EXPONENT
    {
        return sharp_specular(points, q, weights);
    }
    for i in 0..LANES {
        let to_light = lane(q, i) - lane(&points.position, i);
        let l = to_light * (1.0 / to_light.dot(to_light).sqrt());
        let h = l + lane(&points.view, i);
        let cosine = lane(&points.n, i).dot(h) * (1.0 / h.dot(h).sqrt());
        weights.specular[i] *= pow(f64::from(cosine.clamp(0.0, 1.0)), points.exponent[i]);
    }
}

/// [`specular`] with N.H in double precision where the exponent is large.
#[cold]
#[inline(never)]
fn sharp_specular(points: &ShadowPoints, q: &Lanes3, weights: &mut LightWeights) {
    for i in 0..LANES {
        let to_light = lane(q, i) - lane(&points.position, i);
        let (n, view, exponent) = (lane(&points.n, i), lane(&points.view, i), points.exponent[i]);
        let cosine = if exponent > MAX_SINGLE_EXPONENT {
            let unit = |v: Vec3| v.as_dvec3().normalize();
            unit(n).dot((unit(to_light) + unit(view)).normalize())
        } else {
            let l = to_light * (1.0 / to_light.dot(to_light).sqrt());
            let h = l + view;
            f64::from(n.dot(h) * (1.0 / h.dot(h).sqrt()))
        };
        weights.specular[i] *= pow(cosine.clamp(0.0, 1.0), exponent);
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn one_point() -> ShadowPoints {
        let mut p = ShadowPoints::EMPTY;
        p.hit.0[0] = -1;
        set_lane(&mut p.n, 0, Vec3::Y);
        set_lane(&mut p.ng, 0, Vec3::Y);
        set_lane(&mut p.view, 0, Vec3::new(0.6, 0.8, 0.0));
        (p.kd[0], p.ks[0], p.exponent[0]) = (0.7, 0.3, 10.0);
        p
    }

    fn at(q: Vec3, falloff: Falloff, normal: Option<Vec3>) -> (Mask, Rays, LightWeights) {
        let (mut rays, mut weights) = (Rays::EMPTY, LightWeights::EMPTY);
        let mut lanes = [[0.0; LANES]; 3];
        set_lane(&mut lanes, 0, q);
        let active =
            light_rays(&one_point(), &lanes, normal, falloff, true, &mut rays, &mut weights);
        (active, rays, weights)
    }

    #[test]
    fn highlights_of_large_exponents_are_smooth() {
        for exponent in [100.0, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8] {
            for step in 0..20 {
                let mut point = one_point();
                let angle = f64::from(step) * 0.2 / f64::from(exponent).sqrt();
                let q = 5.0 * Vec3::new(-0.6, 0.8, (2.0 * angle).sin() as f32);
                (point.ks[0], point.exponent[0]) = (1.0, exponent);
                let (mut rays, mut weights) = (Rays::EMPTY, LightWeights::EMPTY);
                let mut lanes = [[0.0; LANES]; 3];
                set_lane(&mut lanes, 0, q);
                let falloff = Falloff::None;
                light_rays(&point, &lanes, None, falloff, true, &mut rays, &mut weights);
                let h = q.as_dvec3().normalize() + DVec3::new(0.6, 0.8, 0.0);
                let exact = h.normalize().y.powf(f64::from(exponent));
                let error = (f64::from(weights.specular[0]) - exact).abs();
                let bound = if exponent > MAX_SINGLE_EXPONENT { 1e-3 } else { 2e-4 };
                assert!(error <= bound, "{exponent} {angle}: {} {exact}", weights.specular[0]);
            }
        }
    }

    #[test]
    fn the_terms_match_the_scene_format() {
        let q = Vec3::new(-3.0, 4.0, 0.0);
        for (falloff, divisor) in
            [(Falloff::None, 1.0), (Falloff::Linear, 5.0), (Falloff::Quadratic, 25.0)]
        {
            let (active, rays, weights) = at(q, falloff, None);
            assert_eq!(active.count(), 1);
            assert!((weights.diffuse[0] - 0.7 * 0.8 / divisor).abs() < 1e-7);
            // L + V = (0, 1.6, 0), so H = N.
            assert!((weights.specular[0] - 0.3 / divisor).abs() < 1e-7);
            assert!(rays.tfar[0] < 1.0 && rays.tfar[0] > 0.99999);
        }
    }

    #[test]
    fn a_lambertian_emitter_shines_one_way() {
        let q = Vec3::new(0.0, 2.0, 0.0);
        let (active, _, weights) = at(q, Falloff::Quadratic, Some(-Vec3::Y));
        assert_eq!(active.count(), 1);
        assert!((weights.diffuse[0] - 0.7 / 4.0).abs() < 1e-7);
        assert_eq!(at(q, Falloff::Quadratic, Some(Vec3::Y)).0.count(), 0);
    }

    #[test]
    fn a_light_nearer_than_its_rounding_is_visible() {
        // Far from the origin, the rounding of the segment's end exceeds the segment's length.
        let mut points = one_point();
        let at = Vec3::new(1000.0, 500.0, 0.0);
        set_lane(&mut points.position, 0, at);
        set_lane(&mut points.origin, 0, at);
        let mut q = [[0.0; LANES]; 3];
        set_lane(&mut q, 0, at + Vec3::Y * 1e-4);
        let (mut rays, mut weights) = (Rays::EMPTY, LightWeights::EMPTY);
        let active = light_rays(&points, &q, None, Falloff::None, false, &mut rays, &mut weights);
        assert!(active.count() == 1 && rays.tfar[0] >= 0.0, "{}", rays.tfar[0]);
    }

    #[test]
    fn no_light_from_behind_or_from_the_point_itself() {
        assert_eq!(at(Vec3::new(0.0, -1.0, 0.0), Falloff::None, None).0.count(), 0);
        assert_eq!(at(Vec3::ZERO, Falloff::Linear, None).0.count(), 0);
    }
}
