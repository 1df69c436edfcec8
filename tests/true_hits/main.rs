//! Hits that a backend reports are hits, and are where it says: Embree's false hits are discarded, no
//! ray is lost by that, and what is refined is right to the last digits.

#[path = "../backends/mod.rs"]
mod backends;
mod convex;
mod leaks;
#[path = "../bvh/random.rs"]
mod random;
mod refined;
mod setup;
mod slivers;
