//! Attributes of a part of an EXR file as text, by the names that they have in the file.

use exr::meta::attribute::{
    AttributeValue, Chromaticities, EnvironmentMap, IntegerBounds, Text, TimeCode,
};
use exr::meta::header::Header;

use crate::output::exr::text::decode;

/// Returns the name and the text of each attribute, those of the standard first. Windows, channels,
/// compression and the order of lines are left out.
pub fn attributes(header: &Header) -> Vec<(String, String)> {
    let own = &header.own_attributes;
    let shared = &header.shared_attributes;
    let texts = [
        ("software", &own.software_name),
        ("owner", &own.owner),
        ("comments", &own.comments),
        ("capDate", &own.capture_date),
        ("renderingTransform", &own.rendering_transform_name),
        ("lookModTransform", &own.look_modification_transform_name),
        ("wrapmodes", &own.wrap_mode_name),
        ("view", &own.view_name),
    ];
    let texts = texts.map(|(name, text)| (name, text.as_ref().map(decode)));
    let center = own.screen_window_center;
    let always = [
        ("pixelAspectRatio", vec![shared.pixel_aspect]),
        ("screenWindowCenter", vec![center.x(), center.y()]),
        ("screenWindowWidth", vec![own.screen_window_width]),
    ];
    let always = always.map(|(name, values)| (name, Some(numbers(&values))));
    let floats = [
        ("whiteLuminance", own.white_luminance),
        ("xDensity", own.horizontal_density),
        ("utcOffset", own.utc_offset),
        ("longitude", own.longitude),
        ("latitude", own.latitude),
        ("altitude", own.altitude),
        ("focus", own.focus),
        ("expTime", own.exposure),
        ("aperture", own.aperture),
        ("isoSpeed", own.iso_speed),
        ("near", own.near_clip_plane),
        ("far", own.far_clip_plane),
        ("fieldOfViewHorizontal", own.horizontal_field_of_view),
        ("fieldOfViewVertical", own.vertical_field_of_view),
    ];
    let floats = floats.map(|(name, value)| (name, value.map(|value| value.to_string())));
    let others = [
        ("adoptedNeutral", own.adopted_neutral.map(|v| numbers(&[v.x(), v.y()]))),
        ("worldToCamera", own.world_to_camera.map(|m| numbers(&m))),
        ("worldToNDC", own.world_to_normalized_device.map(|m| numbers(&m))),
        ("framesPerSecond", own.frames_per_second.map(rational)),
        ("timeCode", shared.time_code.map(time_code)),
        ("keyCode", own.film_key_code.map(|code| text(&AttributeValue::KeyCode(code)))),
        ("envmap", own.environment_map.map(environment)),
        ("multiView", own.multi_view_names.as_deref().map(list)),
        ("deepImageState", own.deep_image_state.map(rational)),
        ("originalDataWindow", own.original_data_window.map(window)),
        ("preview", own.preview.as_ref().map(|p| format!("{} x {}", p.size.x(), p.size.y()))),
    ];
    let standard =
        texts.into_iter().chain([("chromaticities", shared.chromaticities.map(chromaticities))]);
    let standard = standard.chain(always).chain(floats).chain(others);
    let standard = standard.filter_map(|(name, text)| Some((name.to_string(), text?)));
    let own = own.other.iter().chain(&shared.other);
    let mut own: Vec<_> = own.map(|(name, value)| (name.to_string(), text(value))).collect();
    own.sort();
    standard.chain(own).collect()
}

/// Returns the text of a value of any type: numbers with spaces between them.
fn text(value: &AttributeValue) -> String {
    match value {
        AttributeValue::Text(text) => decode(text),
        AttributeValue::TextVector(texts) => list(texts),
        AttributeValue::I32(number) => number.to_string(),
        AttributeValue::F32(number) => number.to_string(),
        AttributeValue::F64(number) => number.to_string(),
        AttributeValue::Rational(ratio) => rational(*ratio),
        AttributeValue::IntVec2(v) => format!("{} {}", v.x(), v.y()),
        AttributeValue::FloatVec2(v) => numbers(&[v.x(), v.y()]),
        AttributeValue::IntVec3((x, y, z)) => format!("{x} {y} {z}"),
        AttributeValue::FloatVec3((x, y, z)) => numbers(&[*x, *y, *z]),
        AttributeValue::Matrix3x3(matrix) => numbers(matrix),
        AttributeValue::Matrix4x4(matrix) => numbers(matrix),
        AttributeValue::IntegerBounds(bounds) => window(*bounds),
        AttributeValue::FloatRect(rect) => {
            numbers(&[rect.min.x(), rect.min.y(), rect.max.x(), rect.max.y()])
        }
        AttributeValue::TimeCode(code) => time_code(*code),
        AttributeValue::Chromaticities(colors) => chromaticities(*colors),
        AttributeValue::EnvironmentMap(map) => environment(*map),
        AttributeValue::KeyCode(code) => {
            let numbers = [
                code.film_manufacturer_code,
                code.film_type,
                code.film_roll_prefix,
                code.count,
                code.perforation_offset,
                code.perforations_per_frame,
                code.perforations_per_count,
            ];
            numbers.map(|number| number.to_string()).join(" ")
        }
        AttributeValue::Bytes { type_hint: kind, bytes }
        | AttributeValue::Custom { kind, bytes } => {
            format!("{} bytes of type {}", bytes.len(), decode(kind))
        }
        other => format!("{other:?}"),
    }
}

fn numbers(values: &[f32]) -> String {
    values.iter().map(f32::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns x and y of red, green, blue and white.
fn chromaticities(colors: Chromaticities) -> String {
    let Chromaticities { red, green, blue, white } = colors;
    numbers([red, green, blue, white].map(|c| [c.x(), c.y()]).as_flattened())
}

fn list(texts: &[Text]) -> String {
    texts.iter().map(decode).collect::<Vec<_>>().join(" ")
}

fn rational((above, below): (i32, u32)) -> String {
    format!("{above}/{below}")
}

/// Returns corner and size, as those of the data window.
fn window(bounds: IntegerBounds) -> String {
    let (corner, size) = (bounds.position, bounds.size);
    format!("{} {} {} {}", corner.x(), corner.y(), size.x(), size.y())
}

fn environment(map: EnvironmentMap) -> String {
    let name = match map {
        EnvironmentMap::LatitudeLongitude => "latlong",
        EnvironmentMap::Cube => "cube",
    };
    name.to_string()
}

/// Returns a time code as SMPTE 12M writes it: with a semicolon before dropped frames.
fn time_code(code: TimeCode) -> String {
    let TimeCode { hours, minutes, seconds, frame, drop_frame, .. } = code;
    let mark = if drop_frame { ';' } else { ':' };
    format!("{hours:02}:{minutes:02}:{seconds:02}{mark}{frame:02}")
}

#[cfg(test)]
mod tests {
    use exr::prelude::*;

    use super::*;

    #[test]
    fn standard_and_own_attributes_are_listed_by_name() {
        let channels = SmallVec::from_vec(vec![ChannelDescription::named("Y", SampleType::F16)]);
        let mut header = Header::new("x".into(), (2, 2), channels);
        let own = &mut header.own_attributes;
        own.owner = Some("a studio".into());
        own.exposure = Some(0.25);
        own.view_name = Some("left".into());
        own.multi_view_names = Some(vec!["left".into(), "right".into()]);
        own.environment_map = Some(EnvironmentMap::Cube);
        own.frames_per_second = Some((24, 1));
        own.other.insert("pair".into(), AttributeValue::FloatVec2(Vec2(1.0, 2.5)));
        own.other.insert("large".into(), AttributeValue::F64(2.5));
        let drop_frame = TimeCode {
            hours: 1,
            minutes: 2,
            seconds: 3,
            frame: 4,
            drop_frame: true,
            color_frame: false,
            field_phase: false,
            binary_group_flags: [false; 3],
            binary_groups: [0; 8],
        };
        let shared = &mut header.shared_attributes;
        shared.time_code = Some(drop_frame);
        shared.other.insert("camera".into(), AttributeValue::TimeCode(drop_frame));
        let found = attributes(&header);
        let expected = [
            ("owner", "a studio"),
            ("view", "left"),
            ("pixelAspectRatio", "1"),
            ("screenWindowCenter", "0 0"),
            ("screenWindowWidth", "1"),
            ("expTime", "0.25"),
            ("framesPerSecond", "24/1"),
            ("timeCode", "01:02:03;04"),
            ("envmap", "cube"),
            ("multiView", "left right"),
            ("camera", "01:02:03;04"),
            ("large", "2.5"),
            ("pair", "1 2.5"),
        ];
        let expected = expected.map(|(name, text)| (name.to_string(), text.to_string()));
        assert_eq!(found, expected);
    }
}
