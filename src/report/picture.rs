//! Pictures embedded in a page.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::svg::escape;

/// Returns HTML of a PNG file with a caption, embedded as base64, 192 CSS pixels wide.
pub fn picture(png: &[u8], caption: &str) -> String {
    picture_of_width(png, caption, 192)
}

/// As [`picture()`], `width` CSS pixels wide. Enlarged pixels stay squares.
pub fn picture_of_width(png: &[u8], caption: &str, width: u32) -> String {
    let (data, caption) = (STANDARD.encode(png), escape(caption));
    format!(
        "<figure style=\"width:{width}px\"><img width=\"{width}\" alt=\"{caption}\" \
         src=\"data:image/png;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_embedded_and_its_caption_is_escaped() {
        let html = picture(&[1, 2, 3], "a<b");
        assert!(html.contains("data:image/png;base64,AQID\"") && html.contains("a&lt;b"));
        assert!(!html.contains("a<b"));
    }
}
