//! Cases with quads: rays parallel to them, in their plane, at their corners and grazing; quads
//! that are not quite flat.

use crate::geometry::doubles;
use glam::DVec3;

use super::case::{Amount, Case, PassCriterion};
use super::judge::{AimedPacket, Expect};
use super::meshes::geometry;
use crate::lab::random::Random;

const GROUP: &str = "quads";

type Quad = [DVec3; 4];

/// Rectangles, half of them rotated, half along the axes on a grid. One corner of each is lifted by
/// `bend`.
fn quads(random: &mut Random, bend: f64) -> Vec<Quad> {
    (0..120)
        .map(|k| {
            let (at, x, y) = if k % 2 == 0 {
                let x = random.direction();
                let y = random.direction().cross(x).normalize_or(DVec3::Z);
                (random.cube(), x, y)
            } else {
                let axis = random.below(3) as usize;
                let (mut x, mut y) = (DVec3::ZERO, DVec3::ZERO);
                (x[axis], y[(axis + 1) % 3]) = (1.0, 1.0);
                ((random.cube() * 8.0).round() / 8.0, x, y)
            };
            let (x, y) = (x * 0.375, y * 0.25);
            let lift = x.cross(y).normalize_or(DVec3::Z) * bend;
            [at - x - y, at + x - y, at + x + y + lift, at - x + y]
        })
        .collect()
}

type Aim = fn(&mut Random, &Quad, &mut AimedPacket, usize);

fn case(
    name: &'static str,
    what: &'static str,
    criterion: PassCriterion,
    bend: f64,
    aim: Aim,
) -> Case {
    Case::new(GROUP, name, what, criterion, move |run| {
        let quads = quads(&mut run.random(u64::MAX), bend);
        let f32s = quads.iter().map(|quad| quad.map(|v| v.as_vec3().to_array())).collect();
        let geometry = geometry(vec![], f32s, vec![]);
        // The corners after rounding to f32.
        let rounded: Vec<Quad> = geometry.quads.iter().map(|quad| quad.map(doubles)).collect();
        run.trace(&geometry, Amount { packets: 200, slow_stride: 4, oracle_stride: 1 }, |random| {
            AimedPacket::each(Expect::Oracle, |aimed, i| {
                let quad = &rounded[random.below(rounded.len() as u32) as usize];
                aim(random, quad, aimed, i);
            })
        })
    })
}

fn within(random: &mut Random, [a, b, _, d]: &Quad) -> DVec3 {
    *a + (*b - *a) * random.unit() + (*d - *a) * random.unit()
}

/// Sets a ray at `angle` radians to the plane, through a point of the quad.
fn at_angle(random: &mut Random, quad: &Quad, angle: f64, aimed: &mut AimedPacket, i: usize) {
    let [a, b, _, d] = *quad;
    let normal = (b - a).cross(d - a).normalize_or(DVec3::Z);
    let turn = random.within(0.0, std::f64::consts::TAU);
    let side = (b - a).normalize() * turn.cos() + (d - a).normalize() * turn.sin();
    let away = side * angle.cos() + normal * angle.sin();
    let goal = within(random, quad);
    aimed.through(i, goal + away * random.within(1.0, 4.0), goal);
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    let seen_edge_on = PassCriterion::Coarse(0.01, "seen edge-on, t may be that of the other half");
    vec![
        case(
            "parallel",
            "rays parallel to a quad's plane, beside it",
            PassCriterion::Exact,
            0.0,
            |random, quad, aimed, i| {
                let [a, b, _, d] = *quad;
                let normal = (b - a).cross(d - a).normalize_or(DVec3::Z);
                let direction =
                    (b - a) * random.within(-1.0, 1.0) + (d - a) * random.within(-1.0, 1.0);
                let beside = within(random, quad) + normal * random.within(-0.1, 0.1);
                aimed.put(i, beside - direction * 4.0, direction);
                aimed.goals[i] = beside;
            },
        ),
        case(
            "within the plane",
            "rays in a quad's own plane: they miss it where f32 holds the plane exactly",
            seen_edge_on,
            0.0,
            |random, quad, aimed, i| {
                let [a, b, _, d] = *quad;
                // The direction is a side or a small integer combination of both sides.
                let turns = [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (-1.0, 2.0)];
                let (x, y) = turns[random.below(4) as usize];
                let direction = (b - a) * x + (d - a) * y;
                let steps = f64::from(random.below(9)) / 8.0;
                let goal = a + (b - a) * steps + (d - a) * steps;
                aimed.put(i, goal - direction * 4.0, direction);
                aimed.goals[i] = goal;
            },
        ),
        case(
            "corners and diagonals",
            "rays at corners, edges and the diagonal where the two halves meet",
            PassCriterion::Exact,
            0.0,
            |random, quad, aimed, i| {
                let [a, b, c, d] = *quad;
                let goal = match random.below(4) {
                    0 | 1 => quad[random.below(4) as usize],
                    2 => b.lerp(d, random.unit()),
                    _ => a.lerp(if random.below(2) == 0 { b } else { c }, random.unit()),
                };
                aimed.through(i, random.direction() * random.within(2.0, 6.0), goal);
            },
        ),
        case(
            "grazing at 0.1 degrees",
            "rays at 0.1 degrees to a quad's plane",
            PassCriterion::Exact,
            0.0,
            |random, quad, aimed, i| at_angle(random, quad, 0.1f64.to_radians(), aimed, i),
        ),
        case(
            "grazing at 0.01 degrees",
            "rays at 0.01 degrees to a quad's plane",
            PassCriterion::Exact,
            0.0,
            |random, quad, aimed, i| at_angle(random, quad, 0.01f64.to_radians(), aimed, i),
        ),
        case(
            "not quite flat",
            "one corner 1e-6 off the plane of the others: the quad is two triangles",
            PassCriterion::Exact,
            1e-6,
            |random, quad, aimed, i| {
                let goal = within(random, quad);
                aimed.through(i, random.direction() * random.within(2.0, 6.0), goal);
            },
        ),
    ]
}
