//! Writes a [`SceneDescription`] as JSON that is easy to read: no defaults, vectors on one line.

use std::io::BufWriter;

use serde_json::Value;
use sha2::{Digest, Sha256};

use super::description::{CameraDescription, SceneDescription};
use super::schema::{of_camera, schema, without_defaults};

impl SceneDescription {
    /// Returns the SHA-256 (hexadecimal) of the canonical JSON.
    pub fn hash(&self) -> String {
        format!("{:x}", self.digest().finalize())
    }

    /// [`SceneDescription::hash`] before its end, so that more can follow.
    pub(crate) fn digest(&self) -> Sha256 {
        let mut all = BufWriter::with_capacity(1 << 16, Sha256::new());
        // A hash takes all bytes, and all keys are strings.
        let _ = serde_json::to_writer(&mut all, &self.to_json());
        all.into_inner().unwrap_or_default()
    }

    /// Returns the canonical JSON. Values that equal their default are omitted, whole numbers are
    /// integers.
    pub fn to_json(&self) -> Value {
        // This cannot fail, because all keys are strings. NaN becomes null, which is refused on
        // reading.
        let mut value = serde_json::to_value(self).unwrap_or_default();
        let schema = schema();
        without_defaults(schema, schema, &mut value);
        value
    }

    /// Returns the text of a scene file.
    pub fn to_text(&self) -> String {
        let mut text = String::new();
        write(&self.to_json(), 0, &mut text);
        text.push('\n');
        text
    }
}

/// Returns an object with a camera in the key `camera`, without values that equal their default.
pub(super) fn camera(camera: &CameraDescription) -> Value {
    let mut value = serde_json::json!({ "camera": camera });
    without_defaults(of_camera(), of_camera(), &mut value);
    value
}

fn write(value: &Value, depth: usize, text: &mut String) {
    let scalar = |v: &Value| !v.is_array() && !v.is_object();
    let end = format!("\n{}", "  ".repeat(depth));
    match value {
        Value::Array(items) if items.iter().all(scalar) => {
            let items: Vec<String> = items.iter().map(Value::to_string).collect();
            text.push_str(&format!("[{}]", items.join(", ")));
        }
        Value::Array(items) => {
            text.push('[');
            for (i, item) in items.iter().enumerate() {
                text.push_str(if i == 0 { "" } else { "," });
                text.push_str(&format!("{end}  "));
                write(item, depth + 1, text);
            }
            text.push_str(&format!("{end}]"));
        }
        Value::Object(map) if map.is_empty() => text.push_str("{}"),
        Value::Object(map) => {
            text.push('{');
            for (i, (key, member)) in map.iter().enumerate() {
                text.push_str(if i == 0 { "" } else { "," });
                text.push_str(&format!("{end}  {}: ", Value::from(key.as_str())));
                write(member, depth + 1, text);
            }
            text.push_str(&format!("{end}}}"));
        }
        scalar => text.push_str(&scalar.to_string()),
    }
}
