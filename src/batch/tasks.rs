//! Selects the frames of a run: all frames of all inputs, mesh after mesh, or a range of them.

use std::ops::Range;

use crate::error::{Error, Result};

/// The frames of one input that belong to a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Task {
    /// Index of the input in the job.
    pub input: usize,
    /// Indices of the frames within the input.
    pub frames: Range<u32>,
}

/// Returns the index of a frame among all frames of a job, as in `--range`. `frames` is the number
/// of frames per input. For `input` equal to the number of inputs, it is the number of all frames.
pub fn index(frames: u32, input: usize, frame: u32) -> u64 {
    input as u64 * u64::from(frames) + u64::from(frame)
}

/// Returns one task per input that has frames in `range`. A job has `inputs` inputs of `frames`
/// frames each.
///
/// # Errors
/// A range that is empty or exceeds the job.
pub fn tasks(inputs: usize, frames: u32, range: Option<&Range<u64>>) -> Result<Vec<Task>> {
    let all = 0..index(frames, inputs, 0);
    let range = range.unwrap_or(&all);
    if range.is_empty() || range.end > all.end {
        let message = format!(
            "found {}..{}, expected frames A..B of 0..{}, B excluded",
            range.start, range.end, all.end
        );
        return Err(Error::invalid("--range", message));
    }
    let per = u64::from(frames);
    let first = range.start / per;
    let last = (range.end - 1) / per;
    let task = |input: u64| {
        let start = input * per;
        // Both ends lie within the frames of one input, so they fit into 32 bits.
        let frames = range.start.saturating_sub(start) as u32..(range.end - start).min(per) as u32;
        Task { input: input as usize, frames }
    };
    Ok((first..=last).map(task).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_cover_every_frame_once() {
        for cuts in [vec![0, 20], vec![0, 1, 7, 8, 15, 20], vec![0, 4, 8, 20]] {
            let mut seen = Vec::new();
            for cut in cuts.windows(2) {
                for task in tasks(5, 4, Some(&(cut[0]..cut[1]))).unwrap() {
                    seen.extend(task.frames.map(|frame| index(4, task.input, frame)));
                }
            }
            assert_eq!(seen, (0..20).collect::<Vec<u64>>(), "{cuts:?}");
        }
        assert_eq!(tasks(5, 4, None).unwrap().len(), 5);
        for bad in [3..3, 19..21, 30..31] {
            assert!(tasks(5, 4, Some(&bad)).is_err(), "{bad:?}");
        }
    }
}
