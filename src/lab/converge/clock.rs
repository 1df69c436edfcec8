//! The clock of a study. It does not count the time in which the process is stopped: Ctrl-Z,
//! `SIGSTOP`, a machine that sleeps.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Smallest gap between two ticks that counts as a stop. The watcher ticks every 20 ms.
const STOPPED: Duration = Duration::from_secs(1);

/// Counts the time since a start, without gaps between ticks that are longer than [`STOPPED`].
#[derive(Debug)]
pub struct Clock {
    start: Instant,
    /// Time of the last tick, and the sum of all gaps before it.
    ticked: Mutex<(Instant, Duration)>,
}

impl Clock {
    /// A clock that counts from `start` on.
    pub fn since(start: Instant) -> Self {
        Self { start, ticked: Mutex::new((Instant::now(), Duration::ZERO)) }
    }

    /// Records that the process is running. Call it much more often than once a second.
    pub fn tick(&self) {
        self.tick_at(Instant::now);
    }

    /// Seconds since the start, without stops.
    pub fn elapsed_s(&self) -> f64 {
        self.elapsed_at(Instant::now).as_secs_f64()
    }

    /// `now` is called while no other thread can tick. A time read before might lie before a tick
    /// that ends a stop.
    fn tick_at(&self, now: impl FnOnce() -> Instant) {
        let mut ticked = self.ticked.lock().unwrap_or_else(PoisonError::into_inner);
        let (last, gaps) = *ticked;
        let now = now();
        *ticked = (now.max(last), gaps + gap(last, now));
    }

    fn elapsed_at(&self, now: impl FnOnce() -> Instant) -> Duration {
        let ticked = self.ticked.lock().unwrap_or_else(PoisonError::into_inner);
        let ((last, gaps), now) = (*ticked, now());
        now.saturating_duration_since(self.start).saturating_sub(gaps + gap(last, now))
    }
}

fn gap(last: Instant, now: Instant) -> Duration {
    Some(now.saturating_duration_since(last)).filter(|gap| *gap > STOPPED).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stops_do_not_count_but_delays_do() {
        let clock = Clock::since(Instant::now());
        let at = |ms: u64| clock.start + Duration::from_millis(ms);
        let elapsed = |ms: u64| clock.elapsed_at(|| at(ms)).as_millis();
        clock.tick_at(|| at(500));
        assert_eq!(elapsed(700), 700);
        // A stop from 700 ms to 9 s is found before the next tick and after it.
        assert_eq!(elapsed(9_000), 500);
        clock.tick_at(|| at(9_000));
        assert_eq!(elapsed(9_100), 600);
        clock.tick_at(|| at(9_900));
        assert_eq!(elapsed(10_000), 1500);
    }
}
