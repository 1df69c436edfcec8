//! Formats the results of `crosscheck` for the terminal.

use std::fmt::Write;

use crate::lab::answer::Answer;
use crate::lab::crosscheck::{CrosscheckReport, Finding, TreeReport, VerdictCounts};
use crate::lab::verdict::{MAX_NEAR, Verdict};

use crate::units;

/// Maximum number of findings that are shown.
const MAX_FINDINGS: usize = 12;

/// Formats the whole report.
pub fn report(report: &CrosscheckReport) -> String {
    let mut out = format!(
        "{}, {}, seed {}; the oracle is `brute`; bvh and embree answer each ray in a packet and alone\n",
        units::plural(report.rays as usize, "ray"),
        units::plural(report.primitives as usize, "primitive"),
        report.seed
    );
    for backend in &report.backends {
        let bound = match backend.bound {
            0.0 => "exact".to_string(),
            bound => format!("bound {bound}"),
        };
        let _ = writeln!(
            out,
            "\n{} ({}, {}; {bound})\n{}",
            backend.backend, backend.version, backend.isa, HEADING
        );
        for (i, (source, counts)) in backend.sources.iter().enumerate() {
            out += &row(source, counts, backend.allowed.get(i).copied());
        }
        out += &row("all", &backend.total, None);
        let crowd = backend.total.of[&Verdict::Crowd];
        if crowd > 0 {
            let _ = writeln!(
                out,
                "  {} from the oracle's without being judged: the ray passes within the bound of more \
                 than {MAX_NEAR} primitives",
                units::counted(crowd, ["answer differs", "answers differ"])
            );
        }
    }
    match &report.tree {
        Some(TreeReport::Valid(what)) => out += &format!("\nthe tree of bvh is valid: {what}\n"),
        Some(TreeReport::Invalid(what)) => {
            out += &format!("\nthe tree of bvh is INVALID: {what}\n")
        }
        None => {}
    }
    if let Some(all) = report.plain_loop {
        let _ = writeln!(
            out,
            "\ncoursework against the plain loop over its own tests: {} rays, {} wrong",
            units::count(all.rays),
            units::count(all.wrong)
        );
    }
    for picture in &report.pictures {
        let [a, b] = &picture.backends;
        let _ = writeln!(
            out,
            "picture of {b} against {a}: {:.4}% of {} pixels the same; of the rest {} at outlines, \
             {} by wrong rays of {a}, {} of {b}, {} unexplained, {} not looked into",
            // Rounded down: 100% means all.
            (1e6 * picture.same as f64 / picture.pixels.max(1) as f64).floor() / 1e4,
            units::count(picture.pixels),
            units::count(picture.explained),
            units::count(picture.wrong[0]),
            units::count(picture.wrong[1]),
            units::count(picture.unexplained),
            units::count(picture.not_looked_into),
        );
    }
    if !report.findings.is_empty() {
        out += "\nWrong answers, the first of each kind and class of rays:\n";
    }
    for found in report.findings.iter().take(MAX_FINDINGS) {
        out += &finding(found, found.verdict, found.answer, found.truth);
    }
    if report.findings.len() > MAX_FINDINGS {
        let _ =
            writeln!(out, "and {} more in --save or --json", report.findings.len() - MAX_FINDINGS);
    }
    out
}

const HEADING: &str = "  rays             answers      agree       tie      edge     crowd      leak \
                       false hit  wrong prim  wrong dist  wrong / known";

fn row(name: &str, counts: &VerdictCounts, known: Option<u64>) -> String {
    let mut line = format!("  {name:<14}{:>10}", counts.rays);
    for (verdict, width) in Verdict::ALL.into_iter().zip([10, 9, 9, 9, 9, 9, 11, 11]) {
        line += &format!(" {:>width$}", counts.of[&verdict]);
    }
    if let Some(most) = known {
        line += &format!(" {:>6} / {most}", counts.wrong());
    }
    line + "\n"
}

/// Formats one wrong answer, or the result of its replay.
pub fn finding(found: &Finding, verdict: Verdict, answer: Answer, truth: Answer) -> String {
    format!(
        "  {} {}: {} ({}, {}{:?}): says {}, the {} {}\n",
        found.backend,
        if verdict.is_wrong() { "wrong" } else { "right" },
        verdict.name(),
        found.source,
        if found.shadow { "shadow, " } else { "" },
        found.mode,
        answer_text(answer),
        found.against,
        answer_text(truth),
    )
}

fn answer_text(answer: Answer) -> String {
    match answer {
        Answer::Miss => "nothing".into(),
        Answer::Occluded => "occluded".into(),
        Answer::Hit { geom, prim, t } => format!("primitive {prim} of geometry {geom} at t {t}"),
    }
}
