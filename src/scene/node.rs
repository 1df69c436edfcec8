//! A JSON value that remembers where it was written.

use std::sync::Arc;

use serde_json::Value;

/// Where a node was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// In the text.
    Text {
        /// 1-based.
        line: u32,
        /// 1-based, in characters.
        column: u32,
    },
    /// By `--set` at this JSON pointer.
    Set(Arc<str>),
    /// By code: there is no text.
    Code,
}

impl Place {
    /// Sorts problems by the place of their cause: the text first, then overrides.
    pub(super) fn order(&self) -> (u32, u32) {
        match self {
            Self::Text { line, column } => (*line, *column),
            Self::Set(_) | Self::Code => (u32::MAX, u32::MAX),
        }
    }
}

/// A JSON value and its place.
#[derive(Debug, Clone)]
pub struct Node {
    /// Where it starts.
    pub place: Place,
    /// What it is.
    pub kind: NodeKind,
}

/// A JSON value; numbers as they were written.
#[derive(Debug, Clone)]
pub enum NodeKind {
    /// `null`
    Null,
    /// `true` or `false`
    Bool(bool),
    /// The source text of a number.
    Number(String),
    /// A string, escapes resolved.
    Text(String),
    /// An array.
    List(Vec<Node>),
    /// An object, duplicate keys kept.
    Object(Vec<Member>),
}

/// One key of an object.
#[derive(Debug, Clone)]
pub struct Member {
    /// Of the key.
    pub place: Place,
    /// The key.
    pub key: String,
    /// Its value.
    pub value: Node,
}

impl Node {
    /// The value of `key`; the last one if it is there twice.
    pub fn member(&self, key: &str) -> Option<&Node> {
        match &self.kind {
            NodeKind::Object(members) => {
                let found = members.iter().rev().find(|m| m.key == key)?;
                Some(&found.value)
            }
            _ => None,
        }
    }

    /// One step of a JSON pointer, unescaped.
    pub(super) fn step(&self, token: &str) -> Option<&Node> {
        match &self.kind {
            NodeKind::List(items) => items.get(list_index(token)?),
            _ => self.member(token),
        }
    }

    /// A whole number, however it is written (`16`, `16.0`, `1.6e1`).
    pub fn integer(&self) -> Option<i128> {
        let NodeKind::Number(text) = &self.kind else {
            return None;
        };
        if let Ok(integer) = text.parse::<i128>() {
            return Some(integer);
        }
        let number = text.parse::<f64>().ok()?;
        // Beyond 2^53 a float no longer says which integer was meant.
        let exact = number.fract() == 0.0 && number.abs() <= 9_007_199_254_740_992.0;
        exact.then_some(number as i128)
    }

    /// The number, if it is one; infinite if it is beyond f64.
    pub fn number(&self) -> Option<f64> {
        match &self.kind {
            NodeKind::Number(text) => text.parse().ok(),
            _ => None,
        }
    }

    /// As a plain JSON value, without `comment` keys; of duplicate keys the last counts.
    /// Whole numbers become integers; a number beyond f64 becomes `null`.
    pub fn to_value(&self) -> Value {
        match &self.kind {
            NodeKind::Null => Value::Null,
            NodeKind::Bool(b) => Value::Bool(*b),
            NodeKind::Text(s) => Value::String(s.clone()),
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

    /// The node of a value made by code.
    pub(super) fn from_value(value: &Value) -> Self {
        let kind = match value {
            Value::Null => NodeKind::Null,
            Value::Bool(b) => NodeKind::Bool(*b),
            Value::Number(n) => NodeKind::Number(n.to_string()),
            Value::String(s) => NodeKind::Text(s.clone()),
            Value::Array(items) => NodeKind::List(items.iter().map(Self::from_value).collect()),
            Value::Object(map) => NodeKind::Object(
                map.iter()
                    .map(|(key, value)| Member {
                        place: Place::Code,
                        key: key.clone(),
                        value: Self::from_value(value),
                    })
                    .collect(),
            ),
        };
        Self { place: Place::Code, kind }
    }
}

/// An array index as RFC 6901 writes it: no sign, no leading zero.
pub(super) fn list_index(token: &str) -> Option<usize> {
    let plain =
        token.bytes().all(|b| b.is_ascii_digit()) && (token == "0" || !token.starts_with('0'));
    token.parse().ok().filter(|_| plain)
}
