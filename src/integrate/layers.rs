//! Records the layers of a plan while packets are shaded.

use std::ops::Range;

use crate::film::Dropped;
use crate::geometry::Surfaces;
use crate::layers::{BEAUTY, LayerPlan, NearestHit, PartialSumsLayout, count};
use crate::ray::{LANES, Mask, RayPacket};
use crate::shading::{Lanes, Lanes3, Points, lane, set_lane};
use crate::world::World;

use super::block::{BlockSums, Values};
use super::camera_packet::{CameraPacket, Pattern};
use super::record::Record;
use super::sampled_light::SampledLight;
use super::split::LightParts;

/// The layers of one pixel between passes.
#[derive(Debug)]
pub struct Held {
    sums: BlockSums,
    nearest: NearestHit,
    mattes: Vec<Vec<(u32, u32)>>,
    faces: Vec<u32>,
}

/// Records the layers of a plan, for one block of pixels at a time.
#[derive(Debug)]
pub struct Layers<'a> {
    plan: &'a LayerPlan,
    /// Encoding of a part of the samples; `None` for all samples, which are written as channels.
    raw: Option<&'a PartialSumsLayout>,
    pattern: Pattern,
    /// One packet's values by quantity: the filtered channels, then R, G, B for the variance.
    lanes: Vec<Values>,
    /// Which quantities the packet has; the others are 0.
    filled: Vec<bool>,
    /// Sums of all quantities over the packets of the block.
    sums: BlockSums,
    /// Nearest sample, by pixel of the block.
    nearest: [NearestHit; LANES],
    /// Ids and hit counts, by pixel of the block and by kind of mattes.
    mattes: [Vec<Vec<(u32, u32)>>; LANES],
    /// Primitive of each sample that hits, by pixel of the block.
    faces: [Vec<u32>; LANES],
    /// Buffer for the sums of one pixel.
    totals: Vec<f64>,
    /// Coverage that no rank of the mattes could hold, over all written pixels.
    dropped: Dropped,
}

impl<'a> Layers<'a> {
    /// Allocates the layers of `plan`, for a world of `spp` samples per pixel.
    pub fn new(plan: &'a LayerPlan, raw: Option<&'a PartialSumsLayout>, spp: u32) -> Self {
        let pattern = Pattern::for_spp(spp);
        let (values, squares) = quantities(plan);
        Self {
            plan,
            raw,
            pattern,
            lanes: vec![Values([0.0; LANES]); values],
            filled: vec![false; values],
            sums: BlockSums::new(&pattern, values, squares),
            nearest: [NearestHit::NONE; LANES],
            mattes: std::array::from_fn(|_| vec![Vec::new(); plan.mattes.len()]),
            faces: [const { Vec::new() }; LANES],
            totals: Vec::new(),
            dropped: Dropped::default(),
        }
    }

    /// Adds the values of a packet to a quantity.
    #[inline(always)]
    fn add(&mut self, quantity: usize, values: &Lanes) {
        let Values(lanes) = &mut self.lanes[quantity];
        if self.filled[quantity] {
            for i in 0..LANES {
                lanes[i] += values[i];
            }
        } else {
            (*lanes, self.filled[quantity]) = (*values, true);
        }
    }

    /// Adds the vectors of a packet to the three channels from `first` on.
    #[inline(always)]
    fn add3(&mut self, first: Option<usize>, values: &Lanes3) {
        let Some(first) = first else { return };
        for axis in 0..3 {
            self.add(first + axis, &values[axis]);
        }
    }

    /// [`Layers::add3`] for the lanes in `hit` only.
    #[inline(always)]
    fn add_hit(&mut self, first: Option<usize>, hit: &Mask, values: &Lanes3) {
        if first.is_none() {
            return;
        }
        let mut kept = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                kept[axis][i] = if hit.0[i] != 0 { values[axis][i] } else { 0.0 };
            }
        }
        self.add3(first, &kept);
    }

    /// Keeps the nearest hit of each pixel: by depth, or by distance if the camera sees behind
    /// itself. Of equally near samples, the lowest index wins.
    #[inline(always)]
    fn keep_nearest(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces) {
        let mut depths = [0.0; LANES];
        for i in 0..LANES {
            let depth = world.camera.depth(lane(&surfaces.position, i).as_dvec3()) as f32;
            depths[i] = if surfaces.hit.0[i] != 0 { depth } else { f32::INFINITY };
        }
        if world.camera.sees_behind() {
            for i in (0..LANES).filter(|&i| surfaces.hit.0[i] != 0) {
                depths[i] = world.camera.distance(lane(&surfaces.position, i).as_dvec3()) as f32;
            }
        }
        let lanes = self.pattern.order.chunks_exact(self.pattern.samples as usize);
        for (nearest, lanes) in self.nearest.iter_mut().zip(lanes) {
            let (mut least, mut first) = (nearest.depth, LANES);
            for &i in lanes {
                if depths[i % LANES] < least {
                    (least, first) = (depths[i % LANES], i);
                }
            }
            if first == LANES {
                continue;
            }
            let i = first % LANES;
            let local = lane(&surfaces.position, i).as_dvec3();
            let way = local - lane(&packet.rays.org, i).as_dvec3();
            *nearest = NearestHit {
                depth: depths[i],
                distance: way.length() as f32,
                position: (local + world.geometry.origin).as_vec3().to_array(),
                primitive: world.geometry.number(surfaces.primitive[i]),
                object: world.shapes.shape(packet.hits.geom[i], packet.hits.prim[i]) + 1,
            };
        }
    }

    /// Adds the normal in camera space, and its cosine with the direction to the viewer.
    #[inline(always)]
    fn add_view(&mut self, world: &World, points: &Points) {
        let (mut normal, mut facing) = ([[0.0; LANES]; 3], [0.0; LANES]);
        for i in (0..LANES).filter(|&i| points.at.hit.0[i] != 0) {
            let n = lane(&points.at.n, i);
            set_lane(&mut normal, i, world.camera_axes.map(|axis| axis.dot(n)).into());
            facing[i] = n.dot(lane(&points.at.view, i)).max(0.0);
        }
        self.add3(self.plan.camera_normal, &normal);
        if let Some(channel) = self.plan.facing {
            self.add(channel, &facing);
        }
    }

    /// Adds u, v and 1 for every lane with texture coordinates. v points up, as in mesh files.
    #[inline(always)]
    fn add_uv(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, hit: &Mask) {
        let Some(first) = self.plan.uv else { return };
        if world.shapes.lacks_uv(packet, hit) {
            return;
        }
        let mut uv = [[0.0; LANES]; 3];
        for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
            if let Some(at) = world.shapes.uv(&world.geometry, packet, surfaces, i) {
                (uv[0][i], uv[1][i], uv[2][i]) = (at.x as f32, (1.0 - at.y) as f32, 1.0);
            }
        }
        self.add3(Some(first), &uv);
    }

    /// Counts the shapes that the lanes of each pixel hit.
    #[inline(always)]
    fn count_shapes(&mut self, world: &World, packet: &RayPacket, hit: &Mask) {
        if let Some(shape) = world.shapes.one_shape(packet, hit) {
            let mut times = [0; LANES];
            for i in 0..LANES {
                times[self.pattern.pixel[i] % LANES] += u32::from(hit.0[i] != 0);
            }
            for pixel in 0..self.pattern.pixels() {
                if times[pixel] > 0 {
                    self.count_shape(pixel, shape, times[pixel]);
                }
            }
            return;
        }
        for i in self.pattern.order {
            if hit.0[i] != 0 {
                let shape = world.shapes.shape(packet.hits.geom[i], packet.hits.prim[i]);
                self.count_shape(self.pattern.pixel[i], shape, 1);
            }
        }
    }

    /// Counts `times` hits of a shape at a pixel of the block.
    #[inline(always)]
    fn count_shape(&mut self, pixel: usize, shape: u32, times: u32) {
        for (counts, mattes) in self.mattes[pixel].iter_mut().zip(&self.plan.mattes) {
            count(counts, mattes.id(shape), times);
        }
    }

    /// Encodes the sums of one pixel for a part of the samples.
    #[inline(never)]
    fn encode(
        &self,
        raw: &PartialSumsLayout,
        pixel: usize,
        beauty: &BlockSums,
        column: usize,
        row: &mut [u32],
    ) {
        let stride = raw.words();
        let words = &mut row[column * stride..(column + 1) * stride];
        let sum = |node: usize, quantity: usize| match quantity.checked_sub(BEAUTY) {
            Some(quantity) => self.sums.value(node, pixel, quantity),
            None => beauty.value(node, pixel, quantity),
        };
        raw.encode(sum, &self.nearest[pixel], &self.mattes[pixel], words);
    }
}

/// Number of summed values, and number of squares beside them.
fn quantities(plan: &LayerPlan) -> (usize, usize) {
    let squares = if plan.layout.variance.is_some() { 3 } else { 0 };
    (plan.layout.summed() - squares, squares)
}

impl Record for Layers<'_> {
    const ON: bool = true;
    type Held = Held;

    #[inline(always)]
    fn has_words(&self) -> bool {
        true
    }

    fn held(&self) -> Held {
        let (values, squares) = quantities(self.plan);
        Held {
            sums: BlockSums::new(&self.pattern, values, squares),
            nearest: NearestHit::NONE,
            mattes: vec![Vec::new(); self.plan.mattes.len()],
            faces: Vec::new(),
        }
    }

    fn exchange(&mut self, held: &mut Held) {
        std::mem::swap(&mut self.sums, &mut held.sums);
        std::mem::swap(&mut self.nearest[0], &mut held.nearest);
        std::mem::swap(&mut self.mattes[0], &mut held.mattes);
        std::mem::swap(&mut self.faces[0], &mut held.faces);
    }

    #[inline(always)]
    fn begin(&mut self) {
        self.sums.clear();
        let pixels = self.pattern.pixels();
        self.nearest[..pixels].fill(NearestHit::NONE);
        self.mattes[..pixels].iter_mut().flatten().for_each(Vec::clear);
        self.faces[..pixels].iter_mut().for_each(Vec::clear);
    }

    #[inline(always)]
    fn surface(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, points: &Points) {
        let (plan, hit) = (self.plan, &points.at.hit);
        self.add_hit(plan.normal, hit, &points.at.n);
        self.add_hit(plan.geometric_normal, hit, &points.at.ng);
        self.add_hit(plan.albedo, hit, &points.base);
        self.add_uv(world, packet, surfaces, hit);
        if plan.camera_normal.or(plan.facing).is_some() {
            self.add_view(world, points);
        }
        if plan.faces.is_some() {
            for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
                self.faces[self.pattern.pixel[i]].push(surfaces.primitive[i]);
            }
        }
        if plan.layout.has_nearest() {
            self.keep_nearest(world, packet, surfaces);
        }
        if !plan.mattes.is_empty() {
            self.count_shapes(world, packet, hit);
        }
    }

    #[inline(always)]
    fn light(
        &mut self,
        sampled_light: &SampledLight,
        base: &Lanes3,
        throughput: &Lanes,
        split: &LightParts,
    ) {
        let (plan, light) = (self.plan, sampled_light.index as usize);
        if let (0, Some((channel, share))) = (sampled_light.bounce, plan.shadows[light]) {
            let mut visible = split.visible;
            for i in 0..LANES {
                visible[i] *= share;
            }
            self.add(channel, &visible);
        }
        let (mut diffuse, mut specular) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        let mut both = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                let carried = base[axis][i] * throughput[i];
                // A lane without light may hold the base colour of another packet.
                let (d, s) = (split.diffuse[axis][i], split.specular[axis][i]);
                diffuse[axis][i] = if d == 0.0 { 0.0 } else { d * carried };
                specular[axis][i] = if s == 0.0 { 0.0 } else { s * carried };
                both[axis][i] = diffuse[axis][i] + specular[axis][i];
            }
        }
        if sampled_light.bounce == 0 {
            self.add3(plan.diffuse, &diffuse);
            self.add3(plan.specular.filter(|_| sampled_light.glossy), &specular);
        } else {
            self.add3(plan.reflection, &both);
        }
        self.add3(plan.lights[light], &both);
    }

    #[inline(always)]
    fn ambient(&mut self, bounce: u32, sent: &Lanes3) {
        let plan = self.plan;
        self.add3(if bounce == 0 { plan.ambient } else { plan.reflection }, sent);
        self.add3(plan.light_ambient, sent);
    }

    #[inline(always)]
    fn background(&mut self, bounce: u32, sent: &Lanes3) {
        let plan = self.plan;
        self.add3(if bounce == 0 { plan.background } else { plan.reflection }, sent);
        self.add3(plan.light_background, sent);
    }

    fn occlusion(&mut self, free: &Lanes) {
        if let Some(channel) = self.plan.occlusion {
            self.add(channel, free);
        }
    }

    fn caught(&mut self, light: usize, taken: &Lanes) {
        if let Some(channel) = self.plan.caught[light] {
            self.add(channel, taken);
        }
    }

    #[inline(always)]
    fn packet(&mut self, camera_packet: &CameraPacket, samples: &Range<u32>, radiance: &Lanes3) {
        let filtered = self.plan.layout.filtered;
        self.add3(self.plan.layout.variance.map(|_| filtered), radiance);
        self.sums.add(&self.pattern, camera_packet.first, samples, &self.lanes, &self.filled);
        self.filled.fill(false);
    }

    #[inline(always)]
    fn write(&mut self, pixel: usize, n: u32, beauty: &BlockSums, column: usize, row: &mut [u32]) {
        if let Some(raw) = self.raw {
            return self.encode(raw, pixel, beauty, column, row);
        }
        if let Some(counts) = &self.plan.faces {
            counts.add(&mut self.faces[pixel]);
        }
        self.sums.totals(pixel, &mut self.totals);
        let stride = self.plan.layout.channels.len();
        let words = &mut row[column * stride..(column + 1) * stride];
        let layout = &self.plan.layout;
        let dropped =
            layout.fill(n, &self.totals, &self.nearest[pixel], &self.mattes[pixel], words);
        self.dropped = self.dropped.and(dropped);
    }

    fn dropped(&self) -> Dropped {
        self.dropped
    }
}
