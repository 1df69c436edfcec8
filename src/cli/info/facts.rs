//! Facts that `info` reports about a file.

use std::path::Path;

use serde_json::{Map, Value};

use crate::error::printable;
use crate::units;
use crate::world::Detail;

/// Formats the resolution of a mesh in single precision as one line; `of` follows the first word.
pub fn resolution_line(detail: &Detail, of: &str) -> String {
    let Detail { ulp, shortest_edge, collapsed_edges } = detail;
    let lost = match collapsed_edges {
        0 => String::new(),
        n => format!("; {}", units::counted(*n, ["edge collapses", "edges collapse"])),
    };
    format!(
        "resolution{of}: {ulp:.2e} at the farthest vertex, shortest edge {shortest_edge:.2e}{lost}"
    )
}

/// Collects facts, each as a line of text and as a JSON value.
#[derive(Debug, Default)]
pub struct Facts {
    /// Lines of text that are not printed yet.
    pub lines: Vec<String>,
    json: Map<String, Value>,
    /// True once the file's name has been printed.
    begun: bool,
}

impl Facts {
    /// Adds a fact under a JSON key. An empty `line` adds only JSON.
    pub fn add(&mut self, key: &str, value: Value, line: impl Into<String>) {
        self.json.insert(key.to_string(), value);
        let line = line.into();
        if !line.is_empty() {
            self.lines.push(line);
        }
    }

    /// Adds a count of `one` thing or `many`. A count of zero adds only JSON.
    pub fn add_count(&mut self, key: &str, count: u64, what: [&str; 2]) {
        let line = match count {
            0 => String::new(),
            _ => units::counted(count, what),
        };
        self.add(key, count.into(), line);
    }

    /// Takes the lines collected so far. The first call puts the file's name before them.
    pub fn begin(&mut self, path: &Path) -> String {
        let lines = std::mem::take(&mut self.lines);
        let name = match std::mem::replace(&mut self.begun, true) {
            true => String::new(),
            false => printable(&path.display().to_string()).into_owned() + "\n",
        };
        lines.iter().fold(name, |text, line| text + "  " + &printable(line) + "\n")
    }

    /// Returns all facts as JSON.
    pub fn json(self) -> Value {
        Value::Object(self.json)
    }
}
