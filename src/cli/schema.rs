//! `lightpath schema`: prints JSON Schemas, which editors use for completion.

use crate::{
    batch::JobFile,
    error::Result,
    scene::{schema, schema_of},
};

use super::args::SchemaName;

/// Prints the schema of one kind of file.
pub fn run(of: SchemaName) -> Result<()> {
    // The alternate format of a JSON value is indented.
    super::print(&match of {
        SchemaName::Scene => format!("{:#}\n", schema()),
        SchemaName::Job => format!("{:#}\n", schema_of::<JobFile>("lightpath job")),
    })
}
