//! Interpolated normals of smooth meshes, for all lanes at once.

use super::points::{Lanes, Lanes3, Points};
use crate::geometry::round_towards;
use crate::ray::{LANES, Mask};

/// The triangles of smooth meshes that the lanes of a packet hit.
pub struct SmoothTriangles {
    /// By corner: its position relative to the scene's origin.
    corners: [Lanes3; 3],
    /// By corner: its unit normal, or zero for a missing one.
    normals: [Lanes3; 3],
    /// By corner: its barycentric weight.
    weights: [Lanes; 3],
    /// Lanes that hit a smooth mesh.
    active: Mask,
}

impl SmoothTriangles {
    /// No lane hits a smooth mesh.
    pub const NONE: Self = Self {
        corners: [[[0.0; LANES]; 3]; 3],
        normals: [[[0.0; LANES]; 3]; 3],
        weights: [[0.0; LANES]; 3],
        active: Mask::NONE,
    };

    /// Sets the triangle of lane `i`, which is hit at these barycentric weights.
    #[inline(always)]
    pub fn set(
        &mut self,
        i: usize,
        corners: [[f32; 3]; 3],
        normals: [[f32; 3]; 3],
        weights: [f32; 3],
    ) {
        for c in 0..3 {
            for axis in 0..3 {
                self.corners[c][axis][i] = corners[c][axis];
                self.normals[c][axis][i] = normals[c][axis];
            }
            self.weights[c][i] = weights[c];
        }
        self.active.0[i] = -1;
    }

    /// Sets the interpolated normals, and lifts the origins of secondary rays off the facets.
    ///
    /// Hanika 2021, "Hacking the Shadow Terminator", Ray Tracing Gems II ch. 4: P' = P - sum w_i
    /// min(0, (P - V_i).N_i) N_i. Corner normals are negated if N is. A corner normal that then
    /// faces away from Ng would push the origin below the facet, so it lifts nothing. If the
    /// normals cancel or are missing, N = Ng and P' = P.
    #[inline(always)]
    pub fn interpolate(&self, out: &mut Points) {
        let at = &mut out.at;
        let ([nx, ny, nz], ng) = (self.mean(&self.normals), &at.ng);
        let (mut n, mut side, mut smooth) = ([[0.0; LANES]; 3], [1.0; LANES], Mask::NONE);
        for i in 0..LANES {
            let shrink = 1.0 / (nx[i] * nx[i] + ny[i] * ny[i] + nz[i] * nz[i]).sqrt();
            let valid = (shrink > 0.0) & (shrink < f32::INFINITY);
            smooth.0[i] = self.active.0[i] & -i32::from(valid);
            let (x, y, z) = (nx[i] * shrink, ny[i] * shrink, nz[i] * shrink);
            side[i] = if x * ng[0][i] + y * ng[1][i] + z * ng[2][i] < 0.0 { -1.0 } else { 1.0 };
            (n[0][i], n[1][i], n[2][i]) = (x * side[i], y * side[i], z * side[i]);
        }
        let lift = self.lift(ng, &side);
        let mut lifted = Mask::NONE;
        for i in 0..LANES {
            let any = (lift[0][i] != 0.0) | (lift[1][i] != 0.0) | (lift[2][i] != 0.0);
            lifted.0[i] = smooth.0[i] & -i32::from(any);
        }
        for axis in 0..3 {
            for i in 0..LANES {
                let exact = f64::from(at.origin[axis][i]) + f64::from(lift[axis][i]);
                let outside = round_towards(exact, exact as f32, f64::from(at.ng[axis][i]));
                at.origin[axis][i] = if lifted.0[i] != 0 { outside } else { at.origin[axis][i] };
                at.n[axis][i] = if smooth.0[i] != 0 { n[axis][i] } else { at.n[axis][i] };
            }
        }
        for i in 0..LANES {
            at.lifted.0[i] |= lifted.0[i];
        }
    }

    /// How far the origins are moved: see [`SmoothTriangles::interpolate`].
    #[inline(always)]
    fn lift(&self, ng: &Lanes3, side: &Lanes) -> Lanes3 {
        let mut lift = [[0.0; LANES]; 3];
        for c in 0..3 {
            // P - V_c from the edges, so that large coordinates do not cancel.
            let edges = [self.edge(0, c), self.edge(1, c), self.edge(2, c)];
            let ([px, py, pz], [nx, ny, nz]) = (self.mean(&edges), &self.normals[c]);
            for i in 0..LANES {
                let (x, y, z) = (nx[i] * side[i], ny[i] * side[i], nz[i] * side[i]);
                let faces = x * ng[0][i] + y * ng[1][i] + z * ng[2][i] > 0.0;
                let weight = if faces { self.weights[c][i] } else { 0.0 };
                let height = px[i] * x + py[i] * y + pz[i] * z;
                let below = weight * if height < 0.0 { height } else { 0.0 };
                lift[0][i] -= x * below;
                lift[1][i] -= y * below;
                lift[2][i] -= z * below;
            }
        }
        lift
    }

    /// Vectors from corner `from` to corner `to`.
    #[inline(always)]
    fn edge(&self, to: usize, from: usize) -> Lanes3 {
        let (to, from) = (&self.corners[to], &self.corners[from]);
        let mut edge = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                edge[axis][i] = to[axis][i] - from[axis][i];
            }
        }
        edge
    }

    /// Sum of the corners' vectors times their weights.
    #[inline(always)]
    fn mean(&self, [a, b, c]: &[Lanes3; 3]) -> Lanes3 {
        let [wa, wb, wc] = &self.weights;
        let mut sum = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                sum[axis][i] = a[axis][i] * wa[i] + b[axis][i] * wb[i] + c[axis][i] * wc[i];
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shading::{lane, set_lane};
    use glam::Vec3;

    const CORNERS: [[f32; 3]; 3] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

    /// Lane 3 on a facet with these normals, seen from above.
    fn smooth(normals: [Vec3; 3], weights: [f32; 3]) -> Points {
        let (mut triangles, mut points) = (SmoothTriangles::NONE, Points::EMPTY);
        for v in [&mut points.at.ng, &mut points.at.n] {
            (0..LANES).for_each(|i| set_lane(v, i, Vec3::Z));
        }
        triangles.set(3, CORNERS, normals.map(|n| n.to_array()), weights);
        triangles.interpolate(&mut points);
        for i in (0..LANES).filter(|&i| i != 3) {
            let at = &points.at;
            assert_eq!((lane(&at.n, i), lane(&at.origin, i)), (Vec3::Z, Vec3::ZERO));
            assert_eq!(at.lifted.0[i], 0);
        }
        points
    }

    #[test]
    fn a_convex_corner_lifts_the_shadow_origin() {
        let out_and_up = |x: f32, y: f32| Vec3::new(x, y, 3.0).normalize();
        let normals = [out_and_up(-1.0, -1.0), out_and_up(1.0, 0.0), out_and_up(0.0, 1.0)];
        let points = smooth(normals, [1.0 / 3.0; 3]);
        // The formula, in doubles. P is a third of the way along both legs.
        let p = Vec3::new(1.0 / 3.0, 1.0 / 3.0, 0.0).as_dvec3();
        let lift = (0..3).map(|c| {
            let (v, n) = (Vec3::from(CORNERS[c]).as_dvec3(), normals[c].as_dvec3());
            -n * (p - v).dot(n).min(0.0) / 3.0
        });
        let off = lane(&points.at.origin, 3).as_dvec3() - lift.sum::<glam::DVec3>();
        assert!(lane(&points.at.origin, 3).z > 0.0 && off.length() < 1e-6, "{off}");
        assert_eq!(points.at.lifted.0[3], -1);
        assert!(lane(&points.at.n, 3).z > 0.99);
    }

    #[test]
    fn normals_facing_away_never_push_the_shadow_origin_below_the_facet() {
        let away =
            [Vec3::new(-1.0, -1.0, -0.5), Vec3::new(1.0, 0.0, 3.0), Vec3::new(0.0, 1.0, 3.0)];
        let away = away.map(Vec3::normalize);
        for (normals, turned) in [(away, 1.0), (away.map(|n| -n), -1.0)] {
            let points = smooth(normals, [1.0 / 3.0; 3]);
            assert!(lane(&points.at.origin, 3).z >= 0.0);
            let mean = (normals[0] + normals[1] + normals[2]).normalize() * turned;
            assert!((lane(&points.at.n, 3) - mean).length() < 1e-6, "turned to the viewer's side");
        }
    }

    #[test]
    fn cancelling_or_missing_normals_leave_the_facet_flat() {
        for normals in [[Vec3::ZERO; 3], [Vec3::Z, -Vec3::Z, Vec3::ZERO]] {
            let points = smooth(normals, [0.5, 0.5, 0.0]);
            assert_eq!(lane(&points.at.n, 3), Vec3::Z);
            assert_eq!(points.at.lifted.0[3], 0);
        }
    }
}
