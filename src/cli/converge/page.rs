//! Report page of `converge`: results, charts, pictures side by side, all numbers.

use crate::lab::compare::layer::{Meaning, PictureLayer};
use crate::lab::compare::map;
use crate::lab::converge::{Crop, PointResult, Study, StudyReport};
use crate::output::tonemap::Curve;
use crate::report::{Cell, ChartLine, LineChart, Page, Section, picture_of_width};
use crate::scene::{ToneOperator, Tonemap};
use crate::units::capital;

use crate::cli::compare::page as compare_page;
use crate::cli::machine;

use super::text;

/// Builds the page. `study` holds the pictures.
pub fn page(report: &StudyReport, study: &Study) -> Page {
    let m = &report.machine;
    let sections = [Some(answer(report)), pictures(report, study), Some(numbers(report))];
    Page {
        title: format!("Error against time: {}", report.scene),
        intro: vec![
            text::reference(report),
            format!("{}, {} kernels; {}", m.cpu, m.isa, machine::versions(m)),
        ],
        sections: sections.into_iter().flatten().collect(),
    }
}

fn answer(report: &StudyReport) -> Section {
    let findings = text::findings(report).into_iter().map(|finding| (capital(&finding), false));
    Section {
        title: "What it takes".into(),
        findings: findings.collect(),
        charts: vec![against_time(report), against_samples(report)],
        ..Section::default()
    }
}

/// Returns the pairs of backend and sampler, those with `random` first: later lines of a chart are
/// drawn over earlier ones.
fn compared(report: &StudyReport) -> Vec<(String, String)> {
    let mut all: Vec<(String, String)> = Vec::new();
    for point in &report.points {
        let name = (point.backend.clone(), point.sampler.clone());
        if !all.contains(&name) {
            all.push(name);
        }
    }
    all.sort_by_key(|(_, sampler)| sampler == "sobol");
    all
}

fn against_time(report: &StudyReport) -> String {
    let compared = compared(report);
    let at = |p: &PointResult| [p.median_s, p.relmse.value];
    let of = |(backend, sampler): &(String, String)| -> Vec<[f64; 2]> {
        let points = report.points.iter();
        let own = points.filter(|p| (&p.backend, &p.sampler) == (backend, sampler));
        own.map(at).filter(|p| p[1] > 0.0).collect()
    };
    let dots: Vec<Vec<[f64; 2]>> = compared.iter().map(of).collect();
    let lines = compared.iter().zip(&dots).map(|((backend, sampler), dots)| {
        let front = crate::lab::converge::front(dots);
        ChartLine {
            name: text::shorter(report, backend, sampler),
            points: front.into_iter().map(|i| dots[i]).collect(),
        }
    });
    LineChart {
        title: "Error against time".into(),
        unit: "relmse, less is better; lines join what nothing else of the colour beats".into(),
        across: "seconds of one render".into(),
        lines: lines.collect(),
        dots,
        level: level(report.reference.relmse),
    }
    .svg()
}

fn level(error: Option<f64>) -> Option<(f64, String)> {
    error.filter(|error| *error > 0.0).map(|error| (error, "error of the reference".into()))
}

fn against_samples(report: &StudyReport) -> String {
    let mut chosen = text::headline(report);
    chosen.sort_by_key(|series| series.sampler == "sobol");
    let at = |i: &usize| [report.points[*i].samples as f64, report.points[*i].rmse.value];
    let lines = chosen.iter().filter_map(|series| {
        let slope = series.slope?;
        let name = text::shorter(report, &series.backend, &series.sampler);
        Some(ChartLine {
            name: format!("{name}: samples^{:.2}", slope.slope),
            points: series.points.iter().map(at).collect(),
        })
    });
    let fixed = chosen.first().map_or(String::new(), |series| text::at(series));
    LineChart {
        title: "Error against samples".into(),
        unit: format!("RMSE{fixed}, less is better"),
        across: "samples a pixel".into(),
        lines: lines.collect(),
        dots: Vec::new(),
        level: level(report.reference.rmse),
    }
    .svg()
}

/// Chooses two settings to show as pictures: both samplers with the same number of samples, or both
/// ends of the Pareto front.
fn chosen(report: &StudyReport) -> Vec<usize> {
    let usable = |p: &&PointResult| !p.not_antialiased && p.relmse.value > 0.0;
    let mut sobol: Vec<&PointResult> = report.points.iter().filter(usable).collect();
    sobol.retain(|p| p.sampler == "sobol");
    sobol.sort_by_key(|p| p.samples);
    let noisy = sobol.iter().find(|p| p.samples >= 16).or(sobol.last());
    let pair = noisy.map(|p| {
        let same = |q: &PointResult| {
            (&q.backend, q.spp, q.light_samples) == (&p.backend, p.spp, p.light_samples)
        };
        let of = |name: &str| report.points.iter().position(|q| q.sampler == name && same(q));
        [of("random"), of("sobol")]
    });
    match pair {
        Some([Some(random), Some(sobol)]) => vec![random, sobol],
        _ => {
            let mut ends: Vec<usize> =
                report.front.first().into_iter().chain(report.front.last()).copied().collect();
            ends.dedup();
            ends
        }
    }
}

fn pictures(report: &StudyReport, study: &Study) -> Option<Section> {
    let (crop, reference) = (study.crop?, study.reference.as_ref()?);
    let exact = crop.cut(&reference.values, report.size[0] as usize);
    let measured: Vec<_> = study.points.iter().filter(|point| !point.errors.is_empty()).collect();
    let shown = 2 * crop.size[0] as u32;
    let picture = |values: &[f32], caption: &str| {
        picture_of_width(&eight_bits(values, &exact, crop), caption, shown)
    };
    let (mut charts, mut maps) = (Vec::new(), Vec::new());
    for index in chosen(report) {
        let (point, values) = (&report.points[index], &measured[index].crop);
        let caption = format!(
            "{}: {} s, relmse {}",
            point.name(),
            text::time(point.median_s),
            text::error(point.relmse.value)
        );
        charts.push(picture(values, &caption));
        let png = map::error_map(&layer(values, crop), &layer(&exact, crop));
        maps.push(picture_of_width(&png, &format!("error of {}", point.name()), shown));
    }
    charts.push(picture(&exact, "the reference"));
    charts.extend(maps);
    charts.push(compare_page::error_scale().svg());
    let ([x, y], [across, down]) = (crop.corner, crop.size);
    let title = format!("What it looks like: {across} x {down} pixels at ({x}, {y}), enlarged");
    Some(Section { title, charts, ..Section::default() })
}

fn layer(values: &[f32], crop: Crop) -> PictureLayer {
    PictureLayer {
        name: String::new(),
        meaning: Meaning::Light,
        size: crop.size,
        origin: [0, 0],
        channels: ["R", "G", "B"].map(str::to_string).to_vec(),
        values: values.to_vec(),
        half: false,
    }
}

/// Encodes values as a PNG, divided by the largest value of `reference`.
fn eight_bits(values: &[f32], reference: &[f32], crop: Crop) -> Vec<u8> {
    let opaque = reference.chunks_exact(3).map(|p| [p[0], p[1], p[2], 1.0]);
    let tonemap = Tonemap { operator: ToneOperator::Max, exposure: 0.0, srgb: true };
    let curve = Curve::new(&opaque.collect::<Vec<_>>(), &tonemap, false);
    let byte = |v: f32| curve.to_byte(f64::from(v));
    let pixels = values.chunks_exact(3).map(|p| [byte(p[0]), byte(p[1]), byte(p[2])]);
    map::png(&pixels.collect::<Vec<_>>(), crop.size[0])
}

fn numbers(report: &StudyReport) -> Section {
    let cells = |rows: Vec<Vec<String>>| -> Vec<Vec<Cell>> {
        rows.into_iter().map(|row| row.into_iter().map(Cell::from).collect()).collect()
    };
    Section {
        title: "All numbers".into(),
        findings: text::notes(report).into_iter().map(|note| (capital(&note), false)).collect(),
        tables: [("Slopes", text::series(report)), ("Settings", text::points(report))]
            .into_iter()
            .filter(|(_, rows)| !rows.is_empty())
            .map(|(name, rows)| (name.into(), cells(rows)))
            .collect(),
        ..Section::default()
    }
}
