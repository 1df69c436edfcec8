//! Cases with grazing rays: thin triangles hit at 1 to 0.0001 degrees to their planes.

use glam::DVec3;

use super::case::{Amount, Case, PassCriterion};
use super::judge::{AimedPacket, Expect};
use super::meshes::{any_triangle, inside, scene, soup};
use crate::geometry::TriangleMesh;
use crate::lab::random::Random;

const GROUP: &str = "nearly parallel";

/// Thin triangles of length 1 with slightly different planes, side by side and above each other.
fn strips(random: &mut Random, width: f64) -> TriangleMesh {
    let mut triangles = Vec::new();
    for _ in 0..400 {
        let at = random.cube() * DVec3::new(1.0, 1.0, 0.05);
        let angle = random.within(0.0, std::f64::consts::TAU);
        let along = DVec3::new(angle.cos(), angle.sin(), random.within(-1e-3, 1e-3));
        let across = DVec3::new(-angle.sin(), angle.cos(), random.within(-0.5, 0.5)) * width;
        triangles.push([at, at + along, at + along * random.unit() + across]);
    }
    soup(&triangles)
}

/// Rays at `degrees` to the plane of the triangle that they are aimed at, from 1 to 8 away.
fn aim(random: &mut Random, mesh: &TriangleMesh, degrees: f64) -> AimedPacket {
    AimedPacket::each(Expect::Oracle, |aimed, i| {
        let [a, b, c] = any_triangle(random, mesh);
        let goal = match random.below(3) {
            0 => a.lerp(b, random.unit()),
            _ => inside(random, [a, b, c]),
        };
        let normal = (b - a).cross(c - a).normalize_or(DVec3::Z);
        let side = random.direction().cross(normal).normalize_or(DVec3::X);
        let angle = degrees.to_radians() * random.sign();
        let away = side * angle.cos() + normal * angle.sin();
        aimed.through(i, goal + away * random.within(1.0, 8.0), goal);
    })
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    [(1.0, 1e-3), (0.1, 1e-3), (0.01, 1e-3), (1e-4, 1e-3)]
        .into_iter()
        .map(|(degrees, width)| {
            let name = format!("{degrees:?} degrees to triangles 1:{:e}", 1.0 / width);
            let what =
                format!("triangles of width {width:e}, hit at {degrees:?} degrees to their planes");
            Case::new(GROUP, name, what, PassCriterion::Exact, move |run| {
                let geometry = scene(strips(&mut run.random(u64::MAX), width));
                let amount = Amount { packets: 200, slow_stride: 4, oracle_stride: 1 };
                run.trace(&geometry, amount, |random| aim(random, &geometry.meshes[0], degrees))
            })
        })
        .collect()
}
