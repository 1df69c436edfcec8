//! The PLY reader. It reads any PLY file that holds a mesh. Common binary files are read in bulk.
//!
//! Each step is a module. [`source`] provides the bytes and [`header`] parses the header. [`plan`]
//! selects the properties, and [`layout`] (for text [`lines`]) locates the rows. [`vertex`] and
//! [`face`] fill the arrays, and [`check`] validates triangles. No count in the header is trusted
//! before the rows have been found in the file. A file without faces is read only if its points are
//! requested. Placement and shading are done elsewhere. Format: Turk, "The PLY Polygon File Format"
//! (1994), and common usage.

mod attributes;
mod block;
mod check;
mod choice;
mod context;
mod duplicates;
mod face;
mod faces;
mod finish;
mod header;
mod layout;
mod lines;
mod number;
mod options;
mod plan;
mod points;
mod polygon;
mod read;
mod records;
mod row;
mod scalar;
mod source;
mod stream;
mod summary;
mod table;
mod unpack;
mod unused;
mod vertex;
mod whole;

pub use options::{ColorChoice, ColorRequest, ReadOptions};
pub use read::{read, read_bytes};
pub use scalar::Scalar;
pub use summary::{
    ElementSummary, PlySummary, PropertySummary, TriangleCount, inspect, inspect_with,
};
