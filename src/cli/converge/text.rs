//! Formats the results of `converge` as sentences and tables.

use std::fmt::Write;

use crate::error::printable;
use crate::lab::converge::{MeanWithError, PointResult, Series, StudyReport};
use crate::lab::metrics::Metric;
use crate::units::plural;

use crate::cli::print::aligned;

/// Formats the whole report for the terminal.
pub fn text(report: &StudyReport) -> String {
    let mut out = format!("{}\n\n", reference(report));
    let lines = aligned(&points(report)).into_iter().chain([String::new()]);
    let lines =
        lines.chain(aligned(&series(report))).chain([String::new()]).chain(findings(report));
    for line in lines.chain(notes(report)) {
        let _ = writeln!(out, "{line}");
    }
    out
}

/// Describes the scene, the reference and the error metrics.
pub fn reference(report: &StudyReport) -> String {
    let r = &report.reference;
    let source = match (&r.file, r.spp, r.light_samples) {
        (Some(file), ..) => format!("{file}, with unknown error"),
        (None, spp, lights) => {
            format!(
                "the mean of {} of {}, itself off by RMSE {}, relmse {}",
                plural(r.passes.unwrap_or(0) as usize, "render"),
                samples(spp.unwrap_or(0), lights),
                error(r.rmse.unwrap_or(0.0)),
                error(r.relmse.unwrap_or(0.0)),
            )
        }
    };
    let half = if r.half { " and rounded to 16 bits" } else { "" };
    let [width, height] = report.size;
    let line = format!(
        "{}, {width} x {height}, {}; reference: {source}{half}; relmse: {}; RMSE: {}",
        report.scene,
        plural(report.threads, "thread"),
        Metric::Relmse.formula(),
        Metric::Rmse.formula(),
    );
    printable(&line).into_owned()
}

/// Summarises the results in sentences.
pub fn findings(report: &StudyReport) -> Vec<String> {
    let mut findings = reached(report, 4);
    for series in headline(report) {
        let Some(slope) = series.slope else { continue };
        findings.push(format!(
            "error falls as samples^{:.2} \u{b1} {:.3} ({}, {} points{})",
            slope.slope,
            slope.standard_error,
            shorter(report, &series.backend, &series.sampler),
            slope.points,
            at(series),
        ));
    }
    for name in without_slope(report) {
        findings.push(format!(
            "no slope of {name}: fewer than three of its comparable points have an error clearly above the reference's own"
        ));
    }
    let near_64 = report.ratios.iter().min_by_key(|ratio| ratio.samples.abs_diff(64));
    if let Some(ratio) = near_64 {
        let error = ratio.rmse.standard_error.map_or(String::new(), |e| format!(" \u{b1} {e:.2}"));
        let lights = ratio.light_samples.map_or(String::new(), |n| format!(" x {n} light samples"));
        findings.push(format!(
            "at {} spp{lights} RMSE(random) is {:.2}{error} times RMSE(sobol)",
            ratio.spp, ratio.rmse.value
        ));
    }
    findings
}

/// Formats lines such as `to reach relmse 1e-3: sobol, 16 spp, 0.41 s`, for the smallest errors
/// that were reached. Returns at most `most` lines.
pub fn reached(report: &StudyReport, most: usize) -> Vec<String> {
    let skip = report.reached.len().saturating_sub(most);
    let lines = report.reached.iter().skip(skip).map(|reached| {
        let point = &report.points[reached.point];
        let others = reached.others.iter().map(|&i| {
            let other = &report.points[i];
            let times = other.median_s / point.median_s;
            // The scatter of one render is not known.
            let known = point.seconds.len().min(other.seconds.len()) > 2
                && other.median_s - point.median_s > 2.0 * (other.mad_s + point.mad_s);
            let about = if known { "" } else { "about " };
            format!(
                "{}, {} s, {about}{times:.1} times as long",
                setting(report, other),
                time(other.median_s)
            )
        });
        let others: Vec<String> = others.collect();
        let others =
            if others.is_empty() { others.concat() } else { format!(" ({})", others.join("; ")) };
        let (setting, time) = (setting(report, point), time(point.median_s));
        format!("to reach relmse {:.0e}: {setting}, {time} s{others}", reached.relmse)
    });
    lines.collect()
}

/// Returns series whose slopes can be compared because they keep the same parameter fixed.
///
/// Of several such groups, returns the group with the most slopes, then with the most points, then
/// the first.
pub fn headline(report: &StudyReport) -> Vec<&Series> {
    let mut best: Vec<&Series> = Vec::new();
    let size = |of: &[&Series]| (of.len(), of.iter().map(|s| s.points.len()).sum::<usize>());
    for kind in &report.series {
        let same = |s: &&Series| s.fixed == kind.fixed && s.slope.is_some();
        let all: Vec<&Series> = report.series.iter().filter(same).collect();
        if size(&all) > size(&best) {
            best = all;
        }
    }
    best
}

/// Returns the names of backends and samplers that have no slope in [`headline`]. Empty if no
/// series has a slope.
fn without_slope(report: &StudyReport) -> Vec<String> {
    let shown = headline(report);
    if shown.is_empty() {
        return Vec::new();
    }
    let mut names: Vec<String> = Vec::new();
    for point in &report.points {
        let has = |s: &&Series| (&s.backend, &s.sampler) == (&point.backend, &point.sampler);
        let name = shorter(report, &point.backend, &point.sampler);
        if !shown.iter().any(has) && !names.contains(&name) {
            names.push(name);
        }
    }
    names
}

/// Formats the parameter that a series keeps fixed: ` at ...`, or nothing.
pub fn at(series: &Series) -> String {
    match series.fixed.as_str() {
        "" => String::new(),
        fixed => format!(" at {fixed}"),
    }
}

/// Names a setting by its sampler, and by its backend if there are several.
pub fn shorter(report: &StudyReport, backend: &str, sampler: &str) -> String {
    match report.points.iter().all(|point| point.backend == backend) {
        true => sampler.to_string(),
        false => format!("{backend} {sampler}"),
    }
}

fn setting(report: &StudyReport, point: &PointResult) -> String {
    let samples = samples(point.spp, point.light_samples);
    format!("{}, {samples}", shorter(report, &point.backend, &point.sampler))
}

/// Formats numbers of samples: `4 spp x 16 light samples`, or `4 spp` if no light has samples.
fn samples(spp: u32, lights: Option<u32>) -> String {
    let lights = lights.map(|n| format!(" x {}", plural(n as usize, "light sample")));
    format!("{spp} spp{}", lights.unwrap_or_default())
}

/// Returns notes that a reader needs to interpret the numbers.
pub fn notes(report: &StudyReport) -> Vec<String> {
    let mut notes = Vec::new();
    if let (Some(file), Some(bias)) = (&report.reference.file, report.common_bias()) {
        let note = format!(
            "warning: all settings differ from {file} by the same mean error of {bias:.2e}: it may show another scene"
        );
        notes.push(printable(&note).into_owned());
    }
    if report.reference.spp == Some(1) && report.points.iter().all(|point| point.spp == 1) {
        notes.push(
            "the reference and all settings trace one ray through each pixel's centre: errors come from the \
             light alone, not from edges"
                .into(),
        );
    }
    if report.points.iter().any(PointResult::lacks_antialiasing) {
        notes.push(
            "1 spp is not antialiased: most of its error comes from edges, and it is in no slope"
                .into(),
        );
    }
    if report.points.iter().any(|p| p.at_floor) {
        let note =
            "* the reference's own error is more than a tenth of the squared error: in no slope";
        notes.push(note.into());
    }
    if !report.left_out.is_empty() {
        let left_out = report.left_out.join("; ");
        notes.push(format!("left out to keep the budget of {} s: {left_out}", report.budget_s));
    }
    notes
}

/// Returns the table of all settings, head first. Settings on the Pareto front of time and error
/// are marked.
pub fn points(report: &StudyReport) -> Vec<Vec<String>> {
    let head =
        ["setting", "samples", "s", "MAD", "Mray", "relmse", "\u{b1}", "RMSE", "\u{b1}", "n", ""];
    let mut rows = vec![head.map(str::to_string).to_vec()];
    rows.extend(report.points.iter().enumerate().map(|(i, p)| {
        let floor = if p.at_floor { "*" } else { "" };
        let front = if report.front.contains(&i) { "front" } else { "" };
        vec![
            p.name(),
            p.samples.to_string(),
            time(p.median_s),
            if p.seconds.len() > 1 { time(p.mad_s) } else { "-".into() },
            format!("{:.2}", p.rays as f64 / 1e6),
            error(p.relmse.value) + floor,
            share(p.relmse),
            error(p.rmse.value) + floor,
            share(p.rmse),
            p.seconds.len().to_string(),
            front.into(),
        ]
    }));
    rows
}

/// Returns the table of all slopes, head first; empty if there is no slope.
pub fn series(report: &StudyReport) -> Vec<Vec<String>> {
    let head = ["RMSE ~ samples^slope", "of", "slope", "\u{b1}", "points"];
    let mut rows = vec![head.map(str::to_string).to_vec()];
    rows.extend(report.series.iter().filter_map(|series| {
        let slope = series.slope?;
        Some(vec![
            format!("{}, {}", series.backend, series.sampler),
            series.fixed.clone(),
            format!("{:.3}", slope.slope),
            format!("{:.3}", slope.standard_error),
            slope.points.to_string(),
        ])
    }));
    if rows.len() == 1 { Vec::new() } else { rows }
}

/// Formats all settings as CSV.
pub fn csv(report: &StudyReport) -> String {
    let mut out = String::from(
        "backend,sampler,spp,light_samples,samples,renders,median_s,mad_s,rays,rmse,rmse_se,relmse,\
         relmse_se,mae,mae_se,bias,bias_se,at_floor,not_antialiased,front\n",
    );
    for (i, p) in report.points.iter().enumerate() {
        let lights = p.light_samples.map_or(String::new(), |n| n.to_string());
        let estimates = [p.rmse, p.relmse, p.mae, p.bias].map(|e| {
            let error = e.standard_error.map_or(String::new(), |error| format!("{error:e}"));
            format!("{:e},{error}", e.value)
        });
        let _ = writeln!(
            out,
            "{},{},{},{lights},{},{},{},{},{},{},{},{},{}",
            p.backend,
            p.sampler,
            p.spp,
            p.samples,
            p.seconds.len(),
            p.median_s,
            if p.seconds.len() > 1 { p.mad_s.to_string() } else { String::new() },
            p.rays,
            estimates.join(","),
            p.at_floor,
            p.not_antialiased,
            report.front.contains(&i),
        );
    }
    out
}

fn share(estimate: MeanWithError) -> String {
    let percent = |error: f64| format!("{:.1}%", 100.0 * error / estimate.value.max(1e-300));
    estimate.standard_error.map_or("-".into(), percent)
}

/// Formats an error with three digits.
pub fn error(value: f64) -> String {
    format!("{value:.2e}")
}

/// Formats a time in seconds.
pub fn time(seconds: f64) -> String {
    match seconds {
        s if s < 0.1 => format!("{s:.4}"),
        s if s < 10.0 => format!("{s:.3}"),
        s => format!("{s:.1}"),
    }
}
