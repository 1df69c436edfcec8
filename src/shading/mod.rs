//! Materials, textures and lights: turns surface points into colours and incoming light.
//! Independent of the accelerators.

mod environment;
mod environment_map;
mod footprints;
mod image_file;
mod light;
mod light_plane;
mod light_rays;
mod light_tree;
mod look;
mod mesh_colors;
mod mip_map;
mod points;
mod smooth;
mod sun;
mod texel_filter;
mod texel_image;
mod texture;
mod tiles;
mod uv;

pub use environment::{Environment, TurnedMap};
pub use environment_map::EnvironmentMap;
pub use image_file::{DEFAULT_MAX_BYTES, ImageRequest, TextureSize, WHOLE_TEXELS};
pub use light::{Area, Distant, Emitter, Falloff, Light};
pub use light_rays::{LightWeights, keep_directions, light_rays};
pub use light_tree::{DrawnLights, LightTree};
pub use look::{Material, Owner, Shape, Shapes, TextureChoice, TexturesByFace};
pub use mesh_colors::{ColorSource, MappedScalars, MeshColors, StoredColors};
pub use mip_map::Footprint;
pub use points::{Lanes, Lanes3, Points, ShadowPoints, lane, reflect, set_lane};
pub use sun::Cone;
pub use texel_image::Negative;
pub use texture::Texture;
pub use uv::{UvFrame, UvSource};
