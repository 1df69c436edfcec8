//! Formats the results of `accuracy` as table cells and lines of text.

use crate::lab::accuracy::{AccuracyReport, AccuracySettings, BackendCounts, CaseResult};

use crate::units;

/// Width of the case names on the terminal.
const NAME: usize = 40;

/// Formats a number of failures: `0`, `1,234`, or `-` without rays. ` MISSED` follows if the
/// backend misses the mark of the case.
pub fn failures(entry: &BackendCounts) -> String {
    let missed = if entry.missed.is_some() { " MISSED" } else { "" };
    if entry.rays == 0 { "-".into() } else { format!("{}{missed}", units::count(entry.failed)) }
}

/// Formats the rate of wrong answers among the backend's own answers: `9,514` per million, or `-`
/// without rays. ` MISSED` follows as for [`failures`].
pub fn rate(entry: &BackendCounts) -> String {
    let missed = if entry.missed.is_some() { " MISSED" } else { "" };
    match entry.rays {
        0 => "-".into(),
        rays => format!("{}{missed}", per_million(entry.failed, rays)),
    }
}

/// Formats failures per million: `0`, `9,514`, `0.3`, `4e-3`.
pub fn per_million(failed: u64, rays: u64) -> String {
    let rate = failed as f64 * 1e6 / rays.max(1) as f64;
    match rate {
        0.0 => "0".into(),
        ..0.05 => format!("{rate:.0e}"),
        ..10.0 => format!("{rate:.1}"),
        _ => units::count(rate.round() as u64),
    }
}

/// Formats an error in ulp: `0.50`, `1.2e4`.
pub fn ulp(value: Option<f64>) -> String {
    match value {
        None => "-".into(),
        Some(value) if value < 1000.0 => format!("{value:.2}"),
        Some(value) => format!("{value:.1e}"),
    }
}

/// Formats a relative error: `5.9e-8`.
pub fn relative(value: Option<f64>) -> String {
    value.map_or("-".into(), |value| format!("{value:.1e}"))
}

/// Returns the largest value over the tiers of `bvh`, or over all backends if none is `bvh`.
pub fn worst(
    names: &[String],
    row: &CaseResult,
    of: fn(&BackendCounts) -> Option<f64>,
) -> Option<f64> {
    let ours = |name: &&String| name.starts_with("bvh");
    let any = names.iter().any(|name| ours(&name));
    let entries = names.iter().zip(&row.entries).filter(|(name, _)| ours(name) || !any);
    entries.filter_map(|(_, entry)| of(entry)).reduce(f64::max)
}

fn names(settings: &AccuracySettings) -> Vec<String> {
    settings.tested_backends.iter().map(|backend| backend.name.clone()).collect()
}

fn width(name: &str) -> usize {
    name.len().max(9)
}

/// Formats the head of the table.
pub fn heading(settings: &AccuracySettings) -> String {
    let mut line = format!("{:<NAME$} {:>11}", "wrong answers per million", "answers");
    for name in names(settings) {
        line += &format!(" {name:>0$}", width(&name));
    }
    line + &format!(" {:>8} {:>8} {:>8}\n", "ulp", "relative", "time")
}

/// Formats one row. `first` adds the name of its group.
pub fn line(settings: &AccuracySettings, row: &CaseResult, first: bool) -> String {
    let names = names(settings);
    let mut line = if first { format!("{}\n", row.group) } else { String::new() };
    let indent = NAME - 2;
    line += &format!("  {:<indent$} {:>11}", row.name, units::count(row.rays));
    for (name, entry) in names.iter().zip(&row.entries) {
        line += &format!(" {:>1$}", rate(entry), width(name));
    }
    let (u, r) = (worst(&names, row, |e| e.worst_ulp), worst(&names, row, |e| e.worst_relative));
    line += &format!(" {:>8} {:>8} {:>6.2} s\n", ulp(u), relative(r), row.seconds);
    let ties = names.iter().zip(&row.entries).filter(|(_, entry)| entry.ties > 0);
    let ties: Vec<String> =
        ties.map(|(name, entry)| format!("{name} {}", units::count(entry.ties))).collect();
    if !ties.is_empty() {
        line += &format!("    ties, not wrong: {}\n", ties.join(", "));
    }
    if let Some(note) = &row.note {
        line += &format!("    {note}\n");
    }
    line
}

/// Formats the summary below the table.
pub fn summary(report: &AccuracyReport) -> String {
    let seconds: f64 = report.rows.iter().map(|row| row.seconds).sum();
    let ours = report.columns.iter().any(|column| column.name.starts_with("bvh"));
    let mut text = format!(
        "\n{}, {} judged, {}; ulp and relative are the worst of {}\n",
        units::plural(report.rows.len(), "case"),
        units::plural(report.answers() as usize, "answer"),
        units::duration(seconds),
        if ours { "`bvh`" } else { "these backends" }
    );
    for (index, column) in report.columns.iter().enumerate() {
        let entries = report.rows.iter().map(|row| &row.entries[index]);
        let (mut rays, mut failed, mut rows, mut missed, mut ties) = (0, 0, 0, 0, 0);
        for entry in entries {
            ties += entry.ties;
            rays += entry.rays;
            failed += entry.failed;
            rows += u64::from(entry.failed > 0);
            missed += u64::from(entry.missed.is_some());
        }
        let verdict = match (column.must_be_right, missed) {
            (false, _) => String::new(),
            (true, 0) => "; holds every mark".into(),
            (true, n) => format!("; MISSES {}", units::plural(n as usize, "mark")),
        };
        let ties = match ties {
            0 => String::new(),
            n => format!("; {}, not wrong", units::counted(n, ["tie", "ties"])),
        };
        text += &format!(
            "  {} ({}, {}): {} of {} answers fail, in {}{ties}{verdict}\n",
            column.name,
            column.version,
            column.isa,
            units::count(failed),
            units::count(rays),
            units::plural(rows as usize, "case"),
        );
    }
    text
}
