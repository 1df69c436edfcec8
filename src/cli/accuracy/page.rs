//! Report page of `accuracy`, with pictures of the failures.

use crate::lab::accuracy::{AccuracyReport, BackendCounts, CaseResult, ColumnReport, WrongKind};
use crate::report::{Bar, BarGroup, Bars, Cell, Page, Section, picture};
use crate::units;

use super::{markdown, table};

/// Title of the table of ties.
const TIES: &str = "Ties: equally near, not the lowest index, of backends that do not promise it";

/// Builds the page of a report.
pub fn page(report: &AccuracyReport) -> Page {
    let mut sections = vec![overview(report)];
    sections.extend(report.groups().map(|rows| section(report, rows)));
    sections.push(columns(report));
    sections.extend(report.groups().filter_map(pictures));
    Page { title: "Accuracy of every backend".into(), intro: markdown::machine(report), sections }
}

/// Builds the table of failures per million by group, and a chart of the rays at vertices.
fn overview(report: &AccuracyReport) -> Section {
    let failures = report.failures();
    let mut findings: Vec<(String, bool)> =
        failures.iter().map(|failure| (failure.clone(), true)).collect();
    if failures.is_empty() {
        let names = report.columns.iter().filter(|column| column.must_be_right);
        let names: Vec<&str> = names.map(|column| column.name.as_str()).collect();
        findings.push((format!("{}: every mark holds.", names.join(", ")), false));
    }
    let mut rows = vec![head("failures per million answers", report, &[])];
    for group in report.groups() {
        let mut cells: Vec<Cell> = vec![group[0].group.as_str().into()];
        for (index, column) in report.columns.iter().enumerate() {
            let (mut failed, mut rays, mut missed) = (0, 0, false);
            for entry in group.iter().map(|row| &row.entries[index]) {
                (failed, rays) = (failed + entry.failed, rays + entry.rays);
                missed |= entry.missed.is_some();
            }
            let wrong = missed || (failed > 0 && !column.must_be_right);
            cells.push(Cell { text: table::per_million(failed, rays), wrong });
        }
        rows.push(cells);
    }
    Section {
        title: "Overview".into(),
        findings,
        charts: vec![vertices(report)],
        tables: vec![("Failures per million answers, by group".into(), rows)],
        ..Section::default()
    }
}

fn vertices(report: &AccuracyReport) -> String {
    let aimed = report.rows.iter().filter(|row| row.name.ends_with(", at vertices"));
    let groups = aimed.map(|row| BarGroup {
        label: row.name.trim_end_matches(", at vertices").into(),
        bars: row
            .entries
            .iter()
            .zip(&report.columns)
            .filter(|(_, c)| is_fast(c))
            .map(|(e, _)| bar(e))
            .collect(),
    });
    Bars {
        title: "Rays at shared vertices of closed meshes that slip through".into(),
        unit: "per million, less is better".into(),
        names: report.columns.iter().filter(|c| is_fast(c)).map(|c| c.name.clone()).collect(),
        groups: groups.collect(),
    }
    .svg()
}

/// Returns true for the backends that trace the most rays, which the chart shows.
fn is_fast(column: &ColumnReport) -> bool {
    column.name.starts_with("embree") || column.name.starts_with("bvh")
}

fn bar(entry: &BackendCounts) -> Bar {
    let value = match entry.rays {
        0 => f64::NAN,
        rays => entry.failed as f64 * 1e6 / rays as f64,
    };
    let wrong = entry.missed.as_ref().map(|_| "misses its mark".to_string());
    Bar { value, interval: None, wrong }
}

fn head(first: &str, report: &AccuracyReport, last: &[&str]) -> Vec<Cell> {
    let names = report.columns.iter().map(|column| column.name.as_str());
    [first].into_iter().chain(names).chain(last.iter().copied()).map(Cell::from).collect()
}

fn section(report: &AccuracyReport, rows: &[CaseResult]) -> Section {
    let mut failures = vec![head("wrong per million", report, &["most answers", "mark"])];
    let mut ties = vec![head("ties", report, &[])];
    let mut ulps = vec![head("worst error of t in f32 ulp", report, &[])];
    let mut relatives = vec![head("worst relative distance of the refined point", report, &[])];
    let mut within = vec![head("within the bound of the backend's own test", report, &[])];
    let mut times = vec![head("seconds in the backend, all threads", report, &["whole case"])];
    let mut cases = vec![["case", "what"].map(Cell::from).to_vec()];
    for row in rows {
        let cells = |of: &dyn Fn(&BackendCounts) -> Cell| -> Vec<Cell> {
            [row.name.as_str().into()].into_iter().chain(row.entries.iter().map(of)).collect()
        };
        let mut line = cells(&|entry| Cell { text: table::rate(entry), wrong: entry.failed > 0 });
        line.extend([units::count(row.rays).into(), row.mark.as_str().into()]);
        failures.push(line);
        if row.entries.iter().any(|entry| entry.ties > 0) {
            ties.push(cells(&|entry| units::count(entry.ties).into()));
        }
        ulps.push(cells(&|entry| Cell {
            text: table::ulp(entry.worst_ulp),
            wrong: entry.beyond_8_ulp > 0,
        }));
        relatives.push(cells(&|entry| table::relative(entry.worst_relative).into()));
        within.push(cells(&|entry| units::count(entry.within_bound + entry.counted).into()));
        let mut line = cells(&|entry| format!("{:.3}", entry.seconds).into());
        line.push(format!("{:.2}", row.seconds).into());
        times.push(line);
        let note = row.note.as_ref().map_or(String::new(), |note| format!("; {note}"));
        cases.push(vec![row.name.as_str().into(), format!("{}{note}", row.what).into()]);
    }
    let mut tables = vec![("Wrong answers per million of the backend's own".into(), failures)];
    if ties.len() > 1 {
        tables.push((TIES.into(), ties));
    }
    tables.extend([
        ("Worst error of t, in f32 ulp".to_string(), ulps),
        ("Worst relative distance of the refined point".into(), relatives),
        ("Unlike the exact answer within the bound, or counted only".into(), within),
        ("Time".into(), times),
        ("What is traced".into(), cases),
    ]);
    Section { title: rows[0].group.clone(), tables, ..Section::default() }
}

/// Draws where the failures of a group are.
fn pictures(rows: &[CaseResult]) -> Option<Section> {
    let mut charts = Vec::new();
    for row in rows {
        for shown in &row.pictures {
            let kinds = row.entries[shown.column].failures.iter();
            let kinds: Vec<String> = kinds.map(|(kind, n)| format!("{n} {kind}")).collect();
            let caption = format!("{}; {}: {}", row.name, shown.name, kinds.join(", "));
            charts.push(picture(&shown.png, &caption));
        }
    }
    if charts.is_empty() {
        return None;
    }
    let colors = [
        (WrongKind::Leak, "red"),
        (WrongKind::FalseHit, "orange"),
        (WrongKind::WrongPrimitive, "violet"),
        (WrongKind::WrongDistance, "blue"),
        (WrongKind::Crossings, "green"),
        (WrongKind::SelfShadow, "pink"),
        (WrongKind::Pixel, "yellow"),
    ];
    let colors: Vec<String> =
        colors.iter().map(|(kind, color)| format!("{color} {}", kind.name())).collect();
    let text = format!(
        "Dots mark what the rays that fail were aimed at, at most 400: {}.",
        colors.join(", ")
    );
    Some(Section {
        title: format!("{}: where it fails", rows[0].group),
        findings: vec![(text, false)],
        charts,
        ..Section::default()
    })
}

fn columns(report: &AccuracyReport) -> Section {
    let mut rows =
        vec![["column", "what it is", "version", "instructions"].map(Cell::from).to_vec()];
    for column in &report.columns {
        let what = markdown::meaning(&column.name);
        rows.push(
            [column.name.as_str(), what, &column.version, &column.isa].map(Cell::from).to_vec(),
        );
    }
    Section {
        title: "What the columns are".into(),
        tables: vec![("Columns".into(), rows)],
        ..Section::default()
    }
}
