//! Which light's points and the pixel's are one stratified set: docs/notebook/sampling.md has why.

use crate::shading::Emitter;
use crate::world::World;

/// Camera samples from which on light and camera share a sequence: of fewer points two sets of their own, in the
/// first two dimensions, err less.
const LEAST_JOINT: u32 = 16;

/// The light whose points share the camera's sequence, in the dimensions of the lens: the first area light,
/// if it has one point per camera sample, of which there are enough, and there is no lens.
#[inline(always)]
pub fn joint_light(world: &World) -> Option<u32> {
    let (area, first) =
        world.lights.iter().zip(0..).find_map(|(light, index)| match light.emitter {
            Emitter::Area(area) => Some((area, index)),
            Emitter::Point(_) => None,
        })?;
    let shares = area.samples == 1 && world.spp >= LEAST_JOINT && !world.camera.has_lens();
    shares.then_some(first)
}
