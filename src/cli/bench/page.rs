//! Page of `bench`, with charts.

use crate::lab::baseline::BaselineComparison;
use crate::lab::growth::{Growth, Quantity};
use crate::lab::result::{
    BenchReport, OTHER_RUN, SAME_RUN, SceneResult, TimingEntry, TimingRow, WorkKind,
};
use crate::report::{
    Bar, BarGroup, Bars, Cell, ChartLine, LineChart, Page, Ratio, Ratios, Section,
};
use crate::units;

use super::super::machine;
use super::table;

/// Unit of the rate of whole pictures.
const EFFECTIVE: &str =
    "million effective rays/s (also camera rays of empty blocks, never traced), more is better";

/// Builds the page. `since` adds the changes against a baseline.
pub fn page(report: &BenchReport, since: Option<&BaselineComparison>) -> Page {
    let m = &report.machine;
    let mut sections: Vec<Section> = report.scenes.iter().map(section).collect();
    sections.extend(growth(report));
    sections.extend(since.map(baseline));
    Page {
        title: "Which backend is faster?".into(),
        intro: vec![
            format!(
                "{}, {}, {} kernels; {}",
                m.cpu,
                units::plural(m.cores, "processor"),
                m.isa,
                machine::versions(m)
            ),
            format!(
                "All backends traced the same rays in turns (A B B A). Numbers are medians; whiskers and \
                 brackets are 95 % intervals (bootstrap; of fewer than ten samples Student's t). An interval shows \
                 a difference if it lies beyond a factor of {SAME_RUN}, since a baseline {OTHER_RUN}: less may be chance."
            ),
        ],
        sections,
    }
}

fn section(scene: &SceneResult) -> Section {
    let threads = table::threads(scene);
    let mut charts = Vec::new();
    for &n in &threads {
        for other in 1..scene.backends.len() {
            charts.push(ratios(scene, n, other));
        }
    }
    for &n in &threads {
        for mode in ["single", "packets"] {
            charts.push(rates(scene, n, mode));
        }
    }
    charts.push(rest(scene, WorkKind::Build, "Build", "million triangles/s, more is better"));
    charts.push(memory(scene));
    charts.push(rest(scene, WorkKind::Image, "Whole picture", EFFECTIVE));
    charts.push(visits(scene));
    let mut tables = vec![("Backends".to_string(), cells(table::backends(scene)))];
    for &n in &threads {
        tables.push((format!("Timings, {}", count(n)), cells(table::timings(scene, n))));
    }
    let answers = table::agreement(scene).into_iter().map(|line| vec![line.into()]);
    let head = [vec!["answers of pairs, ray by ray".into()]];
    tables.push(("Answers".into(), head.into_iter().chain(answers).collect()));
    Section {
        title: format!(
            "{} \u{2013} {}",
            scene.name,
            units::plural(scene.triangles as usize, "triangle")
        ),
        findings: findings(scene),
        charts,
        tables,
        folded: false,
    }
}

fn count(threads: usize) -> String {
    units::plural(threads, "thread")
}

fn cells(rows: Vec<Vec<String>>) -> Vec<Vec<Cell>> {
    let cell = |text: String| Cell { wrong: text.ends_with("WRONG"), text };
    rows.into_iter().map(|row| row.into_iter().map(cell).collect()).collect()
}

/// Summarises the results of a scene in sentences. True marks wrong answers.
fn findings(scene: &SceneResult) -> Vec<(String, bool)> {
    let mut findings = Vec::new();
    let first = &scene.backends[0].name;
    for (i, backend) in scene.backends.iter().enumerate().skip(1) {
        let rows = scene.rows.iter().filter(|row| row.what == WorkKind::Rays);
        let ratios: Vec<_> = rows.filter_map(|row| row.entries[i].ratio).collect();
        if ratios.is_empty() {
            continue;
        }
        let n = ratios.len();
        let of = |verdict: &str| ratios.iter().filter(|r| r.verdict(SAME_RUN) == verdict).count();
        let mean = (ratios.iter().map(|r| r.value.ln()).sum::<f64>() / n as f64).exp();
        findings.push((
            format!(
                "{} against {first}: {mean:.2} times as fast on average over {n} comparisons of rays; \
                 faster in {}, slower in {}, no difference shown in {}.",
                backend.name,
                of("faster"),
                of("slower"),
                of("no difference shown"),
            ),
            false,
        ));
    }
    for backend in scene.backends.iter().filter(|backend| backend.wrong > 0) {
        let rays: u64 = scene.rays.values().sum();
        findings.push((
            format!(
                "{} gives wrong answers: {} of {} (every ray, single and in a packet). Its speed is marked red.",
                backend.name,
                units::count(backend.wrong),
                units::count(2 * rays),
            ),
            true,
        ));
    }
    if scene.backends.len() > 1 && scene.backends.iter().all(|backend| backend.wrong == 0) {
        findings.push(("No backend was found wrong on any ray.".into(), false));
    }
    findings
}

fn wrong(entry: &TimingEntry) -> Option<String> {
    entry.wrong.filter(|n| *n > 0).map(table::wrong)
}

fn ratios(scene: &SceneResult, threads: usize, other: usize) -> String {
    let [first, name] = [0, other].map(|i| &scene.backends[i].name);
    let rows = scene.rows.iter().filter(|row| row.threads == threads).filter_map(|row| {
        let entry = &row.entries[other];
        let r = entry.ratio?;
        let interval = [r.low, r.high];
        let (label, verdict) = (row.label(), r.verdict(SAME_RUN));
        Some(Ratio { label, value: r.value, interval, verdict, wrong: wrong(entry) })
    });
    let title = format!("{name} against {first}, {}", count(threads));
    let subtitle = format!("how many times as fast as {first}");
    Ratios { title, subtitle, rows: rows.collect() }.svg()
}

fn names(scene: &SceneResult) -> Vec<String> {
    scene.backends.iter().map(|backend| backend.name.clone()).collect()
}

fn group(label: String, row: &TimingRow) -> BarGroup {
    let bars = row.entries.iter().map(|entry| Bar {
        value: entry.rate.value,
        interval: Some([entry.rate.low, entry.rate.high]),
        wrong: wrong(entry),
    });
    BarGroup { label, bars: bars.collect() }
}

fn rates(scene: &SceneResult, threads: usize, mode: &str) -> String {
    let rows = scene.rows.iter();
    let rows = rows.filter(|row| row.threads == threads && row.mode == mode);
    let title = match mode {
        "single" => format!("Single rays, {}", count(threads)),
        _ => format!("Packets of 16, {}", count(threads)),
    };
    let groups = rows.map(|row| group(row.name.clone(), row)).collect();
    Bars { title, unit: "million rays/s, more is better".into(), names: names(scene), groups }.svg()
}

fn rest(scene: &SceneResult, what: WorkKind, title: &str, unit: &str) -> String {
    let rows = scene.rows.iter().filter(|row| row.what == what);
    let groups = rows.map(|row| group(count(row.threads), row)).collect();
    Bars { title: title.into(), unit: unit.into(), names: names(scene), groups }.svg()
}

fn memory(scene: &SceneResult) -> String {
    let per =
        |bytes: u64| Bar { value: bytes as f64 / scene.triangles.max(1) as f64, ..Bar::default() };
    let group = |label: &str, bars: Vec<Bar>| BarGroup { label: label.into(), bars };
    let held = scene.backends.iter().map(|b| per(b.bytes)).collect();
    let peak = scene.backends.iter().map(|b| per(b.peak_bytes)).collect();
    Bars {
        title: "Memory".into(),
        unit: "bytes per triangle, less is better".into(),
        names: names(scene),
        groups: vec![group("held", held), group("peak of build", peak)],
    }
    .svg()
}

/// Charts visited nodes and primitives per ray, for the backends that count them.
fn visits(scene: &SceneResult) -> String {
    let rows: Vec<&TimingRow> =
        scene.rows.iter().filter(|r| r.what == WorkKind::Rays && r.threads == 1).collect();
    let counted = |row: &&&TimingRow| row.entries.iter().any(|e| e.nodes_per_ray.is_some());
    let groups = rows.iter().filter(counted).flat_map(|row| {
        let group = |label: &str, value: fn(&TimingEntry) -> Option<f64>| {
            let value = |e: &TimingEntry| value(e).unwrap_or(f64::NAN);
            let bars = row.entries.iter().map(|e| Bar { value: value(e), ..Bar::default() });
            BarGroup { label: format!("{}: {label}", row.label()), bars: bars.collect() }
        };
        [group("nodes", |e| e.nodes_per_ray), group("primitives", |e| e.primitives_per_ray)]
    });
    Bars {
        title: "Visited per ray".into(),
        unit: "nodes and primitives, less is better".into(),
        groups: groups.collect(),
        names: names(scene),
    }
    .svg()
}

/// Charts build time and memory against the size of the scene, if there are several scenes.
fn growth(report: &BenchReport) -> Option<Section> {
    let chart = |quantity: Quantity| {
        let lines = Growth::of_report(report, quantity).into_iter().map(|growth| ChartLine {
            name: match growth.exponent {
                Some(exponent) => format!("{} \u{2013} n^{exponent:.2}", growth.backend),
                None => growth.backend,
            },
            points: growth.points,
        });
        let unit = match quantity {
            Quantity::BuildTime => "seconds, all threads",
            Quantity::Memory | Quantity::Peak => "bytes",
        };
        let name = table::quantity_name(quantity);
        let title = name[..1].to_uppercase() + &name[1..];
        let (unit, across) = (unit.into(), "triangles".into());
        LineChart { title, unit, across, lines: lines.collect(), ..LineChart::default() }.svg()
    };
    let charts = Quantity::ALL.map(chart).to_vec();
    let any = report.scenes.len() > 1 && charts.iter().any(|chart| !chart.is_empty());
    let tables = vec![("Fit".to_string(), cells(table::growth(report)))];
    any.then(|| Section { title: "Growth".into(), charts, tables, ..Section::default() })
}

/// Builds the section of changes since an earlier run.
fn baseline(since: &BaselineComparison) -> Section {
    let changes = &since.changes;
    let mut names: Vec<(&str, usize)> = Vec::new();
    for change in changes {
        let key = (change.scene.as_str(), change.threads);
        if !names.contains(&key) {
            names.push(key);
        }
    }
    let charts = names.iter().map(|&(scene, threads)| {
        let of = changes.iter().filter(|c| (c.scene.as_str(), c.threads) == (scene, threads));
        let rows = of.map(|c| Ratio {
            label: format!("{}: {}", c.backend, c.row),
            value: c.ratio.value,
            interval: [c.ratio.low, c.ratio.high],
            verdict: c.ratio.verdict(OTHER_RUN),
            wrong: None,
        });
        let title = format!("{scene}, {}", count(threads));
        let subtitle = "how many times as fast as then".into();
        Ratios { title, subtitle, rows: rows.collect() }.svg()
    });
    let charts: Vec<String> = charts.collect();
    let machine = since.machine_differences.iter();
    let machine = machine.map(|what| (format!("Not the same machine: {what}."), true));
    let nothing = since.nothing_shared.iter().map(|what| (format!("Found {what}."), false));
    Section {
        title: format!("Since the baseline {}", since.baseline),
        findings: machine.chain(nothing).collect(),
        charts,
        ..Section::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::result::{BackendResult, Machine, RunStamp, VERSION};

    fn scene(name: &str, triangles: u64, wrong: u64) -> SceneResult {
        let samples = |t: f64| (0..10).map(|i| t * (1.0 + 0.002 * f64::from(i))).collect();
        let row = |what, name: &str, mode: &str, first, second| {
            let samples = vec![samples(first), samples(second)];
            TimingRow::new(what, name, mode, 1, &[100_000; 2], samples)
        };
        let mut rows = vec![
            row(WorkKind::Build, "build", "", 0.01, 0.012),
            row(WorkKind::Rays, "primary", "single", 0.02, 0.015),
            row(WorkKind::Rays, "primary", "packets", 0.01, 0.01),
        ];
        rows[1].entries[1].wrong = Some(wrong);
        rows[1].entries[1].nodes_per_ray = Some(9.0);
        rows[1].entries[1].primitives_per_ray = Some(4.0);
        let backend = |name: &str, wrong| BackendResult {
            name: name.into(),
            version: "1".into(),
            isa: "AVX2".into(),
            bytes: 60 * triangles,
            peak_bytes: 100 * triangles,
            wrong,
        };
        SceneResult {
            name: name.into(),
            hash: "h".into(),
            triangles,
            rays: [("primary".to_string(), 100_000)].into(),
            backends: vec![backend("embree", 0), backend("bvh", wrong)],
            rows,
            agreement: vec![],
        }
    }

    fn html(scenes: Vec<SceneResult>) -> String {
        let machine = Machine {
            cpu: "<cpu>".into(),
            cores: 2,
            isa: "AVX2".into(),
            versions: [("rustc".to_string(), "1.85".to_string())].into(),
        };
        page(&BenchReport { version: VERSION, machine, run: RunStamp::default(), scenes }, None)
            .html()
    }

    #[test]
    fn a_page_says_who_is_faster_and_who_is_wrong() {
        let right = html(vec![scene("a", 1000, 0)]);
        assert!(right.contains("No backend was found wrong"));
        assert!(right.contains("faster in 1, slower in 0, no difference shown in 1"));
        assert!(!right.contains("WRONG") && right.contains("&lt;cpu&gt;"));
        // What may be chance has no colour in the chart either.
        let mut chance = scene("a", 1000, 0);
        let (what, samples) = (WorkKind::Rays, chance.rows[2].entries[0].seconds.clone());
        let faster = samples.iter().map(|t| t * 0.98).collect();
        chance.rows[2] =
            TimingRow::new(what, "primary", "packets", 1, &[100_000; 2], vec![samples, faster]);
        let chance = html(vec![chance]);
        let marks = |page: &str| page.matches("#1a7f4b").count();
        assert!(chance.contains("no difference shown in 1") && marks(&chance) == marks(&right));
        for title in ["bvh against embree, 1 thread", "Single rays", "Packets of 16", "Memory"] {
            assert!(right.contains(title), "{title}");
        }
        assert!(right.contains("Visited per ray") && !right.contains("Growth"));
        let wrong = html(vec![scene("a", 1000, 7)]);
        assert!(wrong.contains("bvh gives wrong answers: 7"));
        assert!(wrong.contains("7 WRONG") && wrong.contains("finding bad"));
        assert!(!wrong.contains("NaN") && !wrong.contains("inf"));
    }

    #[test]
    fn meshes_of_several_sizes_show_growth() {
        let scenes = html(vec![scene("a", 1000, 0), scene("b", 1_000_000, 0)]);
        assert!(!scenes.contains("Growth"));
        let grown = html(vec![scene("a.ply", 1000, 0), scene("b.ply", 1_000_000, 0)]);
        assert!(grown.contains("Growth") && grown.contains("Peak memory of the build"));
        assert!(grown.contains("bvh \u{2013} n^1.00") && grown.contains("memory held"));
    }
}
