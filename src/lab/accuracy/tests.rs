//! Tests with backends that give wrong answers on purpose.

use std::collections::HashSet;

use glam::DVec3;

use super::backends::CaseBackends;
use super::case::{PassCriterion, forbidden, oracle};
use super::counts::{CaseCounts, WrongKind, worse};
use super::judge::{AimedPacket, Expect, judge_packet, query};
use super::meshes::{corners, geometry, icosphere, inside, scene};
use super::{AccuracySettings, catalogue};
use crate::accel::Accelerator;
use crate::lab::backend::TestedBackend;
use crate::lab::faulty::{BackendFault, Faulty};
use crate::lab::random::Random;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES};
use crate::scene::Backend;
use crate::simd::Isa;

/// Counts of `brute` with a fault, on a sphere. If `closed`, all rays start at its centre.
fn counts(fault: BackendFault, closed: bool) -> CaseCounts {
    let geometry = scene(icosphere(2).placed(DVec3::ZERO, 1.0));
    let monitor = Monitor::default();
    let backend = TestedBackend::new("brute", Backend::Brute);
    let within = oracle(&geometry, &monitor).unwrap();
    let oracle = oracle(&geometry, &monitor).unwrap();
    let faulty: Box<dyn Accelerator> = Box::new(Faulty(&within, fault));
    let tested = std::slice::from_ref(&backend);
    let built = CaseBackends { geometry: &geometry, tested, accelerators: vec![faulty], oracle };
    let mut sum = CaseCounts::default();
    for index in 0..64 {
        let mut random = Random::new(1, index);
        let expect = if closed { Expect::Closed([f64::INFINITY; LANES]) } else { Expect::Oracle };
        let mut aimed = AimedPacket::new(expect);
        for i in 0..LANES {
            let goal = inside(&mut random, corners(&geometry.meshes[0], i as u32 * 3));
            let origin = if closed { DVec3::ZERO } else { random.direction() * 3.0 };
            aimed.through(i, origin, goal);
        }
        if fault == BackendFault::WritesLane7 {
            aimed.rays.dir[1][7] = f32::NAN;
        }
        sum.add(&judge_packet(&built, &aimed, index, !closed, true)[0]);
    }
    sum
}

#[test]
fn a_backend_without_fault_passes() {
    for closed in [false, true] {
        let counts = counts(BackendFault::None, closed);
        assert_eq!(counts.rays, 64 * LANES as u64);
        assert_eq!(PassCriterion::Exact.missed(&counts), None);
    }
}

#[test]
fn every_fault_is_found_with_its_kind() {
    let cases = [
        (BackendFault::MissesLane3, true, WrongKind::Leak),
        (BackendFault::MissesLane3, false, WrongKind::Leak),
        (BackendFault::FirstPrimitiveInLane5, false, WrongKind::WrongPrimitive),
        (BackendFault::ScalesT(1.001), false, WrongKind::WrongDistance),
        (BackendFault::WritesLane7, false, WrongKind::FalseHit),
    ];
    for (fault, closed, kind) in cases {
        let counts = counts(fault, closed);
        assert!(counts.failures.contains_key(&kind), "{kind:?}: {:?}", counts.failures);
        assert!(PassCriterion::Exact.missed(&counts).is_some(), "{kind:?}");
        assert!(PassCriterion::Zero("").missed(&counts).is_some(), "{kind:?}");
        assert!(!counts.places.is_empty());
    }
}

#[test]
fn an_inaccurate_t_does_not_meet_the_exact_mark() {
    // 4, then 16 times 2^-23, relative. The error bound of a test in f32 would allow the first.
    for ulps in [4.0, 16.0] {
        let off = 1.0 + ulps * f64::from(f32::EPSILON);
        let counts = counts(BackendFault::ScalesT(off), false);
        assert!(PassCriterion::Exact.missed(&counts).is_some(), "{ulps}");
        assert!(counts.beyond_2 > 0);
    }
    let says = |counts: CaseCounts| {
        let all = CaseCounts { rays: 1_000_000, measured: 1_000_000, ..counts };
        PassCriterion::Exact.missed(&all)
    };
    let none = CaseCounts::default;
    assert_eq!(says(none()), None);
    let one = says(CaseCounts { beyond_8: 1, worst_ulp: 9.0, ..none() });
    assert_eq!(one.unwrap(), "t is off by 9.0 ulp, expected at most 8");
    let many = says(CaseCounts { beyond_2: 1000, ..none() });
    assert_eq!(many.unwrap(), "1000 of 1000000 hits have t more than 2 ulp off");
    let weight = says(CaseCounts { worst_weight: worse(0.0, f64::NAN), ..none() });
    assert!(weight.unwrap().starts_with("a weight is off by inf"));
}

/// t is right, and the reported place lies on the quad's other half: refinement ends at its
/// diagonal.
#[test]
fn a_refined_point_off_the_hit_does_not_meet_a_mark() {
    let quad = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 4.0, 0.0f32]];
    let geometry = geometry(vec![], vec![quad], vec![]);
    let monitor = Monitor::default();
    let tested = [TestedBackend::new("brute", Backend::Brute)];
    let within = oracle(&geometry, &monitor).unwrap();
    for (fault, passes) in [(BackendFault::None, true), (BackendFault::OtherHalf, false)] {
        let faulty: Box<dyn Accelerator> = Box::new(Faulty(&within, fault));
        let (tested, oracle) = (&tested[..], oracle(&geometry, &monitor).unwrap());
        let built =
            CaseBackends { geometry: &geometry, tested, accelerators: vec![faulty], oracle };
        let mut random = Random::new(1, 0);
        let aimed = AimedPacket::each(Expect::Oracle, |aimed, i| {
            let goal = DVec3::new(random.within(0.0, 4.0), random.within(0.0, 4.0), 0.0);
            aimed.through(i, goal + DVec3::new(1.0, 0.5, 3.0), goal);
        });
        let counts = &judge_packet(&built, &aimed, 0, true, true)[0];
        assert_eq!((counts.failed(), counts.beyond_2), (0, 0));
        for criterion in [PassCriterion::Exact, PassCriterion::Coarse(0.01, "why")] {
            let missed = criterion.missed(counts);
            assert_eq!(missed.is_none(), passes, "{missed:?}");
        }
    }
}

#[test]
fn marks_allow_as_many_failures_as_documented() {
    let mut counts = CaseCounts { rays: 1_000_000, ..CaseCounts::default() };
    assert_eq!(PassCriterion::Exact.missed(&counts), None);
    for _ in 0..3 {
        counts.fail(WrongKind::Leak, DVec3::ZERO);
    }
    assert!(PassCriterion::Exact.missed(&counts).is_some());
    assert!(PassCriterion::Exact.missed(&CaseCounts::default()).is_some(), "no rays, no criterion");
    let coarse = CaseCounts { rays: 1000, measured: 1000, beyond_2: 5, ..CaseCounts::default() };
    assert!(PassCriterion::Exact.missed(&coarse).is_some());
    assert!(PassCriterion::Coarse(0.004, "why").missed(&coarse).is_some());
    assert_eq!(PassCriterion::Coarse(0.005, "why").missed(&coarse), None);
    let heavy = CaseCounts { rays: 1, worst_weight: 2e-6, ..CaseCounts::default() };
    assert!(PassCriterion::Exact.missed(&heavy).is_some());
}

#[test]
fn every_backend_gets_all_queries_and_coherences() {
    for stride in 1..=400 {
        let queries: Vec<_> = (0..60).map(|k| query(k * stride)).collect();
        for shadow in [false, true] {
            for coherence in [Coherence::Coherent, Coherence::Unordered] {
                let count = queries.iter().filter(|q| **q == (shadow, coherence)).count();
                assert!(count > 0, "every {stride}th packet: {shadow} {coherence:?}");
            }
        }
    }
    let shadows = (0..1000).filter(|&index| query(index).0).count();
    assert!((220..=280).contains(&shadows), "{shadows}");
}

#[test]
fn names_are_unique_and_the_catalogue_has_all_groups() {
    let cases = catalogue();
    let names: HashSet<(&str, &str)> = cases.iter().map(|c| (c.group, c.name.as_str())).collect();
    assert_eq!(names.len(), cases.len());
    let groups: HashSet<&str> = cases.iter().map(|case| case.group).collect();
    assert_eq!(groups.len(), 10);
}

#[test]
fn robust_embree_may_leak_but_not_report_false_hits_or_self_shadows() {
    let named = |name: &str| TestedBackend::parse("", name, Isa::detect()).unwrap();
    let counts =
        |kind| CaseCounts { rays: 9, failures: [(kind, 1)].into(), ..CaseCounts::default() };
    let of_embree = forbidden(named("embree").backend);
    assert!(
        counts(WrongKind::FalseHit).has_any(of_embree).is_some_and(|why| why.contains("false hit"))
    );
    assert!(counts(WrongKind::SelfShadow).has_any(of_embree).is_some());
    assert_eq!(counts(WrongKind::Leak).has_any(of_embree), None);
    assert_eq!(counts(WrongKind::FalseHit).has_any(forbidden(named("embree-fast").backend)), None);
    assert!(named("brute").must_be_right() && !named("embree").must_be_right());
}

#[test]
fn counts_do_not_depend_on_the_number_of_threads() {
    let tested_backends =
        TestedBackend::all().into_iter().filter(TestedBackend::must_be_right).collect();
    let settings = AccuracySettings { tested_backends, seed: 5, times: 1, pictures: false };
    let case = |case: &super::Case| case.name.contains("tfar and tnear");
    let count = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let cases = catalogue();
        let case = cases.iter().find(|c| case(c)).unwrap();
        let row = pool.install(|| case.run(&settings, &Monitor::default())).unwrap();
        let of = |entry: &super::BackendCounts| {
            (entry.rays, entry.failed, entry.within_bound, entry.worst_ulp)
        };
        row.entries.iter().map(of).collect::<Vec<_>>()
    };
    assert_eq!(count(1), count(2));
}
