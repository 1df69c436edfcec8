//! Tests with bytes that are not a scene: they are refused, never with a panic, never slowly.

use std::path::Path;

use proptest::prelude::*;
use serde_json::Value;

use super::tests::{everything, load_value, the_rest};
use super::*;
use crate::error::Result;

/// Loads a text with a folder that does not exist.
fn load_bytes(bytes: &[u8]) -> Result<Loaded> {
    let source = Source::Text { name: "p", text: bytes, folder: Path::new("/nonexistent") };
    load(source, &[])
}

#[test]
fn one_long_line_is_parsed_in_linear_time() {
    let list = format!("[{}0]", "[0,1,2],\"\\u00e4\",".repeat(100_000));
    let start = std::time::Instant::now();
    assert!(Document::parse("s", list.as_bytes()).is_ok());
    assert!(start.elapsed().as_secs() < 5);
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Document::parse("p", &bytes);
        let _ = load_bytes(&bytes);
    }

    /// Pieces of JSON in any order are accepted exactly if serde_json accepts them.
    #[test]
    fn as_strict_as_serde_json(pieces in prop::collection::vec(prop::sample::select(vec![
        "{", "}", "[", "]", ",", ":", "\"a\"", "\"\\u00e4\\ud83d\\ude00\"", "\"\\n\"", "\"", "\\", "'", "1", "-0",
        "0", "1.5", "1e5", "-", ".", "e", "+", "true", "null", "nul", " ", "\n", "\u{a0}", "\t", "//", "ä", "\u{1}",
    ]), 0..12)) {
        let text = pieces.concat();
        let ours = Document::parse("p", text.as_bytes()).is_ok();
        let theirs = serde_json::from_str::<Value>(&text).is_ok();
        prop_assert_eq!(ours, theirs, "{:?}", text);
    }

    /// A scene with one changed byte, or cut at any byte, never causes a panic.
    #[test]
    fn damaged_scenes_never_panic(
        which in 0usize..5, at in 0usize..3000, byte in any::<u8>(), cut in any::<bool>(),
    ) {
        let scene = the_rest().into_iter().nth(which).unwrap_or_else(everything);
        let mut text = scene.to_string().into_bytes();
        let at = at % text.len();
        if cut { text.truncate(at) } else { text[at] = byte }
        let _ = load_bytes(&text);
    }

    #[test]
    fn any_override_never_panics(pointer in "(/(camera|scene|shapes|fov|0|-|~1|x)){0,5}", value in "\\PC{0,8}") {
        let _ = load_value(&everything(), &[&format!("{pointer}={value}")]);
    }
}
