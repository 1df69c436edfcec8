//! Reported hits are real and exact: Embree's false hits are rejected, no ray is lost by that, and
//! refined hits are right to the last digits.

#[path = "../backends/mod.rs"]
mod backends;
mod convex;
mod leaks;
#[path = "../bvh/random.rs"]
mod random;
mod refined;
mod setup;
mod slivers;
