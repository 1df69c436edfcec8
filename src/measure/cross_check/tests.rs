use std::path::Path;

use super::*;
use crate::accel::{BuildInfo, BuildOptions};
use crate::ray::{Mask, Rays};
use crate::scene::{self, EmbreeMode, Source as SceneSource};
use crate::simd::Isa;
use crate::world::LoadOptions;

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

/// What a liar does to a right answer.
#[derive(Clone, Copy)]
enum Lie {
    None,
    /// Does not see one primitive.
    Blind(u32, u32),
    /// Sees a primitive where there is nothing.
    Ghost,
    /// Names another primitive of the same geometry.
    Name,
    /// Is off by a share of t.
    Off(f32),
    /// Sees nothing along the shortest directions.
    BlindToTiny,
}

/// The oracle, but for one lie.
struct Liar<'a>(&'a Brute<'a>, Lie);

impl Accelerator for Liar<'_> {
    fn info(&self) -> BuildInfo {
        BuildInfo::default()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, _: Coherence) {
        for i in lanes(active) {
            let blind =
                |hit: &Hit| matches!(self.1, Lie::Blind(g, p) if (hit.geom, hit.prim) == (g, p));
            let ray = Ray::of(&packet.rays, i);
            if matches!(self.1, Lie::BlindToTiny) && ray.direction.length() < 1e-29 {
                continue;
            }
            let hits = self.0.all_hits(&ray);
            match (hits.into_iter().find(|hit| !blind(hit)), self.1) {
                (Some(mut hit), lie) => {
                    match lie {
                        Lie::Name if hit.geom == 0 => hit.prim = 1 - hit.prim,
                        Lie::Off(share) => hit.t *= 1.0 + f64::from(share),
                        _ => {}
                    }
                    hit.store(packet, i);
                }
                (None, Lie::Ghost) => {
                    (packet.hits.geom[i], packet.hits.prim[i]) = (0, 0);
                    packet.rays.tfar[i] = 1.0;
                }
                (None, _) => {}
            }
        }
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, _: Coherence) {
        for i in lanes(active) {
            let mut packet = RayPacket { rays: rays.clone(), hits: Hits::EMPTY };
            self.closest(active, &mut packet, Coherence::Single);
            if packet.hits.geom[i] != crate::ray::NONE {
                rays.tfar[i] = f32::NEG_INFINITY;
            }
        }
    }
}

/// The report of a check whose second contender, said to be `bvh`, lies.
fn report(lie: Lie) -> Report {
    report_on(Backend::default(), lie)
}

fn report_on(backend: Backend, lie: Lie) -> Report {
    let world = world();
    let oracle = Brute::build(&world.geometry, &OPTIONS, &Monitor::default()).unwrap();
    let liar = Liar(&oracle, lie);
    let contenders = [
        Contender { backend: Backend::Brute, accelerator: &oracle },
        Contender { backend, accelerator: &liar },
    ];
    let check = Check {
        world: &world,
        oracle: &oracle,
        contenders: &contenders,
        coursework: None,
        rays: 4000,
        seed: 7,
    };
    let mut report = check_rays(&check, &Monitor::default()).unwrap();
    report.pictures =
        compare_pictures(&world, &oracle, &contenders, Isa::Portable, &Monitor::default()).unwrap();
    report
}

#[test]
fn who_tells_the_truth_passes() {
    let report = report(Lie::None);
    assert_eq!(report.failures(), Vec::<String>::new());
    let total = report.backends[1].total;
    assert_eq!((total.rays, total.rays), (total.agree, 2 * report.backends[0].total.rays));
    assert_eq!(report.pictures[0].same, 32 * 24);
    // Every kind of ray that the scene has.
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
fn every_lie_is_found_and_named() {
    let wrong = |lie| {
        let report = report(lie);
        assert_eq!(
            report.failures().len(),
            1 + usize::from(report.pictures[0].failure().is_some())
        );
        let kept = report.findings.iter().all(|f| f.backend == "bvh" && f.fails());
        assert!(kept && !report.findings.is_empty());
        report
    };
    let blind = wrong(Lie::Blind(0, 0));
    let t = blind.backends[1].total;
    assert!(t.leak > 100 && t.false_hit + t.wrong_distance == 0, "{t:?}");
    // Its picture has a hole, which wrong rays explain.
    let picture = &blind.pictures[0];
    assert!(picture.wrong[1] > 10 && picture.wrong[0] == 0 && picture.unexplained == 0);
    assert!(picture.failure().is_some());
    let t = wrong(Lie::Ghost).backends[1].total;
    assert!(t.false_hit > 100 && t.leak + t.wrong_distance + t.wrong_primitive == 0, "{t:?}");
    let t = wrong(Lie::Name).backends[1].total;
    assert!(t.wrong_primitive > 100 && t.leak + t.false_hit == 0, "{t:?}");
    let t = wrong(Lie::Off(1e-3)).backends[1].total;
    assert!(t.wrong_distance > 100 && t.leak + t.wrong_primitive == 0, "{t:?}");
}

#[test]
fn one_pixel_of_ours_that_is_wrong_fails() {
    let picture = |backends, wrong| PictureReport {
        backends,
        pixels: 10_000,
        same: 9_999,
        explained: 0,
        wrong,
        unexplained: 0,
        not_looked_into: 0,
        first_unexplained: None,
    };
    let failure = picture(["embree", "bvh"], [0, 1]).failure().unwrap();
    assert!(failure.contains("1 pixels differ by rays that `bvh` answers wrong"), "{failure}");
    assert!(picture(["bvh", "embree"], [1, 0]).failure().is_some());
    // A fact about Embree, and few enough.
    assert_eq!(picture(["bvh", "embree"], [0, 1]).failure(), None);
}

#[test]
fn a_tree_that_is_not_as_promised_fails() {
    let mut report = report(Lie::None);
    report.tree = Some(Err::<crate::accel::bvh::Stats, _>("a gap".to_string()).into());
    assert_eq!(report.failures().len(), 1);
    assert!(report.failures()[0].contains("a gap"));
    report.tree = Some(Ok::<_, String>(crate::accel::bvh::Stats::default()).into());
    assert_eq!(report.failures(), Vec::<String>::new());
}

#[test]
fn embree_may_be_wrong_as_often_as_is_known() {
    // All of what it gets wrong are the shortest directions, where that is a known fact.
    let tiny = report_on(EMBREE, Lie::BlindToTiny);
    assert!(tiny.backends[1].total.wrong() > 100);
    assert_eq!(tiny.failures(), Vec::<String>::new());
    // The same is no excuse for our own.
    assert_eq!(report(Lie::BlindToTiny).failures().len(), 1);
    let blind = report_on(EMBREE, Lie::Blind(0, 0));
    let failures = blind.failures();
    let above = |source: &str| {
        let name = format!(" {source} rays wrong, more than the known ");
        failures.iter().any(|failure| failure.starts_with("`embree`") && failure.contains(&name))
    };
    assert!(above("primary") && above("edge") && !above("tiny"), "{failures:?}");
    let [_, embree] = &blind.backends[..] else { panic!("two backends") };
    assert_eq!(embree.allowed.len(), embree.sources.len());
    assert!(blind.backends[0].allowed.is_empty());
}

#[test]
fn known_rates_are_shares() {
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
        let ray = Ray {
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
fn the_bound_of_t_is_not_generous() {
    // A rounding or two pass; a hundred do not.
    let t = report(Lie::Off(1.2e-7)).backends[1].total;
    assert_eq!(t.wrong(), 0, "{t:?}");
    let t = report(Lie::Off(1e-5)).backends[1].total;
    assert!(t.wrong_distance > t.rays / 10, "{t:?}");
}

#[test]
fn a_saved_finding_is_the_same_case_again() {
    let report = report(Lie::Blind(0, 0));
    for finding in &report.findings {
        let text = serde_json::to_string(finding).unwrap();
        let back: Finding = serde_json::from_str(&text).unwrap();
        assert_eq!(&back, finding);
        let world = world();
        let oracle = Brute::build(&world.geometry, &OPTIONS, &Monitor::default()).unwrap();
        let case = back.case().unwrap();
        let ray = Ray::of(&case.packet.rays, back.lane);
        let truth = Answer::truth(&oracle, &ray, case.shadow);
        let answer = answers(&Liar(&oracle, Lie::Blind(0, 0)), &case, back.mode)[back.lane];
        assert_eq!((truth, answer), (back.truth, back.answer));
        assert_eq!(judge(&oracle, &ray, truth, answer, 1.0), back.verdict);
    }
}
