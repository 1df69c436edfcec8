//! Report page of `compare`: pictures side by side, error maps, all numbers.

use crate::lab::compare::mattes::{self, Matte};
use crate::lab::compare::{Compared, Comparison, map};
use crate::lab::metrics::Metric;
use crate::report::{Cell, ColorScale, Page, Section, picture_of_width};
use crate::units::plural;

use super::args::CompareArgs;
use super::text;

/// Maximum number of mattes in one table.
const MAX_MATTES: usize = 1000;

/// Builds the page from the results. `failed` lists the reasons for exit code 1.
pub fn page(args: &CompareArgs, found: &Comparison, failed: &[String]) -> Page {
    let mut intro = vec![text::legend(args, found)];
    intro.extend(text::alone(args, found));
    let pictures = found.layers.iter().filter(|layer| kind(found, layer).is_none());
    // The first layer and all failed layers are unfolded.
    let sections = pictures.enumerate().map(|(i, layer)| {
        let section = section(args, layer, failed);
        let bad = section.findings.iter().any(|(_, bad)| *bad);
        Section { folded: i > 0 && !bad, ..section }
    });
    let mattes = found.mattes.keys().filter_map(|kind| matte_section(kind, found, failed));
    Page {
        title: format!("{} against {}", args.test.display(), args.reference.display()),
        intro,
        sections: sections.chain(mattes).collect(),
    }
}

fn section(args: &CompareArgs, layer: &Compared, failed: &[String]) -> Section {
    let own = format!("{}: ", layer.test.shown());
    let mut findings: Vec<(String, bool)> = Vec::new();
    let main = [Metric::Relmse, Metric::Rmse, Metric::Differ, Metric::Ssim, Metric::HdrFlip];
    let main = main.into_iter().filter_map(|metric| {
        let value = layer.values.get(metric)?;
        Some(format!("{} {}", metric.name(), text::number(metric, value)))
    });
    let main: Vec<String> = main.collect();
    if !main.is_empty() {
        findings.push((main.join(", "), false));
    }
    let failures = failed.iter().filter_map(|failure| failure.strip_prefix(&own));
    findings.extend(failures.map(|failure| (failure.to_string(), true)));
    let notes = [text::grey(args, layer), text::floor(args, layer), text::misses(args, layer)];
    findings.extend(notes.into_iter().flatten().map(|note| (note, false)));
    let mut rows = vec![["metric", "value", "formula"].map(Cell::from).to_vec()];
    for (metric, value) in layer.values.iter() {
        let cells =
            [metric.name().to_string(), text::number(metric, value), metric.formula().into()];
        rows.push(cells.map(Cell::from).to_vec());
    }
    // A layer with pixels that are not finite has no metrics.
    let tables = (rows.len() > 1).then(|| ("Metrics".to_string(), rows));
    Section {
        title: text::heading(layer),
        findings,
        charts: charts(args, layer),
        tables: tables.into_iter().collect(),
        folded: false,
    }
}

/// Returns the pictures in rows of two: both pictures, then the error maps, each with its scale.
fn charts(args: &CompareArgs, layer: &Compared) -> Vec<String> {
    let width = layer.test.size[0];
    let shown = shown_width(width);
    let mut charts = Vec::new();
    if let Some(pictures) = &layer.pictures {
        let paths = [&args.test, &args.reference];
        for (pixels, path) in pictures.iter().zip(paths) {
            let caption = path.display().to_string();
            charts.push(picture_of_width(&map::png(pixels, width), &caption, shown));
        }
    }
    let picture = picture_of_width(
        &map::error_map(&layer.test, &layer.reference),
        "error of each pixel",
        shown,
    );
    charts.push(picture + &error_scale().svg());
    if let Some(flip) = &layer.flip {
        let png = map::colored(flip.iter().copied(), width);
        let picture = picture_of_width(&png, "FLIP of each pixel", shown);
        charts.push(picture + &share_scale("FLIP").svg());
    }
    charts
}

/// Returns the colour scale of an error map.
pub fn error_scale() -> ColorScale {
    let [low, high] = map::RANGE;
    let decades = (high / low).log10().round() as i32;
    let values = (0..=decades).map(|i| low * 10f64.powi(i));
    let ticks = values.map(|value| (map::position(value), format!("{value:.0e}")));
    scale("relative error; light blue: not finite, or a miss of one file alone", ticks.collect())
}

/// Returns the kind of cryptomatte that a layer belongs to, if any.
fn kind<'a>(found: &'a Comparison, layer: &Compared) -> Option<&'a str> {
    mattes::kind(&layer.test.name, &found.mattes)
}

/// Builds the section of one kind of cryptomatte: a table of mattes and a table of channels.
fn matte_section(name: &str, found: &Comparison, failed: &[String]) -> Option<Section> {
    let layers = found.layers.iter().filter(|layer| kind(found, layer) == Some(name));
    let layers: Vec<&Compared> = layers.collect();
    let [width, height] = layers.first()?.test.size;
    let mattes = mattes::compare(name, &found.mattes[name], &layers);
    let own = |failure: &&String| {
        layers.iter().any(|layer| failure.starts_with(&format!("{}: ", layer.test.shown())))
    };
    let differing = mattes.map.iter().filter(|share| **share > 0.0).count();
    let finding = format!("mattes differ in {differing} of {} pixels", width * height);
    let failures = failed.iter().filter(own).map(|failure| (failure.clone(), true));
    let mut rows =
        vec![["matte", "pixels", "of the reference", "differ in"].map(Cell::from).to_vec()];
    let row = |matte: &Matte| {
        let [test, reference] = matte.pixels;
        let numbers = [test, reference, matte.differs].map(|pixels| format!("{pixels:.2}"));
        [matte.name.clone()].into_iter().chain(numbers).map(Cell::from).collect()
    };
    rows.extend(mattes.all.iter().take(MAX_MATTES).map(row));
    let mut channels = vec![["channel", "metric", "value", "formula"].map(Cell::from).to_vec()];
    for layer in &layers {
        channels.extend(layer.values.iter().map(|(metric, value)| {
            let value = text::number(metric, value);
            let cells = [layer.test.shown(), metric.name(), &value, metric.formula()];
            cells.map(Cell::from).to_vec()
        }));
    }
    let count = mattes.all.len();
    let shown = match count > MAX_MATTES {
        true => format!("The {MAX_MATTES} mattes that differ most"),
        false => "Mattes".to_string(),
    };
    let charts = (!mattes.map.is_empty()).then(|| {
        let png = map::colored(mattes.map.iter().copied(), width);
        let caption = "largest difference of one matte's coverage, by pixel";
        picture_of_width(&png, caption, shown_width(width))
            + &share_scale("share of the pixel").svg()
    });
    Some(Section {
        title: format!(
            "{name}: {} in {}, {width} x {height} pixels",
            plural(count, "matte"),
            plural(layers.len(), "channel")
        ),
        findings: [(finding, false)].into_iter().chain(failures).collect(),
        charts: charts.into_iter().collect(),
        tables: vec![(shown, rows), ("Channels".into(), channels)],
        folded: false,
    })
}

/// Returns the displayed width of a picture in CSS pixels.
fn shown_width(width: usize) -> u32 {
    (width as u32).clamp(480, 590)
}

/// Returns the colour scale of a map with values from 0 to 1.
fn share_scale(title: &str) -> ColorScale {
    scale(title, [0.0, 0.5, 1.0].map(|value| (value, value.to_string())).to_vec())
}

fn scale(title: &str, ticks: Vec<(f64, String)>) -> ColorScale {
    let colors = (0..64).map(|i| map::color(f64::from(i) / 63.0)).collect();
    ColorScale { title: title.into(), colors, ticks }
}
