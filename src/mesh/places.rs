//! Corners of triangles by position: vertices at the same place are one corner.

use std::collections::HashMap;

use glam::DVec3;

use crate::parallel;

/// The places of the corners of a few triangles, numbered from 0.
pub struct Places<P> {
    numbers: HashMap<[u64; 3], u32>,
    /// For each vertex of the mesh, whether it is at one of the places.
    marked: Vec<bool>,
    position: P,
}

impl<P: Fn(u32) -> DVec3 + Sync> Places<P> {
    /// Numbers the corners of `triangles`. `vertices` is the number of vertices, above every index.
    /// `position` returns the place of a vertex, in any unit.
    pub fn new(triangles: &[[u32; 3]], vertices: usize, position: P) -> Self {
        let mut numbers = HashMap::new();
        for &vertex in triangles.iter().flatten() {
            let next = numbers.len() as u32;
            numbers.entry(position_key(position(vertex))).or_insert(next);
        }
        let is_marked = |v| numbers.contains_key(&position_key(position(v as u32)));
        let marked = parallel::values(vertices, is_marked);
        Self { numbers, marked, position }
    }

    /// The numbers of the places of a triangle's corners. It must be one of those of [`Self::new`].
    pub fn of(&self, triangle: [u32; 3]) -> [u32; 3] {
        triangle.map(|v| self.numbers[&position_key((self.position)(v))])
    }

    /// The places of any triangle's corners, equal for triangles with the same places.
    pub fn key(&self, triangle: [u32; 3]) -> [[u64; 3]; 3] {
        let mut corners = triangle.map(|v| position_key((self.position)(v)));
        corners.sort_unstable();
        corners
    }

    /// The edges of any triangle whose ends are both at known places.
    pub fn edges(&self, triangle: [u32; 3]) -> impl Iterator<Item = [u32; 2]> + '_ {
        let marked = triangle.map(|v| self.marked[v as usize]);
        let two = marked.iter().filter(|&&marked| marked).count() >= 2;
        let number = |v: u32| self.numbers.get(&position_key((self.position)(v))).copied();
        let corners = if two { triangle.map(number) } else { [None; 3] };
        let [a, b, c] = corners;
        let edge = |(p, q): (Option<u32>, Option<u32>)| Some(ordered([p?, q?]));
        [(a, b), (b, c), (c, a)].into_iter().filter_map(edge)
    }
}

/// Returns numbers that are equal for equal positions, -0 and 0 included.
pub fn position_key(position: DVec3) -> [u64; 3] {
    // Adding 0 turns -0 into 0.
    position.to_array().map(|x| (x + 0.0).to_bits())
}

/// The edges of a triangle, each with its lower end first.
pub fn edges([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(ordered)
}

fn ordered([p, q]: [u32; 2]) -> [u32; 2] {
    [p.min(q), p.max(q)]
}
