//! Cases for watertightness: rays at vertices, edges and faces of closed meshes, from inside and
//! outside. None may pass through.

use glam::DVec3;

use super::case::{Amount, Case, PassCriterion};
use super::judge::{AimedPacket, Expect};
use super::meshes::{
    TestMesh, any_triangle, cells, corners, cube, icosphere, inside, point_on, scan, scene,
    spiky_ball,
};
use crate::geometry::TriangleMesh;
use crate::lab::random::Random;
use crate::ray::LANES;

const GROUP: &str = "watertight";

const SPIKY: &str = "spiky ball";

const AMOUNT: Amount = Amount { packets: 700, slow_stride: 14, oracle_stride: 14 };

/// Part of a triangle that a ray is aimed at.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Target {
    Vertices,
    Edges,
    Faces,
    /// One of the three, at random.
    Any,
}

impl Target {
    fn name(self) -> &'static str {
        match self {
            Self::Vertices => "at vertices",
            Self::Edges => "at edges",
            Self::Faces => "anywhere",
            Self::Any => "at vertices, edges, anywhere",
        }
    }

    fn point(self, random: &mut Random, triangle: [DVec3; 3]) -> DVec3 {
        let which = match self {
            Self::Vertices => 0,
            Self::Edges => 1,
            Self::Faces => 2,
            Self::Any => random.below(3),
        };
        point_on(random, triangle, which)
    }
}

/// A closed mesh, scaled and moved.
struct PlacedTestMesh {
    mesh: TriangleMesh,
    center: DVec3,
    /// Half the sides of a box around the centre. The whole mesh is visible from every point of it.
    core: DVec3,
}

fn place(shape: &TestMesh, center: DVec3, scale: f64) -> PlacedTestMesh {
    let half = shape.vertices.iter().fold(DVec3::ZERO, |most, v| most.max(v.abs())) * scale;
    PlacedTestMesh { mesh: shape.placed(center, scale), center, core: half * shape.core }
}

/// 16 rays that must all hit. Half of the packets start at points well inside. The others start
/// outside and point through their goals at such points.
fn aim(random: &mut Random, target: Target, at: &PlacedTestMesh) -> AimedPacket {
    let count = at.mesh.triangles().len() as u32;
    let mut aimed = AimedPacket::new(Expect::Closed([f64::INFINITY; LANES]));
    let mut before = [f64::INFINITY; LANES];
    let outside = random.below(2) == 0;
    // Half of the packets have one point inside and neighbouring goals.
    let together = random.below(2) == 0;
    let start = random.below(count);
    let (mut inner, mut steps) = (at.center, 1.0);
    for i in 0..LANES {
        if i == 0 || !together {
            inner = at.center + random.cube() * at.core;
            steps = random.within(0.25, 4.0);
        }
        let triangle = if together { (start + i as u32) % count } else { random.below(count) };
        let goal = target.point(random, corners(&at.mesh, triangle));
        let origin = if outside { goal + (goal - inner) * steps } else { inner };
        aimed.through(i, origin, goal);
        // The hit must lie before the point inside. The far side lies behind that point.
        if outside {
            before[i] = 1.0 + 0.9 / steps;
        }
    }
    aimed.expect = Expect::Closed(before);
    aimed
}

fn closed(
    name: String,
    shape: fn() -> TestMesh,
    target: Target,
    center: DVec3,
    scale: f64,
) -> Case {
    let what = format!(
        "rays {} of a closed mesh, from inside and from outside: each must hit before the far side",
        target.name()
    );
    Case::new(GROUP, name, what, PassCriterion::Exact, move |run| {
        let at = place(&shape(), center, scale);
        let geometry = scene(place(&shape(), center, scale).mesh);
        run.trace(&geometry, AMOUNT, |random| aim(random, target, &at))
    })
}

/// A case with rays along the axes on the lines of a cube's grid. They pass exactly through edges
/// and vertices.
fn grid_lines() -> Case {
    let what = "axis-parallel rays exactly on the lines of a cube's grid, from inside and outside";
    Case::new(GROUP, "cube grid, along the axes on grid lines", what, PassCriterion::Exact, |run| {
        let n = 32;
        let mesh = cube(n).placed(DVec3::ZERO, 1.0);
        let geometry = scene(mesh);
        run.trace(&geometry, AMOUNT, |random| {
            let mut aimed = AimedPacket::new(Expect::Closed([f64::INFINITY; LANES]));
            let axis = random.below(3) as usize;
            let from = [0.0, 0.5, 2.0][random.below(3) as usize] * random.sign();
            let line =
                |random: &mut Random| f64::from(1 + random.below(n - 1)) / f64::from(n) * 2.0 - 1.0;
            for i in 0..LANES {
                let mut origin = DVec3::splat(from);
                origin[(axis + 1) % 3] = line(random);
                // On a line of the grid, or halfway between two lines.
                let shift = f64::from(random.below(2)) / f64::from(n);
                origin[(axis + 2) % 3] = line(random) + shift;
                let mut direction = DVec3::ZERO;
                let inwards = if from == 0.0 { random.sign() } else { -from.signum() };
                direction[axis] = inwards;
                aimed.put(i, origin, direction);
                aimed.goals[i][axis] = if from.abs() > 1.0 { -inwards } else { inwards };
            }
            // From 2, the near side is at t = 1 and the far side at t = 3.
            let before = if from.abs() > 1.0 { 2.0 } else { f64::INFINITY };
            aimed.expect = Expect::Closed([before; LANES]);
            aimed
        })
    })
}

fn crossings(name: &str, shape: fn() -> TestMesh) -> Case {
    let what = "lines from outside hit the mesh as often as the oracle, an even number of times; only \
                lines that pass no edge within the error bound are judged";
    let criterion = PassCriterion::Zero("t is held to its bound in the other rows");
    Case::new(GROUP, format!("{name}, crossings along lines"), what, criterion, move |run| {
        let at = place(&shape(), DVec3::ZERO, 1.0);
        let geometry = scene(place(&shape(), DVec3::ZERO, 1.0).mesh);
        let amount = Amount { packets: 80, slow_stride: 4, oracle_stride: 1 };
        run.trace(&geometry, amount, |random| {
            AimedPacket::each(Expect::Crossings, |aimed, i| {
                let triangle = any_triangle(random, &at.mesh);
                let goal = inside(random, triangle);
                let origin = random.direction() * random.within(2.0, 8.0);
                aimed.through(i, origin, goal);
            })
        })
    })
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    type Make = fn() -> TestMesh;
    let shapes: [(&str, Make, Make); 4] = [
        ("icosphere", || icosphere(5), || icosphere(5).squashed(DVec3::new(1.0, 1.0, 1e-3))),
        ("cube grid", || cube(32), || cube(32).squashed(DVec3::new(1e-3, 1.0, 1.0))),
        ("scan", scan, || scan().squashed(DVec3::new(1.0, 1e-3, 1.0))),
        // The worst mesh found for Embree: tips of few thin triangles, seen from inside the spikes.
        (SPIKY, || spiky_ball(3), || spiky_ball(3).squashed(DVec3::new(1.0, 1.0, 1e-3))),
    ];
    let places: [(&str, DVec3, f64); 3] = [
        ("1e3 large at 1e5", DVec3::new(1e5, -1e5, 1e5), 1e3),
        ("1e-4 small", DVec3::ZERO, 1e-4),
        ("1e6 large", DVec3::ZERO, 1e6),
    ];
    let mut cases = Vec::new();
    for (name, make, squashed) in shapes {
        for target in [Target::Vertices, Target::Edges, Target::Faces] {
            let name = format!("{name}, {}", target.name());
            cases.push(closed(name, make, target, DVec3::ZERO, 1.0));
        }
        let any = Target::Any;
        let name_of = |place: &str| format!("{name}, {place}");
        cases.push(closed(name_of("squashed 1:1:1e-3"), squashed, any, DVec3::ZERO, 1.0));
        for (place, center, scale) in places {
            cases.push(closed(name_of(place), make, any, center, scale));
        }
    }
    cases.push(grid_lines());
    let name = "cells that share walls, at vertices, edges, anywhere".to_owned();
    cases.push(closed(name, || cells(true), Target::Any, DVec3::ZERO, 1.0));
    // The spiky ball is left out: a line crosses it more often than crossings are counted.
    for (name, make, _) in shapes.into_iter().filter(|(name, ..)| *name != SPIKY) {
        cases.push(crossings(name, make));
    }
    cases
}
