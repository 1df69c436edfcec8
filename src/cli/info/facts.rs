//! Facts that `info` reports about a file.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::{error::printable, units};

/// Resolution of single precision compared with the shortest edge, in world units.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    /// Distance between neighbouring f32 values at the farthest coordinate.
    pub ulp: f64,
    /// Length of the shortest edge. Infinite without triangles, which JSON shows as null.
    pub edge: f64,
    /// Number of edges whose ends round to the same point.
    pub collapsed: u64,
}

impl Extent {
    /// Formats one line of text; `of` names the object.
    pub fn line(&self, of: &str) -> String {
        let Self { ulp, edge, collapsed } = self;
        let lost = match collapsed {
            0 => String::new(),
            n => format!("; {} edges collapse", units::count(*n)),
        };
        format!("resolution{of}: {ulp:.2e} at the farthest vertex, shortest edge {edge:.2e}{lost}")
    }

    /// Returns the same numbers as JSON.
    pub fn json(&self) -> Value {
        let Self { ulp, edge, collapsed } = self;
        json!({ "ulp": ulp, "shortest_edge": edge, "collapsed_edges": collapsed })
    }
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

    /// Takes the lines collected so far, preceded by the file's name the first time.
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
