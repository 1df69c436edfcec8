//! Scene files: text -> [`Description`] (as written) -> [`Scene`] (checked).

mod checked;

pub use checked::*;
