//! Surface points -> what they look like and what light they get. Knows nothing of how hits are
//! found.

mod exr;
mod light;
mod look;
mod points;
mod texture;

pub use light::{Area, Emitter, Falloff, Light, Lit, light_rays};
pub use look::{Material, Owner, Shape, Shapes, UvSource, VertexColors};
pub use points::{Lanes, Lanes3, Points, ShadowPoints, lane, reflect, set_lane};
pub use texture::{DEFAULT_MAX_BYTES, Texture, TextureSize};
