//! What the rows would say of backends that are wrong.

use std::collections::HashSet;

use glam::DVec3;

use super::case::{Mark, oracle};
use super::column::{Built, Column};
use super::judge::{Expect, Judge, Shot};
use super::meshes::{corners, icosphere, inside, scene};
use super::tally::{Kind, Tally};
use super::{Settings, catalogue};
use crate::accel::{Accelerator, BuildInfo};
use crate::measure::random::Random;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays};

/// What is wrong with a backend.
#[derive(Clone, Copy, PartialEq)]
enum Lie {
    Nothing,
    /// Misses what lane 3 meets.
    Blind,
    /// Every t by this factor.
    Off(f32),
    /// Meets the first triangle with lane 5.
    Name,
    /// Writes to lanes that do not count.
    Untidy,
}

/// Answers as the one within does, but for the lie.
struct Liar<'a>(Box<dyn Accelerator + 'a>, Lie);

impl Accelerator for Liar<'_> {
    fn info(&self) -> BuildInfo {
        self.0.info()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        let before = packet.rays.tfar;
        self.0.closest(active, packet, coherence);
        match self.1 {
            Lie::Nothing => {}
            Lie::Blind => (packet.hits.geom[3], packet.rays.tfar[3]) = (NONE, before[3]),
            Lie::Off(by) => packet.rays.tfar.iter_mut().for_each(|t| *t *= by),
            Lie::Name => packet.hits.prim[5] = 0,
            Lie::Untidy => packet.rays.tfar[7] = 1.0,
        }
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.0.occluded(active, rays, coherence);
        if self.1 == Lie::Blind {
            rays.tfar[3] = 1.0;
        }
    }
}

/// What `brute` is said to have done, lying so, with rays from within and without a closed mesh.
fn tally(lie: Lie, closed: bool) -> Tally {
    let geometry = scene(icosphere(2).placed(DVec3::ZERO, 1.0));
    let monitor = Monitor::default();
    let columns = Column::all();
    let column = columns.last().unwrap();
    let within = column.build(&geometry, 1, &monitor).unwrap();
    let oracle = oracle(&geometry, &monitor).unwrap();
    let liar: Box<dyn Accelerator> = Box::new(Liar(within, lie));
    let built = Built { geometry: &geometry, columns: vec![(column, liar)], oracle };
    let judge = Judge { built: &built };
    let mut sum = Tally::default();
    for index in 0..64 {
        let mut random = Random::new(1, index);
        let expect = match closed {
            true => Expect::Closed([f64::INFINITY; LANES]),
            false => Expect::Oracle,
        };
        let mut shot = Shot::new(expect);
        for i in 0..LANES {
            let goal = inside(&mut random, corners(&geometry.meshes[0], i as u32 * 3));
            let origin = if closed { DVec3::ZERO } else { random.direction() * 3.0 };
            shot.through(i, origin, goal);
        }
        if lie == Lie::Untidy {
            shot.rays.dir[1][7] = f32::NAN;
        }
        sum.add(&judge.shot(&shot, index, !closed, true)[0]);
    }
    sum
}

#[test]
fn an_honest_backend_passes() {
    for closed in [false, true] {
        let tally = tally(Lie::Nothing, closed);
        assert_eq!(tally.rays, 64 * LANES as u64);
        assert_eq!(Mark::Exact.missed(&tally), None);
    }
}

#[test]
fn lies_are_found_and_named() {
    let cases = [
        (Lie::Blind, true, Kind::Leak),
        (Lie::Blind, false, Kind::Leak),
        (Lie::Name, false, Kind::WrongPrimitive),
        (Lie::Off(1.001), false, Kind::WrongDistance),
        (Lie::Untidy, false, Kind::FalseHit),
    ];
    for (lie, closed, kind) in cases {
        let tally = tally(lie, closed);
        assert!(tally.failures.contains_key(&kind), "{kind:?}: {:?}", tally.failures);
        assert!(Mark::Exact.missed(&tally).is_some(), "{kind:?}");
        assert!(Mark::Zero("").missed(&tally).is_some(), "{kind:?}");
        assert!(!tally.places.is_empty());
    }
}

#[test]
fn a_coarse_t_misses_the_mark_though_nothing_is_wrong() {
    // Three ulp, then some twelve: the bound of a test in f32 would allow the first.
    for (ulps, says) in [(4.0, "more than 2 ulp"), (16.0, "expected at most 8")] {
        let off = 1.0 + ulps * f32::EPSILON;
        let tally = tally(Lie::Off(off), false);
        let missed = Mark::Exact.missed(&tally).unwrap_or_default();
        let failed = tally.failed() > 0;
        assert!(missed.contains(says) || failed, "{missed}");
        assert!(tally.beyond_2 > 0);
    }
}

#[test]
fn marks_allow_what_they_say() {
    let mut tally = Tally { rays: 1_000_000, ..Tally::default() };
    assert_eq!(Mark::Exact.missed(&tally), None);
    for _ in 0..3 {
        tally.fail(Kind::Leak, DVec3::ZERO);
    }
    assert!(Mark::Exact.missed(&tally).is_some());
    assert_eq!(Mark::Rate(3e-6, "why").missed(&tally), None);
    assert!(Mark::Rate(2e-6, "why").missed(&tally).is_some());
    assert!(Mark::Exact.missed(&Tally::default()).is_some(), "no rays, no mark");
    let coarse = Tally { rays: 1000, measured: 1000, beyond_2: 5, ..Tally::default() };
    assert!(Mark::Exact.missed(&coarse).is_some());
    assert!(Mark::Coarse(0.004, "why").missed(&coarse).is_some());
    assert_eq!(Mark::Coarse(0.005, "why").missed(&coarse), None);
    let heavy = Tally { rays: 1, worst_weight: 2e-6, ..Tally::default() };
    assert!(Mark::Exact.missed(&heavy).is_some());
}

#[test]
fn names_are_unique_and_every_part_of_the_catalogue_is_there() {
    let cases = catalogue();
    let names: HashSet<(&str, &str)> = cases.iter().map(|c| (c.group, c.name.as_str())).collect();
    assert_eq!(names.len(), cases.len());
    let groups: HashSet<&str> = cases.iter().map(|case| case.group).collect();
    assert_eq!(groups.len(), 10);
}

#[test]
fn robust_embree_may_leak_but_not_hit_what_is_not_there() {
    let column = |name: &str| Column::all().into_iter().find(|c| c.name() == name).unwrap();
    let tally = |kind| Tally { rays: 9, failures: [(kind, 1)].into(), ..Tally::default() };
    let forbidden = column("embree").forbidden();
    assert!(tally(Kind::FalseHit).has_any(forbidden).is_some_and(|why| why.contains("false hit")));
    assert!(tally(Kind::SelfShadow).has_any(forbidden).is_some());
    assert_eq!(tally(Kind::Leak).has_any(forbidden), None);
    assert_eq!(tally(Kind::FalseHit).has_any(column("embree-fast").forbidden()), None);
    assert!(column("brute").must_hold() && !column("embree").must_hold());
}

#[test]
fn a_case_counts_the_same_for_any_number_of_threads() {
    let columns: Vec<Column> = Column::all().into_iter().filter(Column::must_hold).collect();
    let settings = Settings { columns, seed: 5, times: 1, pictures: false };
    let case = |case: &super::Case| case.name.contains("tfar and tnear");
    let count = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let cases = catalogue();
        let case = cases.iter().find(|c| case(c)).unwrap();
        let row = pool.install(|| case.run(&settings, &Monitor::default())).unwrap();
        let of =
            |entry: &super::Entry| (entry.rays, entry.failed, entry.within_bound, entry.worst_ulp);
        row.entries.iter().map(of).collect::<Vec<_>>()
    };
    assert_eq!(count(1), count(2));
}
