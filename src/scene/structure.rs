//! Checks a document against the schema. Reports every problem with its place and a help text.
//!
//! The checks walk the generated schema, so there is only one table of keys and ranges. Only the
//! keywords that this schema uses are supported. The module `check` tests what a schema cannot
//! express.

use std::collections::HashMap;

use serde_json::Value;

use crate::nearest::{did_you_mean, list, nearest};

use super::document::join;
use super::expected::{expected, found, quoted, words};
use super::node::{JsonNode, Member, NodeKind};
use super::problems::Problems;
use super::schema::{resolve, tag};

/// Checks the whole document. Returns the pointers of values that cannot be read as their type. The
/// meaning of all other values can still be checked.
pub fn check(schema: &Value, problems: &mut Problems) -> Vec<String> {
    let document = problems.document;
    let mut walk = Walk { root: schema, problems, broken: Vec::new() };
    walk.node(schema, &document.root, "");
    walk.broken
}

struct Walk<'a, 'b> {
    root: &'a Value,
    problems: &'a mut Problems<'b>,
    broken: Vec<String>,
}

impl<'a> Walk<'a, '_> {
    fn node(&mut self, schema: &'a Value, node: &JsonNode, pointer: &str) {
        let schema = resolve(self.root, schema);
        if let Some(words) = words(schema) {
            return self.word(schema, &words, node, pointer);
        }
        let branches = schema["oneOf"].as_array().or(schema["anyOf"].as_array());
        let branches: Vec<&Value> =
            branches.into_iter().flatten().map(|b| resolve(self.root, b)).collect();
        if branches.iter().any(|b| tag(b).is_some()) {
            return self.tagged(&branches, node, pointer);
        }
        if schema["type"].is_null() && !branches.is_empty() {
            return match branches.iter().find(|b| is_type(b, node)) {
                Some(branch) => self.node(branch, node, pointer),
                None => self.wrong(schema, node, pointer),
            };
        }
        match (schema["type"].as_str(), &node.kind) {
            (Some("object"), NodeKind::Object(members)) => {
                self.object(schema, &[], node, members, pointer)
            }
            (Some("array"), NodeKind::List(items)) => self.list(schema, node, items, pointer),
            (Some("string"), NodeKind::String(text)) => {
                if text.is_empty() && schema["minLength"] == 1 {
                    let message = "found \"\", expected a string that is not empty";
                    self.problems.error(pointer, message, None);
                }
            }
            (Some("number" | "integer"), NodeKind::Number(_)) => self.number(schema, node, pointer),
            (Some("boolean"), NodeKind::Bool(_)) | (None, _) => {}
            _ => self.wrong(schema, node, pointer),
        }
    }

    /// Reports a value that does not match the schema.
    fn wrong(&mut self, schema: &Value, node: &JsonNode, pointer: &str) {
        let message = format!("found {}, expected {}", found(node), expected(self.root, schema));
        self.unreadable(node, pointer, message, None);
    }

    /// Reports a value that the later checks cannot read.
    fn unreadable(
        &mut self,
        node: &JsonNode,
        pointer: &str,
        message: String,
        help: Option<String>,
    ) {
        self.problems.error_at(&node.place, pointer, message, help);
        self.broken.push(pointer.to_string());
    }

    fn word(&mut self, schema: &Value, words: &[&str], node: &JsonNode, pointer: &str) {
        let text = node.text();
        if !text.is_some_and(|text| words.contains(&text)) {
            let wanted = expected(self.root, schema);
            let help = text.and_then(|text| did_you_mean(text, words.iter().copied()));
            let message = format!("found {}, expected {wanted}", found(node));
            self.unreadable(node, pointer, message, help);
        }
    }

    fn tagged(&mut self, branches: &[&'a Value], node: &JsonNode, pointer: &str) {
        let NodeKind::Object(members) = &node.kind else {
            return self.wrong(&serde_json::json!({ "type": "object" }), node, pointer);
        };
        let tags: Vec<&str> = branches.iter().filter_map(|b| tag(b)).collect();
        let Some(kind) = node.member("type") else {
            let message = format!("missing key `type`, expected {}", list(tags));
            self.unreadable(node, pointer, message, None);
            return self.shared(branches, members, pointer);
        };
        let text = kind.text();
        if let Some(branch) = branches.iter().find(|b| text.is_some() && tag(b) == text) {
            return self.object(branch, branches, node, members, pointer);
        }
        let help = text.and_then(|text| did_you_mean(text, tags.iter().copied()));
        let message = format!("found {}, expected {}", found(kind), list(tags));
        self.problems.error_at(&kind.place, &join(pointer, "type"), message, help);
        self.broken.push(pointer.to_string());
        match text.and_then(|text| meant(text, branches, members)) {
            Some(branch) => self.object(branch, branches, node, members, pointer),
            None => self.shared(branches, members, pointer),
        }
    }

    /// Checks an object with an unknown `type`: only the members that every type has.
    fn shared(&mut self, branches: &[&'a Value], members: &[Member], pointer: &str) {
        for member in members.iter().filter(|member| !matches!(&*member.key, "type" | "comment")) {
            let of_key = &branches[0]["properties"][&member.key];
            let same = |branch: &&Value| branch["properties"][&member.key] == *of_key;
            if !of_key.is_null() && branches.iter().all(same) {
                self.node(of_key, &member.value, &join(pointer, &member.key));
            }
        }
    }

    /// Checks an object. `variants` are the schemas of all its possible types, if it has a `type`.
    fn object(
        &mut self,
        schema: &'a Value,
        variants: &[&Value],
        node: &JsonNode,
        members: &[Member],
        pointer: &str,
    ) {
        let properties = &schema["properties"];
        let open = &schema["additionalProperties"];
        let mut seen: HashMap<&str, &Member> = HashMap::new();
        for member in members {
            let key = member.key.as_str();
            let below = join(pointer, key);
            if let Some(first) = seen.insert(key, member) {
                let at = self.problems.document.describe(&first.place, "");
                let message =
                    format!("found the key {} a second time, expected it once", quoted(key));
                let help = Some(format!("the first is at {at}"));
                self.problems.error_at(&member.place, &below, message, help);
            }
            match properties.get(key) {
                Some(_) if key == "comment" => {}
                // The type that selects one of several variants has been checked.
                Some(_) if key == "type" && !variants.is_empty() => {}
                Some(of_key) => self.node(of_key, &member.value, &below),
                None if open.is_object() => self.node(open, &member.value, &below),
                None => self.unknown(schema, variants, member, &below),
            }
        }
        for key in schema["required"].as_array().into_iter().flatten() {
            let key = key.as_str().unwrap_or_default();
            if !seen.contains_key(key) {
                let wanted = expected(self.root, &properties[key]);
                let message = format!("missing key `{key}`, expected {wanted}");
                self.unreadable(node, pointer, message, None);
            }
        }
    }

    fn unknown(&mut self, schema: &Value, variants: &[&Value], member: &Member, pointer: &str) {
        let has = |variant: &&&Value| variant["properties"].get(&member.key).is_some();
        let others: Vec<&str> = variants.iter().filter(has).filter_map(|v| tag(v)).collect();
        if let (Some(own), false) = (tag(schema), others.is_empty()) {
            let message = format!(
                "found `{}` with type `{own}`, expected it with type {} only",
                member.key,
                list(others)
            );
            let help = "remove the key, or change the type".to_string();
            return self.problems.error_at(&member.place, pointer, message, Some(help));
        }
        let known = schema["properties"].as_object().into_iter().flat_map(|p| p.keys());
        let known: Vec<&str> = known.map(String::as_str).collect();
        let help = did_you_mean(&member.key, known.iter().copied());
        let message =
            format!("found the unknown key {}, expected {}", quoted(&member.key), list(known));
        self.problems.error_at(&member.place, pointer, message, help);
    }

    fn list(&mut self, schema: &'a Value, node: &JsonNode, items: &[JsonNode], pointer: &str) {
        let count = items.len() as u64;
        let short = schema["minItems"].as_u64().is_some_and(|min| count < min);
        let long = schema["maxItems"].as_u64().is_some_and(|max| count > max);
        if short || long {
            return self.wrong(schema, node, pointer);
        }
        for (i, item) in items.iter().enumerate() {
            self.node(&schema["items"], item, &join(pointer, &i.to_string()));
        }
    }

    fn number(&mut self, schema: &Value, node: &JsonNode, pointer: &str) {
        let integer = schema["type"] == "integer";
        let number = node.number().unwrap_or(f64::NAN);
        if !number.is_finite() {
            let wanted = expected(self.root, schema);
            let message = format!(
                "found {}, which is not finite in double precision, expected {wanted}",
                found(node)
            );
            return self.unreadable(node, pointer, message, None);
        }
        if integer && node.integer().is_none() {
            return self.wrong(schema, node, pointer);
        }
        if !in_range(schema, node, number) {
            self.wrong(schema, node, pointer);
            // A float out of range can still be read, so the rest of its object is checked.
            if !integer {
                self.broken.pop();
            }
        }
    }
}

/// Returns the variant that an object with the misspelt type `text` means. It is the only one with
/// a similar name, and has all keys of the object that any variant has: else an error about a key
/// could be wrong.
fn meant<'a>(text: &str, branches: &[&'a Value], members: &[Member]) -> Option<&'a Value> {
    let tags = || branches.iter().filter_map(|branch| tag(branch));
    let near = nearest(text, tags())?;
    if nearest(text, tags().filter(|tag| *tag != near)).is_some() {
        return None;
    }
    let branch = *branches.iter().find(|branch| tag(branch) == Some(near))?;
    let has = |branch: &Value, key: &str| branch["properties"].get(key).is_some();
    let is_its_own =
        |key: &str| has(branch, key) || !branches.iter().any(|branch| has(branch, key));
    members.iter().all(|member| is_its_own(&member.key)).then_some(branch)
}

/// Returns true if a number is within the bounds of the schema. Absent bounds always hold.
fn in_range(schema: &Value, node: &JsonNode, number: f64) -> bool {
    let bound = |key: &str| schema[key].as_f64();
    if let (Some(n), "integer") = (node.integer(), schema["type"].as_str().unwrap_or_default()) {
        let bound =
            |key: &str| schema[key].as_number().and_then(|b| b.to_string().parse::<i128>().ok());
        return bound("minimum").is_none_or(|b| n >= b)
            && bound("maximum").is_none_or(|b| n <= b)
            && bound("multipleOf").is_none_or(|b| n % b == 0);
    }
    bound("minimum").is_none_or(|b| number >= b)
        && bound("maximum").is_none_or(|b| number <= b)
        && bound("exclusiveMinimum").is_none_or(|b| number > b)
        && bound("exclusiveMaximum").is_none_or(|b| number < b)
}

fn is_type(schema: &Value, node: &JsonNode) -> bool {
    if words(schema).is_some() {
        return node.text().is_some();
    }
    let name = match node.kind {
        NodeKind::Null => "null",
        NodeKind::Bool(_) => "boolean",
        NodeKind::Number(_) => "number",
        NodeKind::String(_) => "string",
        NodeKind::List(_) => "array",
        NodeKind::Object(_) => "object",
    };
    schema["type"] == name
}
