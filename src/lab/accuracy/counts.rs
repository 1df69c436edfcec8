//! Counts of wrong answers and worst errors of one backend in one case.

use std::collections::BTreeMap;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::lab::named::named;
use crate::lab::verdict::Verdict;
use crate::units::counted;

/// Largest number of failures whose places are kept for the pictures.
const PLACES: usize = 400;

/// Largest relative error of a right point: 2^-23.
///
/// Rounding to f32 moves a coordinate by at most 2^-24 of itself. The other half is room for the
/// errors of f64 and of the oracle's t (2^-40), which are far smaller.
const POINT: f64 = 1.0 / (1u64 << 23) as f64;

/// Returns the worse of two errors. NaN is worse than all.
pub fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

named! {
    /// Kind of a wrong answer.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum WrongKind {
        /// The ray passed through a surface.
        Leak = "leak",
        /// A hit on a primitive that the ray misses by more than the error bound, or a lane without
        /// a ray that was changed.
        FalseHit = "false hit",
        /// The right t, but on a primitive that the ray misses by more than the error bound.
        WrongPrimitive = "wrong primitive",
        /// The right primitive at a wrong t, or a vertex at a wrong place.
        WrongDistance = "wrong distance",
        /// A tie that did not go to the lowest primitive, of a backend that promises it.
        Tie = "not the lowest primitive",
        /// A line crosses a closed mesh an odd number of times, or not as often as the oracle.
        Crossings = "odd or missing crossing",
        /// A surface shadows itself although nothing lies in the way.
        SelfShadow = "self-shadow",
        /// Light passes through an occluder.
        LightLeak = "light leak",
        /// A pixel of a shifted scene differs from that of the scene at the origin.
        Pixel = "pixel differs",
        /// Packets with impossible rays (NaN, infinity) take too long.
        Slow = "slow",
    }
}

impl WrongKind {
    /// Colour of the dots in pictures: R, G, B.
    pub fn color(self) -> [u8; 3] {
        match self {
            Self::Leak | Self::LightLeak => [0xe6, 0x12, 0x2e],
            Self::FalseHit => [0xff, 0x8c, 0x00],
            Self::WrongPrimitive | Self::Tie => [0x8e, 0x24, 0xaa],
            Self::WrongDistance | Self::Slow => [0x00, 0x8a, 0xd8],
            Self::Crossings => [0x00, 0xa1, 0x5c],
            Self::SelfShadow => [0xc2, 0x18, 0x5b],
            Self::Pixel => [0xd4, 0xb1, 0x06],
        }
    }
}

/// Kind of error of a verdict of [`crate::lab::verdict::judge`]; `None` if it is no error.
pub fn kind_of(verdict: Verdict) -> Option<WrongKind> {
    match verdict {
        Verdict::Agree | Verdict::Tie | Verdict::Edge | Verdict::Crowd => None,
        Verdict::Leak => Some(WrongKind::Leak),
        Verdict::FalseHit => Some(WrongKind::FalseHit),
        Verdict::WrongPrimitive => Some(WrongKind::WrongPrimitive),
        Verdict::WrongDistance => Some(WrongKind::WrongDistance),
    }
}

/// Counts and worst errors of one backend.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CaseCounts {
    /// Number of judged answers. A ray counts once for each coherence.
    pub rays: u64,
    /// Number of wrong answers of each kind.
    pub failures: BTreeMap<WrongKind, u64>,
    /// Answers that differ from the exact one within the error bound of the backend's own test.
    pub within_bound: u64,
    /// Hits that are as near as the lowest primitive but on another one, of backends that do not
    /// promise the lowest.
    pub ties: u64,
    /// Answers that a case counts without failing it.
    pub counted: u64,
    /// Number of hits whose t was compared with the exact t.
    pub measured: u64,
    /// Number of these hits with t off by more than 2 f32 ulp.
    pub beyond_2: u64,
    /// Number of these hits with t off by more than 8 f32 ulp.
    pub beyond_8: u64,
    /// Largest error of t, in f32 ulp of the exact t.
    pub worst_ulp: f64,
    /// Largest error of a refined point, relative to its scale.
    ///
    /// The scale is the largest of the point's coordinates, the primitive's coordinates (not for
    /// the group `spheres`), and the distance between point and ray origin.
    pub worst_relative: f64,
    /// Number of refined points with a relative error above 2^-23.
    pub points_off: u64,
    /// Largest error of a refined barycentric weight.
    pub worst_weight: f64,
    /// Nanoseconds spent in the backend, summed over threads.
    pub nanoseconds: u64,
    /// Places and kinds of the first failures.
    pub places: Vec<(DVec3, WrongKind)>,
}

impl CaseCounts {
    /// Returns a message if any failure of these kinds was counted.
    pub fn has_any(&self, kinds: &[WrongKind]) -> Option<String> {
        let count = |kind: &WrongKind| self.failures.get(kind).copied().unwrap_or(0);
        let found = kinds.iter().find(|kind| count(kind) > 0)?;
        let wrong = counted(count(found), ["answer is", "answers are"]);
        Some(format!("{wrong} wrong ({}), expected none", found.name()))
    }

    /// Counts a wrong answer, shown at `place` in pictures.
    pub fn fail(&mut self, kind: WrongKind, place: DVec3) {
        *self.failures.entry(kind).or_default() += 1;
        if self.places.len() < PLACES {
            self.places.push((place, kind));
        }
    }

    /// Counts a hit whose t has this error in f32 ulp. NaN counts as beyond all limits.
    pub fn measure(&mut self, ulp: f64) {
        self.measured += 1;
        self.beyond_2 += u64::from(!(ulp <= 2.0));
        self.beyond_8 += u64::from(!(ulp <= 8.0));
        self.worst_ulp = worse(self.worst_ulp, ulp);
    }

    /// Counts the relative error of a refined point. NaN counts as off.
    pub fn measure_point(&mut self, relative: f64) {
        self.points_off += u64::from(!(relative <= POINT));
        self.worst_relative = worse(self.worst_relative, relative);
    }

    /// Number of wrong answers of all kinds.
    pub fn failed(&self) -> u64 {
        self.failures.values().sum()
    }

    /// Adds the counts of `other` and keeps the larger of each worst error.
    pub fn add(&mut self, other: &Self) {
        self.rays += other.rays;
        for (kind, n) in &other.failures {
            *self.failures.entry(*kind).or_default() += n;
        }
        self.within_bound += other.within_bound;
        self.ties += other.ties;
        self.counted += other.counted;
        self.measured += other.measured;
        self.beyond_2 += other.beyond_2;
        self.beyond_8 += other.beyond_8;
        self.points_off += other.points_off;
        self.worst_ulp = self.worst_ulp.max(other.worst_ulp);
        self.worst_relative = self.worst_relative.max(other.worst_relative);
        self.worst_weight = self.worst_weight.max(other.worst_weight);
        self.nanoseconds += other.nanoseconds;
        let room = PLACES - self.places.len();
        self.places.extend(other.places.iter().take(room));
    }
}

/// One f32 ulp at `exact`: 2^-23 times the power of two at or below |`exact`|, but at least the
/// smallest normal number.
pub fn ulp(exact: f64) -> f64 {
    let smallest = f64::from(f32::MIN_POSITIVE);
    let power = exact.abs().max(smallest).log2().floor();
    f64::from(f32::EPSILON) * power.exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ulp_is_the_distance_to_the_next_float() {
        for x in [1.0f32, 1.5, 1.999_999_9, 2.0, 3e-20, 7e30, 0.1] {
            let next = f32::from_bits(x.to_bits() + 1);
            assert_eq!(ulp(x.into()), f64::from(next) - f64::from(x), "{x}");
        }
    }

    #[test]
    fn tallies_add_up() {
        let mut one = CaseCounts { rays: 3, worst_ulp: 1.0, ..CaseCounts::default() };
        one.fail(WrongKind::Leak, DVec3::ONE);
        let mut two = one.clone();
        two.measure(9.0);
        two.add(&one);
        assert_eq!((two.rays, two.failed(), two.beyond_8), (6, 2, 1));
        assert_eq!((two.worst_ulp, two.places.len()), (9.0, 2));
        two.measure(f64::NAN);
        assert_eq!(two.beyond_8, 2);
        for (relative, off) in [(6e-8, 0), (2e-7, 1), (f64::NAN, 2)] {
            two.measure_point(relative);
            assert_eq!(two.points_off, off, "{relative}");
        }
        assert_eq!(two.worst_relative, f64::INFINITY);
    }
}
