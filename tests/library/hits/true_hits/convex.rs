//! Rays that leave one side of a convex edge, a few ulp from it. The other side lies behind them.

use lightpath::geometry::Geometry;
use lightpath::ray::{Coherence, Mask, NONE, RayPacket, Rays};
use lightpath::scene::Backend;

use super::setup::geometry;
use crate::support::backends::{build, on_both};

/// A ray that leaves the second primitive of a geometry.
struct Leaving {
    geometry: Geometry,
    origin: [f32; 3],
    direction: [f32; 3],
}

impl Leaving {
    /// Returns whether a backend reports a hit: in packets and singly, for occlusion and for the
    /// closest hit.
    fn stopped(&self, backend: Backend) -> [bool; 4] {
        let accelerator = build(&self.geometry, backend);
        let mut rays = Rays::EMPTY;
        for axis in 0..3 {
            (rays.org[axis][0], rays.dir[axis][0]) = (self.origin[axis], self.direction[axis]);
        }
        (rays.tfar[0], rays.leaving[0]) = (0.99999, 1);
        let mut one = Mask::NONE;
        one.0[0] = -1;
        let mut stopped = [false; 4];
        for (i, way) in [Coherence::Coherent, Coherence::Single].into_iter().enumerate() {
            let mut packet = RayPacket { rays: rays.clone(), ..RayPacket::EMPTY };
            accelerator.closest(&one, &mut packet, way);
            stopped[i] = packet.hits.geom[0] != NONE;
            let mut shadow = rays.clone();
            accelerator.occluded(&one, &mut shadow, way);
            stopped[2 + i] = shadow.tfar[0] < 0.0;
        }
        stopped
    }
}

fn triangles(corners: [[[f32; 3]; 3]; 2]) -> Geometry {
    geometry(corners.as_flattened().to_vec(), vec![[0, 1, 2], [3, 4, 5]], vec![])
}

/// Rays that Embree's ROBUST test stops at once: at an octahedron near the origin, at one 1e3 times
/// its size away, and at a cube.
fn rays() -> [Leaving; 3] {
    let (low, high, none) = (-9.999931e-7, 1.0000069e-6, 6.937422e-12);
    let octahedron = [
        [[low, none, none], [none, low, none], [none, none, low]],
        [[low, none, none], [none, high, none], [none, none, low]],
    ];
    let (a, b) = ([0.8253386, 0.36375567, -0.43186313], [-0.5646395, 0.5316988, -0.6312522]);
    let far = [
        [a, [2.9733083e-6, -0.7648392, -0.64421844], b],
        [a, [2.9733083e-6, 0.7648452, 0.64421695], b],
    ];
    let cube = [
        [[-1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
        [[1.0, -1.0, -1.0], [1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [1.0, -1.0, 1.0]],
    ];
    [
        Leaving {
            geometry: triangles(octahedron),
            origin: [-4.109524e-7, 7.965979e-12, -5.890327e-7],
            direction: [2.6748523e-9, -7.644595e-8, -9.146606e-8],
        },
        Leaving {
            geometry: triangles(far),
            origin: [0.14380227, 0.44610196, -0.52962756],
            direction: [47.692543, -36.12982, -158.44205],
        },
        Leaving {
            geometry: geometry(vec![], vec![], cube.to_vec()),
            origin: [1.0, 0.8007369, -1.0],
            direction: [0.10719097, 0.17082173, -0.048551798],
        },
    ]
}

fn does_not_shadow_itself(backend: Backend) {
    for (i, ray) in rays().iter().enumerate() {
        assert_eq!(ray.stopped(backend), [false; 4], "ray {i}, {backend:?}");
    }
}

on_both! {
    fn a_convex_edge_does_not_shadow_itself(backend: Backend) {
        does_not_shadow_itself(backend);
    }

    /// A surface in front still counts, however near it starts.
    fn a_concave_edge_does_shadow_itself(backend: Backend) {
        concave_edge_shadows(backend);
    }
}

fn concave_edge_shadows(backend: Backend) {
    let [_, _, mut cube] = rays();
    // Into the cube instead of out of it, towards the side that shares the edge.
    (cube.origin, cube.direction) = ([0.999_999_9, 0.8, -0.999_999_8], [-0.5, 0.1, -1e-3]);
    assert_eq!(cube.stopped(backend), [true; 4], "{backend:?}");
}

#[test]
fn the_oracle_agrees_about_edges() {
    does_not_shadow_itself(Backend::Brute);
    concave_edge_shadows(Backend::Brute);
}
