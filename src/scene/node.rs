//! A JSON value that stores its place in the text.

use std::sync::Arc;

use serde_json::Value;

/// The place where a node was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JsonPlace {
    /// A position in the text.
    Text {
        /// Line number, from 1.
        line: u32,
        /// Column in characters, from 1.
        column: u32,
    },
    /// An override: `--set` with this JSON pointer.
    Set(Arc<str>),
    /// No place in a text: code made the value.
    Code,
}

impl JsonPlace {
    /// Returns the sort key for errors and warnings: places in the text first, then all others.
    pub(super) fn order(&self) -> (u32, u32) {
        match self {
            Self::Text { line, column } => (*line, *column),
            Self::Set(_) | Self::Code => (u32::MAX, u32::MAX),
        }
    }
}

/// A JSON value and its place.
#[derive(Debug, Clone)]
pub struct JsonNode {
    /// Where the value starts in the text, or its override.
    pub place: JsonPlace,
    /// The type and the value.
    pub kind: NodeKind,
}

/// A JSON value. Numbers are stored as written.
#[derive(Debug, Clone)]
pub enum NodeKind {
    /// The value `null`.
    Null,
    /// The value `true` or `false`.
    Bool(bool),
    /// The source text of a number.
    Number(String),
    /// A string with escapes resolved.
    String(String),
    /// An array of values.
    List(Vec<JsonNode>),
    /// An object in file order. Duplicate keys are kept.
    Object(Vec<Member>),
}

/// A key of an object and its value.
#[derive(Debug, Clone)]
pub struct Member {
    /// Where the key starts.
    pub place: JsonPlace,
    /// The key with escapes resolved.
    pub key: String,
    /// The value of this key.
    pub value: JsonNode,
}

impl JsonNode {
    /// Returns the value of `key`. If the key is duplicated, the last one counts.
    pub fn member(&self, key: &str) -> Option<&JsonNode> {
        match &self.kind {
            NodeKind::Object(members) => {
                let found = members.iter().rev().find(|m| m.key == key)?;
                Some(&found.value)
            }
            _ => None,
        }
    }

    /// [`JsonNode::member`], to be changed.
    pub(super) fn member_mut(&mut self, key: &str) -> Option<&mut JsonNode> {
        match &mut self.kind {
            NodeKind::Object(members) => {
                let found = members.iter_mut().rev().find(|m| m.key == key)?;
                Some(&mut found.value)
            }
            _ => None,
        }
    }

    /// Returns the string that the node holds; `None` for other values.
    pub fn text(&self) -> Option<&str> {
        match &self.kind {
            NodeKind::String(text) => Some(text),
            _ => None,
        }
    }

    /// Follows one unescaped step of a JSON pointer.
    pub(super) fn step(&self, token: &str) -> Option<&JsonNode> {
        match &self.kind {
            NodeKind::List(items) => items.get(list_index(token)?),
            _ => self.member(token),
        }
    }

    /// Returns the value of a whole number in any notation (`16`, `16.0`, `1.6e1`). `None` for
    /// other values, and beyond 2^53 if the notation is not that of an integer.
    pub fn integer(&self) -> Option<i128> {
        let NodeKind::Number(text) = &self.kind else {
            return None;
        };
        if let Ok(integer) = text.parse::<i128>() {
            return Some(integer);
        }
        let number = text.parse::<f64>().ok()?;
        // Beyond 2^53, f64 does not hold every integer: the text may have been rounded.
        let exact = number.fract() == 0.0 && number.abs() <= 9_007_199_254_740_992.0;
        exact.then_some(number as i128)
    }

    /// Returns the value of a number: infinite if it is beyond f64, `None` if it is not a number.
    pub fn number(&self) -> Option<f64> {
        match &self.kind {
            NodeKind::Number(text) => text.parse().ok(),
            _ => None,
        }
    }

    /// Converts to a plain JSON value. Keys called `comment` are dropped: any object may have one.
    /// The last of duplicate keys counts. Whole numbers within i64 become integers, other numbers
    /// floats. A number beyond f64 becomes `null`.
    pub fn to_value(&self) -> Value {
        match &self.kind {
            NodeKind::Null => Value::Null,
            NodeKind::Bool(b) => Value::Bool(*b),
            NodeKind::String(s) => Value::String(s.clone()),
            NodeKind::List(items) => items.iter().map(Self::to_value).collect(),
            NodeKind::Object(members) => members
                .iter()
                .filter(|m| m.key != "comment")
                .map(|m| (m.key.clone(), m.value.to_value()))
                .collect(),
            NodeKind::Number(_) => {
                let integer = self.integer();
                if let Some(n) = integer.and_then(|i| i64::try_from(i).ok()) {
                    return n.into();
                }
                self.number().unwrap_or(f64::NAN).into()
            }
        }
    }

    /// Makes a node from a value made by code.
    pub(super) fn from_value(value: &Value) -> Self {
        let kind = match value {
            Value::Null => NodeKind::Null,
            Value::Bool(b) => NodeKind::Bool(*b),
            Value::Number(n) => NodeKind::Number(n.to_string()),
            Value::String(s) => NodeKind::String(s.clone()),
            Value::Array(items) => NodeKind::List(items.iter().map(Self::from_value).collect()),
            Value::Object(map) => NodeKind::Object(
                map.iter()
                    .map(|(key, value)| Member {
                        place: JsonPlace::Code,
                        key: key.clone(),
                        value: Self::from_value(value),
                    })
                    .collect(),
            ),
        };
        Self { place: JsonPlace::Code, kind }
    }
}

/// Parses an array index as RFC 6901 requires: no sign, no leading zero.
pub(super) fn list_index(token: &str) -> Option<usize> {
    let plain =
        token.bytes().all(|b| b.is_ascii_digit()) && (token == "0" || !token.starts_with('0'));
    token.parse().ok().filter(|_| plain)
}
