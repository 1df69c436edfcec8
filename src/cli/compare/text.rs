//! Formats the results of `compare` as text and as JSON.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::error::printable;
use crate::lab::compare::layer::Meaning;
use crate::lab::compare::misses::Misses;
use crate::lab::compare::{Compared, Comparison, NonFinite};
use crate::lab::metrics::Metric;
use crate::scene::ToneOperator;
use crate::units::{counted, plural};

use super::args::CompareArgs;

/// Word for one and for several pixels that miss.
const MISSES: [&str; 2] = ["miss", "misses"];

/// Formats the whole result for the terminal.
pub fn text(args: &CompareArgs, found: &Comparison) -> String {
    let mut out = format!("{}\n", legend(args, found));
    for layer in &found.layers {
        let _ = writeln!(out, "\n{}", heading(layer));
        for (metric, value) in layer.values.iter() {
            let value = number(metric, value);
            let _ = writeln!(out, "  {:<8}{value:>13}  {}", metric.name(), metric.formula());
        }
        let notes = [
            grey(args, layer),
            floor(args, layer),
            layer.non_finite.map(|_| non_finite(args, layer)),
            misses(args, layer),
        ];
        for note in notes.into_iter().flatten() {
            let _ = writeln!(out, "  {note}");
        }
    }
    let alone = alone(args, found);
    if !alone.is_empty() {
        let _ = writeln!(out, "\n{}", alone.join("\n"));
    }
    out
}

/// Explains the symbols x, r and d, and how the 8-bit pictures are made.
pub fn legend(args: &CompareArgs, found: &Comparison) -> String {
    let [a, b] = [&args.test, &args.reference].map(|path| shown(path));
    let misses = found.layers.iter().any(|layer| layer.misses.is_some());
    let without = if misses { " but depths of misses" } else { "" };
    format!(
        "x: {a}, r: {b} (the reference), d = x - r; over all pixels and channels{without}, in \
         linear light. 8-bit pictures: sRGB, {}",
        curve(found)
    )
}

fn curve(found: &Comparison) -> String {
    let operator = match found.tonemap.operator {
        ToneOperator::Max => "divided by the reference's largest value",
        ToneOperator::Clamp => "clipped at 1",
        ToneOperator::Reinhard => "x / (1 + x)",
    };
    match found.tonemap.exposure {
        0.0 => operator.to_string(),
        stops => format!("{operator}, exposure {stops}"),
    }
}

/// Formats name, channels and size of a layer.
pub fn heading(layer: &Compared) -> String {
    let test = &layer.test;
    let [width, height] = test.size;
    let line = format!("{}: {}, {width} x {height} pixels", test.shown(), test.channels.join(" "));
    printable(&line).into_owned()
}

/// Formats a value with five digits; decibels and similarities in their usual form.
pub fn number(metric: Metric, value: f64) -> String {
    match metric {
        _ if value == 0.0 => "0".into(),
        _ if !value.is_finite() => value.to_string(),
        Metric::Psnr => format!("{value:.2}"),
        Metric::Ssim | Metric::Flip | Metric::HdrFlip => format!("{value:.6}"),
        _ => format!("{value:.4e}"),
    }
}

/// Returns a note on which file has a grey layer, if that of the other file has colours.
pub fn grey(args: &CompareArgs, layer: &Compared) -> Option<String> {
    let who = match [layer.test.is_grey(), layer.reference.is_grey()] {
        [true, false] => &args.test,
        [false, true] => &args.reference,
        _ => return None,
    };
    Some(format!("{} is grey: its Y is taken for R, G and B alike", shown(who)))
}

/// Returns a note on the error that rounding to half floats alone may cause, if a file holds them.
pub fn floor(args: &CompareArgs, layer: &Compared) -> Option<String> {
    let floor = layer.floor?;
    let who = match layer.half {
        [true, true] => "both files hold".to_string(),
        [true, false] => format!("{} holds", shown(&args.test)),
        [false, _] => format!("{} holds", shown(&args.reference)),
    };
    let light = layer.test.meaning == Meaning::Light;
    let relmse = light.then(|| format!(", relmse {:.1e}", floor.relmse));
    Some(format!(
        "{who} half floats: their rounding alone may give rmse {:.1e}{}",
        floor.rmse,
        relmse.unwrap_or_default()
    ))
}

/// Formats how many pixels of each file are not finite, and the first of them. Empty if all are
/// finite.
pub fn non_finite(args: &CompareArgs, layer: &Compared) -> String {
    let Some(NonFinite { pixels: [a, b], first: [x, y] }) = layer.non_finite else {
        return String::new();
    };
    format!(
        "{}: not finite: {} of {} and {b} of {}, the first at {x}, {y}",
        printable(layer.test.shown()),
        plural(a as usize, "pixel"),
        shown(&args.test),
        shown(&args.reference)
    )
}

/// Returns a note on the pixels of a layer of depths that miss, if any.
pub fn misses(args: &CompareArgs, layer: &Compared) -> Option<String> {
    let misses = layer.misses?;
    let both = counted(misses.both, MISSES);
    let out = format!("{both} of both files left out (the depth 1e30)");
    Some(match differing_misses(args, layer) {
        Some(alone) => format!("{out}; {alone}, in `differ` alone"),
        None => out,
    })
}

/// Formats how many pixels miss in each file alone, and the first of them. `None` if there are
/// none.
pub fn differing_misses(args: &CompareArgs, layer: &Compared) -> Option<String> {
    let Misses { alone: [a, b], first, .. } = layer.misses?;
    let [x, y] = first?;
    Some(format!(
        "{} of {} alone and {b} of {} alone, the first at {x}, {y}",
        counted(a, MISSES),
        shown(&args.test),
        shown(&args.reference)
    ))
}

/// Lists the layers without a counterpart, one line per file that has any.
pub fn alone(args: &CompareArgs, found: &Comparison) -> Vec<String> {
    let files = [&args.test, &args.reference].into_iter().zip(&found.alone);
    let files = files.filter(|(_, names)| !names.is_empty());
    files
        .map(|(path, names)| format!("only in {}: {}", shown(path), printable(&names.join(", "))))
        .collect()
}

/// Formats a path for the terminal.
fn shown(path: &Path) -> String {
    printable(&path.display().to_string()).into_owned()
}

/// Returns the result as JSON.
pub fn json(
    args: &CompareArgs,
    found: &Comparison,
    failed: &[String],
    written: &[PathBuf],
) -> Value {
    let path = |path: &PathBuf| path.display().to_string();
    let [alone, missing] = &found.alone;
    json!({
        "image": path(&args.test),
        "reference": path(&args.reference),
        "tonemap": { "operator": found.tonemap.operator, "exposure": found.tonemap.exposure },
        "layers": found.layers.iter().map(layer).collect::<Vec<_>>(),
        "only_in_image": alone,
        "only_in_reference": missing,
        "failures": failed,
        "files": written.iter().map(path).collect::<Vec<_>>(),
    })
}

fn layer(layer: &Compared) -> Value {
    let mut metrics = Map::new();
    for (metric, value) in layer.values.iter() {
        // JSON has no infinity. The PSNR of equal pictures becomes null.
        metrics
            .insert(metric.name().into(), json!({ "value": value, "formula": metric.formula() }));
    }
    let non_finite = layer
        .non_finite
        .map(|n| json!({ "image": n.pixels[0], "reference": n.pixels[1], "first": n.first }));
    let misses = layer.misses.map(|m| {
        let [image, reference] = m.alone;
        json!({ "both": m.both, "image": image, "reference": reference, "first": m.first })
    });
    let light = layer.test.meaning == Meaning::Light;
    let floor = layer.floor.map(|floor| {
        let relmse = light.then_some(floor.relmse);
        json!({ "rmse": floor.rmse, "relmse": relmse })
    });
    json!({
        "name": layer.test.shown(),
        "meaning": layer.test.meaning.name(),
        "channels": layer.test.channels,
        "size": layer.test.size,
        "metrics": metrics,
        "non_finite": non_finite,
        "misses": misses,
        "grey": { "image": layer.test.is_grey(), "reference": layer.reference.is_grey() },
        "half": { "image": layer.half[0], "reference": layer.half[1], "floor": floor },
    })
}
