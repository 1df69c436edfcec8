//! Benchmarks of single kernels per instruction set: `cargo bench --bench kernels`.
//!
//! They show what a change to one kernel does. Whole pictures are in `benches/render.rs`.

use divan::{Bencher, black_box, counter::ItemsCount};
use lightpath::accel::bvh::{
    Bvh,
    kernels::{COUNT, Which},
};
use lightpath::accel::{Accelerator, BuildOptions};
use lightpath::geometry::{Geometry, Surfaces, TriangleMesh, refine};
use lightpath::math::pow;
use lightpath::monitor::Monitor;
use lightpath::ray::{Coherence, LANES, Mask, RayPacket, Rays};
use lightpath::sampler::Sampler;
use lightpath::shading::{Falloff, LightWeights, ShadowPoints, light_rays};
use lightpath::simd::{Isa, Kernel, dispatch};

fn main() {
    divan::main();
}

const TIERS: &[Isa] = Isa::compiled();

/// Defines a kernel from its arguments and an expression. A closure would not be compiled per
/// instruction set.
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
    refine(geometry, &Mask::ALL, packet, out)
});

kernel!(Light<'a>(
    points: &'a ShadowPoints, glossy: bool, rays: &'a mut Rays, lit: &'a mut LightWeights
) -> Mask {
    let q = [[3.0; LANES], [6.0; LANES], [5.0; LANES]];
    light_rays(points, &q, None, Falloff::Quadratic, glossy, rays, lit)
});

kernel!(Pow<'a>(x: &'a [f32; LANES]) -> [f32; LANES] {
    let mut y = [0.0; LANES];
    for i in 0..LANES {
        y[i] = pow(x[i].into(), 50.0);
    }
    y
});

fn lanes(f: impl Fn(f32) -> f32) -> [f32; LANES] {
    std::array::from_fn(|i| f(i as f32))
}

/// Computes the hit positions of 16 triangles in f64.
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

/// Makes the shadow rays and light terms of 16 points, with and without a specular term.
#[divan::bench(args = TIERS, consts = [false, true])]
fn light_16_points<const GLOSSY: bool>(bencher: Bencher, isa: Isa) {
    let mut points = ShadowPoints::EMPTY;
    points.hit = Mask::ALL;
    points.n = [lanes(|_| 0.0), lanes(|_| 1.0), lanes(|_| 0.0)];
    points.ng = points.n;
    points.view = [lanes(|_| 0.6), lanes(|_| 0.8), lanes(|_| 0.0)];
    points.position = [lanes(|i| i), lanes(|_| 0.0), lanes(|i| -i)];
    (points.kd, points.ks, points.exponent) = ([0.8; LANES], [0.2; LANES], [50.0; LANES]);
    let (mut rays, mut lit) = (Rays::EMPTY, LightWeights::EMPTY);
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

/// Returns a bumpy square of `2 rows^2` triangles around the origin, 2 units wide, at z = 0.
fn terrain(rows: u32) -> Geometry {
    let at = |row: u32, column: u32| {
        let [x, y] = [row, column].map(|i| i as f32 / rows as f32 * 2.0 - 1.0);
        [x, y, 0.1 * (7.0 * x).sin() * (9.0 * y).cos()]
    };
    let vertices = (0..=rows).flat_map(|r| (0..=rows).map(move |c| at(r, c))).collect();
    let triangles = (0..rows)
        .flat_map(|r| (0..rows).map(move |c| r * (rows + 1) + c))
        .flat_map(|a| [[a, a + 1, a + rows + 1], [a + rows + 2, a + rows + 1, a + 1]])
        .collect();
    let mesh = TriangleMesh::new(vertices, triangles, false);
    Geometry::new(glam::DVec3::ZERO, vec![mesh], vec![], vec![]).expect("few")
}

fn bvh(geometry: &Geometry, isa: Isa) -> Bvh<'_> {
    let options = BuildOptions { threads: 1, max_bytes: None };
    Bvh::build(geometry, isa, &options, &Monitor::default()).expect("a tree")
}

/// Returns 16 rays from one point down to the terrain. Neighbouring directions differ by `spread`.
fn down(spread: f32) -> RayPacket {
    let mut packet = RayPacket::EMPTY;
    packet.rays.org = [[0.3; LANES], [-0.2; LANES], [2.0; LANES]];
    packet.rays.dir =
        [lanes(|i| (i % 4.0 - 1.6) * spread), lanes(|i| (i / 4.0 - 1.7) * spread), lanes(|_| -2.0)];
    packet
}

fn kernel(bencher: Bencher, isa: Isa, which: Which) {
    let geometry = terrain(100);
    let bvh = bvh(&geometry, isa);
    let rays = down(0.01).rays;
    bencher.counter(ItemsCount::new(COUNT)).bench_local(|| bvh.run_kernel(which, black_box(&rays)));
}

/// One ray, 256 nodes: tests 16 boxes each and sorts those that it hits.
#[divan::bench(args = TIERS)]
fn bvh_node(bencher: Bencher, isa: Isa) {
    kernel(bencher, isa, Which::Node);
}

/// One ray, 256 leaves: finds the triangles that may be hit.
#[divan::bench(args = TIERS)]
fn bvh_leaf(bencher: Bencher, isa: Isa) {
    kernel(bencher, isa, Which::Leaf);
}

/// One ray, 256 triangles: decides exactly and computes t.
#[divan::bench(args = TIERS)]
fn bvh_exact(bencher: Bencher, isa: Isa) {
    kernel(bencher, isa, Which::Exact);
}

/// Builds a tree over 100 thousand triangles, on the threads of the global rayon pool.
#[divan::bench(args = TIERS)]
fn bvh_build_100k(bencher: Bencher, isa: Isa) {
    let geometry = terrain(224);
    let triangles = geometry.meshes[0].triangles().len();
    bencher.counter(ItemsCount::new(triangles)).bench_local(|| bvh(&geometry, isa));
}

/// Traces 16 rays through a tree over 100 thousand triangles: far apart and one by one, or close
/// together as one packet.
#[divan::bench(args = TIERS, consts = [false, true])]
fn bvh_closest_16<const PACKET: bool>(bencher: Bencher, isa: Isa) {
    let geometry = terrain(224);
    let bvh = bvh(&geometry, isa);
    let (spread, coherence) =
        if PACKET { (0.01, Coherence::Coherent) } else { (0.4, Coherence::Single) };
    let packet = down(spread);
    bencher.counter(ItemsCount::new(LANES)).bench_local(|| {
        let mut packet = black_box(&packet).clone();
        bvh.closest(&Mask::ALL, &mut packet, coherence);
        packet
    });
}
