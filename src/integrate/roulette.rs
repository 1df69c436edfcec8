//! Shadow rays where they are needed: a part of a packet's light points first, and the others only where
//! these disagree, or by chance.
//!
//! If all of the first points are seen, or none, the packet most likely lies outside of the penumbra. The
//! others are then traced with the probability [`CHANCE`] alone, and what they find different from what the
//! first ones say is weighted by its inverse (Russian roulette on the difference). Over the choices the mean
//! is what tracing all of them gives, for any scene: nothing is ever skipped for certain. Where the first
//! points are right nothing is added, so neither umbra nor full light get noise by this.

use std::ops::Range;

use crate::scene::FIRST_SHADOW_POINTS;

/// The probability of tracing the other points where the first ones agree.
pub const CHANCE: f32 = 0.125;

/// The first points are this part of all, but no fewer than [`FIRST_SHADOW_POINTS`].
const PART: u32 = 4;

/// Some of the points of a light, for each shading point.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Which points.
    pub points: Range<u32>,
    /// Whether they are traced; if not, all are seen.
    pub traced: bool,
    /// What a point counts that is seen.
    pub seen: f64,
    /// What a point counts that is hidden.
    pub hidden: f64,
}

impl Stage {
    /// Points that are traced and count what they bring.
    #[inline(always)]
    fn plain(points: Range<u32>) -> Self {
        Self { points, traced: true, seen: 1.0, hidden: 0.0 }
    }

    /// All of a light's points, or those that decide about the others.
    #[inline(always)]
    pub fn first(points: u32, adaptive: bool) -> Self {
        let part = points.div_ceil(PART).max(FIRST_SHADOW_POINTS).min(points);
        Self::plain(0..if adaptive { part } else { points })
    }

    /// What comes after the first points: of `active` rays, `seen` reached the light. `refine`: what came
    /// true with the probability [`CHANCE`].
    pub fn rest(points: Range<u32>, active: u32, seen: u32, refine: bool) -> Option<Self> {
        let inverse = f64::from(1.0 / CHANCE);
        let plain = Self::plain(points);
        match (seen, refine) {
            (0, false) => None,
            (0, true) => Some(Self { seen: inverse, ..plain }),
            (n, _) if n < active => Some(plain),
            (_, false) => Some(Self { traced: false, ..plain }),
            // Full light, and its difference to what is found.
            (_, true) => Some(Self { hidden: 1.0 - inverse, ..plain }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a point brings on average over the choice, if it is seen or not.
    fn mean(seen: u32, visible: bool) -> f64 {
        let of = |refine: bool| match Stage::rest(4..16, 4, seen, refine) {
            None => 0.0,
            Some(stage) if visible || !stage.traced => stage.seen,
            Some(stage) => stage.hidden,
        };
        f64::from(CHANCE) * of(true) + f64::from(1.0 - CHANCE) * of(false)
    }

    #[test]
    fn the_mean_over_the_choice_is_what_tracing_gives() {
        for seen in 0..=4 {
            assert!((mean(seen, true) - 1.0).abs() < 1e-12, "{seen} of 4");
            assert!(mean(seen, false).abs() < 1e-12, "{seen} of 4");
        }
    }

    #[test]
    fn where_the_first_points_disagree_all_are_traced() {
        for refine in [false, true] {
            assert_eq!(Stage::rest(4..16, 64, 1, refine), Some(Stage::plain(4..16)));
        }
        assert_eq!(Stage::rest(4..16, 64, 0, false), None);
    }

    #[test]
    fn few_points_are_all_first() {
        assert_eq!(Stage::first(4, true), Stage::plain(0..4));
        assert_eq!(Stage::first(1, true), Stage::plain(0..1));
        assert_eq!(Stage::first(8, true), Stage::plain(0..4));
        assert_eq!(Stage::first(64, true), Stage::plain(0..16));
        assert_eq!(Stage::first(64, false), Stage::plain(0..64));
    }
}
