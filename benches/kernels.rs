//! The kernels one by one, per instruction-set tier: `cargo bench --bench kernels`.
//!
//! For finding out what a change to one kernel does; whole pictures are in `benches/render.rs`.

use divan::{Bencher, black_box};
use lightpath::geometry::{Geometry, Surfaces, TriangleMesh, refine};
use lightpath::math::pow;
use lightpath::ray::{LANES, Mask, RayPacket, Rays};
use lightpath::sampler::Sampler;
use lightpath::shading::{Falloff, Lit, ShadowPoints, light_rays};
use lightpath::simd::{Isa, Kernel, dispatch};

fn main() {
    divan::main();
}

const TIERS: &[Isa] = Isa::compiled();
const ALL: Mask = Mask([-1; LANES]);

/// Makes a kernel of its arguments and an expression: a closure would not be compiled per tier.
macro_rules! kernel {
    ($name:ident<$l:lifetime>($($arg:ident: $ty:ty),*) -> $out:ty $body:block) => {
        struct $name<$l> {
            $($arg: $ty),*
        }
        impl<$l> Kernel for $name<$l> {
            type Output = $out;
            #[inline(always)]
            fn run(self) -> $out {
                let Self { $($arg),* } = self;
                $body
            }
        }
    };
}

kernel!(Refine<'a>(geometry: &'a Geometry, packet: &'a RayPacket, out: &'a mut Surfaces) -> () {
    refine(geometry, &ALL, packet, out)
});

kernel!(Light<'a>(
    points: &'a ShadowPoints, glossy: bool, rays: &'a mut Rays, lit: &'a mut Lit
) -> Mask {
    let q = [[3.0; LANES], [6.0; LANES], [5.0; LANES]];
    light_rays(points, &q, None, Falloff::Quadratic, glossy, rays, lit)
});

kernel!(Pow<'a>(x: &'a [f32; LANES]) -> [f32; LANES] {
    let mut y = [0.0; LANES];
    for i in 0..LANES {
        y[i] = pow(x[i], 50.0);
    }
    y
});

fn lanes(f: impl Fn(f32) -> f32) -> [f32; LANES] {
    std::array::from_fn(|i| f(i as f32))
}

/// Hit positions of 16 triangles in f64.
#[divan::bench(args = TIERS)]
fn refine_16_hits(bencher: Bencher, isa: Isa) {
    let vertices = (0..48).map(|i| [(i * 7 % 5) as f32, (i * 3 % 7) as f32, (i % 3) as f32 + 5.0]);
    let triangles = (0..16).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let mesh = TriangleMesh::new(vertices.collect(), triangles, false);
    let geometry = Geometry::new(glam::DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few");
    let mut packet = RayPacket::EMPTY;
    packet.rays.dir = [lanes(|i| i * 0.01), lanes(|i| i * 0.02), lanes(|_| 1.0)];
    packet.hits.geom = [0; LANES];
    packet.hits.prim = std::array::from_fn(|i| i as u32);
    let mut out = Surfaces::EMPTY;
    bencher.bench_local(|| {
        let (packet, out) = (black_box(&packet), black_box(&mut out));
        dispatch(isa, Refine { geometry: &geometry, packet, out });
    });
}

/// Shadow rays and light terms of 16 points, with and without a specular term.
#[divan::bench(args = TIERS, consts = [false, true])]
fn light_16_points<const GLOSSY: bool>(bencher: Bencher, isa: Isa) {
    let mut points = ShadowPoints::EMPTY;
    points.hit = ALL;
    points.n = [lanes(|_| 0.0), lanes(|_| 1.0), lanes(|_| 0.0)];
    points.ng = points.n;
    points.view = [lanes(|_| 0.6), lanes(|_| 0.8), lanes(|_| 0.0)];
    points.position = [lanes(|i| i), lanes(|_| 0.0), lanes(|i| -i)];
    (points.kd, points.ks, points.exponent) = ([0.8; LANES], [0.2; LANES], [50.0; LANES]);
    let (mut rays, mut lit) = (Rays::EMPTY, Lit::EMPTY);
    bencher.bench_local(|| {
        let (points, rays, lit) = (black_box(&points), black_box(&mut rays), black_box(&mut lit));
        dispatch(isa, Light { points, glossy: GLOSSY, rays, lit })
    });
}

#[divan::bench(args = TIERS)]
fn pow_of_16_lanes(bencher: Bencher, isa: Isa) {
    let x = lanes(|i| 0.5 + i / 40.0);
    bencher.bench_local(|| dispatch(isa, Pow { x: black_box(&x) }));
}

#[divan::bench]
fn sobol_point(bencher: Bencher) {
    let sampler = Sampler::new(1);
    let mut index = 0;
    bencher.bench_local(move || {
        index += 1;
        sampler.light(black_box([3, 4]), index, 0, 0)
    });
}
