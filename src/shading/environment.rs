//! Directions of an environment: light of the same radiance from all sides.

use super::points::{Lanes, Lanes3, ShadowPoints, lane, set_lane};
use super::sun::reach;
use crate::geometry::Geometry;
use crate::ray::LANES;
use crate::sampler::disk;

/// The radius of the disk whose points become directions. A direction in the horizon itself would
/// be lost to rounding.
const RADIUS: f32 = 1.0 - f32::EPSILON;

/// Directions over the hemisphere of each shading point, with a density of cosine / pi.
///
/// So a diffuse surface receives the same from every direction, and the mean over the visible ones
/// has no error but that of their visibility: a white surface of a convex body returns exactly the
/// radiance.
#[derive(Debug, Clone, Copy)]
pub struct Environment {
    /// Length of the shadow rays: they end outside of the scene.
    reach: f32,
}

impl Environment {
    /// The environment of these primitives.
    pub fn new(geometry: &Geometry) -> Self {
        Self { reach: reach(geometry) as f32 }
    }

    /// Ends of the shadow rays from `from`, for 16 points (s, t) in the unit square.
    ///
    /// Malley's method: Pharr, Jakob and Humphreys, "Physically Based Rendering", 4th edition,
    /// A.5.3. The tangents are those of Duff et al. 2017, "Building an Orthonormal Basis,
    /// Revisited", JCGT 6(1).
    #[inline(always)]
    pub fn points(&self, [s, t]: &[Lanes; 2], from: &ShadowPoints) -> Lanes3 {
        let mut q = [[0.0; LANES]; 3];
        for i in 0..LANES {
            let [x, y] = disk([s[i], t[i]]);
            let (x, y) = (x * RADIUS, y * RADIUS);
            let up = (1.0 - x * x - y * y).max(0.0).sqrt();
            let n = lane(&from.n, i);
            let sign = 1f32.copysign(n.z);
            let a = -1.0 / (sign + n.z);
            let b = n.x * n.y * a;
            let across = glam::Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
            let along = glam::Vec3::new(b, sign + n.y * n.y * a, -n.y);
            let direction = across * x + along * y + n * up;
            set_lane(&mut q, i, lane(&from.position, i) + direction * self.reach);
        }
        q
    }

    /// Divides the diffuse and specular weights of the light points `q` by the density of their
    /// directions, relative to 1 / pi.
    #[inline(always)]
    pub fn weigh(
        &self,
        points: &ShadowPoints,
        q: &Lanes3,
        diffuse: &mut Lanes,
        specular: &mut Lanes,
    ) {
        // The cosine of the diffuse term cancels out.
        *diffuse = points.kd;
        for i in 0..LANES {
            let to_light = lane(q, i) - lane(&points.position, i);
            let cosine = lane(&points.n, i).dot(to_light) * (1.0 / to_light.dot(to_light).sqrt());
            specular[i] *= 1.0 / cosine;
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    #[test]
    fn directions_have_the_density_of_the_cosine() {
        let environment = Environment { reach: 4.0 };
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
            // The mean of the squared cosine is 1/2. Its error on the grid is below 1e-3, as it has no
            // steep end, unlike that of the cosine.
            assert!((squares - 0.5).abs() < 1e-3, "{n}: {squares}");
            assert!(sides.length() < 1e-3, "{n}: {sides}");
        }
    }

    #[test]
    fn directions_in_the_horizon_are_above_it() {
        let environment = Environment { reach: 1.0 };
        let mut points = ShadowPoints::EMPTY;
        set_lane(&mut points.n, 0, Vec3::Y);
        for edge in [[0.0, 0.5], [0.5, 0.0], [0.999_999_94, 0.5], [0.0, 0.0]] {
            let q = environment.points(&edge.map(|x| [x; LANES]), &points);
            assert!(lane(&q, 0).y > 1e-4);
        }
    }
}
