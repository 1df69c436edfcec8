//! The EXR: linear BT.709 radiance as compositors expect it.
//!
//! Single part, scanlines, ZIP, unnamed half `R G B A` premultiplied, display window = the whole
//! frame, data window = what was rendered. The same film and attributes give the same bytes: the
//! encoding is stated (the `exr` crate's default order depends on threads) and the header's
//! attributes are sorted afterwards (the crate keeps them in a hash map). The crate's own thread
//! pool is not used; ZIP gains nothing from it.

use std::{
    io::{BufWriter, Read, Seek, SeekFrom, Write},
    path::Path,
};

use exr::{
    error::Error as ExrError,
    image::{Encoding, Image, Layer, SpecificChannels, write::WritableImage},
    math::Vec2,
    meta::{
        attribute::{AttributeValue, Chromaticities, IntegerBounds, LineOrder, Text},
        header::LayerAttributes,
    },
};
use half::f16;

use crate::{
    error::{Error, Kind, Problem, Result},
    film::Film,
};

use super::{HALF_MAX, exr_header, finite};

/// Rec. ITU-R BT.709 primaries and D65, as OpenEXR's own default states them.
const BT709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Writes the film at the start of an empty `file`. `attributes` are custom strings; `path` is for
/// messages. NaN and infinities are never written ([`super::Oddities`] counts them).
///
/// # Errors
/// `Retry` where the disk is full; `Limit` for more than 2^31 pixels a side or attributes that the
/// format cannot hold.
pub fn write<F: Read + Write + Seek>(
    film: &Film,
    attributes: &[(String, String)],
    file: &mut F,
    path: &Path,
) -> Result<()> {
    let image =
        image(film, attributes).ok_or_else(|| unwritable(path, "its size or attributes"))?;
    let mut buffered = BufWriter::new(&mut *file);
    let written = image.write().non_parallel().to_buffered(&mut buffered);
    written.map_err(|error| exr_error(path, error))?;
    // Dropping a BufWriter would hide a full disk.
    let flushed = buffered.flush();
    drop(buffered);
    flushed.and_then(|()| sort_header(file)).map_err(|error| Error::io(path, "write", &error))
}

type Pixels<'a> = Box<dyn Fn(Vec2<usize>) -> (f16, f16, f16, f16) + Sync + 'a>;
type Rgba = (
    exr::meta::attribute::ChannelDescription,
    exr::meta::attribute::ChannelDescription,
    exr::meta::attribute::ChannelDescription,
    exr::meta::attribute::ChannelDescription,
);

/// The image in the crate's terms; `None` where the format cannot hold it.
fn image<'a>(
    film: &'a Film,
    attributes: &[(String, String)],
) -> Option<Image<Layer<SpecificChannels<Pixels<'a>, Rgba>>>> {
    let window = film.window;
    let size = Vec2(window.width() as usize, window.height() as usize);
    let frame = film.frame.map(|side| i32::try_from(side).ok());
    let frame = Vec2(frame[0]? as usize, frame[1]? as usize);
    let mut own = LayerAttributes {
        software_name: Text::new_or_none(format!("lightpath {}", env!("CARGO_PKG_VERSION"))),
        layer_position: Vec2(i32::try_from(window.x0).ok()?, i32::try_from(window.y0).ok()?),
        ..LayerAttributes::default()
    };
    for (name, value) in attributes {
        let name = Text::new_or_none(name)?;
        own.other.insert(name, AttributeValue::Text(Text::new_or_none(value)?));
    }
    let encoding = Encoding {
        compression: exr::compression::Compression::ZIP16,
        blocks: exr::image::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let pixels: Pixels = Box::new(move |Vec2(x, y)| {
        let [r, g, b, a] = film.pixels[y * size.0 + x].map(to_half);
        (r, g, b, a)
    });
    let layer = Layer::new(size, own, encoding, SpecificChannels::rgba(pixels));
    let mut image = Image::from_layer(layer);
    image.attributes.display_window = IntegerBounds::from_dimensions(frame);
    image.attributes.chromaticities = Some(BT709);
    Some(image)
}

/// The nearest half; finite for every input.
fn to_half(value: f32) -> f16 {
    f16::from_f32(finite(value).clamp(-HALF_MAX, HALF_MAX))
}

/// Sorts the attributes of the header in place; its length and the offsets behind it stay.
fn sort_header<F: Read + Write + Seek>(file: &mut F) -> std::io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    let header = exr_header::read_sorted(file)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(&header)?;
    file.seek(SeekFrom::End(0))?;
    file.flush()
}

fn unwritable(path: &Path, what: &str) -> Error {
    let message = format!("cannot write: {what} do not fit into an EXR file");
    Error::new(Kind::Limit, Problem::new(path.display().to_string(), message))
}

fn exr_error(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(error) => Error::io(path, "write", &error),
        other => unwritable(path, &other.to_string()),
    }
}
