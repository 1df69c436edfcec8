//! Cases with spheres: tiny and far, huge and near, seen from inside, from their surface, along
//! their outline. The right answers are roots computed in integers.

use crate::shading::lane;
use glam::DVec3;
use num_bigint::BigInt;

use super::backends::CaseBackends;
use super::case::{Case, PassCriterion};
use super::counts::{CaseCounts, WrongKind, ulp};
use super::judge::query;
use super::meshes::geometry;
use crate::accel::brute::Fraction;
use crate::accel::lane::LaneRay;
use crate::geometry::{Geometry, NONE, Sphere, Surfaces, refine};
use crate::lab::answer::Answer;
use crate::lab::query::trace;
use crate::lab::random::Random;
use crate::ray::{LANES, Mask, RayPacket, Rays};

const GROUP: &str = "spheres";

/// Number of packets in the quick run.
const PACKETS: u64 = 150;

/// Slow backends trace one of this many packets.
const SLOW: u64 = 2;

/// Distance from the outline within which f64 cannot decide a hit, relative to the distance from
/// the centre.
const OUTLINE: f64 = 1.0 / (1u64 << 48) as f64;

/// Converts numbers to whole multiples of one power of two, whose sums and products are exact.
struct Exact {
    exponent: i32,
}

impl Exact {
    /// Chooses the power of two of which all these finite numbers are multiples.
    fn of(numbers: &[f64]) -> Self {
        let least = numbers.iter().filter(|&&x| x != 0.0).map(|&x| parts(x).1).min();
        Self { exponent: least.unwrap_or(0) }
    }

    fn integer(&self, x: f64) -> BigInt {
        let (mantissa, exponent) = parts(x);
        if mantissa == 0 {
            BigInt::from(0)
        } else {
            BigInt::from(mantissa) << (exponent - self.exponent)
        }
    }

    fn vector(&self, v: DVec3) -> [BigInt; 3] {
        v.to_array().map(|x| self.integer(x))
    }
}

/// Splits `x` into an integer and the exponent of a power of two.
fn parts(x: f64) -> (i64, i32) {
    let bits = x.to_bits();
    let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, (bits & ((1 << 52) - 1)) as i64);
    let (magnitude, exponent) = match exponent {
        0 => (fraction, -1074),
        _ => (fraction | 1 << 52, exponent - 1075),
    };
    (if x < 0.0 { -magnitude } else { magnitude }, exponent)
}

fn dot(a: &[BigInt; 3], b: &[BigInt; 3]) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

/// Returns both t at which the line of a ray hits a sphere, or `None` for a miss.
///
/// Each t has a relative error of about 2^-52. The second value is true if the line passes the
/// outline so closely that f64 cannot decide the hit.
fn roots(ray: &LaneRay, sphere: &Sphere) -> (Option<[f64; 2]>, bool) {
    let LaneRay { origin, direction, .. } = *ray;
    let numbers = [origin.to_array(), direction.to_array(), sphere.center.to_array()].concat();
    let exact = Exact::of(&[&numbers[..], &[sphere.radius]].concat());
    let (o, d, c) = (exact.vector(origin), exact.vector(direction), exact.vector(sphere.center));
    let f: [BigInt; 3] = std::array::from_fn(|k| &c[k] - &o[k]);
    let r = exact.integer(sphere.radius);
    // a t^2 - 2 b t + c = 0
    let (a, b) = (dot(&d, &d), dot(&d, &f));
    let discriminant = &b * &b - &a * (dot(&f, &f) - &r * &r);
    let zero = BigInt::from(0);
    // Compare the square of half the chord, relative to the squared radius, with its error in f64,
    // which grows with the distance.
    let half2 = Fraction::new(discriminant.clone(), &a * &r * &r).to_f64();
    let distance = (sphere.center - origin).length();
    let unsure = half2.abs() <= 4.0 * OUTLINE * distance.max(sphere.radius) / sphere.radius;
    if discriminant < zero {
        return (None, unsure);
    }
    // A shift by 2^256 under the root leaves 128 fraction bits.
    let root = (discriminant << 256u32).sqrt();
    let (a, b) = (a << 128u32, b << 128u32);
    let t = |n: BigInt| Fraction::new(n, a.clone()).to_f64();
    (Some([t(&b - &root), t(b + root)]), unsure)
}

type Aim = fn(&mut Random, &Sphere) -> (DVec3, DVec3, bool);

struct Setup {
    sphere: Sphere,
    /// Returns origin, direction, and whether the ray leaves the sphere.
    aim: Aim,
}

fn case(
    name: &'static str,
    what: &'static str,
    criterion: PassCriterion,
    setups: Vec<Setup>,
) -> Case {
    Case::new(GROUP, name, what, criterion, move |run| {
        for (k, setup) in setups.iter().enumerate() {
            let geometry = geometry(vec![], vec![], vec![setup.sphere]);
            let first = (k as u64) << 40;
            run.check_packets(&geometry, PACKETS * run.settings.times, |run, built, index| {
                trace_packet(built, setup, &mut run.random(first + index), index)
            })?;
        }
        Ok(())
    })
}

/// Traces one packet with every tested backend and judges it by the roots in integers.
fn trace_packet(
    built: &CaseBackends,
    setup: &Setup,
    random: &mut Random,
    index: u64,
) -> Vec<CaseCounts> {
    let mut rays = Rays::EMPTY;
    let mut truths = [(None, false); LANES];
    for i in 0..LANES {
        let (origin, direction, leaving) = (setup.aim)(random, &setup.sphere);
        rays.set(i, origin.as_vec3(), direction.as_vec3());
        rays.leaving[i] = if leaving { 0 } else { NONE };
        let (roots, unsure) = roots(&LaneRay::of(&rays, i), &setup.sphere);
        // For a ray that leaves the sphere, the root nearer to 0 is its origin.
        truths[i] = match (roots, leaving) {
            (None, false) => (None, unsure),
            (None, true) => (None, true),
            (Some([a, b]), false) => ([a, b].into_iter().find(|&t| t > 0.0), unsure),
            (Some([a, b]), true) => {
                let other = if a.abs() < b.abs() { b } else { a };
                // The origin is rounded, so a root within a few ulp of it is uncertain.
                let unsure =
                    other.abs() * direction.length() <= 4.0 * ulp(origin.abs().max_element());
                (Some(other).filter(|&t| t > 0.0), unsure)
            }
        };
    }
    let active = Mask::ALL;
    let (shadow, packets) = query(index);
    built.counts(index % SLOW == 0, |backend, counts| {
        for way in backend.tested.coherences(packets) {
            let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
            let time = trace(backend.accelerator, &active, &mut packet, shadow, way);
            counts.nanoseconds += time.as_nanos() as u64;
            match shadow {
                true => judge_occlusion(setup, &packet.rays, &truths, counts),
                false => judge(built.geometry, setup, &packet, &truths, counts),
            }
        }
    })
}

/// Judges the answers of an occlusion query.
fn judge_occlusion(
    setup: &Setup,
    rays: &Rays,
    truths: &[(Option<f64>, bool); LANES],
    counts: &mut CaseCounts,
) {
    for (i, (truth, unsure)) in truths.iter().enumerate() {
        counts.rays += 1;
        match (truth.is_some(), Answer::occluded(rays, i).is_hit()) {
            (expected, found) if expected == found => {}
            _ if *unsure => counts.within_bound += 1,
            (true, _) => counts.fail(WrongKind::Leak, setup.sphere.center),
            (false, _) => counts.fail(WrongKind::FalseHit, setup.sphere.center),
        }
    }
}

fn judge(
    geometry: &Geometry,
    setup: &Setup,
    packet: &RayPacket,
    truths: &[(Option<f64>, bool); LANES],
    counts: &mut CaseCounts,
) {
    let hit = packet.hit(&Mask::ALL);
    let mut surfaces = Surfaces::EMPTY;
    refine(geometry, &hit, packet, &mut surfaces);
    for i in 0..LANES {
        counts.rays += 1;
        let ray = LaneRay::of(&packet.rays, i);
        let (truth, unsure) = truths[i];
        let leaving = packet.rays.leaving[i] != NONE;
        match (truth, hit.0[i] != 0) {
            (None, false) => {}
            (Some(_), false) | (None, true) if unsure => counts.within_bound += 1,
            (Some(_), false) => counts.fail(WrongKind::Leak, setup.sphere.center),
            (None, true) => counts.fail(WrongKind::FalseHit, setup.sphere.center),
            // A ray that leaves the sphere is judged below: its other root is as uncertain as its
            // origin.
            (Some(exact), true) if !leaving => {
                counts.measure((ray.tfar - exact).abs() / ulp(exact));
                let point = ray.origin + ray.direction * exact;
                let refined = lane(&surfaces.position, i).as_dvec3();
                let way = (ray.direction * exact).length();
                let scale = point.abs().max_element().max(way);
                let relative = (refined - point).abs().max_element() / scale;
                counts.measure_point(relative);
            }
            (Some(exact), true) => {
                let off = (ray.tfar - exact).abs() * ray.direction.length();
                let slack = 8.0 * ulp(ray.origin.abs().max_element());
                let flat = (ray.direction.length() * exact).max(f64::from(f32::MIN_POSITIVE));
                // On a chord of length l, the rounding of the origin moves the other end by 2 r / l
                // times as much.
                if off > slack * (1.0 + 2.0 * setup.sphere.radius / flat) {
                    counts.fail(WrongKind::WrongDistance, setup.sphere.center);
                }
            }
        }
    }
}

/// Direction from `origin` to a point of the disk that the sphere shows, at `share` of the disk's
/// radius from its middle.
fn at_share(random: &mut Random, sphere: &Sphere, origin: DVec3, share: f64) -> DVec3 {
    let origin = origin.as_vec3().as_dvec3();
    let axis = sphere.center - origin;
    let side = random.direction().cross(axis).normalize_or(DVec3::X);
    // The angle between a tangent and the axis has the sine r / distance.
    let sine = (sphere.radius / axis.length() * share).min(1.0);
    let cosine = (1.0 - sine * sine).sqrt();
    axis.normalize() * cosine + side * sine
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    let sphere = |center: [f64; 3], radius: f64| Sphere { center: center.into(), radius };
    let unit = [([0.0; 3], 1.0), ([3.0, -2.0, 7.0], 1.0), ([1e3, 5.0, -1e3], 250.0)];
    let units = move |aim: Aim| -> Vec<Setup> {
        unit.into_iter().map(|(c, r)| Setup { sphere: sphere(c, r), aim }).collect()
    };
    vec![
        case(
            "tiny and far",
            "radius 1e-3 at distance 1e5, seen from the origin and from points 1e4 around it",
            PassCriterion::Exact,
            [[0.0, 0.0, 1e5], [7e4, -3e4, 6.5e4]]
                .map(|center| Setup {
                    sphere: sphere(center, 1e-3),
                    aim: |random, sphere| {
                        let from = match random.below(2) {
                            0 => DVec3::ZERO,
                            _ => random.direction() * 1e4,
                        };
                        let share = random.within(0.0, 1.5);
                        (from, at_share(random, sphere, from, share), false)
                    },
                })
                .into(),
        ),
        case(
            "huge ground, camera 1 above it",
            "radius 1e7, rays from 1 above its surface in any direction that points down",
            PassCriterion::Exact,
            vec![Setup {
                sphere: sphere([0.0, -1e7, 0.0], 1e7),
                aim: |random, _| {
                    let mut direction = random.direction();
                    direction.y = -direction.y.abs() * 10f64.powf(random.within(-3.0, 0.0));
                    (DVec3::new(0.0, 1.0, 0.0), direction, false)
                },
            }],
        ),
        case(
            "from inside",
            "origins inside the sphere: every ray hits it",
            PassCriterion::Exact,
            units(|random, sphere| {
                let origin = sphere.center + random.cube() * 0.57 * sphere.radius;
                (origin, random.direction() * 10f64.powf(random.within(-3.0, 3.0)), false)
            }),
        ),
        case(
            "from its own surface",
            "rays that leave the sphere: outwards they hit nothing, inwards its other side",
            PassCriterion::Zero("t is as uncertain as the rounded origin, and held to that bound"),
            units(|random, sphere| {
                let origin = sphere.center + random.direction() * sphere.radius;
                (origin, random.direction(), true)
            }),
        ),
        case(
            "grazing within 1e-7 of tangency",
            "rays that pass within 1e-7 of the radius inside or outside the outline",
            PassCriterion::Exact,
            units(|random, sphere| {
                let from =
                    sphere.center + random.direction() * sphere.radius * random.within(1.5, 20.0);
                let share = 1.0 + random.within(-1e-7, 1e-7);
                (from, at_share(random, sphere, from, share), false)
            }),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(origin: [f64; 3], direction: [f64; 3], radius: f64) -> (Option<[f64; 2]>, bool) {
        let (origin, direction) = (origin.into(), direction.into());
        let ray = LaneRay { origin, direction, tnear: 0.0, tfar: f64::INFINITY, leaving: NONE };
        roots(&ray, &Sphere { center: DVec3::ZERO, radius })
    }

    #[test]
    fn roots_are_exact() {
        assert_eq!(of([0.0, 0.0, -3.0], [0.0, 0.0, 1.0], 1.0), (Some([2.0, 4.0]), false));
        assert_eq!(of([0.0, 0.0, 0.0], [0.0, 0.0, 0.5], 1.0), (Some([-2.0, 2.0]), false));
        assert_eq!(of([0.0, 1.5, -3.0], [0.0, 0.0, 1.0], 1.0), (None, false));
        // A tangent, and lines 2^-60 beside it: decided exactly, but unsure for f64.
        assert_eq!(of([0.0, 1.0, -3.0], [0.0, 0.0, 1.0], 1.0), (Some([3.0, 3.0]), true));
        let beside = 2f64.powi(-60);
        assert_eq!(of([1.0, beside, -3.0], [0.0, 0.0, 1.0], 1.0), (None, true));
        let near = 1.0 - 2f64.powi(-40);
        assert!(matches!(of([0.0, near, -3.0], [0.0, 0.0, 1.0], 1.0), (Some(_), false)));
    }
}
