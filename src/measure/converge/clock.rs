//! The time of a study. A process that is stopped (Ctrl-Z, `SIGSTOP`, a machine that sleeps) does not
//! use up its budget meanwhile.

use std::{
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

/// A gap between two ticks that is no mere delay: the watcher ticks every 20 ms.
const STOPPED: Duration = Duration::from_secs(1);

/// Counts the time since a start, without the time in which nobody ticked.
#[derive(Debug)]
pub struct Clock {
    start: Instant,
    /// The last tick, and the gaps before it.
    ticked: Mutex<(Instant, Duration)>,
}

impl Clock {
    /// A clock that counts since `start`.
    pub fn since(start: Instant) -> Self {
        Self { start, ticked: Mutex::new((Instant::now(), Duration::ZERO)) }
    }

    /// Says that the process runs. To be called much more often than once a second.
    pub fn tick(&self) {
        self.tick_at(Instant::now());
    }

    /// The time that counts, seconds.
    pub fn elapsed_s(&self) -> f64 {
        self.elapsed_at(Instant::now()).as_secs_f64()
    }

    fn tick_at(&self, now: Instant) {
        let mut ticked = self.ticked.lock().unwrap_or_else(PoisonError::into_inner);
        let (last, gaps) = *ticked;
        *ticked = (now.max(last), gaps + gap(last, now));
    }

    fn elapsed_at(&self, now: Instant) -> Duration {
        let (last, gaps) = *self.ticked.lock().unwrap_or_else(PoisonError::into_inner);
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
    fn a_stop_does_not_count_and_a_delay_does() {
        let clock = Clock::since(Instant::now());
        let at = |ms: u64| clock.start + Duration::from_millis(ms);
        let elapsed = |ms: u64| clock.elapsed_at(at(ms)).as_millis();
        clock.tick_at(at(500));
        assert_eq!(elapsed(700), 700);
        // Stopped from 700 ms to 9 s: seen before the next tick and after it.
        assert_eq!(elapsed(9_000), 500);
        clock.tick_at(at(9_000));
        assert_eq!(elapsed(9_100), 600);
        clock.tick_at(at(9_900));
        assert_eq!(elapsed(10_000), 1500);
    }
}
