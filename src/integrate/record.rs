//! What is kept of a packet beside its radiance: nothing, or the layers of a plan.
//!
//! [`Record::ON`] is a constant, so a render without layers is compiled without any of this.

use std::ops::Range;

use crate::geometry::Surfaces;
use crate::layers::{BEAUTY, Nearest, Plan, Raw, count};
use crate::ray::{LANES, Mask, RayPacket};
use crate::shading::{Lanes, Lanes3, Light, Lit, Points, lane};
use crate::world::World;

use super::block::BlockSums;
use super::slot::{Pattern, Slot};

/// Watches the light of packets being gathered.
pub trait Record {
    /// Whether the light of packets is watched.
    const ON: bool;
    /// Whether words are written for each pixel.
    fn has_words(&self) -> bool;
    /// What is kept of one pixel between passes over its samples.
    type Held: Send;
    /// That of a pixel without samples.
    fn held(&self) -> Self::Held;
    /// Exchanges what is kept of the block, which is one pixel, with another pixel's.
    fn exchange(&mut self, held: &mut Self::Held);
    /// A new block of pixels begins.
    fn begin(&mut self);
    /// The first hits of a packet's camera rays.
    fn surface(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, points: &Points);
    /// What a light brings, to be multiplied by base colours and throughputs.
    fn light(&mut self, light: u32, bounce: u32, base: &Lanes3, throughput: &Lanes, split: &Split);
    /// Ambient light that the lanes carry.
    fn ambient(&mut self, bounce: u32, sent: &Lanes3);
    /// Background that the lanes carry.
    fn background(&mut self, bounce: u32, sent: &Lanes3);
    /// The packet is done: its samples within `samples` count.
    fn packet(&mut self, slot: &Slot, samples: &Range<u32>, radiance: &Lanes3);
    /// Writes the words of one pixel of the block, of `n` samples, into a row, as pixel `column` of it.
    /// `beauty` holds R, G, B, A.
    fn write(&self, pixel: usize, n: u32, beauty: &BlockSums, column: usize, row: &mut [u32]);
}

/// The beauty alone; of a part of the samples, its sums as words.
#[derive(Debug, Clone, Copy)]
pub struct Beauty<'a>(pub Option<&'a Raw>);

impl Record for Beauty<'_> {
    const ON: bool = false;
    #[inline(always)]
    fn has_words(&self) -> bool {
        self.0.is_some()
    }
    type Held = ();
    fn held(&self) {}
    #[inline(always)]
    fn exchange(&mut self, (): &mut ()) {}
    #[inline(always)]
    fn begin(&mut self) {}
    fn surface(&mut self, _: &World, _: &RayPacket, _: &Surfaces, _: &Points) {}
    fn light(&mut self, _: u32, _: u32, _: &Lanes3, _: &Lanes, _: &Split) {}
    fn ambient(&mut self, _: u32, _: &Lanes3) {}
    fn background(&mut self, _: u32, _: &Lanes3) {}
    fn packet(&mut self, _: &Slot, _: &Range<u32>, _: &Lanes3) {}

    fn write(&self, pixel: usize, _: u32, beauty: &BlockSums, column: usize, row: &mut [u32]) {
        let Some(raw) = self.0 else { return };
        let stride = raw.words();
        let words = &mut row[column * stride..(column + 1) * stride];
        let sum = |node: usize, quantity: usize| beauty.value(node, pixel, quantity);
        raw.encode(sum, &Nearest::NONE, &[], words);
    }
}

/// What one light brings to each lane, before the base colour: diffuse and specular apart.
#[derive(Debug, Clone)]
pub struct Split {
    diffuse: [[f64; LANES]; 3],
    specular: [[f64; LANES]; 3],
    /// Light points that are seen.
    visible: [f64; LANES],
}

impl Split {
    /// No light.
    pub const NONE: Self =
        Self { diffuse: [[0.0; LANES]; 3], specular: [[0.0; LANES]; 3], visible: [0.0; LANES] };

    /// A light point of each lane that `visible` has, with the weights of [`Lit`].
    #[inline(always)]
    pub fn of(light: &Light, lit: &Lit, visible: &Mask) -> Self {
        let mut split = Self::NONE;
        for axis in 0..3 {
            let (diffuse, specular) = (light.diffuse[axis], light.specular[axis]);
            for i in 0..LANES {
                let seen = visible.0[i] != 0;
                let (d, s) = (diffuse * lit.diffuse[i], specular * lit.specular[i]);
                split.diffuse[axis][i] = if seen { f64::from(d) } else { 0.0 };
                split.specular[axis][i] = if seen { f64::from(s) } else { 0.0 };
            }
        }
        for i in 0..LANES {
            split.visible[i] = if visible.0[i] != 0 { 1.0 } else { 0.0 };
        }
        split
    }

    /// Adds a light point to lane `i`, with the weights of [`Lit`], times `weight`.
    #[inline(always)]
    pub fn add(&mut self, i: usize, light: &Light, diffuse: f32, specular: f32, weight: f64) {
        for axis in 0..3 {
            self.diffuse[axis][i] += f64::from(light.diffuse[axis] * diffuse) * weight;
            self.specular[axis][i] += f64::from(light.specular[axis] * specular) * weight;
        }
        self.visible[i] += weight;
    }

    /// Sums over light points -> their mean.
    #[inline(always)]
    pub fn scale(&mut self, share: f64) {
        for i in 0..LANES {
            for axis in 0..3 {
                self.diffuse[axis][i] *= share;
                self.specular[axis][i] *= share;
            }
            self.visible[i] *= share;
        }
    }
}

/// The layers of one pixel between passes.
#[derive(Debug)]
pub struct Held {
    sums: BlockSums,
    nearest: Nearest,
    mattes: Vec<Vec<(u32, u32)>>,
}

/// The layers of a plan, for one block of pixels at a time.
#[derive(Debug)]
pub struct Layers<'a> {
    plan: &'a Plan,
    /// How a part of the samples is written; all of them are written as channels.
    raw: Option<&'a Raw>,
    pattern: Pattern,
    /// One packet's values of each quantity of [`crate::layers::Recipe::summed`], in f64.
    lanes: Vec<[f64; LANES]>,
    /// Their sums over packets.
    sums: BlockSums,
    /// By pixel of the block.
    nearest: [Nearest; LANES],
    /// By pixel of the block and kind of mattes: ids and how often they were met.
    mattes: [Vec<Vec<(u32, u32)>>; LANES],
}

impl<'a> Layers<'a> {
    /// Room for the layers of `plan`, of a world of `spp` samples a pixel.
    pub fn new(plan: &'a Plan, raw: Option<&'a Raw>, spp: u32) -> Self {
        let (pattern, summed) = (Pattern::for_spp(spp), plan.recipe.summed());
        Self {
            plan,
            raw,
            pattern,
            lanes: vec![[0.0; LANES]; summed],
            sums: BlockSums::new(&pattern, summed),
            nearest: [Nearest::NONE; LANES],
            mattes: std::array::from_fn(|_| vec![Vec::new(); plan.mattes.len()]),
        }
    }

    /// Adds 16 vectors, those of lanes that hit, to the three channels from `first` on.
    #[inline(always)]
    fn add(&mut self, first: Option<usize>, hit: &Mask, values: &Lanes3) {
        let Some(first) = first else { return };
        for (lanes, values) in self.lanes[first..first + 3].iter_mut().zip(values) {
            for i in 0..LANES {
                lanes[i] += if hit.0[i] != 0 { f64::from(values[i]) } else { 0.0 };
            }
        }
    }

    #[inline(always)]
    fn keep_nearest(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces) {
        let mut depths = [0.0; LANES];
        for i in 0..LANES {
            let depth = world.camera.depth(lane(&surfaces.position, i).as_dvec3()) as f32;
            depths[i] = if surfaces.hit.0[i] != 0 { depth } else { f32::INFINITY };
        }
        for i in 0..LANES {
            let nearest = &mut self.nearest[self.pattern.pixel[i]];
            if depths[i] < nearest.depth {
                let local = lane(&surfaces.position, i).as_dvec3();
                *nearest = Nearest {
                    depth: depths[i],
                    position: (local + world.geometry.origin).as_vec3().to_array(),
                    primitive: surfaces.primitive[i] + 1,
                    object: world.shapes.shape(packet.hits.geom[i], packet.hits.prim[i]) + 1,
                };
            }
        }
    }

    /// Counts the shapes of each pixel, those of neighbouring lanes together.
    #[inline(always)]
    fn count_shapes(&mut self, world: &World, packet: &RayPacket, hit: &Mask) {
        let mut run: Option<(usize, u32, u32)> = None;
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            let shape = world.shapes.shape(packet.hits.geom[i], packet.hits.prim[i]);
            let pixel = self.pattern.pixel[i];
            run = match run {
                Some((p, s, times)) if (p, s) == (pixel, shape) => Some((p, s, times + 1)),
                before => {
                    self.count_run(before);
                    Some((pixel, shape, 1))
                }
            };
        }
        self.count_run(run);
    }

    /// A shape that was met some times at a pixel of the block.
    #[inline(always)]
    fn count_run(&mut self, run: Option<(usize, u32, u32)>) {
        let Some((pixel, shape, times)) = run else { return };
        for (counts, mattes) in self.mattes[pixel].iter_mut().zip(&self.plan.mattes) {
            count(counts, mattes.id(shape), times);
        }
    }
}

impl Record for Layers<'_> {
    const ON: bool = true;
    type Held = Held;

    #[inline(always)]
    fn has_words(&self) -> bool {
        true
    }

    fn held(&self) -> Held {
        Held {
            sums: BlockSums::new(&self.pattern, self.plan.recipe.summed()),
            nearest: Nearest::NONE,
            mattes: vec![Vec::new(); self.plan.mattes.len()],
        }
    }

    fn exchange(&mut self, held: &mut Held) {
        std::mem::swap(&mut self.sums, &mut held.sums);
        std::mem::swap(&mut self.nearest[0], &mut held.nearest);
        std::mem::swap(&mut self.mattes[0], &mut held.mattes);
    }

    #[inline(always)]
    fn begin(&mut self) {
        self.sums.clear();
        let pixels = self.pattern.pixels();
        self.nearest[..pixels].fill(Nearest::NONE);
        self.mattes[..pixels].iter_mut().flatten().for_each(Vec::clear);
    }

    #[inline(always)]
    fn surface(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, points: &Points) {
        let (plan, hit) = (self.plan, &points.at.hit);
        self.add(plan.normal, hit, &points.at.n);
        self.add(plan.geometric_normal, hit, &points.at.ng);
        self.add(plan.albedo, hit, &points.base);
        if let Some(first) = plan.uv {
            for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
                if let Some(uv) = world.shapes.uv(&world.geometry, packet, surfaces, i) {
                    self.lanes[first][i] += f64::from(uv.x);
                    self.lanes[first + 1][i] += f64::from(uv.y);
                }
            }
        }
        if self.plan.recipe.has_nearest() {
            self.keep_nearest(world, packet, surfaces);
        }
        if !plan.mattes.is_empty() {
            self.count_shapes(world, packet, hit);
        }
    }

    #[inline(always)]
    fn light(&mut self, light: u32, bounce: u32, base: &Lanes3, throughput: &Lanes, split: &Split) {
        let plan = self.plan;
        let group = plan.lights[light as usize];
        if let (0, Some((channel, share))) = (bounce, plan.shadows[light as usize]) {
            for i in 0..LANES {
                self.lanes[channel][i] += split.visible[i] * f64::from(share);
            }
        }
        let parts = match bounce {
            0 => [plan.diffuse, plan.specular],
            _ => [plan.reflection; 2],
        };
        for axis in 0..3 {
            let (mut diffuse, mut specular) = ([0.0; LANES], [0.0; LANES]);
            for i in 0..LANES {
                let carried = f64::from(base[axis][i]) * f64::from(throughput[i]);
                // What an unlit lane carries is of no packet in particular.
                let (d, s) = (split.diffuse[axis][i], split.specular[axis][i]);
                diffuse[i] = if d == 0.0 { 0.0 } else { d * carried };
                specular[i] = if s == 0.0 { 0.0 } else { s * carried };
            }
            for (first, sent) in parts.iter().zip([&diffuse, &specular]) {
                if let Some(first) = first {
                    for i in 0..LANES {
                        self.lanes[first + axis][i] += sent[i];
                    }
                }
            }
            if let Some(first) = group {
                for i in 0..LANES {
                    self.lanes[first + axis][i] += diffuse[i] + specular[i];
                }
            }
        }
    }

    #[inline(always)]
    fn ambient(&mut self, bounce: u32, sent: &Lanes3) {
        let plan = self.plan;
        let first = if bounce == 0 { plan.ambient } else { plan.reflection };
        self.add(first, &Mask::ALL, sent);
        self.add(plan.light_ambient, &Mask::ALL, sent);
    }

    #[inline(always)]
    fn background(&mut self, bounce: u32, sent: &Lanes3) {
        let plan = self.plan;
        let first = if bounce == 0 { plan.background } else { plan.reflection };
        self.add(first, &Mask::ALL, sent);
        self.add(plan.light_background, &Mask::ALL, sent);
    }

    #[inline(always)]
    fn packet(&mut self, slot: &Slot, samples: &Range<u32>, radiance: &Lanes3) {
        if self.plan.recipe.variance.is_some() {
            let moments = &mut self.lanes[self.plan.recipe.filtered..];
            for axis in 0..3 {
                for i in 0..LANES {
                    let value = f64::from(radiance[axis][i]);
                    moments[axis][i] = value;
                    moments[3 + axis][i] = value * value;
                }
            }
        }
        self.sums.add(&self.pattern, slot.first, samples, &self.lanes);
        self.lanes.fill([0.0; LANES]);
    }

    fn write(&self, pixel: usize, n: u32, beauty: &BlockSums, column: usize, row: &mut [u32]) {
        let (nearest, mattes) = (&self.nearest[pixel], &self.mattes[pixel]);
        if let Some(raw) = self.raw {
            let stride = raw.words();
            let words = &mut row[column * stride..(column + 1) * stride];
            let sum = |node: usize, quantity: usize| match quantity.checked_sub(BEAUTY) {
                Some(quantity) => self.sums.value(node, pixel, quantity),
                None => beauty.value(node, pixel, quantity),
            };
            return raw.encode(sum, nearest, mattes, words);
        }
        let stride = self.plan.recipe.channels.len();
        let words = &mut row[column * stride..(column + 1) * stride];
        let sum = |quantity: usize| self.sums.total(pixel, quantity);
        self.plan.recipe.fill(n, sum, nearest, mattes, words);
    }
}
