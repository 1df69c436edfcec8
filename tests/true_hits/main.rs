//! Hits that a backend reports are hits, and are where it says: Embree's false hits are discarded, no
//! ray is lost by that, and what is refined is right to the last digits.

mod convex;
mod leaks;
#[path = "../bvh/random.rs"]
mod random;
mod refined;
mod setup;
#[cfg(feature = "embree")]
mod slivers;
