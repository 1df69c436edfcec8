//! Interleaved timing: backends take turns, so a slow period of the machine affects all of them.

use std::time::{Duration, Instant};

use crate::error::Result;
use crate::monitor::Monitor;

/// Number of rounds and time limit of a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimingPlan {
    /// Smallest number of rounds. Each round takes two samples of every backend.
    pub rounds: usize,
    /// Further rounds begin until this time has passed since the warm-up.
    pub budget: Duration,
}

impl TimingPlan {
    /// Largest number of rounds that the budget allows. [`TimingPlan::rounds`] may be larger.
    const MAX_ROUNDS: usize = 500;
}

/// Times `count` backends in turns and returns the samples of each.
///
/// `run(i)` runs backend i once and returns its sample. The first run of each is a warm-up and is
/// discarded. Then each round runs all backends in order and in reverse order (A B B A). So sample
/// k of one backend was taken next to sample k of another.
///
/// # Errors
/// The errors of `run`; `Interrupted` after a signal.
pub fn interleave(
    count: usize,
    plan: TimingPlan,
    monitor: &Monitor,
    mut run: impl FnMut(usize) -> Result<f64>,
) -> Result<Vec<Vec<f64>>> {
    let mut samples = vec![Vec::new(); count];
    for i in 0..count {
        run(i)?;
    }
    let started = Instant::now();
    let mut round = 0;
    while round < plan.rounds || (started.elapsed() < plan.budget && round < TimingPlan::MAX_ROUNDS)
    {
        for i in (0..count).chain((0..count).rev()) {
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
    fn rounds_run_forwards_and_backwards_after_a_warm_up() {
        let mut order = Vec::new();
        let plan = TimingPlan { rounds: 2, budget: Duration::ZERO };
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
        let plan = TimingPlan { rounds: 1, budget: Duration::from_secs(3600) };
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
