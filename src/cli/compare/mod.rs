//! `lightpath compare`: measures how far a picture is from a reference, as numbers, error maps and
//! an exit code.

pub mod args;
pub mod page;
mod text;

use std::path::PathBuf;

use crate::error::{Error, Failures, Result};
use crate::lab::compare::file::Picture;
use crate::lab::compare::layer::is_beauty;
use crate::lab::compare::{self, CompareSettings, Comparison, map};
use crate::lab::metrics::Metric;
use crate::output::atomic::PartFile;
use crate::scene::{did_you_mean, list};

use super::outputs::OutputFlags;
use super::{print, signals};

use self::args::CompareArgs;

/// Compares a picture with a reference.
pub fn run(args: &CompareArgs) -> Result<()> {
    let limits = limits(args)?;
    check_outputs(args)?;
    let pool = args.workers.pool()?;
    signals::end_at_once()?;
    let error_map = args.out.as_deref().map(PartFile::create).transpose()?;
    let mut outputs = OutputFlags(vec![("--html FILE", &args.html)]).create()?;
    let mut failures = Failures::default();
    let test = failures.keep(Picture::read(&args.test));
    let reference = failures.keep(Picture::read(&args.reference));
    failures.check()?;
    let (Some(test), Some(reference)) = (test, reference) else { return Ok(()) };
    let settings = settings(args, [&test, &reference])?;
    let found = pool.install(|| compare::compare(test, reference, &settings))?;
    let failed = failed(args, &found, &limits)?;
    let shown = error_map.zip(found.layers.first());
    let shown =
        shown.map(|(part, layer)| part.finish(map::error_map(&layer.test, &layer.reference)));
    let mut written: Vec<PathBuf> = shown.transpose()?.into_iter().collect();
    outputs.write("--html", || page::page(args, &found, &failed).html())?;
    written.extend(outputs.written());
    if args.json {
        print::json(&text::json(args, &found, &failed, &written))?;
    } else {
        if !args.quiet {
            print::text(&text::text(args, &found))?;
        }
        print::paths(&written)?;
    }
    Error::failed("compare", failed)
}

/// Threshold of a metric.
struct Limit {
    metric: Metric,
    value: f64,
}

/// Parses the thresholds of `--fail-above` and `--fail-below`.
fn limits(args: &CompareArgs) -> Result<Vec<Limit>> {
    let mut failures = Failures::default();
    let above = args.fail_above.iter().map(|text| limit("--fail-above", text, false));
    let below = args.fail_below.iter().map(|text| limit("--fail-below", text, true));
    let limits: Vec<Limit> = above.chain(below).filter_map(|limit| failures.keep(limit)).collect();
    failures.check()?;
    Ok(limits)
}

fn limit(flag: &str, text: &str, below: bool) -> Result<Limit> {
    let names =
        || Metric::ALL.into_iter().filter(|m| m.more_is_better() == below).map(Metric::name);
    let (name, value) = text.split_once('=').ok_or_else(|| {
        let message = format!("found `{text}`, expected METRIC=VALUE");
        Error::invalid(flag, message).help(format!("{flag} {}=0.001", names().next().unwrap_or("")))
    })?;
    let metric = Metric::named(name).filter(|m| m.more_is_better() == below);
    let metric = metric.ok_or_else(|| {
        let message = format!("found `{name}`, expected {}", list(names()));
        let other = if below { "--fail-above" } else { "--fail-below" };
        let help = match Metric::named(name) {
            Some(_) => Some(format!("{other} {text}")),
            None => did_you_mean(name, names()),
        };
        Error::invalid(flag, message).maybe_help(help)
    })?;
    match value.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(Limit { metric, value }),
        _ => {
            let message = format!("found `{value}`, expected a number of at least 0, such as 1e-3");
            Err(Error::invalid(format!("{flag} {name}"), message))
        }
    }
}

fn settings(args: &CompareArgs, files: [&Picture; 2]) -> Result<CompareSettings> {
    if !(-100.0..=100.0).contains(&args.exposure) {
        let message = format!("found {}, expected a number of stops in [-100, 100]", args.exposure);
        return Err(Error::invalid("--exposure", message));
    }
    let layers = || files.into_iter().flat_map(|file| &file.layers);
    let known = || layers().map(|layer| layer.shown());
    // As in files, the picture itself has several names, unless a layer has that name.
    let named = |name: &String| match !name.is_empty() && is_beauty(name) {
        true if !layers().any(|layer| layer.is_called(name)) => "beauty".to_string(),
        _ => name.clone(),
    };
    let chosen: Vec<String> = args.layer.iter().map(named).collect();
    for name in &chosen {
        if !layers().any(|layer| layer.is_called(name)) {
            let mut all: Vec<&str> = known().collect();
            all.sort_unstable();
            all.dedup();
            let message = format!("found `{name}`, expected {}", list(all));
            let help = did_you_mean(name, known());
            return Err(Error::invalid("--layer", message).maybe_help(help));
        }
        for file in files {
            if !file.layers.iter().any(|layer| layer.is_called(name)) {
                let names = list(file.layers.iter().map(|layer| layer.shown()));
                let message =
                    format!("found `{name}`, which {} does not have: it has {names}", file.path);
                return Err(Error::invalid("--layer", message));
            }
        }
    }
    Ok(CompareSettings { layers: chosen, tonemap: args.tonemap, exposure: args.exposure })
}

/// Returns the reasons why the check fails: pixels that are not finite, exceeded thresholds, and
/// pixels that miss in one file alone, which have no error that a threshold could bound.
///
/// # Errors
/// A threshold for a metric that no compared layer has.
fn failed(args: &CompareArgs, found: &Comparison, limits: &[Limit]) -> Result<Vec<String>> {
    let mut failed = Vec::new();
    for layer in &found.layers {
        failed.extend(layer.non_finite.map(|_| text::non_finite(args, layer)));
    }
    // A layer that is not finite has no metrics, and fails anyhow.
    let lacks = |metric: Metric| found.layers.iter().all(|l| l.values.get(metric).is_none());
    let unknown = limits.iter().find(|limit| failed.is_empty() && lacks(limit.metric));
    if let Some(Limit { metric, .. }) = unknown {
        let message = format!("no layer that was compared has a `{}`", metric.name());
        let help =
            "flip, psnr and ssim (11 x 11 pixels) need layers of light, hdrflip needs two EXRs";
        return Err(Error::invalid("--fail-above, --fail-below", message).help(help));
    }
    for Limit { metric, value } in limits {
        let name = metric.name();
        for layer in &found.layers {
            let Some(measured) = layer.values.get(*metric) else { continue };
            let counted = *metric == Metric::Differ;
            if let Some(alone) = text::differing_misses(args, layer).filter(|_| !counted) {
                let reason = format!("{}: {alone}; only `differ` counts them", layer.test.shown());
                if !failed.contains(&reason) {
                    failed.push(reason);
                }
            }
            let (exceeded, word) = match metric.more_is_better() {
                true => (measured < *value, "below"),
                false => (measured.abs() > *value, "above"),
            };
            if exceeded {
                let (name, measured) = match measured < 0.0 && word == "above" {
                    true => (format!("|{name}|"), -measured),
                    false => (name.to_string(), measured),
                };
                let shown = text::number(*metric, measured);
                failed.push(format!("{}: {name} is {shown}, {word} {value}", layer.test.shown()));
            }
        }
    }
    Ok(failed)
}

/// Refuses outputs that would overwrite inputs or each other, and names of error maps that do not
/// end in `.png`.
fn check_outputs(args: &CompareArgs) -> Result<()> {
    let is_png = |path: &PathBuf| {
        path.starts_with("/dev")
            || path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png"))
    };
    if let Some(path) = args.out.iter().find(|path| !is_png(path)) {
        let message = format!("found {}, expected a name that ends in .png", path.display());
        return Err(Error::invalid("--out", message));
    }
    let outputs = OutputFlags(vec![("--out FILE.png", &args.out), ("--html FILE", &args.html)]);
    outputs.refuse_overwrites([&args.test, &args.reference])
}
