//! Primitives -> groups, the units that the builder sorts.

use std::ops::Range;

use super::super::bounds::Bounds3;
use super::reference::Group;
use crate::geometry::{Geometry, GeometryKind, TriangleMesh, Unseen};

/// Two consecutive triangles form a pair if the area of their common box is at most this factor
/// times the sum of the areas of their own boxes.
const MAX_AREA: f64 = 1.25;

/// Returns the number of primitives that the tree sorts. An instance counts as one. Its index is
/// the number of primitives before it.
pub fn sorted_count(geometry: &Geometry) -> u64 {
    u64::from(geometry.own_count()) + geometry.instances.len() as u64
}

/// Returns the number of references that would be built without pairs: one per triangle, sphere and
/// instance, two per quad. Primitives of `unseen` have none.
pub fn count(geometry: &Geometry, unseen: &Unseen) -> usize {
    let (quads, spheres) = (geometry.quads_id() as usize, geometry.spheres_id() as usize);
    let seen = geometry.bases().windows(2).enumerate().map(|(geom, ends)| {
        let own = ends[0]..ends[1];
        if geom > spheres {
            return usize::from(!unseen.has_all(&own));
        }
        let seen = (own.end - own.start - unseen.count(&own)) as usize;
        if geom == quads { 2 * seen } else { seen }
    });
    seen.sum()
}

/// What takes groups. Not a closure: called from several places, it is not inlined into the
/// kernel, whose instruction set it would then lack.
pub trait Collect {
    /// Takes a group and its box.
    fn add(&mut self, group: Group, bounds: Bounds3);
}

/// Gives `found` each group, and its box, of the primitives with indices in `range` that are not in
/// `unseen`. The indices are scene-wide, those of instances as in [`sorted_count`]. A mesh forms
/// pairs if `may_pair`, and if `unseen` has none of its triangles in `range`.
#[inline(always)]
pub fn each(
    (geometry, unseen): (&Geometry, &Unseen),
    range: Range<u32>,
    may_pair: bool,
    found: &mut impl Collect,
) {
    let own_geometries = geometry.spheres_id() as usize + 1;
    for (geom, ends) in geometry.bases().windows(2).enumerate().take(own_geometries) {
        let own = range.start.max(ends[0])..range.end.min(ends[1]);
        if own.is_empty() || unseen.has_all(&own) {
            continue;
        }
        let all_seen = unseen.count(&own) == 0;
        let may_pair = may_pair && all_seen;
        if let (GeometryKind::Mesh(mesh), true) = (geometry.kind(geom as u32), may_pair) {
            pairs(&geometry.meshes[mesh], ends[0], own, found);
            continue;
        }
        for index in own.filter(|&index| all_seen || !unseen.has(index)) {
            let one = Group::one(index);
            found.add(one, one.bounds(geometry));
            if geom as u32 == geometry.quads_id() {
                let second = Group::second_half(index);
                found.add(second, second.bounds(geometry));
            }
        }
    }
    for index in range.start.max(geometry.own_count())..range.end {
        let instance = geometry.instance_id((index - geometry.own_count()) as usize) as usize;
        let triangles = geometry.bases()[instance]..geometry.bases()[instance + 1];
        if !unseen.has_all(&triangles) {
            let one = Group::one(index);
            found.add(one, one.bounds(geometry));
        }
    }
}

/// Gives `found` the groups of consecutive triangles of a mesh, whose first triangle has index
/// `base`. A triangle forms a pair with the next one if that is possible.
#[inline(always)]
fn pairs(mesh: &TriangleMesh, base: u32, own: Range<u32>, found: &mut impl Collect) {
    let end = own.end;
    let mut single: Option<Bounds3> = None;
    for index in own {
        let bounds = Bounds3::from_points(&mesh.corners(index - base));
        let Some(before) = single.replace(bounds) else { continue };
        let both = before.union(bounds);
        if both.half_area() <= MAX_AREA * (before.half_area() + bounds.half_area()) {
            found.add(Group::pair(index - 1), both);
            single = None;
        } else {
            found.add(Group::one(index - 1), before);
        }
    }
    if let Some(bounds) = single {
        found.add(Group::one(end - 1), bounds);
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::geometry::Sphere;

    /// Two meshes of `n` triangles each along x, a quad and a sphere. Triangles 2 k and 2 k + 1 of
    /// a mesh share an edge; the next two are far away.
    fn scene(n: u32) -> Geometry {
        let strip = || {
            let corner =
                |i: u32, k: u32| [(i / 2 * 10) as f32 + (k & 1) as f32, (k >> 1) as f32, 0.0];
            let vertices = (0..n).step_by(2).flat_map(|i| (0..4).map(move |k| corner(i, k)));
            let triangle = |i: u32| [0, 1, 2].map(|k| i / 2 * 4 + i % 2 + k);
            TriangleMesh::new(vertices.collect(), (0..n).map(triangle).collect(), false)
        };
        let quad = [[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let sphere = Sphere { center: DVec3::ZERO, radius: 1.0 };
        Geometry::new(DVec3::ZERO, vec![strip(), strip()], vec![quad], vec![sphere]).expect("few")
    }

    impl Collect for Vec<(Group, Bounds3)> {
        fn add(&mut self, group: Group, bounds: Bounds3) {
            self.push((group, bounds));
        }
    }

    fn found(geometry: &Geometry, unseen: &Unseen, range: Range<u32>) -> Vec<Group> {
        let mut found = Vec::new();
        each((geometry, unseen), range, true, &mut found);
        let check = |(group, bounds): (Group, Bounds3)| {
            assert_eq!(bounds.0, group.bounds(geometry).0);
            group
        };
        found.into_iter().map(check).collect()
    }

    #[test]
    fn neighbours_of_one_mesh_that_lie_together_are_pairs() {
        let geometry = scene(4);
        let pairs = [0, 2, 4, 6].map(Group::pair);
        let others = [Group::one(8), Group::second_half(8), Group::one(9)];
        assert_eq!(found(&geometry, &Unseen::NONE, 0..10), [&pairs[..], &others].concat());
        assert_eq!(count(&geometry, &Unseen::NONE), 11);
        // A range that begins with the second triangle of a pair finds no pair across the gap.
        assert_eq!(
            found(&geometry, &Unseen::NONE, 1..5),
            [Group::one(1), Group::pair(2), Group::one(4)]
        );
    }

    #[test]
    fn a_mesh_that_is_partly_hidden_has_no_pairs() {
        let geometry = scene(2);
        let mut unseen = Unseen::NONE;
        unseen.push(1..2);
        let groups = [Group::one(0), Group::pair(2), Group::one(4), Group::second_half(4)];
        assert_eq!(found(&geometry, &unseen, 0..5), groups);
        assert_eq!(count(&geometry, &unseen), 6);
    }
}
