//! `lightpath accuracy`: runs the hard cases on every backend; writes a table, JSON and pages.

use std::{path::PathBuf, sync::Arc};

use crate::{
    error::{Error, Kind, Problem, Result},
    files,
    lab::{
        accuracy::{self, AccuracyReport, AccuracySettings, Case},
        backend::{self, TestedBackend},
    },
    monitor::Monitor,
    output::atomic::TextFile,
    simd::Isa,
};

use super::{
    accuracy_markdown, accuracy_page, accuracy_table, args::AccuracyArgs, bench, machine, signals,
};

/// Factor from the rays of `--quick` to those of `--full`.
const FULL: u64 = 400;

/// Runs the catalogue of hard cases, or the selected ones.
pub fn run(args: &AccuracyArgs) -> Result<()> {
    let cases = cases(args.case.as_deref())?;
    not_twice(args)?;
    let monitor = Arc::new(Monitor::default());
    let settings = settings(args, &monitor)?;
    signals::watch(&monitor)?;
    let files = Files::create(args)?;
    let mut report = machine::pool(args.threads)?.install(|| {
        super::print(&accuracy_table::heading(&settings))?;
        let count = cases.len();
        let begun = |index: usize, case: &Case| {
            if settings.times > 1 && !args.quiet {
                super::note(&format!("{} of {count}: {}, {}", index + 1, case.group, case.name));
            }
        };
        let mut group = String::new();
        accuracy::run(&cases, &settings, &monitor, &begun, &mut |row| {
            let first = std::mem::replace(&mut group, row.group.clone()) != row.group;
            super::print(&accuracy_table::line(&settings, row, first))
        })
    })?;
    report.machine = Some(bench::machine(Isa::detect()));
    super::print(&accuracy_table::summary(&report))?;
    files.finish(&report)?;
    let failures = report.failures();
    if failures.is_empty() {
        return Ok(());
    }
    let problems = failures.into_iter().map(|failure| Problem::new("accuracy", failure)).collect();
    Err(Error { kind: Kind::Check, problems })
}

/// Returns the cases of the catalogue whose group or name contains `text`.
fn cases(text: Option<&str>) -> Result<Vec<Case>> {
    let mut cases = accuracy::catalogue();
    if let Some(text) = text {
        let lower = text.to_lowercase();
        cases.retain(|case| {
            format!("{}, {}", case.group, case.name).to_lowercase().contains(&lower)
        });
        if cases.is_empty() {
            let mut groups: Vec<&str> =
                accuracy::catalogue().iter().map(|case| case.group).collect();
            groups.dedup();
            let message = format!("found {text:?}, expected a part of the name of a case");
            let help = format!("groups: {}", groups.join(", "));
            return Err(Error::invalid("--case", message).help(help));
        }
    }
    Ok(cases)
}

fn settings(args: &AccuracyArgs, monitor: &Monitor) -> Result<AccuracySettings> {
    let parsed = args.backend.iter().flat_map(|name| match name.as_str() {
        "bvh" => TestedBackend::tiers().into_iter().map(Ok).collect(),
        _ => vec![TestedBackend::parse("--backend", name, Isa::detect())],
    });
    let mut tested_backends = TestedBackend::distinct("--backend", parsed)?;
    if tested_backends.is_empty() {
        let (available, without) = backend::available(TestedBackend::all(), monitor)?;
        without.iter().for_each(|line| super::note(line));
        tested_backends = available;
    }
    let times = match args.full {
        true => FULL,
        false => args.times.unwrap_or(1),
    };
    Ok(AccuracySettings { tested_backends, seed: args.seed, times, pictures: args.html.is_some() })
}

/// Refuses two outputs with the same path.
fn not_twice(args: &AccuracyArgs) -> Result<()> {
    let outputs = [&args.json, &args.html, &args.markdown].into_iter().flatten();
    let help = "choose another name: --json FILE, --html FILE, --markdown FILE";
    files::refuse_overwrites([""; 0], outputs, help)
}

/// Output files, created before the long work so that a bad output folder is found at once.
struct Files {
    json: Option<TextFile>,
    html: Option<TextFile>,
    markdown: Option<TextFile>,
}

impl Files {
    fn create(args: &AccuracyArgs) -> Result<Self> {
        let create = |path: &Option<PathBuf>| path.as_deref().map(TextFile::create).transpose();
        Ok(Self {
            json: create(&args.json)?,
            html: create(&args.html)?,
            markdown: create(&args.markdown)?,
        })
    }

    fn finish(self, report: &AccuracyReport) -> Result<()> {
        let mut written = Vec::new();
        if let Some(file) = self.json {
            let json = serde_json::to_string_pretty(report).unwrap_or_default();
            written.push(file.finish(&(json + "\n"))?);
        }
        if let Some(file) = self.html {
            written.push(file.finish(&accuracy_page::page(report).html())?);
        }
        if let Some(file) = self.markdown {
            written.push(file.finish(&accuracy_markdown::page(report))?);
        }
        super::print_paths(&written)
    }
}
