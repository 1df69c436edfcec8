//! Builds the tree: primitives -> references in cells -> binary tree by binned SAH -> wide nodes
//! and leaves.

mod binary;
mod binary_node;
mod block;
mod cells;
mod collapse;
mod groups;
mod in_order;
mod reference;
mod room;
mod sah;
mod split;

pub use self::collapse::Tree;

use std::mem;

use rayon::prelude::*;

use self::binary_node::{BinaryNode, Leaf, Slot};
use self::block::MakeBlock;
use self::reference::{Group, Reference};
use super::bounds::Bounds3;
use super::node::{Block, SphereLeaf, WIDE, WIDTH};
use crate::accel::accelerator::over_limit;
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::geometry::{Geometry, Unseen};
use crate::monitor::Monitor;
use crate::ray::NONE;
use crate::reserve;
use crate::simd::{self, Isa};

/// Unit tests are not optimised, so what is done for large meshes begins there at a sixteenth of
/// the size: sizes are shifted by this many bits less.
const SMALLER: u32 = if cfg!(test) { 4 } else { 0 };

/// Trees of more bytes are prefetched during traversal. The effect is in docs/notebook/bvh.md.
const MAX_UNPREFETCHED_BYTES: u64 = 64 << 20;

/// In trees of more bytes, rays in no order take turns to find their closest hits. In smaller ones
/// turns may cost more than they save: see docs/notebook/bvh.md.
const MAX_BYTES_WITHOUT_TURNS: u64 = 20 << 20;

/// Builds the tree without the primitives of `unseen`, on the current rayon pool. The meshes of
/// instances have trees of their own. Also returns the most bytes that the build held at a time.
///
/// # Errors
/// - `Interrupted` after a signal.
/// - `Limit` if the build needs more than `max_bytes`, or there are 2^30 primitives or more. A
///   lower bound is checked first, the exact bytes only when the nodes exist.
/// - `Retry` if there is too little memory.
pub fn build(
    (geometry, unseen): (&Geometry, &Unseen),
    isa: Isa,
    max_bytes: Option<u64>,
    monitor: &Monitor,
) -> Result<(Tree, u64)> {
    let within = |bytes: u64| match max_bytes {
        Some(limit) if bytes > limit => Err(over_limit(limit)),
        _ => Ok(bytes),
    };
    let count = groups::count(geometry, unseen);
    let most = groups::sorted_count(geometry).max(count as u64);
    if most >= MAX_REFERENCES {
        let message = format!("found {most} primitives, expected fewer than 2^30");
        return Err(Error::new(ErrorKind::Limit, Problem::new("bvh", message)));
    }
    // A lower bound: a pair has one box for two triangles.
    within((count.div_ceil(2) * size_of::<Reference>()) as u64)?;
    let mut sorted = cells::sort(geometry, unseen, isa)?;
    monitor.check()?;
    let mut binary = binary::build(geometry, &mut sorted, isa, monitor)?;
    monitor.check()?;
    let boxes = size_of_val(&sorted.references[..]) as u64;
    // The boxes have moved into the nodes.
    drop(sorted);
    let ids = mem::take(&mut binary.primitives);
    let sorted = (count * size_of::<Group>()) as u64;
    let splitting = boxes + sorted + (binary.len * size_of::<Slot>()) as u64;
    let leaves = binary::number_leaves(&mut binary)?;
    let sorted = sorted + size_of_val(&leaves[..]) as u64;
    let mut tree = collapse::collapse(&mut binary)?;
    let collapsing = sorted + collapse::scratch_bytes(&binary) + tree.bytes();
    let bounds =
        binary.slots.first().map_or(Bounds3::EMPTY, |root| *BinaryNode::read(root).bounds());
    drop(binary);
    let of_spheres = leaves.iter().filter(|leaf| leaf.spheres).count();
    let (mut triangles, mut spheres) = (Vec::<&Leaf>::new(), Vec::<&Leaf>::new());
    reserve::exact(&mut triangles, leaves.len() - of_spheres, "bvh")?;
    reserve::exact(&mut spheres, of_spheres, "bvh")?;
    for leaf in &leaves {
        if leaf.spheres { &mut spheres } else { &mut triangles }.push(leaf);
    }
    let filling = sorted
        + tree.bytes()
        + (triangles.len() * size_of::<Block>() + leaves.len() * size_of::<&Leaf>()) as u64
        + (spheres.len() * size_of::<SphereLeaf>()) as u64;
    let ids_of = |i: usize| triangles.get(i).map_or(&[][..], |leaf| &ids[leaf.range()]);
    let wide = (0..triangles.len()).into_par_iter().filter(|&i| block::is_wide(ids_of(i)));
    let wide: Vec<usize> = wide.collect();
    let filling = filling + (wide.len() * (size_of::<usize>() + size_of::<[u16; WIDTH]>())) as u64;
    let mut peak = within(splitting.max(collapsing).max(filling))?;
    reserve::exact(&mut tree.blocks, triangles.len(), "bvh")?;
    let block = |i: usize| {
        let next = [ids_of(i + 1), ids_of(i + 2)];
        simd::dispatch(isa, MakeBlock { geometry, triangles: ids_of(i), next })
    };
    (0..triangles.len()).into_par_iter().map(block).collect_into_vec(&mut tree.blocks);
    reserve::exact(&mut tree.wide, wide.len(), "bvh")?;
    let high_bits = wide.par_iter().map(|&i| block::high_bits(ids_of(i)));
    high_bits.collect_into_vec(&mut tree.wide);
    for (base, &i) in (0..).zip(&wide) {
        tree.blocks[i].base = base | WIDE;
    }
    reserve::exact(&mut tree.spheres, spheres.len(), "bvh")?;
    tree.spheres.extend(spheres.iter().map(|leaf| {
        let mut prims = [NONE; super::node::SPHERES];
        for (prim, &id) in prims.iter_mut().zip(&ids[leaf.range()]) {
            *prim = Group::from_bits(id).first() - geometry.bases()[geometry.spheres_id() as usize];
        }
        SphereLeaf(prims)
    }));
    tree.bounds = bounds;
    tree.is_large = tree.bytes() > MAX_UNPREFETCHED_BYTES;
    tree.closest_in_turns = tree.bytes() > MAX_BYTES_WITHOUT_TURNS;
    for shared in &geometry.shared {
        let left = max_bytes.map(|limit| limit.saturating_sub(tree.bytes()));
        let (below, below_peak) = build((shared, &Unseen::NONE), isa, left, monitor)?;
        peak = peak.max(tree.bytes() + below_peak);
        tree.shared.push(below);
    }
    Ok((tree, peak))
}

/// From this many references on, a distance between slots does not fit into a [`BinaryNode`], and
/// an index does not fit into a group.
const MAX_REFERENCES: u64 = 1 << 30;
