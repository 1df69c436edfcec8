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
mod tests;
