//! Makes the header of a part for the `exr` crate.

use exr::compression::Compression as Method;
use exr::math::Vec2;
use exr::meta::BlockDescription;
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, Chromaticities, IntegerBounds, LineOrder, SampleType, Text,
};
use exr::meta::header::{Header, ImageAttributes, LayerAttributes};

use crate::film::{ChannelKind, Film};

use super::options::{Compression, Options};
use super::parts::{ExrPart, FIRST};
use super::text;

/// Primaries and white point D65 of Rec. ITU-R BT.709, with the values of OpenEXR's default.
const BT709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Returns the header of a part, or `None` if the format cannot hold it. Every part has the
/// metadata of the picture, because a reader may look at any part.
pub fn header(film: &Film, options: &Options, part: &ExrPart) -> Option<Header> {
    let window = film.window;
    let [left, top] = film.origin();
    let size = Vec2(window.width() as usize, window.height() as usize);
    let frame = film.frame.map(|side| i32::try_from(side).ok());
    let frame = Vec2(frame[0]? as usize, frame[1]? as usize);
    let mut own = LayerAttributes {
        layer_name: if options.multipart { Some(Text::new_or_none(part.name)?) } else { None },
        software_name: Text::new_or_none(format!("lightpath {}", env!("CARGO_PKG_VERSION"))),
        layer_position: Vec2(left, top),
        frames_per_second: options.sequence.per_second,
        ..LayerAttributes::default()
    };
    if let Some(view) = options.view {
        own.world_to_camera = Some(view.world_to_camera);
        own.world_to_normalized_device = view.world_to_ndc;
        own.screen_window_width = view.screen_window_width;
        let [x, y] = view.screen_window_center;
        own.screen_window_center = Vec2(x, y);
    }
    let selected = options.attributes.iter().filter(|(name, _)| belongs_to(name, part, options));
    for (name, value) in selected {
        let name = Text::new_or_none(name)?;
        own.other.insert(name, AttributeValue::Text(text::encode(value)));
    }
    if let Some(frame) = options.sequence.frame {
        own.other.insert(Text::from("imageCounter"), AttributeValue::I32(frame));
    }
    if let Some(seconds) = options.render_seconds {
        own.other.insert(Text::from("renderTimeSeconds"), AttributeValue::F32(seconds));
    }
    let channels = part.sources.iter().map(|source| {
        let kind = match source.kind {
            ChannelKind::Half => SampleType::F16,
            ChannelKind::Float => SampleType::F32,
            ChannelKind::Uint => SampleType::U32,
        };
        Some(ChannelDescription::new(Text::new_or_none(source.name)?, kind, false))
    });
    let channels: Option<_> = channels.collect();
    let shared = ImageAttributes {
        chromaticities: Some(BT709),
        pixel_aspect: options.view.map_or(1.0, |view| view.pixel_aspect),
        ..ImageAttributes::new(IntegerBounds::from_dimensions(frame))
    };
    let method = match options.compression {
        Compression::Zip => Method::ZIP16,
        Compression::Zips => Method::ZIP1,
        Compression::Piz => Method::PIZ,
        Compression::Rle => Method::RLE,
        Compression::None => Method::Uncompressed,
        Compression::Dwaa => Method::DWAA(None),
    };
    let header = Header::new(Text::from(""), size, channels?)
        .with_encoding(method, BlockDescription::ScanLines, LineOrder::Increasing)
        .with_attributes(own)
        .with_shared_attributes(shared);
    Some(header)
}

/// Returns true if a part has the attribute `name`. The attributes of a cryptomatte are in the part
/// with its channels, for readers of single parts. They are also in the first part, because some
/// readers look only there. They are in no other part, because a manifest can be long.
fn belongs_to(name: &str, part: &ExrPart, options: &Options) -> bool {
    let matte = name.strip_prefix("cryptomatte/").and_then(|rest| rest.split_once('/'));
    let Some((key, _)) = matte.filter(|_| part.name != FIRST) else { return true };
    let kind = format!("cryptomatte/{key}/name");
    options.attributes.iter().any(|(name, value)| *name == kind && value == part.name)
}
