//! Records the rays of a scene once, to replay them on every backend that is measured or checked.
//!
//! The renderer itself generates the rays: it runs over a `Recorder`, an accelerator that records
//! every query. So order, packets and masks are those of a render, and no formula is duplicated.
//! The renderer has no diffuse bounces; these rays are generated here.

use std::sync::{Mutex, PoisonError};

use glam::Vec3;

use crate::accel::{Accelerator, BuildInfo};
use crate::error::Result;
use crate::film::Window;
use crate::geometry::{Geometry, Nearby, Surfaces, refine};
use crate::integrate::{Pattern, RenderContext, TILE, TileKernel};
use crate::lab::named::named;
use crate::monitor::Monitor;
use crate::ray::{Coherence, LANES, Mask, RayKind, RayPacket, Rays};
use crate::sampler::{Sampler, disk};
use crate::shading::{Emitter, lane};
use crate::simd::{self, Isa};
use crate::world::World;

named! {
    /// Class of rays by their purpose. It decides the query and the coherence of their packets.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum RayClass {
        /// Rays from the camera.
        Primary = "primary",
        /// Shadow rays from camera hits to point lights.
        ShadowPoint = "shadow-point",
        /// Shadow rays from camera hits to area lights, suns and environments.
        ShadowArea = "shadow-area",
        /// Mirrored rays from camera hits on mirrors.
        Mirror = "mirror",
        /// Rays from camera hits in random directions, cosine-distributed around the geometric
        /// normal.
        Diffuse = "diffuse",
    }
}

impl RayClass {
    /// Returns whether the query of these rays is [`Accelerator::occluded`], not
    /// [`Accelerator::closest`].
    pub fn is_shadow(self) -> bool {
        matches!(self, Self::ShadowPoint | Self::ShadowArea)
    }

    /// Coherence of the packets of this class in the renderer.
    pub fn coherence(self) -> Coherence {
        match self {
            Self::Primary | Self::ShadowPoint | Self::ShadowArea => Coherence::Coherent,
            Self::Mirror | Self::Diffuse => Coherence::Incoherent,
        }
    }
}

/// A packet of rays as it is before its query.
#[derive(Debug, Clone)]
pub struct PacketToTrace {
    /// Lanes that hold rays; at least one.
    pub active: Mask,
    /// The rays. Active lanes pass [`Rays::possible`].
    pub rays: Rays,
}

/// All recorded rays of one scene, by class.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    packets: [Vec<PacketToTrace>; RayClass::ALL.len()],
}

impl Recording {
    /// The packets of a class, in the renderer's order. Empty if the scene has no such rays.
    pub fn packets(&self, class: RayClass) -> &[PacketToTrace] {
        &self.packets[class as usize]
    }

    /// Number of rays of a class.
    pub fn count(&self, class: RayClass) -> u64 {
        self.packets(class).iter().map(|packet| u64::from(packet.active.count())).sum()
    }
}

/// Records the rays of `world`, at most `packets` (> 0) packets of each class.
///
/// If `packets` camera packets suffice for all tiles, the rays come from the whole frame. Else they
/// come from equal windows, spread evenly over the tiles. `accelerator` finds the camera hits, from
/// which all other rays start. `seed` is the seed of the diffuse rays.
///
/// # Errors
/// `Interrupted` after a signal.
pub fn record(
    world: &World,
    accelerator: &dyn Accelerator,
    packets: usize,
    seed: i64,
    monitor: &Monitor,
) -> Result<Recording> {
    let (windows, primary) = windows(world, packets);
    let state = State {
        recording: Recording::default(),
        seen: 0,
        primary,
        limit: packets,
        taking: [true; RayClass::ALL.len()],
        surfaces: Surfaces::EMPTY,
    };
    let points = world.lights.iter().filter_map(|light| match &light.emitter {
        Emitter::Point(q) => Some(*q),
        Emitter::Area(_) => None,
    });
    let tape = Tape {
        inner: accelerator,
        geometry: &world.geometry,
        points: points.collect(),
        sampler: Sampler::new(seed),
        state: Mutex::new(state),
    };
    let recorder = Recorder(RayKind::ALL.map(|kind| KindRecorder { tape: &tape, kind }));
    let isa = Isa::detect();
    for window in windows {
        monitor.check()?;
        let width = window.width() as usize;
        let mut pixels = vec![[0.0; 4]; width * window.height() as usize];
        let mut rows: Vec<_> = pixels.chunks_mut(width).collect();
        let context = RenderContext { world, accelerator: &recorder, isa, monitor };
        simd::dispatch(isa, TileKernel::beauty(context, window, &mut rows));
    }
    monitor.check()?;
    let state = tape.state.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(state.recording)
}

/// Returns one window for each chosen tile, and the number of camera packets of all windows.
fn windows(world: &World, packets: usize) -> (Vec<Window>, usize) {
    let [width, height] = world.frame;
    let pattern = Pattern::for_spp(world.spp);
    let [bw, bh] = pattern.block;
    let passes = u64::from(world.spp.div_ceil(pattern.samples));
    let blocks = (packets as u64 / passes).max(1);
    let [across, down] = [width.div_ceil(TILE), height.div_ceil(TILE)];
    let tiles = u64::from(across) * u64::from(down);
    // Tiles are left out only if there are fewer blocks than tiles.
    let share = (blocks as f64 / tiles as f64).sqrt().min(1.0);
    let part = |n: u32| ((f64::from(n) * share) as u32).max(1);
    let [columns, rows] = [part(across), part(down)];
    let each = (blocks / (u64::from(columns) * u64::from(rows))).max(1);
    let most = [TILE / bw, TILE / bh];
    let wide = ((each as f64).sqrt().ceil() as u64).min(u64::from(most[0]));
    let high = (each / wide).clamp(1, u64::from(most[1]));
    let middle = |i: u32, chosen: u32, all: u32| {
        ((u64::from(2 * i + 1) * u64::from(all)) / u64::from(2 * chosen)) as u32 * TILE
    };
    let mut windows = Vec::new();
    let mut count = 0;
    for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
        let (x0, y0) = (middle(i, columns, across), middle(j, rows, down));
        let x1 = (x0 + wide as u32 * bw).min(width);
        let y1 = (y0 + high as u32 * bh).min(height);
        count += u64::from((x1 - x0).div_ceil(bw) * (y1 - y0).div_ceil(bh)) * passes;
        windows.push(Window { x0, y0, x1, y1 });
    }
    (windows, count as usize)
}

/// What the accelerators of a recording share.
///
/// Only camera rays get an answer. Rays that start from hits of other rays are not recorded, so
/// these hits are not needed.
struct Tape<'a> {
    inner: &'a dyn Accelerator,
    geometry: &'a Geometry,
    /// Positions of the point lights.
    points: Vec<Vec3>,
    sampler: Sampler,
    state: Mutex<State>,
}

struct State {
    recording: Recording,
    /// Number of camera packets traced so far.
    seen: usize,
    /// Number of camera packets of all windows.
    primary: usize,
    /// Largest number of packets of each class.
    limit: usize,
    /// Whether each class records the rays that belong to the current camera packet. It records all
    /// of them or none, so rays from one place stay together, as in a render.
    taking: [bool; RayClass::ALL.len()],
    surfaces: Surfaces,
}

impl State {
    fn push(&mut self, class: RayClass, active: &Mask, rays: &Rays) {
        let packets = &mut self.recording.packets[class as usize];
        if packets.len() < self.limit && self.taking[class as usize] && active.any() {
            packets.push(PacketToTrace { active: *active, rays: rays.clone() });
        }
    }

    /// Begins the next camera packet. Its rays are recorded by every class that does not exceed its
    /// even share so far.
    fn next(&mut self) {
        self.taking = RayClass::ALL.map(|class| {
            let have = self.recording.packets(class).len() as u128;
            have * (self.primary as u128) <= self.limit as u128 * self.seen as u128
        });
        self.seen += 1;
    }
}

impl Tape<'_> {
    fn with(&self, note: impl FnOnce(&mut State)) {
        note(&mut self.state.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// Returns whether all active rays end at one and the same point light. `light_rays` computes
    /// their directions as `q - origin`, so the comparison is exact.
    fn towards_a_point(&self, active: &Mask, rays: &Rays) -> bool {
        self.points.iter().any(|&q| {
            let mut lanes = (0..LANES).filter(|&i| active.0[i] != 0);
            lanes.all(|i| lane(&rays.dir, i) == q - lane(&rays.org, i))
        })
    }

    /// Records cosine-distributed rays from the hits of a camera packet.
    fn diffuse(&self, state: &mut State, hit: &Mask, packet: &RayPacket) {
        refine(self.geometry, hit, packet, &mut state.surfaces);
        let mut rays = Rays::EMPTY;
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            // All rays take points of one sample sequence, as if they belonged to one pixel.
            let index = (state.seen * LANES + i) as u32;
            let [x, y] = disk(self.sampler.light([0; 2], index, 0, 0));
            let normal = lane(&state.surfaces.ng, i);
            let (tangent, bitangent) = normal.any_orthonormal_pair();
            let up = (1.0 - x * x - y * y).max(0.0).sqrt();
            let direction = (tangent * x + bitangent * y + normal * up).normalize();
            rays.set(i, lane(&state.surfaces.outside, i), direction);
            rays.leaving[i] = state.surfaces.primitive[i];
        }
        state.push(RayClass::Diffuse, hit, &rays);
    }
}

/// An accelerator that records every query of one kind of rays.
///
/// The query does not tell the kind: shadow rays near an inner edge are traced by
/// [`Accelerator::closest`].
struct KindRecorder<'a> {
    tape: &'a Tape<'a>,
    kind: RayKind,
}

impl KindRecorder<'_> {
    /// Records shadow rays or mirrored rays.
    fn secondary(&self, active: &Mask, rays: &Rays) {
        let class = match self.kind {
            RayKind::Shadow if self.tape.towards_a_point(active, rays) => RayClass::ShadowPoint,
            RayKind::Shadow => RayClass::ShadowArea,
            RayKind::Camera | RayKind::Reflection => RayClass::Mirror,
        };
        self.tape.with(|state| state.push(class, active, rays));
    }
}

impl Accelerator for KindRecorder<'_> {
    fn info(&self) -> BuildInfo {
        self.tape.inner.info()
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        if self.kind != RayKind::Camera {
            return self.secondary(active, &packet.rays);
        }
        self.tape.with(|state| {
            state.next();
            state.push(RayClass::Primary, active, &packet.rays);
        });
        self.tape.inner.closest(active, packet, coherence);
        self.tape.with(|state| self.tape.diffuse(state, &packet.hit(active), packet));
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.tape.inner.near(geometry, nearby, found);
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, _: Coherence) {
        self.secondary(active, rays);
    }
}

/// The accelerator that the renderer gets: one recorder for each [`RayKind`].
struct Recorder<'a>([KindRecorder<'a>; RayKind::ALL.len()]);

impl Recorder<'_> {
    fn of(&self, kind: RayKind) -> &dyn Accelerator {
        &self.0[kind as usize]
    }
}

impl Accelerator for Recorder<'_> {
    fn info(&self) -> BuildInfo {
        self.of(RayKind::Camera).info()
    }

    fn only(&self, kind: RayKind) -> Option<&dyn Accelerator> {
        Some(self.of(kind))
    }

    fn closest(&self, active: &Mask, packet: &mut RayPacket, coherence: Coherence) {
        self.of(RayKind::Camera).closest(active, packet, coherence);
    }

    fn near(&self, geometry: &Geometry, nearby: &Nearby, found: &mut dyn FnMut(u32)) {
        self.of(RayKind::Camera).near(geometry, nearby, found);
    }

    fn occluded(&self, active: &Mask, rays: &mut Rays, coherence: Coherence) {
        self.of(RayKind::Shadow).occluded(active, rays, coherence);
    }
}
