//! Orders the workers of a batch. Meshes are read in the order of the run, while there is memory
//! for the next one. A limited number of frames is rendered at a time, and frames of earlier meshes
//! come first.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, PoisonError};

use crate::threads::lock;

/// Admits meshes in the order of their indices, within a limit of memory.
#[derive(Debug)]
pub struct MemoryGate {
    limit: u64,
    state: Mutex<Admitted>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Admitted {
    /// Index of the mesh that enters next.
    next: usize,
    meshes: usize,
    bytes: u64,
}

impl Admitted {
    /// Returns whether the mesh with index `number` has to wait.
    fn keeps_out(&self, number: usize, bytes: u64, limit: u64) -> bool {
        let fits = self.bytes.saturating_add(bytes) <= limit;
        self.next != number || self.meshes > 0 && !fits
    }
}

/// Memory reserved for a mesh until this guard is dropped.
#[derive(Debug)]
pub struct Reservation<'a> {
    memory: &'a MemoryGate,
    bytes: u64,
    /// Bytes of the limit that were free when this mesh entered, its own bytes included.
    pub share: u64,
}

impl MemoryGate {
    /// Creates a gate for `limit` bytes. A single mesh inside may exceed the limit.
    pub fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default(), changed: Condvar::new() }
    }

    /// Waits for the turn of the mesh with index `number`. Then waits until `bytes` are free or no
    /// other mesh is inside.
    ///
    /// Each index, counted from 0, must enter exactly once.
    pub fn enter(&self, number: usize, bytes: u64) -> Reservation<'_> {
        let waits = |s: &mut Admitted| s.keeps_out(number, bytes, self.limit);
        let waited = self.changed.wait_while(lock(&self.state), waits);
        let mut inside = waited.unwrap_or_else(PoisonError::into_inner);
        let share = self.limit.saturating_sub(inside.bytes);
        inside.next += 1;
        inside.meshes += 1;
        inside.bytes = inside.bytes.saturating_add(bytes);
        self.changed.notify_all();
        Reservation { memory: self, bytes, share }
    }
}

impl Drop for Reservation<'_> {
    fn drop(&mut self) {
        let mut inside = lock(&self.memory.state);
        inside.meshes -= 1;
        inside.bytes -= self.bytes;
        self.memory.changed.notify_all();
    }
}

/// Limits how many frames are rendered at a time.
#[derive(Debug)]
pub struct RenderPermits {
    state: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Debug)]
struct Waiting {
    free: usize,
    /// Number of waiting frames, by the index of their mesh.
    frames: BTreeMap<usize, usize>,
}

/// Permission to render one frame; dropping it ends the permission.
#[derive(Debug)]
pub struct RenderPermit<'a>(&'a RenderPermits);

impl RenderPermits {
    /// Allows `count` frames at a time.
    pub fn new(count: usize) -> Self {
        let state = Waiting { free: count, frames: BTreeMap::new() };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Waits until a permit is free and no frame of an earlier mesh is waiting.
    pub fn take(&self, mesh: usize) -> RenderPermit<'_> {
        let mut state = lock(&self.state);
        *state.frames.entry(mesh).or_default() += 1;
        let waits = |s: &mut Waiting| {
            s.free == 0 || s.frames.first_key_value().is_some_and(|(first, _)| *first < mesh)
        };
        let waited = self.changed.wait_while(state, waits);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner);
        state.free -= 1;
        if let Some(count) = state.frames.get_mut(&mesh) {
            *count -= 1;
            if *count == 0 {
                state.frames.remove(&mesh);
            }
        }
        self.changed.notify_all();
        RenderPermit(self)
    }
}

impl Drop for RenderPermit<'_> {
    fn drop(&mut self) {
        lock(&self.0.state).free += 1;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU64;
    use std::sync::atomic::Ordering::SeqCst;

    #[test]
    fn only_a_mesh_that_is_alone_may_exceed_the_limit() {
        let memory = MemoryGate::new(10);
        let (held, most) = (AtomicU64::new(0), AtomicU64::new(0));
        let sizes = [4, 6, 3, 12, 5, 5, 0, 10, 1];
        std::thread::scope(|scope| {
            for (number, bytes) in sizes.into_iter().enumerate() {
                let (memory, held, most) = (&memory, &held, &most);
                scope.spawn(move || {
                    let _inside = memory.enter(number, bytes);
                    let now = held.fetch_add(bytes, SeqCst) + bytes;
                    most.fetch_max(if now == 12 { 0 } else { now }, SeqCst);
                    std::thread::yield_now();
                    held.fetch_sub(bytes, SeqCst);
                });
            }
        });
        assert!(most.load(SeqCst) <= 10);
    }

    #[test]
    fn a_mesh_waits_for_its_turn_and_for_room() {
        let inside = |next, meshes, bytes| Admitted { next, meshes, bytes };
        let waits = |state: Admitted, bytes| state.keeps_out(3, bytes, 10);
        assert!(!waits(inside(3, 0, 0), 12) && !waits(inside(3, 0, 0), u64::MAX));
        assert!(!waits(inside(3, 1, 4), 6) && waits(inside(3, 1, 4), 7));
        assert!(waits(inside(3, 1, 12), 0) && waits(inside(3, 2, 10), u64::MAX));
        assert!(waits(inside(2, 0, 0), 1) && waits(inside(4, 0, 0), 1));
    }

    #[test]
    fn meshes_enter_in_turn_and_share_what_is_free() {
        let memory = MemoryGate::new(10);
        let (first, second) = (memory.enter(0, 4), memory.enter(1, 6));
        assert_eq!((first.share, second.share), (10, 6));
        let shares = Mutex::new(Vec::new());
        std::thread::scope(|scope| {
            for (number, bytes) in [(3, 12), (2, 3)] {
                let (memory, shares) = (&memory, &shares);
                scope.spawn(move || {
                    let inside = memory.enter(number, bytes);
                    lock(shares).push((number, inside.share));
                });
            }
            drop(first);
            drop(second);
        });
        // The mesh of 12 waits until those of 6 and 3 have left.
        let shares = lock(&shares);
        assert!(matches!(shares[..], [(2, 4 | 10), (3, 10)]), "{shares:?}");
        let state = lock(&memory.state);
        assert_eq!((state.next, state.meshes, state.bytes), (4, 0, 0));
    }

    #[test]
    fn turns_go_to_the_earliest_mesh() {
        let permits = RenderPermits::new(1);
        let order = Mutex::new(Vec::new());
        let first = permits.take(0);
        std::thread::scope(|scope| {
            for mesh in [3, 1, 2] {
                let (permits, order) = (&permits, &order);
                scope.spawn(move || {
                    let _permit = permits.take(mesh);
                    lock(order).push(mesh);
                });
            }
            while lock(&permits.state).frames.len() < 3 {
                std::thread::yield_now();
            }
            drop(first);
        });
        assert_eq!(*lock(&order), [1, 2, 3]);
    }
}
