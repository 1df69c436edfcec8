//! Rays to the diagonal of a quad have one surface point, alone and among others, in every
//! instruction set.

use glam::DVec3;
use lightpath::accel::bvh::Bvh;
use lightpath::accel::{Accelerator, BuildOptions};
use lightpath::geometry::{Geometry, Surfaces, refine};
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Mask, RayPacket};
use lightpath::simd::Isa;

use crate::support::random::Random;

fn point(random: &mut Random) -> DVec3 {
    DVec3::from([0; 3].map(|_| random.within(-1.0, 1.0)))
}

/// A parallelogram, whose corners are rounded.
fn quad(random: &mut Random) -> [[f32; 3]; 4] {
    let [middle, a, b] = [0; 3].map(|_| point(random));
    [middle - a - b, middle + a - b, middle + a + b, middle - a + b].map(|p| p.as_vec3().to_array())
}

/// Rays from one origin to points within some roundings of the diagonal.
fn rays([v0, v1, _, v3]: [[f32; 3]; 4], random: &mut Random) -> RayPacket {
    let [v0, v1, v3] = [v0, v1, v3].map(|v| DVec3::from(v.map(f64::from)));
    let origin = (v1 + 3.0 * point(random)).as_vec3();
    let spot = random.unit();
    let mut packet = RayPacket::EMPTY;
    for i in 0..LANES {
        let along = v1 + (v3 - v1) * (spot + random.within(-1e-3, 1e-3)).clamp(0.0, 1.0);
        let goal = along + (v1 - v0) * random.within(-4e-7, 4e-7);
        let direction = (goal - origin.as_dvec3()).as_vec3();
        for (axis, (from, to)) in
            origin.to_array().into_iter().zip(direction.to_array()).enumerate()
        {
            (packet.rays.org[axis][i], packet.rays.dir[axis][i]) = (from, to);
        }
        (packet.rays.tnear[i], packet.rays.tfar[i]) = (0.0, f32::INFINITY);
    }
    packet
}

/// Position, normal, t and weights, as bits.
type Point = ([u32; 3], [u32; 3], u32, [u64; 2]);

/// The surface points of the active rays, by lane; `None` for a miss.
fn surfaces(
    geometry: &Geometry,
    tree: &Bvh,
    mut packet: RayPacket,
    (active, coherence): (Mask, Coherence),
) -> [Option<Point>; LANES] {
    packet.clear_hits();
    tree.closest(&active, &mut packet, coherence);
    let hit = packet.hit(&active);
    let mut out = Surfaces::EMPTY;
    refine(geometry, &hit, &packet, &mut out);
    std::array::from_fn(|i| {
        let bits = |v: &[[f32; LANES]; 3]| [0, 1, 2].map(|axis| v[axis][i].to_bits());
        let weights = [out.u[i].to_bits(), out.v[i].to_bits()];
        (hit.0[i] != 0).then(|| (bits(&out.position), bits(&out.ng), out.t[i].to_bits(), weights))
    })
}

#[test]
fn surface_points_at_the_diagonal_of_a_quad_depend_on_the_ray_alone() {
    let (mut random, mut hits) = (Random(1), 0);
    let all = Mask([-1; LANES]);
    for _ in 0..400 {
        let corners = quad(&mut random);
        let geometry = Geometry::new(DVec3::ZERO, vec![], vec![corners], vec![]).expect("a quad");
        let options = BuildOptions { threads: 1, max_bytes: None };
        let tree = |isa| Bvh::build(&geometry, isa, &options, &Monitor::default()).expect("a tree");
        let trees: Vec<Bvh> = Isa::available().map(tree).collect();
        for _ in 0..10 {
            let packet = rays(corners, &mut random);
            let expected: [_; LANES] = std::array::from_fn(|i| {
                let mut alone = Mask::NONE;
                alone.0[i] = -1;
                let rays = packet.clone();
                surfaces(&geometry, &trees[0], rays, (alone, Coherence::Incoherent))[i]
            });
            hits += expected.iter().flatten().count();
            for tree in &trees {
                for coherence in [Coherence::Coherent, Coherence::Incoherent] {
                    let found = surfaces(&geometry, tree, packet.clone(), (all, coherence));
                    assert_eq!(found, expected, "{corners:?}");
                }
            }
        }
    }
    assert!(hits > 30_000, "{hits}");
}
