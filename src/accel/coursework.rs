//! The baseline: the coursework's BVH as section 4 of its report describes it, in f64.
//!
//! One tree holds all shapes of the scene, and each mesh has a tree of its triangles.
//!
//! - Build: a set of shapes is split at the middle of the longest side of its bounds. A shape goes
//!   left if the centre of its own bounds is below the split. If all shapes go to one side, the
//!   split is tried once more; then the set becomes a leaf.
//! - Traversal: a ray visits every child whose box it hits. The closest hit after `tnear` wins.
//!   Children are not ordered, and a hit does not shorten the ray.
//! - A mesh with `loop_only` (`bvh: false`) has no tree: every ray tests all its triangles.
//!
//! Two things differ from the report's program:
//!
//! - Recursion is a loop with its own stack. Nested shapes that share a corner are split off one by
//!   one, so the tree may be as deep as there are shapes.
//! - A hit must lie within the bounds of its shape, up to `PreparedRay::slack`. So a box test never
//!   loses a hit (proof at `PreparedRay::may_hit`): the trees find exactly the hits of
//!   [`Coursework::plain_loop`].

use glam::{BVec3, DVec3};

use super::accelerator::{Accelerator, BuildInfo, BuildOptions, Visits, over_limit};
use super::geometry_ref::GeometryRef;
use super::lane::{LaneHit, LaneRay, lanes};
use crate::error::Result;
use crate::geometry::{
    Box3, Geometry, GeometryKind, Nearby, Sphere, Unseen, doubles, quad_halves, slabs_meet,
};
use crate::monitor::Monitor;
use crate::ray::{Coherence, Mask, RayPacket, Rays};

/// Number of times that a failed split is tried again before the set becomes a leaf.
const MAX_ATTEMPTS: u32 = 1;

/// The coursework's trees over a scene: the accelerator of the backend `coursework`.
pub struct Coursework<'g> {
    geometry: GeometryRef<'g>,
    shapes: Vec<TreeShape>,
    scene: BoxTree,
    /// One tree for each mesh; `None` if rays test all its triangles, or can hit none of them.
    meshes: Vec<Option<BoxTree>>,
    /// Largest magnitude of any coordinate in the scene's bounds, for each axis.
    reach: DVec3,
    /// Largest number of bytes held during the build.
    peak_bytes: u64,
}

/// A shape in the tree of the scene.
#[derive(Clone, Copy)]
enum TreeShape {
    Mesh(u32),
    Quad(u32),
    Sphere(u32),
}

impl<'g> Coursework<'g> {
    /// Builds all trees. Every split is across the longest side, the rule of the report.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build(
        geometry: &'g Geometry,
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        Self::build_part((geometry.into(), &Unseen::NONE), options, monitor)
    }

    /// [`Coursework::build`] without the primitives in `unseen`.
    ///
    /// # Errors
    /// See [`super::build`].
    pub fn build_part(
        (geometry, unseen): (GeometryRef<'g>, &Unseen),
        options: &BuildOptions,
        monitor: &Monitor,
    ) -> Result<Self> {
        let limit = options.max_bytes.unwrap_or(u64::MAX);
        let mut builder = Builder { limit, bytes: 0, peak_bytes: 0, monitor };
        let (mut shapes, mut bounds) = (Vec::new(), Vec::new());
        let mut meshes = Vec::new();
        for (geom, mesh) in (0..).zip(&geometry.meshes) {
            let own = geometry.bases()[geom as usize]..geometry.bases()[geom as usize + 1];
            if unseen.has_all(&own) {
                meshes.push(None);
                continue;
            }
            let corners = |prim| mesh.corners(prim).map(doubles);
            let seen = (0..own.end - own.start).filter(|prim| !unseen.has(own.start + prim));
            let triangles: Vec<Box3> = seen.clone().map(|p| Box3::of(&corners(p))).collect();
            bounds.push(Box3::around(triangles.iter().copied()));
            shapes.push(TreeShape::Mesh(geom));
            // Only a mesh of a file can be `loop_only`. Rays can hit all of its triangles or none.
            let mut tree = if mesh.loop_only { None } else { Some(builder.tree(&triangles)?) };
            if let Some(tree) = tree.as_mut().filter(|_| unseen.count(&own) > 0) {
                let seen: Vec<u32> = seen.collect();
                tree.order.iter_mut().for_each(|item| *item = seen[*item as usize]);
            }
            meshes.push(tree);
        }
        let is_seen = |geom, prim| !unseen.has(geometry.primitive(geom, prim));
        for (prim, quad) in (0..).zip(&geometry.quads) {
            if !is_seen(geometry.quads_id(), prim) {
                continue;
            }
            shapes.push(TreeShape::Quad(prim));
            bounds.push(Box3::of(&quad.map(doubles)));
        }
        for (prim, sphere) in (0..).zip(&geometry.spheres) {
            if !is_seen(geometry.spheres_id(), prim) {
                continue;
            }
            shapes.push(TreeShape::Sphere(prim));
            bounds.push(Box3::of_sphere(sphere.center, sphere.radius));
        }
        let all = Box3::around(bounds.iter().copied());
        let scene = builder.tree(&bounds)?;
        // The bounds of an empty scene are infinite.
        let reach = all.min.abs().max(all.max.abs());
        let reach = if reach.is_finite() { reach } else { DVec3::ZERO };
        Ok(Self { geometry, shapes, scene, meshes, reach, peak_bytes: builder.peak_bytes })
    }

    /// Returns the closest hit of the ray. Adds the visited nodes and primitives to `visits`.
    pub fn closest_hit(&self, ray: &LaneRay, visits: &mut Visits) -> Option<LaneHit> {
        self.search(ray, visits, &mut Default::default())
    }

    /// Returns the closest hit by testing every primitive of the geometry without boxes: the
    /// reference for the trees.
    pub fn plain_loop(&self, ray: &LaneRay) -> Option<LaneHit> {
        let ray = PreparedRay::new(ray, self.reach);
        let mut best = None;
        for (geom, range) in (0..).zip(self.geometry.bases().windows(2)) {
            for prim in 0..range[1] - range[0] {
                self.offer(&ray, geom, prim, &mut best);
            }
        }
        best.filter(|hit: &LaneHit| hit.t < ray.ray.tfar)
    }

    fn search(
        &self,
        ray: &LaneRay,
        visits: &mut Visits,
        stacks: &mut [Vec<u32>; 2],
    ) -> Option<LaneHit> {
        let ray = PreparedRay::new(ray, self.reach);
        let (geometry, mut best) = (&self.geometry, None);
        let [outer, inner] = stacks;
        self.scene.each(&ray, visits, outer, |shape, visits| match self.shapes[shape as usize] {
            TreeShape::Quad(prim) => {
                visits.primitives += 1;
                self.offer(&ray, geometry.quads_id(), prim, &mut best);
            }
            TreeShape::Sphere(prim) => {
                visits.primitives += 1;
                self.offer(&ray, geometry.spheres_id(), prim, &mut best);
            }
            TreeShape::Mesh(geom) => {
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
        best.filter(|hit: &LaneHit| hit.t < ray.ray.tfar)
    }

    /// Tests one primitive and keeps its hit if it is the closest so far.
    ///
    /// Of equally near hits, the lowest scene-wide primitive index wins, so the order of the tests
    /// does not matter.
    fn offer(&self, ray: &PreparedRay, geom: u32, prim: u32, best: &mut Option<LaneHit>) {
        let Some(hit) = self.test(ray, geom, prim) else { return };
        let key = |hit: &LaneHit| (hit.t, self.geometry.primitive(hit.geom, hit.prim));
        if best.as_ref().is_none_or(|best| key(&hit) < key(best)) {
            *best = Some(hit);
        }
    }

    fn test(&self, ray: &PreparedRay, geom: u32, prim: u32) -> Option<LaneHit> {
        let leaving = ray.ray.leaving == self.geometry.primitive(geom, prim);
        let hit = |t, u, v, ng| Some(LaneHit { geom, prim, t, u, v, ng });
        match self.geometry.kind(geom) {
            GeometryKind::Spheres => {
                let sphere = &self.geometry.spheres[prim as usize];
                let t = sphere_hit(ray, sphere, leaving)?;
                hit(t, 0.0, 0.0, ray.at(t) - sphere.center)
            }
            // `accel::build` refuses instances for this backend.
            GeometryKind::Instance(_) => None,
            _ if leaving => None,
            GeometryKind::Mesh(mesh) => {
                let corners = self.geometry.meshes[mesh].corners(prim).map(doubles);
                let [v0, v1, v2] = corners;
                let normal = (v1 - v0).cross(v2 - v0);
                let t = planar_hit(ray, &corners, normal)?;
                let (u, v) = weights(corners, normal, ray.at(t));
                hit(t, u, v, normal)
            }
            GeometryKind::Quads => {
                let corners = self.geometry.quads[prim as usize].map(doubles);
                let [v0, v1, v2, v3] = corners;
                let [first, second] = quad_halves(corners);
                let normal = (v2 - v0).cross(v3 - v1);
                let t = planar_hit(ray, &corners, normal)?;
                let (u, v) = weights(first, normal, ray.at(t));
                if u + v <= 1.0 {
                    return hit(t, u, v, normal);
                }
                let (u, v) = weights(second, normal, ray.at(t));
                hit(t, 1.0 - u, 1.0 - v, normal)
            }
        }
    }
}

/// Returns t where the ray hits a convex polygon: intersects its plane, then tests the point
/// against each edge.
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
    if !(t > ray.ray.tnear) || !ray.is_in(&Box3::of(corners), t) {
        return None;
    }
    let point = ray.at(t);
    let inside = (0..N).all(|i| {
        let edge = corners[(i + 1) % N] - corners[i];
        normal.dot(edge.cross(point - corners[i])) >= 0.0
    });
    inside.then_some(t)
}

/// Returns the barycentric weights of the second and third corner at a point of the triangle's
/// plane.
fn weights([v0, v1, v2]: [DVec3; 3], normal: DVec3, point: DVec3) -> (f64, f64) {
    let whole = normal.dot((v1 - v0).cross(v2 - v0));
    let u = normal.dot((v0 - v2).cross(point - v2)) / whole;
    let v = normal.dot((v1 - v0).cross(point - v0)) / whole;
    (u, v)
}

/// Returns the smallest root of |o + t d - c|^2 = r^2 above `tnear`, by the textbook quadratic
/// formula.
fn sphere_hit(ray: &PreparedRay, sphere: &Sphere, leaving: bool) -> Option<f64> {
    let LaneRay { origin, direction, tnear, .. } = ray.ray;
    let from_center = origin - sphere.center;
    let a = direction.dot(direction);
    let b = 2.0 * direction.dot(from_center);
    let c = from_center.dot(from_center) - sphere.radius * sphere.radius;
    let root = (b * b - 4.0 * a * c).sqrt();
    // A ray that leaves the sphere starts at one of the roots. That root does not count.
    let roots = match leaving {
        true => [f64::NAN, (-b + root.copysign(-b)) / (2.0 * a)],
        false => [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)],
    };
    let bounds = Box3::of_sphere(sphere.center, sphere.radius);
    roots.into_iter().find(|&t| t > tnear && ray.is_in(&bounds, t))
}

impl Accelerator for Coursework<'_> {
    fn info(&self) -> BuildInfo {
        let trees = self.meshes.iter().flatten().chain([&self.scene]);
        let bytes = trees.map(BoxTree::bytes).sum::<u64>() + size_of_val(&self.shapes[..]) as u64;
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
            let ray = LaneRay::of(&packet.rays, i);
            if let Some(hit) = self.search(&ray, &mut visits, &mut stacks) {
                hit.store(packet, i);
            }
        }
    }

    /// As for the report's shadow rays, a ray is occluded if its closest hit lies before `tfar`.
    fn occluded(&self, active: &Mask, rays: &mut Rays, _: Coherence) {
        let (mut visits, mut stacks) = Default::default();
        for i in lanes(active) {
            if self.search(&LaneRay::of(rays, i), &mut visits, &mut stacks).is_some() {
                rays.tfar[i] = f32::NEG_INFINITY;
            }
        }
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.scene.near(nearby, &mut |shape| match self.shapes[shape as usize] {
            TreeShape::Quad(prim) => found(geometry.primitive(geometry.quads_id(), prim)),
            TreeShape::Sphere(_) => {}
            TreeShape::Mesh(geom) => {
                let mut triangle = |prim| found(geometry.primitive(geom, prim));
                match &self.meshes[geom as usize] {
                    Some(tree) => tree.near(nearby, &mut triangle),
                    None => (0..geometry.meshes[geom as usize].triangles().len() as u32)
                        .for_each(triangle),
                }
            }
        });
    }

    /// A test of a box counts as a node, and so does that of the box of a whole mesh.
    fn visits(&self, active: &Mask, rays: &Rays, _: bool, _: Coherence) -> Option<Visits> {
        let mut visits = Visits::default();
        for i in lanes(active) {
            let _ = self.closest_hit(&LaneRay::of(rays, i), &mut visits);
        }
        Some(visits)
    }
}

/// A ray with the values that all tests of boxes share.
struct PreparedRay {
    ray: LaneRay,
    /// Reciprocal of the direction.
    inverse: DVec3,
    /// Distance by which rounding may put a hit outside the bounds of its shape, for each axis:
    /// 2^-50 (|origin| + the largest coordinate of the scene).
    slack: DVec3,
}

impl PreparedRay {
    fn new(ray: &LaneRay, reach: DVec3) -> Self {
        let slack = (ray.origin.abs() + reach) * (4.0 * f64::EPSILON);
        Self { ray: *ray, inverse: ray.direction.recip(), slack }
    }

    fn at(&self, t: f64) -> DVec3 {
        self.ray.origin + self.ray.direction * t
    }

    /// Returns whether the ray may hit the box, by its six planes moved outwards by 3 slacks.
    ///
    /// The test never loses a hit within the box. Let u = 2^-53, M = |origin| + reach, and s = 8uM
    /// the slack. A hit at t has fl(o + fl(t d)) >= min - s. Hence t d >= min - o - s - 4uM, with
    /// the rounding of its comparison. The plane is moved by 3s. Its computed t times d is at most
    /// min - o - 3s + 6uM < min - o - 2s, five roundings included: not above t d of the hit. The
    /// same holds for max. A NaN (0/0, all coordinates zero) is dropped by `min` and `max` and
    /// rejects no box.
    fn may_hit(&self, bounds: &Box3) -> bool {
        let slack = 3.0 * self.slack;
        let first = (bounds.min - (self.ray.origin + slack)) * self.inverse;
        let second = (bounds.max - (self.ray.origin - slack)) * self.inverse;
        slabs_meet(first, second, [self.ray.tnear, f64::INFINITY])
    }

    /// Returns whether the ray's point at t lies within the bounds, up to the slack.
    fn is_in(&self, bounds: &Box3, t: f64) -> bool {
        let point = self.at(t);
        (bounds.min - self.slack).cmple(point).all() && point.cmple(bounds.max + self.slack).all()
    }
}

/// A binary tree over boxes. Node 0 is the root.
struct BoxTree {
    nodes: Vec<BoxNode>,
    /// Indices of the shapes, leaf by leaf.
    order: Vec<u32>,
}

struct BoxNode {
    bounds: Box3,
    content: Content,
}

#[derive(Clone, Copy)]
enum Content {
    /// Indices of two child nodes; one of them may be [`EMPTY`].
    Inner([u32; 2]),
    /// A range of [`BoxTree::order`].
    Leaf { first: u32, end: u32 },
}

/// Index of a child without shapes.
const EMPTY: u32 = u32::MAX;

impl BoxTree {
    /// Calls `found` for the shapes of every leaf that the ray reaches.
    ///
    /// The ray reaches a leaf if it may hit the box of the leaf and the boxes of all nodes above,
    /// except for the root, whose box is not tested.
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
                        if ray.may_hit(&self.nodes[child as usize].bounds) {
                            stack.push(child);
                        }
                    }
                }
            }
        }
    }

    /// Calls `found` for the shapes of every leaf whose box is near.
    fn near(&self, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        let mut stack = vec![0];
        while let Some(node) = stack.pop() {
            let BoxNode { bounds, content } = &self.nodes[node as usize];
            if nearby.reach([bounds.min, bounds.max]).is_none() {
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

/// A range of shapes whose node is still to be built.
struct BuildTask {
    node: usize,
    first: usize,
    end: usize,
    /// Failed splits in a row above this node.
    attempts: u32,
}

/// State shared by the builds of all trees of a scene.
struct Builder<'m> {
    /// Most bytes that all trees together may hold.
    limit: u64,
    /// Bytes of the finished trees.
    bytes: u64,
    /// Largest number of bytes held so far.
    peak_bytes: u64,
    monitor: &'m Monitor,
}

impl Builder<'_> {
    fn tree(&mut self, bounds: &[Box3]) -> Result<BoxTree> {
        let mut order: Vec<u32> = (0..bounds.len() as u32).collect();
        let mut nodes = vec![];
        let mut tasks = vec![];
        let add = |nodes: &mut Vec<BoxNode>, tasks: &mut Vec<BuildTask>, first, end, attempts| {
            if first == end {
                return EMPTY;
            }
            let content = Content::Leaf { first: first as u32, end: end as u32 };
            tasks.push(BuildTask { node: nodes.len(), first, end, attempts });
            nodes.push(BoxNode { bounds: Box3::EMPTY, content });
            nodes.len() as u32 - 1
        };
        add(&mut nodes, &mut tasks, 0, bounds.len(), 0);
        while let Some(BuildTask { node, first, end, attempts }) = tasks.pop() {
            self.monitor.check()?;
            self.check_room(nodes.len())?;
            let set = &mut order[first..end];
            let all = Box3::around(set.iter().map(|&s| bounds[s as usize]));
            nodes[node].bounds = all;
            if set.len() <= 1 || attempts > MAX_ATTEMPTS {
                continue;
            }
            let axis = longest_axis(&all);
            let middle = |b: &Box3| (b.min[axis] + b.max[axis]) / 2.0;
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
            nodes.push(BoxNode { bounds: Box3::EMPTY, content });
        }
        let tree = BoxTree { nodes, order };
        let building = tree.nodes.capacity() * size_of::<BoxNode>() + size_of_val(bounds);
        self.peak_bytes = self.peak_bytes.max(self.bytes + building as u64);
        self.bytes += tree.bytes();
        Ok(tree)
    }

    fn check_room(&self, nodes: usize) -> Result<()> {
        let bytes = self.bytes + (nodes * size_of::<BoxNode>()) as u64;
        if bytes <= self.limit { Ok(()) } else { Err(over_limit(self.limit)) }
    }
}

/// Returns the axis of the longest side: 0, 1 or 2. Of equal sides, the lowest axis.
fn longest_axis(bounds: &Box3) -> usize {
    let side = bounds.max - bounds.min;
    let longest: BVec3 = side.cmpeq(DVec3::splat(side.max_element()));
    longest.bitmask().trailing_zeros().min(2) as usize
}

/// Moves the shapes that go left to the front and returns their number.
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
    use crate::error::ErrorKind;
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

    fn ray(origin: [f32; 3], direction: [f32; 3]) -> LaneRay {
        LaneRay {
            origin: doubles(origin),
            direction: doubles(direction),
            tnear: 0.0,
            tfar: f64::INFINITY,
            leaving: NONE,
        }
    }

    fn depth(tree: &BoxTree) -> usize {
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

    /// Points with small integer coordinates: many rays run in box faces, along edges and through
    /// vertices.
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
        ) {
            let add = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|k| a[k] + b[k]);
            let quads = quads.into_iter().map(|(o, a, b)| [o, add(o, a), add(add(o, a), b), add(o, b)]);
            let spheres = spheres.into_iter().map(|(c, radius)| Sphere { center: doubles(c), radius });
            let meshes = vec![soup(&triangles, false), soup(&looped, true)];
            let geometry = Geometry::new(DVec3::ZERO, meshes, quads.collect(), spheres.collect());
            let geometry = geometry.unwrap();
            let trees = build(&geometry);
            for (origin, direction, leaving) in rays {
                let ray = LaneRay { leaving, ..ray(origin, direction) };
                let found = trees.closest_hit(&ray, &mut Visits::default());
                prop_assert_eq!(found, trees.plain_loop(&ray), "{:?}", ray);
            }
        }
    }

    /// An octahedron whose corners have distance 1 from the origin.
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
        // All sides are equal, so the first split is x = 0, with four faces on each side. Their
        // bounds are 1 by 2 by 2. Splits of y and z follow, down to single faces.
        let tree = trees.meshes[0].as_ref().unwrap();
        assert_eq!((tree.nodes.len(), depth(tree)), (15, 3));
        let mut visits = Visits::default();
        let hit =
            trees.closest_hit(&ray([0.25, 0.25, 5.0], [0.0, 0.0, -1.0]), &mut visits).unwrap();
        assert_eq!(hit.t, 4.5);
        // Six box tests: two for x, two for y, two for z. The ray hits both z boxes, of one face
        // each.
        assert_eq!(visits, Visits { nodes: 6, primitives: 2 });
    }

    #[test]
    fn a_set_that_cannot_be_split_becomes_a_leaf_after_one_more_attempt() {
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
    fn a_build_stops_at_its_memory_limit_and_on_a_signal() {
        let geometry = geometry(vec![octahedron()]);
        let monitor = Monitor::default();
        let little = BuildOptions { max_bytes: Some(500), ..OPTIONS };
        let error = Coursework::build(&geometry, &little, &monitor).err().unwrap();
        assert_eq!(error.kind, ErrorKind::Limit);
        monitor.signal.store(2, std::sync::atomic::Ordering::Relaxed);
        let error = Coursework::build(&geometry, &OPTIONS, &monitor).err().unwrap();
        assert_eq!(error.kind, ErrorKind::Interrupted(2));
    }

    #[test]
    fn packets_get_f32_hits_and_lanes_that_miss_stay_as_they_were() {
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
        // Lane 5 leaves the sphere: it hits the far side, not the near one.
        (packet.rays.org[2][5], packet.rays.dir[2][5]) = (2.0, 2.0);
        packet.rays.leaving[5] = geometry.primitive(1, 0);
        let mut active = Mask::ALL;
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
