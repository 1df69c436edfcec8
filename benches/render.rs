//! Compares the renderer with bare Embree: primary and shadow rays per second of the render phase.
//! Both use the same packets in the same order, the same flags and the same threads. A third side
//! is the renderer without its check of occluders.
//!
//! `cargo bench --bench render [-- MESH.ply]`; without a mesh it makes a displaced sphere of 1.3M
//! triangles. Runs are interleaved A B C C B A. It prints every sample, medians, MAD, and the
//! ratios with bootstrap intervals. All sides must find the same numbers of hits and occlusions.

#[cfg(not(feature = "embree"))]
fn main() {
    println!("this benchmark needs Embree");
}

#[cfg(feature = "embree")]
fn main() {
    with_embree::run();
}

#[cfg(feature = "embree")]
mod with_embree {
    use std::path::{Path, PathBuf};
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
    use std::time::{Duration, Instant};

    use lightpath::accel::{self, Accelerator, BuildInfo, BuildOptions};
    use lightpath::film::{Film, Window};
    use lightpath::lab::ab::{TimingPlan, interleave};
    use lightpath::lab::accuracy::meshes::{TestMesh, icosphere};
    use lightpath::lab::stats::{Estimate, mad, median, paired_ratio};
    use lightpath::monitor::Monitor;
    use lightpath::ray::{Coherence, LANES, Mask, RayPacket, Rays};
    use lightpath::render::render;
    use lightpath::simd::{self, Isa, Kernel};
    use lightpath::world::{LoadOptions, World};
    use lightpath::{scene, shading};
    use rayon::prelude::*;

    const SIZE: u32 = 1024;
    const ROUNDS: usize = 15;

    pub fn run() {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let dir = tempfile::tempdir().expect("a temporary folder");
        let mesh = match std::env::args().skip(1).find(|a| !a.starts_with("--")) {
            Some(path) => PathBuf::from(path),
            None => displaced_sphere(&dir.path().join("sphere.ply")),
        };
        for n in [1, threads] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().expect("threads");
            pool.install(|| measure(&mesh, n));
            if threads == 1 {
                break;
            }
        }
    }

    fn measure(mesh: &Path, threads: usize) {
        let monitor = Monitor::default();
        let text = scene_text(mesh);
        let source =
            scene::Source::Text { name: "bench", text: text.as_bytes(), folder: Path::new(".") };
        let scene = scene::load(source, &[]).expect("the scene").scene;
        let started = Instant::now();
        let (world, _) = World::load(&scene, LoadOptions::default(), &monitor).expect("the mesh");
        let load_s = started.elapsed().as_secs_f64();
        let started = Instant::now();
        std::hint::black_box(std::fs::read(mesh).expect("the mesh"));
        let read_s = started.elapsed().as_secs_f64();
        let options = BuildOptions { threads, max_bytes: None };
        let started = Instant::now();
        let backend = scene::Backend::Embree(scene::EmbreeMode::Robust);
        let embree = accel::build(&world.geometry, backend, &options, &monitor).expect("Embree");
        let build_s = started.elapsed().as_secs_f64();
        let info = embree.info();
        let isa = Isa::detect();
        println!(
            "{} triangles, {SIZE}x{SIZE}, 1 spp, {threads} thread(s), {}, {} kernels {isa}",
            world.triangles(),
            info.version,
            info.isa
        );
        println!(
            "load {load_s:.3} s + build {build_s:.3} s = {:.2} x (read file {read_s:.3} s + build)",
            (load_s + build_s) / (read_s + build_s)
        );
        println!(
            "memory: mesh {} + Embree {} (peak {}) bytes",
            world.mesh_bytes(),
            info.bytes,
            info.peak_bytes
        );
        let mut film = Film::new([SIZE; 2], Window::full(SIZE, SIZE)).expect("memory");
        let replay = Replay::record(&world, &*embree, &mut film);
        let counts = render(&world, &*embree, isa, &mut film, &monitor).expect("a render");
        let rays = (counts.primary + counts.shadow) as f64;
        let plan = TimingPlan { rounds: ROUNDS, budget: Duration::ZERO };
        let unchecked = Unchecked(&*embree);
        let samples = interleave(3, plan, &monitor, |side| {
            let started = Instant::now();
            if side != 1 {
                let by: &dyn Accelerator = if side == 0 { &*embree } else { &unchecked };
                let again = render(&world, by, isa, &mut film, &monitor)?;
                let seconds = started.elapsed().as_secs_f64();
                assert_eq!(again, counts);
                return Ok(seconds);
            }
            let answer = replay.run(&world, &*embree, isa);
            let seconds = started.elapsed().as_secs_f64();
            assert_eq!(
                answer, replay.expected,
                "the bare queries must find what the renderer found"
            );
            Ok(seconds)
        });
        let samples = samples.expect("no signal");
        let [ours, bare, unchecked] = &samples[..] else { unreachable!("three sides") };
        report("renderer", rays, ours);
        report("bare Embree", rays, bare);
        report("occluders unchecked", rays, unchecked);
        ratio("renderer / bare", bare, ours);
        ratio("renderer's time / with occluders unchecked", ours, unchecked);
        println!();
    }

    fn ratio(name: &str, a: &[f64], b: &[f64]) {
        let Estimate { value, low, high } = paired_ratio(a, b);
        println!("{name}: {value:.3} [{low:.3}, {high:.3}] (median of pairs, 95 %)");
    }

    /// Embree without the check of occluders that the renderer adds.
    struct Unchecked<'a>(&'a dyn Accelerator);

    impl Accelerator for Unchecked<'_> {
        fn info(&self) -> BuildInfo {
            self.0.info()
        }
        fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
            self.0.closest(active, packet, coherence);
        }
        fn closest_unfiltered(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
            self.0.closest_unfiltered(active, packet, coherence);
        }
        fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
            self.0.occluded_unfiltered(active, rays, coherence);
        }
    }

    fn report(name: &str, rays: f64, seconds: &[f64]) {
        let m = median(seconds);
        println!(
            "{name}: {:.2} Mray/s, median {:.2} ms, MAD {:.2} ms",
            rays / m / 1e6,
            m * 1e3,
            mad(seconds) * 1e3
        );
        let all: Vec<String> = seconds.iter().map(|s| format!("{:.1}", s * 1e3)).collect();
        println!("  ms: {}", all.join(" "));
    }

    /// The queries of a render in order, tile by tile.
    struct Replay {
        tiles: Vec<Vec<Query>>,
        light: [f32; 3],
        expected: [u64; 2],
    }

    enum Query {
        /// A camera packet, given by the pixel of its lane 0. Its rays are rebuilt in the replay.
        Camera([u32; 2]),
        /// A shadow packet, given by its origins. Its directions are rebuilt in the replay.
        Shadow(Box<Shadow>),
    }

    struct Shadow {
        active: Mask,
        org: [[f32; LANES]; 3],
        tfar: [f32; LANES],
        leaving: [u32; LANES],
    }

    struct Recorder<'a> {
        inner: &'a dyn Accelerator,
        queries: Mutex<Vec<Query>>,
        hits: [AtomicU64; 2],
    }

    impl Accelerator for Recorder<'_> {
        fn info(&self) -> BuildInfo {
            self.inner.info()
        }
        fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
            self.inner.closest(active, packet, coherence);
            self.hits[0].fetch_add(hits(packet), Relaxed);
            self.queries.lock().expect("one thread").push(Query::Camera([0; 2]));
        }
        fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
            let shadow =
                Shadow { active: *active, org: rays.org, tfar: rays.tfar, leaving: rays.leaving };
            self.inner.occluded(active, rays, coherence);
            self.hits[1].fetch_add(occlusions(active, rays), Relaxed);
            self.queries.lock().expect("one thread").push(Query::Shadow(Box::new(shadow)));
        }
    }

    fn hits(packet: &RayPacket) -> u64 {
        packet.hits.geom.iter().filter(|&&g| g != u32::MAX).count() as u64
    }

    fn occlusions(active: &Mask, rays: &Rays) -> u64 {
        (0..LANES).filter(|&i| active.0[i] != 0 && rays.tfar[i] < 0.0).count() as u64
    }

    impl Replay {
        fn record(world: &World, inner: &dyn Accelerator, film: &mut Film) -> Self {
            let hits = [AtomicU64::new(0), AtomicU64::new(0)];
            let recorder = Recorder { inner, queries: Mutex::default(), hits };
            let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
            let monitor = Monitor::default();
            one.install(|| render(world, &recorder, Isa::detect(), film, &monitor))
                .expect("a render");
            // One thread renders the tiles in order: 8 x 8 blocks of 4 x 4 pixels in Z-order.
            let across = SIZE / 32;
            let (mut tiles, mut packets) = (Vec::new(), 0u32);
            for mut query in recorder.queries.into_inner().expect("one thread") {
                if let Query::Camera(corner) = &mut query {
                    let (tile, i) = (packets / 64, packets % 64);
                    let even = |b: u32| (b & 1) | ((b >> 1) & 2) | ((b >> 2) & 4);
                    let (x, y) = (tile % across * 32, tile / across * 32);
                    *corner = [x + even(i) * 4, y + even(i >> 1) * 4];
                    if i == 0 {
                        tiles.push(Vec::new());
                    }
                    packets += 1;
                }
                tiles.last_mut().expect("a camera packet comes first").push(query);
            }
            assert_eq!(packets, across * across * 64);
            let shading::Emitter::Point(q) = world.lights[0].emitter else {
                unreachable!("a point light")
            };
            let expected = recorder.hits.map(AtomicU64::into_inner);
            Self { tiles, light: q.to_array(), expected }
        }

        fn run(&self, world: &World, embree: &dyn Accelerator, isa: Isa) -> [u64; 2] {
            let add = |a: [u64; 2], b: [u64; 2]| [a[0] + b[0], a[1] + b[1]];
            self.tiles
                .par_iter()
                .map(|tile| simd::dispatch(isa, Bare { tile, light: self.light, world, embree }))
                .reduce(|| [0; 2], add)
        }
    }

    struct Bare<'a> {
        tile: &'a [Query],
        light: [f32; 3],
        world: &'a World,
        embree: &'a dyn Accelerator,
    }

    impl Kernel for Bare<'_> {
        type Output = [u64; 2];
        #[inline(always)]
        fn run(self) -> [u64; 2] {
            let mut found = [0; 2];
            let mut packet = RayPacket::EMPTY;
            let mut rays = Rays::EMPTY;
            let all = Mask::ALL;
            for query in self.tile {
                match query {
                    Query::Camera(corner) => {
                        packet.clear_hits();
                        for i in 0..LANES {
                            let x = (corner[0] + i as u32 % 4) as f32 + 0.5;
                            let y = (corner[1] + i as u32 / 4) as f32 + 0.5;
                            let (o, d) = self.world.camera.pinhole_ray(x, y);
                            for axis in 0..3 {
                                packet.rays.org[axis][i] = o[axis];
                                packet.rays.dir[axis][i] = d[axis];
                            }
                            packet.rays.tfar[i] = f32::INFINITY;
                        }
                        self.embree.closest_unfiltered(&all, &mut packet, Coherence::Coherent);
                        found[0] += hits(&packet);
                    }
                    Query::Shadow(shadow) => {
                        for axis in 0..3 {
                            for i in 0..LANES {
                                rays.org[axis][i] = shadow.org[axis][i];
                                rays.dir[axis][i] = self.light[axis] - shadow.org[axis][i];
                            }
                        }
                        rays.tfar = shadow.tfar;
                        rays.leaving = shadow.leaving;
                        self.embree.occluded_unfiltered(
                            &shadow.active,
                            &mut rays,
                            Coherence::Coherent,
                        );
                        found[1] += occlusions(&shadow.active, &rays);
                    }
                }
            }
            found
        }
    }

    fn scene_text(mesh: &Path) -> String {
        serde_json::json!({
            "nbounces": 0,
            "camera": {"type": "pinhole", "width": SIZE, "height": SIZE, "fov": 40,
                "position": [0, 1.5, 4], "target": [0, 0.9, 0], "up": [0, 1, 0]},
            "scene": {
                "lightsources": [{"type": "pointlight", "position": [3, 6, 5], "id": [5, 5, 5]}],
                "shapes": [
                    {"type": "trimesh", "path": mesh, "fit": 2, "center": [0, 1, 0], "material": {"kd": 0.8}},
                    {"type": "plane", "v0": [-10, 0, -10], "v1": [10, 0, -10], "v2": [10, 0, 10],
                        "v3": [-10, 0, 10], "material": {"kd": 0.8}}
                ]
            }
        })
        .to_string()
    }

    /// Writes an icosphere of 1,310,720 triangles with bumps on it.
    fn displaced_sphere(path: &Path) -> PathBuf {
        let TestMesh { vertices, triangles, .. } = icosphere(8);
        let mut bytes = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
             property float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
            vertices.len(),
            triangles.len()
        )
        .into_bytes();
        for p in &vertices {
            let bumps = (p.x * 23.0).sin() * (p.y * 29.0).sin() * (p.z * 31.0).sin();
            for x in (*p * (1.0 + 0.03 * bumps)).to_array() {
                bytes.extend((x as f32).to_le_bytes());
            }
        }
        for f in &triangles {
            bytes.push(3);
            f.iter().for_each(|i| bytes.extend(i.to_le_bytes()));
        }
        std::fs::write(path, bytes).expect("a writable temporary folder");
        path.to_path_buf()
    }
}
