//! Formats the results of `crosscheck` for the terminal.

use std::fmt::Write;

use crate::lab::{
    answer::Answer,
    crosscheck::{CrosscheckReport, Finding, Tree, VerdictCounts},
    verdict::{MAX_NEAR, Verdict},
};

use crate::units;

/// Maximum number of findings that are shown.
const MAX_FINDINGS: usize = 12;

/// Formats the whole report.
pub fn report(report: &CrosscheckReport) -> String {
    let mut out = format!(
        "{} rays, {} primitives, seed {}; the oracle is `brute`\n",
        units::count(report.rays),
        units::count(report.primitives),
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
        for (i, (source, tally)) in backend.sources.iter().enumerate() {
            out += &row(source, tally, backend.allowed.get(i).copied());
        }
        out += &row("all", &backend.total, None);
        if backend.total.crowd > 0 {
            let _ = writeln!(
                out,
                "  {} answers differ from the oracle's but are not judged: the ray passes within the bound of more \
                 than {MAX_NEAR} primitives",
                units::count(backend.total.crowd)
            );
        }
    }
    match &report.tree {
        Some(Tree::Valid(what)) => out += &format!("\nthe tree of bvh is valid: {what}\n"),
        Some(Tree::Invalid(what)) => out += &format!("\nthe tree of bvh is INVALID: {what}\n"),
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
            100.0 * picture.same as f64 / picture.pixels as f64,
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

const HEADING: &str = "  rays                 all      agree       tie      edge     crowd      leak \
                       false hit  wrong prim  wrong dist  wrong / known";

fn row(name: &str, tally: &VerdictCounts, known: Option<u64>) -> String {
    let VerdictCounts { rays, agree, tie, edge, crowd, .. } = tally;
    let VerdictCounts { leak, false_hit, wrong_primitive, wrong_distance, .. } = tally;
    let known = known.map_or(String::new(), |most| format!("{:>6} / {most}", tally.wrong()));
    let line = format!(
        "  {name:<14}{rays:>10} {agree:>10} {tie:>9} {edge:>9} {crowd:>9} {leak:>9} {false_hit:>9} \
         {wrong_primitive:>11} {wrong_distance:>11} {known}"
    );
    format!("{}\n", line.trim_end())
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
