//! Applies `--set /json/pointer=VALUE` to a [`Document`] before it is checked. So an override
//! passes the same checks as the text, and messages name it as `--set`.

use std::sync::Arc;

use crate::error::Problem;

use super::document::{Document, join, shown, tokens};
use super::node::{JsonNode, JsonPlace, Member, NodeKind, list_index};
use super::parse::{self, MAX_DEPTH};

impl Document {
    /// Applies one `/json/pointer=VALUE`. VALUE is JSON; a text that is not JSON is taken as a
    /// string. Missing object members are created. An array index must exist; `-` appends an item,
    /// also to a missing array. A `target` of the camera replaces its `lookat`, and the reverse.
    ///
    /// # Errors
    /// - A text without `=`, or a pointer without a leading `/` or with an unknown escape.
    /// - A pointer of more steps than a scene may have levels.
    /// - A pointer below a value that is neither an object nor an array.
    /// - A pointer to an array index that does not exist.
    pub fn apply_set(&mut self, assignment: &str) -> std::result::Result<(), Problem> {
        let complain =
            |message: &str| Problem::new(format!("--set {}", shown(assignment)), message);
        let Some((pointer, value)) = assignment.split_once('=') else {
            let problem = complain("found no `=`, expected /json/pointer=VALUE");
            return Err(problem.help("for example --set /camera/fov=40"));
        };
        if !pointer.starts_with('/') {
            let problem =
                complain("found a pointer without a leading `/`, expected /json/pointer=VALUE");
            return Err(problem.help(format!("write --set /{}", shown(assignment))));
        }
        if pointer.split('~').skip(1).any(|rest| !rest.starts_with(['0', '1'])) {
            let problem = complain("found `~` without 0 or 1 behind it, expected a JSON pointer");
            return Err(problem.help("`~0` stands for `~`, `~1` for `/`"));
        }
        let steps: Vec<String> = tokens(pointer).collect();
        if steps.len() > MAX_DEPTH {
            return Err(complain("found a pointer deeper than any scene"));
        }
        let place = JsonPlace::Set(Arc::from(pointer));
        let kind = match parse::parse(value) {
            Ok(node) => node.kind,
            Err(_) => NodeKind::String(value.to_string()),
        };
        let mut new = JsonNode { place: place.clone(), kind };
        replace_places(&mut new, &place);
        let mut node = &mut self.root;
        let mut walked = String::new();
        for (i, step) in steps.iter().enumerate() {
            let missing = match steps.get(i + 1).map(String::as_str) {
                Some("-") => NodeKind::List(Vec::new()),
                _ => NodeKind::Object(Vec::new()),
            };
            let missing = JsonNode { place: place.clone(), kind: missing };
            node = descend(node, step, missing, &walked).map_err(|problem| Problem {
                place: format!("--set {}", shown(assignment)),
                ..problem
            })?;
            walked = join(&walked, step);
        }
        *node = new;
        match pointer {
            "/camera/target" => self.drop_of_camera("lookat"),
            "/camera/lookat" => self.drop_of_camera("target"),
            _ => {}
        }
        Ok(())
    }

    /// Removes a member of `/camera`.
    fn drop_of_camera(&mut self, key: &str) {
        if let Some(NodeKind::Object(members)) =
            self.root.member_mut("camera").map(|camera| &mut camera.kind)
        {
            members.retain(|member| member.key != key);
        }
    }
}

fn replace_places(node: &mut JsonNode, place: &JsonPlace) {
    node.place = place.clone();
    match &mut node.kind {
        NodeKind::List(items) => items.iter_mut().for_each(|item| replace_places(item, place)),
        NodeKind::Object(members) => {
            for member in members {
                member.place = place.clone();
                replace_places(&mut member.value, place);
            }
        }
        _ => {}
    }
}

/// Follows one step of the pointer. Adds `missing` if the step leads to a member that the object
/// lacks, or is `-`, which appends to an array.
fn descend<'a>(
    node: &'a mut JsonNode,
    step: &str,
    missing: JsonNode,
    walked: &str,
) -> std::result::Result<&'a mut JsonNode, Problem> {
    match &mut node.kind {
        NodeKind::Object(members) => {
            let at = match members.iter().rposition(|m| m.key == step) {
                Some(at) => at,
                None => {
                    members.push(Member {
                        place: missing.place.clone(),
                        key: step.to_string(),
                        value: missing,
                    });
                    members.len() - 1
                }
            };
            Ok(&mut members[at].value)
        }
        NodeKind::List(items) => {
            let count = items.len();
            let at = match list_index(step) {
                Some(index) if index < count => index,
                _ if step == "-" => {
                    items.push(missing);
                    count
                }
                _ => {
                    let indices = match count {
                        0 => String::new(),
                        _ => format!("0 to {} or ", count - 1),
                    };
                    let message = format!(
                        "found the index `{step}` into {walked}, an array of {count}, \
                         expected {indices}`-` to append"
                    );
                    return Err(Problem::new("", message));
                }
            };
            Ok(&mut items[at])
        }
        kind => {
            let message = format!(
                "found the key `{step}` below {walked}, which is neither an object nor an array"
            );
            let problem = Problem::new("", message);
            // The value of `material` is often only the name of a material.
            Err(match kind {
                NodeKind::String(name) if walked.ends_with("/material") => {
                    let there = join(&join("/scene/materials", name), step);
                    problem.help(format!("the material is named {name:?}: --set {there}=VALUE"))
                }
                _ => problem,
            })
        }
    }
}
