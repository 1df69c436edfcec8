//! Who may go on: meshes enter memory in their order while it lasts; frames are rendered some at a
//! time, those of the earliest mesh first.

use std::{
    collections::BTreeMap,
    sync::{Condvar, Mutex, MutexGuard, PoisonError},
};

/// A panic of another thread leaves counters, which stay right.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Lets meshes into memory one after the other.
#[derive(Debug)]
pub struct Memory {
    limit: u64,
    state: Mutex<Inside>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Inside {
    /// The mesh that enters next.
    next: usize,
    meshes: usize,
    bytes: u64,
}

/// Memory that a mesh holds until this is dropped.
#[derive(Debug)]
pub struct Held<'a> {
    memory: &'a Memory,
    bytes: u64,
    /// What the limit leaves for this mesh beside those that were there when it entered.
    pub share: u64,
}

impl Memory {
    /// Room for so many bytes; a mesh that is alone may take more, if it may at all.
    pub fn new(limit: u64) -> Self {
        Self { limit, state: Mutex::default(), changed: Condvar::new() }
    }

    /// Waits until it is the turn of mesh `number` (each enters once, counted from 0) and what it
    /// needs is free, or nobody else is inside.
    pub fn enter(&self, number: usize, bytes: u64) -> Held<'_> {
        let waits = |s: &mut Inside| {
            let fits = s.bytes.saturating_add(bytes) <= self.limit;
            s.next != number || s.meshes > 0 && !fits
        };
        let waited = self.changed.wait_while(lock(&self.state), waits);
        let mut inside = waited.unwrap_or_else(PoisonError::into_inner);
        let share = self.limit.saturating_sub(inside.bytes);
        inside.next += 1;
        inside.meshes += 1;
        inside.bytes = inside.bytes.saturating_add(bytes);
        self.changed.notify_all();
        Held { memory: self, bytes, share }
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        let mut inside = lock(&self.memory.state);
        inside.meshes -= 1;
        inside.bytes -= self.bytes;
        self.memory.changed.notify_all();
    }
}

/// Lets so many frames be rendered at a time.
#[derive(Debug)]
pub struct Turns {
    state: Mutex<Waiting>,
    changed: Condvar,
}

#[derive(Debug)]
struct Waiting {
    free: usize,
    /// Frames that wait, by the number of their mesh.
    frames: BTreeMap<usize, usize>,
}

/// A turn, until it is dropped.
#[derive(Debug)]
pub struct Turn<'a>(&'a Turns);

impl Turns {
    /// So many at a time.
    pub fn new(count: usize) -> Self {
        let state = Waiting { free: count, frames: BTreeMap::new() };
        Self { state: Mutex::new(state), changed: Condvar::new() }
    }

    /// Waits until a turn is free and no frame of an earlier mesh waits.
    pub fn take(&self, mesh: usize) -> Turn<'_> {
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
        Turn(self)
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        lock(&self.0.state).free += 1;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

    #[test]
    fn memory_is_never_exceeded_but_by_one_alone() {
        let memory = Memory::new(10);
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
    fn turns_go_to_the_earliest_mesh() {
        let turns = Turns::new(1);
        let order = Mutex::new(Vec::new());
        let first = turns.take(0);
        std::thread::scope(|scope| {
            for mesh in [3, 1, 2] {
                let (turns, order) = (&turns, &order);
                scope.spawn(move || {
                    let _turn = turns.take(mesh);
                    lock(order).push(mesh);
                });
            }
            while lock(&turns.state).frames.len() < 3 {
                std::thread::yield_now();
            }
            drop(first);
        });
        assert_eq!(*lock(&order), [1, 2, 3]);
    }
}
