//! Who is faster: contestants take turns, so that a slow minute hits all of them alike.

use std::time::{Duration, Instant};

use crate::error::Result;
use crate::monitor::Monitor;

/// How long to measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Rounds at least; each gives every contestant two samples.
    pub rounds: usize,
    /// Further rounds until this time is up.
    pub budget: Duration,
}

impl Plan {
    /// Rounds that no budget exceeds.
    const MOST: usize = 500;
}

/// The samples of `contestants`: one warm-up each that is thrown away, then rounds of all in order
/// and all in the reverse order (A B B A). `run(i)` runs contestant i once and returns its sample.
/// Sample k of one was taken next to sample k of another.
///
/// # Errors
/// Those of `run`; `Interrupted` after a signal.
pub fn interleave(
    contestants: usize,
    plan: Plan,
    monitor: &Monitor,
    mut run: impl FnMut(usize) -> Result<f64>,
) -> Result<Vec<Vec<f64>>> {
    let mut samples = vec![Vec::new(); contestants];
    for i in 0..contestants {
        run(i)?;
    }
    let started = Instant::now();
    let mut round = 0;
    while round < plan.rounds || (started.elapsed() < plan.budget && round < Plan::MOST) {
        for i in (0..contestants).chain((0..contestants).rev()) {
            monitor.check()?;
            samples[i].push(run(i)?);
        }
        round += 1;
    }
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turns_go_forth_and_back_after_a_warm_up() {
        let mut order = Vec::new();
        let plan = Plan { rounds: 2, budget: Duration::ZERO };
        let samples = interleave(3, plan, &Monitor::default(), |i| {
            order.push(i);
            Ok(order.len() as f64)
        });
        assert_eq!(order, [0, 1, 2, 0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0]);
        let samples = samples.unwrap();
        assert_eq!(samples[0], [4.0, 9.0, 10.0, 15.0]);
        assert_eq!(samples[2], [6.0, 7.0, 12.0, 13.0]);
    }

    #[test]
    fn a_budget_adds_rounds_and_a_signal_ends_them() {
        let monitor = Monitor::default();
        let mut runs = 0;
        let plan = Plan { rounds: 1, budget: Duration::from_secs(3600) };
        let result = interleave(1, plan, &monitor, |_| {
            runs += 1;
            if runs == 10 {
                monitor.signal.store(2, std::sync::atomic::Ordering::Relaxed);
            }
            Ok(1.0)
        });
        assert!(result.is_err());
        assert_eq!(runs, 10);
    }
}
