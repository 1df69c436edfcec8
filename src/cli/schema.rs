//! `lightpath schema`: the JSON Schema that editors complete scene files with.

use crate::{error::Result, scene};

/// Prints it.
pub fn run() -> Result<()> {
    let schema = scene::schema();
    // The alternate form of a JSON value is indented.
    super::print(&format!("{schema:#}\n"))
}
