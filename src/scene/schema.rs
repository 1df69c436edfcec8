//! The JSON Schema of scene files, generated from [`SceneDescription`].
//!
//! The types are the only table of keys. This module adapts the generated schema for editors and
//! for the structural checks. Every object is closed (no unknown keys), except for `comment` and
//! the top-level `$schema`. Optional keys exclude `null`, and tagged variants are written out.

use std::sync::LazyLock;

use schemars::JsonSchema;
use serde_json::{Map, Value, json};

use super::description::{CameraDescription, SceneDescription};

/// Returns the JSON Schema 2020-12 of scene files.
pub fn schema() -> &'static Value {
    // Cached, because one run may check thousands of frames.
    static SCHEMA: LazyLock<Value> =
        LazyLock::new(|| schema_of::<SceneDescription>("lightpath scene"));
    &SCHEMA
}

/// An object with a camera.
#[derive(JsonSchema)]
pub(super) struct WithCamera {
    /// The camera.
    #[allow(dead_code)] // only its schema is used
    camera: CameraDescription,
}

/// Returns the schema of an object that holds a camera only.
pub(super) fn of_camera() -> &'static Value {
    static SCHEMA: LazyLock<Value> = LazyLock::new(|| schema_of::<WithCamera>(""));
    &SCHEMA
}

/// Returns the JSON Schema 2020-12 of a file that is read as `T`. Job files use it too.
pub fn schema_of<T: JsonSchema>(title: &str) -> Value {
    let generated = schemars::generate::SchemaSettings::draft2020_12()
        .into_generator()
        .into_root_schema_for::<T>();
    let mut schema = Value::from(generated);
    let definitions = schema["$defs"].clone();
    tidy(&mut schema, &definitions);
    schema["properties"]["$schema"] =
        json!({ "type": "string", "description": "Ignored: where an editor finds this schema." });
    schema["title"] = json!(title);
    schema
}

fn tidy(schema: &mut Value, definitions: &Value) {
    let Some(map) = schema.as_object_mut() else {
        return;
    };
    inline_variant(map, definitions);
    drop_null(map);
    map.remove("format");
    // Doc comments contain line breaks. Editors wrap the text themselves.
    if let Some(Value::String(text)) = map.get_mut("description") {
        *text = text.replace('\n', " ");
    }
    for key in ["properties", "$defs"] {
        let members = map.get_mut(key).and_then(Value::as_object_mut);
        members.into_iter().flat_map(Map::values_mut).for_each(|s| tidy(s, definitions));
    }
    for key in ["items", "additionalProperties"] {
        map.get_mut(key).into_iter().for_each(|s| tidy(s, definitions));
    }
    for key in ["oneOf", "anyOf"] {
        let branches = map.get_mut(key).and_then(Value::as_array_mut);
        branches.into_iter().flatten().for_each(|s| tidy(s, definitions));
    }
    if map.get("type") == Some(&json!("object")) {
        let properties = map.entry("properties").or_insert_with(|| json!({}));
        properties["comment"] = json!({ "description": "Ignored." });
        map.entry("additionalProperties").or_insert(json!(false));
    }
}

/// Merges the struct of a tagged variant into the variant. The generator writes a tag and a
/// reference to the struct, but a closed object must list all its keys itself.
fn inline_variant(map: &mut Map<String, Value>, definitions: &Value) {
    let tagged = map.contains_key("properties") && map.contains_key("$ref");
    let name = map.get("$ref").and_then(Value::as_str).and_then(|r| r.strip_prefix("#/$defs/"));
    let Some(target) = name.filter(|_| tagged).map(|name| definitions[name].clone()) else {
        return;
    };
    map.remove("$ref");
    if let Some(alternatives) = target.get("oneOf") {
        map.insert("oneOf".into(), alternatives.clone());
    }
    if let (Some(to), Some(from)) =
        (map["properties"].as_object_mut(), target["properties"].as_object())
    {
        to.extend(from.clone());
    }
    if let (Some(to), Some(from)) = (map["required"].as_array_mut(), target["required"].as_array())
    {
        to.extend(from.clone());
    }
}

/// Removes `null` from a type, its values and its default. The generator writes `Option` as "or
/// null", but in the format an optional key is left out and never `null`.
fn drop_null(map: &mut Map<String, Value>) {
    match map.get_mut("default") {
        Some(Value::Null) => drop(map.remove("default")),
        Some(Value::Object(members)) => members.retain(|_, member| !member.is_null()),
        _ => {}
    }
    if let Some(Value::Array(values)) = map.get_mut("enum") {
        values.retain(|value| !value.is_null());
    }
    if let Some(Value::Array(types)) = map.get("type") {
        let kept = types.iter().find(|t| **t != json!("null")).cloned();
        map.insert("type".into(), kept.unwrap_or(Value::Null));
    }
    let branches = map.get_mut("anyOf").and_then(Value::as_array_mut);
    let single = branches.and_then(|branches| {
        branches.retain(|b| b["type"] != json!("null"));
        (branches.len() == 1).then(|| branches[0].clone())
    });
    if let Some(Value::Object(only)) = single {
        map.remove("anyOf");
        for (key, value) in only {
            map.entry(key).or_insert(value);
        }
    }
}

/// Follows references inside the schema.
pub(super) fn resolve<'a>(root: &'a Value, mut schema: &'a Value) -> &'a Value {
    while let Some(name) = schema["$ref"].as_str().and_then(|r| r.strip_prefix("#/$defs/")) {
        schema = &root["$defs"][name];
    }
    schema
}

/// Returns the value of `type` that selects this variant of a tagged object.
pub(super) fn tag(variant: &Value) -> Option<&str> {
    variant["properties"]["type"]["const"].as_str()
}

/// Removes values that equal their default. Whole floats become integers.
pub(super) fn without_defaults(root: &Value, schema: &Value, value: &mut Value) {
    let schema = variant(root, resolve(root, schema), value);
    match value {
        Value::Array(items) => {
            items.iter_mut().for_each(|item| without_defaults(root, &schema["items"], item));
        }
        Value::Object(map) => {
            let properties = &schema["properties"];
            map.retain(|key, member| {
                let of_key = properties.get(key).unwrap_or(&schema["additionalProperties"]);
                without_defaults(root, of_key, member);
                let mut default = of_key["default"].clone();
                without_defaults(root, of_key, &mut default);
                default != *member
            });
        }
        Value::Number(n) => {
            // Write 1.0 as 1.
            let whole = n.as_f64().filter(|f| f.fract() == 0.0 && f.abs() < 1e15);
            if let Some(f) = whole.filter(|_| n.is_f64()) {
                *value = json!(f as i64);
            }
        }
        _ => {}
    }
}

/// Returns the alternative of a schema that `value` matches, or the schema itself if it has none.
fn variant<'a>(root: &'a Value, schema: &'a Value, value: &Value) -> &'a Value {
    let Some(branches) = schema["oneOf"].as_array().or(schema["anyOf"].as_array()) else {
        return schema;
    };
    let mut resolved = branches.iter().map(|b| resolve(root, b));
    let found = resolved.find(|b| match tag(b) {
        Some(tag) => value["type"].as_str() == Some(tag),
        None => value.is_object() && b["type"] == json!("object"),
    });
    found.unwrap_or(schema)
}
