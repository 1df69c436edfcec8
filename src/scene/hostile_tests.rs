//! Tests with bytes that are not a scene: they are refused, never with a panic, never slowly.

use std::cell::Cell;
use std::path::Path;

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
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

/// Pieces that a text gains or has in place of a character. Some are allowed only in strings, some
/// nowhere, some are white space for other formats.
const PIECES: [&str; 31] = [
    "{", "}", "[", "]", ",", ":", "\"", "\\", "\\u00e4", "\\ud83d", "'", "1", "-", "0", "00", ".",
    "e", "1e", "1e+", "+", "true", "nul", " ", "\n", "\u{a0}", "\t", "\u{b}", "\u{c}", "//", "ä",
    "\u{1}",
];

/// JSON values of all kinds. The numbers are so short that no edit gives one an exponent of three
/// digits, and no edit makes two keys equal.
fn values() -> impl Strategy<Value = Value> {
    let strings = "[a-z ä\u{1f600}\"\\\\\n]{0,4}";
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::Bool),
        (-99i64..99).prop_map(Value::from),
        (-39i32..39).prop_map(|quarters| Value::from(f64::from(quarters) / 4.0)),
        strings.prop_map(Value::String),
    ];
    leaf.prop_recursive(3, 12, 4, |inner| {
        let list = prop::collection::vec(inner, 0..4);
        let keys = (0..).map(|i| format!("ä{i}{i}{i}"));
        let object = move |list: Vec<Value>| keys.clone().zip(list).collect();
        prop_oneof![
            list.clone().prop_map(Value::Array),
            list.prop_map(move |list| Value::Object(object(list))),
        ]
    })
}

/// A text with one edit is accepted exactly if serde_json accepts it.
#[test]
fn as_strict_as_serde_json() {
    let edit = (any::<prop::sample::Index>(), 0..4, prop::sample::select(&PIECES[..]));
    let [cases, accepted, containers] = [(); 3].map(|()| Cell::new(0u32));
    let count = |counter: &Cell<u32>, is: bool| counter.set(counter.get() + u32::from(is));
    let texts = (values(), any::<[bool; 2]>(), edit);
    let mut runner = TestRunner::new(ProptestConfig::with_cases(256));
    let done = runner.run(&texts, |(value, [pretty, escaped], (at, kind, piece))| {
        let mut text = if pretty { format!("{value:#}") } else { value.to_string() };
        if escaped {
            text = text.replace('\u{1f600}', "\\ud83d\\ude00");
        }
        let at = at.index(text.chars().count());
        let (start, old) = text.char_indices().nth(at).expect("a character");
        match kind {
            0 => {}
            1 => text.insert_str(start, piece),
            2 => text.replace_range(start..start + old.len_utf8(), ""),
            _ => text.replace_range(start..start + old.len_utf8(), piece),
        }
        let ours = Document::parse("p", text.as_bytes()).is_ok();
        let theirs = serde_json::from_str::<Value>(&text).is_ok();
        count(&cases, true);
        count(&accepted, theirs);
        count(&containers, theirs && (value.is_array() || value.is_object()));
        prop_assert_eq!(ours, theirs, "{:?}", text);
        Ok(())
    });
    done.unwrap_or_else(|error| panic!("{error}"));
    let (refused, tenth) = (cases.get() - accepted.get(), cases.get() / 10);
    let counts = [accepted.get(), refused, containers.get()];
    assert!(counts.iter().all(|&count| count > tenth), "{counts:?}");
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = Document::parse("p", &bytes);
        let _ = load_bytes(&bytes);
    }

    /// Pieces of JSON in any order are accepted exactly if serde_json accepts them.
    #[test]
    fn pieces_in_any_order(pieces in prop::collection::vec(prop::sample::select(vec![
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
