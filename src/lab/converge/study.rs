//! State of a study: chooses the next render and collects results. It has no renderer and no clock.

use super::crop::Crop;
use super::grid::{Setting, StudyGrid};
use super::reference::{PassSums, ReferencePicture};
use crate::lab::metrics::ValueErrors;

/// Number of passes of a reference.
const PASSES: u32 = 4;

/// Share of the remaining time that the reference may take, and share of the budget for all
/// renders. The rest of the budget is for computing errors and writing files.
const SHARES: [f64; 2] = [0.5, 0.92];

/// Largest number of samples of a pass, relative to the finest setting of the grid. More samples
/// would make no visible difference.
const FINER: f64 = 64.0;

/// Limits of a study: time, number of renders and seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StudyLimits {
    /// Seconds for the whole study.
    pub budget: f64,
    /// Number of renders of each setting, each with its own seed.
    pub repeats: u32,
    /// Seed of the first round. Later rounds count up, and the passes of the reference count down.
    pub seed: i64,
}

/// Purpose of a render.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Timing, to predict the time of other renders.
    Probe,
    /// One pass of the reference.
    Reference,
    /// A measured point of the grid, by its index.
    Point(usize),
}

/// A render of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StudyRender {
    /// Setting to render with.
    pub setting: Setting,
    /// Seed of the render.
    pub seed: i64,
    /// What the picture is used for.
    pub purpose: Purpose,
}

/// Results of one setting.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StudyPoint {
    /// The setting that was rendered.
    pub setting: Setting,
    /// Seconds of each render.
    pub seconds: Vec<f64>,
    /// Number of rays of one render.
    pub rays: u64,
    /// Errors of each render.
    pub errors: Vec<ValueErrors>,
    /// The part [`Study::crop`] of the first picture of this setting.
    pub crop: Vec<f32>,
    /// Whether renders of this setting do not fit the budget.
    pub left_out: bool,
}

/// The state of a study.
#[derive(Debug)]
pub struct Study {
    grid: StudyGrid,
    limits: StudyLimits,
    width: usize,
    stage: Stage,
    /// Seconds per unit of work, for each backend.
    cost: Vec<f64>,
    /// Results of all settings, in the order of the grid.
    pub points: Vec<StudyPoint>,
    /// The reference, once it is known.
    pub reference: Option<ReferencePicture>,
    /// Setting of the reference's passes; `None` before the first pass, or if the reference is a
    /// file.
    pub pass: Option<Setting>,
    /// Sums of the reference's passes so far.
    pub passes: PassSums,
    /// Part of the pictures that is kept. The first picture of the study decides which.
    pub crop: Option<Crop>,
}

#[derive(Debug, Clone, Copy)]
enum Stage {
    /// Index of the backend, and whether this is its second, longer probe.
    Probe(usize, bool),
    Reference,
    /// Number of the round, and the position in it.
    Grid(u32, usize),
}

impl Study {
    /// Begins a study of pictures that are `width` pixels wide. Without a reference, one is
    /// rendered.
    pub fn new(
        grid: StudyGrid,
        limits: StudyLimits,
        width: usize,
        reference: Option<ReferencePicture>,
    ) -> Self {
        let point = |setting| StudyPoint { setting, ..StudyPoint::default() };
        Self {
            points: grid.settings().into_iter().map(point).collect(),
            cost: vec![0.0; grid.backend_count],
            grid,
            limits,
            width,
            stage: Stage::Probe(0, false),
            reference,
            pass: None,
            passes: PassSums::default(),
            crop: None,
        }
    }

    /// Chooses the next render, `elapsed` seconds after the study began. `None` ends the study.
    pub fn next(&mut self, elapsed: f64) -> Option<StudyRender> {
        let StudyLimits { budget, seed, .. } = self.limits;
        let left = SHARES[1] * budget - elapsed;
        loop {
            match self.stage {
                Stage::Probe(backend, _) if backend >= self.grid.backend_count => {
                    self.stage = Stage::Reference;
                }
                Stage::Probe(backend, second) => {
                    let cheapest = self.grid.cheapest(backend);
                    // A hundredth of the budget is long enough for a timing, and costs little.
                    let factor = 0.01 * budget / (self.cost[backend] * cheapest.work());
                    let setting = match second {
                        true => self.grid.scaled(backend, factor.min(256.0)),
                        false => cheapest,
                    };
                    let purpose = Purpose::Probe;
                    return (left > 0.0).then_some(StudyRender { setting, seed, purpose });
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
                    let purpose = Purpose::Reference;
                    return (left > 0.0).then_some(StudyRender { setting, seed, purpose });
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
                    // Every other round runs backwards, so a slow period affects all settings.
                    let index = if round % 2 == 0 { place } else { count - 1 - place };
                    if self.points[index].left_out || self.expected(index) > left {
                        continue;
                    }
                    let (setting, purpose) = (self.points[index].setting, Purpose::Point(index));
                    let seed = seed.wrapping_add(i64::from(round));
                    return Some(StudyRender { setting, seed, purpose });
                }
            }
        }
    }

    /// Samples per pixel that a pass of the reference may have in the remaining seconds `left`.
    fn affordable(&self, left: f64) -> f64 {
        let finest = self.points.iter().map(|p| p.setting.samples()).max().unwrap_or(1) as f64;
        let one = self.grid.reference(1.0);
        let seconds = SHARES[0] * left.max(0.0) / f64::from(PASSES);
        let per_sample = self.cost[0] * one.work() / one.samples() as f64;
        (seconds / per_sample).min(FINER * finest)
    }

    /// Expected seconds of a render of a point: the mean so far, or a prediction.
    fn expected(&self, index: usize) -> f64 {
        let point = &self.points[index];
        match point.seconds.is_empty() {
            true => self.cost[point.setting.backend] * point.setting.work(),
            false => point.seconds.iter().sum::<f64>() / point.seconds.len() as f64,
        }
    }

    /// Leaves out the most expensive settings, so that the time suffices to render all others
    /// twice, or once if there is only one round.
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

    /// Adds the result of a render. `values` are R, G, B of all pixels.
    pub fn take(&mut self, job: &StudyRender, values: &[f32], rays: u64, seconds: f64) {
        match (&mut self.stage, job.purpose) {
            (Stage::Probe(backend, second), Purpose::Probe) => {
                self.cost[*backend] = seconds / job.setting.work();
                (*backend, *second) = (*backend + usize::from(*second), !*second);
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
                point.errors.push(ValueErrors::of(values, &reference.values));
            }
            _ => {}
        }
    }
}
