//! Strings of attributes. The format leaves their encoding open; cryptomattes ask for UTF-8, and readers
//! expect it. The `exr` crate takes Latin-1.

use exr::meta::attribute::Text;

/// As it stands in the file.
pub fn encode(text: &str) -> Text {
    Text::from_slice_unchecked(text.as_bytes())
}

/// What the file says; Latin-1 where it is no UTF-8.
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
    fn what_is_written_is_read_and_latin_1_as_well() {
        for text in ["", "bunny", "Käse", "равнина", "日本 \u{1f407}"] {
            assert_eq!(encode(text).as_slice(), text.as_bytes());
            assert_eq!(decode(&encode(text)), text);
        }
        assert_eq!(decode(&Text::from_slice_unchecked(b"K\xe4se")), "Käse");
    }
}
