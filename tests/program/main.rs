//! Tests that run the program.

use std::sync::{Mutex, MutexGuard, PoisonError};

#[path = "../support/mod.rs"]
mod support;

/// Waits until no other test that limits a time runs.
fn timed() -> MutexGuard<'static, ()> {
    static TIMED: Mutex<()> = Mutex::new(());
    TIMED.lock().unwrap_or_else(PoisonError::into_inner)
}

mod batch {
    mod cameras;
    mod flags;
    mod frames;
    #[cfg(unix)]
    mod inputs;
    #[cfg(unix)]
    mod kill;
    mod memory;
    mod origins;
    mod photographs;
    mod settings;
    mod sheet;
}

/// Bad input, signals, and too little memory, disk space or processes.
mod failures {
    #[cfg(unix)]
    mod bad_input;
    #[cfg(target_os = "linux")]
    mod full_disk;
    #[cfg(unix)]
    mod hostile_names;
    #[cfg(unix)]
    mod inputs_stay;
    #[cfg(target_os = "linux")]
    mod limits;
    #[cfg(unix)]
    mod signals;
}

mod farm {
    mod cluster;
    mod submit;
}

/// The commands that measure and compare.
mod measure {
    mod accuracy;
    mod bench;
    mod compare;
    mod compare_depths;
    mod converge;
    mod crosscheck;
}

#[cfg(target_os = "linux")]
mod installed;
mod merge;
mod pages;

/// Pictures compared with closed forms and with an independent ray tracer.
mod pictures {
    mod analytic;
    mod far_and_near;
    mod lights_in_walls;
    mod reference_images;
}

mod render {
    mod adaptive;
    mod catcher_parts;
    mod command;
    mod cryptomatte;
    mod dataset;
    mod determinism;
    mod exr_inputs;
    mod instances;
    mod layers;
    mod map_coordinates;
    mod memory;
    mod mesh_alone;
    mod plate;
    mod tiers;
}

#[cfg(unix)]
mod terminal;
mod usage;
