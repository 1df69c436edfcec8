//! Formats the results of `bench` as lines of text.

use std::collections::BTreeSet;

use crate::cli::print::aligned;
use crate::error::printable;
use crate::lab::baseline::{BaselineComparison, Change};
use crate::lab::growth::{Growth, Quantity};
use crate::lab::result::{
    BenchReport, OTHER_RUN, SAME_RUN, SceneResult, TimingEntry, TimingRow, WorkKind,
};
use crate::lab::stats::Estimate;
use crate::units;

/// Formats the results of one scene.
pub fn scene(scene: &SceneResult) -> String {
    let name = printable(&scene.name);
    let mut lines =
        vec![format!("{name}: {}", units::plural(scene.triangles as usize, "triangle"))];
    let rays = scene.rays.iter().map(|(class, n)| match n {
        0 => format!("no {class}"),
        n => format!("{} {class}", units::count(*n)),
    });
    lines.push(format!("rays: {}", rays.collect::<Vec<_>>().join(", ")));
    lines.push(String::new());
    lines.extend(aligned(&backends(scene)));
    for threads in threads(scene) {
        lines.push(String::new());
        lines.extend(aligned(&timings(scene, threads)));
    }
    lines.push(String::new());
    lines.extend(agreement(scene));
    lines.push(String::new());
    lines.join("\n") + "\n"
}

/// Formats the changes since the baseline.
pub fn since(since: &BaselineComparison) -> String {
    let machine_differences = since.machine_differences.iter();
    let warnings: String = machine_differences
        .map(|what| format!("baseline: NOT THE SAME MACHINE: {what}\n"))
        .collect();
    match &since.nothing_shared {
        Some(what) => warnings + &format!("baseline: {}\n", printable(what)),
        None => warnings + &changes(&since.changes),
    }
}

fn changes(changes: &[Change]) -> String {
    let head = ["since the baseline", "", "threads", "backend", "now / then", ""];
    let mut rows = vec![head.map(str::to_string).to_vec()];
    rows.extend(changes.iter().map(|change| {
        vec![
            printable(&change.scene).into_owned(),
            change.row.clone(),
            change.threads.to_string(),
            change.backend.clone(),
            ratio(&change.ratio),
            change.ratio.verdict(OTHER_RUN).to_string(),
        ]
    }));
    aligned(&rows).join("\n") + "\n"
}

/// Returns the table of growth of build time and memory with scene size, head first. Empty for one
/// scene.
pub fn growth(report: &BenchReport) -> Vec<Vec<String>> {
    let row = |fit: Growth| {
        let most = fit.points.last().map_or(0.0, |[n, _]| *n);
        Some(vec![
            quantity_name(fit.quantity).to_string(),
            fit.backend,
            format!("n^{:.3}", fit.exponent?),
            format!("{} sizes to {}", fit.points.len(), units::count(most as u64)),
        ])
    };
    let mut rows: Vec<_> = Growth::fits(report).into_iter().filter_map(row).collect();
    if !rows.is_empty() {
        rows.insert(0, ["growth", "backend", "fit", "n triangles"].map(str::to_string).to_vec());
    }
    rows
}

/// Formats [`growth`] as text; empty for one scene.
pub fn growth_text(report: &BenchReport) -> String {
    aligned(&growth(report)).iter().map(|line| format!("{line}\n")).collect()
}

/// Returns the name of a quantity for tables and charts.
pub fn quantity_name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::BuildTime => "build time",
        Quantity::Memory => "memory held",
        Quantity::Peak => "peak memory of the build",
    }
}

/// Returns the table of backends and their memory, head first.
pub fn backends(scene: &SceneResult) -> Vec<Vec<String>> {
    let head = ["backend", "version", "isa", "memory", "B/triangle", "peak", "B/triangle", "wrong"];
    let mut rows = vec![head.map(str::to_string).to_vec()];
    let per = |bytes: u64| match scene.triangles {
        0 => String::new(),
        n => format!("{:.1}", bytes as f64 / n as f64),
    };
    rows.extend(scene.backends.iter().map(|b| {
        vec![
            b.name.clone(),
            b.version.clone(),
            b.isa.clone(),
            units::bytes(b.bytes),
            per(b.bytes),
            units::bytes(b.peak_bytes),
            per(b.peak_bytes),
            wrong(b.wrong),
        ]
    }));
    rows
}

/// Returns the numbers of threads that were measured.
pub fn threads(scene: &SceneResult) -> BTreeSet<usize> {
    scene.rows.iter().map(|row| row.threads).collect()
}

/// Returns the table of timings for one number of threads, head first.
pub fn timings(scene: &SceneResult, threads: usize) -> Vec<Vec<String>> {
    let first = &scene.backends[0].name;
    let title = units::plural(threads, "thread");
    let against = format!("/ {first}");
    let head =
        [&title, "backend", "M/s", "median", "MAD", &against, "", "nodes/ray", "prims/ray", ""];
    let mut rows = vec![head.map(str::to_string).to_vec()];
    for row in scene.rows.iter().filter(|row| row.threads == threads) {
        for (i, (backend, entry)) in scene.backends.iter().zip(&row.entries).enumerate() {
            let label = if i == 0 { label(row) } else { String::new() };
            let mut cells = vec![label, backend.name.clone()];
            cells.extend(numbers(entry));
            rows.push(cells);
        }
    }
    without_empty_columns(rows)
}

/// Removes the columns that are empty below the head.
fn without_empty_columns(mut rows: Vec<Vec<String>>) -> Vec<Vec<String>> {
    let used = |c: usize| rows[1..].iter().any(|row| !row[c].is_empty());
    let used: Vec<bool> = (0..rows[0].len()).map(used).collect();
    for row in &mut rows {
        let mut keep = used.iter();
        row.retain(|_| *keep.next().unwrap_or(&true));
    }
    rows
}

/// Returns the label of a row: what it times, with the unit of its rate. The rays of a picture
/// include camera rays of blocks that are known to be empty, which are never traced.
fn label(row: &TimingRow) -> String {
    match row.what {
        WorkKind::Build => "build (triangles)".into(),
        WorkKind::Image => "image (effective rays)".into(),
        WorkKind::Rays => row.label(),
    }
}

fn numbers(entry: &TimingEntry) -> [String; 8] {
    let per_ray = |n: Option<f64>| n.map_or(String::new(), |n| format!("{n:.2}"));
    [
        format!("{:.2}", entry.rate.value),
        format!("{:.2} ms", entry.median_s.value * 1e3),
        format!("{:.1} %", 100.0 * entry.mad_s / entry.median_s.value),
        entry.ratio.map_or(String::new(), |r| ratio(&r)),
        entry.ratio.map_or(String::new(), |r| r.verdict(SAME_RUN).to_string()),
        per_ray(entry.nodes_per_ray),
        per_ray(entry.primitives_per_ray),
        match entry.wrong {
            None | Some(0) => String::new(),
            Some(n) => wrong(n),
        },
    ]
}

/// Formats a ratio with its interval: `1.160 [1.150, 1.170]`.
pub fn ratio(r: &Estimate) -> String {
    format!("{:.3} [{:.3}, {:.3}]", r.value, r.low, r.high)
}

/// Formats a number of wrong answers: `3 WRONG`.
pub fn wrong(n: u64) -> String {
    match n {
        0 => "0".into(),
        n => format!("{} WRONG", units::count(n)),
    }
}

/// Describes the rays on which two backends differ.
pub fn agreement(scene: &SceneResult) -> Vec<String> {
    let mut lines = Vec::new();
    for pair in &scene.agreement {
        let a = &pair.agreement;
        if a.disagreements() + a.tie > 0 {
            lines.push(format!(
                "{}, {}: {} and {}: {} same, {} ties, {} at another t, {} only one hits",
                pair.name,
                pair.mode,
                pair.backends[0],
                pair.backends[1],
                units::count(a.same),
                units::count(a.tie),
                units::count(a.depth),
                units::count(a.missed),
            ));
        }
    }
    if scene.agreement.is_empty() {
        lines.push("answers: not compared".into());
    } else if lines.is_empty() {
        lines.push("answers: the same for every ray".into());
    }
    lines
}
