use std::path::Path;

use super::*;
use crate::accel::BuildOptions;
use crate::accel::brute::Brute;
use crate::lab::backend::{BuiltBackend, TestedBackend};
use crate::lab::faulty::{BackendFault, Faulty};
use crate::lab::verdict::Verdict;
use crate::scene::{self, Backend, EmbreeMode, Source as SceneSource};
use crate::simd::Isa;
use crate::world::{LoadOptions, World};

const SCENE: &str = r#"{
  "nbounces": 1,
  "camera": { "type": "pinhole", "width": 32, "height": 24, "fov": 50,
              "position": [0, 1, 5], "lookat": [0, 0, -1], "up": [0, 1, 0] },
  "scene": {
    "backgroundcolor": [0.1, 0.2, 0.3],
    "lightsources": [{ "type": "pointlight", "position": [2, 5, 4], "id": [3, 3, 3] }],
    "shapes": [
      { "type": "sphere", "center": [1.2, 1, 0], "radius": 0.8, "material": { "kr": 0.3 } },
      { "type": "triangle", "v0": [-2, 0, 0], "v1": [0, 0, 0.5], "v2": [-1, 2, 0], "material": {} },
      { "type": "triangle", "v0": [0, 0, 0.5], "v1": [0.2, 1.8, 0.1], "v2": [-1, 2, 0], "material": {} },
      { "type": "plane", "v0": [-4, 0, 4], "v1": [4, 0, 4], "v2": [4, 0, -4], "v3": [-4, 0, -4],
        "material": { "kr": 0.4 } }
    ]
  }
}"#;

const OPTIONS: BuildOptions = BuildOptions { threads: 1, max_bytes: None };

fn world() -> World {
    let source = SceneSource::Text { name: "test", text: SCENE.as_bytes(), folder: Path::new("") };
    let loaded = scene::load(source, &[]).unwrap();
    World::load(&loaded.scene, LoadOptions::default(), &Monitor::default()).unwrap().0
}

const EMBREE: Backend = Backend::Embree(EmbreeMode::Robust);

/// The report of a check whose second backend, checked as `bvh`, has a fault.
fn report(fault: BackendFault) -> CrosscheckReport {
    report_on(Backend::default(), fault)
}

fn report_on(backend: Backend, fault: BackendFault) -> CrosscheckReport {
    let world = world();
    let oracle = Brute::build(&world.geometry, &OPTIONS, &Monitor::default()).unwrap();
    let faulty = Faulty(&oracle, fault);
    let tested = [Backend::Brute, backend].map(|b| TestedBackend::new(b.name(), b));
    let built_backends = [
        BuiltBackend { tested: &tested[0], accelerator: &oracle },
        BuiltBackend { tested: &tested[1], accelerator: &faulty },
    ];
    let check = CrossCheck {
        world: &world,
        oracle: &oracle,
        built_backends: &built_backends,
        coursework: None,
        rays: 4000,
        seed: 7,
    };
    let mut report = check_rays(&check, &Monitor::default()).unwrap();
    report.pictures = compare_pictures(&check, Isa::Portable, &Monitor::default()).unwrap();
    report
}

#[test]
fn a_backend_without_fault_passes() {
    let report = report(BackendFault::None);
    assert_eq!(report.failures(), Vec::<String>::new());
    let total = &report.backends[1].total;
    assert_eq!(
        (total.rays, total.rays),
        (total.of[&Verdict::Agree], 2 * report.backends[0].total.rays)
    );
    assert_eq!(report.pictures[0].same, 32 * 24);
    // Every source of rays that the scene has.
    let sources: Vec<&str> = report.backends[0].sources.iter().map(|(s, _)| s.as_str()).collect();
    let expected = [
        "primary",
        "shadow-point",
        "mirror",
        "diffuse",
        "random",
        "vertex",
        "edge",
        "axis",
        "box-face",
        "far",
        "tiny",
    ];
    assert_eq!(sources, expected);
}

#[test]
fn every_fault_is_found_with_its_verdict() {
    use Verdict::{FalseHit, Leak, WrongDistance, WrongPrimitive};
    let wrong = |fault| {
        let report = report(fault);
        assert_eq!(
            report.failures().len(),
            1 + usize::from(report.pictures[0].failure().is_some())
        );
        let kept = report.findings.iter().all(|f| f.backend == "bvh" && f.fails());
        assert!(kept && !report.findings.is_empty());
        report
    };
    let leaky = wrong(BackendFault::Misses(0, 0));
    let t = leaky.backends[1].total.of.clone();
    assert!(t[&Leak] > 100 && t[&FalseHit] + t[&WrongDistance] == 0, "{t:?}");
    // The picture has a hole, and wrong rays explain it.
    let picture = &leaky.pictures[0];
    assert!(picture.wrong[1] > 10 && picture.wrong[0] == 0 && picture.unexplained == 0);
    assert!(picture.failure().is_some());
    let t = wrong(BackendFault::HitsInsteadOfMisses).backends.remove(1).total.of;
    assert!(t[&FalseHit] > 100 && t[&Leak] + t[&WrongDistance] + t[&WrongPrimitive] == 0, "{t:?}");
    let t = wrong(BackendFault::OtherPrimitive).backends.remove(1).total.of;
    assert!(t[&WrongPrimitive] > 100 && t[&Leak] + t[&FalseHit] == 0, "{t:?}");
    let t = wrong(BackendFault::ScalesT(1.0 + 1e-3)).backends.remove(1).total.of;
    assert!(t[&WrongDistance] > 100 && t[&Leak] + t[&WrongPrimitive] == 0, "{t:?}");
}

#[test]
fn one_pixel_fails_if_bvh_is_wrong() {
    let picture = |backends: [&str; 2], wrong| PictureReport {
        backends: backends.map(String::from),
        pixels: 10_000,
        same: 9_999,
        explained: 0,
        wrong,
        unexplained: 0,
        not_looked_into: 0,
        first_unexplained: None,
    };
    let failure = picture(["embree", "bvh"], [0, 1]).failure().unwrap();
    assert!(failure.contains("1 pixel differs by rays that `bvh` answers wrong"), "{failure}");
    assert!(picture(["bvh", "embree"], [1, 0]).failure().is_some());
    assert!(picture(["embree", "bvh:avx2"], [0, 1]).failure().is_some());
    // Embree may be wrong, and few enough pixels differ.
    assert_eq!(picture(["bvh", "embree"], [0, 1]).failure(), None);
}

#[test]
fn an_invalid_tree_fails() {
    let mut report = report(BackendFault::None);
    report.tree = Some(Err::<crate::accel::bvh::TreeStats, _>("a gap".to_string()).into());
    assert_eq!(report.failures().len(), 1);
    assert!(report.failures()[0].contains("a gap"));
    report.tree = Some(Ok::<_, String>(crate::accel::bvh::TreeStats::default()).into());
    assert_eq!(report.failures(), Vec::<String>::new());
}

#[test]
fn embree_may_be_wrong_at_its_known_rates() {
    // It is wrong only along the shortest directions, where every answer may be wrong.
    let tiny = report_on(EMBREE, BackendFault::MissesTiny);
    assert!(tiny.backends[1].total.wrong() > 100);
    assert_eq!(tiny.failures(), Vec::<String>::new());
    // `bvh` with the same fault fails.
    assert_eq!(report(BackendFault::MissesTiny).failures().len(), 1);
    let leaky = report_on(EMBREE, BackendFault::Misses(0, 0));
    let failures = leaky.failures();
    let above = |source: &str| {
        let name = format!(" {source} rays, more than the known ");
        failures.iter().any(|failure| failure.starts_with("`embree`") && failure.contains(&name))
    };
    assert!(above("primary") && above("edge") && !above("tiny"), "{failures:?}");
    let [_, embree] = &leaky.backends[..] else { panic!("two backends") };
    assert_eq!(embree.allowed.len(), embree.sources.len());
    assert!(leaky.backends[0].allowed.is_empty());
}

#[test]
fn known_rates_allow_a_share_and_a_few_more() {
    let [few, many] = [100, 1_000_000].map(|rays| known::most(0.01, rays));
    assert_eq!((few, many), (11, 10_010));
    assert_eq!(known::rate(Backend::default(), "tiny"), None);
}

#[test]
fn a_ray_through_a_crowd_is_not_judged() {
    let at = |i: u16| [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| [x, y, f32::from(i)]);
    let mesh = |n: u16| {
        let vertices: Vec<[f32; 3]> = (0..n).flat_map(at).collect();
        let triangles = (0..u32::from(n)).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        crate::geometry::TriangleMesh::new(vertices, triangles, false)
    };
    for (n, expected) in [(1000, Verdict::Leak), (1001, Verdict::Crowd)] {
        let geometry =
            crate::geometry::Geometry::new(glam::DVec3::ZERO, vec![mesh(n)], vec![], vec![]);
        let geometry = geometry.unwrap();
        let oracle = Brute::build(&geometry, &OPTIONS, &Monitor::default()).unwrap();
        let ray = LaneRay {
            origin: glam::DVec3::new(0.25, 0.25, -1.0),
            direction: glam::DVec3::Z,
            tnear: 0.0,
            tfar: f64::INFINITY,
            leaving: crate::ray::NONE,
        };
        let truth = Answer::truth(&oracle, &ray, false);
        assert_eq!(judge(&oracle, &ray, truth, Answer::Miss, 1.0), expected);
    }
}

#[test]
fn the_error_bound_of_t_is_tight() {
    // An error of one or two roundings passes. An error of a hundred fails.
    let t = report(BackendFault::ScalesT(1.0 + 1.2e-7)).backends.remove(1).total;
    assert_eq!(t.wrong(), 0, "{t:?}");
    let t = report(BackendFault::ScalesT(1.0 + 1e-5)).backends.remove(1).total;
    assert!(t.of[&Verdict::WrongDistance] > t.rays / 10, "{t:?}");
}

#[test]
fn a_saved_finding_reproduces_the_case() {
    let report = report(BackendFault::Misses(0, 0));
    for finding in &report.findings {
        let text = serde_json::to_string(finding).unwrap();
        let back: Finding = serde_json::from_str(&text).unwrap();
        assert_eq!(&back, finding);
        let world = world();
        let oracle = Brute::build(&world.geometry, &OPTIONS, &Monitor::default()).unwrap();
        let case = back.case().unwrap();
        let ray = LaneRay::of(&case.packet.rays, back.lane);
        let truth = Answer::truth(&oracle, &ray, case.shadow);
        let faulty = Faulty(&oracle, BackendFault::Misses(0, 0));
        let answer = case.answers(&faulty, back.mode)[back.lane];
        assert_eq!((truth, answer), (back.truth, back.answer));
        assert_eq!(judge(&oracle, &ray, truth, answer, 1.0), back.verdict);
    }
}
