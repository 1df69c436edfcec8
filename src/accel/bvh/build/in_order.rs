//! Makes references in the order of the primitives' indices: where no grid of [`super::cells`]
//! sorts them, in small scenes and in those without finite bounds.

use std::ops::Range;

use super::super::bounds::Bounds3;
use super::groups::{self, Collect};
use super::reference::{Group, Reference};
use crate::error::Result;
use crate::geometry::{Geometry, Unseen};
use crate::parallel;
use crate::reserve;
use crate::simd::{self, Isa, Kernel};

/// Makes the references of all primitives that are not in `unseen`. `ranges` are consecutive and
/// cover the indices of all primitives; each is the work of one task. If `pairs`, two consecutive
/// triangles of one range may share a reference.
///
/// # Errors
/// `Retry` if there is too little memory. It is tried out before any reference is made.
pub fn references(
    (geometry, unseen): (&Geometry, &Unseen),
    ranges: impl ExactSizeIterator<Item = Range<u32>> + Send,
    pairs: bool,
    isa: Isa,
) -> Result<Vec<Reference>> {
    // Twice: a reference is made in the array of its task, and then copied into the result.
    let most = 2 * groups::count(geometry, unseen) * size_of::<Reference>();
    reserve::probe(most as u64, "bvh")?;
    let make = |range| simd::dispatch(isa, MakeReferences { geometry, unseen, range, pairs });
    let chunks = parallel::map(ranges, make);
    let mut references = Vec::new();
    reserve::exact(&mut references, chunks.iter().map(Vec::len).sum(), "bvh")?;
    for chunk in chunks {
        references.extend(chunk);
    }
    Ok(references)
}

/// Makes the references of the primitives in `range`, in their order.
struct MakeReferences<'a> {
    geometry: &'a Geometry,
    unseen: &'a Unseen,
    range: Range<u32>,
    /// Whether triangles may form pairs.
    pairs: bool,
}

impl Kernel for MakeReferences<'_> {
    type Output = Vec<Reference>;
    #[inline(always)]
    fn run(self) -> Vec<Reference> {
        let Self { geometry, unseen, range, pairs } = self;
        let references = Vec::with_capacity((range.end - range.start) as usize);
        let mut pushed = PushReferences { geometry, references };
        groups::each((geometry, unseen), range, pairs, &mut pushed);
        pushed.references
    }
}

struct PushReferences<'a> {
    geometry: &'a Geometry,
    references: Vec<Reference>,
}

impl Collect for PushReferences<'_> {
    #[inline(always)]
    fn add(&mut self, group: Group, bounds: Bounds3) {
        self.references.push(Reference::in_box(bounds, group, self.geometry));
    }
}
