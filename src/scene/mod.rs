//! Scene files: text -> [`SceneDescription`] (as written) -> [`Scene`] (checked).
//!
//! `parse` turns a file into a [`Document`] that stores the place of every value. `overrides`
//! applies `--set`. `structure` checks the document against the [`schema()`], which is generated
//! from the types in `description`. `check` finds what types cannot express. All problems come back
//! in one [`Error`](crate::error::Error). docs/guide/scene-format.md specifies the format.

mod backend;
mod check;
mod checked;
mod description;
mod document;
mod expected;
mod flags;
#[cfg(test)]
mod hostile_tests;
mod layers;
mod load_scene;
mod node;
mod overrides;
mod parse;
mod parse_string;
mod problems;
mod schema;
mod structure;
#[cfg(test)]
mod tests;
mod write;

pub use crate::nearest::{did_you_mean, list, nearest};
pub use backend::{Backend, BackendFlags, EmbreeMode};
pub use check::{IN_MEMORY, MAX_PIXELS, begins_as_ply, unused_material};
pub use checked::*;
pub use description::SceneDescription;
pub use document::{Document, escaped};
pub use flags::Overrides;
pub use layers::{Layer, LightGroups};
pub use load_scene::{
    Loaded, Source, check_camera, from_description, load, read, read_as, read_stdin,
};
pub use node::{JsonNode, JsonPlace, Member, NodeKind};
pub use schema::{schema, schema_of};

/// The types of the format as written, for scenes made by code.
pub mod written {
    pub use super::description::*;
}
