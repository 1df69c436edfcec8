//! The two backends that render, and a test of each. What needs Embree is ignored where there was none when the
//! tests were compiled.
//!
//! What depends on hits is tested on both; that of files, flags, messages and sampling runs on the default alone,
//! as no backend has a part in it.
#![allow(dead_code, unused_imports, unused_macros)] // each test program uses its own part of this module

use lightpath::{
    accel::{self, Accelerator, BuildOptions},
    geometry::Geometry,
    monitor::Monitor,
    scene::Backend,
};

/// One thread, as much memory as it takes.
pub const OPTIONS: BuildOptions = BuildOptions { threads: 1, max_bytes: None };

/// `backend` over `geometry`.
#[track_caller]
pub fn build(geometry: &Geometry, backend: Backend) -> Box<dyn Accelerator + '_> {
    accel::build(geometry, backend, &OPTIONS, &Monitor::default()).unwrap()
}

/// Makes of `fn what(backend: Backend) { ... }` the tests `what::bvh` and `what::embree`.
macro_rules! on_both {
    ($($(#[$about:meta])* fn $what:ident($backend:ident: Backend) $body:block)+) => {$(
        $(#[$about])*
        mod $what {
            use lightpath::scene::{Backend, written::Accelerator as Named};

            #[allow(unused_imports)]
            use super::*;

            fn test($backend: Backend) $body

            #[test]
            fn bvh() {
                test(Named::Bvh.into());
            }

            #[test]
            #[cfg_attr(not(lightpath_embree), ignore = "needs Embree")]
            fn embree() {
                test(Named::Embree.into());
            }
        }
    )+};
}
pub(crate) use on_both;
