//! The stacks of children that are still to be visited. Their memory is not initialised, which
//! would take time for every ray.

use std::mem::MaybeUninit;

use crate::accel::bvh::node::{Child, WIDTH};
use crate::ray::LANES;

/// Maximum number of levels of inner nodes. The builder never exceeds it.
pub const MAX_DEPTH: usize = 64;

/// Size of the stack: a level adds at most 15 children, and a push writes 16 lanes.
pub const CAPACITY: usize = MAX_DEPTH * (WIDTH - 1) + 2 * WIDTH;

/// A stack of children and the distances of their boxes.
pub struct Stack {
    children: [MaybeUninit<Child>; CAPACITY],
    distances: [MaybeUninit<f32>; CAPACITY],
    /// Number of entries. All of them are initialised.
    len: usize,
}

impl Stack {
    #[inline(always)]
    pub const fn new() -> Self {
        Self {
            children: [const { MaybeUninit::uninit() }; CAPACITY],
            distances: [const { MaybeUninit::uninit() }; CAPACITY],
            len: 0,
        }
    }

    /// Adds an entry.
    ///
    /// # Panics
    /// If the tree is deeper than [`MAX_DEPTH`].
    #[inline(always)]
    pub fn push(&mut self, child: Child, distance: f32) {
        self.children[self.len].write(child);
        self.distances[self.len].write(distance);
        self.len += 1;
    }

    /// Returns the last entry.
    #[inline(always)]
    pub fn last(&self) -> Option<Child> {
        let i = self.len.checked_sub(1)?;
        // SAFETY: every entry below `len` is initialised, and `len` is within the arrays.
        Some(unsafe { self.children.get_unchecked(i).assume_init() })
    }

    /// Removes and returns the last entry.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<(Child, f32)> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: every entry below `len` is initialised, and `len` is within the arrays.
        unsafe {
            Some((
                self.children.get_unchecked(self.len).assume_init(),
                self.distances.get_unchecked(self.len).assume_init(),
            ))
        }
    }

    /// Returns where to write the next 16 entries.
    ///
    /// # Panics
    /// If the tree is deeper than [`MAX_DEPTH`].
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn room(&mut self) -> (*mut Child, *mut f32) {
        assert!(self.len <= CAPACITY - WIDTH);
        (
            self.children[self.len..].as_mut_ptr().cast(),
            self.distances[self.len..].as_mut_ptr().cast(),
        )
    }

    /// Adds `n` entries that were written to [`Self::room`].
    ///
    /// # Safety
    /// The first `n <= 16` entries there must be initialised.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub unsafe fn grow(&mut self, n: usize) {
        self.len += n;
    }
}

/// The stack of an any-hit traversal by one ray: the nodes above the current node that have
/// children still to be visited, with these children as bits.
pub struct Path {
    steps: [MaybeUninit<(u32, u32)>; MAX_DEPTH],
    /// Number of steps. All of them are initialised.
    len: usize,
}

impl Path {
    #[inline(always)]
    pub const fn new() -> Self {
        Self { steps: [const { MaybeUninit::uninit() }; MAX_DEPTH], len: 0 }
    }

    /// Adds a node and its children that are still to be visited, as bits.
    ///
    /// # Panics
    /// If the tree is deeper than [`MAX_DEPTH`].
    #[inline(always)]
    pub fn push(&mut self, node: usize, children: u32) {
        self.steps[self.len].write((node as u32, children));
        self.len += 1;
    }

    /// Removes and returns the last node.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<(usize, u32)> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: every step below `len` is initialised, and `len` is within the array.
        let (node, children) = unsafe { self.steps.get_unchecked(self.len).assume_init() };
        Some((node as usize, children))
    }

    /// Removes all steps, for the next ray.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.len = 0;
    }
}

/// A [`Path`] for each ray of a packet.
pub struct Paths {
    steps: [[MaybeUninit<(u32, u32)>; MAX_DEPTH]; LANES],
    /// Number of steps of each ray. All of them are initialised.
    lengths: [u32; LANES],
}

impl Paths {
    #[inline(always)]
    pub fn new() -> Self {
        let steps = [const { [const { MaybeUninit::uninit() }; MAX_DEPTH] }; LANES];
        Self { steps, lengths: [0; LANES] }
    }

    /// Adds a node and its children that are still to be visited, as bits, to the path of ray `i`.
    ///
    /// # Panics
    /// If the tree is deeper than [`MAX_DEPTH`].
    #[inline(always)]
    pub fn push(&mut self, i: usize, node: u32, children: u32) {
        self.steps[i][self.lengths[i] as usize].write((node, children));
        self.lengths[i] += 1;
    }

    /// Removes and returns the last node of ray `i`.
    #[inline(always)]
    pub fn pop(&mut self, i: usize) -> Option<(u32, u32)> {
        self.lengths[i] = self.lengths[i].checked_sub(1)?;
        // SAFETY: every step below `lengths[i]` is initialised, and within the array.
        Some(unsafe { self.steps[i].get_unchecked(self.lengths[i] as usize).assume_init() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_popped_in_reverse_up_to_the_capacity() {
        let mut stack = Stack::new();
        assert!(stack.last().is_none() && stack.pop().is_none());
        for i in 0..CAPACITY {
            stack.push(Child::node(i), i as f32);
            assert_eq!(stack.last(), Some(Child::node(i)));
        }
        for i in (0..CAPACITY).rev() {
            assert_eq!(stack.pop(), Some((Child::node(i), i as f32)));
        }
        assert!(stack.last().is_none() && stack.pop().is_none());
    }

    /// The vector kernels write 16 entries, also where fewer count.
    #[cfg(target_arch = "x86_64")]
    #[test]
    fn entries_that_were_written_in_place_are_popped() {
        let mut stack = Stack::new();
        stack.push(Child::node(7), 7.0);
        for n in [3, 0, 16] {
            let (children, distances) = stack.room();
            for i in 0..WIDTH {
                // SAFETY: there is room for 16 entries, and all of them are written.
                unsafe {
                    children.add(i).write(Child::node(i));
                    distances.add(i).write(i as f32);
                }
            }
            // SAFETY: as above.
            unsafe { stack.grow(n) };
            for i in (0..n).rev() {
                assert_eq!(stack.pop(), Some((Child::node(i), i as f32)));
            }
        }
        assert_eq!(stack.pop(), Some((Child::node(7), 7.0)));
        assert!(stack.pop().is_none());
    }

    #[test]
    fn steps_of_a_path_are_popped_in_reverse() {
        let mut path = Path::new();
        for i in 0..MAX_DEPTH {
            path.push(i, !(i as u32));
        }
        for i in (0..MAX_DEPTH).rev() {
            assert_eq!(path.pop(), Some((i, !(i as u32))));
        }
        path.push(1, 2);
        path.clear();
        assert!(path.pop().is_none());
    }

    #[test]
    fn the_paths_of_rays_are_separate() {
        let mut paths = Paths::new();
        for step in 0..MAX_DEPTH as u32 {
            for i in 0..LANES {
                paths.push(i, step, i as u32);
            }
        }
        for i in 0..LANES {
            for step in (0..MAX_DEPTH as u32).rev() {
                assert_eq!(paths.pop(i), Some((step, i as u32)));
            }
            assert!(paths.pop(i).is_none());
        }
    }
}
