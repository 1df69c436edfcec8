//! Formats the results of `accuracy` as a page of the documentation.

use std::fmt::Write;

use crate::lab::accuracy::{AccuracyReport, BackendCounts, CaseResult};

use crate::units::{self, capital};

use super::table;

/// Returns the page in Markdown.
pub fn page(report: &AccuracyReport) -> String {
    let mut text = String::from(
        "# Accuracy\n\nWritten by `lightpath accuracy --markdown`; do not edit. Rays that are hard to \
         answer are traced\nwith every backend. The numbers of the tables are wrong answers, or wrong \
         answers per million (ppm).\n\n",
    );
    for line in machine(report) {
        let _ = writeln!(text, "- {line}");
    }
    text += "\n## What the columns are\n\n| column | what it is | version | instructions |\n|---|---|---|---|\n";
    for column in &report.columns {
        let (name, what) = (&column.name, meaning(&column.name));
        let _ = writeln!(text, "| `{name}` | {what} | {} | {} |", column.version, column.isa);
    }
    text += HOW;
    text += "\n## Overview\n\nWrong answers per million.\n\n";
    head(&mut text, report, &["group"], &[]);
    for rows in report.groups() {
        let _ = write!(text, "| {} |", rows[0].group);
        for index in 0..report.columns.len() {
            let sum = |of: fn(&BackendCounts) -> u64| {
                rows.iter().map(|row| of(&row.entries[index])).sum()
            };
            let _ = write!(text, " {} |", table::per_million(sum(|e| e.failed), sum(|e| e.rays)));
        }
        text.push('\n');
    }
    for rows in report.groups() {
        section(&mut text, report, rows);
    }
    text
}

/// How answers are judged: a section of the page.
const HOW: &str = "
Each packet of 16 rays is traced as a packet and again ray by ray, so each ray counts twice. One packet in four
is an occlusion query. `coursework` and `brute` are slow and get fewer rays: compare rates, not numbers.

**The oracle** decides without rounding whether a ray hits, and which hit is nearest: by determinants in f64 with
a proved bound, and by integers where the bound does not decide. Every backend gets the same f32 vertices and
rays. The oracle's t has a relative error of at most 2^-40; that of a sphere comes from roots computed in integers.
Rays from within a closed mesh need no oracle: each must hit it.

**Wrong answers.** The rounding of an intersection test acts as if the triangle's corners moved. So a ray near an
outline may pass on its other side. Such an answer is not wrong if corners within the test's error bound explain it.
The bound is 6u max|v - o|, with u = 2^-24, the corners v and the ray's origin o. Embree publishes none and gets
four times that; `brute` gets 0. In the tables these answers are *counted*. Triangles that share an edge have its
corners in common, and these move together. So the bound excuses no gap between them. Nor does it in `origin on a
surface`: a ray must not hit the surface that it starts on. In other rows, such a hit at t = 0 is within the bound.
Of equally near hits, `bvh` and `brute` promise the lowest index. Another choice of another backend is a *tie*, not
wrong.

**ulp** is the largest error of t in units of the last place of the exact t. After the program has computed the
hit's point again, in f64 from the primitive, it stores the point as f32. **relative** is the largest error of its
coordinates, divided by the largest of: the point's coordinates, the primitive's coordinates, and the distance from
the ray's origin. Both count only hits of the right primitive. A row that bounds t for a share of the hits demands
2^-23, relative, for the same share of the points.
";

/// Returns lines about the machine and the size of the run.
pub fn machine(report: &AccuracyReport) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(m) = &report.machine {
        let versions = m.versions.iter().filter(|(name, _)| *name != "commit");
        let versions: Vec<String> = versions.map(|(name, v)| format!("{name} {v}")).collect();
        lines.push(format!(
            "{}, {}, best instruction set {}; {}",
            m.cpu,
            units::plural(m.cores, "processor"),
            m.isa,
            versions.join(", ")
        ));
    }
    let (cases, times, seed) = (report.rows.len(), report.times, report.seed);
    lines.push(format!(
        "{}, {} answers judged: {times} times the rays of `--quick`, seed {seed}",
        units::plural(cases, "case"),
        units::count(report.answers())
    ));
    lines
}

/// Returns the description of the backend `name`.
pub fn meaning(name: &str) -> &'static str {
    match name {
        "embree" => "Intel Embree with `RTC_SCENE_FLAG_ROBUST`, packets of 16 and single rays",
        "embree-fast" => {
            "`embree` without that flag, which is Embree's default; `--fast` in `render`"
        }
        "embree-compact" => "`embree` with `RTC_SCENE_FLAG_COMPACT`: half the memory",
        "coursework" => {
            "the tree and tests of the first version, in f64; in `contact` with its fixed offset of ray origins, 1e-4"
        }
        "brute" => "every primitive by exact predicates: the oracle itself, t rounded to f32",
        name if name.starts_with("bvh") => {
            "lightpath's own tree, exactly watertight, in one instruction set"
        }
        _ => "a backend",
    }
}

fn head(text: &mut String, report: &AccuracyReport, first: &[&str], last: &[&str]) {
    let names = report.columns.iter().map(|column| format!("`{}`", column.name));
    let first = first.iter().map(ToString::to_string);
    let cells: Vec<String> =
        first.chain(names).chain(last.iter().map(ToString::to_string)).collect();
    let _ = writeln!(text, "| {} |\n|{}", cells.join(" | "), "---|".repeat(cells.len()));
}

fn section(text: &mut String, report: &AccuracyReport, rows: &[CaseResult]) {
    let _ = writeln!(text, "\n## {}\n", capital(&rows[0].group));
    head(text, report, &["case", "answers"], &["`bvh` and `brute` pass if"]);
    for row in rows {
        let _ = write!(text, "| {} | {} |", row.name, units::count(row.rays));
        for entry in &row.entries {
            let _ = write!(text, " {} |", failures(entry));
        }
        let _ = writeln!(text, " {} |", row.mark);
    }
    if rows.iter().any(|row| row.entries.iter().any(|entry| entry.measured > 0)) {
        text.push_str(
            "\nWorst error of t in ulp, and worst relative distance of the refined point:\n\n",
        );
        head(text, report, &["case"], &[]);
        for row in rows.iter().filter(|row| row.entries.iter().any(|e| e.measured > 0)) {
            let _ = write!(text, "| {} |", row.name);
            for entry in &row.entries {
                let (u, r) = (table::ulp(entry.worst_ulp), table::relative(entry.worst_relative));
                let coarse = match entry.beyond_8_ulp {
                    0 => String::new(),
                    n => format!(" ({} ppm beyond 8 ulp)", table::per_million(n, entry.measured)),
                };
                let _ = write!(text, " {u}{coarse}, {r} |");
            }
            text.push('\n');
        }
    }
    text.push('\n');
    for row in rows {
        let _ = write!(text, "- **{}**: {}.", row.name, row.what);
        if let Some(note) = &row.note {
            let _ = write!(text, " {}.", capital(note));
        }
        text.push('\n');
    }
}

/// Formats the number of wrong answers, their rate, the number of ties, and the number of answers
/// that only the error bound makes right.
fn failures(entry: &BackendCounts) -> String {
    let total = table::failures(entry);
    let rate = match entry.failed {
        0 => String::new(),
        failed => format!(" ({} ppm)", table::per_million(failed, entry.rays)),
    };
    let counted = match entry.counted {
        0 => String::new(),
        n => format!("; {} counted", units::count(n)),
    };
    let ties = match entry.ties {
        0 => String::new(),
        n => format!("; {}", units::counted(n, ["tie", "ties"])),
    };
    format!("{total}{rate}{ties}{counted}")
}
