//! Which triangles beside an edge are stitches in a picture, and whose surface they continue.

use glam::DVec3;

use super::places::{NONE, Places};
use super::shared_edges::SharedEdges;

/// Returns the `candidates` that lie along an edge of a triangle, each with this triangle: the one
/// across its longest edge. If another candidate lies there, the search goes on across that one's
/// longest edge. Vertices at the same place are one vertex. `vertices` is the number of vertices,
/// above every index. `position` returns the place of a vertex, in any unit.
pub fn kept_stitches(
    candidates: &[[u32; 3]],
    triangles: &[[u32; 3]],
    vertices: usize,
    position: impl Fn(u32) -> DVec3 + Sync,
) -> Vec<([u32; 3], u32)> {
    if candidates.is_empty() {
        return Vec::new();
    }
    let places = Places::new(candidates, vertices, &position);
    let corners = candidates.iter().map(|&candidate| places.of(candidate)).collect();
    let shared = SharedEdges::new(corners, places.count());
    let own = |index: usize| shared.of(index as u32);
    let longest = |index: usize| {
        let corners = candidates[index].map(&position);
        own(index)[longest_edge(corners)] as usize
    };
    // For each edge of a candidate, the first candidate that has this edge and a longer one.
    let mut longer = vec![NONE; shared.count()];
    for index in 0..candidates.len() {
        let longest = longest(index);
        for edge in own(index).map(|edge| edge as usize) {
            if edge != longest && longer[edge] == NONE {
                longer[edge] = index as u32;
            }
        }
    }
    let mut at_edge = vec![NONE; shared.count()];
    for (prim, &triangle) in (0..).zip(triangles) {
        for edge in places.edges(triangle).filter_map(|edge| shared.number(edge)) {
            let first = &mut at_edge[edge as usize];
            *first = prim.min(*first);
        }
    }
    let known = |number: u32| (number != NONE).then_some(number);
    let next = |index: usize| known(longer[longest(index)]).map(|next| next as usize);
    let found = |index: usize| known(at_edge[longest(index)]);
    let beside = candidates.iter().zip(follow(candidates.len(), found, next));
    beside.filter_map(|(candidate, beside)| Some((*candidate, beside?))).collect()
}

/// Returns which edge of a triangle is the longest, the first of equal ones.
fn longest_edge([a, b, c]: [DVec3; 3]) -> usize {
    let squared = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
    let longer = |p: usize, q: usize| if squared[p] >= squared[q] { p } else { q };
    longer(longer(0, 1), 2)
}

/// Follows the chain of `next` from each of `count` indices. Returns for each the first `found`
/// value. Each index is visited once.
fn follow(
    count: usize,
    found: impl Fn(usize) -> Option<u32>,
    next: impl Fn(usize) -> Option<usize>,
) -> Vec<Option<u32>> {
    let mut results: Vec<Option<Option<u32>>> = vec![None; count];
    let mut path = Vec::new();
    for start in 0..count {
        let mut at = Some(start);
        let result = loop {
            let Some(index) = at else { break None };
            if let Some(known) = results[index] {
                break known;
            }
            // A chain that returns to itself finds nothing.
            results[index] = Some(None);
            path.push(index);
            if let Some(prim) = found(index) {
                break Some(prim);
            }
            at = next(index);
        };
        path.drain(..).for_each(|index| results[index] = Some(result));
    }
    results.into_iter().map(Option::flatten).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_edge_is_found_at_any_place() {
        let position = |v: u32| DVec3::new([0.0, 4.0, 1.0][v as usize], 2.0, 3.0);
        for (stitch, longest) in [([0, 2, 1], 2), ([2, 1, 0], 1), ([1, 0, 2], 0), ([2, 0, 1], 1)] {
            assert_eq!(longest_edge(stitch.map(position)), longest);
        }
    }

    #[test]
    fn a_chain_finds_the_first_value_and_a_circle_finds_nothing() {
        // 0 to 1 to 2, which has a value. 3 and 4 are a circle, 5 leads to nothing.
        let next = [Some(1), Some(2), None, Some(4), Some(3), None];
        let found = follow(6, |index| (index == 2).then_some(7), |index| next[index]);
        assert_eq!(found, [Some(7), Some(7), Some(7), None, None, None]);
    }
}
