//! Which triangles without area are stitches: those that close a T-junction.

use std::collections::HashMap;

use glam::DVec3;

/// Returns the `candidates` that lie along an edge of a triangle, each with this triangle: the one
/// across its longest edge. If another candidate lies there, the search goes on across that one's
/// longest edge. `vertices` is the number of vertices, above every index. `position` returns the
/// place of a vertex, in any unit.
pub fn kept_stitches(
    candidates: &[[u32; 3]],
    triangles: &[[u32; 3]],
    vertices: usize,
    position: impl Fn(u32) -> DVec3,
) -> Vec<([u32; 3], u32)> {
    if candidates.is_empty() {
        return Vec::new();
    }
    let longest: Vec<[u32; 2]> = candidates.iter().map(|&c| longest_edge(c, &position)).collect();
    let mut marked = vec![false; vertices];
    // For each edge of a candidate, the first candidate that has this edge and a longer one.
    let mut longer: HashMap<[u32; 2], Option<usize>> = HashMap::new();
    for (index, &candidate) in candidates.iter().enumerate() {
        candidate.iter().for_each(|&v| marked[v as usize] = true);
        for edge in edges(candidate) {
            let first = longer.entry(edge).or_default();
            *first = first.or((edge != longest[index]).then_some(index));
        }
    }
    let mut at_edge: HashMap<[u32; 2], u32> = HashMap::new();
    for (prim, &triangle) in (0..).zip(triangles) {
        let both = |[a, b]: &[u32; 2]| marked[*a as usize] && marked[*b as usize];
        for edge in edges(triangle).into_iter().filter(both) {
            if longer.contains_key(&edge) {
                at_edge.entry(edge).or_insert(prim);
            }
        }
    }
    let next = |index: usize| longer[&longest[index]];
    let found = |index: usize| at_edge.get(&longest[index]).copied();
    let beside = candidates.iter().zip(follow(candidates.len(), found, next));
    beside.filter_map(|(candidate, beside)| Some((*candidate, beside?))).collect()
}

/// Returns the longest edge of a triangle, the first of equal ones.
fn longest_edge(triangle: [u32; 3], position: impl Fn(u32) -> DVec3) -> [u32; 2] {
    let squared_length = |[a, b]: [u32; 2]| position(a).distance_squared(position(b));
    let [a, b, c] = edges(triangle);
    let longer = |p, q| if squared_length(p) >= squared_length(q) { p } else { q };
    longer(longer(a, b), c)
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

/// The edges, each with its lower vertex first.
fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_edge_is_found_at_any_place() {
        let position = |v: u32| DVec3::new([0.0, 4.0, 1.0][v as usize], 2.0, 3.0);
        for stitch in [[0, 2, 1], [2, 1, 0], [1, 0, 2], [2, 0, 1]] {
            assert_eq!(longest_edge(stitch, position), [0, 1]);
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
