//! Tests of studies with known errors and times, without a renderer and a clock.

use super::result::StudyNames;
use super::study::{Purpose, StudyRender};
use super::*;
use crate::lab::random::Random;
use crate::lab::result::Machine;
use crate::scene::SamplerKind;

const WIDTH: usize = 64;
const PIXELS: usize = WIDTH * 48;

/// Renders a picture of value 1 plus uniform noise of width `samples^-p`, so that
/// RMSE = samples^-p / sqrt(12).
fn render(job: &StudyRender) -> Vec<f32> {
    let power = match job.setting.sampler {
        SamplerKind::Sobol => -0.75,
        SamplerKind::Random => -0.5,
    };
    let noise = (job.setting.samples() as f64).powf(power);
    let key = job.setting.samples() << 8 | u64::from(job.setting.sampler == SamplerKind::Random);
    let mut random = Random::new(job.seed as u64, key);
    (0..3 * PIXELS).map(|_| (1.0 + noise * (random.unit() - 0.5)) as f32).collect()
}

/// Runs a study whose renders take `per_work` seconds per unit of work.
fn run_all(grid: &StudyGrid, limits: StudyLimits, per_work: f64) -> (Study, Vec<StudyRender>, f64) {
    let mut study = Study::new(grid.clone(), limits, WIDTH, None);
    let (mut now, mut jobs) = (0.0, Vec::new());
    while let Some(job) = study.next(now) {
        let seconds = per_work * job.setting.work();
        now += seconds;
        study.take(&job, &render(&job), job.setting.samples(), seconds);
        jobs.push(job);
    }
    (study, jobs, now)
}

fn grid() -> StudyGrid {
    StudyGrid {
        backend_count: 1,
        samplers: SamplerKind::ALL.to_vec(),
        spp: vec![1, 4, 16, 64],
        light_samples: vec![Some(1), Some(4)],
    }
}

fn limits(budget: f64) -> StudyLimits {
    StudyLimits { budget, repeats: 3, seed: 5 }
}

fn found(study: &Study, limits: StudyLimits) -> StudyReport {
    found_beside(None, study, limits)
}

/// The report of a study whose reference may be a file, stored in 16 bits or not.
fn found_beside(
    reference: Option<(String, bool)>,
    study: &Study,
    limits: StudyLimits,
) -> StudyReport {
    let machine =
        Machine { cpu: String::new(), cores: 1, isa: String::new(), versions: Default::default() };
    let subject = StudyNames {
        machine,
        threads: 1,
        scene: "s".into(),
        hash: String::new(),
        size: [WIDTH as u32, (PIXELS / WIDTH) as u32],
        backends: vec!["b".into()],
        reference,
    };
    report(study, subject, limits, 1.0)
}

#[test]
fn known_slopes_ratios_and_errors_are_found() {
    let (study, ..) = run_all(&grid(), limits(100.0), 1e-3);
    let report = found(&study, limits(100.0));
    assert_eq!(report.points.len(), 16);
    assert_eq!(report.left_out, [""; 0]);
    for point in report.points.iter().filter(|p| !p.at_floor) {
        let power = if point.sampler == "sobol" { -0.75 } else { -0.5 };
        let expected = (point.samples as f64).powf(power) / 12f64.sqrt();
        assert!((point.rmse.value / expected - 1.0).abs() < 0.03, "{point:?}");
        let error = point.rmse.standard_error.unwrap();
        // The mean square of n = 3 x 9216 uniform numbers varies by 0.9 / sqrt(n).
        assert!(error > 0.0 && error < 0.01 * expected, "{point:?}");
        assert!(point.not_antialiased == (point.spp == 1));
    }
    let slopes: Vec<_> = report.series.iter().filter_map(|s| Some((s, s.slope?))).collect();
    assert!(slopes.len() >= 4, "{:?}", report.series);
    for (series, slope) in slopes {
        let expected = if series.sampler == "sobol" { -0.75 } else { -0.5 };
        assert!((slope.slope - expected).abs() < 0.02, "{series:?}");
        assert!(slope.standard_error < 0.02);
        assert!(series.points.iter().all(|&i| report.points[i].spp > 1 || series.fixed == "1 spp"));
    }
    for ratio in &report.ratios {
        let expected = (ratio.samples as f64).powf(0.25);
        assert!((ratio.rmse.value / expected - 1.0).abs() < 0.05, "{ratio:?}");
    }
    // Sobol is never slower and never worse here.
    assert!(report.front.iter().all(|&i| report.points[i].sampler == "sobol"));
    let reached = &report.reached[0];
    assert_eq!(report.points[reached.point].sampler, "sobol");
    let others = reached.others.iter().map(|&i| report.points[i].sampler.as_str());
    assert_eq!(others.collect::<Vec<_>>(), ["random"]);
}

#[test]
fn the_reference_has_more_samples_than_the_grid_and_a_known_error() {
    let (study, jobs, _) = run_all(&grid(), limits(100.0), 1e-3);
    let passes: Vec<&StudyRender> =
        jobs.iter().filter(|j| j.purpose == Purpose::Reference).collect();
    assert_eq!((passes.len(), study.passes.count), (4, 4));
    assert!(passes.iter().all(|job| job.setting.samples() > 256 && job.setting.spp > 1));
    let mut seeds: Vec<i64> = passes.iter().map(|job| job.seed).collect();
    let points = jobs.iter().filter(|job| matches!(job.purpose, Purpose::Point(_)));
    seeds.extend(points.map(|job| job.seed).take(1));
    seeds.sort_unstable();
    seeds.dedup();
    assert_eq!(seeds.len(), 5, "independent of each other and of what is measured");
    let expected = (passes[0].setting.samples() as f64).powf(-1.5) / 12.0 / 4.0;
    let floor = study.reference.unwrap().floor.unwrap();
    assert!((floor.mse / expected - 1.0).abs() < 0.1, "{floor:?} {expected}");
}

/// The error of the reference is independent, so its square adds to those of all points.
#[test]
fn slopes_and_ratios_are_those_without_the_error_of_the_reference() {
    let (mut study, ..) = run_all(&grid(), limits(100.0), 1e-3);
    let set = |study: &mut Study, mse: f64| {
        let floor = study.reference.as_mut().and_then(|reference| reference.floor.as_mut());
        floor.expect("a reference").mse = mse;
    };
    set(&mut study, 0.0);
    let alone = found(&study, limits(100.0));
    let errors = || alone.points.iter().map(|point| point.rmse.value.powi(2));
    // Just too small to put a point at the floor.
    let floor = 0.1 * errors().fold(f64::INFINITY, f64::min);
    set(&mut study, floor);
    study.points.iter_mut().flat_map(|point| &mut point.errors).for_each(|e| e.mse += floor);
    let beside = found(&study, limits(100.0));
    assert!(beside.points.iter().all(|point| !point.at_floor));
    assert!(!alone.ratios.is_empty() && alone.ratios.len() == beside.ratios.len());
    for (a, b) in alone.ratios.iter().zip(&beside.ratios) {
        assert!((a.rmse.value / b.rmse.value - 1.0).abs() < 1e-9, "{a:?} {b:?}");
    }
    let slopes = |report: &StudyReport| -> Vec<f64> {
        report.series.iter().filter_map(|series| Some(series.slope?.slope)).collect()
    };
    let (alone, beside) = (slopes(&alone), slopes(&beside));
    assert!(alone.len() >= 4 && alone.len() == beside.len());
    for (a, b) in alone.into_iter().zip(beside) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

#[test]
fn rounds_run_forwards_and_backwards_with_their_own_seeds() {
    let (_, jobs, _) = run_all(&grid(), limits(100.0), 1e-3);
    let order = jobs.iter().filter_map(|job| match job.purpose {
        Purpose::Point(index) => Some((index, job.seed)),
        _ => None,
    });
    let order: Vec<_> = order.collect();
    let round = |seed: i64| -> Vec<usize> {
        order.iter().filter(|(_, s)| *s == seed).map(|(i, _)| *i).collect()
    };
    assert_eq!(order.len(), 48);
    assert_eq!(round(5), (0..16).collect::<Vec<_>>());
    assert_eq!(round(6), (0..16).rev().collect::<Vec<_>>());
}

#[test]
fn expensive_settings_are_left_out_to_keep_the_budget() {
    for budget in [1.0, 3.0, 10.0] {
        let (study, _, took) = run_all(&grid(), limits(budget), 1e-3);
        assert!(took <= budget, "{took} of {budget}");
        let report = found(&study, limits(budget));
        assert!(!report.points.is_empty());
        let all = report.points.len() + report.left_out.len();
        assert_eq!(all, 16);
        let work = |p: &StudyPoint| p.setting.work();
        let out = study.points.iter().filter(|p| p.errors.is_empty()).map(work);
        let kept = study.points.iter().filter(|p| !p.errors.is_empty()).map(work);
        let most = kept.fold(0.0, f64::max);
        assert!(out.fold(f64::INFINITY, f64::min) >= most, "the cheapest come first");
    }
    let (short, ..) = run_all(&grid(), limits(1.0), 1e-3);
    assert!(!found(&short, limits(1.0)).left_out.is_empty());
    // Without time the study ends without a point.
    let (none, jobs, _) = run_all(&grid(), limits(1e-9), 1.0);
    assert!(none.points.iter().all(|p| p.errors.is_empty()) && jobs.len() <= 1);
}

#[test]
fn a_given_reference_is_not_rendered() {
    let values = vec![1.0; 3 * PIXELS];
    let reference = ReferencePicture { values, floor: None };
    let mut study = Study::new(grid(), limits(100.0), WIDTH, Some(reference));
    let mut now = 0.0;
    while let Some(job) = study.next(now) {
        assert_ne!(job.purpose, Purpose::Reference);
        now += 1e-3;
        study.take(&job, &render(&job), 1, 1e-3);
    }
    let report = found(&study, limits(100.0));
    assert_eq!((report.reference.passes, report.reference.rmse), (None, None));
    let sobol = report.series.iter().find(|s| s.sampler == "sobol").unwrap();
    assert!((sobol.slope.unwrap().slope + 0.75).abs() < 0.01);
}

#[test]
fn a_bias_by_rounding_the_reference_is_no_other_scene() {
    let grid = StudyGrid {
        samplers: vec![SamplerKind::Sobol],
        spp: vec![1024, 4096],
        light_samples: vec![None],
        ..grid()
    };
    // Half floats above 1 are 2^-10 apart.
    let rounding = 0.9 * 2f64.powi(-11);
    for (bias, half, told) in
        [(rounding, true, false), (rounding, false, true), (2f64.powi(-10), true, true)]
    {
        let values = vec![(1.0 + bias) as f32; 3 * PIXELS];
        let reference = ReferencePicture { values, floor: None };
        let mut study = Study::new(grid.clone(), limits(100.0), WIDTH, Some(reference));
        let mut now = 0.0;
        while let Some(job) = study.next(now) {
            now += 1e-3;
            study.take(&job, &render(&job), 1, 1e-3);
        }
        let file = Some(("r.exr".to_string(), half));
        let common = found_beside(file, &study, limits(100.0)).common_bias();
        assert_eq!(common.is_some(), told, "{bias} {half}: {common:?}");
    }
}
