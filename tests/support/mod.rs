//! Helpers that several test programs share.
#![allow(dead_code)] // each test program uses its own part of this module

pub mod backends;
pub mod browser;
pub mod errors;
pub mod oracle;
pub mod ply_writer;
pub mod program;
pub mod random;
pub mod reference;
