//! What the EXR and the PNG of a film hold beside its pixels, and how they are encoded.

use super::exr;
use super::legend::Legend;
use super::tonemap::Depth;
use crate::scene::Tonemap;

/// Options for writing a film to files.
#[derive(Debug, Clone, Copy)]
pub struct WriteOptions<'a> {
    /// Tone mapping of the PNG.
    pub tonemap: &'a Tonemap,
    /// True if the PNG has an alpha channel.
    pub transparent: bool,
    /// Colours behind the PNG's pixels: one for each pixel of the film. The PNG then has no alpha.
    pub over: Option<&'a [[f32; 3]]>,
    /// Number of bits of the PNG's channels.
    pub depth: Depth,
    /// Legend to draw into the PNG.
    pub legend: Option<&'a Legend>,
    /// Fingerprint of the render's inputs: an attribute of the EXR and a text of the PNG.
    pub fingerprint: Option<&'a str>,
    /// Metadata and encoding of the EXR.
    pub exr: exr::Options<'a>,
}
