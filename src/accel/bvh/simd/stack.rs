//! Nodes yet to visit, without clearing memory for every ray.

use std::mem::MaybeUninit;

use crate::accel::bvh::node::{Child, WIDTH};

/// Levels of the tree: the builder makes no more.
pub const MAX_DEPTH: usize = 64;

/// A level leaves at most 15 children behind; a push writes 16 lanes.
pub const CAPACITY: usize = MAX_DEPTH * (WIDTH - 1) + 2 * WIDTH;

/// Children and the distances of their boxes.
pub struct Stack {
    children: [MaybeUninit<Child>; CAPACITY],
    distances: [MaybeUninit<f32>; CAPACITY],
    /// Entries, all of them written.
    len: usize,
}

impl Stack {
    /// An empty stack.
    #[inline(always)]
    pub fn new() -> Self {
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

    /// The last entry.
    #[inline(always)]
    pub fn last(&self) -> Option<Child> {
        let i = self.len.checked_sub(1)?;
        // SAFETY: every entry below `len` was written, and `len` is within the arrays.
        Some(unsafe { self.children.get_unchecked(i).assume_init() })
    }

    /// Takes the last entry.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<(Child, f32)> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: every entry below `len` was written, and `len` is within the arrays.
        unsafe {
            Some((
                self.children.get_unchecked(self.len).assume_init(),
                self.distances.get_unchecked(self.len).assume_init(),
            ))
        }
    }

    /// Where the next 16 entries go.
    ///
    /// # Panics
    /// If the tree is deeper than [`MAX_DEPTH`].
    #[inline(always)]
    pub fn room(&mut self) -> (*mut Child, *mut f32) {
        assert!(self.len <= CAPACITY - WIDTH);
        (
            self.children[self.len..].as_mut_ptr().cast(),
            self.distances[self.len..].as_mut_ptr().cast(),
        )
    }

    /// Counts entries that were written to [`Self::room`].
    ///
    /// # Safety
    /// The first `n <= 16` entries there were written.
    #[inline(always)]
    pub unsafe fn grow(&mut self, n: usize) {
        self.len += n;
    }
}

/// Nodes on the way to where a traversal is, each with the children that are yet to visit.
pub struct Path {
    steps: [MaybeUninit<(u32, u32)>; MAX_DEPTH],
    /// Steps, all of them written.
    len: usize,
}

impl Path {
    /// At the root.
    #[inline(always)]
    pub fn new() -> Self {
        Self { steps: [const { MaybeUninit::uninit() }; MAX_DEPTH], len: 0 }
    }

    /// Adds a node and its children yet to visit, by bit.
    ///
    /// # Panics
    /// If the tree is deeper than [`MAX_DEPTH`].
    #[inline(always)]
    pub fn push(&mut self, node: usize, children: u32) {
        self.steps[self.len].write((node as u32, children));
        self.len += 1;
    }

    /// Takes the last node.
    #[inline(always)]
    pub fn pop(&mut self) -> Option<(usize, u32)> {
        self.len = self.len.checked_sub(1)?;
        // SAFETY: every step below `len` was written, and `len` is within the array.
        let (node, children) = unsafe { self.steps.get_unchecked(self.len).assume_init() };
        Some((node as usize, children))
    }

    /// Forgets all steps.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.len = 0;
    }
}
