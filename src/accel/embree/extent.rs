//! How large a mesh and its triangles are: tells most true hits without a look at the triangle.

use glam::DVec3;
use rayon::prelude::*;

use super::candidate::Candidate;
use crate::geometry::TriangleMesh;

/// Triangles that share one longest edge.
const BLOCK: usize = 256;

/// 2^-24.
const UNIT: f64 = 0.5 * f32::EPSILON as f64;

/// The size of a mesh and of its triangles.
pub struct Extent {
    centre: DVec3,
    /// No vertex is farther from the centre.
    radius: f64,
    /// The longest edge, rounded up, of each [`BLOCK`] triangles in order.
    edges: Vec<f32>,
}

impl Extent {
    /// Of the mesh's triangles.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let vertices = mesh.vertices();
        let widen = |[low, high]: [DVec3; 2], v: DVec3| [low.min(v), high.max(v)];
        let none = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let [low, high] = vertices
            .par_chunks(1 << 14)
            .map(|part| part.iter().fold(none, |bounds, v| widen(bounds, dvec(*v))))
            .reduce(|| none, |a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        let corner = |i: u32| dvec(vertices[i as usize]);
        let longest = |part: &[[u32; 3]]| {
            let square = part.iter().fold(0.0f64, |most, &[a, b, c]| {
                let (a, b, c) = (corner(a), corner(b), corner(c));
                let longest = (a - b).length_squared().max((b - c).length_squared());
                most.max(longest).max((c - a).length_squared())
            });
            (square.sqrt() * (1.0 + f64::from(f32::EPSILON))) as f32
        };
        let edges = mesh.triangles().par_chunks(BLOCK).map(longest).collect();
        Self { centre: (low + high) * 0.5, radius: (high - low).length() * 0.5, edges }
    }

    /// Whether the candidate, a hit by Embree's own test, is one beyond all doubt, within the ray's ends.
    ///
    /// With E the longest edge, L the farthest corner's distance from the origin, d the direction, n
    /// the normal and u = 2^-24, q = u E L |d| / |n . d| is the unit in which the test may be off:
    ///
    /// - Each of Embree's U, V, W is off by at most 9u E 2L |d| ([`crate::geometry::passing`]), and the corners
    ///   it sees, each off by u L in a coordinate, change it by at most 7u E L |d| more once the three agree
    ///   on a side, as the line then passes no farther from a corner than E. Their sum is 2 n . d to 80u E L |d|.
    ///   So a weight above 12.5 q / (1 - 40 q), 20 q for q < 1 / 128, is one of which the sign is sure; and the
    ///   line meets the triangle if all three are. The weights themselves are rounded.
    /// - n is off by 6u E^2 and its products with a corner or d by 3u of their permanents, so t is off by at
    ///   most 20u L E^2 / |n . d|, and by 3^0.5 u L E^2 / |n . d| as the corners move, n . d itself by 20 q:
    ///   32 q E / |d|.
    #[inline(always)]
    pub fn sure(&self, candidate: &Candidate) -> bool {
        let Candidate { origin, direction, normal, .. } = *candidate;
        let edge = f64::from(self.edges[candidate.prim as usize / BLOCK]);
        let far = sum(origin - self.centre) + self.radius;
        let length = sum(direction);
        let facing = normal.dot(direction).abs();
        let off = UNIT * edge * far;
        // What underflows or overflows in f32 is not what the bounds are about.
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

fn dvec(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

/// At least the length, at most 3^0.5 of it.
#[inline(always)]
fn sum(v: DVec3) -> f64 {
    v.x.abs() + v.y.abs() + v.z.abs()
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

    /// Embree's ROBUST test: u, v, t and the normal.
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

    /// Rays at the inside and the edges of triangles of all shapes: sure only of what f64 finds too.
    #[test]
    fn what_is_sure_is_met() {
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
            // Weights around 0 reach both sides of the edges.
            let (u, v) = (within(-0.01, 1.0), within(-0.01, 1.0));
            let [p, q, r] = corners.map(dvec);
            let to = p + (q - p) * u + (r - p) * v * (1.0 - u);
            let direction = (to - dvec(from)) * within(0.1, 10.0);
            let toward = direction.as_vec3().to_array();
            let Some(([u, v, t], normal)) = robust(corners, from, toward) else { continue };
            let mesh = TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2]], false);
            let candidate = Candidate {
                origin: dvec(from),
                direction: dvec(toward),
                normal: dvec(normal),
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
