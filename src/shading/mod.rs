//! Materials, textures and lights: what turns a hit into radiance.

pub mod texture;
