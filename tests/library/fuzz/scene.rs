//! Reads bytes as a scene file. The result must be an error with a message, or a scene that can be
//! written and read again unchanged. Files that the scene names may be looked up, but are not read.

use std::path::Path;

use lightpath::scene::{Source, load};

use super::inputs;

/// Runs one input, whose paths are relative to a folder. Returns whether it is a scene.
pub fn run(folder: &Path, text: &[u8]) -> bool {
    let source = Source::Text { name: "f.json", text, folder };
    match load(source, &[]) {
        Err(error) => {
            inputs::check_error(&error);
            false
        }
        Ok(loaded) => {
            let text = loaded.description.to_text();
            let again = load(Source::Text { name: "g.json", text: text.as_bytes(), folder }, &[]);
            let again = again.unwrap_or_else(|error| panic!("{error}\n{text}"));
            assert_eq!(again.description.to_text(), text);
            assert_eq!(again.hash, loaded.hash);
            true
        }
    }
}
