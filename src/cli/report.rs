//! What `info` found out about a file.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::error::printable;

use super::units;

/// The steps of single precision against the shortest edge, world units.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// At the farthest coordinate.
    pub ulp: f64,
    /// Infinite without triangles; JSON has null for it.
    pub edge: f64,
    /// Edges whose ends become one point.
    pub collapsed: u64,
}

impl Extent {
    /// For people; `of` says of what.
    pub fn line(&self, of: &str) -> String {
        let Self { ulp, edge, collapsed } = self;
        let lost = match collapsed {
            0 => String::new(),
            n => format!("; {} edges collapse", units::count(*n)),
        };
        format!("resolution{of}: {ulp:.2e} at the farthest vertex, shortest edge {edge:.2e}{lost}")
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let Self { ulp, edge, collapsed } = self;
        json!({ "ulp": ulp, "shortest_edge": edge, "collapsed_edges": collapsed })
    }
}

/// What was found out: a line per fact for people, and the same for programs.
#[derive(Debug, Default)]
pub struct Report {
    /// For people.
    pub lines: Vec<String>,
    json: Map<String, Value>,
    /// The file's name has been taken with the first lines.
    begun: bool,
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

    /// The lines under the file's name; those so far where more may follow.
    pub fn begin(&mut self, path: &Path) -> String {
        let lines = std::mem::take(&mut self.lines);
        let name = match std::mem::replace(&mut self.begun, true) {
            true => String::new(),
            false => printable(&path.display().to_string()).into_owned() + "\n",
        };
        lines.iter().fold(name, |text, line| text + "  " + &printable(line) + "\n")
    }

    /// All of it, for programs.
    pub fn json(self) -> Value {
        Value::Object(self.json)
    }
}
