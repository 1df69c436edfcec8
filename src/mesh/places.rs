//! Corners of triangles by position: vertices at the same place are one corner.

use std::hash::{BuildHasher, RandomState};

use glam::DVec3;

use crate::parallel::{self, GRAIN};

/// In place of a number: there is none.
pub const NONE: u32 = u32::MAX;

/// The places of the corners of a few triangles, numbered from 0.
pub struct Places<P> {
    /// For each vertex of the mesh, the number of its place, or [`NONE`].
    numbers: Vec<u32>,
    count: usize,
    position: P,
}

impl<P: Fn(u32) -> DVec3 + Sync> Places<P> {
    /// Numbers the corners of `triangles`. `vertices` is the number of vertices, above every index.
    /// `position` returns the place of a vertex, in any unit.
    pub fn new(triangles: &[[u32; 3]], vertices: usize, position: P) -> Self {
        let mut numbers = vec![NONE; vertices];
        let mut table = Table::new(vertices.min(3 * triangles.len()), &position);
        for &vertex in triangles.as_flattened() {
            let number = &mut numbers[vertex as usize];
            if *number == NONE {
                *number = table.number(vertex);
            }
        }
        parallel::each(numbers.chunks_mut(GRAIN).enumerate(), |(part, numbers)| {
            for (number, vertex) in numbers.iter_mut().zip(part * GRAIN..) {
                if *number == NONE {
                    *number = table.known(vertex as u32);
                }
            }
        });
        let count = table.firsts.len();
        Self { numbers, count, position }
    }

    /// Number of places.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The numbers of the places of a triangle's corners. It must be one of those of [`Self::new`].
    pub fn of(&self, triangle: [u32; 3]) -> [u32; 3] {
        triangle.map(|v| self.numbers[v as usize])
    }

    /// The places of any triangle's corners, equal for triangles with the same places.
    pub fn key(&self, triangle: [u32; 3]) -> [[u64; 3]; 3] {
        let mut corners = triangle.map(|v| position_key((self.position)(v)));
        corners.sort_unstable();
        corners
    }

    /// The edges of any triangle whose ends are both at known places.
    pub fn edges(&self, triangle: [u32; 3]) -> impl Iterator<Item = [u32; 2]> + '_ {
        edges(self.of(triangle)).into_iter().filter(|edge| edge[1] != NONE)
    }
}

/// A hash table of places. It has an index a place; a map would have the place itself.
struct Table<'a, P> {
    /// Numbers of places, or [`NONE`]. At most half of them are taken, so a search ends soon.
    slots: Vec<u32>,
    /// A vertex at each place.
    firsts: Vec<u32>,
    hasher: RandomState,
    position: &'a P,
}

impl<'a, P: Fn(u32) -> DVec3> Table<'a, P> {
    /// A table for at most `count` places.
    fn new(count: usize, position: &'a P) -> Self {
        let slots = vec![NONE; (2 * count).next_power_of_two()];
        Self { slots, firsts: Vec::new(), hasher: RandomState::new(), position }
    }

    fn key(&self, vertex: u32) -> [u64; 3] {
        position_key((self.position)(vertex))
    }

    /// Returns the slot of a vertex's place, or the free one where it belongs.
    fn slot(&self, vertex: u32) -> usize {
        let key = self.key(vertex);
        let last = self.slots.len() - 1;
        let mut slot = self.hasher.hash_one(key) as usize & last;
        let other = |number: u32| self.key(self.firsts[number as usize]) != key;
        while self.slots[slot] != NONE && other(self.slots[slot]) {
            slot = (slot + 1) & last;
        }
        slot
    }

    /// Returns the number of a vertex's place, or [`NONE`].
    fn known(&self, vertex: u32) -> u32 {
        self.slots[self.slot(vertex)]
    }

    /// Returns the number of a vertex's place, the next one if it is new.
    fn number(&mut self, vertex: u32) -> u32 {
        let slot = self.slot(vertex);
        if self.slots[slot] == NONE {
            self.slots[slot] = self.firsts.len() as u32;
            self.firsts.push(vertex);
        }
        self.slots[slot]
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
