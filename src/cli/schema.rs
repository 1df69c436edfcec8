//! `lightpath schema`: the JSON Schemas that editors complete files with.

use crate::{
    batch::JobFile,
    error::Result,
    scene::{schema, schema_of},
};

use super::args::SchemaName;

/// Prints one.
pub fn run(of: SchemaName) -> Result<()> {
    // The alternate form of a JSON value is indented.
    super::print(&match of {
        SchemaName::Scene => format!("{:#}\n", schema()),
        SchemaName::Job => format!("{:#}\n", schema_of::<JobFile>("lightpath job")),
    })
}
