//! Validation of a tree. The tests, the fuzzer and `crosscheck` use it.

use std::fmt;

use super::bounds::Bounds3;
use super::node::{Child, ChildKind, Node, WIDE, WIDTH};
use super::simd::MAX_DEPTH;
use super::tree::Bvh;
use crate::geometry::{Geometry, GeometryKind, quad_halves};
use crate::ray::NONE;

/// Size and shape of a tree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct TreeStats {
    /// Number of levels of inner nodes.
    pub depth: usize,
    /// Number of inner nodes.
    pub nodes: usize,
    /// Number of inner nodes by number of children.
    pub nodes_of: [usize; WIDTH + 1],
    /// Number of leaves of triangles.
    pub leaves: usize,
    /// Number of leaves of triangles by number of triangles.
    pub leaves_of: [usize; WIDTH + 1],
    /// Number of leaves of spheres.
    pub sphere_leaves: usize,
    /// Number of triangles, two for each quad.
    pub triangles: usize,
    /// Number of spheres in all leaves.
    pub spheres: usize,
    /// Number of instances. Each has a leaf of spheres for itself.
    pub instances: usize,
}

impl TreeStats {
    /// Mean number of children of a node.
    pub fn children_per_node(&self) -> f64 {
        mean(&self.nodes_of)
    }

    /// Mean number of triangles in a leaf of triangles; NaN without one.
    pub fn triangles_per_leaf(&self) -> f64 {
        mean(&self.leaves_of)
    }
}

fn mean(histogram: &[usize]) -> f64 {
    let sum: usize = histogram.iter().enumerate().map(|(n, count)| n * count).sum();
    sum as f64 / histogram.iter().sum::<usize>() as f64
}

impl fmt::Display for TreeStats {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let nodes = (self.nodes, self.children_per_node(), self.depth);
        write!(f, "{} nodes of {:.2} children in {} levels", nodes.0, nodes.1, nodes.2)?;
        if self.leaves > 0 {
            write!(f, ", {} leaves of {:.2} triangles", self.leaves, self.triangles_per_leaf())?;
        }
        if self.sphere_leaves > 0 {
            write!(f, ", {} leaves of {} spheres", self.sphere_leaves, self.spheres)?;
        }
        if self.instances > 0 {
            write!(f, " and {} instances", self.instances)?;
        }
        Ok(())
    }
}

impl Bvh<'_> {
    /// Checks the tree and returns its size:
    ///
    /// - Every primitive of the geometry is in exactly one leaf, unchanged. Each half of a quad is
    ///   in one leaf. So a tree of [`Bvh::build_part`] without some primitives fails.
    /// - Every box is the smallest box around its contents.
    /// - The order of each octant runs from far to near.
    /// - No node and no leaf is empty, except for the root of a geometry without primitives.
    /// - No path has more levels than the traversal stack supports.
    ///
    /// # Errors
    /// Describes the first violation.
    pub fn validate(&self) -> Result<TreeStats, String> {
        let total = self.geometry.count() as usize;
        let mut validator =
            Validator { bvh: self, seen: vec![0; total], stats: TreeStats::default() };
        let bounds = validator.node(0, 1)?;
        same(&bounds, &self.tree.bounds).map_err(|e| format!("the scene's box: {e}"))?;
        validator.finish()
    }
}

/// State of a validation.
struct Validator<'a> {
    bvh: &'a Bvh<'a>,
    /// Parts of each primitive seen so far: bit 0 for the first half or the whole, bit 1 for the
    /// second half.
    seen: Vec<u8>,
    stats: TreeStats,
}

impl Validator<'_> {
    /// Checks a subtree whose root is on the given level. Returns its box.
    fn node(&mut self, index: usize, level: usize) -> Result<Bounds3, String> {
        let tree = &self.bvh.tree;
        let node = tree.nodes.get(index).ok_or_else(|| format!("node {index} does not exist"))?;
        let place = |what: String| format!("node {index}: {what}");
        if level > MAX_DEPTH {
            return Err(place(format!("is on level {level}, expected at most {MAX_DEPTH}")));
        }
        if self.stats.nodes == tree.nodes.len() {
            return Err(place("reached twice".into()));
        }
        self.stats.depth = self.stats.depth.max(level);
        self.stats.nodes += 1;
        let len = node.children.iter().take_while(|&&child| child != Child::EMPTY).count();
        self.stats.nodes_of[len] += 1;
        if len == 0 && !self.seen.is_empty() {
            return Err(place("has no children".into()));
        }
        empty_behind(node, len).map_err(place)?;
        in_order(node, len).map_err(place)?;
        let mut all = Bounds3::EMPTY;
        for slot in 0..len {
            let below = match node.children[slot].kind() {
                ChildKind::Node(child) => self.node(child, level + 1)?,
                ChildKind::Triangles(leaf) => self.triangles(leaf)?,
                ChildKind::Spheres(leaf) => self.spheres(leaf)?,
                ChildKind::Empty => Bounds3::EMPTY,
            };
            same(&bounds(node, slot), &below)
                .map_err(|e| place(format!("the box of child {slot}: {e}")))?;
            all = all.union(below);
        }
        Ok(all)
    }

    /// Checks a leaf of triangles. Returns its box.
    fn triangles(&mut self, index: usize) -> Result<Bounds3, String> {
        let (tree, geometry) = (&*self.bvh.tree, &*self.bvh.geometry);
        let place = |what: String| format!("leaf {index}: {what}");
        let block = tree.blocks.get(index).ok_or_else(|| place("does not exist".into()))?;
        let mut bounds = Bounds3::EMPTY;
        for i in 0..WIDTH {
            if (block.present >> i) & 1 == 0 {
                continue;
            }
            if block.base & WIDE != 0 && (block.base & !WIDE) as usize >= tree.wide.len() {
                return Err(place("has no primitive indices".into()));
            }
            let primitive = tree.indices().of(block, i);
            let second = block.is_second_half(i);
            let source = triangle(geometry, primitive, second).map_err(place)?;
            let kept = block.triangle(i);
            if kept.map(|v| v.map(f32::to_bits)) != source.map(|v| v.map(f32::to_bits)) {
                return Err(place(format!(
                    "slot {i} has {kept:?}, expected {source:?} of primitive {primitive}"
                )));
            }
            self.see(primitive, if second { 2 } else { 1 }).map_err(place)?;
            self.stats.triangles += 1;
            bounds = bounds.union(Bounds3::from_points(&kept));
        }
        if block.present == 0 {
            return Err(place("is empty".into()));
        }
        self.stats.leaves += 1;
        self.stats.leaves_of[block.present.count_ones() as usize] += 1;
        Ok(bounds)
    }

    /// Checks a leaf of spheres. Returns its box.
    fn spheres(&mut self, index: usize) -> Result<Bounds3, String> {
        let (tree, geometry) = (&*self.bvh.tree, &*self.bvh.geometry);
        let place = |what: String| format!("sphere leaf {index}: {what}");
        let leaf = tree.spheres.get(index).ok_or_else(|| place("does not exist".into()))?;
        let len = leaf.0.iter().take_while(|&&id| id != NONE).count();
        if len == 0 || leaf.0[len..].iter().any(|&id| id != NONE) {
            return Err(place(format!("holds {:?}", leaf.0)));
        }
        let mut bounds = Bounds3::EMPTY;
        for &id in &leaf.0[..len] {
            if let Some(index) = geometry.instance_in_leaf(id) {
                let instance = geometry.instance_id(index);
                let triangles = geometry.bases()[instance as usize..][..2].to_vec();
                for triangle in triangles[0]..triangles[1] {
                    self.see(triangle, 1).map_err(place)?;
                }
                let [lower, upper] = geometry.instances[index].bounds;
                bounds = bounds.union(Bounds3::new(lower, upper));
                self.stats.instances += 1;
                continue;
            }
            let sphere = geometry
                .spheres
                .get(id as usize)
                .ok_or_else(|| place(format!("there is no sphere {id}")))?;
            self.see(geometry.primitive(geometry.spheres_id(), id), 1).map_err(place)?;
            let (lower, upper) = sphere.bounds();
            bounds = bounds.union(Bounds3::new(lower, upper));
            self.stats.spheres += 1;
        }
        self.stats.sphere_leaves += 1;
        Ok(bounds)
    }

    fn see(&mut self, primitive: u32, part: u8) -> Result<(), String> {
        match self.seen.get_mut(primitive as usize) {
            None => Err(format!("there is no primitive {primitive}")),
            Some(seen) if *seen & part != 0 => {
                Err(format!("primitive {primitive} is in the tree twice"))
            }
            Some(seen) => {
                *seen |= part;
                Ok(())
            }
        }
    }

    /// Checks that every primitive was seen and that the counts match those of the tree.
    fn finish(self) -> Result<TreeStats, String> {
        let (tree, geometry, stats) = (&*self.bvh.tree, &*self.bvh.geometry, self.stats);
        for (primitive, &seen) in self.seen.iter().enumerate() {
            let (geom, prim) = geometry.place(primitive as u32);
            let whole = if geometry.kind(geom) == GeometryKind::Quads { 3 } else { 1 };
            if seen != whole {
                return Err(format!("primitive {prim} of geometry {geom} is not in the tree"));
            }
        }
        let found = [stats.depth, stats.nodes, stats.leaves, stats.sphere_leaves];
        let recorded = [tree.depth, tree.nodes.len(), tree.blocks.len(), tree.spheres.len()];
        if found != recorded {
            return Err(format!(
                "levels, nodes, leaves and sphere leaves: found {found:?}, recorded {recorded:?}"
            ));
        }
        Ok(stats)
    }
}

/// Returns the corners of a triangle or of one half of a quad.
fn triangle(
    geometry: &Geometry,
    primitive: u32,
    second_half: bool,
) -> Result<[[f32; 3]; 3], String> {
    if u64::from(primitive) >= geometry.count() {
        return Err(format!("there is no primitive {primitive}"));
    }
    let (geom, prim) = geometry.place(primitive);
    match (geometry.kind(geom), second_half) {
        (GeometryKind::Mesh(mesh), false) => Ok(geometry.meshes[mesh].corners(prim)),
        (GeometryKind::Quads, half) => {
            Ok(quad_halves(geometry.quads[prim as usize])[usize::from(half)])
        }
        (kind, half) => Err(format!("primitive {primitive} is of {kind:?}, second half: {half}")),
    }
}

/// Returns the box of a child.
fn bounds(node: &Node, slot: usize) -> Bounds3 {
    let corner = |first: usize| [0, 1, 2].map(|axis| node.planes[first + axis][slot]);
    Bounds3::new(corner(0), corner(3))
}

fn same(kept: &Bounds3, needed: &Bounds3) -> Result<(), String> {
    let corners = |b: &Bounds3| (b.lower(), b.upper());
    let (kept, needed) = (corners(kept), corners(needed));
    (kept == needed).then_some(()).ok_or_else(|| format!("is {kept:?}, expected {needed:?}"))
}

/// Checks that the slots from `len` on are empty, with boxes that no ray hits.
fn empty_behind(node: &Node, len: usize) -> Result<(), String> {
    if let Some(behind) = node.children[len..].iter().position(|&child| child != Child::EMPTY) {
        return Err(format!("child {} follows an empty one", len + behind));
    }
    for slot in len..WIDTH {
        for (row, planes) in node.planes.iter().enumerate() {
            let outside = if row < 3 { f32::INFINITY } else { f32::NEG_INFINITY };
            if planes[slot] != outside {
                return Err(format!("empty child {slot} has a plane at {}", planes[slot]));
            }
        }
    }
    Ok(())
}

/// Checks that each octant's order is a permutation of the slots: first the children from far to
/// near, then the empty slots.
fn in_order(node: &Node, len: usize) -> Result<(), String> {
    if len == 0 {
        return Ok(());
    }
    for octant in 0..8 {
        let order: [usize; WIDTH] = std::array::from_fn(|j| node.ordered(octant, j));
        let named = order.iter().fold(0u32, |named, &slot| named | 1 << slot);
        if named != (1 << WIDTH) - 1 || order[..len].iter().any(|&slot| slot >= len) {
            return Err(format!(
                "octant {octant}: order {order:?} is no permutation with {len} children first"
            ));
        }
        let distance = |slot: usize| {
            let center = bounds(node, slot).center2();
            let sign = |axis: usize| if (octant >> axis) & 1 == 0 { 1.0 } else { -1.0 };
            center[0] * sign(0) + center[1] * sign(1) + center[2] * sign(2)
        };
        if order[..len].windows(2).any(|pair| distance(pair[0]) < distance(pair[1])) {
            return Err(format!("octant {octant}: order {order:?} is not from far to near"));
        }
    }
    Ok(())
}
