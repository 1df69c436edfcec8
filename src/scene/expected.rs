//! Formats the values that messages mention: the value that was found, and the values that a schema
//! accepts.

use serde_json::Value;

use crate::nearest::list;

use super::node::{JsonNode, NodeKind};
use super::schema::{resolve, tag};

/// Maximum number of input characters that a message repeats.
const QUOTED_CHARS: usize = 60;

/// Describes a value for a message.
pub fn found(node: &JsonNode) -> String {
    match &node.kind {
        NodeKind::Null => "null".into(),
        NodeKind::Bool(b) => b.to_string(),
        NodeKind::Number(text) => cut(text),
        NodeKind::String(text) => quoted(text),
        NodeKind::List(items) => format!("an array of {}", items.len()),
        NodeKind::Object(_) => "an object".into(),
    }
}

/// Quotes a text for a message: shortened, control characters escaped.
pub fn quoted(text: &str) -> String {
    format!("{:?}", cut(text))
}

/// Shortens a text for a message.
pub fn cut(text: &str) -> String {
    match text.char_indices().nth(QUOTED_CHARS) {
        None => text.to_string(),
        Some((at, _)) => format!("{}...", &text[..at]),
    }
}

/// Returns the words of an enumeration, or `None` if the schema is no enumeration.
pub fn words(schema: &Value) -> Option<Vec<&str>> {
    if let Some(only) = schema["const"].as_str() {
        return Some(vec![only]);
    }
    let list = schema["enum"].as_array().or(schema["oneOf"].as_array())?;
    list.iter().map(|w| w.as_str().or(w["const"].as_str())).collect()
}

/// Describes the values that a schema accepts.
pub fn expected(root: &Value, schema: &Value) -> String {
    let schema = resolve(root, schema);
    if let Some(words) = words(schema) {
        return list(words);
    }
    let numbers = schema["enum"].as_array().into_iter().flatten().filter_map(Value::as_u64);
    let numbers: Vec<String> = numbers.map(|number| number.to_string()).collect();
    if !numbers.is_empty() {
        return numbers.join(" or ");
    }
    let branches = schema["oneOf"].as_array().or(schema["anyOf"].as_array());
    let kind = match (schema["type"].as_str(), branches) {
        (Some(kind), _) => kind,
        (None, Some(branches)) if branches.iter().any(|b| tag(b).is_some()) => "object",
        (None, Some(branches)) => {
            let all: Vec<String> = branches.iter().map(|b| expected(root, b)).collect();
            return all.join(" or ");
        }
        (None, None) => "",
    };
    match kind {
        "object" => "an object".into(),
        "array" => array(root, schema),
        "string" => "a string".into(),
        "boolean" => "true or false".into(),
        "integer" if schema["multipleOf"] == 2 => format!("an even integer{}", range(schema)),
        "integer" => format!("an integer{}", range(schema)),
        "number" => format!("a number{}", range(schema)),
        _ => "a value".into(),
    }
}

fn array(root: &Value, schema: &Value) -> String {
    let items = resolve(root, &schema["items"]);
    let what = match items["type"].as_str() {
        Some("number") => "numbers",
        Some("integer") => "integers",
        Some("string") => "strings",
        Some("array") => "arrays",
        // A union, such as a path or an object with a path.
        None if items["anyOf"].is_array() => "values",
        _ => "objects",
    };
    match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
        (Some(min), Some(max)) if min == max => format!("an array of {min} {what}"),
        (Some(1..), _) => format!("an array of {what}, at least one"),
        _ => format!("an array of {what}"),
    }
}

fn range(schema: &Value) -> String {
    let bound = |key: &str| schema.get(key).map(show);
    let low = bound("exclusiveMinimum").map(|b| ('(', b));
    let low = low.or(bound("minimum").map(|b| ('[', b)));
    let high = bound("exclusiveMaximum").map(|b| (')', b));
    let high = high.or(bound("maximum").map(|b| (']', b)));
    match (low, high) {
        (Some((open, low)), Some((close, high))) => format!(" in {open}{low}, {high}{close}"),
        (Some((open, low)), None) => format!(" {} {low}", if open == '(' { ">" } else { ">=" }),
        (None, Some((close, high))) => format!(" {} {high}", if close == ')' { "<" } else { "<=" }),
        (None, None) => String::new(),
    }
}

fn show(bound: &Value) -> String {
    match bound.as_f64() {
        Some(f) if bound.is_f64() && (f.abs() >= 1e6 || (f != 0.0 && f.abs() < 1e-3)) => {
            format!("{f:e}")
        }
        Some(f) if bound.is_f64() => f.to_string(),
        _ => bound.to_string(),
    }
}
