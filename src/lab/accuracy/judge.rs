//! Traces one packet with every tested backend and judges the answers.

use std::time::Instant;

use glam::DVec3;

use super::backends::CaseBackends;
use super::counts::{CaseCounts, WrongKind, kind_of, ulp, worse};
use crate::accel::Accelerator;
use crate::accel::lane::{LaneHit, LaneRay, lanes};
use crate::geometry::{Geometry, GeometryKind, Surfaces, refine};
use crate::lab::answer::Answer;
use crate::lab::backend::{BuiltBackend, MAX_ERROR_FACTOR};
use crate::lab::query::trace;
use crate::lab::random::Random;
use crate::lab::verdict::{MAX_NEAR, Verdict, judge};
use crate::ray::{Coherence, LANES, Mask, NONE, RayPacket, Rays, lane};

/// Largest number of crossings of one line that are counted.
const MAX_CROSSINGS: usize = 64;

/// The rule by which the answers of a packet are judged.
#[derive(Debug, Clone, Copy)]
pub enum Expect {
    /// The oracle's answer. An answer within the error bound of the backend's intersection test is
    /// right, too.
    Oracle,
    /// The oracle's primitive or its miss: no error bound excuses another. t is not compared.
    Primitive,
    /// As [`Expect::Oracle`]. Of equally near primitives, the one of the lowest index, of backends
    /// that must be right. Another choice of other backends counts as a tie.
    Lowest,
    /// A closed surface lies in the way: every ray is occluded, and hits at a t below this.
    Closed([f64; LANES]),
    /// Lines that begin outside a closed mesh cross it as often as in the oracle, and an even
    /// number of times.
    Crossings,
}

/// 16 rays, and how their answers are judged.
pub struct AimedPacket {
    /// The rays. Invalid ones (see [`Rays::possible`]) are never traced.
    pub rays: Rays,
    /// A point of each ray that pictures of failures show: its target, or else its origin.
    pub goals: [DVec3; LANES],
    /// Which answers are right.
    pub expect: Expect,
}

impl AimedPacket {
    /// Creates a packet without rays.
    pub fn new(expect: Expect) -> Self {
        Self { rays: Rays::EMPTY, goals: [DVec3::ZERO; LANES], expect }
    }

    /// Creates a packet and aims its rays one by one with `aim`.
    pub fn each(expect: Expect, mut aim: impl FnMut(&mut Self, usize)) -> Self {
        let mut packet = Self::new(expect);
        (0..LANES).for_each(|i| aim(&mut packet, i));
        packet
    }

    /// Sets ray `i` from `origin`, rounded to f32, to `goal`. But for the rounding of the
    /// direction, t is 1 at `goal`.
    pub fn through(&mut self, i: usize, origin: DVec3, goal: DVec3) {
        let origin = origin.as_vec3().as_dvec3();
        self.put(i, origin, goal - origin);
        self.goals[i] = goal;
    }

    /// Sets ray `i` from `origin` along `direction`, both rounded to f32.
    pub fn put(&mut self, i: usize, origin: DVec3, direction: DVec3) {
        self.rays.set(i, origin.as_vec3(), direction.as_vec3());
        self.goals[i] = origin;
    }
}

/// Returns whether packet `index` is an occlusion query, as one packet in four is, and the
/// coherence of the packet.
///
/// Slow backends trace every n-th packet. A remainder of the index could give these one query
/// alone.
pub fn query(index: u64) -> (bool, Coherence) {
    let mut random = Random::new(0, index);
    let shadow = random.below(4) == 3;
    let coherence = [Coherence::Coherent, Coherence::Unordered][random.below(2) as usize];
    (shadow, coherence)
}

/// Traces and judges one packet. Returns the counts of each backend.
///
/// The oracle answers each packet, but those of [`Expect::Closed`] only if `known`. If `slow`, slow
/// backends trace the packet, too. `index` is the packet's number in its case.
pub fn judge_packet(
    built: &CaseBackends,
    aimed: &AimedPacket,
    index: u64,
    known: bool,
    slow: bool,
) -> Vec<CaseCounts> {
    let active = aimed.rays.possible(&Mask::ALL);
    let exact = known || !matches!(aimed.expect, Expect::Closed(_));
    let mut truths: [Option<LaneHit>; LANES] = [None; LANES];
    for i in lanes(&active).filter(|_| exact) {
        truths[i] = built.oracle.closest_hit(&LaneRay::of(&aimed.rays, i));
    }
    // Crossings are closest hits, always.
    let (shadow, packets) = query(index);
    built.counts(slow, |backend, counts| {
        let test = PacketTest { aimed, active, truths: exact.then_some(&truths), built, backend };
        if matches!(aimed.expect, Expect::Crossings) {
            return test.crossings(counts);
        }
        for (nth, way) in backend.tested.coherences(packets).into_iter().enumerate() {
            test.answers(shadow, way, nth == 0, counts);
        }
    })
}

/// One packet, to be traced with one backend.
struct PacketTest<'a> {
    aimed: &'a AimedPacket,
    active: Mask,
    truths: Option<&'a [Option<LaneHit>; LANES]>,
    built: &'a CaseBackends<'a>,
    backend: BuiltBackend<'a>,
}

impl PacketTest<'_> {
    fn answers(&self, shadow: bool, way: Coherence, measure: bool, counts: &mut CaseCounts) {
        let mut packet = RayPacket { rays: self.aimed.rays.clone(), ..RayPacket::EMPTY };
        let time = trace(self.backend.accelerator, &self.active, &mut packet, shadow, way);
        counts.nanoseconds += time.as_nanos() as u64;
        for i in 0..LANES {
            counts.rays += 1;
            if let Some(kind) = self.judge(i, &packet, shadow, counts) {
                counts.fail(kind, self.aimed.goals[i]);
            }
        }
        if let Some(truths) = self.truths.filter(|_| measure && !shadow) {
            measure_hits(self.built.geometry, &self.active, &packet, truths, counts);
        }
    }

    /// Returns the kind of error in lane `i`, or `None` if its answer is right; counts answers that
    /// only the error bound makes right. A lane without a ray must be unchanged.
    fn judge(
        &self,
        i: usize,
        packet: &RayPacket,
        shadow: bool,
        counts: &mut CaseCounts,
    ) -> Option<WrongKind> {
        let answer = Answer::in_lane(packet, i, shadow);
        if self.active.0[i] == 0 {
            let same = packet.rays.tfar[i].to_bits() == self.aimed.rays.tfar[i].to_bits();
            return (!same || packet.hits.geom[i] != NONE).then_some(WrongKind::FalseHit);
        }
        if let Expect::Closed(before) = &self.aimed.expect {
            let leaks = match answer {
                Answer::Miss => true,
                Answer::Hit { t, .. } => t >= before[i],
                Answer::Occluded => false,
            };
            if leaks {
                return Some(WrongKind::Leak);
            }
        }
        let truth = self.truths?[i];
        let exact = Answer::of_hit(truth, shadow);
        if matches!(self.aimed.expect, Expect::Primitive) {
            return match (exact, answer) {
                (Answer::Miss, Answer::Miss) | (Answer::Occluded, Answer::Occluded) => None,
                (Answer::Hit { .. }, Answer::Hit { .. }) => {
                    let found = (packet.hits.geom[i], packet.hits.prim[i]);
                    (truth.map(|hit| (hit.geom, hit.prim)) != Some(found))
                        .then_some(WrongKind::FalseHit)
                }
                (_, Answer::Miss) => Some(WrongKind::Leak),
                _ => Some(WrongKind::FalseHit),
            };
        }
        let ray = LaneRay::of(&self.aimed.rays, i);
        let verdict =
            judge(&self.built.oracle, &ray, exact, answer, self.backend.tested.error_factor());
        if matches!((self.aimed.expect, verdict), (Expect::Lowest, Verdict::Tie)) {
            // Only the backends that must be right promise the lowest index.
            if self.backend.tested.must_be_right() {
                return Some(WrongKind::Tie);
            }
            counts.ties += 1;
            return None;
        }
        counts.within_bound += u64::from(matches!(verdict, Verdict::Tie | Verdict::Edge));
        kind_of(verdict)
    }

    /// Counts the crossings of each line with the mesh and compares them with the oracle's.
    ///
    /// Only clear lines are judged: no edge of a primitive lies within the error bound, no two
    /// crossings are too close to separate, and none is too close to tnear.
    fn crossings(&self, counts: &mut CaseCounts) {
        for i in lanes(&self.active) {
            let ray = LaneRay::of(&self.aimed.rays, i);
            if !self.clear(&ray) {
                continue;
            }
            let expected = self.built.oracle.all_hits(&ray).len();
            let started = Instant::now();
            let found =
                crossings(self.backend.accelerator, self.built.geometry, &self.aimed.rays, i);
            counts.nanoseconds += started.elapsed().as_nanos() as u64;
            counts.rays += 1;
            if found != expected || found % 2 != 0 {
                counts.fail(WrongKind::Crossings, self.aimed.goals[i]);
            }
        }
    }

    /// Returns whether the line is clear: see [`PacketTest::crossings`].
    fn clear(&self, ray: &LaneRay) -> bool {
        // A line that is clear of edges within the largest bound is clear for every backend.
        let Some(mut near) = self.built.oracle.near(ray, MAX_ERROR_FACTOR, MAX_NEAR) else {
            return false;
        };
        near.sort_by(|a, b| a.t.total_cmp(&b.t));
        let apart = near.windows(2).all(|w| w[0].t + w[0].t_error < w[1].t - w[1].t_error);
        let inside = |part: &crate::accel::brute::Near| {
            (0..3).all(|edge| part.outline.clearance(edge) > 0.0)
                && (part.t - part.t_error > ray.tnear || part.t + part.t_error < ray.tnear)
        };
        apart && near.iter().all(inside)
    }
}

/// Counts the hits along a line, up to [`MAX_CROSSINGS`]. Each query starts at the previous hit and
/// cannot hit its primitive again.
fn crossings(accelerator: &dyn Accelerator, geometry: &Geometry, rays: &Rays, i: usize) -> usize {
    let mut active = Mask::NONE;
    active.0[i] = -1;
    let (mut tnear, mut leaving) = (rays.tnear[i], rays.leaving[i]);
    for found in 0..MAX_CROSSINGS {
        let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
        (packet.rays.tnear[i], packet.rays.leaving[i]) = (tnear, leaving);
        accelerator.closest(&active, &mut packet, Coherence::Single);
        if packet.hits.geom[i] == NONE {
            return found;
        }
        tnear = packet.rays.tfar[i];
        leaving = geometry.primitive(packet.hits.geom[i], packet.hits.prim[i]);
    }
    MAX_CROSSINGS
}

/// Largest magnitude of a coordinate of the primitive that was hit; of a sphere, a bound.
fn size(geometry: &Geometry, hit: &LaneHit) -> f64 {
    match geometry.kind(hit.geom) {
        GeometryKind::Spheres => {
            let sphere = &geometry.spheres[hit.prim as usize];
            sphere.center.abs().max_element() + sphere.radius
        }
        _ => {
            let corners = geometry.triangles(hit.geom, hit.prim).flat_map(|(corners, _)| corners);
            corners.fold(f32::MIN_POSITIVE.into(), |most, v| v.abs().max_element().max(most))
        }
    }
}

/// Measures the errors of t, refined point and weights of hits on the right primitive. Values that
/// overflow are not measured.
fn measure_hits(
    geometry: &Geometry,
    active: &Mask,
    packet: &RayPacket,
    truths: &[Option<LaneHit>; LANES],
    counts: &mut CaseCounts,
) {
    let mut surfaces = Surfaces::EMPTY;
    let hit = packet.hit(active);
    if !hit.any() {
        return;
    }
    refine(geometry, &hit, packet, &mut surfaces);
    for i in lanes(&hit) {
        let same = |h: &LaneHit| (h.geom, h.prim) == (packet.hits.geom[i], packet.hits.prim[i]);
        let Some(exact) = truths[i].filter(same) else { continue };
        if exact.t < f64::from(f32::MAX) {
            counts.measure((f64::from(packet.rays.tfar[i]) - exact.t).abs() / ulp(exact.t));
        }
        let ray = LaneRay::of(&packet.rays, i);
        let way = ray.direction * exact.t;
        let point = ray.origin + way;
        let refined = lane(&surfaces.position, i).as_dvec3();
        let scale = point.abs().max_element().max(way.length()).max(size(geometry, &exact));
        let relative = (refined - point).abs().max_element() / scale;
        if scale <= f64::from(f32::MAX) {
            counts.measure_point(relative);
        }
        if geometry.mesh(exact.geom).is_some() {
            let error = worse((surfaces.u[i] - exact.u).abs(), (surfaces.v[i] - exact.v).abs());
            counts.worst_weight = worse(counts.worst_weight, error);
        }
    }
}
