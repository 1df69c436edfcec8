//! Results of `lightpath converge`, as they are written to files.

use serde::{Deserialize, Serialize};

use super::fit::{Slope, front, slope};
use super::grid::Setting;
use super::study::{Study, StudyLimits, StudyPoint};
use crate::lab::compare::half::largest_bias;
use crate::lab::result::Machine;
use crate::lab::stats::{mad, mean, median};
use crate::units::plural;

/// Version of the file format. It changes if a reader of older files would misread newer ones.
pub const VERSION: u32 = 1;

/// Smallest ratio of a squared error to the squared error of the reference for a usable result.
/// Below it, the reference adds more than a tenth.
const FLOOR: f64 = 10.0;

/// Results of one study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StudyReport {
    /// Format of the file: [`VERSION`] when it was written.
    pub version: u32,
    /// The machine that the study ran on.
    pub machine: Machine,
    /// Number of worker threads.
    pub threads: usize,
    /// Name of the scene, as on the command line.
    pub scene: String,
    /// SHA-256 of the canonical scene.
    pub hash: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Budget of the study, in seconds.
    pub budget_s: f64,
    /// Seconds that the study took, without writing files.
    pub seconds: f64,
    /// The reference that errors are measured against.
    pub reference: ReferenceResult,
    /// All measured settings, in the order of the grid.
    pub points: Vec<PointResult>,
    /// Settings that did not fit the budget.
    pub left_out: Vec<String>,
    /// Slopes of error against samples.
    pub series: Vec<Series>,
    /// Error of `random` divided by the error of `sobol`, at equal settings.
    pub ratios: Vec<SamplerRatio>,
    /// Pareto front: indices of points with a smaller relmse than every point of at most their
    /// time. The fastest comes first.
    pub front: Vec<usize>,
    /// The cheapest points that reach given errors.
    pub reached: Vec<CheapestPoint>,
}

/// The reference of a study, and its own error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReferenceResult {
    /// Path of the file; `None` if the reference was rendered.
    pub file: Option<String>,
    /// Whether the file is stored in 16 bits.
    pub half: bool,
    /// Largest mean error by storing it in 16 bits; `None` if it is not.
    pub largest_half_bias: Option<f64>,
    /// Camera samples per pixel of each pass, rendered by the first backend.
    pub spp: Option<u32>,
    /// Samples on each area light, sun and environment per shading point, of each pass.
    pub light_samples: Option<u32>,
    /// Number of independent passes that are averaged.
    pub passes: Option<u32>,
    /// RMSE of the reference itself, from the variance between its passes.
    pub rmse: Option<f64>,
    /// Relmse of the reference itself, likewise.
    pub relmse: Option<f64>,
}

/// A mean and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeanWithError {
    /// The mean over all renders.
    pub value: f64,
    /// Standard error of the mean; `None` for a single render.
    pub standard_error: Option<f64>,
}

impl MeanWithError {
    /// Standard error relative to the value; `None` for a single render or a value of 0.
    fn relative_error(&self) -> Option<f64> {
        self.standard_error.map(|error| error / self.value).filter(|error| error.is_finite())
    }
}

/// Results of one setting.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointResult {
    /// Name of the backend, as on the command line.
    pub backend: String,
    /// Sampler: `sobol` or `random`.
    pub sampler: String,
    /// Camera samples per pixel.
    pub spp: u32,
    /// Samples on each area light, sun and environment per shading point.
    pub light_samples: Option<u32>,
    /// Samples per pixel: the product of `spp` and `light_samples`.
    pub samples: u64,
    /// Number of rays of one render.
    pub rays: u64,
    /// Seconds of each render, without builds and writing.
    pub seconds: Vec<f64>,
    /// The median of `seconds`.
    pub median_s: f64,
    /// Median absolute deviation of `seconds`.
    pub mad_s: f64,
    /// Root mean squared error: sqrt(mean d^2), with the mean over pixels and renders.
    pub rmse: MeanWithError,
    /// Relative squared error: mean d^2 / (r^2 + 0.01).
    pub relmse: MeanWithError,
    /// Mean absolute error: mean |d|.
    pub mae: MeanWithError,
    /// Mean signed error: mean d.
    pub bias: MeanWithError,
    /// Whether the reference's own error is more than a tenth of the squared error.
    pub at_floor: bool,
    /// Whether it has one camera sample per pixel and another setting of the study has more. Then
    /// its error is mostly that of edges.
    pub not_antialiased: bool,
}

/// Settings of one backend and sampler that differ in one number of samples.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Series {
    /// Name of the backend, as on the command line.
    pub backend: String,
    /// Sampler: `sobol` or `random`.
    pub sampler: String,
    /// The other number, which is constant: `4 light samples`, `1 spp`; empty if no light has
    /// samples.
    pub fixed: String,
    /// Indices of points, fewest samples first. Points at the floor or without antialiasing are
    /// left out.
    pub points: Vec<usize>,
    /// Slope of RMSE, without the error of the reference, against samples per pixel; `None` for
    /// fewer than 3 points.
    pub slope: Option<Slope>,
}

/// Ratio of the errors of both samplers at the same settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SamplerRatio {
    /// Name of the backend, as on the command line.
    pub backend: String,
    /// Camera samples per pixel.
    pub spp: u32,
    /// Samples on each area light, sun and environment per shading point.
    pub light_samples: Option<u32>,
    /// Samples per pixel: the product of both numbers.
    pub samples: u64,
    /// RMSE of `random` divided by RMSE of `sobol`, both without the error of the reference.
    pub rmse: MeanWithError,
}

/// The cheapest point that reaches an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CheapestPoint {
    /// The relmse that is reached, a power of ten.
    pub relmse: f64,
    /// Index of the point with the shortest time.
    pub point: usize,
    /// Indices of the fastest points of every other pair of backend and sampler that reaches it.
    pub others: Vec<usize>,
}

/// Names of machine, scene, backends and reference of a study.
#[derive(Debug, Clone)]
pub struct StudyNames {
    /// The machine that the study ran on.
    pub machine: Machine,
    /// Number of worker threads.
    pub threads: usize,
    /// Name of the scene, as on the command line.
    pub scene: String,
    /// SHA-256 of the canonical scene.
    pub hash: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Names of the backends.
    pub backends: Vec<String>,
    /// Path of the reference's file, and whether it is stored in 16 bits.
    pub reference: Option<(String, bool)>,
}

/// Computes the report of a finished study. `seconds` is its duration.
pub fn report(
    study: &Study,
    subject: StudyNames,
    limits: StudyLimits,
    seconds: f64,
) -> StudyReport {
    let antialiased = study.points.iter().any(|point| point.setting.spp > 1);
    let measured = study.points.iter().filter(|point| !point.errors.is_empty());
    let measured: Vec<&StudyPoint> = measured.collect();
    let name = |setting: &Setting| subject.backends[setting.backend].clone();
    let points = measured.iter().map(|p| point(p, name(&p.setting), study, antialiased));
    let points: Vec<PointResult> = points.collect();
    let left_out = study.points.iter().filter(|point| point.errors.is_empty()).map(|point| {
        let Setting { sampler, spp, light_samples, .. } = point.setting;
        shown(&name(&point.setting), sampler.name(), spp, light_samples)
    });
    let cost = |p: &PointResult| [p.median_s, p.relmse.value];
    let costs: Vec<[f64; 2]> = points.iter().map(cost).collect();
    let floor = study.reference.as_ref().and_then(|reference| reference.floor);
    let (file, half) = subject.reference.unzip();
    let half = half.unwrap_or_default();
    let in_half = study.reference.as_ref().filter(|_| half);
    StudyReport {
        version: VERSION,
        machine: subject.machine,
        threads: subject.threads,
        scene: subject.scene,
        hash: subject.hash,
        size: subject.size,
        budget_s: limits.budget,
        seconds,
        reference: ReferenceResult {
            file,
            half,
            largest_half_bias: in_half.map(|reference| largest_bias(&reference.values)),
            spp: study.pass.map(|pass| pass.spp),
            light_samples: study.pass.and_then(|pass| pass.light_samples),
            passes: study.pass.map(|_| study.passes.count),
            rmse: floor.map(|floor| floor.mse.sqrt()),
            relmse: floor.map(|floor| floor.relmse),
        },
        left_out: left_out.collect(),
        series: series(&points, floor.map_or(0.0, |floor| floor.mse)),
        ratios: ratios(&points, floor.map_or(0.0, |floor| floor.mse)),
        front: front(&costs),
        reached: reached(&points),
        points,
    }
}

/// Name of a setting in tables: `embree, sobol, 16 spp x 4`.
pub fn shown(backend: &str, sampler: &str, spp: u32, light_samples: Option<u32>) -> String {
    let lights = light_samples.map_or(String::new(), |n| format!(" x {n}"));
    format!("{backend}, {sampler}, {spp} spp{lights}")
}

impl PointResult {
    /// Name of the setting in tables and messages.
    pub fn name(&self) -> String {
        shown(&self.backend, &self.sampler, self.spp, self.light_samples)
    }

    /// Whether most of the error comes from edges without antialiasing.
    pub fn lacks_antialiasing(&self) -> bool {
        self.not_antialiased && self.rmse.value > 0.0
    }

    fn backend_and_sampler(&self) -> (&str, &str) {
        (&self.backend, &self.sampler)
    }
}

fn point(point: &StudyPoint, backend: String, study: &Study, antialiased: bool) -> PointResult {
    let of = |f: fn(&crate::lab::metrics::ValueErrors) -> f64| {
        mean_with_error(&point.errors.iter().map(f).collect::<Vec<_>>())
    };
    let mse = of(|e| e.mse);
    let floor = study.reference.as_ref().and_then(|reference| reference.floor);
    PointResult {
        backend,
        sampler: point.setting.sampler.name().into(),
        spp: point.setting.spp,
        light_samples: point.setting.light_samples,
        samples: point.setting.samples(),
        rays: point.rays,
        median_s: median(&point.seconds),
        mad_s: mad(&point.seconds),
        seconds: point.seconds.clone(),
        rmse: root(mse),
        relmse: of(|e| e.relmse),
        mae: of(|e| e.mae),
        bias: of(|e| e.bias),
        at_floor: floor.is_some_and(|floor| mse.value < FLOOR * floor.mse),
        not_antialiased: antialiased && point.setting.spp == 1,
    }
}

fn mean_with_error(values: &[f64]) -> MeanWithError {
    let (n, value) = (values.len() as f64, mean(values));
    let squares: f64 = values.iter().map(|v| (v - value).powi(2)).sum();
    let standard_error = (values.len() > 1).then(|| (squares / (n - 1.0) / n).sqrt());
    MeanWithError { value, standard_error }
}

/// Root of a mean square, with its standard error to first order.
fn root(square: MeanWithError) -> MeanWithError {
    let value = square.value.sqrt();
    let standard_error = square.standard_error.map(|error| match value > 0.0 {
        true => error / (2.0 * value),
        false => 0.0,
    });
    MeanWithError { value, standard_error }
}

/// The RMSE of a point without that of the reference, whose mean square is `floor`: the two are
/// independent, so their mean squares add up. The point must be above the floor.
fn own_rmse(point: &PointResult, floor: f64) -> MeanWithError {
    let MeanWithError { value, standard_error } = point.rmse;
    let standard_error = standard_error.map(|error| 2.0 * value * error);
    root(MeanWithError { value: (value * value - floor).max(0.0), standard_error })
}

/// Collects the series along spp, and along light samples, of every backend and sampler. `floor` is
/// the mean square error of the reference.
fn series(points: &[PointResult], floor: f64) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let lights = point.light_samples;
        let fixed = [
            lights.map_or(String::new(), |n| plural(n as usize, "light sample")),
            format!("{} spp", point.spp),
        ];
        // Only spp varies if no light has samples.
        for fixed in fixed.into_iter().take(if lights.is_some() { 2 } else { 1 }) {
            let (backend, sampler) = point.backend_and_sampler();
            let same = |s: &Series| {
                (s.backend.as_str(), s.sampler.as_str(), &s.fixed) == (backend, sampler, &fixed)
            };
            let at = series.iter().position(same).unwrap_or_else(|| {
                let (backend, sampler) = (backend.to_string(), sampler.to_string());
                series.push(Series { backend, sampler, fixed, points: Vec::new(), slope: None });
                series.len() - 1
            });
            if !(point.at_floor || point.not_antialiased) {
                series[at].points.push(i);
            }
        }
    }
    for series in &mut series {
        series.points.sort_by_key(|&i| points[i].samples);
        let own = || series.points.iter().map(|&i| &points[i]).map(|p| (p, own_rmse(p, floor)));
        let values: Vec<_> = own().map(|(p, rmse)| [p.samples as f64, rmse.value]).collect();
        let errors: Vec<_> = own().map(|(_, e)| e.relative_error().unwrap_or(0.0)).collect();
        series.slope = slope(&values, &errors);
    }
    series.retain(|series| series.points.len() > 1);
    series
}

fn ratios(points: &[PointResult], floor: f64) -> Vec<SamplerRatio> {
    let mut ratios = Vec::new();
    for sobol in points.iter().filter(|p| p.sampler == "sobol" && !p.at_floor) {
        let key = |p: &PointResult| (p.backend.clone(), p.spp, p.light_samples);
        let same = |p: &&PointResult| p.sampler == "random" && key(p) == key(sobol);
        let Some(random) = points.iter().find(same) else { continue };
        if sobol.not_antialiased || sobol.rmse.value == 0.0 {
            continue;
        }
        let (own, of_random) = (own_rmse(sobol, floor), own_rmse(random, floor));
        let value = of_random.value / own.value;
        let relative = |e: MeanWithError| e.standard_error.map(|error| (error / e.value).powi(2));
        let errors = relative(of_random).zip(relative(own));
        let standard_error = errors.map(|(a, b)| value * (a + b).sqrt());
        ratios.push(SamplerRatio {
            backend: sobol.backend.clone(),
            spp: sobol.spp,
            light_samples: sobol.light_samples,
            samples: sobol.samples,
            rmse: MeanWithError { value, standard_error },
        });
    }
    ratios
}

/// Finds the cheapest points for every power of ten of relmse, from 1e-12 to 100, that some points
/// reach, but not all.
fn reached(points: &[PointResult]) -> Vec<CheapestPoint> {
    let mut reached = Vec::new();
    let largest = points.iter().map(|p| p.relmse.value).fold(0.0, f64::max);
    for exponent in -12..=2 {
        let relmse = 10f64.powi(exponent);
        if relmse >= largest {
            continue;
        }
        let mut best: Vec<usize> = Vec::new();
        for (i, point) in points.iter().enumerate().filter(|(_, p)| p.relmse.value <= relmse) {
            let same = |j: &usize| points[*j].backend_and_sampler() == point.backend_and_sampler();
            match best.iter().position(same) {
                Some(at) if points[best[at]].median_s > point.median_s => best[at] = i,
                Some(_) => {}
                None => best.push(i),
            }
        }
        best.sort_by(|&a, &b| points[a].median_s.total_cmp(&points[b].median_s));
        if let [first, others @ ..] = best.as_slice() {
            reached.push(CheapestPoint { relmse, point: *first, others: others.to_vec() });
        }
    }
    reached.reverse();
    reached
}
