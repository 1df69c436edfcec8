//! Primitives -> groups, the units that the builder sorts.

use std::ops::Range;

use super::super::bounds::Bounds3;
use super::reference::Group;
use crate::geometry::{Geometry, GeometryKind, Unseen};

/// Two triangles form a pair if the area of their common box is at most this factor times the sum
/// of the areas of their own boxes.
const MAX_AREA: f64 = 1.25;

/// Returns the number of references that would be built without pairs: one per triangle and sphere,
/// two per quad. Primitives of `unseen` have none.
pub fn count(geometry: &Geometry, unseen: &Unseen) -> usize {
    let quads = geometry.quads_id() as usize;
    let seen = geometry.bases().windows(2).enumerate().map(|(geom, ends)| {
        let own = ends[0]..ends[1];
        let seen = (own.end - own.start - unseen.count(&own)) as usize;
        if geom == quads { 2 * seen } else { seen }
    });
    seen.sum()
}

/// Appends the groups of the primitives with scene-wide indices in `range` that are not in
/// `unseen`. Calls `add` with each group and its box.
#[inline(always)]
pub fn each(
    geometry: &Geometry,
    unseen: &Unseen,
    range: Range<u32>,
    mut add: impl FnMut(Group, Bounds3),
) {
    for (geom, ends) in geometry.bases().windows(2).enumerate() {
        let own = range.start.max(ends[0])..range.end.min(ends[1]);
        if own.is_empty() || unseen.has_all(&own) {
            continue;
        }
        let all_seen = unseen.count(&own) == 0;
        if let (GeometryKind::Mesh(mesh), true) = (geometry.kind(geom as u32), all_seen) {
            let mut last: Option<Bounds3> = None;
            for index in own.clone() {
                let corners = geometry.meshes[mesh].corners(index - ends[0]);
                let bounds = Bounds3::from_points(&corners);
                let Some(before) = last else {
                    last = Some(bounds);
                    continue;
                };
                let both = before.union(bounds);
                let apart = before.half_area() + bounds.half_area();
                if both.half_area() <= MAX_AREA * apart {
                    add(Group::pair(index - 1), both);
                    last = None;
                } else {
                    add(Group::one(index - 1), before);
                    last = Some(bounds);
                }
            }
            if let Some(bounds) = last {
                add(Group::one(own.end - 1), bounds);
            }
            continue;
        }
        for index in own.filter(|&index| all_seen || !unseen.has(index)) {
            let one = Group::one(index);
            add(one, one.bounds(geometry));
            if geom as u32 == geometry.quads_id() {
                let second = Group::second_half(index);
                add(second, second.bounds(geometry));
            }
        }
    }
}
