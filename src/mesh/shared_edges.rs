//! The edges of triangles without area, and which of these triangles share one. All is in flat
//! arrays: a file may consist of such triangles.

use std::ops::Range;

use super::places::edges;

/// The edges of triangles, numbered in the order in which the triangles have them.
pub struct SharedEdges {
    /// Places of the corners of each triangle.
    corners: Vec<[u32; 3]>,
    /// Sides of triangles by the lower place of their edge; of each, by the higher place. Side
    /// 3 i + k begins at corner k of triangle i.
    sides: Groups,
    /// Edges of each triangle.
    numbers: Vec<[u32; 3]>,
    /// The range of `sides` that has each edge.
    users: Vec<[u32; 2]>,
}

impl SharedEdges {
    /// Finds the edges of triangles with these `corners`, three different ones of `places` numbers.
    /// There must be fewer than 2^32 / 3 triangles.
    pub fn new(corners: Vec<[u32; 3]>, places: usize) -> Self {
        let edge = |side: u32| edge(&corners, side);
        let mut sides = Groups::new(3 * corners.len(), places, |side| edge(side)[0]);
        let mut numbers = vec![[0; 3]; corners.len()];
        let of_side = numbers.as_flattened_mut();
        for place in 0..places {
            let group = sides.of_mut(place);
            group.sort_unstable_by_key(|&side| (edge(side)[1], side));
            for same in group.chunk_by(|&a, &b| edge(a) == edge(b)) {
                same.iter().for_each(|&side| of_side[side as usize] = same[0]);
            }
        }
        // Each side has the first side with its edge, which now gets a number before the others.
        let mut count = 0;
        for side in 0..of_side.len() {
            let first = of_side[side] as usize;
            of_side[side] = if first == side { count } else { of_side[first] };
            count += u32::from(first == side);
        }
        let mut users = vec![[0; 2]; count as usize];
        let mut start = 0;
        for same in sides.items.chunk_by(|&a, &b| of_side[a as usize] == of_side[b as usize]) {
            let end = start + same.len() as u32;
            users[of_side[same[0] as usize] as usize] = [start, end];
            start = end;
        }
        Self { corners, sides, numbers, users }
    }

    /// Number of edges.
    pub fn count(&self) -> usize {
        self.users.len()
    }

    /// Number of triangles.
    pub fn triangles(&self) -> usize {
        self.numbers.len()
    }

    /// The edges of a triangle.
    pub fn of(&self, triangle: u32) -> [u32; 3] {
        self.numbers[triangle as usize]
    }

    /// The triangles that have an edge, in ascending order.
    pub fn users(&self, edge: u32) -> impl ExactSizeIterator<Item = u32> + '_ {
        let [start, end] = self.users[edge as usize];
        self.sides.items[start as usize..end as usize].iter().map(|side| side / 3)
    }

    /// The number of the edge between two places, the lower one first, if a triangle has it.
    pub fn number(&self, [low, high]: [u32; 2]) -> Option<u32> {
        let group = self.sides.of(low as usize);
        let end = |side: u32| edge(&self.corners, side)[1];
        let at = group.partition_point(|&side| end(side) < high);
        let side = group.get(at).filter(|&&side| end(side) == high)?;
        Some(self.numbers.as_flattened()[*side as usize])
    }
}

/// The edge of a side.
fn edge(corners: &[[u32; 3]], side: u32) -> [u32; 2] {
    edges(corners[(side / 3) as usize])[(side % 3) as usize]
}

/// Items 0, 1, 2 .. in groups.
pub struct Groups {
    /// The end of each group in `items`. It begins where the one before ends.
    ends: Vec<u32>,
    items: Vec<u32>,
}

impl Groups {
    /// Puts each of `items` items into one of `count` groups, in ascending order. `group` returns
    /// the group of an item. There must be fewer than 2^32 items.
    pub fn new(items: usize, count: usize, group: impl Fn(u32) -> u32) -> Self {
        let mut ends = vec![0u32; count];
        let mut all = vec![0; items];
        (0..items as u32).for_each(|item| ends[group(item) as usize] += 1);
        // Each number becomes the start of the group. Filling moves it to its end.
        let mut next = 0;
        for end in &mut ends {
            next += std::mem::replace(end, next);
        }
        for item in 0..items as u32 {
            let end = &mut ends[group(item) as usize];
            all[*end as usize] = item;
            *end += 1;
        }
        Self { ends, items: all }
    }

    fn range(&self, group: usize) -> Range<usize> {
        let start = group.checked_sub(1).map_or(0, |before| self.ends[before]);
        start as usize..self.ends[group] as usize
    }

    /// The items of a group.
    pub fn of(&self, group: usize) -> &[u32] {
        &self.items[self.range(group)]
    }

    /// The items of a group, to change their order.
    pub fn of_mut(&mut self, group: usize) -> &mut [u32] {
        let range = self.range(group);
        &mut self.items[range]
    }
}
