//! Hits that a backend reports are hits, and are where it says: Embree's false hits are discarded, no
//! ray is lost by that, and what is refined is right to the last digits.

mod leaks;
mod refined;
#[cfg(feature = "embree")]
mod slivers;
#[path = "../bvh/random.rs"]
mod random;
mod setup;
