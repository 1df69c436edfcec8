//! Decides which light shares one stratified sequence with the pixel offsets;
//! docs/notebook/sampling.md explains why.

use crate::shading::Emitter;
use crate::world::World;

/// Fewest camera samples at which the light shares the camera's sequence. With fewer, two separate
/// sets in the first two dimensions have a lower error.
const MIN_JOINT_SAMPLES: u32 = 16;

/// Index of the light whose points share the camera's sequence, in the dimensions of the lens. That
/// is the first area light. It must have one point per camera sample, there must be enough samples,
/// and the camera must have no lens.
#[inline(always)]
pub fn joint_light(world: &World) -> Option<u32> {
    let (area, first) =
        world.lights.iter().zip(0..).find_map(|(light, index)| match &light.emitter {
            Emitter::Area(area) => Some((area, index)),
            Emitter::Point(_) => None,
        })?;
    let shares = area.samples == 1 && world.spp >= MIN_JOINT_SAMPLES && !world.camera.has_lens();
    shares.then_some(first)
}
