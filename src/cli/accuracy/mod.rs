//! `lightpath accuracy`: traces a catalogue of hard cases on every backend; writes a table, JSON
//! and pages.

pub mod args;
mod markdown;
mod page;
mod table;

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::lab::accuracy::{self, AccuracySettings, Case};
use crate::lab::backend::{self, TestedBackend};
use crate::monitor::Monitor;
use crate::simd::Isa;

use super::outputs::OutputFlags;
use super::{machine, print, signals};

use self::args::AccuracyArgs;

/// Number of rays of `--full` relative to `--quick`.
const FULL: u64 = 400;

/// Runs the catalogue of hard cases, or the selected ones.
pub fn run(args: &AccuracyArgs) -> Result<()> {
    let cases = cases(args.case.as_deref())?;
    let outputs = OutputFlags(vec![
        ("--json FILE", &args.json),
        ("--html FILE", &args.html),
        ("--markdown FILE", &args.markdown),
    ]);
    outputs.refuse_overwrites([""; 0])?;
    let monitor = Arc::new(Monitor::default());
    let settings = settings(args, &monitor)?;
    signals::watch(&monitor)?;
    let mut outputs = outputs.create()?;
    let mut shown = print::Report::new(!outputs.is_empty());
    let mut report = args.workers.pool()?.install(|| {
        shown.text(&table::heading(&settings))?;
        let count = cases.len();
        let begun = |index: usize, case: &Case| {
            if settings.times > 1 {
                let text = format!("{} of {count}: {}, {}", index + 1, case.group, case.name);
                args.messages.note(&text);
            }
        };
        let mut group = String::new();
        accuracy::run(&cases, &settings, &monitor, &begun, &mut |row| {
            let first = std::mem::replace(&mut group, row.group.clone()) != row.group;
            shown.text(&table::line(&settings, row, first))
        })
    })?;
    report.machine = Some(machine::describe(Isa::detect()));
    shown.text(&table::summary(&report))?;
    outputs.write_json("--json", &report)?;
    outputs.write("--html", || page::page(&report).html())?;
    outputs.write("--markdown", || markdown::page(&report))?;
    shown.end()?;
    print::paths(&outputs.written())?;
    Error::failed("accuracy", report.failures())
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
        without.iter().for_each(|line| args.messages.note(line));
        tested_backends = available;
    }
    let times = if args.full { FULL } else { args.times.unwrap_or(1) };
    Ok(AccuracySettings { tested_backends, seed: args.seed, times, pictures: args.html.is_some() })
}
