//! Builds the tree: primitives -> references -> binary tree by binned SAH -> wide nodes and leaves.

mod binary;
mod block;
mod collapse;
mod reference;
mod sah;

pub use self::collapse::Tree;

use rayon::prelude::*;

use self::binary::Leaf;
use self::block::MakeBlock;
use super::bounds::Bounds3;
use super::node::{Block, Child, SphereLeaf};
use crate::accel::accelerator::over_limit;
use crate::error::{Error, Kind, Problem, Result};
use crate::geometry::{Geometry, Unseen};
use crate::monitor::Monitor;
use crate::ray::NONE;
use crate::reserve;
use crate::simd::{self, Isa, Kernel};

/// Trees of more bytes are prefetched during traversal. The effect is in docs/notebook/bvh.md.
const MAX_UNPREFETCHED_BYTES: u64 = 64 << 20;

/// Builds the tree without the primitives of `unseen`, on the current rayon pool. Also returns the
/// most bytes that the build held at a time.
///
/// # Errors
/// - `Interrupted` after a signal.
/// - `Limit` if the build needs more than `max_bytes`, or the tree has more leaves than an index
///   can address.
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
    let count = reference::count(geometry, unseen);
    within((count * size_of::<reference::Reference>()) as u64)?;
    let mut references = simd::dispatch(isa, References(geometry, unseen))?;
    // The nodes are allocated in many small pieces, so the memory for all of them is probed in
    // advance.
    reserve::probe(binary::SCRATCH_BYTES * count as u64, "bvh")?;
    monitor.check()?;
    let mut nodes = binary::build(geometry, &mut references, isa, monitor)?;
    monitor.check()?;
    let leaves = binary::number_leaves(&mut nodes)?;
    if leaves.len() >= Child::MAX_INDEX {
        let message = format!("found {} leaves, expected fewer than 2^30", leaves.len());
        return Err(Error::new(Kind::Limit, Problem::new("bvh", message)));
    }
    let sorted = (size_of_val(&references[..]) + size_of_val(&leaves[..])) as u64;
    let mut tree = collapse::collapse(&nodes)?;
    let collapsing = sorted + collapse::scratch_bytes(&nodes) + tree.bytes();
    drop(nodes);
    let of_spheres = leaves.iter().filter(|leaf| leaf.spheres).count();
    let (mut triangles, mut spheres) = (Vec::<&Leaf>::new(), Vec::<&Leaf>::new());
    reserve::exact(&mut triangles, leaves.len() - of_spheres, "bvh")?;
    reserve::exact(&mut spheres, of_spheres, "bvh")?;
    for leaf in &leaves {
        if leaf.spheres { &mut spheres } else { &mut triangles }.push(leaf);
    }
    let filling = sorted
        + tree.bytes()
        + (triangles.len() * size_of::<Block>() + leaves.len() * size_of::<&Leaf>()) as u64;
    let peak = within(collapsing.max(filling))?;
    let leaf_references =
        |i: usize| triangles.get(i).map_or(&[][..], |leaf| &references[leaf.range()]);
    reserve::exact(&mut tree.blocks, triangles.len(), "bvh")?;
    let block = |i: usize| {
        let next = [leaf_references(i + 1), leaf_references(i + 2)];
        simd::dispatch(isa, MakeBlock { geometry, references: leaf_references(i), next })
    };
    (0..triangles.len()).into_par_iter().map(block).collect_into_vec(&mut tree.blocks);
    reserve::exact(&mut tree.spheres, spheres.len(), "bvh")?;
    tree.spheres.extend(spheres.iter().map(|leaf| {
        let mut ids = [NONE; super::node::SPHERES];
        for (id, reference) in ids.iter_mut().zip(&references[leaf.range()]) {
            *id = reference.primitive();
        }
        SphereLeaf(ids)
    }));
    tree.bounds = references.par_iter().map(|r| r.bounds).reduce(|| Bounds3::EMPTY, Bounds3::union);
    tree.is_large = tree.bytes() > MAX_UNPREFETCHED_BYTES;
    Ok((tree, peak))
}

struct References<'g>(&'g Geometry, &'g Unseen);

impl Kernel for References<'_> {
    type Output = Result<Vec<reference::Reference>>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        reference::references(self.0, self.1)
    }
}
