//! Environment lights: directions to all sides, with one radiance or the radiance of a map.

use std::sync::Arc;

use glam::Vec3;

use super::environment_map::{Arrivals, EnvironmentMap};
use super::light_rays::LightWeights;
use super::points::{Lanes, Lanes3, ShadowPoints, lane, set_lane};
use super::sun::reach;
use crate::geometry::Geometry;
use crate::ray::LANES;
use crate::sampler::disk;

/// Radius of the disk whose points become directions. Below 1, because rounding would lose a
/// direction in the horizon itself.
const RADIUS: f32 = 1.0 - f32::EPSILON;

/// Share of the directions that follow the map. The others follow the cosine.
const MAP_SHARE: f32 = 0.5;

/// Directions over the hemisphere of each shading point, with a density of cosine / pi.
///
/// So every direction brings the same light to a diffuse surface. The mean over the visible
/// directions has no error except that of their visibility. A white surface of a convex body
/// returns exactly the radiance.
///
/// With a map that is not smooth, half of the directions have a density that follows the map, over
/// the whole sphere.
#[derive(Debug, Clone)]
pub struct Environment {
    /// Length of the shadow rays: they end outside of the scene, or at the distance of ambient
    /// occlusion.
    reach: f32,
    /// Whether the reach is that of ambient occlusion, which rounding limits.
    pub(super) is_near: bool,
    map: Option<TurnedMap>,
}

/// A map that is turned about the y axis.
#[derive(Debug, Clone)]
pub struct TurnedMap {
    map: Arc<EnvironmentMap>,
    /// Cosine and sine of the azimuth of the map's middle.
    turn: [f32; 2],
}

impl TurnedMap {
    /// A map whose middle has this azimuth, in degrees from -z towards +x.
    pub fn new(map: Arc<EnvironmentMap>, rotation_deg: f64) -> Self {
        let (sin, cos) = rotation_deg.to_radians().sin_cos();
        Self { map, turn: [cos as f32, sin as f32] }
    }

    /// The world's direction for a direction of the map.
    #[inline(always)]
    fn in_world(&self, Vec3 { x, y, z }: Vec3) -> Vec3 {
        let [cos, sin] = self.turn;
        Vec3::new(cos * x - sin * z, y, sin * x + cos * z)
    }

    /// The map's direction for a direction of the world.
    #[inline(always)]
    fn in_map(&self, Vec3 { x, y, z }: Vec3) -> Vec3 {
        let [cos, sin] = self.turn;
        Vec3::new(cos * x + sin * z, y, cos * z - sin * x)
    }

    /// Radiance that camera rays and mirrors see in a direction of any length but 0, if the map is
    /// visible to them.
    pub fn seen(&self, direction: Vec3) -> Vec3 {
        self.map.seen(self.in_map(direction.normalize()))
    }

    /// Radiance of the directions of the light points `q`. Divides their diffuse and specular
    /// weights by the density of [`Environment::points`], relative to 1 / pi.
    ///
    /// The density is that of both kinds of directions together. This is the balance heuristic of
    /// Veach 1997, "Robust Monte Carlo Methods for Light Transport Simulation", eq. 9.13.
    #[inline(always)]
    pub fn weigh(&self, points: &ShadowPoints, q: &Lanes3, weights: &mut LightWeights) -> Lanes3 {
        let (mut directions, mut cosine) = ([[0.0; LANES]; 3], [0.0; LANES]);
        for i in 0..LANES {
            let to_light = lane(q, i) - lane(&points.position, i);
            let direction = to_light * (1.0 / to_light.dot(to_light).sqrt());
            cosine[i] = lane(&points.n, i).dot(direction).max(0.0);
            set_lane(&mut directions, i, self.in_map(direction));
        }
        let Arrivals { radiance, density } = self.map.arrivals(&directions);
        let share = if self.map.is_smooth() { 0.0 } else { MAP_SHARE };
        for i in 0..LANES {
            let density = share * std::f32::consts::PI * density[i] + (1.0 - share) * cosine[i];
            // A light point behind the surface has no ray and no weight.
            let weight = if density > 0.0 { 1.0 / density } else { 0.0 };
            weights.diffuse[i] *= weight;
            weights.specular[i] *= weight;
        }
        radiance
    }
}

impl Environment {
    /// The environment around these primitives.
    pub fn new(geometry: &Geometry, map: Option<TurnedMap>) -> Self {
        Self { reach: reach(geometry) as f32, is_near: false, map }
    }

    /// The hemisphere up to this distance in world units, for ambient occlusion. From each shading
    /// point it is at least [`Environment::LEAST_SHARE`] of the point's largest coordinate.
    pub fn within(distance: f64) -> Self {
        Self { reach: distance as f32, is_near: true, map: None }
    }

    /// Shortest shadow ray of [`Environment::within`] over the largest coordinate of its start. The
    /// coordinates of both ends are rounded by 2^-24 of themselves. So 1 in 10,000 rays of this
    /// length ends below its surface, and most of those that are a hundredth as long.
    pub const LEAST_SHARE: f32 = 1.0 / (1 << 19) as f32;

    /// Lengths of the shadow rays from the points `from`.
    #[inline(always)]
    fn reaches(&self, from: &Lanes3) -> Lanes {
        let mut reaches = [self.reach; LANES];
        if self.is_near {
            let [x, y, z] = from;
            for i in 0..LANES {
                let largest = x[i].abs().max(y[i].abs()).max(z[i].abs());
                reaches[i] = self.reach.max(Self::LEAST_SHARE * largest);
            }
        }
        reaches
    }

    /// The map of the radiance.
    #[inline(always)]
    pub fn map(&self) -> Option<&TurnedMap> {
        self.map.as_ref()
    }

    /// Ends of the shadow rays from `from`, for 16 points (s, t) in the unit square.
    #[inline(always)]
    pub fn points(&self, square: &[Lanes; 2], from: &ShadowPoints) -> Lanes3 {
        match &self.map {
            Some(map) if !map.map.is_smooth() => self.map_points(map, square, from),
            _ => self.cosine_points(square, from),
        }
    }

    /// End of the shadow ray from `position` in a direction of length 1.
    pub fn point(&self, position: Vec3, direction: Vec3) -> Vec3 {
        position + direction * self.reach
    }

    /// [`Environment::points`] by the cosine alone.
    ///
    /// Malley's method: Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition,
    /// A.5.3. The tangents are those of Duff et al. 2017, "Building an Orthonormal Basis,
    /// Revisited", JCGT 6(1).
    #[inline(always)]
    fn cosine_points(&self, [s, t]: &[Lanes; 2], from: &ShadowPoints) -> Lanes3 {
        let (mut q, reaches) = ([[0.0; LANES]; 3], self.reaches(&from.position));
        for i in 0..LANES {
            let [x, y] = disk([s[i], t[i]]);
            let (x, y) = (x * RADIUS, y * RADIUS);
            let up = (1.0 - x * x - y * y).max(0.0).sqrt();
            let n = lane(&from.n, i);
            let sign = 1f32.copysign(n.z);
            let a = -1.0 / (sign + n.z);
            let b = n.x * n.y * a;
            let across = Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
            let along = Vec3::new(b, sign + n.y * n.y * a, -n.y);
            let direction = across * x + along * y + n * up;
            set_lane(&mut q, i, lane(&from.position, i) + direction * reaches[i]);
        }
        q
    }

    /// [`Environment::points`] with directions of the map in the part of the square where s is
    /// below [`MAP_SHARE`]. Both parts of a stratified set are stratified.
    #[inline(always)]
    fn map_points(&self, map: &TurnedMap, [s, t]: &[Lanes; 2], from: &ShadowPoints) -> Lanes3 {
        let mut rest = [0.0; LANES];
        for i in 0..LANES {
            rest[i] = ((s[i] - MAP_SHARE) / (1.0 - MAP_SHARE)).max(0.0);
        }
        let mut q = self.cosine_points(&[rest, *t], from);
        for i in (0..LANES).filter(|&i| s[i] < MAP_SHARE) {
            let direction = map.in_world(map.map.direction([s[i] / MAP_SHARE, t[i]]));
            set_lane(&mut q, i, lane(&from.position, i) + direction * self.reach);
        }
        q
    }

    /// Divides the diffuse and specular weights of the light points `q` by the density of their
    /// directions, relative to 1 / pi. For an environment without a map.
    #[inline(always)]
    pub fn weigh(&self, points: &ShadowPoints, q: &Lanes3, weights: &mut LightWeights) {
        // The cosine of the diffuse term cancels out.
        weights.diffuse = points.kd;
        for i in 0..LANES {
            let to_light = lane(q, i) - lane(&points.position, i);
            let cosine = lane(&points.n, i).dot(to_light) * (1.0 / to_light.dot(to_light).sqrt());
            weights.specular[i] *= 1.0 / cosine;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_have_the_density_of_the_cosine() {
        let environment = Environment { reach: 4.0, is_near: false, map: None };
        for n in [Vec3::Y, -Vec3::Z, Vec3::Z, Vec3::new(0.6, 0.0, -0.8)] {
            let mut points = ShadowPoints::EMPTY;
            for i in 0..LANES {
                set_lane(&mut points.n, i, n);
                set_lane(&mut points.position, i, Vec3::new(0.5, -1.0, 2.0));
            }
            let (mut squares, mut sides) = (0.0, Vec3::ZERO);
            let at = |k: usize| [(k as f32 + 0.5) / 64.0; LANES];
            for (s, t) in (0..64).flat_map(|i| (0..64).map(move |k| (i, k))) {
                let q = environment.points(&[at(s), at(t)], &points);
                let direction = (lane(&q, 0) - Vec3::new(0.5, -1.0, 2.0)) / 4.0;
                assert!((direction.length() - 1.0).abs() < 1e-5);
                assert!(direction.dot(n) > 0.0);
                squares += direction.dot(n).powi(2) / 4096.0;
                sides += (direction - n * direction.dot(n)) / 4096.0;
            }
            // The mean of the squared cosine is 1/2. Its error on the grid is below 1e-3, as it has
            // no steep end, unlike that of the cosine.
            assert!((squares - 0.5).abs() < 1e-3, "{n}: {squares}");
            assert!(sides.length() < 1e-3, "{n}: {sides}");
        }
    }

    #[test]
    fn directions_in_the_horizon_are_above_it() {
        let environment = Environment { reach: 1.0, is_near: false, map: None };
        let mut points = ShadowPoints::EMPTY;
        set_lane(&mut points.n, 0, Vec3::Y);
        for edge in [[0.0, 0.5], [0.5, 0.0], [0.999_999_94, 0.5], [0.0, 0.0]] {
            let q = environment.points(&edge.map(|x| [x; LANES]), &points);
            assert!(lane(&q, 0).y > 1e-4);
        }
    }

    #[test]
    fn short_rays_are_as_long_as_the_rounding_of_their_point_needs() {
        let environment = Environment::within(1e-5);
        let (n, mut points) = (Vec3::new(0.3, 1.0, 0.1).normalize(), ShadowPoints::EMPTY);
        let starts = [Vec3::new(1e-3, -2.0, 0.5), Vec3::new(250.3, -999.7, 3.1)];
        for (start, length) in starts.into_iter().zip([1e-5, 999.7 / 524_288.0]) {
            for i in 0..LANES {
                set_lane(&mut points.n, i, n);
                set_lane(&mut points.position, i, start);
            }
            let at = |k: usize| [(k as f32 + 0.5) / 64.0; LANES];
            let (mut below, mut sum) = (0, 0.0);
            for (s, t) in (0..64).flat_map(|i| (0..64).map(move |k| (i, k))) {
                let way = lane(&environment.points(&[at(s), at(t)], &points), 7) - start;
                below += u32::from(way.dot(n) <= 0.0);
                sum += way.length() / 4096.0;
            }
            assert!(below < 4, "{start}: {below} of 4096");
            assert!((sum / length - 1.0).abs() < 0.02, "{start}: {sum}");
        }
    }
}
