//! The two backends that render, and a macro for one test of each. Tests that need Embree are
//! ignored if there was none when they were compiled.
//!
//! Tests that depend on hits run on both. Tests of files, flags, messages and sampling run only on
//! the default backend, because the backend does not affect them.
#![allow(unused_imports, unused_macros)] // each test program uses its own part of this module

use lightpath::{
    accel::{self, Accelerator, BuildOptions},
    geometry::Geometry,
    monitor::Monitor,
    scene::Backend,
};

/// One thread and unlimited memory.
pub const OPTIONS: BuildOptions = BuildOptions { threads: 1, max_bytes: None };

/// Builds `backend` over `geometry`.
#[track_caller]
pub fn build(geometry: &Geometry, backend: Backend) -> Box<dyn Accelerator + '_> {
    accel::build(geometry, backend, &OPTIONS, &Monitor::default()).unwrap()
}

/// Makes the tests `what::bvh` and `what::embree` from `fn what(backend: Backend) { ... }`.
macro_rules! on_both {
    ($($(#[$about:meta])* fn $what:ident($backend:ident: Backend) $body:block)+) => {$(
        $(#[$about])*
        mod $what {
            use lightpath::scene::{Backend, written::AcceleratorName};

            #[allow(unused_imports)]
            use super::*;

            fn test($backend: Backend) $body

            #[test]
            fn bvh() {
                test(AcceleratorName::Bvh.into());
            }

            #[test]
            #[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
            fn embree() {
                test(AcceleratorName::Embree.into());
            }
        }
    )+};
}
pub(crate) use on_both;
