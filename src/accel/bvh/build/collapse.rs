//! Binary tree -> wide nodes, with the smallest expected number of node visits per ray.
//!
//! A ray visits a node with a probability proportional to the area of its box. Dynamic programming
//! over the number of slots that a subtree may fill chooses which binary nodes become wide ones.
//! See Wald, Benthin and Boulos 2008, "Getting Rid of Packets"; Ylitie, Karras and Laine 2017,
//! section 3.1.

use rayon::prelude::*;

use super::super::bounds::Bounds3;
use super::super::node::{Block, Child, ChildKind, Indices, Node, SphereLeaf, WIDTH};
use super::SMALLER;
use super::binary::BinaryTree;
use super::binary_node::{BinaryNode, Slot};
use crate::error::Result;
use crate::parallel;
use crate::reserve;

/// The finished tree. Children are indices into its arrays.
pub struct Tree {
    /// Inner nodes. The root is the first.
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
    pub spheres: Vec<SphereLeaf>,
    /// Upper 16 bits of the primitive indices of the leaves in which they are far apart: see
    /// [`Indices`].
    pub wide: Vec<[u16; WIDTH]>,
    /// The trees of the meshes of instances: see [`Geometry::shared`](crate::geometry::Geometry).
    pub shared: Vec<Tree>,
    /// Box of the whole scene.
    pub bounds: Bounds3,
    /// Number of levels of inner nodes.
    pub depth: usize,
    /// Whether the tree is large enough for prefetching to pay.
    pub is_large: bool,
    /// Whether rays in no order take turns to find their closest hits.
    pub closest_in_turns: bool,
}

impl Tree {
    /// Prefetches a node or a leaf of triangles.
    #[inline(always)]
    pub fn prefetch(&self, child: Child) {
        match child.kind() {
            ChildKind::Node(index) => prefetch_all(&self.nodes, index),
            ChildKind::Triangles(index) => prefetch_all(&self.blocks, index),
            ChildKind::Spheres(_) | ChildKind::Empty => {}
        }
    }

    /// Prefetches a node or a leaf of triangles if the tree is larger than caches are.
    #[inline(always)]
    pub fn prefetch_if_large(&self, child: Child) {
        if self.is_large {
            self.prefetch(child);
        }
    }

    /// Returns what finds the primitive indices of the leaves of triangles.
    #[inline(always)]
    pub fn indices(&self) -> Indices<'_> {
        Indices { wide: &self.wide, first: 0 }
    }

    /// Returns the size of the arrays in bytes.
    pub fn bytes(&self) -> u64 {
        let own = size_of_val(&self.nodes[..])
            + size_of_val(&self.blocks[..])
            + size_of_val(&self.spheres[..])
            + size_of_val(&self.wide[..]);
        own as u64 + self.shared.iter().map(Tree::bytes).sum::<u64>()
    }
}

/// From this many slots on, two subtrees are processed in parallel.
const MIN_PARALLEL: usize = 1 << (16 - SMALLER);

/// From this many wide nodes on, the subtrees of a node are written in parallel.
const MIN_PARALLEL_NODES: usize = 1 << (12 - SMALLER);

/// Collapses a binary tree. An empty tree becomes a root without children. Wide nodes refer to
/// leaves by index; the leaves themselves are not made here.
///
/// # Errors
/// If there is too little memory.
pub fn collapse(tree: &mut BinaryTree) -> Result<Tree> {
    let binary = &mut tree.slots[..];
    let mut plan = reserve::filled([0; WIDTH], binary.len(), "bvh")?;
    let mut number = 0;
    if !binary.is_empty() {
        slots(binary, &mut plan, area_unit(&binary[0]));
        number = count(binary, &plan, 1);
    }
    // The root is there even if the whole tree is empty or one leaf.
    let number = number.max(1);
    let mut nodes = Vec::new();
    reserve::exact(&mut nodes, number, "bvh")?;
    // In parallel, because the first touch of the memory takes longer than the nodes do.
    (0..number).into_par_iter().map(|_| Node::EMPTY).collect_into_vec(&mut nodes);
    let depth = if binary.is_empty() { 1 } else { write(binary, &plan, 0, &mut nodes, 0) };
    Ok(Tree {
        nodes,
        blocks: Vec::new(),
        spheres: Vec::new(),
        wide: Vec::new(),
        shared: Vec::new(),
        bounds: Bounds3::EMPTY,
        depth,
        is_large: false,
        closest_in_turns: false,
    })
}

/// Returns the bytes that collapsing holds besides its result.
pub fn scratch_bytes(tree: &BinaryTree) -> u64 {
    ((size_of::<Slot>() + size_of::<Plan>()) * tree.len) as u64
}

/// How a subtree fills k slots of a wide node.
///
/// Element k - 1, for k from 2 to 16, is the number of these slots that the left child gets. It is
/// 0 if the subtree takes only one slot. Element 0 is the left child's share of 16 slots, if the
/// subtree becomes a wide node itself.
type Plan = [u8; WIDTH];

/// Returns the unit of areas: a power of two near the area of the root. So sums of areas stay in
/// the range of f32 however large the coordinates are.
fn area_unit(root: &Slot) -> f64 {
    let area = BinaryNode::read(root).bounds().half_area();
    if area.is_normal() { area.log2().floor().exp2() } else { 1.0 }
}

/// Plans the subtree whose root is the first node of `binary`. Returns its costs: element k - 1 is
/// the smallest sum of the areas of its wide nodes if it may fill k slots.
fn slots(binary: &[Slot], plan: &mut [Plan], unit: f64) -> [f32; WIDTH] {
    let root = BinaryNode::read(&binary[0]);
    let right = root.right();
    if right == 0 {
        return [0.0; WIDTH];
    }
    let (own, below) = plan.split_at_mut(1);
    let (below_left, below_right) = below.split_at_mut(right - 1);
    let (a, b) = if binary.len() >= MIN_PARALLEL {
        rayon::join(
            || slots(&binary[1..right], below_left, unit),
            || slots(&binary[right..], below_right, unit),
        )
    } else {
        (slots(&binary[1..right], below_left, unit), slots(&binary[right..], below_right, unit))
    };
    let mut cost = [f32::INFINITY; WIDTH];
    for k in 2..=WIDTH {
        for i in 1..k {
            let sum = a[i - 1] + b[k - i - 1];
            if sum < cost[k - 1] {
                cost[k - 1] = sum;
                own[0][k - 1] = i as u8;
            }
        }
    }
    own[0][0] = own[0][WIDTH - 1];
    cost[0] = cost[WIDTH - 1] + (root.bounds().half_area() / unit) as f32;
    for k in 2..=WIDTH {
        if cost[0] <= cost[k - 1] {
            cost[k - 1] = cost[0];
            own[0][k - 1] = 0;
        }
    }
    cost
}

/// Counts the wide nodes of the subtree whose root is the first node of `binary`, if it may fill
/// `slots` slots. Stores in each binary node that becomes a wide one how many are in its subtree.
fn count(binary: &mut [Slot], plan: &[Plan], slots: usize) -> usize {
    let mut root = BinaryNode::read(&binary[0]);
    let right = root.right();
    if right == 0 {
        return 0;
    }
    // It becomes a wide node, with all slots of its own, or shares those of the node above.
    let shared = if slots < 2 { 0 } else { usize::from(plan[0][slots - 1]) };
    let (own, left, others) = match shared {
        0 => (1, usize::from(plan[0][0]), WIDTH - usize::from(plan[0][0])),
        left => (0, left, slots - left),
    };
    let parallel = binary.len() >= MIN_PARALLEL;
    let (below_left, below_right) = binary[1..].split_at_mut(right - 1);
    let (a, b) = if parallel {
        rayon::join(
            || count(below_left, &plan[1..right], left),
            || count(below_right, &plan[right..], others),
        )
    } else {
        (count(below_left, &plan[1..right], left), count(below_right, &plan[right..], others))
    };
    let all = own + a + b;
    if own == 1 {
        root.set_number(all);
        root.write(&mut binary[0]);
    }
    all
}

/// Writes the wide tree below a binary node to `nodes`, its root first. The first of `nodes` has
/// the index `base`. Returns the number of its levels.
fn write(binary: &[Slot], plan: &[Plan], root: usize, nodes: &mut [Node], base: usize) -> usize {
    let parallel = nodes.len() >= MIN_PARALLEL_NODES;
    let children = Children::new(binary, plan, root);
    let mut starts = [0; WIDTH];
    let (node, mut rest) = nodes.split_at_mut(1);
    let mut below: [Option<(usize, usize, &mut [Node])>; WIDTH] = [const { None }; WIDTH];
    let mut next = base + 1;
    for (slot, &i) in children.indices().iter().enumerate() {
        if is_leaf(binary, i) {
            continue;
        }
        let (own, others) = rest.split_at_mut(BinaryNode::read(&binary[i]).number());
        (starts[slot], rest) = (next, others);
        next += own.len();
        below[slot] = Some((i, starts[slot], own));
    }
    node[0] = children.node(binary, &starts);
    let levels =
        |(i, start, nodes): (usize, usize, &mut [Node])| write(binary, plan, i, nodes, start);
    let below = below.into_iter().flatten();
    let depth = match parallel {
        true => parallel::map(below.collect::<Vec<_>>().into_iter(), levels).into_iter().max(),
        false => below.map(levels).max(),
    };
    depth.unwrap_or(0) + 1
}

fn is_leaf(binary: &[Slot], index: usize) -> bool {
    BinaryNode::read(&binary[index]).right() == 0
}

/// The binary nodes that become the children of one wide node.
struct Children {
    index: [usize; WIDTH],
    len: usize,
}

impl Children {
    fn new(binary: &[Slot], plan: &[Plan], root: usize) -> Self {
        let mut children = Self { index: [0; WIDTH], len: 0 };
        let right = BinaryNode::read(&binary[root]).right();
        if right == 0 {
            // The whole tree is one leaf.
            children.fill(binary, plan, root, 1);
            return children;
        }
        let left = usize::from(plan[root][0]);
        children.fill(binary, plan, root + 1, left);
        children.fill(binary, plan, root + right, WIDTH - left);
        children
    }

    /// Adds the subtree at `index`, in at most `slots` slots.
    fn fill(&mut self, binary: &[Slot], plan: &[Plan], index: usize, slots: usize) {
        let right = BinaryNode::read(&binary[index]).right();
        let left = if slots < 2 { 0 } else { usize::from(plan[index][slots - 1]) };
        if right == 0 || left == 0 {
            self.index[self.len] = index;
            self.len += 1;
        } else {
            self.fill(binary, plan, index + 1, left);
            self.fill(binary, plan, index + right, slots - left);
        }
    }

    fn indices(&self) -> &[usize] {
        &self.index[..self.len]
    }

    /// Returns the wide node. `starts[i]` is the index of child i if this is an inner node.
    fn node(&self, binary: &[Slot], starts: &[usize; WIDTH]) -> Node {
        let mut node = Node::EMPTY;
        let mut centers = [[f32::INFINITY; 3]; WIDTH];
        for (slot, &i) in self.indices().iter().enumerate() {
            let child = BinaryNode::read(&binary[i]);
            let bounds = child.bounds();
            let (lower, upper) = (bounds.lower(), bounds.upper());
            for axis in 0..3 {
                node.planes[axis][slot] = lower[axis];
                node.planes[axis + 3][slot] = upper[axis];
            }
            node.children[slot] = match (child.right(), child.is_of_spheres()) {
                (0, false) => Child::triangles(child.number()),
                (0, true) => Child::spheres(child.number()),
                _ => Child::node(starts[slot]),
            };
            centers[slot] = bounds.center2();
        }
        // The opposite octant has the reverse order.
        for octant in 0..4 {
            let sign = |axis: usize| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 };
            let along = |c: [f32; 3]| c[0] * sign(0) + c[1] * sign(1) + c[2] * sign(2);
            let mut order: [u8; WIDTH] = std::array::from_fn(|i| i as u8);
            order[..self.len].sort_by(|&a, &b| {
                along(centers[usize::from(b)]).total_cmp(&along(centers[usize::from(a)]))
            });
            node.set_order(octant, &order);
            order[..self.len].reverse();
            node.set_order(7 - octant, &order);
        }
        node
    }
}

/// Prefetches all cache lines of `values[index]`.
#[inline(always)]
fn prefetch_all<T>(values: &[T], index: usize) {
    for line in 0..size_of::<T>() / 64 {
        crate::simd::prefetch_line(values, index, line);
    }
}
