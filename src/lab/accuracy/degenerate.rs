//! Cases with degenerate triangles: zero area, duplicates, slivers, tiny and huge triangles.

use glam::DVec3;

use super::case::{Amount, Case, PassCriterion};
use super::judge::{AimedPacket, Expect};
use super::meshes::{any_triangle, inside, point_on, scene, soup};
use crate::geometry::TriangleMesh;
use crate::lab::random::Random;

const GROUP: &str = "degenerate";

const AMOUNT: Amount = Amount { packets: 160, slow_stride: 4, oracle_stride: 1 };

/// Makes 16 rays that start at `distance` from the origin. Each passes through a point of a random
/// triangle: a corner, a point of an edge or a point inside. Only inside, unless `expect` is
/// [`Expect::Oracle`].
fn aim(random: &mut Random, mesh: &TriangleMesh, distance: f64, expect: Expect) -> AimedPacket {
    // Half of the packets have one common origin.
    let together = random.below(2) == 0;
    let mut from = DVec3::ZERO;
    AimedPacket::each(expect, |aimed, i| {
        if i == 0 || !together {
            from = random.direction() * distance;
        }
        let triangle = any_triangle(random, mesh);
        let which = random.below(4);
        let goal = match expect {
            Expect::Oracle => point_on(random, triangle, which),
            _ => inside(random, triangle),
        };
        aimed.through(i, from, goal);
    })
}

fn case(
    name: &'static str,
    what: &'static str,
    distance: f64,
    expect: Expect,
    make: fn(&mut Random) -> TriangleMesh,
) -> Case {
    Case::new(GROUP, name, what, PassCriterion::Exact, move |run| {
        // The packets use the random sequences from 0 on, so the mesh takes the last one.
        let geometry = scene(make(&mut run.random(u64::MAX)));
        run.trace(&geometry, AMOUNT, |random| aim(random, &geometry.meshes[0], distance, expect))
    })
}

/// A triangle whose corners lie at distance `size` from a random point in [-1, 1)^3.
fn some(random: &mut Random, size: f64) -> [DVec3; 3] {
    let at = random.cube();
    [0; 3].map(|_| at + random.direction() * size)
}

/// A mesh of 150 ordinary triangles and 150 of `others`. Rays that miss the others may hit an
/// ordinary triangle behind them.
fn crowd(random: &mut Random, others: impl Fn(&mut Random) -> [DVec3; 3]) -> TriangleMesh {
    let mut triangles: Vec<[DVec3; 3]> = (0..150).map(|_| some(random, 0.2)).collect();
    triangles.extend((0..150).map(|_| others(random)));
    soup(&triangles)
}

fn fan(random: &mut Random) -> TriangleMesh {
    // Two sectors of cones, each a tenth of a turn. A sector is 2,000 needles with a common apex,
    // each 3,400 times as long as wide.
    let mut triangles = Vec::new();
    for _ in 0..2 {
        let apex = random.cube() * 0.5;
        let (axis, side) = (random.direction(), random.direction());
        let x = axis.cross(side).normalize_or(DVec3::X);
        let y = axis.cross(x);
        let rim = |k: u32| {
            let angle = f64::from(k % 20_000) * std::f64::consts::TAU / 20_000.0;
            apex + axis * 0.3 + (x * angle.cos() + y * angle.sin()) * 0.8
        };
        triangles.extend((0..2000).map(|k| [apex, rim(k), rim(k + 1)]));
    }
    soup(&triangles)
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    vec![
        case(
            "zero area",
            "triangles with equal corners among ordinary ones: never hit, and they hide nothing",
            4.0,
            Expect::Oracle,
            |random| {
                crowd(random, |random| {
                    let [a, b, _] = some(random, 0.3);
                    if random.below(2) == 0 { [a, a, b] } else { [a, a, a] }
                })
            },
        ),
        case(
            "collinear",
            "triangles whose corners stand on a line, exactly or up to rounding",
            4.0,
            Expect::Oracle,
            |random| {
                crowd(random, |random| {
                    let a = (random.cube() * 64.0).round() / 64.0;
                    let step = (random.cube() * 16.0).round() / 64.0;
                    match random.below(2) {
                        0 => [a, a + step, a + step * 2.0],
                        _ => [a, a.lerp(a + step, random.unit()), a + step],
                    }
                })
            },
        ),
        case(
            "duplicates",
            "three copies of every triangle: the lowest primitive is the hit",
            4.0,
            Expect::Lowest,
            |random| copied(random, false),
        ),
        case(
            "coincident, opposite winding",
            "every triangle again with its corners in the other order: the lowest primitive is the hit",
            4.0,
            Expect::Lowest,
            |random| copied(random, true),
        ),
        case(
            "slivers 1:1e7",
            "triangles 1e7 times as long as wide",
            4.0,
            Expect::Oracle,
            |random| {
                crowd(random, |random| {
                    let a = random.cube();
                    let (along, across) = (random.direction(), random.direction());
                    [a, a + along, a + along * random.unit() + across * 1e-7]
                })
            },
        ),
        case("needle fans", "fans of 2,000 needles around one vertex", 3.0, Expect::Oracle, fan),
        case(
            "1e-25 triangles",
            "triangles of size 1e-25 around the origin, seen from 4e-25 away",
            4e-25,
            Expect::Oracle,
            |random| {
                let triangles: Vec<_> =
                    (0..300).map(|_| some(random, 0.3).map(|v| v * 1e-25)).collect();
                soup(&triangles)
            },
        ),
        case(
            "1e18 coordinates",
            "triangles of size 1e18, seen from 4e18 away",
            4e18,
            Expect::Oracle,
            |random| {
                let triangles: Vec<_> =
                    (0..300).map(|_| some(random, 0.3).map(|v| v * 1e18)).collect();
                soup(&triangles)
            },
        ),
    ]
}

/// A mesh in which every triangle occurs three times. The two copies have the opposite winding if
/// `opposite`.
fn copied(random: &mut Random, opposite: bool) -> TriangleMesh {
    let mut triangles: Vec<[DVec3; 3]> = (0..60).map(|_| some(random, 0.3)).collect();
    // The copies stand in a different order than the first triangles.
    for k in 0..120 {
        let [a, b, c] = triangles[k * 7 % 60];
        triangles.push(if opposite { [a, c, b] } else { [a, b, c] });
    }
    soup(&triangles)
}
