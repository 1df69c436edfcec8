//! Thin triangles and quads with rays nearly along them, where Embree's own test reports false
//! hits.

use glam::DVec3;
use lightpath::accel::Accelerator;
use lightpath::accel::brute::Brute;
use lightpath::accel::lane::LaneRay;
use lightpath::geometry::Geometry;
use lightpath::lab::{
    answer::Answer,
    verdict::{Verdict, judge},
};
use lightpath::ray::{Coherence, LANES, RayPacket, Rays};
use lightpath::scene::{Backend, EmbreeMode};

use super::setup::{ALL, cube, geometry, oracle, packet, unit};
use crate::support::backends::build;
use crate::support::random::Random;

const EMBREE: Backend = Backend::Embree(EmbreeMode::Robust);

/// Embree's error bound in units of `bvh`'s, as in `crosscheck`.
const FACTOR: f64 = 4.0;

/// Random slivers, and rays nearly along them.
struct Soup {
    geometry: Geometry,
    /// A corner, the long side, and a direction across it in the plane.
    frames: Vec<[DVec3; 3]>,
}

impl Soup {
    /// Makes triangles or quads with an angle of `degrees` between their long sides.
    fn new(degrees: f64, quads: bool, random: &mut Random) -> Self {
        let (mut vertices, mut triangles, mut fours) = (Vec::new(), Vec::new(), Vec::new());
        let mut frames = Vec::new();
        for _ in 0..60 {
            let corner = cube(random);
            let long = unit(random) * 10f64.powf(random.within(-1.5, 0.5));
            let across = unit(random).cross(long).normalize();
            let wide = across * long.length() * degrees.to_radians();
            let of = |v: DVec3| v.as_vec3().to_array();
            frames.push([corner, long, across]);
            if quads {
                fours.push([corner, corner + long, corner + long + wide, corner + wide].map(of));
            } else {
                let first = vertices.len() as u32;
                vertices.extend([corner, corner + long, corner + long + wide].map(of));
                triangles.push([first, first + 1, first + 2]);
            }
        }
        Self { geometry: geometry(vertices, triangles, fours), frames }
    }

    /// Returns a ray that starts near a sliver's plane and runs nearly along it, mostly past it.
    fn ray(&self, random: &mut Random) -> (DVec3, DVec3) {
        let [corner, long, across] = self.frames[random.below(self.frames.len())];
        let length = long.length();
        let mut off = || unit(random) * 10f64.powf(random.within(-9.0, -1.0));
        let (shift, turn) = (off() * length, off());
        let along = (long / length + across * turn.x + turn).normalize();
        let target = corner + long * random.unit() + shift;
        (target - along * length * random.within(0.1, 20.0), along)
    }
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
struct Wrong {
    false_hits: u64,
    primitives: u64,
    distances: u64,
    leaks: u64,
}

impl Wrong {
    fn add(&mut self, verdict: Verdict) {
        match verdict {
            Verdict::FalseHit => self.false_hits += 1,
            Verdict::WrongPrimitive => self.primitives += 1,
            Verdict::WrongDistance => self.distances += 1,
            Verdict::Leak => self.leaks += 1,
            Verdict::Agree | Verdict::Tie | Verdict::Edge | Verdict::Crowd => {}
        }
    }
}

/// Returns the wrong candidates, closest hits and shadows of a packet.
fn wrong(oracle: &Brute, embree: &dyn Accelerator, rays: &Rays, how: Coherence) -> [Wrong; 3] {
    let mut wrong = [Wrong::default(); 3];
    let traced = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
    let (mut native, mut closest, mut shadow) = (traced.clone(), traced, rays.clone());
    embree.closest_unfiltered(&ALL, &mut native, how);
    embree.closest(&ALL, &mut closest, how);
    embree.occluded(&ALL, &mut shadow, how);
    for i in 0..LANES {
        let ray = LaneRay::of(rays, i);
        let hit = oracle.closest_hit(&ray);
        let judged = |is_shadow: bool, answer: Answer| {
            judge(oracle, &ray, Answer::of_hit(hit, is_shadow), answer, FACTOR)
        };
        wrong[0].add(judged(false, Answer::closest(&native, i)));
        wrong[1].add(judged(false, Answer::closest(&closest, i)));
        wrong[2].add(judged(true, Answer::occluded(&shadow, i)));
    }
    wrong
}

/// Sums the counts over soups of one kind.
fn survey(degrees: f64, quads: bool) -> [Wrong; 3] {
    let mut random = Random(degrees.to_bits() ^ u64::from(quads));
    let mut sums = [Wrong::default(); 3];
    let mut discarded = 0;
    for _ in 0..8 {
        let soup = Soup::new(degrees, quads, &mut random);
        let (embree, oracle) = (build(&soup.geometry, EMBREE), oracle(&soup.geometry));
        for k in 0..600 {
            let rays = packet(|| soup.ray(&mut random)).rays;
            let how = [Coherence::Coherent, Coherence::Unordered, Coherence::Single][k % 3];
            let more = wrong(&oracle, &*embree, &rays, how);
            for (sum, more) in sums.iter_mut().zip(more) {
                sum.false_hits += more.false_hits;
                sum.primitives += more.primitives;
                sum.distances += more.distances;
                sum.leaks += more.leaks;
            }
        }
        discarded += embree.false_hits();
    }
    println!("{degrees} quads {quads}: {sums:?}, {discarded} discarded");
    assert!(discarded >= sums[0].false_hits);
    sums
}

/// Only Embree has candidates to reject.
#[test]
#[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
fn no_false_hit_is_left() {
    let mut native = 0;
    for degrees in [1.0, 0.1, 0.01, 1e-3] {
        for quads in [false, true] {
            let [candidates, closest, shadow] = survey(degrees, quads);
            native += candidates.false_hits;
            assert!(closest.leaks <= candidates.leaks, "{closest:?} {candidates:?}");
            for left in [closest, shadow] {
                assert_eq!((left.false_hits, left.primitives, left.distances), (0, 0, 0));
            }
        }
    }
    // Otherwise these rays would show nothing.
    assert!(native > 100, "{native}");
}
