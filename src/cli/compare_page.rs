//! What `compare` found out, as one page: pictures side by side, where they differ, all numbers.

use crate::{
    measure::{
        compare::{Compared, Comparison, map},
        metrics::Metric,
    },
    report::{Cell, Page, Scale, Section, picture_of_width},
};

use super::{args::CompareArgs, compare_text as text};

/// The page.
pub fn page(args: &CompareArgs, found: &Comparison, failed: &[String]) -> Page {
    let mut intro = vec![text::legend(args, found)];
    intro.extend(text::alone(args, found));
    let sections = found.layers.iter().map(|layer| section(args, layer, failed));
    Page {
        title: format!("{} against {}", args.test.display(), args.reference.display()),
        intro,
        sections: sections.collect(),
    }
}

/// The error map of a layer as a PNG.
pub fn error_map(layer: &Compared) -> Vec<u8> {
    let errors = map::errors(&layer.test, &layer.reference);
    let pixels: Vec<[u8; 3]> = errors.iter().map(|e| map::color(map::position(*e))).collect();
    map::png(&pixels, layer.test.size[0])
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
    let notes = [text::grey(args, layer), text::floor(args, layer)];
    findings.extend(notes.into_iter().flatten().map(|note| (note, false)));
    let mut rows = vec![["metric", "value", "formula"].map(Cell::from).to_vec()];
    for (metric, value) in layer.values.iter() {
        let cells =
            [metric.name().to_string(), text::number(metric, value), metric.formula().into()];
        rows.push(cells.map(Cell::from).to_vec());
    }
    Section {
        title: text::heading(layer),
        findings,
        charts: charts(args, layer),
        tables: vec![("Metrics".into(), rows)],
    }
}

/// Two in a row: the pictures; the maps, each with its scale.
fn charts(args: &CompareArgs, layer: &Compared) -> Vec<String> {
    let width = layer.test.size[0];
    let shown = (width as u32).clamp(480, 590);
    let mut charts = Vec::new();
    if let Some(pictures) = &layer.pictures {
        let paths = [&args.test, &args.reference];
        for (pixels, path) in pictures.iter().zip(paths) {
            let caption = path.display().to_string();
            charts.push(picture_of_width(&map::png(pixels, width), &caption, shown));
        }
    }
    let picture = picture_of_width(&error_map(layer), "error of each pixel", shown);
    charts.push(picture + &error_scale().svg());
    if let Some(flip) = &layer.flip {
        let pixels: Vec<[u8; 3]> = flip.iter().map(|value| map::color(*value)).collect();
        let picture = picture_of_width(&map::png(&pixels, width), "FLIP of each pixel", shown);
        let ticks = [0.0, 0.5, 1.0].map(|value| (value, value.to_string()));
        charts.push(picture + &scale("FLIP", ticks.to_vec()).svg());
    }
    charts
}

/// What the colours of an error map mean.
pub fn error_scale() -> Scale {
    let [low, high] = map::RANGE;
    let decades = (high / low).log10().round() as i32;
    let values = (0..=decades).map(|i| low * 10f64.powi(i));
    let ticks = values.map(|value| (map::position(value), format!("{value:.0e}")));
    scale("relative error; light blue: not finite", ticks.collect())
}

fn scale(title: &str, ticks: Vec<(f64, String)>) -> Scale {
    let colors = (0..64).map(|i| map::color(f64::from(i) / 63.0)).collect();
    Scale { title: title.into(), colors, ticks }
}
