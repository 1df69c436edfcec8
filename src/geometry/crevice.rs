//! Crevices: the surfaces that meet at an inner edge, for the rays that leave a point near it.
//!
//! A hit's point is rounded to f32, to the outside of its own primitive. At an inner edge, as in
//! the corner of a room, another primitive rises above it. The rounded point may lie behind that
//! primitive, and a test in f32, which moves corners, may let a ray slip between the two. So near
//! an edge the walls are tested in f64 from the exact point, which lies in front of all of them.
//!
//! A ray that comes in through a corner hits several triangles at one t. A backend reports any of
//! them, even one whose other side faces the viewer. [`hides`] finds the one in front.

use glam::DVec3;

use super::doubles::doubles;
use super::nearby::Nearby;
use super::primitives::Geometry;
use super::quad::on_quad_half;

/// Tolerance of weights at an edge: some thousand roundings of f64.
const EQUAL: f64 = 1.0 / (1u64 << 43) as f64;

/// How far the point is moved into its own triangle: relative to the vector to the triangle's
/// middle, and relative to the point's coordinates. Far more than the rounding of f64, far less
/// than that of f32. The moved point lies on no edge, and in front of the walls.
const INWARD: [f64; 2] = [1.0 / (1u64 << 36) as f64, 1.0 / (1u64 << 44) as f64];

/// A triangle near the point.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    /// Scene-wide index of the primitive.
    primitive: u32,
    corners: [DVec3; 3],
    /// `(v1 - v0) x (v2 - v0)`.
    normal: DVec3,
    /// Whether this is the half v2, v3, v1 of a quad.
    second_half: bool,
}

/// Where a ray from the exact point hits a wall.
#[derive(Debug, Clone, Copy)]
pub struct WallHit {
    /// Ray parameter, in units of the direction; >= 0.
    pub t: f64,
    /// Scene-wide index of the primitive.
    pub primitive: u32,
    /// Weight of the second corner, as a backend reports it.
    pub u: f32,
    /// Weight of the third corner, as a backend reports it.
    pub v: f32,
}

/// A point near an edge of its primitive, and the walls around it.
#[derive(Debug, Clone)]
pub struct Crevice {
    /// The point in f64, moved slightly into its triangle.
    point: DVec3,
    /// Triangles near the point that rise above its own triangle.
    walls: Vec<Triangle>,
    /// Origin of the secondary rays: the rounded point, or the nearest f32 point with no neighbour
    /// in front of it.
    pub origin: [f32; 3],
    /// Whether there is such an origin.
    pub is_clear: bool,
}

impl Crevice {
    /// Collects the walls around `point` among the `neighbours`. Returns `None` if none rises above
    /// the point's triangle. `own`, `up` and `leaving` are that triangle, its unit normal turned to
    /// the viewer, and its primitive. `origin` is the point rounded to the outside of its triangle.
    pub fn new(
        geometry: &Geometry,
        (point, origin): (DVec3, [f32; 3]),
        (own, up, leaving): ([DVec3; 3], DVec3, u32),
        neighbours: &[u32],
    ) -> Option<Self> {
        let nearby = Nearby::new(point, own);
        let others = neighbours.iter().filter(|&&primitive| primitive != leaving);
        let near = others.flat_map(|&primitive| triangles(geometry, primitive));
        let near: Vec<Triangle> = near.filter(|other| other.is_near(&nearby)).collect();
        let is_wall = |other: &Triangle| other.corners.iter().any(|&v| rises(v, point, own[0], up));
        let walls: Vec<Triangle> = near.iter().copied().filter(is_wall).collect();
        if walls.is_empty() {
            return None;
        }
        let point = inside(point, own);
        // The exact point is inside, so the segment to a valid origin crosses nothing.
        let is_inside = |origin: [f32; 3]| {
            let way = (doubles(origin) - point) * BEYOND;
            let crosses = |other: &Triangle| other.meet(point, way).is_some_and(|hit| hit.t <= 1.0);
            way.dot(up) > 0.0 && !near.iter().any(crosses)
        };
        let (mut origin, mut is_clear) = (origin, is_inside(origin));
        if !is_clear {
            let distance = |a: &[f32; 3]| doubles(*a).distance_squared(point);
            let nearest = around(point)
                .filter(|&origin| is_inside(origin))
                .min_by(|a, b| distance(a).total_cmp(&distance(b)));
            (origin, is_clear) = (nearest.unwrap_or(origin), nearest.is_some());
        }
        Some(Self { point, walls, origin, is_clear })
    }

    /// Returns the nearest hit of a ray from the point with a wall for which `counts` is true,
    /// before `tfar`.
    pub fn meet(
        &self,
        direction: DVec3,
        tfar: f64,
        counts: impl Fn(u32) -> bool,
    ) -> Option<WallHit> {
        let walls = self.walls.iter().filter(|wall| counts(wall.primitive));
        let hits = walls.filter_map(|wall| wall.meet(self.point, direction));
        hits.filter(|hit| hit.t < tfar).min_by(|a, b| a.t.total_cmp(&b.t))
    }

    /// Whether `primitive` is a wall and the ray leads away from it. A test from the rounded point
    /// may still hit that wall; such a hit is false. Other walls are not excluded, even if the ray
    /// passes them: at the edge of two walls, only the test that both share has no gap.
    pub fn leaves(&self, primitive: u32, direction: DVec3) -> bool {
        let mut own = self.walls.iter().filter(|wall| wall.primitive == primitive);
        own.any(|wall| wall.distance(self.point, direction) < 0.0)
    }
}

/// Finds the surface that hides a point from the viewer, where several are hit within rounding of
/// the point. `own` is the triangle of the point, of primitive `hit`; the viewer's ray has the
/// given `direction`. Returns the hit among the `neighbours` that is nearest to the viewer, or
/// `None` if nothing hides the point.
pub fn hides(
    geometry: &Geometry,
    point: DVec3,
    (own, hit): ([DVec3; 3], u32),
    direction: DVec3,
    neighbours: &[u32],
) -> Option<WallHit> {
    let nearby = Nearby::new(point, own);
    let others = neighbours.iter().filter(|&&primitive| primitive != hit);
    let near = others.flat_map(|&primitive| triangles(geometry, primitive));
    let hits = near.filter_map(|other| {
        let reach = nearby.reach(other.bounds())?;
        let hit = other.meet(inside(point, own), -direction)?;
        // A hit farther away is not tied with the point: the ray passes it.
        (hit.t > 0.0 && hit.t * direction.length() <= TIED * reach).then_some(hit)
    });
    hits.max_by(|a, b| a.t.total_cmp(&b.t))
}

/// The point of a triangle, moved slightly into it.
fn inside(point: DVec3, own: [DVec3; 3]) -> DVec3 {
    let middle = (own[0] + own[1] + own[2]) / 3.0 - point;
    let [least, of_coordinates] = INWARD;
    let share = of_coordinates * point.abs().max_element() / middle.abs().max_element();
    point + middle * share.max(least).min(0.25)
}

/// Whether a corner lies above the plane through `own` with the unit normal `up`, by more than
/// rounding.
fn rises(corner: DVec3, point: DVec3, own: DVec3, up: DVec3) -> bool {
    let size = (corner - point).length() + (own - point).length() + point.length();
    (corner - own).dot(up) > EQUAL * size
}

/// Largest distance of tied hits, as a multiple of a reach: the diagonal of the box around a point.
const TIED: f64 = 2.0 * 1.75;

/// How many steps of f32, in each coordinate, the search for an origin goes.
const STEPS: i32 = 2;

/// The segment to an origin is extended by this factor, so that it is clear by more than rounding.
const BEYOND: f64 = 1.0 + 1.0 / 256.0;

/// The f32 points around a point, up to [`STEPS`] steps away.
fn around(point: DVec3) -> impl Iterator<Item = [f32; 3]> {
    let [x, y, z] = point.as_vec3().to_array();
    let step = |x: f32, n: i32| x + n as f32 * (x.abs() * f32::EPSILON).max(f32::MIN_POSITIVE);
    let steps = || -STEPS..=STEPS;
    let pairs = steps().flat_map(move |i| steps().map(move |j| (i, j)));
    pairs.flat_map(move |(i, j)| steps().map(move |k| [step(x, i), step(y, j), step(z, k)]))
}

impl Triangle {
    /// The triangle's bounding box.
    fn bounds(&self) -> [DVec3; 2] {
        let [a, b, c] = self.corners;
        [a.min(b).min(c), a.max(b).max(c)]
    }

    fn is_near(&self, nearby: &Nearby) -> bool {
        nearby.reach(self.bounds()).is_some()
    }

    /// Ray parameter at the plane, in units of the direction; not finite for a ray along the plane.
    fn distance(&self, point: DVec3, direction: DVec3) -> f64 {
        (self.corners[0] - point).dot(self.normal) / self.normal.dot(direction)
    }

    /// Intersects a ray from `point` with the triangle. Edges belong to it.
    fn meet(&self, point: DVec3, direction: DVec3) -> Option<WallHit> {
        let [a, b, c] = self.corners;
        let (e1, e2, to_a) = (b - a, c - a, a - point);
        let det = self.normal.dot(direction);
        let t = self.distance(point, direction);
        let r = to_a.cross(direction);
        let (u, v) = (r.dot(e2) / det, -r.dot(e1) / det);
        let permanent = to_a.length() * direction.length() * e1.length().max(e2.length());
        let slack = (EQUAL * (1.0 + permanent / det.abs())).min(1.0 / 1024.0);
        // A ray along the plane gives NaN, which is no hit.
        if !(t >= 0.0 && u >= -slack && v >= -slack && u + v <= 1.0 + slack) {
            return None;
        }
        let (u, v) = super::triangle::clamp_barycentrics(u, v);
        let (u, v) = if self.second_half { (1.0 - u, 1.0 - v) } else { (u, v) };
        let (u, v) = on_quad_half(u as f32, v as f32, self.second_half);
        Some(WallHit { t, primitive: self.primitive, u, v })
    }
}

/// The triangles of a primitive: one, two for a quad, none for a sphere.
fn triangles(geometry: &Geometry, primitive: u32) -> impl Iterator<Item = Triangle> {
    let (geom, prim) = geometry.place(primitive);
    geometry.triangles(geom, prim).map(move |(corners, second_half)| {
        let [a, b, c] = corners;
        Triangle { primitive, corners, normal: (b - a).cross(c - a), second_half }
    })
}

/// Whether a primitive is a triangle or quad near a point.
pub fn is_near(geometry: &Geometry, primitive: u32, nearby: &Nearby) -> bool {
    triangles(geometry, primitive).any(|triangle| triangle.is_near(nearby))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor (z = 0, x and y >= 0), and walls on the planes x = 0 and y = 0.
    fn corner() -> Geometry {
        let quads = vec![
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]],
            [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        ];
        Geometry::new(DVec3::ZERO, vec![], quads, vec![]).unwrap()
    }

    fn at(point: DVec3, origin: [f32; 3]) -> Option<Crevice> {
        let geometry = corner();
        let own = [DVec3::ZERO, DVec3::X, DVec3::Y];
        Crevice::new(&geometry, (point, origin), (own, DVec3::Z, 0), &[0, 1, 2])
    }

    #[test]
    fn a_ray_into_the_wall_hits_it_even_from_the_edge() {
        let point = DVec3::new(0.0, 0.3, 0.0);
        let crevice = at(point, [-1e-8, 0.3, 1e-9]).unwrap();
        assert!(crevice.is_clear && crevice.origin[0] > 0.0 && crevice.origin[2] > 0.0);
        assert!(
            crevice.leaves(1, DVec3::X)
                && !crevice.leaves(1, -DVec3::X)
                && !crevice.leaves(0, DVec3::X)
        );
        let all = |_| true;
        let hit = crevice.meet(DVec3::new(-1.0, 0.0, 1e-6), 1.0, all).unwrap();
        assert!(hit.primitive == 1 && (0.0..1e-10).contains(&hit.t));
        assert!(
            crevice.meet(DVec3::new(1e-9, 0.0, 1.0), f64::INFINITY, all).is_none(),
            "off the wall"
        );
        // From the vertex, both walls are hit.
        let crevice = at(DVec3::ZERO, [0.0; 3]).unwrap();
        for direction in [DVec3::new(-1.0, 0.5, 0.1), DVec3::new(0.5, -1.0, 0.1)] {
            assert!(crevice.meet(direction, 1.0, all).is_some());
        }
        assert!(crevice.meet(DVec3::ONE, 1.0, all).is_none());
    }

    #[test]
    fn a_wall_is_hit_at_its_distance_from_the_point() {
        let point = DVec3::new(1e-7, 0.3, 0.0);
        let crevice = at(point, [1e-7, 0.3, 1e-9]).unwrap();
        assert!(crevice.is_clear);
        let hit = crevice.meet(DVec3::new(-1.0, 0.0, 0.5), 1.0, |_| true).unwrap();
        assert!((hit.t - 1e-7).abs() < 1e-10);
        let nearer = crevice.meet(DVec3::new(-1.0, 0.0, 0.5), 1e-8, |_| true);
        assert!(nearer.is_none(), "the light is nearer");
    }

    /// Two faces that hang from one edge, both on the viewer's side of it. The one in front hides
    /// the other, also at the edge itself.
    #[test]
    fn the_face_in_front_hides_the_other_at_a_shared_edge() {
        let mesh = super::super::TriangleMesh::new(
            vec![[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.5, -1.0], [-0.5, 0.5, -1.0]],
            vec![[0, 1, 2], [0, 1, 3]],
            false,
        );
        let geometry = Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap();
        let corners = |k| geometry.meshes[0].corners(k).map(doubles);
        let seen = |k, point, way| hides(&geometry, point, (corners(k), k), way, &[0, 1]);
        for point in [DVec3::new(0.0, 0.3, 0.0), DVec3::ZERO] {
            assert_eq!(seen(1, point, DVec3::X).map(|hit| hit.primitive), Some(0));
            assert!(seen(0, point, DVec3::X).is_none());
            assert_eq!(seen(0, point, -DVec3::X).map(|hit| hit.primitive), Some(1));
        }
        // Below the edge, the ray's two hits are far apart.
        let below = DVec3::new(-0.25, 0.5, -0.5);
        for length in [1e-3, 1.0, 1e3] {
            assert!(seen(1, below, DVec3::X * length).is_none());
            let at_edge = DVec3::new(0.0, 0.3, 0.0);
            let hit = seen(1, at_edge, DVec3::X * length);
            assert_eq!(hit.map(|hit| hit.primitive), Some(0), "{length}");
        }
    }

    #[test]
    fn surfaces_behind_the_plane_are_no_walls() {
        let geometry = corner();
        let own = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let point = DVec3::new(0.0, 0.3, 0.0);
        // Seen from below, the walls are behind the floor.
        let seen =
            Crevice::new(&geometry, (point, [0.0, 0.3, -1e-9]), (own, -DVec3::Z, 0), &[0, 1, 2]);
        assert!(seen.is_none());
    }

    #[test]
    fn a_primitive_is_near_if_its_box_is() {
        let geometry = corner();
        let near = |primitive, point: DVec3| {
            is_near(&geometry, primitive, &Nearby::new(point, [DVec3::ZERO, DVec3::X, DVec3::Y]))
        };
        assert!(near(0, DVec3::new(0.5, 0.5, 1e-7)) && near(0, DVec3::new(1.0, 0.5, -1e-7)));
        for away in [[1.5, 0.5, 0.0], [0.5, 1.5, 0.0], [0.5, 0.5, 0.125], [0.5, -0.5, 0.0]] {
            assert!(!near(0, DVec3::from(away)), "{away:?}");
        }
    }

    /// A triangle away from the origin, and the ray to its point with the weights `u` and `v`.
    fn meet(u: f64, v: f64, second_half: bool) -> Option<WallHit> {
        let corners = [[1.0, -1.0, 3.0], [3.0, 0.5, 3.5], [0.5, 3.0, 2.5]].map(DVec3::from);
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let triangle = Triangle { primitive: 7, corners, normal, second_half };
        let point = DVec3::new(0.5, 1.0, -1.0);
        let on_plane = a * (1.0 - u - v) + b * u + c * v;
        triangle.meet(point, (on_plane - point) * 0.25)
    }

    #[test]
    fn a_wall_is_hit_at_the_point_that_the_ray_is_aimed_at() {
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        let hit = meet(0.25, 0.625, false).unwrap();
        assert!((hit.t - 4.0).abs() < 1e-12 && hit.primitive == 7);
        assert!(near(hit.u.into(), 0.25) && near(hit.v.into(), 0.625));
        let hit = meet(0.25, 0.625, true).unwrap();
        assert!(near(hit.u.into(), 0.75) && near(hit.v.into(), 0.375));
    }

    #[test]
    fn edges_of_a_wall_are_hit_up_to_the_rounding_of_f64() {
        for (off, expected) in [(0.0, true), (1e-14, true), (1e-10, false), (1e-2, false)] {
            for (u, v) in [(-off, 0.5), (0.5, -off), (0.5, 0.5 + off)] {
                assert_eq!(meet(u, v, false).is_some(), expected, "{u} {v}");
            }
        }
    }

    /// Almost in the plane, weights are imprecise. The tolerance has a limit, and does not depend
    /// on the unit of length.
    #[test]
    fn the_tolerance_grows_for_a_grazing_ray_up_to_a_limit() {
        for (unit, length) in
            [(1.0, 1.0), (1048576.0, 1.0), (1e-6, 1.0), (1.0, 1024.0), (1.0, 1e-3)]
        {
            let corners = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|v| v * unit);
            let normal = DVec3::Z * unit * unit;
            let wall = Triangle { primitive: 0, corners, normal, second_half: false };
            for (slope, off, expected) in [
                (1e-8, 1e-6, true),
                (1e-8, 1e-4, false),
                (1e-13, 0.9 / 1024.0, true),
                (1e-13, 1.2 / 1024.0, false),
            ] {
                let point = DVec3::new(-1.0, -off, slope) * unit;
                let met = wall.meet(point, DVec3::new(1.25, 0.0, -slope) * length);
                assert_eq!(met.is_some(), expected, "{slope:e} {off:e} {unit:e} {length:e}");
            }
        }
    }

    #[test]
    fn the_point_is_moved_into_its_triangle_by_little() {
        let moved = |point: DVec3, own| inside(point, own) - point;
        let own = [DVec3::ZERO, DVec3::X * 3.0, DVec3::Y * 3.0];
        // By 2^-36 of the way to the middle.
        let [share, of_coordinates] = INWARD;
        let way = moved(DVec3::X, own);
        assert!((way - DVec3::Y * share).length() < 0.01 * share, "{way}");
        // By a fraction of the coordinates if these are large.
        let far = DVec3::Z * 4096.0;
        let way = moved(far + DVec3::X * 4.0, own.map(|v| v * 2.0 + far));
        let expected = DVec3::new(-1.0, 1.0, 0.0) * 4096.0 * of_coordinates;
        assert!((way - expected).length() < 0.02 * expected.length(), "{way} {expected}");
        // By at most a quarter of the way.
        let tiny = own.map(|v| v * 2f64.powi(-40) + far);
        let way = moved(tiny[1], tiny);
        assert!((way - ((tiny[0] + tiny[1] + tiny[2]) / 3.0 - tiny[1]) * 0.25).length() < 1e-12);
    }

    #[test]
    fn a_corner_rises_if_it_is_above_the_plane_by_more_than_rounding() {
        let up = DVec3::Z;
        // The size is 3 + 4 + 12 in all.
        let (point, own) = (DVec3::X * 12.0, DVec3::new(12.0, 4.0, 0.0));
        for (height, expected) in [(1.1, true), (0.9, false), (-1.1, false)] {
            let corner = DVec3::new(15.0, 0.0, height * EQUAL * 19.0);
            assert_eq!(rises(corner, point, own, up), expected, "{height}");
            // A plane away from zero: the size grows by its height.
            let above = DVec3::Z * 5.0;
            let corner = DVec3::new(15.0, 0.0, 5.0 + height * EQUAL * 20.0);
            assert_eq!(rises(corner, point + above, own + above, up), expected, "{height}");
        }
    }

    fn mesh(vertices: Vec<[f32; 3]>, triangles: Vec<[u32; 3]>) -> Geometry {
        let mesh = super::super::TriangleMesh::new(vertices, triangles, false);
        Geometry::new(DVec3::ZERO, vec![mesh], vec![], vec![]).unwrap()
    }

    /// The other triangle lies in the plane x + y + z = 0, and the point below it.
    #[test]
    fn hits_are_tied_up_to_twice_the_diagonal_of_what_is_near() {
        let vertices = vec![[8.0, -4.0, -4.0], [-4.0, 8.0, -4.0], [-4.0, -4.0, 8.0], [-4.0; 3]];
        let geometry = mesh(vertices, vec![[3, 0, 1], [0, 1, 2]]);
        let own = geometry.meshes[0].corners(0).map(doubles);
        let across = DVec3::ONE / 3f64.sqrt();
        let size = Nearby::new(DVec3::ZERO, own).reach([DVec3::splat(-4.0), DVec3::splat(8.0)]);
        for (share, expected) in [(0.5, true), (1.5, true), (3.4, true), (3.6, false)] {
            let point = across * -share * size.unwrap();
            for length in [0.01, 1.0, 100.0] {
                let hit = hides(&geometry, point, (own, 0), across * -length, &[0, 1]);
                assert_eq!(hit.is_some(), expected, "{share} {length}");
            }
        }
    }

    /// A ceiling at 1.002 times the height of the origin is too close, at 1.005 times it is not.
    #[test]
    fn an_origin_keeps_away_from_a_ceiling_by_more_than_rounding() {
        let height = 2f32.powi(-22);
        for (share, is_kept) in [(0.5, false), (1.002, false), (1.005, true), (1.9, true)] {
            let at = |z: f32| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
            let vertices = [at(0.0), at(share * height)].concat();
            let geometry = mesh(vertices, vec![[0, 1, 2], [3, 4, 5]]);
            let own = geometry.meshes[0].corners(0).map(doubles);
            let (point, origin) = (DVec3::new(0.25, 0.25, 0.0), [0.25, 0.25, height]);
            let crevice = Crevice::new(&geometry, (point, origin), (own, DVec3::Z, 0), &[0, 1]);
            let crevice = crevice.unwrap();
            assert!(crevice.is_clear && crevice.origin[2] > 0.0, "{share}");
            assert_eq!(crevice.origin == origin, is_kept, "{share}");
        }
    }

    #[test]
    fn points_around_a_point_are_up_to_two_steps_away_along_each_axis() {
        let points: Vec<_> = around(DVec3::new(1.0 + 1e-9, -4.0, 0.0)).collect();
        let steps = [f32::EPSILON, 4.0 * f32::EPSILON, f32::MIN_POSITIVE];
        for k in -2..=2 {
            for j in -2..=2 {
                for i in -2..=2 {
                    let [x, y, z] = [(i, steps[0]), (j, steps[1]), (k, steps[2])]
                        .map(|(n, step): (i32, f32)| n as f32 * step);
                    assert!(points.contains(&[1.0 + x, y - 4.0, z]), "{i} {j} {k}");
                }
            }
        }
        assert_eq!(points.len(), 125);
    }

    #[test]
    fn normals_are_across_both_edges() {
        let corners = [[1.0, -1.0, 3.0], [3.0, 0.5, 3.5], [0.5, 3.0, 2.5]];
        let geometry = mesh(corners.to_vec(), vec![[0, 1, 2]]);
        let [found] = triangles(&geometry, 0).collect::<Vec<_>>()[..] else { panic!() };
        let [a, b, c] = found.corners;
        assert_eq!((found.normal.dot(b - a), found.normal.dot(c - a)), (0.0, 0.0));
        assert_eq!(found.normal, DVec3::new(-2.75, 0.75, 8.75));
    }

    /// At the first corner, the ray is almost at its end. Weights are rounded there, too.
    #[test]
    fn edges_are_hit_up_to_the_rounding_next_to_the_first_corner() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let wall = Triangle { primitive: 0, corners, normal: DVec3::Z, second_half: false };
        for (off, expected) in [(0.5, true), (2.0, false)] {
            let point = DVec3::new(-off * EQUAL, 1e-10, 1e-10);
            assert_eq!(wall.meet(point, -DVec3::Z).is_some(), expected, "{off}");
        }
    }
}
