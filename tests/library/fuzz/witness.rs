//! Judges the rays of a picture for which the tree and `brute` differ.

use std::sync::Mutex;

use lightpath::accel::brute::Brute;
use lightpath::accel::lane::{LaneRay, lanes};
use lightpath::accel::{Accelerator, BuildInfo, BuildOptions};
use lightpath::geometry::{Geometry, Nearby};
use lightpath::lab::answer::Answer;
use lightpath::lab::query::answers;
use lightpath::lab::rays::PacketToTrace;
use lightpath::lab::verdict::{Verdict, judge};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, Mask, RayKind, RayPacket, Rays};

/// An accelerator that answers as a tree does. It keeps the verdicts on the answers that are not
/// the oracle's.
pub struct Witness<'a> {
    of: [OfKind<'a>; RayKind::ALL.len()],
}

struct OfKind<'a> {
    tree: &'a dyn Accelerator,
    oracle: Brute<'a>,
    found: Mutex<Vec<Verdict>>,
}

impl<'a> Witness<'a> {
    /// Builds the oracles of `tree`, which was built over `geometry`.
    pub fn new(geometry: &'a Geometry, tree: &'a dyn Accelerator) -> Self {
        let options = BuildOptions { threads: 1, max_bytes: None };
        let of = RayKind::ALL.map(|kind| {
            let part = (geometry.into(), geometry.unseen(kind));
            OfKind {
                tree: tree.only(kind).unwrap_or(tree),
                oracle: Brute::build_part(part, &options, &Monitor::default()).expect("an oracle"),
                found: Mutex::default(),
            }
        });
        Self { of }
    }

    /// The verdicts on answers that differ by more than the rounding of t.
    pub fn verdicts(self) -> Vec<Verdict> {
        self.of.into_iter().flat_map(|of| of.found.into_inner().expect("no panic")).collect()
    }
}

impl Accelerator for Witness<'_> {
    fn info(&self) -> BuildInfo {
        self.of[0].info()
    }

    fn only(&self, kind: RayKind) -> Option<&dyn Accelerator> {
        Some(&self.of[kind as usize])
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.of[RayKind::Camera as usize].closest(active, packet, coherence);
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.of[RayKind::Shadow as usize].occluded(active, rays, coherence);
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.of.iter().for_each(|of| of.near(geometry, nearby, found));
    }
}

impl OfKind<'_> {
    fn compare(&self, active: &Mask, rays: &Rays, shadow: bool, coherence: Coherence) {
        let packet = PacketToTrace { active: *active, rays: rays.clone() };
        let answers = answers(self.tree, &packet, shadow, coherence);
        for i in lanes(active) {
            let ray = LaneRay::of(rays, i);
            let truth = Answer::truth(&self.oracle, &ray, shadow);
            let verdict = judge(&self.oracle, &ray, truth, answers[i], 1.0);
            if verdict != Verdict::Agree {
                self.found.lock().expect("no panic").push(verdict);
            }
        }
    }
}

impl Accelerator for OfKind<'_> {
    fn info(&self) -> BuildInfo {
        self.tree.info()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.compare(active, &packet.rays, false, coherence);
        self.tree.closest(active, packet, coherence);
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.compare(active, rays, true, coherence);
        self.tree.occluded(active, rays, coherence);
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.tree.near(geometry, nearby, found);
    }
}
