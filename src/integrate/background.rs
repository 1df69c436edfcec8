//! The background: radiance of rays that hit nothing.

use glam::Vec3;

use super::camera_packet::CameraPacket;
use super::record::Record;
use super::whitted::WhittedIntegrator;
use crate::ray::{LANES, Mask, Rays};
use crate::shading::{Lanes3, lane, set_lane};

impl WhittedIntegrator<'_> {
    /// Adds the background to the active lanes that missed.
    #[inline(always)]
    pub(super) fn background<R: Record>(
        &mut self,
        camera_packet: &CameraPacket,
        (active, hit): (&Mask, &Mask),
        bounce: u32,
        record: &mut R,
    ) {
        let missed = active.without(hit);
        if !missed.any() {
            return;
        }
        let color = self.world.background.to_array();
        let mut sent = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for i in 0..LANES {
                let carried = color[axis] * self.throughput[i];
                sent[axis][i] = if missed.0[i] != 0 { carried } else { 0.0 };
            }
        }
        if !self.world.visible_environments.is_empty() {
            self.visible_environments(&camera_packet.packet.rays, &missed, &mut sent);
        }
        for axis in 0..3 {
            for i in 0..LANES {
                self.radiance[axis][i] += sent[axis][i];
            }
        }
        if R::ON {
            record.background(bounce, &sent);
        }
    }

    /// Adds the radiance of the visible environment maps to `sent`, for the rays that missed.
    #[cold]
    #[inline(never)]
    fn visible_environments(&self, rays: &Rays, missed: &Mask, sent: &mut Lanes3) {
        for i in (0..LANES).filter(|&i| missed.0[i] != 0) {
            let seen = self
                .world
                .visible_environments
                .iter()
                .map(|environment| environment.seen(lane(&rays.dir, i)));
            let color = seen.sum::<Vec3>() * self.throughput[i];
            set_lane(sent, i, lane(sent, i) + color);
        }
    }
}
