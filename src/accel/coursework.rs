//! The coursework's BVH as its report describes it (section 4), in f64: the baseline.
//!
//! A tree over all shapes of the scene and one inside each mesh. A set of shapes is split at the
//! middle of the longest side of its bounds; a shape goes left if the centre of its own bounds is
//! below. When all land on one side there is one more attempt, then a leaf with what is left. A
//! ray goes into both children whose box it meets, and the closest positive t wins: nothing is
//! ordered, nothing is cut off. A mesh with `loop_only` (`bvh: false`) has no tree: all its
//! triangles are tried.
//!
//! Two things differ from the report's program. Its recursion is a loop with a stack of its own,
//! because nested shapes that share a corner are peeled off one by one and make a tree as deep as
//! they are many. And a hit must lie in its shape's bounds up to `PreparedRay::slack`, which is what
//! lets boxes prune without losing a hit (proof at `Bounds::met`): the tree finds exactly what
//! [`Coursework::plain_loop`] finds.

use glam::{BVec3, DVec3};

use super::lane::{Hit, Ray, lanes};
use super::{Accelerator, BuildInfo, BuildOptions, Visits};
use crate::error::{Error, Kind, Problem, Result};
use crate::geometry::{Geometry, GeometryKind, Nearby, Sphere};
use crate::monitor::Monitor;
use crate::ray::{Coherence, Mask, RayPacket, Rays};

/// Failed splits after which what is left becomes a leaf.
const MAX_ATTEMPTS: u32 = 1;

/// How the axis of a split is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SplitAxis {
    /// Along the longest side of the bounds.
    Longest,
    /// At random from this seed, the report's other experiment.
    Random(u64),
}

/// The backend `coursework`.
pub struct Coursework<'g> {
    geometry: &'g Geometry,
    shapes: Vec<Shape>,
    scene: Tree,
    /// One per mesh; `None` loops over the triangles.
    meshes: Vec<Option<Tree>>,
    /// Largest coordinate of any bounds.
    reach: DVec3,
    /// Most bytes held while it was built.
    peak_bytes: u64,
}

/// What the scene's own tree holds.
#[derive(Clone, Copy)]
enum Shape {
    Mesh(u32),
    Quad(u32),
    Sphere(u32),
}

impl<'g> Coursework<'g> {
    /// Builds all trees with the report's choice of axis.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        Self::with_axis(geometry, options, monitor, SplitAxis::Longest)
    }

    /// Builds all trees.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn with_axis(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
        axis: SplitAxis,
    ) -> Result<Self> {
        let limit = options.max_bytes.unwrap_or(u64::MAX);
        let mut builder = Builder { axis, limit, bytes: 0, peak_bytes: 0, monitor };
        let (mut shapes, mut bounds) = (Vec::new(), Vec::new());
        let mut meshes = Vec::new();
        for (geom, mesh) in (0..).zip(&geometry.meshes) {
            let corners = |prim| mesh.corners(prim).map(corner);
            let triangles = 0..mesh.triangles().len() as u32;
            let triangles: Vec<Bounds> = triangles.map(|p| Bounds::of(&corners(p))).collect();
            bounds.push(triangles.iter().fold(Bounds::EMPTY, |all, &b| all.union(b)));
            shapes.push(Shape::Mesh(geom));
            let tree = if mesh.loop_only { None } else { Some(builder.tree(&triangles)?) };
            meshes.push(tree);
        }
        for (prim, quad) in (0..).zip(&geometry.quads) {
            shapes.push(Shape::Quad(prim));
            bounds.push(Bounds::of(&quad.map(corner)));
        }
        for (prim, sphere) in (0..).zip(&geometry.spheres) {
            shapes.push(Shape::Sphere(prim));
            bounds.push(Bounds::of_sphere(sphere));
        }
        let all = bounds.iter().fold(Bounds::EMPTY, |all, &b| all.union(b));
        let scene = builder.tree(&bounds)?;
        // Without any shape the bounds are infinite.
        let reach = all.min.abs().max(all.max.abs());
        let reach = if reach.is_finite() { reach } else { DVec3::ZERO };
        Ok(Self { geometry, shapes, scene, meshes, reach, peak_bytes: builder.peak_bytes })
    }

    /// The closest hit; what it took to find it is added to `visits`.
    pub fn closest_hit(&self, ray: &Ray, visits: &mut Visits) -> Option<Hit> {
        self.search(ray, visits, &mut Default::default())
    }

    /// The closest hit by trying every primitive without any box: what the trees must find.
    pub fn plain_loop(&self, ray: &Ray) -> Option<Hit> {
        let ray = PreparedRay::new(ray, self.reach);
        let mut best = None;
        for (geom, range) in (0..).zip(self.geometry.bases().windows(2)) {
            for prim in 0..range[1] - range[0] {
                self.offer(&ray, geom, prim, &mut best);
            }
        }
        best.filter(|hit: &Hit| hit.t < ray.ray.tfar)
    }

    fn search(&self, ray: &Ray, visits: &mut Visits, stacks: &mut [Vec<u32>; 2]) -> Option<Hit> {
        let ray = PreparedRay::new(ray, self.reach);
        let (geometry, mut best) = (self.geometry, None);
        let [outer, inner] = stacks;
        self.scene.each(&ray, visits, outer, |shape, visits| match self.shapes[shape as usize] {
            Shape::Quad(prim) => {
                visits.primitives += 1;
                self.offer(&ray, geometry.quads_id(), prim, &mut best);
            }
            Shape::Sphere(prim) => {
                visits.primitives += 1;
                self.offer(&ray, geometry.spheres_id(), prim, &mut best);
            }
            Shape::Mesh(geom) => {
                let mut try_triangle = |prim, visits: &mut Visits| {
                    visits.primitives += 1;
                    self.offer(&ray, geom, prim, &mut best);
                };
                match &self.meshes[geom as usize] {
                    Some(tree) => tree.each(&ray, visits, inner, try_triangle),
                    None => (0..geometry.meshes[geom as usize].triangles().len() as u32)
                        .for_each(|prim| try_triangle(prim, visits)),
                }
            }
        });
        best.filter(|hit: &Hit| hit.t < ray.ray.tfar)
    }

    /// Tests one primitive and keeps its hit if it is the closest so far; of equal ones the one of
    /// the lowest number, so that the order of the tests does not matter.
    fn offer(&self, ray: &PreparedRay, geom: u32, prim: u32, best: &mut Option<Hit>) {
        let Some(hit) = self.test(ray, geom, prim) else { return };
        let key = |hit: &Hit| (hit.t, self.geometry.primitive(hit.geom, hit.prim));
        if best.as_ref().is_none_or(|best| key(&hit) < key(best)) {
            *best = Some(hit);
        }
    }

    fn test(&self, ray: &PreparedRay, geom: u32, prim: u32) -> Option<Hit> {
        let leaving = ray.ray.leaving == self.geometry.primitive(geom, prim);
        let hit = |t, u, v, ng| Some(Hit { geom, prim, t, u, v, ng });
        match self.geometry.kind(geom) {
            GeometryKind::Spheres => {
                let sphere = &self.geometry.spheres[prim as usize];
                let t = sphere_hit(ray, sphere, leaving)?;
                hit(t, 0.0, 0.0, ray.at(t) - sphere.center)
            }
            _ if leaving => None,
            GeometryKind::Mesh(mesh) => {
                let corners = self.geometry.meshes[mesh].corners(prim).map(corner);
                let [v0, v1, v2] = corners;
                let normal = (v1 - v0).cross(v2 - v0);
                let t = planar_hit(ray, &corners, normal)?;
                let (u, v) = weights(corners, normal, ray.at(t));
                hit(t, u, v, normal)
            }
            GeometryKind::Quads => {
                let corners = self.geometry.quads[prim as usize].map(corner);
                let [v0, v1, v2, v3] = corners;
                let normal = (v2 - v0).cross(v3 - v1);
                let t = planar_hit(ray, &corners, normal)?;
                let (u, v) = weights([v0, v1, v3], normal, ray.at(t));
                if u + v <= 1.0 {
                    return hit(t, u, v, normal);
                }
                let (u, v) = weights([v2, v3, v1], normal, ray.at(t));
                hit(t, 1.0 - u, 1.0 - v, normal)
            }
        }
    }
}

fn corner(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

/// The plane of `corners`, and then the inside-outside test against each edge in turn.
fn planar_hit<const N: usize>(
    ray: &PreparedRay,
    corners: &[DVec3; N],
    normal: DVec3,
) -> Option<f64> {
    let facing = normal.dot(ray.ray.direction);
    if facing == 0.0 {
        return None;
    }
    let t = normal.dot(corners[0] - ray.ray.origin) / facing;
    if !(t > ray.ray.tnear) || !ray.reaches(&Bounds::of(corners), t) {
        return None;
    }
    let point = ray.at(t);
    let inside = (0..N).all(|i| {
        let edge = corners[(i + 1) % N] - corners[i];
        normal.dot(edge.cross(point - corners[i])) >= 0.0
    });
    inside.then_some(t)
}

/// Weights of the second and third corner at a point of the triangle's plane.
fn weights([v0, v1, v2]: [DVec3; 3], normal: DVec3, point: DVec3) -> (f64, f64) {
    let whole = normal.dot((v1 - v0).cross(v2 - v0));
    let u = normal.dot((v0 - v2).cross(point - v2)) / whole;
    let v = normal.dot((v1 - v0).cross(point - v0)) / whole;
    (u, v)
}

/// The quadratic in t of |o + t d - c|^2 = r^2, as schools teach it; the smaller root in front.
fn sphere_hit(ray: &PreparedRay, sphere: &Sphere, leaving: bool) -> Option<f64> {
    let Ray { origin, direction, tnear, .. } = ray.ray;
    let from_center = origin - sphere.center;
    let a = direction.dot(direction);
    let b = 2.0 * direction.dot(from_center);
    let c = from_center.dot(from_center) - sphere.radius * sphere.radius;
    let root = (b * b - 4.0 * a * c).sqrt();
    // The root of a ray that leaves the sphere at its origin, the smaller one, does not count.
    let roots = match leaving {
        true => [f64::NAN, (-b + root.copysign(-b)) / (2.0 * a)],
        false => [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)],
    };
    let bounds = Bounds::of_sphere(sphere);
    roots.into_iter().find(|&t| t > tnear && ray.reaches(&bounds, t))
}

impl Accelerator for Coursework<'_> {
    fn info(&self) -> BuildInfo {
        let trees = self.meshes.iter().flatten().chain([&self.scene]);
        let bytes = trees.map(Tree::bytes).sum::<u64>() + size_of_val(&self.shapes[..]) as u64;
        BuildInfo {
            version: "coursework".into(),
            isa: "f64".into(),
            bytes,
            peak_bytes: bytes.max(self.peak_bytes),
        }
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, _: Coherence) {
        let (mut visits, mut stacks) = Default::default();
        for i in lanes(active) {
            let ray = Ray::of(&packet.rays, i);
            if let Some(hit) = self.search(&ray, &mut visits, &mut stacks) {
                hit.store(packet, i);
            }
        }
    }

    /// As the report's shadow rays: the closest hit, and whether it is near enough.
    fn occluded(&self, active: &Mask, rays: &mut Rays, _: Coherence) {
        let (mut visits, mut stacks) = Default::default();
        for i in lanes(active) {
            if self.search(&Ray::of(rays, i), &mut visits, &mut stacks).is_some() {
                rays.tfar[i] = f32::NEG_INFINITY;
            }
        }
    }

    fn near(&self, geometry: &Geometry, [low, high]: &Nearby, found: &mut dyn FnMut(u32)) {
        let nearby = Bounds { min: corner(*low), max: corner(*high) };
        self.scene.near(&nearby, &mut |shape| match self.shapes[shape as usize] {
            Shape::Quad(prim) => found(geometry.primitive(geometry.quads_id(), prim)),
            Shape::Sphere(_) => {}
            Shape::Mesh(geom) => {
                let mut triangle = |prim| found(geometry.primitive(geom, prim));
                match &self.meshes[geom as usize] {
                    Some(tree) => tree.near(&nearby, &mut triangle),
                    None => (0..geometry.meshes[geom as usize].triangles().len() as u32)
                        .for_each(triangle),
                }
            }
        });
    }

    /// Boxes of nodes, and of whole meshes, count as nodes.
    fn visits(&self, active: &Mask, rays: &Rays, _: bool, _: Coherence) -> Option<Visits> {
        let mut visits = Visits::default();
        for i in lanes(active) {
            let _ = self.closest_hit(&Ray::of(rays, i), &mut visits);
        }
        Some(visits)
    }
}

/// A ray with what its box tests share.
struct PreparedRay {
    ray: Ray,
    inverse: DVec3,
    /// How far outside its shape's bounds a hit may lie, for its rounding:
    /// 2^-50 (|origin| + the largest coordinate of the scene).
    slack: DVec3,
}

impl PreparedRay {
    fn new(ray: &Ray, reach: DVec3) -> Self {
        let slack = (ray.origin.abs() + reach) * (4.0 * f64::EPSILON);
        Self { ray: *ray, inverse: ray.direction.recip(), slack }
    }

    fn at(&self, t: f64) -> DVec3 {
        self.ray.origin + self.ray.direction * t
    }

    /// Whether the ray's point at t lies in the bounds.
    fn reaches(&self, bounds: &Bounds, t: f64) -> bool {
        let point = self.at(t);
        (bounds.min - self.slack).cmple(point).all() && point.cmple(bounds.max + self.slack).all()
    }
}

/// An axis-parallel box.
#[derive(Debug, Clone, Copy)]
struct Bounds {
    min: DVec3,
    max: DVec3,
}

impl Bounds {
    const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    fn of(points: &[DVec3]) -> Self {
        points.iter().fold(Self::EMPTY, |b, &p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    fn of_sphere(sphere: &Sphere) -> Self {
        Self { min: sphere.center - sphere.radius, max: sphere.center + sphere.radius }
    }

    fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether the ray meets the box, by the six planes around it.
    ///
    /// Every hit in the box is kept. With u = 2^-53, s the slack and M = |origin| + reach, so that
    /// s = 8uM: a hit at t has fl(o + fl(t d)) >= min - s, hence t d >= min - o - s - 4uM, with
    /// the rounding of its comparison. The plane is moved by 3s, and its computed t times d is
    /// at most min - o - 3s + 6uM < min - o - 2s, five roundings included: not above t. Likewise
    /// for max. A NaN (0/0, all coordinates zero) is dropped by `min` and `max` and prunes nothing.
    fn met(&self, ray: &PreparedRay) -> bool {
        let slack = 3.0 * ray.slack;
        let first = ((self.min - (ray.ray.origin + slack)) * ray.inverse).to_array();
        let second = ((self.max - (ray.ray.origin - slack)) * ray.inverse).to_array();
        let (mut near, mut far) = (ray.ray.tnear, f64::INFINITY);
        for (a, b) in first.into_iter().zip(second) {
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        near <= far
    }
}

/// A binary tree over boxes; node 0 is the root.
struct Tree {
    nodes: Vec<Node>,
    /// The shapes, leaf by leaf.
    order: Vec<u32>,
}

struct Node {
    bounds: Bounds,
    content: Content,
}

#[derive(Clone, Copy)]
enum Content {
    /// Two nodes, either [`EMPTY`].
    Inner([u32; 2]),
    /// A range of `order`.
    Leaf { first: u32, end: u32 },
}

/// A child without shapes.
const EMPTY: u32 = u32::MAX;

impl Tree {
    /// Calls `found` for all shapes in leaves whose boxes, and those of all nodes above but the
    /// root, the ray meets.
    fn each(
        &self,
        ray: &PreparedRay,
        visits: &mut Visits,
        stack: &mut Vec<u32>,
        mut found: impl FnMut(u32, &mut Visits),
    ) {
        stack.push(0);
        while let Some(node) = stack.pop() {
            match self.nodes[node as usize].content {
                Content::Leaf { first, end } => {
                    let shapes = &self.order[first as usize..end as usize];
                    shapes.iter().for_each(|&shape| found(shape, visits));
                }
                Content::Inner(children) => {
                    for child in children.into_iter().filter(|&child| child != EMPTY) {
                        visits.nodes += 1;
                        if self.nodes[child as usize].bounds.met(ray) {
                            stack.push(child);
                        }
                    }
                }
            }
        }
    }

    /// Calls `found` for all shapes in leaves whose boxes reach into another.
    fn near(&self, nearby: &Bounds, found: &mut dyn FnMut(u32)) {
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            let Node { bounds, content } = &self.nodes[node as usize];
            if bounds.min.cmpgt(nearby.max).any() || bounds.max.cmplt(nearby.min).any() {
                continue;
            }
            match *content {
                Content::Leaf { first, end } => {
                    self.order[first as usize..end as usize].iter().for_each(|&shape| found(shape));
                }
                Content::Inner(children) => {
                    stack.extend(children.into_iter().filter(|&child| child != EMPTY));
                }
            }
        }
    }

    fn bytes(&self) -> u64 {
        (size_of_val(&self.nodes[..]) + size_of_val(&self.order[..])) as u64
    }
}

/// A set of shapes that is to become a node.
struct Task {
    node: usize,
    first: usize,
    end: usize,
    attempts: u32,
}

/// What the trees of a scene share while they are built.
struct Builder<'m> {
    axis: SplitAxis,
    /// Bytes that all trees may take.
    limit: u64,
    /// Bytes of the trees so far.
    bytes: u64,
    /// Most bytes so far.
    peak_bytes: u64,
    monitor: &'m Monitor,
}

impl Builder<'_> {
    fn tree(&mut self, bounds: &[Bounds]) -> Result<Tree> {
        let mut order: Vec<u32> = (0..bounds.len() as u32).collect();
        let mut nodes = vec![];
        let mut tasks = vec![];
        let add = |nodes: &mut Vec<Node>, tasks: &mut Vec<Task>, first, end, attempts| {
            if first == end {
                return EMPTY;
            }
            let content = Content::Leaf { first: first as u32, end: end as u32 };
            tasks.push(Task { node: nodes.len(), first, end, attempts });
            nodes.push(Node { bounds: Bounds::EMPTY, content });
            nodes.len() as u32 - 1
        };
        add(&mut nodes, &mut tasks, 0, bounds.len(), 0);
        while let Some(Task { node, first, end, attempts }) = tasks.pop() {
            self.monitor.check()?;
            self.check_room(nodes.len())?;
            let set = &mut order[first..end];
            let all = set.iter().fold(Bounds::EMPTY, |all, &s| all.union(bounds[s as usize]));
            nodes[node].bounds = all;
            if set.len() <= 1 || attempts > MAX_ATTEMPTS {
                continue;
            }
            let axis = self.choose(&all);
            let middle = |b: &Bounds| (b.min[axis] + b.max[axis]) / 2.0;
            let split = middle(&all);
            let left = partition(set, |shape| middle(&bounds[shape as usize]) < split);
            let failed = left == 0 || left == set.len();
            let attempts = if failed { attempts + 1 } else { 0 };
            let children = [(first, first + left), (first + left, end)];
            let children =
                children.map(|(first, end)| add(&mut nodes, &mut tasks, first, end, attempts));
            nodes[node].content = Content::Inner(children);
        }
        if nodes.is_empty() {
            let content = Content::Leaf { first: 0, end: 0 };
            nodes.push(Node { bounds: Bounds::EMPTY, content });
        }
        let tree = Tree { nodes, order };
        let building = tree.nodes.capacity() * size_of::<Node>() + size_of_val(bounds);
        self.peak_bytes = self.peak_bytes.max(self.bytes + building as u64);
        self.bytes += tree.bytes();
        Ok(tree)
    }

    /// The axis to split along.
    fn choose(&mut self, bounds: &Bounds) -> usize {
        match &mut self.axis {
            SplitAxis::Longest => {
                let side = bounds.max - bounds.min;
                let longest: BVec3 = side.cmpeq(DVec3::splat(side.max_element()));
                longest.bitmask().trailing_zeros().min(2) as usize
            }
            SplitAxis::Random(state) => {
                // SplitMix64 (Steele et al. 2014).
                *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
                let x = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
                let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
                ((x ^ (x >> 31)) % 3) as usize
            }
        }
    }

    fn check_room(&self, nodes: usize) -> Result<()> {
        let limit = self.limit;
        if self.bytes + (nodes * size_of::<Node>()) as u64 <= limit {
            return Ok(());
        }
        let message = format!("the accelerator would hold more than the {limit} bytes left to it");
        Err(Error::new(Kind::Limit, Problem::new("--max-memory", message)))
    }
}

/// Moves the shapes that go left to the front; returns how many.
fn partition(set: &mut [u32], left: impl Fn(u32) -> bool) -> usize {
    let mut count = 0;
    for i in 0..set.len() {
        if left(set[i]) {
            set.swap(i, count);
            count += 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{NONE, TriangleMesh};
    use crate::ray::LANES;
    use proptest::prelude::*;

    const OPTIONS: BuildOptions = BuildOptions { threads: 1, max_bytes: None };

    fn build(geometry: &Geometry) -> Coursework<'_> {
        Coursework::build(geometry, &OPTIONS, &Monitor::default()).unwrap()
    }

    fn soup(triangles: &[[[f32; 3]; 3]], loop_only: bool) -> TriangleMesh {
        let indices = (0..triangles.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k));
        TriangleMesh::new(triangles.concat(), indices.collect(), loop_only)
    }

    fn geometry(meshes: Vec<TriangleMesh>) -> Geometry {
        Geometry::new(DVec3::ZERO, meshes, vec![], vec![]).unwrap()
    }

    fn ray(origin: [f32; 3], direction: [f32; 3]) -> Ray {
        Ray {
            origin: corner(origin),
            direction: corner(direction),
            tnear: 0.0,
            tfar: f64::INFINITY,
            leaving: NONE,
        }
    }

    fn depth(tree: &Tree) -> usize {
        let mut deepest = 0;
        let mut stack = vec![(0, 0)];
        while let Some((node, depth)) = stack.pop() {
            deepest = deepest.max(depth);
            if let Content::Inner(children) = tree.nodes[node as usize].content {
                let children = children.into_iter().filter(|&child| child != EMPTY);
                stack.extend(children.map(|child| (child, depth + 1)));
            }
        }
        deepest
    }

    /// Small integers, so that rays run in box faces, along edges and through vertices.
    fn grid_point() -> impl Strategy<Value = [f32; 3]> {
        prop::array::uniform3((-4i8..=4).prop_map(f32::from))
    }

    fn point() -> impl Strategy<Value = [f32; 3]> {
        prop_oneof![grid_point(), prop::array::uniform3(-4f32..4.0)]
    }

    fn direction() -> impl Strategy<Value = [f32; 3]> {
        let wild = prop::array::uniform3(prop_oneof![-1f32..1.0, -1e-30f32..1e-30]);
        prop_oneof![grid_point(), point(), wild].prop_filter("not zero", |d| *d != [0.0; 3])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn the_trees_find_exactly_what_a_plain_loop_finds(
            triangles in prop::collection::vec(prop::array::uniform3(point()), 0..40),
            looped in prop::collection::vec(prop::array::uniform3(point()), 0..9),
            quads in prop::collection::vec((point(), point(), point()), 0..5),
            spheres in prop::collection::vec((point(), 0.01f64..2.0), 0..9),
            rays in prop::collection::vec((point(), direction(), 0u32..80), 60),
            axis in prop_oneof![Just(SplitAxis::Longest), any::<u64>().prop_map(SplitAxis::Random)],
        ) {
            let add = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|k| a[k] + b[k]);
            let quads = quads.into_iter().map(|(o, a, b)| [o, add(o, a), add(add(o, a), b), add(o, b)]);
            let spheres = spheres.into_iter().map(|(c, radius)| Sphere { center: corner(c), radius });
            let meshes = vec![soup(&triangles, false), soup(&looped, true)];
            let geometry = Geometry::new(DVec3::ZERO, meshes, quads.collect(), spheres.collect());
            let geometry = geometry.unwrap();
            let trees = Coursework::with_axis(&geometry, &OPTIONS, &Monitor::default(), axis).unwrap();
            for (origin, direction, leaving) in rays {
                let ray = Ray { leaving, ..ray(origin, direction) };
                let found = trees.closest_hit(&ray, &mut Visits::default());
                prop_assert_eq!(found, trees.plain_loop(&ray), "{:?}", ray);
            }
        }
    }

    /// Corners at distance 1.
    fn octahedron() -> TriangleMesh {
        let corner = |axis: usize, sign: f32| {
            let mut v = [0.0; 3];
            v[axis] = sign;
            v
        };
        let faces = (0..8).map(|bits: i32| {
            [0, 1, 2].map(|axis| corner(axis, if bits >> axis & 1 == 0 { 1.0 } else { -1.0 }))
        });
        soup(&faces.collect::<Vec<_>>(), false)
    }

    #[test]
    fn the_octahedron_is_split_as_the_report_says() {
        let geometry = geometry(vec![octahedron()]);
        let trees = build(&geometry);
        // All sides are equal, so x is split first, at 0: four faces each side. Their bounds are
        // 1 by 2 by 2: then y, then z, to single faces.
        let tree = trees.meshes[0].as_ref().unwrap();
        assert_eq!((tree.nodes.len(), depth(tree)), (15, 3));
        let mut visits = Visits::default();
        let hit =
            trees.closest_hit(&ray([0.25, 0.25, 5.0], [0.0, 0.0, -1.0]), &mut visits).unwrap();
        assert_eq!(hit.t, 4.5);
        // One column of boxes: x > 0 of 2, y > 0 of 2, both z.
        assert_eq!(visits, Visits { nodes: 6, primitives: 2 });
    }

    #[test]
    fn what_cannot_be_split_is_a_leaf_after_one_more_attempt() {
        let triangle = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let geometry = geometry(vec![soup(&vec![triangle; 1_000_000], false)]);
        let trees = build(&geometry);
        let tree = trees.meshes[0].as_ref().unwrap();
        assert_eq!((tree.nodes.len(), depth(tree)), (3, 2));
        let mut visits = Visits::default();
        let hit = trees.closest_hit(&ray([0.2, 0.2, 1.0], [0.0, 0.0, -1.0]), &mut visits).unwrap();
        assert_eq!((hit.prim, visits.primitives), (0, 1_000_000));
    }

    #[test]
    fn nested_shapes_make_a_deep_tree_and_no_stack_overflows() {
        let nested = (1..4001).map(|i| {
            let size = i as f32;
            [[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.0, size, 0.0]]
        });
        let geometry = geometry(vec![soup(&nested.collect::<Vec<_>>(), false)]);
        let trees = build(&geometry);
        assert!(depth(trees.meshes[0].as_ref().unwrap()) >= 2000);
        let ray = ray([0.25, 0.25, 1.0], [0.0, 0.0, -1.0]);
        assert_eq!(trees.closest_hit(&ray, &mut Visits::default()).unwrap().prim, 0);
    }

    #[test]
    fn a_build_stops_when_it_is_told_to_or_has_no_room() {
        let geometry = geometry(vec![octahedron()]);
        let monitor = Monitor::default();
        let little = BuildOptions { max_bytes: Some(500), ..OPTIONS };
        let error = Coursework::build(&geometry, &little, &monitor).err().unwrap();
        assert_eq!(error.kind, Kind::Limit);
        monitor.signal.store(2, std::sync::atomic::Ordering::Relaxed);
        let error = Coursework::build(&geometry, &OPTIONS, &monitor).err().unwrap();
        assert_eq!(error.kind, Kind::Interrupted(2));
    }

    #[test]
    fn packets_get_f32_answers_and_leave_what_they_miss() {
        let quad = [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
        let sphere = Sphere { center: DVec3::new(0.0, 0.0, 3.0), radius: 1.0 };
        let geometry = Geometry::new(DVec3::ZERO, vec![], vec![quad], vec![sphere]).unwrap();
        let trees = build(&geometry);
        let mut packet = RayPacket::EMPTY;
        for i in 0..LANES {
            packet.rays.org[2][i] = 1.0;
            packet.rays.dir[2][i] = -2.0;
        }
        (packet.rays.org[0][0], packet.rays.org[1][0]) = (0.5, 0.25);
        packet.rays.org[0][1] = 1.5;
        packet.rays.leaving[2] = geometry.primitive(0, 0);
        packet.rays.tfar[3] = 0.5;
        packet.rays.tnear[4] = 0.5;
        // The far side of the sphere that it leaves, not the near one.
        (packet.rays.org[2][5], packet.rays.dir[2][5]) = (2.0, 2.0);
        packet.rays.leaving[5] = geometry.primitive(1, 0);
        let mut active = Mask([-1; LANES]);
        active.0[15] = 0;
        let mut shadow = packet.rays.clone();
        trees.closest(&active, &mut packet, Coherence::Coherent);
        let (hits, rays) = (&packet.hits, &packet.rays);
        assert_eq!((hits.geom[0], hits.u[0], hits.v[0], rays.tfar[0]), (0, 0.75, 0.625, 0.5));
        assert_eq!((hits.ng[0][0], hits.ng[1][0], hits.ng[2][0]), (0.0, 0.0, 1.0));
        for miss in [1, 2, 3, 4, 15] {
            assert_eq!(hits.geom[miss], NONE, "lane {miss}");
        }
        assert_eq!((hits.geom[5], rays.tfar[5]), (1, 1.0));
        trees.occluded(&active, &mut shadow, Coherence::Coherent);
        let hit = |i: usize| shadow.tfar[i] == f32::NEG_INFINITY;
        let expected = [0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14];
        assert_eq!((0..LANES).filter(|&i| hit(i)).collect::<Vec<_>>(), expected);
    }
}
