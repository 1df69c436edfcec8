//! Bounds on the size of a mesh and its triangles. They confirm most true hits without reading the
//! triangle.

use glam::DVec3;

use super::candidate::Candidate;
use crate::geometry::{TriangleMesh, doubles};
use crate::parallel;

/// Number of triangles that share one bound on their longest edge.
const BLOCK: usize = 256;

/// u = 2^-24, the rounding unit of f32.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;

/// Bounding sphere of a mesh and bounds on its edges.
pub struct Extent {
    centre: DVec3,
    /// Upper bound on the distance of a vertex from the centre.
    radius: f64,
    /// Longest edge, rounded up, of every [`BLOCK`] consecutive triangles.
    edges: Vec<f32>,
}

impl Extent {
    /// Computes the bounds of a mesh.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let vertices = mesh.vertices();
        let [low, high] = mesh.bounds().map(doubles);
        let corner = |i: u32| doubles(vertices[i as usize]);
        let longest = |part: &[[u32; 3]]| {
            let square = part.iter().fold(0.0f64, |most, &[a, b, c]| {
                let (a, b, c) = (corner(a), corner(b), corner(c));
                let longest = (a - b).length_squared().max((b - c).length_squared());
                most.max(longest).max((c - a).length_squared())
            });
            (square.sqrt() * (1.0 + f64::from(f32::EPSILON))) as f32
        };
        let edges = parallel::map(mesh.triangles().chunks(BLOCK), longest);
        Self { centre: (low + high) * 0.5, radius: (high - low).length() * 0.5, edges }
    }

    /// Returns true only if the candidate, a hit by Embree's test, is certainly a hit in (`tnear`,
    /// `tfar`). Conservative: may return false for a true hit.
    ///
    /// Let E be the longest edge, L the distance of the farthest corner from the origin, d the
    /// direction, n the normal and u = 2^-24. All error bounds are in units of
    /// q = u E L |d| / |n . d|.
    ///
    /// Weights:
    ///
    /// - Each of Embree's U, V, W has an error of at most 9u E 2L |d|
    ///   ([`crate::geometry::passing`]).
    /// - Each coordinate of the corners that Embree sees has an error of u L. That adds at most
    ///   7u E L |d| if the three agree on a side: then the line passes within E of each corner.
    /// - The sum of the three is 2 n . d, with an error of 80u E L |d|.
    /// - So the sign of a weight above 12.5 q / (1 - 40 q) is certain. For q < 1 / 128 that is at
    ///   most 20 q. If all three signs are certain, the line hits the triangle. The weights
    ///   themselves are rounded too, hence the 1e-6.
    ///
    /// Distance:
    ///
    /// - n has an error of 6u E^2; its products with a corner or d, of 3u of their permanents. So t
    ///   has an error of at most 20u L E^2 / |n . d|.
    /// - The errors of the corners add 3^0.5 u L E^2 / |n . d|. n . d has a relative error of 20 q.
    /// - Together: 32 q E / |d|.
    #[inline(always)]
    pub fn sure(&self, candidate: &Candidate) -> bool {
        let Candidate { origin, direction, normal, .. } = *candidate;
        let edge = f64::from(self.edges[candidate.prim as usize / BLOCK]);
        // Upper bounds on lengths: the sum of the magnitudes is at most 3^0.5 times the length.
        let far = (origin - self.centre).abs().element_sum() + self.radius;
        let length = direction.abs().element_sum();
        let facing = normal.dot(direction).abs();
        let off = UNIT * edge * far;
        // The bounds hold only without underflow and overflow in f32.
        if !(off.min(off * length) > 1e-34 && facing < 1e34) {
            return false;
        }
        let q = off * length / facing;
        let (u, v) = (f64::from(candidate.u), f64::from(candidate.v));
        let slack = 3f64.sqrt() * 32.0 * q * edge / length;
        (q < 1.0 / 128.0)
            & (u.min(v).min(1.0 - u - v) > 20.0 * q + 1e-6)
            & (candidate.t - slack > candidate.tnear)
            & (candidate.t + slack < candidate.tfar)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{NONE, refine_triangle};

    fn minus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
        [0, 1, 2].map(|i| a[i] - b[i])
    }

    fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }

    /// Embree's ROBUST triangle test in f32: returns u, v, t and the normal.
    fn robust(corners: [[f32; 3]; 3], o: [f32; 3], d: [f32; 3]) -> Option<([f32; 3], [f32; 3])> {
        let [a, b, c] = corners.map(|corner| minus(corner, o));
        let (e0, e1, e2) = (minus(c, a), minus(a, b), minus(b, c));
        let side = |e, p: [f32; 3], q: [f32; 3]| dot(cross(e, [0, 1, 2].map(|i| p[i] + q[i])), d);
        let (u, v, w) = (side(e0, c, a), side(e1, a, b), side(e2, b, c));
        let (all, slack) = (u + v + w, f32::EPSILON * (u + v + w).abs());
        if u.min(v).min(w) < -slack && u.max(v).max(w) > slack {
            return None;
        }
        let normal = cross(e0, e1);
        let t = dot(a, normal) / dot(normal, d);
        t.is_finite().then(|| ([(u / all).min(1.0), (v / all).min(1.0), t], normal))
    }

    /// Traces rays at the inside and the edges of triangles of all shapes. Every hit that is `sure`
    /// must be a hit in f64.
    #[test]
    fn sure_hits_are_hits_in_f64() {
        let mut state = 7u64;
        // Knuth's generator (MMIX); its high bits are good.
        let mut within = |low: f64, high: f64| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            low + (high - low) * ((state >> 11) as f64 / (1u64 << 53) as f64)
        };
        let (mut sure, mut hits, mut ordinary, mut ordinary_sure) = (0, 0, 0, 0);
        for round in 0..400_000u32 {
            let scale = 10f64.powf(within(-3.0, 3.0));
            let thin = if round % 2 == 0 { 1.0 } else { 10f64.powf(within(-6.0, 0.0)) };
            let mut point = |s: f64| DVec3::from([0; 3].map(|_| within(-s, s)));
            let (centre, a, side) = (point(1.0), point(scale), point(scale));
            let corners = [a, a + side, a + side * 0.5 + point(scale * thin)];
            let corners = corners.map(|v| (v + centre).as_vec3().to_array());
            let from = point(4.0).as_vec3().to_array();
            // Weights below and above 0 lie on both sides of the edges.
            let (u, v) = (within(-0.01, 1.0), within(-0.01, 1.0));
            let [p, q, r] = corners.map(doubles);
            let to = p + (q - p) * u + (r - p) * v * (1.0 - u);
            let direction = (to - doubles(from)) * within(0.1, 10.0);
            let toward = direction.as_vec3().to_array();
            let Some(([u, v, t], normal)) = robust(corners, from, toward) else { continue };
            let mesh = TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2]], false);
            let candidate = Candidate {
                origin: doubles(from),
                direction: doubles(toward),
                normal: doubles(normal),
                tnear: 0.0,
                tfar: f64::from(t) * within(1.0 - 1e-5, 1.0 + 1e-3),
                t: t.into(),
                u,
                v,
                prim: 0,
                geom: 0,
                leaving: NONE,
            };
            hits += 1;
            let is_sure = Extent::new(&mesh).sure(&candidate);
            if thin == 1.0 && (0.1..1.0).contains(&scale) && candidate.tfar > 1.0002 * f64::from(t)
            {
                ordinary += 1;
                ordinary_sure += u32::from(is_sure);
            }
            if is_sure {
                sure += 1;
                let exact =
                    refine_triangle([p, q, r], candidate.origin, candidate.direction, (0.0, 0.0));
                assert!(exact.met, "{corners:?} {from:?} {toward:?}");
                assert!(exact.t > 0.0 && exact.t < candidate.tfar, "{} {t}", exact.t);
            }
        }
        assert!(sure > hits / 4, "{sure} of {hits}");
        assert!(ordinary_sure > ordinary * 9 / 10, "{ordinary_sure} of {ordinary}");
    }
}
