//! What is kept of a packet beside its radiance: nothing, or the layers of a plan.
//!
//! [`Record::ON`] is a constant, so a render without layers is compiled without any of this.

use crate::geometry::Surfaces;
use crate::layers::{FAR, Plan};
use crate::ray::{LANES, Mask, RayPacket};
use crate::shading::{Lanes, Lanes3, Light, Points, lane};
use crate::world::World;

use super::slot::Pattern;

/// Watches the light of packets being gathered.
pub trait Record {
    /// Whether anything is kept.
    const ON: bool;
    /// A new block of pixels begins.
    fn begin(&mut self);
    /// The first hits of a packet's camera rays.
    fn surface(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, points: &Points);
    /// What a light brings, to be multiplied by base colours and throughputs.
    fn light(&mut self, light: u32, bounce: u32, base: &Lanes3, throughput: &Lanes, split: &Split);
    /// Ambient light of one lane.
    fn ambient(&mut self, axis: usize, lane: usize, bounce: u32, sent: f32);
    /// Background of one lane.
    fn background(&mut self, axis: usize, lane: usize, bounce: u32, sent: f32);
    /// The packet's final radiance.
    fn radiance(&mut self, active: &Mask, radiance: &Lanes3);
    /// Writes the words of one pixel of the block into a row, as pixel `column` of it.
    fn write(&self, pattern: &Pattern, pixel: usize, spp: u32, column: usize, row: &mut [u32]);
}

/// The beauty alone.
#[derive(Debug, Clone, Copy)]
pub struct Beauty;

impl Record for Beauty {
    const ON: bool = false;
    fn begin(&mut self) {}
    fn surface(&mut self, _: &World, _: &RayPacket, _: &Surfaces, _: &Points) {}
    fn light(&mut self, _: u32, _: u32, _: &Lanes3, _: &Lanes, _: &Split) {}
    fn ambient(&mut self, _: usize, _: usize, _: u32, _: f32) {}
    fn background(&mut self, _: usize, _: usize, _: u32, _: f32) {}
    fn radiance(&mut self, _: &Mask, _: &Lanes3) {}
    fn write(&self, _: &Pattern, _: usize, _: u32, _: usize, _: &mut [u32]) {}
}

/// What one light brings to each lane, before the base colour: diffuse and specular apart.
#[derive(Debug, Clone)]
pub struct Split {
    diffuse: [[f64; 3]; LANES],
    specular: [[f64; 3]; LANES],
    /// Light points that are seen.
    visible: [f64; LANES],
}

impl Split {
    /// No light.
    pub const NONE: Self =
        Self { diffuse: [[0.0; 3]; LANES], specular: [[0.0; 3]; LANES], visible: [0.0; LANES] };

    /// Adds a light point that lane `i` sees, with the weights of [`crate::shading::Lit`].
    #[inline(always)]
    pub fn add(&mut self, i: usize, light: &Light, diffuse: f32, specular: f32) {
        for axis in 0..3 {
            self.diffuse[i][axis] += f64::from(light.diffuse[axis] * diffuse);
            self.specular[i][axis] += f64::from(light.specular[axis] * specular);
        }
        self.visible[i] += 1.0;
    }

    /// Sums over light points -> their mean.
    #[inline(always)]
    pub fn scale(&mut self, share: f64) {
        for i in 0..LANES {
            for axis in 0..3 {
                self.diffuse[i][axis] *= share;
                self.specular[i][axis] *= share;
            }
            self.visible[i] *= share;
        }
    }
}

/// The nearest hit among the samples that a lane took of its pixel.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    depth: f32,
    position: [f32; 3],
    primitive: u32,
    object: u32,
}

impl Nearest {
    const NONE: Self = Self { depth: FAR, position: [0.0; 3], primitive: 0, object: 0 };
}

/// The layers of a plan, for one block of pixels at a time: sums by lane, in f64.
#[derive(Debug)]
pub struct Layers<'a> {
    plan: &'a Plan,
    /// One row of lanes for each channel that is a mean.
    sums: Vec<[f64; LANES]>,
    nearest: [Nearest; LANES],
    /// Radiance and its square.
    moments: [[[f64; LANES]; 3]; 2],
    /// By lane: shapes that were hit and how often, in the order of their first hits.
    shapes: [Vec<(u32, u32)>; LANES],
}

impl<'a> Layers<'a> {
    /// Room for the layers of `plan`.
    pub fn new(plan: &'a Plan) -> Self {
        Self {
            plan,
            sums: vec![[0.0; LANES]; plan.filtered],
            nearest: [Nearest::NONE; LANES],
            moments: [[[0.0; LANES]; 3]; 2],
            shapes: std::array::from_fn(|_| Vec::new()),
        }
    }

    /// Adds 16 vectors to the three channels from `first` on.
    #[inline(always)]
    fn add3(&mut self, first: Option<usize>, hit: &Mask, values: &Lanes3) {
        let Some(first) = first else { return };
        for (sums, values) in self.sums[first..first + 3].iter_mut().zip(values) {
            for i in 0..LANES {
                sums[i] += if hit.0[i] != 0 { f64::from(values[i]) } else { 0.0 };
            }
        }
    }

    #[inline(always)]
    fn add(&mut self, first: Option<usize>, axis: usize, i: usize, sent: f32) {
        if let Some(first) = first {
            self.sums[first + axis][i] += f64::from(sent);
        }
    }

    fn keep_nearest(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces) {
        for i in (0..LANES).filter(|&i| surfaces.hit.0[i] != 0) {
            let local = lane(&surfaces.position, i).as_dvec3();
            let depth = world.camera.depth(local) as f32;
            if depth < self.nearest[i].depth {
                self.nearest[i] = Nearest {
                    depth,
                    position: (local + world.geometry.origin).as_vec3().to_array(),
                    primitive: surfaces.primitive[i] + 1,
                    object: world.shapes.shape(packet.hits.geom[i], packet.hits.prim[i]) + 1,
                };
            }
        }
    }

    fn count_shapes(&mut self, world: &World, packet: &RayPacket, hit: &Mask) {
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            let shape = world.shapes.shape(packet.hits.geom[i], packet.hits.prim[i]);
            count(&mut self.shapes[i], shape, 1);
        }
    }

    fn variance(&self, lanes: std::ops::Range<usize>, axis: usize, n: f64) -> f32 {
        let [sum, squares] =
            [0, 1].map(|k| self.moments[k][axis][lanes.clone()].iter().sum::<f64>());
        if n < 2.0 { 0.0 } else { ((squares - sum * sum / n) / (n - 1.0)).max(0.0) as f32 }
    }
}

fn count(counts: &mut Vec<(u32, u32)>, shape: u32, times: u32) {
    match counts.iter_mut().find(|(known, _)| *known == shape) {
        Some((_, sum)) => *sum += times,
        None => counts.push((shape, times)),
    }
}

impl Record for Layers<'_> {
    const ON: bool = true;

    fn begin(&mut self) {
        self.sums.fill([0.0; LANES]);
        self.nearest = [Nearest::NONE; LANES];
        self.moments = [[[0.0; LANES]; 3]; 2];
        self.shapes.iter_mut().for_each(Vec::clear);
    }

    #[inline(never)]
    fn surface(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, points: &Points) {
        let (plan, hit) = (self.plan, &points.at.hit);
        self.add3(plan.normal, hit, &points.at.n);
        self.add3(plan.geometric_normal, hit, &points.at.ng);
        self.add3(plan.albedo, hit, &points.base);
        if let Some(first) = plan.uv {
            for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
                if let Some(uv) = world.shapes.uv(&world.geometry, packet, surfaces, i) {
                    self.sums[first][i] += f64::from(uv.x);
                    self.sums[first + 1][i] += f64::from(uv.y);
                }
            }
        }
        let nearest = [plan.depth, plan.position, plan.primitive, plan.object];
        if nearest.iter().any(Option::is_some) {
            self.keep_nearest(world, packet, surfaces);
        }
        if !plan.mattes.is_empty() {
            self.count_shapes(world, packet, hit);
        }
    }

    #[inline(never)]
    fn light(&mut self, light: u32, bounce: u32, base: &Lanes3, throughput: &Lanes, split: &Split) {
        let plan = self.plan;
        let group = plan.lights[light as usize];
        if let (0, Some((channel, share))) = (bounce, plan.shadows[light as usize]) {
            for i in 0..LANES {
                self.sums[channel][i] += split.visible[i] * f64::from(share);
            }
        }
        for i in (0..LANES).filter(|&i| split.visible[i] > 0.0) {
            for axis in 0..3 {
                let carried = f64::from(base[axis][i]) * f64::from(throughput[i]);
                let diffuse = split.diffuse[i][axis] * carried;
                let specular = split.specular[i][axis] * carried;
                let parts = match bounce {
                    0 => [(plan.diffuse, diffuse), (plan.specular, specular)],
                    _ => [(plan.reflection, diffuse), (plan.reflection, specular)],
                };
                for (first, sent) in parts {
                    if let Some(first) = first {
                        self.sums[first + axis][i] += sent;
                    }
                }
                if let Some(first) = group {
                    self.sums[first + axis][i] += diffuse + specular;
                }
            }
        }
    }

    #[inline(always)]
    fn ambient(&mut self, axis: usize, lane: usize, bounce: u32, sent: f32) {
        let plan = self.plan;
        self.add(if bounce == 0 { plan.ambient } else { plan.reflection }, axis, lane, sent);
        self.add(plan.light_ambient, axis, lane, sent);
    }

    #[inline(always)]
    fn background(&mut self, axis: usize, lane: usize, bounce: u32, sent: f32) {
        let plan = self.plan;
        self.add(if bounce == 0 { plan.background } else { plan.reflection }, axis, lane, sent);
        self.add(plan.light_background, axis, lane, sent);
    }

    #[inline(never)]
    fn radiance(&mut self, active: &Mask, radiance: &Lanes3) {
        if self.plan.variance.is_none() {
            return;
        }
        for axis in 0..3 {
            for i in 0..LANES {
                let value = if active.0[i] != 0 { f64::from(radiance[axis][i]) } else { 0.0 };
                self.moments[0][axis][i] += value;
                self.moments[1][axis][i] += value * value;
            }
        }
    }

    fn write(&self, pattern: &Pattern, pixel: usize, spp: u32, column: usize, row: &mut [u32]) {
        let plan = self.plan;
        let stride = plan.channels.len();
        let words = &mut row[column * stride..(column + 1) * stride];
        let samples = pattern.samples as usize;
        let lanes = pixel * samples..(pixel + 1) * samples;
        let n = f64::from(spp);
        for (word, sums) in words.iter_mut().zip(&self.sums) {
            let sum: f64 = sums[lanes.clone()].iter().sum();
            *word = ((sum / n) as f32).to_bits();
        }
        let nearest = self.nearest[lanes.clone()]
            .iter()
            .fold(&Nearest::NONE, |near, one| if one.depth < near.depth { one } else { near });
        let mut set = |first: Option<usize>, values: &[u32]| {
            if let Some(first) = first {
                words[first..first + values.len()].copy_from_slice(values);
            }
        };
        set(plan.depth, &[nearest.depth.to_bits()]);
        set(plan.position, &nearest.position.map(f32::to_bits));
        set(plan.primitive, &[nearest.primitive]);
        set(plan.object, &[nearest.object]);
        set(plan.samples, &[(spp as f32).to_bits()]);
        let variance = [0, 1, 2].map(|axis| self.variance(lanes.clone(), axis, n).to_bits());
        set(plan.variance, &variance);
        if !plan.mattes.is_empty() {
            let mut counts: Vec<(u32, u32)> = Vec::new();
            for &(shape, times) in self.shapes[lanes].iter().flatten() {
                count(&mut counts, shape, times);
            }
            for mattes in &plan.mattes {
                mattes.rank(&counts, spp, words);
            }
        }
    }
}
