//! Cases for conservative boxes: soups of primitives whose sizes span sixteen decades. A box test
//! must never cull a primitive that the ray hits.

use glam::DVec3;

use super::case::{Amount, Case, PassCriterion};
use super::judge::{AimedPacket, Expect};
use super::meshes::{corners, geometry, point_on, soup};
use crate::geometry::{Geometry, Sphere};
use crate::lab::random::Random;

const GROUP: &str = "conservative";

/// Number of soups in the quick run.
const SOUPS: u64 = 16;

/// From this multiple of the quick run's rays on, a run traces four times as many packets.
const LONG: u64 = 400;

/// A random number of either sign with a magnitude from 1e-8 to 1e8.
fn wide(random: &mut Random) -> f64 {
    10f64.powf(random.within(-8.0, 8.0)) * random.sign()
}

fn wide_point(random: &mut Random) -> DVec3 {
    DVec3::new(wide(random), wide(random), wide(random))
}

/// Primitives of every size at every distance. Half of the triangles and quads lie around one
/// point.
fn scene(random: &mut Random) -> Geometry {
    let crowd = wide_point(random);
    let corners = |random: &mut Random, n: usize| -> Vec<DVec3> {
        let base = if random.below(2) == 0 { crowd } else { wide_point(random) };
        let (size, far) = (wide(random).abs(), random.below(4) == 0);
        let corner = |random: &mut Random| match far {
            true => wide_point(random),
            false => base + wide_point(random).normalize() * size,
        };
        (0..n).map(|_| corner(random)).collect()
    };
    let triangles: Vec<[DVec3; 3]> =
        (0..96).filter_map(|_| corners(random, 3).try_into().ok()).collect();
    let quads = (0..10)
        .filter_map(|_| {
            // Parallelograms, flat except for rounding.
            let [a, b, d]: [DVec3; 3] = corners(random, 3).try_into().ok()?;
            Some([a, b, b + (d - a), d].map(|v| v.as_vec3().to_array()))
        })
        .collect();
    let spheres = (0..20)
        .map(|_| Sphere { center: wide_point(random), radius: wide(random).abs() })
        .collect();
    geometry(vec![soup(&triangles)], quads, spheres)
}

/// All cases of this group.
pub fn cases() -> Vec<Case> {
    let row = |name: &'static str, what: &'static str, at_triangles: bool, packets: u64| {
        let criterion = PassCriterion::Coarse(
            0.01,
            "needles 16 decades long: f64 has too few digits for their planes",
        );
        Case::new(GROUP, name, what, criterion, move |run| {
            // A longer run has more soups, not only more rays.
            let times = run.settings.times;
            let soups = SOUPS * times.min(64);
            // With the factor 4, a full run has 10^8 random rays.
            let more = if times >= LONG { 4 } else { 1 };
            let packets = (more * packets).div_ceil(soups).max(1);
            for k in 0..soups {
                let geometry = scene(&mut run.random(u64::MAX - k));
                let mesh = &geometry.meshes[0];
                let amount = Amount { packets, slow_stride: 4, oracle_stride: 1 };
                run.trace(&geometry, amount, |random| {
                    let one = (random.below(2) == 0).then(|| wide_point(random));
                    AimedPacket::each(Expect::Oracle, |aimed, i| {
                        let origin = one.unwrap_or_else(|| wide_point(random));
                        if at_triangles {
                            let triangle = corners(mesh, random.below(96));
                            let which = random.below(4);
                            let goal = point_on(random, triangle, which);
                            aimed.through(i, origin, goal);
                        } else {
                            let direction = random.direction();
                            aimed.put(i, origin, direction);
                        }
                    })
                })?;
            }
            Ok(())
        })
    };
    vec![
        row(
            "16 decades, aimed",
            "triangles, quads and spheres of sizes 1e-8 to 1e8 anywhere within 1e8: rays at corners, \
             edges and insides of the triangles",
            true,
            1024,
        ),
        row("16 decades, random", "the same, rays from anywhere in any direction", false, 4096),
    ]
}
