//! Produces items on all threads and consumes them in order.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::{Condvar, Mutex, PoisonError};

use crate::threads::lock;

/// Number of items per thread by which production may be ahead of consumption. It bounds the memory
/// of the items that wait for their turn.
const AHEAD: usize = 2;

/// Items that are ready, and the consumer.
struct Queue<T, W, E> {
    /// Index of the next item to consume.
    next: usize,
    ready: BTreeMap<usize, T>,
    take: W,
    failed: Option<E>,
    /// True after an error or a panic.
    over: bool,
}

/// Wakes up all waiting threads if a thread panics.
struct Guard<'a, T, W, E>(&'a Mutex<Queue<T, W, E>>, &'a Condvar);

impl<T, W, E> Drop for Guard<'_, T, W, E> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            lock(self.0).over = true;
            self.1.notify_all();
        }
    }
}

/// Produces items 0 to `count` - 1 with `make` on the threads of the caller's rayon pool. Passes
/// the items to `take` in order, one at a time. Each thread has its own `scratch`.
///
/// A thread that is more than [`AHEAD`] items per thread ahead waits. The thread with the next item
/// never waits, so there is no deadlock.
///
/// # Errors
/// The first error in time, which need not be that of the first item. No item is taken after it.
pub fn produce_in_order<R, T: Send, E: Send>(
    count: usize,
    scratch: impl Fn() -> R + Sync,
    make: impl Fn(&mut R, usize) -> Result<T, E> + Sync,
    take: impl FnMut(usize, T) -> Result<(), E> + Send,
) -> Result<(), E> {
    let threads = rayon::current_num_threads();
    let started = AtomicUsize::new(0);
    let queue =
        Mutex::new(Queue { next: 0, ready: BTreeMap::new(), take, failed: None, over: false });
    let changed = Condvar::new();
    let work = || {
        let _guard = Guard(&queue, &changed);
        let mut scratch = scratch();
        loop {
            let number = started.fetch_add(1, Relaxed);
            if number >= count {
                return;
            }
            let result = make(&mut scratch, number);
            let queue = lock(&queue);
            let early = |q: &mut Queue<_, _, _>| {
                !q.over && result.is_ok() && number > q.next + AHEAD * threads
            };
            let mut guard =
                changed.wait_while(queue, early).unwrap_or_else(PoisonError::into_inner);
            let queue = &mut *guard;
            if queue.over {
                return;
            }
            let taken = result.and_then(|thing| {
                queue.ready.insert(number, thing);
                while let Some(thing) = queue.ready.remove(&queue.next) {
                    (queue.take)(queue.next, thing)?;
                    queue.next += 1;
                }
                Ok(())
            });
            if let Err(error) = taken {
                queue.failed.get_or_insert(error);
                queue.over = true;
            }
            changed.notify_all();
            if queue.over {
                return;
            }
        }
    };
    rayon::scope(|scope| {
        for _ in 1..threads.min(count) {
            scope.spawn(|_| work());
        }
        work();
    });
    let queue = queue.into_inner().unwrap_or_else(PoisonError::into_inner);
    queue.failed.map_or(Ok(()), Err)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Consumes the numbers that the threads produce. Item `slow` takes longer, item `wrong` fails.
    fn run(threads: usize, count: usize, slow: usize, wrong: usize) -> (Vec<usize>, Option<usize>) {
        let mut taken = Vec::new();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let result = pool.install(|| {
            let one = |result: &mut usize, number: usize| {
                *result += 1;
                if number == slow {
                    std::thread::sleep(std::time::Duration::from_millis(30));
                }
                if number == wrong { Err(number) } else { Ok(number * number) }
            };
            produce_in_order(
                count,
                || 0,
                one,
                |number, square| {
                    assert_eq!(square, number * number);
                    taken.push(number);
                    Ok(())
                },
            )
        });
        (taken, result.err())
    }

    #[test]
    fn items_are_consumed_in_order() {
        for threads in [1, 2, 7] {
            for (count, slow) in [(0, 0), (1, 0), (200, 0), (200, 50), (200, 199)] {
                let expected: Vec<usize> = (0..count).collect();
                assert_eq!(run(threads, count, slow, usize::MAX), (expected, None));
            }
        }
    }

    #[test]
    fn a_panic_ends_all_threads() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let run = || {
            let one = |_: &mut (), number| match number {
                0 => panic!("a bug"),
                _ => Ok::<_, ()>(number),
            };
            pool.install(|| produce_in_order(1000, || (), one, |_, _| Ok(())))
        };
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).is_err());
    }

    #[test]
    fn an_error_ends_all_threads() {
        for threads in [1, 2, 7] {
            let (taken, error) = run(threads, 1000, 3, 20);
            assert_eq!(error, Some(20));
            assert!(taken.len() <= 20 && taken.iter().copied().eq(0..taken.len()));
        }
    }
}
