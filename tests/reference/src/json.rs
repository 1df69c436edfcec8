//! Small readers over `serde_json::Value`. The caller gives the format's defaults.

use glam::DVec3;
use serde_json::Value;

/// `[x, y, z]`; panics with the value if it is anything else.
pub fn vec3(value: &Value) -> DVec3 {
    let list: Vec<f64> = value
        .as_array()
        .unwrap_or_else(|| panic!("not a vector: {value}"))
        .iter()
        .map(|x| x.as_f64().unwrap_or_else(|| panic!("not a number: {x}")))
        .collect();
    assert_eq!(list.len(), 3, "not three numbers: {value}");
    DVec3::new(list[0], list[1], list[2])
}

/// The required vector under `key`.
pub fn need_vec3(object: &Value, key: &str) -> DVec3 {
    vec3(object.get(key).unwrap_or_else(|| panic!("no `{key}` in {object}")))
}

/// The vector under `key`, or `default`.
pub fn vec3_or(object: &Value, key: &str, default: DVec3) -> DVec3 {
    object.get(key).map_or(default, vec3)
}

/// The number under `key`, or `default`.
pub fn number_or(object: &Value, key: &str, default: f64) -> f64 {
    object.get(key).map_or(default, |x| x.as_f64().unwrap())
}

/// The required number under `key`.
pub fn need_number(object: &Value, key: &str) -> f64 {
    object[key].as_f64().unwrap_or_else(|| panic!("no number `{key}` in {object}"))
}

/// The word under `key`, or `default`.
pub fn word_or<'a>(object: &'a Value, key: &str, default: &'a str) -> &'a str {
    object.get(key).map_or(default, |x| x.as_str().unwrap())
}

/// The switch under `key`, or `default`.
pub fn switch_or(object: &Value, key: &str, default: bool) -> bool {
    object.get(key).map_or(default, |x| x.as_bool().unwrap())
}
