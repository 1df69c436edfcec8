//! Growth of build time and memory with the number of triangles.

use std::path::Path;

use serde::Serialize;

use super::result::{BenchReport, SceneResult, WorkKind};
use super::stats::log_fit;
use crate::studio;

/// Smallest ratio of the largest to the smallest number of triangles for a fit. With a smaller
/// ratio the differences between the meshes outweigh the growth.
const SPAN: f64 = 3.0;

/// A quantity that grows with the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Seconds of a build, with the largest number of threads that was measured.
    BuildTime,
    /// Bytes held after the build.
    Memory,
    /// Largest number of bytes held during the build.
    Peak,
}

impl Quantity {
    /// All quantities, in the order of reports.
    pub const ALL: [Self; 3] = [Self::BuildTime, Self::Memory, Self::Peak];

    fn of(self, scene: &SceneResult, backend: usize) -> Option<f64> {
        match self {
            Self::BuildTime => {
                let builds = scene.rows.iter().filter(|row| row.what == WorkKind::Build);
                let row = builds.max_by_key(|row| row.threads)?;
                Some(row.entries.get(backend)?.median_s.value)
            }
            Self::Memory => Some(scene.backends.get(backend)?.bytes as f64),
            Self::Peak => Some(scene.backends.get(backend)?.peak_bytes as f64),
        }
    }
}

/// One quantity of one backend over the scenes of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Growth {
    /// The quantity that grows.
    pub quantity: Quantity,
    /// Name of the backend.
    pub backend: String,
    /// Exponent e of the best fit c n^e to n triangles, by least squares of the logarithms.
    ///
    /// `None` if the largest n is less than 3 times the smallest. For comparison: n log n gives
    /// 1.07 between 70 thousand and 18 million triangles.
    pub exponent: Option<f64>,
    /// Number of triangles and value of the quantity, both > 0, smallest scene first.
    pub points: Vec<[f64; 2]>,
}

impl Growth {
    /// All fits of a run, by quantity and backend. Empty where the meshes have like sizes.
    pub fn fits(report: &BenchReport) -> Vec<Self> {
        let all = Quantity::ALL.into_iter().flat_map(|quantity| Self::of_report(report, quantity));
        all.filter(|growth| growth.exponent.is_some()).collect()
    }

    /// Collects a quantity of every backend over the scenes that are a single mesh.
    ///
    /// Other scenes are left out: they have too little in common.
    pub fn of_report(report: &BenchReport, quantity: Quantity) -> Vec<Self> {
        let alone = |scene: &&SceneResult| studio::is_mesh(Path::new(&scene.name));
        let mut scenes: Vec<&SceneResult> = report.scenes.iter().filter(alone).collect();
        scenes.sort_by_key(|scene| scene.triangles);
        let names = scenes.first().map_or(&[][..], |scene| &scene.backends);
        let of = |(i, name): (usize, String)| {
            let point = |scene: &&SceneResult| {
                let point = [scene.triangles as f64, quantity.of(scene, i)?];
                point.iter().all(|v| *v > 0.0).then_some(point)
            };
            let points: Vec<_> = scenes.iter().filter_map(point).collect();
            Self { quantity, backend: name, exponent: exponent(&points), points }
        };
        names.iter().map(|backend| backend.name.clone()).enumerate().map(of).collect()
    }
}

/// Returns [`Growth::exponent`] of some points.
fn exponent(points: &[[f64; 2]]) -> Option<f64> {
    let sizes = || points.iter().map(|[n, _]| *n);
    let (least, most) = (sizes().fold(f64::INFINITY, f64::min), sizes().fold(0.0, f64::max));
    (most >= SPAN * least).then(|| log_fit(points).exponent)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exponent_of(of: impl Fn(f64) -> f64) -> f64 {
        exponent(&[7e4, 3e5, 1e6, 2e7].map(|n| [n, of(n)])).unwrap()
    }

    #[test]
    fn the_fits_of_a_run_are_those_of_its_meshes() {
        let run = |sizes: [u64; 2]| {
            let mut report = crate::lab::result::tests::report(1.0, "h");
            report.scenes.push(report.scenes[0].clone());
            for (scene, n) in report.scenes.iter_mut().zip(sizes) {
                (scene.name, scene.triangles) = ("m.ply".into(), n);
                scene.backends.iter_mut().for_each(|backend| backend.bytes = n * n);
            }
            Growth::fits(&report)
        };
        let fits = run([10, 1000]);
        // Memory and peak of two backends; the runs have no build.
        assert_eq!(fits.len(), 4);
        assert_eq!((fits[0].quantity, fits[0].points.len()), (Quantity::Memory, 2));
        assert!((fits[0].exponent.unwrap() - 2.0).abs() < 1e-9, "{fits:?}");
        assert_eq!(run([10, 11]), []);
    }

    #[test]
    fn exponents_of_known_powers_are_recovered() {
        for (power, factor) in [(1.0, 3.0), (2.0, 1e-9), (0.5, 7.0)] {
            let exponent = exponent_of(|n| factor * n.powf(power));
            assert!((exponent - power).abs() < 1e-9, "{exponent}");
        }
        let n_log_n = exponent_of(|n| n * n.ln());
        assert!((n_log_n - 1.07).abs() < 0.01, "{n_log_n}");
        for points in [vec![], vec![[5.0, 1.0]; 2], vec![[6322.0, 1.0], [6326.0, 2.0]]] {
            assert_eq!(exponent(&points), None);
        }
    }
}
