//! Rays that leave a surface, at sizes from 1e-6 to 1e6 and up to 1e7 times the size away from the
//! scene's origin: no surface shadows itself or mirrors itself, and what lies four ulp above it
//! shadows it. The coursework's fixed offset, beside it, fails both ways.

#[path = "../embree/mod.rs"]
mod embree;
mod measure;

use lightpath::accel::{BuildOptions, EmbreeMode, build};
use lightpath::monitor::Monitor;
use lightpath::scene::Backend;
use lightpath::simd::Isa;

use embree::unless_missing;
use measure::{CLEAR, Count, Origin, Row};

/// The coursework's offset.
const FIXED: f32 = 1e-4;

/// The counts of a backend; `None` where it cannot run here.
fn measure(
    backend: Backend,
    embree: EmbreeMode,
    isa: Isa,
    origin: Origin,
    rays: usize,
) -> Option<Vec<Row>> {
    let options = BuildOptions { threads: 1, embree, isa, max_bytes: None };
    let monitor = Monitor::default();
    let rows = measure::measure(&|g| build(g, backend, &options, &monitor), origin, rays, 7);
    unless_missing(backend, rows)
}

fn sum(rows: &[Row], of: impl Fn(&Row) -> Count) -> Count {
    rows.iter().map(of).fold(Count::default(), |a, b| Count {
        rays: a.rays + b.rays,
        failures: a.failures + b.failures,
    })
}

/// Every row's failures that are not allowed, and how much was looked at.
fn check(backend: Backend, embree: EmbreeMode, isa: Isa) {
    let Some(rows) = measure(backend, embree, isa, Origin::Rounded, 128) else { return };
    let bad = |row: &&Row| {
        row.self_shadow.failures + row.self_reflection.failures + row.leak.failures > 0
    };
    let failed: Vec<String> = rows.iter().filter(bad).map(Row::to_string).collect();
    let near = sum(&rows, |r| r.near);
    println!("{backend:?} nearer than {} ulp: {near:?}", CLEAR);
    assert!(failed.is_empty(), "{} rows:\n{}", failed.len(), failed.join("\n"));
    for row in &rows {
        // No row may pass because nothing was asked.
        let asked = [row.self_shadow, row.self_reflection, row.leak].map(|count| count.rays);
        assert!(asked.iter().all(|&rays| rays >= 16), "hardly any rays: {row}");
    }
}

#[test]
fn embree() {
    check(Backend::Embree, EmbreeMode::Robust, Isa::Portable);
}

#[test]
fn embree_fast() {
    check(Backend::Embree, EmbreeMode::Fast, Isa::Portable);
}

#[test]
fn embree_exact() {
    check(Backend::Embree, EmbreeMode::Exact, Isa::detect());
}

#[test]
fn bvh() {
    for isa in Isa::available() {
        check(Backend::Bvh, EmbreeMode::Robust, isa);
    }
}

#[test]
fn coursework() {
    check(Backend::Coursework, EmbreeMode::Robust, Isa::Portable);
}

#[test]
fn brute() {
    check(Backend::Brute, EmbreeMode::Robust, Isa::Portable);
}

#[test]
fn a_fixed_offset_fails_at_both_ends() {
    let rows = measure(Backend::Brute, EmbreeMode::Robust, Isa::Portable, Origin::Fixed(FIXED), 64)
        .unwrap();
    let small: Vec<Row> = rows.iter().copied().filter(|r| r.scale <= 1e-4).collect();
    let large: Vec<Row> = rows.iter().copied().filter(|r| r.scale >= 1e4).collect();
    let leaks = sum(&small, |r| r.leak);
    let acne = sum(&large, |r| r.self_shadow);
    println!("small: leaks {leaks:?}; large: self-shadow {acne:?}");
    assert!(leaks.failures * 4 > leaks.rays, "{leaks:?}");
    assert!(acne.failures * 20 > acne.rays, "{acne:?}");
}
