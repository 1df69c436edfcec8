//! Encodes and decodes the text of attributes, as UTF-8. The format does not define an encoding.
//! Cryptomattes require UTF-8, and their readers expect it. The `exr` crate's own conversions use
//! Latin-1.

use exr::meta::attribute::Text;

/// Encodes a text for the file, as UTF-8.
pub fn encode(text: &str) -> Text {
    // Unchecked: the other constructors replace or refuse what is not Latin-1.
    Text::from_slice_unchecked(text.as_bytes())
}

/// Decodes a text of the file: as UTF-8, or, as the crate does, as Latin-1 if it is not valid
/// UTF-8.
pub fn decode(text: &Text) -> String {
    match std::str::from_utf8(text.as_slice()) {
        Ok(utf8) => utf8.to_string(),
        Err(_) => text.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utf_8_round_trips_and_latin_1_is_decoded() {
        for text in ["", "bunny", "Käse", "равнина", "日本 \u{1f407}"] {
            assert_eq!(encode(text).as_slice(), text.as_bytes());
            assert_eq!(decode(&encode(text)), text);
        }
        assert_eq!(decode(&Text::from_slice_unchecked(b"K\xe4se")), "Käse");
    }
}
