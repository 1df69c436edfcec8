//! Compares the renderer's picture with the reference's, and shows where they differ.

use lightpath_reference::Picture;
use std::fmt::Write;
use std::path::Path;

/// Half floats keep 11 bits, so rounding to nearest changes a value by at most 2^-11 = 4.9e-4 of
/// itself. The rest of 1e-3 is for the renderer's f32 geometry.
pub const RELATIVE: f64 = 1e-3;

/// Values below this are compared as if they were this large. Below 1/100 only absolute differences
/// (1e-5) matter, because f32 cosines near the terminator have lost relative precision.
pub const FLOOR: f64 = 0.01;

/// Share of the pixels that may be out of tolerance: silhouettes, shadow and texel edges, where f32
/// and f64 may decide differently, and five-sigma events among many pixels.
pub const ALLOWED: f64 = 0.003;

/// Number of standard deviations that a pixel of a sampled picture may be off. With normal noise,
/// one value in 1.7 million would be further off. Real noise has heavier tails (a rare bright
/// sample), for which `ALLOWED` leaves room.
pub const SIGMAS: f64 = 5.0;

/// Relative tolerance in a sampled picture. Light that fewer than some five of 1024 points see
/// shows no variance in the reference's own 1024 points, nor any light.
pub const RELATIVE_SAMPLED: f64 = 5e-3;

/// Side of the blocks whose mean is checked in a sampled picture, px.
const BLOCK: usize = 10;

/// Largest allowed difference of channel `c` of pixel `k` from the reference.
type Tolerance<'a> = &'a dyn Fn(usize, usize) -> f64;

/// Checks a picture without random choices: `|x - r| <= RELATIVE max(|r|, FLOOR)`, except for
/// `ALLOWED` of the pixels.
pub fn assert_same(name: &str, actual: &Picture, expected: &Picture) {
    let tolerance = |k: usize, c: usize| RELATIVE * expected.pixels[k][c].abs().max(FLOOR);
    if let Err(report) = judge_pixels(actual, expected, &tolerance) {
        let place = write_pictures(name, actual, expected, &tolerance);
        panic!("{name}: see {place}\n{report}");
    }
}

/// Checks a picture with random choices, by [`judge_sampled`].
pub fn assert_same_sampled(name: &str, actual: &Picture, expected: &Picture) {
    if let Err(report) = judge_sampled(actual, expected) {
        let place = write_pictures(name, actual, expected, &sampled_tolerance(expected));
        panic!("{name}: see {place}\n{report}");
    }
}

/// Checks a picture with random choices: each pixel within `SIGMAS` of its noise, and the means of
/// blocks of pixels within `SIGMAS` of theirs. The blocks are ten times sharper and show any bias,
/// such as a wrong density of the samples.
pub fn judge_sampled(actual: &Picture, expected: &Picture) -> Result<(), String> {
    judge_pixels(actual, expected, &sampled_tolerance(expected))?;
    let mut report = String::new();
    for top in (0..expected.height).step_by(BLOCK) {
        for left in (0..expected.width).step_by(BLOCK) {
            check_block(actual, expected, left, top, &mut report);
        }
    }
    if report.is_empty() { Ok(()) } else { Err(report) }
}

fn sampled_tolerance(expected: &Picture) -> impl Fn(usize, usize) -> f64 {
    |k: usize, c: usize| {
        SIGMAS * expected.deviation[k][c]
            + RELATIVE_SAMPLED * expected.pixels[k][c].abs().max(FLOOR)
    }
}

/// Rounding of a block's pixels to half floats goes either way, so their mean stays well within
/// `RELATIVE`.
fn check_block(a: &Picture, e: &Picture, left: usize, top: usize, report: &mut String) {
    let columns = left..(left + BLOCK).min(e.width);
    let rows = top..(top + BLOCK).min(e.height);
    let inside: Vec<usize> =
        rows.flat_map(|j| columns.clone().map(move |i| j * e.width + i)).collect();
    let n = inside.len() as f64;
    for c in 0..4 {
        let mean = |p: &Picture| inside.iter().map(|k| p.pixels[*k][c]).sum::<f64>() / n;
        let noise = inside.iter().map(|k| e.deviation[*k][c].powi(2)).sum::<f64>().sqrt() / n;
        let (actual, expected) = (mean(a), mean(e));
        let tolerance = SIGMAS * noise + RELATIVE * expected.abs().max(FLOOR);
        // Written so that a NaN fails.
        let right = (actual - expected).abs() <= tolerance;
        if !right {
            let corner = (left, top);
            writeln!(
                report,
                "  block at {corner:?} channel {c}: {actual:.6}, expected {expected:.6} +- {tolerance:.2e}"
            )
            .unwrap();
        }
    }
}

/// Checks that all but `ALLOWED` of the pixels are within tolerance, else reports the worst.
fn judge_pixels(a: &Picture, e: &Picture, tolerance: Tolerance) -> Result<(), String> {
    assert_eq!((a.width, a.height), (e.width, e.height), "picture size");
    let mut wrong: Vec<(f64, usize)> = (0..e.pixels.len())
        .map(|k| (excess(a, e, tolerance, k), k))
        .filter(|(excess, _)| *excess > 1.0)
        .collect();
    let allowed = (ALLOWED * e.pixels.len() as f64) as usize;
    println!("{} of {} pixels differ, {allowed} may", wrong.len(), e.pixels.len());
    if wrong.len() <= allowed {
        return Ok(());
    }
    wrong.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut report = format!("{} pixels differ, {allowed} may\n", wrong.len());
    for (excess, k) in wrong.iter().take(10) {
        let (i, j) = (k % e.width, k / e.width);
        let (x, r) = (a.pixels[*k], e.pixels[*k]);
        writeln!(report, "  ({i}, {j}): {x:.5?}, expected {r:.5?}: {excess:.1} tolerances")
            .unwrap();
    }
    Err(report)
}

/// Returns the largest difference of a pixel's channels in tolerances; infinite for a NaN.
fn excess(actual: &Picture, expected: &Picture, tolerance: Tolerance, k: usize) -> f64 {
    (0..4)
        .map(|c| (actual.pixels[k][c] - expected.pixels[k][c]).abs() / tolerance(k, c))
        .map(|x| if x.is_nan() { f64::INFINITY } else { x })
        .fold(0.0, f64::max)
}

/// Writes actual, expected and difference PNGs to cargo's folder for tests, and returns their
/// place. In the difference, black is equal, mid grey is one tolerance, white is two or more.
fn write_pictures(name: &str, a: &Picture, e: &Picture, tolerance: Tolerance) -> String {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a folder for the pictures");
    write_png(&folder.join("actual.png"), a);
    write_png(&folder.join("expected.png"), e);
    let shade = |k: usize| (127.5 * excess(a, e, tolerance, k)).min(255.0) as u8;
    let grey = (0..e.pixels.len()).map(shade).collect();
    image::GrayImage::from_raw(e.width as u32, e.height as u32, grey)
        .expect("as many pixels as that")
        .save(folder.join("difference.png"))
        .expect("difference.png");
    folder.display().to_string()
}

/// Writes a picture for viewing: sRGB, clamped, over black.
fn write_png(path: &Path, picture: &Picture) {
    let to_srgb = |x: f64| {
        let x = x.clamp(0.0, 1.0);
        let y = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
        (255.0 * y).round() as u8
    };
    let bytes = picture.pixels.iter().flat_map(|p| [p[0], p[1], p[2]].map(to_srgb)).collect();
    image::RgbImage::from_raw(picture.width as u32, picture.height as u32, bytes)
        .expect("as many pixels as that")
        .save(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
}
