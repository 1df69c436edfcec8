//! Whether Embree is there: what needs it is skipped, with a note, where it is not.
#![allow(dead_code)] // each test program uses its own part of this module

use lightpath::{
    accel::{self, Accelerator, BuildOptions},
    error::Error,
    geometry::Geometry,
    monitor::Monitor,
    scene::Backend,
};

/// Whether a message says that Embree is not installed, or not in this build; notes it.
pub fn no_embree(message: &str) -> bool {
    let missing = ["cannot load libembree", "`embree`, which this build does not have"];
    let missing = missing.iter().any(|text| message.contains(text));
    if missing {
        eprintln!("skipped: {message}");
    }
    missing
}

/// What was made of a backend; `None` where that is Embree and is not there.
#[track_caller]
pub fn unless_missing<T>(backend: Backend, made: Result<T, Error>) -> Option<T> {
    match made {
        Err(error) if backend == Backend::Embree && no_embree(&error.to_string()) => None,
        made => Some(made.unwrap()),
    }
}

/// `backend` over `geometry`; `None` where that is Embree and is not there.
#[track_caller]
pub fn build<'g>(
    geometry: &'g Geometry,
    backend: Backend,
    options: &BuildOptions,
) -> Option<Box<dyn Accelerator + 'g>> {
    unless_missing(backend, accel::build(geometry, backend, options, &Monitor::default()))
}
