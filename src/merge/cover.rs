//! Checks that parts cover every sample of every pixel of a picture exactly once.

use std::ops::Range;

use crate::film::Window;

/// Pixels and samples of one part.
#[derive(Debug, Clone)]
pub struct CoveredRegion {
    pub window: Window,
    pub samples: Range<u32>,
}

/// A region that is not covered, or that two parts cover.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CoverFault {
    pub window: Window,
    /// Range of samples in each pixel of the window.
    pub samples: Range<u32>,
    /// Indices of two pieces that both contain the region; `None` if the region is missing.
    pub twice: Option<[usize; 2]>,
}

/// Returns all regions of `whole` and of the samples `0..of` that the pieces do not cover exactly
/// once, from top to bottom.
pub fn faults(pieces: &[CoveredRegion], whole: Window, of: u32) -> Vec<CoverFault> {
    let mut rows: Vec<u32> = pieces.iter().flat_map(|p| [p.window.y0, p.window.y1]).collect();
    rows.extend([whole.y0, whole.y1]);
    let rows = cuts(rows, whole.y0, whole.y1);
    let mut faults: Vec<CoverFault> = Vec::new();
    for two in rows.windows(2) {
        let (y0, y1) = (two[0], two[1]);
        let here = |p: &CoveredRegion| p.window.y0 <= y0 && p.window.y1 > y0;
        let here: Vec<usize> = (0..pieces.len()).filter(|&i| here(&pieces[i])).collect();
        let sides = here.iter().flat_map(|&i| [pieces[i].window.x0, pieces[i].window.x1]);
        let columns = cuts(sides.chain([whole.x0, whole.x1]).collect(), whole.x0, whole.x1);
        for two in columns.windows(2) {
            let window = Window { x0: two[0], y0, x1: two[1], y1 };
            let covers = |i: &usize| {
                let w = pieces[*i].window;
                w.x0 <= window.x0 && w.x1 > window.x0
            };
            let mut found = here.iter().copied().filter(covers).collect::<Vec<_>>();
            found.sort_by_key(|&i| (pieces[i].samples.start, pieces[i].samples.end));
            let mut done = 0;
            let mut last = 0;
            for i in found {
                let Range { start, end } = pieces[i].samples;
                if start > done {
                    add(&mut faults, CoverFault { window, samples: done..start, twice: None });
                }
                if start < done {
                    let samples = start..end.min(done);
                    add(&mut faults, CoverFault { window, samples, twice: Some([last, i]) });
                }
                if end > done {
                    (done, last) = (end, i);
                }
            }
            if done < of {
                add(&mut faults, CoverFault { window, samples: done..of, twice: None });
            }
        }
    }
    faults
}

fn cuts(mut at: Vec<u32>, from: u32, to: u32) -> Vec<u32> {
    at.retain(|at| (from..=to).contains(at));
    at.sort_unstable();
    at.dedup();
    at
}

/// Adds a fault. If an adjacent fault has the same samples and pieces, extends it instead.
fn add(faults: &mut Vec<CoverFault>, new: CoverFault) {
    let same = |old: &&mut CoverFault| old.samples == new.samples && old.twice == new.twice;
    for old in faults.iter_mut().rev().filter(same) {
        let (a, b) = (&mut old.window, new.window);
        if a.x0 == b.x0 && a.x1 == b.x1 && a.y1 == b.y0 {
            a.y1 = b.y1;
            return;
        }
        if a.y0 == b.y0 && a.y1 == b.y1 && a.x1 == b.x0 {
            a.x1 = b.x1;
            return;
        }
    }
    faults.push(new);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(x0: u32, y0: u32, x1: u32, y1: u32) -> Window {
        Window { x0, y0, x1, y1 }
    }

    fn piece(window: Window, samples: Range<u32>) -> CoveredRegion {
        CoveredRegion { window, samples }
    }

    #[test]
    fn exact_covers_have_no_faults() {
        let whole = window(0, 0, 10, 10);
        assert_eq!(faults(&[piece(whole, 0..4)], whole, 4), []);
        let pieces = [
            piece(window(0, 0, 10, 5), 0..4),
            piece(window(0, 5, 3, 10), 0..4),
            piece(window(3, 5, 10, 10), 2..4),
            piece(window(3, 5, 10, 10), 0..2),
        ];
        assert_eq!(faults(&pieces, whole, 4), []);
    }

    #[test]
    fn missing_and_duplicate_samples_are_found() {
        let whole = window(0, 0, 10, 10);
        let pieces = [
            piece(window(0, 0, 10, 4), 0..4),
            piece(window(0, 3, 10, 6), 0..2),
            piece(window(0, 6, 10, 10), 0..4),
            piece(window(0, 8, 10, 10), 1..2),
        ];
        let expected = [
            CoverFault { window: window(0, 3, 10, 4), samples: 0..2, twice: Some([1, 0]) },
            CoverFault { window: window(0, 4, 10, 6), samples: 2..4, twice: None },
            CoverFault { window: window(0, 8, 10, 10), samples: 1..2, twice: Some([2, 3]) },
        ];
        assert_eq!(faults(&pieces, whole, 4), expected);
        assert_eq!(
            faults(&[], whole, 4),
            [CoverFault { window: whole, samples: 0..4, twice: None }]
        );
    }

    /// Adds missing samples in two windows, and returns the windows of the faults.
    fn added(first: Window, second: Window) -> Vec<Window> {
        let mut faults = Vec::new();
        for window in [first, second] {
            add(&mut faults, CoverFault { window, samples: 0..1, twice: None });
        }
        faults.into_iter().map(|fault| fault.window).collect()
    }

    #[test]
    fn only_faults_with_a_whole_side_in_common_become_one() {
        let first = window(2, 2, 4, 4);
        assert_eq!(added(first, window(2, 4, 4, 6)), [window(2, 2, 4, 6)], "below");
        assert_eq!(added(first, window(4, 2, 6, 4)), [window(2, 2, 6, 4)], "to the right");
        let apart = [
            // Below: another left side, another right side, a gap.
            window(3, 4, 4, 6),
            window(2, 4, 5, 6),
            window(2, 5, 4, 6),
            // To the right: another top, another bottom, a gap.
            window(4, 3, 6, 4),
            window(4, 2, 6, 5),
            window(5, 2, 6, 4),
        ];
        for second in apart {
            assert_eq!(added(first, second), [first, second]);
        }
    }

    #[test]
    fn faults_of_other_samples_or_parts_stay_apart() {
        let fault = |y: u32, samples: Range<u32>, twice: Option<[usize; 2]>| CoverFault {
            window: window(0, y, 1, y + 1),
            samples,
            twice,
        };
        for second in [fault(1, 0..2, None), fault(1, 0..1, Some([0, 1]))] {
            let mut faults = vec![fault(0, 0..1, None)];
            add(&mut faults, second);
            assert_eq!(faults.len(), 2, "{faults:?}");
        }
    }
}
