//! 16 shading points as structures of arrays.

use crate::geometry::NONE;
use crate::ray::{LANES, Mask, Rays};
pub use crate::ray::{lane, set_lane};

/// One float per lane.
pub type Lanes = [f32; LANES];

/// One vector per lane.
pub type Lanes3 = [Lanes; 3];

/// The part of 16 shading points that light sampling reads.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct ShadowPoints {
    /// Position P, relative to the scene's origin.
    pub position: Lanes3,
    /// Origin of the shadow rays: P', outside the surface.
    pub origin: Lanes3,
    /// Unit geometric normal, on the viewer's side.
    pub ng: Lanes3,
    /// Unit shading normal, on the side of `ng`.
    pub n: Lanes3,
    /// Unit direction to the viewer.
    pub view: Lanes3,
    /// Coefficient kd of the diffuse term, by lane.
    pub kd: Lanes,
    /// Coefficient ks of the specular term, by lane.
    pub ks: Lanes,
    /// Exponent of the specular term.
    pub exponent: Lanes,
    /// Scene-wide index of the primitive, by lane.
    pub primitive: [u32; LANES],
    /// Lanes whose shadow origin is lifted off the surface (smooth normals).
    pub lifted: Mask,
    /// Lanes that hit anything.
    pub hit: Mask,
}

impl ShadowPoints {
    /// No lane has a point.
    pub const EMPTY: Self = Self {
        position: [[0.0; LANES]; 3],
        origin: [[0.0; LANES]; 3],
        ng: [[0.0; LANES]; 3],
        n: [[0.0; LANES]; 3],
        view: [[0.0; LANES]; 3],
        kd: [0.0; LANES],
        ks: [0.0; LANES],
        exponent: [0.0; LANES],
        primitive: [NONE; LANES],
        lifted: Mask::NONE,
        hit: Mask::NONE,
    };

    /// Copies the points of `lanes`. Lanes from `count` on lose their `hit`.
    #[inline(always)]
    pub fn gather(&mut self, from: &Self, lanes: &[usize; LANES], count: usize) {
        let pick3 = |to: &mut Lanes3, from: &Lanes3, i: usize, j: usize| {
            for axis in 0..3 {
                to[axis][i] = from[axis][j];
            }
        };
        for i in 0..LANES {
            let j = lanes[i] % LANES;
            pick3(&mut self.position, &from.position, i, j);
            pick3(&mut self.origin, &from.origin, i, j);
            pick3(&mut self.ng, &from.ng, i, j);
            pick3(&mut self.n, &from.n, i, j);
            pick3(&mut self.view, &from.view, i, j);
            self.kd[i] = from.kd[j];
            self.ks[i] = from.ks[j];
            self.exponent[i] = from.exponent[j];
            self.primitive[i] = from.primitive[j];
            self.lifted.0[i] = from.lifted.0[j];
            self.hit.0[i] = if i < count { from.hit.0[j] } else { 0 };
        }
    }
}

/// 16 shading points with everything that shading reads.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub struct Points {
    /// The part that light sampling reads.
    pub at: ShadowPoints,
    /// Base colour of the surface, by lane.
    pub base: Lanes3,
    /// Coefficient ka of the ambient term, by lane.
    pub ka: Lanes,
    /// Coefficient kr of the mirror term, by lane.
    pub kr: Lanes,
}

impl Points {
    /// No lane has a point.
    pub const EMPTY: Self = Self {
        at: ShadowPoints::EMPTY,
        base: [[0.0; LANES]; 3],
        ka: [0.0; LANES],
        kr: [0.0; LANES],
    };
}

/// Smallest R.Ng of a mirrored ray: twice the largest effect of rounding.
const MIN_RISE: f32 = 8.0 * f32::EPSILON;

/// Sets `rays` to the mirrored rays in all lanes. Returns the lanes that have a point with kr > 0.
///
/// R = reflect(D, N). If R points below the surface (R.Ng <= 0), it is mirrored at the plane of Ng.
/// R then rises by at least `MIN_RISE`, so that rounding does not send it into its own surface.
#[inline(always)]
pub fn reflect(points: &Points, outside: &Lanes3, rays: &mut Rays) -> Mask {
    let mut active = Mask::NONE;
    for i in 0..LANES {
        let (n, ng) = (lane(&points.at.n, i), lane(&points.at.ng, i));
        let d = -lane(&points.at.view, i);
        let r = d - n * (2.0 * d.dot(n));
        let below = r.dot(ng).min(0.0);
        let r = r - ng * (2.0 * below);
        let r = r + ng * (MIN_RISE - r.dot(ng)).max(0.0);
        let r = r * (1.0 / r.dot(r).sqrt());
        set_lane(&mut rays.org, i, lane(outside, i));
        set_lane(&mut rays.dir, i, r);
        rays.tnear[i] = 0.0;
        rays.tfar[i] = f32::INFINITY;
        rays.leaving[i] = points.at.primitive[i];
        active.0[i] = points.at.hit.0[i] & -i32::from(points.kr[i] > 0.0);
    }
    active
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn mirrored_rays_leave_the_surface() {
        let mut points = Points::EMPTY;
        points.at.hit.0[0] = -1;
        points.kr[0] = 0.5;
        set_lane(&mut points.at.ng, 0, Vec3::Y);
        set_lane(&mut points.at.n, 0, Vec3::Y);
        let view = Vec3::new(-0.6, 0.8, 0.0);
        set_lane(&mut points.at.view, 0, view);
        let mut rays = Rays::EMPTY;
        let active = reflect(&points, &[[0.0; LANES]; 3], &mut rays);
        assert_eq!(active.count(), 1);
        assert!((lane(&rays.dir, 0) - Vec3::new(0.6, 0.8, 0.0)).length() < 1e-6);

        // The shading normal leans so far that the mirrored ray would go below the surface.
        set_lane(&mut points.at.n, 0, Vec3::new(0.9, 0.435_889_9, 0.0).normalize());
        reflect(&points, &[[0.0; LANES]; 3], &mut rays);
        assert!(lane(&rays.dir, 0).y > 0.0);
        assert!((lane(&rays.dir, 0).length() - 1.0).abs() < 1e-6);
    }
}
