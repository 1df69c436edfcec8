//! What is rendered next, and what is known so far: the study without a renderer and without a clock.

use super::crop::Crop;
use super::grid::{Grid, Setting};
use super::reference::{Passes, Reference};
use crate::measure::metrics::Errors;

/// Passes of a reference.
const PASSES: u32 = 4;

/// Share of the budget that the reference may take, and that is left for rendering altogether: the rest is
/// for finding errors and writing files.
const SHARES: [f64; 2] = [0.5, 0.92];

/// Most samples of a pass, relative to the finest setting of the grid: more would not be seen.
const FINER: f64 = 64.0;

/// How much is rendered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Seconds for all of it.
    pub budget: f64,
    /// Renders of each setting, each with a seed of its own.
    pub repeats: u32,
    /// Seed of the first round; the rounds after it count up.
    pub seed: i64,
}

/// What a render is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// To know how long others will take.
    Probe,
    /// A pass of the reference.
    Reference,
    /// Point of the grid.
    Point(usize),
}

/// A render to be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Job {
    /// Setting to render with.
    pub setting: Setting,
    /// Of every random choice.
    pub seed: i64,
    /// What the picture is used for.
    pub purpose: Purpose,
}

/// What is known of one setting.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// The setting that was rendered.
    pub setting: Setting,
    /// Seconds of each render.
    pub seconds: Vec<f64>,
    /// Rays of one render.
    pub rays: u64,
    /// Errors of each render.
    pub errors: Vec<Errors>,
    /// A part of the first picture.
    pub crop: Vec<f32>,
    /// Whether a render of it does not fit the budget.
    pub left_out: bool,
}

/// The state of a study.
#[derive(Debug)]
pub struct Study {
    grid: Grid,
    limits: Limits,
    width: usize,
    stage: Stage,
    /// Seconds per work, by contestant.
    cost: Vec<f64>,
    /// The points in the order of the grid.
    pub points: Vec<Point>,
    /// What errors are measured against.
    pub reference: Option<Reference>,
    /// How the reference is rendered; `None` for a file.
    pub pass: Option<Setting>,
    /// What was rendered of it.
    pub passes: Passes,
    /// Which part of pictures is kept.
    pub crop: Option<Crop>,
}

#[derive(Debug, Clone, Copy)]
enum Stage {
    /// Of a contestant; whether it is the second, larger one.
    Probe(usize, bool),
    Reference,
    /// Round and place in it.
    Grid(u32, usize),
}

impl Study {
    /// A study of pictures `width` pixels wide, against a reference if there is one.
    pub fn new(grid: Grid, limits: Limits, width: usize, reference: Option<Reference>) -> Self {
        let point = |setting| Point {
            setting,
            seconds: Vec::new(),
            rays: 0,
            errors: Vec::new(),
            crop: Vec::new(),
            left_out: false,
        };
        Self {
            points: grid.settings().into_iter().map(point).collect(),
            cost: vec![0.0; grid.contestants],
            grid,
            limits,
            width,
            stage: Stage::Probe(0, false),
            reference,
            pass: None,
            passes: Passes::default(),
            crop: None,
        }
    }

    /// What to render next, `elapsed` seconds after the study began; `None` at its end.
    pub fn next(&mut self, elapsed: f64) -> Option<Job> {
        let Limits { budget, seed, .. } = self.limits;
        let left = SHARES[1] * budget - elapsed;
        loop {
            match self.stage {
                Stage::Probe(contestant, _) if contestant >= self.grid.contestants => {
                    self.stage = Stage::Reference;
                }
                Stage::Probe(contestant, second) => {
                    let least = self.grid.least(contestant);
                    // A hundredth of the budget is long enough for a clock, and little.
                    let factor = 0.01 * budget / (self.cost[contestant] * least.work());
                    let setting = match second {
                        true => self.grid.times(contestant, factor.min(256.0)),
                        false => least,
                    };
                    return (left > 0.0).then_some(Job { setting, seed, purpose: Purpose::Probe });
                }
                Stage::Reference => {
                    let setting = match (&self.reference, self.pass) {
                        (Some(_), _) => None,
                        (None, Some(setting)) => Some(setting),
                        (None, None) => Some(self.grid.reference(self.affordable(left))),
                    };
                    let Some(setting) = setting else {
                        self.begin_grid(left);
                        continue;
                    };
                    let count = self.passes.count;
                    let expected = self.cost[0] * setting.work();
                    if count >= PASSES || (count >= 2 && expected > left) {
                        self.reference = Some(self.passes.mean());
                        continue;
                    }
                    self.pass = Some(setting);
                    let seed = seed.wrapping_sub(1 + i64::from(count));
                    return (left > 0.0).then_some(Job {
                        setting,
                        seed,
                        purpose: Purpose::Reference,
                    });
                }
                Stage::Grid(round, place) => {
                    if round >= self.limits.repeats {
                        return None;
                    }
                    let count = self.points.len();
                    self.stage = match place + 1 < count {
                        true => Stage::Grid(round, place + 1),
                        false => Stage::Grid(round + 1, 0),
                    };
                    // Forth and back, so that a slow minute hits all alike.
                    let index = if round % 2 == 0 { place } else { count - 1 - place };
                    if self.points[index].left_out || self.expected(index) > left {
                        continue;
                    }
                    let (setting, purpose) = (self.points[index].setting, Purpose::Point(index));
                    let seed = seed.wrapping_add(i64::from(round));
                    return Some(Job { setting, seed, purpose });
                }
            }
        }
    }

    /// Samples of a pass of the reference.
    fn affordable(&self, left: f64) -> f64 {
        let finest = self.points.iter().map(|p| p.setting.samples()).max().unwrap_or(1) as f64;
        let one = self.grid.reference(1.0);
        let seconds = SHARES[0] * left.max(0.0) / f64::from(PASSES);
        let per_sample = self.cost[0] * one.work() / one.samples() as f64;
        (seconds / per_sample).min(FINER * finest)
    }

    /// Seconds of a point.
    fn expected(&self, index: usize) -> f64 {
        let point = &self.points[index];
        match point.seconds.is_empty() {
            true => self.cost[point.setting.contestant] * point.setting.work(),
            false => point.seconds.iter().sum::<f64>() / point.seconds.len() as f64,
        }
    }

    /// Leaves out what is too expensive to be rendered twice: the cheapest come first.
    fn begin_grid(&mut self, left: f64) {
        let mut order: Vec<usize> = (0..self.points.len()).collect();
        order.sort_by(|&a, &b| self.expected(a).total_cmp(&self.expected(b)));
        let twice = 2.0f64.min(f64::from(self.limits.repeats));
        let mut sum = 0.0;
        for index in order {
            sum += twice * self.expected(index);
            self.points[index].left_out = sum > left;
        }
        self.stage = Stage::Grid(0, 0);
    }

    /// Takes what was rendered: R G B of all pixels.
    pub fn take(&mut self, job: &Job, values: &[f32], rays: u64, seconds: f64) {
        match (&mut self.stage, job.purpose) {
            (Stage::Probe(contestant, second), Purpose::Probe) => {
                self.cost[*contestant] = seconds / job.setting.work();
                (*contestant, *second) = (*contestant + usize::from(*second), !*second);
            }
            (Stage::Reference, Purpose::Reference) => self.passes.add(values),
            (_, Purpose::Point(index)) => {
                let Some(reference) = &self.reference else { return };
                let make = || Crop::of_largest_error(values, &reference.values, self.width);
                let crop = *self.crop.get_or_insert_with(make);
                let point = &mut self.points[index];
                if point.crop.is_empty() {
                    point.crop = crop.cut(values, self.width);
                }
                point.rays = rays;
                point.seconds.push(seconds);
                point.errors.push(Errors::of(values, &reference.values));
            }
            _ => {}
        }
    }
}
