//! Rays that leave a surface, at sizes from 1e-6 to 1e6 and up to 1e7 times the size away from the
//! scene's origin. No surface may shadow or mirror itself, and an object four ulp above it must
//! cast a shadow. For comparison, the coursework's fixed offset fails in both ways.

mod measure;

use lightpath::accel::build;
use lightpath::monitor::Monitor;
use lightpath::scene::{Backend, EmbreeMode};
use lightpath::simd::Isa;

use crate::support::backends::OPTIONS;
use measure::{CLEAR, Count, Origin, Row};

/// The coursework's offset.
const FIXED: f32 = 1e-4;

/// Measures a backend and returns the counts.
fn measure(backend: Backend, origin: Origin, rays: usize) -> Vec<Row> {
    let monitor = Monitor::default();
    measure::measure(&|g| build(g, backend, &OPTIONS, &monitor), origin, rays, 7).unwrap()
}

fn sum(rows: &[Row], of: impl Fn(&Row) -> Count) -> Count {
    rows.iter().map(of).fold(Count::default(), |a, b| Count {
        rays: a.rays + b.rays,
        failures: a.failures + b.failures,
    })
}

/// Checks that no row has a forbidden failure, and that each row has rays.
fn check(backend: Backend) {
    let rows = measure(backend, Origin::Rounded, 128);
    let bad = |row: &&Row| {
        row.self_shadow.failures + row.self_reflection.failures + row.leak.failures > 0
    };
    let failed: Vec<String> = rows.iter().filter(bad).map(Row::to_string).collect();
    let near = sum(&rows, |r| r.near);
    println!("{backend:?} nearer than {} ulp: {near:?}", CLEAR);
    assert!(failed.is_empty(), "{} rows:\n{}", failed.len(), failed.join("\n"));
    for row in &rows {
        // No row may pass without rays.
        let asked = [row.self_shadow, row.self_reflection, row.leak].map(|count| count.rays);
        assert!(asked.iter().all(|&rays| rays >= 16), "hardly any rays: {row}");
    }
}

#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn embree() {
    check(Backend::Embree(EmbreeMode::Robust));
}

#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn embree_fast() {
    check(Backend::Embree(EmbreeMode::Fast));
}

#[test]
fn bvh() {
    Isa::available().for_each(|isa| check(Backend::Bvh(isa)));
}

#[test]
fn coursework() {
    check(Backend::Coursework);
}

#[test]
fn brute() {
    check(Backend::Brute);
}

#[test]
fn a_fixed_offset_fails_at_both_ends() {
    let rows = measure(Backend::Brute, Origin::Fixed(FIXED), 64);
    let small: Vec<Row> = rows.iter().copied().filter(|r| r.scale <= 1e-4).collect();
    let large: Vec<Row> = rows.iter().copied().filter(|r| r.scale >= 1e4).collect();
    let leaks = sum(&small, |r| r.leak);
    let acne = sum(&large, |r| r.self_shadow);
    println!("small: leaks {leaks:?}; large: self-shadow {acne:?}");
    assert!(leaks.failures * 4 > leaks.rays, "{leaks:?}");
    assert!(acne.failures * 20 > acne.rays, "{acne:?}");
}
