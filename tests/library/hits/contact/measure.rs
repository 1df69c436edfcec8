//! Rays that leave a surface: does it shadow itself, and does an object just above it shadow it?
//!
//! The surfaces are tilted grids of triangles or quads, and spheres. Corners of grids lie on a
//! lattice of whole ulps of the largest coordinate, so they are exactly coplanar at any distance
//! from the origin. The right hits are known without asking a backend: above a plane, or above the
//! tangent plane of a sphere, there is only the occluder.

use std::fmt;

use glam::DVec3;

use lightpath::accel::Accelerator;
use lightpath::error::Result;
use lightpath::geometry::{Geometry, NONE, Sphere, Surfaces, TriangleMesh, refine};
use lightpath::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use lightpath::shading::{Falloff, LightWeights, Points, lane, light_rays, reflect, set_lane};
use lightpath::world::ulp;

use crate::support::random::Random;

/// Origin of rays that leave a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// As in the renderer: outside the point's rounding error, and the primitive that a ray leaves
    /// does not count.
    Rounded,
    /// Moved along the normal by a fixed length, as in the coursework (1e-4).
    Fixed(f32),
}

/// Kind of surface that rays leave.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A grid of triangles.
    Triangles,
    /// A grid of quads.
    Quads,
    /// One sphere.
    Sphere,
}

impl Shape {
    /// All kinds of surfaces.
    pub const ALL: [Self; 3] = [Self::Triangles, Self::Quads, Self::Sphere];

    /// Returns the name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Triangles => "triangles",
            Self::Quads => "quads",
            Self::Sphere => "sphere",
        }
    }
}

/// Sizes of the surfaces, in world units.
pub const SCALES: [f64; 7] = [1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6];

/// Distances from the scene's origin, in sizes of the surface.
pub const DISTANCES: [f64; 6] = [0.0, 1.0, 1e2, 1e4, 1e6, 1e7];

/// Heights of occluders, in ulp of the largest coordinate, before they are rounded to the lattice.
const HEIGHTS: [f64; 7] = [1.5, 3.0, 4.0, 5.0, 8.0, 32.0, 1000.0];

/// From this height in ulp on, an occluder must cast a shadow.
pub const CLEAR: f64 = 4.0;

/// Rays of one kind, and how many of them failed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Count {
    /// Rays with a known answer.
    pub rays: u64,
    /// Rays with a wrong answer.
    pub failures: u64,
}

impl Count {
    fn add(&mut self, failed: bool) {
        self.rays += 1;
        self.failures += u64::from(failed);
    }
}

/// Counts of one surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Kind of surface.
    pub shape: Shape,
    /// Size in world units.
    pub scale: f64,
    /// Distance from the scene's origin, in sizes of the surface.
    pub distance: f64,
    /// Shadow rays to an unoccluded light. Failure: occluded.
    pub self_shadow: Count,
    /// Mirrored rays with nothing above. Failure: hit.
    pub self_reflection: Count,
    /// Shadow rays under an occluder at least [`CLEAR`] ulp above. Failure: not occluded.
    pub leak: Count,
    /// Shadow rays under nearer occluders: counted, not judged.
    pub near: Count,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { shape, scale, distance, self_shadow, self_reflection, leak, near } = self;
        write!(f, "{:9} {scale:e} at {distance:e}:", shape.name())?;
        let all = [
            ("self-shadow", self_shadow),
            ("self-reflection", self_reflection),
            ("leak", leak),
            ("nearer", near),
        ];
        for (name, count) in all {
            write!(f, " {name} {}/{}", count.failures, count.rays)?;
        }
        Ok(())
    }
}

/// A function that builds the backend under test.
pub type Build<'b> = dyn for<'g> Fn(&'g Geometry) -> Result<Box<dyn Accelerator + 'g>> + 'b;

/// Counts failures of some `rays` shadow rays, mirrored rays and occluded rays per surface and
/// occluder. The same `seed` gives the same rays.
///
/// # Errors
/// Errors of `build`.
pub fn measure(build: &Build, origin: Origin, rays: usize, seed: u64) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for shape in Shape::ALL {
        for scale in SCALES {
            for distance in DISTANCES {
                let random = Random(seed ^ ((rows.len() as u64) << 32));
                rows.push(row(build, origin, rays, random, (shape, scale, distance))?);
            }
        }
    }
    Ok(rows)
}

fn row(
    build: &Build,
    origin: Origin,
    rays: usize,
    mut random: Random,
    (shape, scale, distance): (Shape, f64, f64),
) -> Result<Row> {
    let zero = Count::default();
    let mut row = Row {
        shape,
        scale,
        distance,
        self_shadow: zero,
        self_reflection: zero,
        leak: zero,
        near: zero,
    };
    let packets = rays.div_ceil(LANES);
    let grid = Grid::new(scale, distance, &mut random);
    let bare = grid.geometry(shape, None)?;
    let traced = build(&bare)?;
    for _ in 0..packets {
        let packet = grid.camera(shape, &mut random);
        let start = Start::new(&bare, traced.as_ref(), packet, origin);
        start.self_shadow(&grid, traced.as_ref(), &mut random, &mut row.self_shadow);
        start.self_reflection(traced.as_ref(), &mut row.self_reflection);
    }
    for occluder in [Occluder::Flat, Occluder::Ball] {
        for height in HEIGHTS {
            let Some(cover) = grid.cover(shape, occluder, height) else { continue };
            let geometry = grid.geometry(shape, Some(&cover))?;
            let covered = build(&geometry)?;
            let clear = cover.clearance >= CLEAR * largest_ulp(&geometry);
            let count = if clear { &mut row.leak } else { &mut row.near };
            for _ in 0..packets {
                let packet = grid.camera(shape, &mut random);
                let mut start = Start::new(&bare, traced.as_ref(), packet, origin);
                start.renumber(shape, &bare, &geometry);
                start.leak(&grid, &cover, covered.as_ref(), &mut random, count);
            }
        }
    }
    Ok(row)
}

/// The ulp of the largest coordinate of a geometry.
fn largest_ulp(geometry: &Geometry) -> f64 {
    let corners = geometry.meshes.iter().flat_map(|mesh| mesh.vertices().iter().flatten());
    let corners = corners.chain(geometry.quads.iter().flatten().flatten());
    let corners = corners.map(|x| f64::from(x.abs()));
    let spheres = geometry.spheres.iter().map(|s| s.center.abs().max_element() + s.radius);
    ulp(corners.chain(spheres).fold(0.0, f64::max))
}

/// Maximum number of cells along a side of the grid.
const CELLS: f64 = 6.0;

/// A tilted plane through points of a lattice, and a sphere that touches it from below.
struct Grid {
    /// Step of the lattice: one ulp of the largest possible coordinate.
    step: f64,
    corner: DVec3,
    /// Sides of a cell.
    a: DVec3,
    b: DVec3,
    /// Cells along a side.
    cells: f64,
    /// Number of cells by which a cover extends beyond the grid.
    beyond: f64,
    /// Unit normal, upwards.
    up: DVec3,
    /// Radius of the sphere.
    radius: f64,
}

/// Object above the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Occluder {
    /// One triangle or quad parallel to the plane.
    Flat,
    /// A sphere above the middle.
    Ball,
}

struct Cover {
    /// Least distance from the surface.
    clearance: f64,
    form: Form,
}

enum Form {
    /// A corner and two sides.
    Flat([DVec3; 3]),
    Ball(Sphere),
}

impl Grid {
    fn new(scale: f64, distance: f64, random: &mut Random) -> Self {
        let far = distance * scale;
        // All objects stay within a cover's reach of the surface.
        let cells = |step: f64| (scale / step).floor().clamp(1.0, CELLS);
        let reach = |step: f64| far + 20.0 * scale + 200.0 * step;
        let step = ulp(reach(ulp(reach(0.0))));
        let cells = cells(step);
        // Whole steps along a side of a cell.
        let side = (scale / (cells * step)).floor().max(1.0);
        let whole = |x: f64| (x * side).round();
        let mut tilt = || random.within(-0.9, 0.9);
        let (a, b) = if side < 4.0 {
            (DVec3::new(1.0, 0.0, 1.0) * side, DVec3::new(0.0, 1.0, 1.0) * side)
        } else {
            let a = DVec3::new(side, whole(tilt() * 0.3), whole(tilt()));
            (a, DVec3::new(whole(tilt() * 0.3), side, whole(tilt())))
        };
        let towards = DVec3::new(0.61, -0.57, 0.55) * far;
        let corner = (towards / step).round() * step;
        let (a, b) = (a * step, b * step);
        let up = a.cross(b).normalize();
        let up = if random.unit() < 0.5 { up } else { -up };
        let beyond = if side < 64.0 { 40.0 } else { 2.0 };
        Self { step, corner, a, b, cells, beyond, up, radius: scale * random.within(0.3, 0.5) }
    }

    /// A point of the plane, in cells.
    fn at(&self, x: f64, y: f64) -> DVec3 {
        self.corner + self.a * x + self.b * y
    }

    fn middle(&self) -> DVec3 {
        self.at(self.cells / 2.0, self.cells / 2.0)
    }

    /// Returns the sphere that touches the plane in the middle.
    fn sphere(&self) -> Sphere {
        Sphere { center: self.middle() - self.up * self.radius, radius: self.radius }
    }

    /// Returns the surface with its cover. The cover is numbered after the surface, except on a
    /// sphere.
    fn geometry(&self, shape: Shape, cover: Option<&Cover>) -> Result<Geometry> {
        let f32s = |p: DVec3| p.as_vec3().to_array();
        let n = self.cells as u32;
        let (mut meshes, mut quads, mut spheres) = (Vec::new(), Vec::new(), Vec::new());
        match shape {
            Shape::Triangles => {
                let index = |i: u32, j: u32| j * (n + 1) + i;
                let points = (0..=n).flat_map(|j| (0..=n).map(move |i| (i, j)));
                let points = points.map(|(i, j)| f32s(self.at(f64::from(i), f64::from(j))));
                let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
                let triangles = cells.flat_map(|(i, j)| {
                    let [p, q] = [index(i, j), index(i + 1, j)];
                    let [r, s] = [index(i + 1, j + 1), index(i, j + 1)];
                    [[p, q, r], [p, r, s]]
                });
                meshes.push(TriangleMesh::new(points.collect(), triangles.collect(), false));
            }
            Shape::Quads => {
                let cells = (0..n).flat_map(|j| (0..n).map(move |i| (f64::from(i), f64::from(j))));
                quads.extend(cells.map(|(i, j)| {
                    [(i, j), (i + 1.0, j), (i + 1.0, j + 1.0), (i, j + 1.0)]
                        .map(|(x, y)| f32s(self.at(x, y)))
                }));
            }
            Shape::Sphere => spheres.push(self.sphere()),
        }
        match (cover.map(|cover| &cover.form), shape) {
            (None, _) => {}
            (Some(Form::Ball(ball)), _) => spheres.push(*ball),
            (Some(Form::Flat([p, a, b])), Shape::Triangles) => {
                // Twice the square, so that one triangle covers it.
                let corners = [*p, *p + *a * 2.0, *p + *b * 2.0].map(f32s);
                meshes.push(TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2]], false));
            }
            (Some(Form::Flat([p, a, b])), _) => {
                quads.push([*p, *p + *a, *p + *a + *b, *p + *b].map(f32s));
            }
        }
        Ok(Geometry::new(DVec3::ZERO, meshes, quads, spheres).unwrap_or_default())
    }

    /// Places an occluder at about `height` ulp above the surface; `None` if it does not fit.
    fn cover(&self, shape: Shape, occluder: Occluder, height: f64) -> Option<Cover> {
        match occluder {
            Occluder::Flat => {
                // Whole steps of the lattice keep its corners exact, so the height is known.
                let lift = (self.up * height).round() * self.step;
                let clearance = lift.dot(self.up);
                let side = self.cells + 2.0 * self.beyond;
                let corner = self.at(-self.beyond, -self.beyond) + lift;
                let form = Form::Flat([corner, self.a * side, self.b * side]);
                (clearance > 0.0).then_some(Cover { clearance, form })
            }
            Occluder::Ball => {
                let clearance = height * self.step;
                // The ball must be large compared with the rounding of the ray's origin.
                let radius = self.radius.max(64.0 * self.step);
                let center = self.middle() + self.up * (radius + clearance);
                let form = Form::Ball(Sphere { center, radius });
                let fits = shape != Shape::Sphere || self.radius > 64.0 * self.step;
                fits.then_some(Cover { clearance, form })
            }
        }
    }

    /// Returns rays from above to points of the surface, at all angles.
    fn camera(&self, shape: Shape, random: &mut Random) -> RayPacket {
        let mut packet = RayPacket::EMPTY;
        for i in 0..LANES {
            let (x, y) = (random.within(0.0, self.cells), random.within(0.0, self.cells));
            let target = match shape {
                Shape::Sphere => {
                    // A point of the upper cap.
                    let across = (self.at(x, y) - self.middle()).normalize_or_zero();
                    let aside = across * random.within(0.0, 0.5);
                    let sphere = self.sphere();
                    sphere.center + (self.up + aside).normalize() * self.radius
                }
                _ => self.at(x, y),
            };
            let from = self.above(target, 10f64.powf(random.within(-2.0, 0.0)), random);
            let from = from.as_vec3();
            let direction = (target - from.as_dvec3()).normalize().as_vec3();
            set_lane(&mut packet.rays.org, i, from);
            set_lane(&mut packet.rays.dir, i, direction);
        }
        packet
    }

    /// Returns a point above `p`, at `cosine` to the normal, far enough for f32 to distinguish.
    fn above(&self, p: DVec3, cosine: f64, random: &mut Random) -> DVec3 {
        let size = (self.a.length() * self.cells).max(64.0 * self.step);
        let angle = random.within(0.0, std::f64::consts::TAU);
        let x = self.a.normalize();
        let across = x * angle.cos() + self.up.cross(x) * angle.sin();
        let sine = (1.0 - cosine * cosine).sqrt();
        p + (self.up * cosine + across * sine) * size * 10f64.powf(random.within(0.0, 3.0))
    }
}

impl Cover {
    /// Returns true if the segment from the surface's point `p` to `q` crosses the cover, clear of
    /// its borders.
    fn hides(&self, grid: &Grid, p: DVec3, q: DVec3) -> bool {
        // The ray itself starts a few ulp from p.
        let slack = 8.0 * grid.step;
        match &self.form {
            Form::Ball(ball) => {
                let l = (q - p).normalize();
                let to_center = ball.center - p;
                let aside = to_center - l * to_center.dot(l);
                let beyond = (q - p).length() > to_center.dot(l) + ball.radius;
                beyond && aside.length() + slack < 0.9 * ball.radius
            }
            Form::Flat([corner, a, b]) => {
                let (below, above) = (corner - p, q - corner);
                let (down, height) = (below.dot(grid.up), above.dot(grid.up));
                if !(height > slack && height > 0.0) {
                    return false;
                }
                let at = p + (q - p) * (down / (down + height)) - *corner;
                // Coordinates along a and b by Cramer's rule.
                let (aa, ab, bb) = (a.length_squared(), a.dot(*b), b.length_squared());
                let (pa, pb) = (at.dot(*a), at.dot(*b));
                let det = aa * bb - ab * ab;
                let (x, y) = ((pa * bb - pb * ab) / det, (pb * aa - pa * ab) / det);
                let margin = 0.02 + 4.0 * slack / aa.min(bb).sqrt();
                let inside = |x: f64| x > margin && x < 1.0 - margin;
                inside(x) && inside(y)
            }
        }
    }
}

/// 16 points of a surface, as the renderer would leave them.
struct Start {
    origin: Origin,
    surfaces: Surfaces,
    points: Points,
    /// Lanes that hit the surface from above.
    hit: Mask,
}

impl Start {
    fn new(
        geometry: &Geometry,
        accelerator: &dyn Accelerator,
        mut packet: RayPacket,
        origin: Origin,
    ) -> Self {
        let all = packet.rays.possible(&Mask::ALL);
        accelerator.closest(&all, &mut packet, Coherence::Incoherent);
        let hit = packet.hit(&all);
        let mut surfaces = Surfaces::EMPTY;
        refine(geometry, &hit, &packet, &mut surfaces);
        if let Origin::Fixed(length) = origin {
            for i in 0..LANES {
                let moved = lane(&surfaces.position, i) + lane(&surfaces.ng, i) * length;
                set_lane(&mut surfaces.outside, i, moved);
            }
            surfaces.primitive = [NONE; LANES];
        }
        let mut points = Points::EMPTY;
        points.at.position = surfaces.position;
        points.at.origin = surfaces.outside;
        points.at.ng = surfaces.ng;
        points.at.n = surfaces.ng;
        points.at.primitive = surfaces.primitive;
        points.at.hit = hit;
        points.at.kd = [1.0; LANES];
        points.kr = [1.0; LANES];
        for axis in 0..3 {
            points.at.view[axis] = packet.rays.dir[axis].map(|d| -d);
        }
        Self { origin, surfaces, points, hit }
    }

    /// Renumbers primitives as in `geometry`, where flat covers come before a sphere.
    fn renumber(&mut self, shape: Shape, bare: &Geometry, geometry: &Geometry) {
        if shape == Shape::Sphere && self.origin == Origin::Rounded {
            let first = |g: &Geometry| g.bases()[g.spheres_id() as usize];
            let shift = first(geometry) - first(bare);
            for i in 0..LANES {
                let number = &mut self.points.at.primitive[i];
                *number = if self.hit.0[i] != 0 { *number + shift } else { *number };
            }
        }
    }

    /// Returns shadow rays to one light point each, and the mask of those that are cast.
    fn shadows(&self, lights: &[DVec3; LANES]) -> (Rays, Mask) {
        let mut q = [[0.0; LANES]; 3];
        for i in 0..LANES {
            set_lane(&mut q, i, lights[i].as_vec3());
        }
        let (mut rays, mut lit) = (Rays::EMPTY, LightWeights::EMPTY);
        let on = light_rays(&self.points.at, &q, None, Falloff::None, false, &mut rays, &mut lit);
        (rays, on)
    }

    fn self_shadow(
        &self,
        grid: &Grid,
        accelerator: &dyn Accelerator,
        random: &mut Random,
        count: &mut Count,
    ) {
        let mut lights = [DVec3::ZERO; LANES];
        let mut known = [false; LANES];
        for i in 0..LANES {
            let p = lane(&self.surfaces.position, i).as_dvec3();
            let light = grid.above(p, 10f64.powf(random.within(-2.0, 0.0)), random);
            lights[i] = light.as_vec3().as_dvec3();
            let to_light = lights[i] - p;
            let rises = lane(&self.surfaces.ng, i).as_dvec3().dot(to_light.normalize()) > 0.004;
            known[i] = rises && to_light.length() > 32.0 * grid.step;
        }
        let (mut rays, on) = self.shadows(&lights);
        accelerator.occluded(&on, &mut rays, Coherence::Coherent);
        for i in (0..LANES).filter(|&i| on.0[i] != 0 && known[i]) {
            count.add(rays.tfar[i] == f32::NEG_INFINITY);
        }
    }

    fn self_reflection(&self, accelerator: &dyn Accelerator, count: &mut Count) {
        let mut packet = RayPacket::EMPTY;
        let on = reflect(&self.points, &self.surfaces.outside, &mut packet.rays);
        accelerator.closest(&on, &mut packet, Coherence::Incoherent);
        for i in (0..LANES).filter(|&i| on.0[i] != 0) {
            count.add(packet.hits.geom[i] != NONE);
        }
    }

    fn leak(
        &self,
        grid: &Grid,
        cover: &Cover,
        accelerator: &dyn Accelerator,
        random: &mut Random,
        count: &mut Count,
    ) {
        let mut lights = [DVec3::ZERO; LANES];
        for i in 0..LANES {
            let p = lane(&self.surfaces.position, i).as_dvec3();
            let light = match &cover.form {
                Form::Flat(_) => grid.above(p, random.within(0.1, 1.0), random),
                Form::Ball(ball) => p + (ball.center - p) * random.within(2.5, 50.0),
            };
            lights[i] = light.as_vec3().as_dvec3();
        }
        let (mut rays, on) = self.shadows(&lights);
        accelerator.occluded(&on, &mut rays, Coherence::Coherent);
        for i in (0..LANES).filter(|&i| on.0[i] != 0) {
            let p = lane(&self.surfaces.position, i).as_dvec3();
            if cover.hides(grid, p, lights[i]) {
                count.add(rays.tfar[i] != f32::NEG_INFINITY);
            }
        }
    }
}
