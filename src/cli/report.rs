//! What `info` found out about a file.

use std::path::Path;

use serde_json::{Map, Value};

/// What was found out: a line per fact for people, and the same for programs.
#[derive(Debug, Default)]
pub struct Report {
    /// For people.
    pub lines: Vec<String>,
    json: Map<String, Value>,
}

impl Report {
    /// Adds a fact under a JSON key.
    pub fn add(&mut self, key: &str, value: Value, line: impl Into<String>) {
        self.json.insert(key.to_string(), value);
        let line = line.into();
        if !line.is_empty() {
            self.lines.push(line);
        }
    }

    /// All of it, as lines under the file's name or as one line of JSON.
    pub fn text(self, path: &Path, json: bool) -> String {
        if json {
            return format!("{}\n", Value::Object(self.json));
        }
        let lines = self.lines.iter().map(|line| format!("  {line}\n"));
        format!("{}\n{}", path.display(), lines.collect::<String>())
    }
}
