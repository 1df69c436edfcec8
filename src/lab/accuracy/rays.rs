//! Cases with extreme rays: directions with zeros or of extreme lengths, ends on surfaces, NaN.

use crate::shading::{lane, set_lane};
use glam::DVec3;

use super::backends::CaseBackends;
use super::case::{Amount, Case, CaseRun, PassCriterion};
use super::counts::{CaseCounts, WrongKind};
use super::judge::{AimedPacket, Expect};
use super::meshes::{any_triangle, inside, point_on, scan, scene};
use crate::error::Result;
use crate::geometry::{Sphere, TriangleMesh};
use crate::lab::query::trace;
use crate::lab::random::Random;
use crate::ray::{Coherence, Mask, RayPacket, Rays};

const GROUP: &str = "rays";

const AMOUNT: Amount = Amount { packets: 150, slow_stride: 5, oracle_stride: 1 };

/// Largest allowed time of packets with impossible rays (NaN, infinity), relative to packets
/// without such rays.
const SLOW: f64 = 2.5;

/// Number of timings, of which the fastest counts.
const ROUNDS: usize = 7;

type Change = fn(&mut Random, &TriangleMesh, &mut AimedPacket, usize);

fn case(name: &'static str, what: &'static str, criterion: PassCriterion, change: Change) -> Case {
    Case::new(GROUP, name, what, criterion, move |run| {
        let geometry = scene(scan().placed(DVec3::ZERO, 1.0));
        run.trace(&geometry, AMOUNT, |random| aimed_packet(random, &geometry.meshes[0], change))
    })
}

/// Rays from a distance of 3 to points of the mesh, each changed by `change`.
fn aimed_packet(random: &mut Random, mesh: &TriangleMesh, change: Change) -> AimedPacket {
    AimedPacket::each(Expect::Oracle, |aimed, i| {
        let goal = point(random, mesh);
        aimed.through(i, random.direction() * 3.0, goal);
        change(random, mesh, aimed, i);
    })
}

fn point(random: &mut Random, mesh: &TriangleMesh) -> DVec3 {
    let triangle = any_triangle(random, mesh);
    inside(random, triangle)
}

fn vertex(random: &mut Random, mesh: &TriangleMesh) -> DVec3 {
    any_triangle(random, mesh)[0]
}

/// Replaces one or two components of the direction by values of `small`. The origin gets the goal's
/// coordinates on these axes, so the ray still passes near its goal.
fn flatten(random: &mut Random, aimed: &mut AimedPacket, i: usize, small: fn(&mut Random) -> f32) {
    let axis = random.below(3) as usize;
    let goal = aimed.goals[i];
    // One component, or two, which gives a ray along an axis.
    let both = random.below(2) == 0;
    for k in (0..3).filter(|&k| k == axis || (both && k == (axis + 1) % 3)) {
        aimed.rays.org[k][i] = goal[k] as f32;
        aimed.rays.dir[k][i] = small(random);
    }
}

fn stretch(aimed: &mut AimedPacket, i: usize, by: f64) {
    let direction = lane(&aimed.rays.dir, i).as_dvec3();
    set_lane(&mut aimed.rays.dir, i, (direction.normalize_or(DVec3::X) * by).as_vec3());
}

/// Sets ray `i` from `origin` in a random direction.
fn start(random: &mut Random, aimed: &mut AimedPacket, i: usize, origin: DVec3) {
    let direction = random.direction();
    aimed.put(i, origin, direction);
}

fn impossible(random: &mut Random, _: &TriangleMesh, aimed: &mut AimedPacket, i: usize) {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
    let value = bad[random.below(3) as usize];
    let axis = random.below(3) as usize;
    match random.below(6) {
        0 | 1 => aimed.rays.org[axis][i] = value,
        2 | 3 => aimed.rays.dir[axis][i] = value,
        4 => (0..3).for_each(|k| aimed.rays.dir[k][i] = value),
        // The other rays stay as they are.
        _ => {}
    }
}

/// Judges packets with impossible rays, and compares their time with the time of packets without
/// such rays. They may take at most [`SLOW`] times as long.
fn quickly(run: &mut CaseRun) -> Result<()> {
    let geometry = scene(scan().placed(DVec3::ZERO, 1.0));
    run.trace(&geometry, AMOUNT, |random| aimed_packet(random, &geometry.meshes[0], impossible))?;
    let (sums, note) = {
        let packets = |change: Change| -> Vec<Rays> {
            let mesh = &geometry.meshes[0];
            (0..64).map(|k| aimed_packet(&mut run.random(k), mesh, change).rays).collect()
        };
        let (clean, bad) = (packets(|_, _, _, _| {}), packets(impossible));
        let built = run.build(&geometry)?;
        timed(&built, [&clean, &bad])
    };
    run.note = Some(note);
    run.keep(&geometry, sums)
}

fn timed(built: &CaseBackends, sets: [&[Rays]; 2]) -> (Vec<CaseCounts>, String) {
    let mut worst: f64 = 0.0;
    let sums = built.counts(true, |backend, counts| {
        for way in backend.tested.coherences(Coherence::Coherent) {
            let mut least = [u64::MAX; 2];
            for _ in 0..ROUNDS {
                for (set, least) in sets.iter().zip(&mut least) {
                    let nanoseconds: u64 = set
                        .iter()
                        .map(|rays| {
                            let active = rays.possible(&Mask::ALL);
                            let rays = rays.clone();
                            let mut packet = RayPacket { rays, ..RayPacket::EMPTY };
                            trace(backend.accelerator, &active, &mut packet, false, way).as_nanos()
                                as u64
                        })
                        .sum();
                    *least = nanoseconds.min(*least);
                }
            }
            let ratio = least[1] as f64 / least[0].max(1) as f64;
            worst = worst.max(ratio);
            counts.rays += 1;
            if ratio > SLOW {
                counts.fail(WrongKind::Slow, DVec3::ZERO);
            }
        }
    });
    (
        sums,
        format!(
            "packets with impossible rays take at most {worst:.2} times as long as packets without"
        ),
    )
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    vec![
        case(
            "components 0 and -0",
            "directions with one or two components 0 or -0",
            PassCriterion::Exact,
            |random, _, aimed, i| {
                flatten(random, aimed, i, |random| 0f32.copysign(random.sign() as f32));
            },
        ),
        case(
            "denormal components",
            "directions with one or two denormal components",
            PassCriterion::Exact,
            |random, _, aimed, i| {
                flatten(random, aimed, i, |random| {
                    f32::from_bits(1 + random.below(0x7f_fffe)).copysign(random.sign() as f32)
                });
            },
        ),
        case(
            "direction of length 1e-30",
            "t is around 1e30",
            PassCriterion::Exact,
            |_, _, aimed, i| {
                stretch(aimed, i, 1e-30);
            },
        ),
        case(
            "direction of length 1e30",
            "t is around 1e-30",
            PassCriterion::Exact,
            |_, _, aimed, i| {
                stretch(aimed, i, 1e30);
            },
        ),
        case(
            "origins on vertices",
            "from vertices of the mesh in any direction",
            PassCriterion::Exact,
            |random, mesh, aimed, i| {
                let origin = vertex(random, mesh);
                start(random, aimed, i, origin);
            },
        ),
        case(
            "origins on edges and faces",
            "from points on the mesh, rounded to f32, in any direction",
            PassCriterion::Coarse(1e-3, "t is close to 0 near an origin on the mesh"),
            |random, mesh, aimed, i| {
                let triangle = any_triangle(random, mesh);
                let which = 1 + random.below(2);
                let origin = point_on(random, triangle, which);
                start(random, aimed, i, origin);
            },
        ),
        case(
            "origins on box planes",
            "from a plane of a triangle's box, often along that plane",
            PassCriterion::Exact,
            |random, mesh, aimed, i| {
                let axis = random.below(3) as usize;
                aimed.rays.org[axis][i] = vertex(random, mesh)[axis] as f32;
                if random.below(2) == 0 {
                    aimed.rays.dir[axis][i] = 0.0;
                }
            },
        ),
        Case::new(
            GROUP,
            "NaN and infinity",
            "some rays of a packet have NaN or infinite components: these miss, the others are \
             answered right, and the packet takes at most 2.5 times as long",
            PassCriterion::Exact,
            quickly,
        ),
        case(
            "tnear beyond tfar",
            "empty segments miss",
            PassCriterion::Exact,
            |random, _, aimed, i| {
                if random.below(4) > 0 {
                    (aimed.rays.tnear[i], aimed.rays.tfar[i]) = (2.0, random.unit() as f32);
                }
            },
        ),
        case(
            "zero direction",
            "rays without direction miss",
            PassCriterion::Exact,
            |random, _, aimed, i| {
                if random.below(4) > 0 {
                    let zero = 0f32.copysign(random.sign() as f32);
                    (0..3).for_each(|k| aimed.rays.dir[k][i] = zero);
                }
            },
        ),
        ends(),
        on_a_surface(),
    ]
}

/// A case of rays that start exactly on primitives, between two distant walls.
fn on_a_surface() -> Case {
    let what = "from points exactly on a triangle (inside, on an edge, at a corner), a quad or a sphere, axis-parallel and \
                tilted, in any direction: the ray does not hit that primitive at its start, and hits what lies behind it. \
                Whatever the bound of a backend's test, the primitive must be right";
    let criterion = PassCriterion::Coarse(1e-3, "a sphere may be hit again just behind the start");
    Case::new(GROUP, "origin on a surface", what, criterion, |run| {
        for slope in [0.0, 0.25, 0.625] {
            // Multiples of 1/64, so that points of the plane are exact in f32.
            let at = |x: f64, y: f64| DVec3::new(x, y, slope * x - 0.5 * slope * y);
            let [a, b, c] = [at(-0.5, -0.75), at(0.75, -0.5), at(-0.25, 0.75)];
            let wall =
                |z: f64| [[-8.0, -8.0], [9.0, -8.0], [0.0, 9.0]].map(|[x, y]| DVec3::new(x, y, z));
            let mesh = super::meshes::soup(&[[a, b, c], wall(6.0), wall(-6.0)]);
            let quad = [at(3.0, -1.0), at(5.0, -1.0), at(5.0, 1.0), at(3.0, 1.0)];
            let quad = quad.map(|v| v.as_vec3().to_array());
            let ball = Sphere { center: DVec3::new(-4.0, 0.0, 0.0), radius: 1.0 };
            let geometry = super::meshes::geometry(vec![mesh], vec![quad], vec![ball]);
            run.trace(
                &geometry,
                Amount { packets: 100, slow_stride: 5, oracle_stride: 1 },
                |random| {
                    AimedPacket::each(Expect::Primitive, |aimed, i| {
                        let share = f64::from(random.below(5)) / 4.0;
                        let origin = match random.below(5) {
                            0 => at(
                                f64::from(random.below(17)) / 64.0,
                                f64::from(random.below(17)) / 64.0,
                            ),
                            1 => a.lerp(b, share),
                            2 => [a, b, c][random.below(3) as usize],
                            3 => at(3.0 + 2.0 * share, f64::from(random.below(33)) / 32.0 - 0.5),
                            _ => {
                                ball.center + DVec3::AXES[random.below(3) as usize] * random.sign()
                            }
                        };
                        start(random, aimed, i, origin);
                    })
                },
            )?;
        }
        Ok(())
    })
}

/// A case for open segments. A hit exactly at `tfar` or `tnear` does not count. A hit one float
/// inside the segment counts.
fn ends() -> Case {
    let what = "a wall hit at exactly t = 4, 8 or 16; segments that end or begin there, one float \
                before, one float behind";
    Case::new(GROUP, "t exactly at tfar and tnear", what, PassCriterion::Exact, |run| {
        let corners = |z: f64| {
            let at = |x: f64, y: f64| DVec3::new(x, y, z);
            let (a, b, c, d) = (at(-8.0, -8.0), at(8.0, -8.0), at(8.0, 8.0), at(-8.0, 8.0));
            [[a, b, c], [a, c, d]]
        };
        let geometry = scene(super::meshes::soup(&[corners(4.0), corners(8.0)].concat()));
        run.trace(&geometry, Amount { packets: 60, ..AMOUNT }, |random| {
            AimedPacket::each(Expect::Oracle, |aimed, i| {
                let mut origin = (random.cube() * 512.0).round() / 128.0;
                origin.z = 0.0;
                let step = f64::from(1 << random.below(3));
                aimed.put(i, origin, DVec3::Z / step);
                let t = (4.0 * step) as f32;
                let near = f32::from_bits(t.to_bits() + random.below(3) - 1);
                match random.below(2) {
                    0 => aimed.rays.tfar[i] = near,
                    _ => aimed.rays.tnear[i] = near,
                }
            })
        })
    })
}
