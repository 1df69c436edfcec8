//! Compares tinybvh with Embree and `bvh` on the rays of `lightpath bench`, one at a time, in
//! turns. See README.md.

mod layouts;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::Parser;
use layouts::{Corners, Layout, TinyBvh};
use lightpath::accel::{self, Accelerator, BuildOptions};
use lightpath::error::Result;
use lightpath::lab::ab::{TimingPlan, interleave};
use lightpath::lab::agreement::{self, Agreement};
use lightpath::lab::rays::{RayClass, Recording, record};
use lightpath::lab::replay::{Mode, Replay};
use lightpath::lab::stats::{mad, median, paired_ratio};
use lightpath::monitor::Monitor;
use lightpath::ray::LANES;
use lightpath::scene::{Backend, EmbreeMode, Overrides};
use lightpath::simd::Isa;
use lightpath::studio::{self, Subject, Template};
use lightpath::world::{LoadOptions, World};
use rayon::ThreadPool;

/// Maximum share of rays whose answer may differ from that of `bvh`. Above it, the benchmark itself
/// is wrong.
const MAX_DIFFERENT: f64 = 0.01;

#[derive(Parser)]
struct Arguments {
    /// A mesh; it is placed in the scene of `lightpath bench`
    mesh: PathBuf,
    /// Maximum number of rays per class
    #[arg(long, default_value_t = 1 << 16)]
    rays: usize,
    /// Width and height of the picture whose rays are used
    #[arg(long, default_value_t = 384)]
    size: u32,
    /// Turns of A B .. B A
    #[arg(long, default_value_t = 10)]
    rounds: usize,
    /// How far tinybvh's rays start from the surface that they leave; the mesh is 2 units wide
    #[arg(long, default_value_t = 2e-5)]
    offset: f32,
    /// Measure with one thread and with N [default: all]
    #[arg(long)]
    threads: Option<usize>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

/// A backend of lightpath or a tree of tinybvh.
enum ComparedTree {
    Own(&'static str, Backend),
    Tiny(Layout),
}

impl ComparedTree {
    fn all() -> Vec<Self> {
        let mut all = vec![
            Self::Own("embree", Backend::Embree(EmbreeMode::Robust)),
            Self::Own("embree-compact", Backend::Embree(EmbreeMode::Compact)),
            Self::Own("bvh", Backend::Bvh(Isa::detect())),
        ];
        if Isa::detect() == Isa::Avx512 {
            all.push(Self::Own("bvh:avx2", Backend::Bvh(Isa::Avx2)));
        }
        all.extend(Layout::ALL.map(Self::Tiny));
        all
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Own(name, _) => name,
            Self::Tiny(layout) => layout.name(),
        }
    }
}

/// Inputs that all backends share.
struct Bench<'a> {
    arguments: &'a Arguments,
    world: &'a World,
    corners: &'a Corners,
    trees: Vec<ComparedTree>,
    monitor: &'a Monitor,
}

type Built<'a> = Vec<Box<dyn Accelerator + 'a>>;

fn run(arguments: &Arguments) -> Result<bool> {
    let monitor = Monitor::default();
    let world = world(arguments, &monitor)?;
    let corners = Corners::of(&world.geometry);
    let all = std::thread::available_parallelism().map_or(1, usize::from);
    let most = arguments.threads.unwrap_or(all);
    println!("{}: {} triangles", arguments.mesh.display(), corners.triangles());
    let bench = Bench {
        arguments,
        world: &world,
        corners: &corners,
        trees: ComparedTree::all(),
        monitor: &monitor,
    };
    let built = pool(most).install(|| bench.build())?;
    let ours = bench.trees.iter().position(|c| c.name() == "bvh").unwrap_or(0);
    let packets = arguments.rays.div_ceil(LANES).max(1);
    let recording = record(&world, &*built[ours], packets, 0, &monitor)?;
    let right = bench.answers(&built, &recording, ours);
    let mut counts = vec![1, most];
    counts.dedup();
    for threads in counts {
        pool(threads).install(|| bench.rays(&built, &recording, threads))?;
    }
    Ok(right)
}

fn pool(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
}

/// Loads the mesh in the scene of `lightpath bench`.
fn world(arguments: &Arguments, monitor: &Monitor) -> Result<World> {
    let template = Template::builtin("<bench>", include_str!("../../../assets/bench.json"));
    let mut size = Overrides::default();
    size.flag("--size", "/camera/width", Some(arguments.size));
    size.flag("--size", "/camera/height", Some(arguments.size));
    let path: &Path = &arguments.mesh;
    let shown = studio::show(&Subject::new(path), &template, size, None, monitor)?;
    let options = LoadOptions { ready: vec![shown.mesh], ..LoadOptions::default() };
    Ok(World::load(&shown.loaded.scene, options, monitor)?.0)
}

impl Bench<'_> {
    /// Builds one accelerator. Also returns how many of its bytes queries read.
    fn one(&self, tree: &ComparedTree) -> Result<(Box<dyn Accelerator + '_>, u64)> {
        let threads = rayon::current_num_threads();
        let options = BuildOptions { threads, max_bytes: None };
        match tree {
            ComparedTree::Own(_, backend) => {
                let geometry = &self.world.geometry;
                let built = accel::build(geometry, *backend, &options, self.monitor)?;
                let bytes = built.info().bytes;
                Ok((built, bytes))
            }
            ComparedTree::Tiny(layout) => {
                let built = TinyBvh::build(self.corners, *layout, self.arguments.offset);
                let bytes = built.cost.read;
                Ok((Box::new(built), bytes))
            }
        }
    }

    /// Builds all accelerators on the current pool, in turns, and prints their build times and
    /// memory.
    fn build(&self) -> Result<Built<'_>> {
        let plan = TimingPlan { rounds: self.arguments.rounds.div_ceil(3), budget: Duration::ZERO };
        let samples = interleave(self.trees.len(), plan, self.monitor, |i| {
            let started = Instant::now();
            let built = self.one(&self.trees[i])?;
            let seconds = started.elapsed().as_secs_f64();
            drop(built);
            Ok(seconds)
        })?;
        let triangles = f64::from(self.corners.triangles());
        println!(
            "\n{:24} {:>10} {:>8} {:>10} {:>10}",
            "", "build ms", "MAD %", "held B/tri", "read B/tri"
        );
        let mut all = Built::new();
        for (tree, samples) in self.trees.iter().zip(&samples) {
            let (built, read) = self.one(tree)?;
            let [held, read] = [built.info().bytes, read].map(|bytes| bytes as f64 / triangles);
            let (middle, spread) = (median(samples), mad(samples));
            println!(
                "{:24} {:10.1} {:8.1} {held:10.1} {read:10.1}",
                tree.name(),
                middle * 1e3,
                100.0 * spread / middle
            );
            all.push(built);
        }
        Ok(all)
    }

    /// Returns the rays of each class, to be traced one at a time.
    fn replays<'r>(&self, recording: &'r Recording) -> impl Iterator<Item = Replay<'r>> {
        RayClass::ALL.into_iter().filter_map(|class| {
            let packets = recording.packets(class);
            (!packets.is_empty()).then_some(Replay { class, mode: Mode::Single, packets })
        })
    }

    /// Prints how the answers of each backend differ from those of `bvh`. Returns true if at most
    /// [`MAX_DIFFERENT`] of each class differ.
    fn answers(&self, built: &Built<'_>, recording: &Recording, ours: usize) -> bool {
        let head = ["rays", "hits", "same", "ties", "other t", "missed", "wrong"];
        let mut right = true;
        for replay in self.replays(recording) {
            let rays = recording.count(replay.class);
            print!("\n{:24}", replay.class.name());
            println!("{}", head.map(|name| format!(" {name:>8}")).concat());
            for (i, tree) in self.trees.iter().enumerate() {
                let pair: [&dyn Accelerator; 2] = [&*built[ours], &*built[i]];
                let (scores, pairs) = agreement::compare(&replay, &self.world.geometry, &pair);
                let Agreement { same, tie, depth, missed } = pairs[0].2;
                let numbers = [rays, scores[1].hits, same, tie, depth, missed, scores[1].wrong];
                print!("{:24}", tree.name());
                println!("{}", numbers.map(|n| format!(" {n:8}")).concat());
                right &= (depth + missed) as f64 <= MAX_DIFFERENT * rays as f64;
            }
        }
        if !right {
            eprintln!("more than {} % of some answers differ", 100.0 * MAX_DIFFERENT);
        }
        right
    }

    /// Prints rays per second, measured in turns on the current pool.
    fn rays(&self, built: &Built<'_>, recording: &Recording, threads: usize) -> Result<()> {
        let plan = TimingPlan { rounds: self.arguments.rounds, budget: Duration::ZERO };
        for replay in self.replays(recording) {
            let samples =
                interleave(built.len(), plan, self.monitor, |i| Ok(replay.seconds(&*built[i])))?;
            let rays = recording.count(replay.class) as f64;
            let title = format!("{}, {threads} thread(s)", replay.class.name());
            println!("\n{title:24} {:>8} {:>8}   / embree", "Mray/s", "MAD %");
            for (tree, own) in self.trees.iter().zip(&samples) {
                let (middle, ratio) = (median(own), paired_ratio(&samples[0], own));
                println!(
                    "{:24} {:8.2} {:8.1}   {:.2} [{:.2}, {:.2}]",
                    tree.name(),
                    rays / middle / 1e6,
                    100.0 * mad(own) / middle,
                    ratio.value,
                    ratio.low,
                    ratio.high
                );
            }
        }
        Ok(())
    }
}
