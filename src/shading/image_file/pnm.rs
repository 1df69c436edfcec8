//! Decodes Netpbm files (P1 to P7) without scaling their samples.
//!
//! The `image` decoder scales samples from the header's white level to 255 or 65535, and rounds. So
//! it gets a header that already has this white level. The caller divides by the true one.

use std::io::{Cursor, Read};

use image::codecs::pnm::{
    ArbitraryHeader, ArbitraryTuplType, GraymapHeader, PixmapHeader, PnmDecoder, PnmHeader,
};
use image::error::ImageResult;

/// Returns the decoder of the file that begins at `reader`, and the sample that means white; `None`
/// if the decoder's samples need no scaling: white is 255 or 65535, or the samples are bits.
pub fn decoder<R: Read>(reader: R) -> ImageResult<(PnmDecoder<impl Read>, Option<u16>)> {
    let (rest, header) = PnmDecoder::new(reader)?.into_inner();
    let white = header.maximal_sample();
    let full = if white > 255 { 65535 } else { 255 };
    let (header, white) = match with_white(&header, full) {
        Some(unscaled) if white != full => (unscaled, u16::try_from(white).ok()),
        _ => (header, None),
    };
    let mut start = Vec::new();
    header.write(&mut start)?;
    Ok((PnmDecoder::new(Cursor::new(start).chain(rest))?, white))
}

/// Returns the header with another white level; `None` if samples are bits.
fn with_white(header: &PnmHeader, white: u32) -> Option<PnmHeader> {
    use ArbitraryTuplType::{BlackAndWhite, BlackAndWhiteAlpha};
    if let Some(&grey) = header.as_graymap() {
        return Some(GraymapHeader { maxwhite: white, ..grey }.into());
    }
    if let Some(&colors) = header.as_pixmap() {
        return Some(PixmapHeader { maxval: white, ..colors }.into());
    }
    let any = header.as_arbitrary()?.clone();
    let bits = matches!(any.tupltype, Some(BlackAndWhite | BlackAndWhiteAlpha));
    (!bits).then(|| ArbitraryHeader { maxval: white, ..any }.into())
}
