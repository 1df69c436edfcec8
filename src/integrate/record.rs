//! Records layers while a packet is shaded: none ([`Beauty`]), or the layers of a plan
//! ([`super::Layers`]).
//!
//! [`Record::ON`] is a constant, so a render without layers is compiled without any of this.

use std::ops::Range;

use crate::film::Dropped;
use crate::geometry::Surfaces;
use crate::layers::{NearestHit, PartialSumsLayout};
use crate::ray::RayPacket;
use crate::shading::{Lanes, Lanes3, Points};
use crate::world::World;

use super::block::BlockSums;
use super::camera_packet::CameraPacket;
use super::sampled_light::SampledLight;
use super::split::LightParts;

/// Receives the light of packets while it is computed.
pub trait Record {
    /// Whether the light of packets is recorded.
    const ON: bool;
    /// Whether the record writes words for each pixel.
    fn has_words(&self) -> bool;
    /// State of one pixel between passes over its samples.
    type Held: Send;
    /// State of a pixel without samples.
    fn held(&self) -> Self::Held;
    /// Swaps the state of the block, which is one pixel, with the state of another pixel.
    fn exchange(&mut self, held: &mut Self::Held);
    /// Starts a new block of pixels.
    fn begin(&mut self);
    /// Records the first hits of a packet's camera rays.
    fn surface(&mut self, world: &World, packet: &RayPacket, surfaces: &Surfaces, points: &Points);
    /// Records the light of one light at a bounce, to be multiplied by base colours and
    /// throughputs.
    fn light(
        &mut self,
        sampled_light: &SampledLight,
        base: &Lanes3,
        throughput: &Lanes,
        split: &LightParts,
    );
    /// Records ambient light, by lane.
    fn ambient(&mut self, bounce: u32, sent: &Lanes3);
    /// Records background radiance, by lane.
    fn background(&mut self, bounce: u32, sent: &Lanes3);
    /// Records the share of the hemisphere that is free of surfaces, by lane.
    fn occlusion(&mut self, free: &Lanes);
    /// Records the share of the light on shadow catchers that shadows of a light take, by lane.
    fn caught(&mut self, light: usize, taken: &Lanes);
    /// Ends the packet and adds its samples within `samples`.
    fn packet(&mut self, camera_packet: &CameraPacket, samples: &Range<u32>, radiance: &Lanes3);
    /// Writes the words of one pixel of the block, with `n` samples, into a row at pixel `column`.
    /// `beauty` holds R, G, B, A.
    fn write(&mut self, pixel: usize, n: u32, beauty: &BlockSums, column: usize, row: &mut [u32]);
    /// Coverage of the written pixels that no rank of the mattes could hold.
    fn dropped(&self) -> Dropped {
        Dropped::default()
    }
}

/// Records no layers. For a part of the samples, writes the sums of the beauty as words.
#[derive(Debug, Clone, Copy)]
pub struct Beauty<'a>(pub Option<&'a PartialSumsLayout>);

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
    fn light(&mut self, _: &SampledLight, _: &Lanes3, _: &Lanes, _: &LightParts) {}
    fn ambient(&mut self, _: u32, _: &Lanes3) {}
    fn background(&mut self, _: u32, _: &Lanes3) {}
    fn occlusion(&mut self, _: &Lanes) {}
    fn caught(&mut self, _: usize, _: &Lanes) {}
    fn packet(&mut self, _: &CameraPacket, _: &Range<u32>, _: &Lanes3) {}

    fn write(&mut self, pixel: usize, _: u32, beauty: &BlockSums, column: usize, row: &mut [u32]) {
        let Some(raw) = self.0 else { return };
        let stride = raw.words();
        let words = &mut row[column * stride..(column + 1) * stride];
        let sum = |node: usize, quantity: usize| beauty.value(node, pixel, quantity);
        raw.encode(sum, &NearestHit::NONE, &[], words);
    }
}
