//! Rays and points on meshes whose arrays stay with the caller: [`RayScene`].
//!
//! `arrays` reads the caller's arrays. `batch` checks rays, `rounded` rounds them for the tree, and
//! `refine` computes their hits in f64. `further` goes on where a hit lies outside of a ray's
//! limits, and `at_limit` decides where faces meet at one. `filling` makes the arrays of answers.
//! `first_hit`, `all_hits`, `inside`, `nearest` and `visible` are one kind of query each.

mod all_hits;
mod arrays;
mod at_limit;
mod batch;
mod closed;
mod filling;
mod first_hit;
mod further;
mod inside;
mod nearest;
mod progress;
mod refine;
mod rounded;
mod scene;
mod strays;
mod visible;

pub use all_hits::AllHits;
pub use arrays::{Faces, MeshArrays, Vertices};
pub use batch::{Limits, RayBatch};
pub use first_hit::FirstHits;
pub use nearest::ClosestPoints;
pub use scene::{RayBackend, RayScene};
