//! The primitives of a scene, in coordinates relative to one f64 origin. All accelerators read them
//! from here.

mod ahead;
mod behind;
mod box3;
mod counts;
mod crevice;
mod double_double;
mod doubles;
mod exact;
mod gather;
mod mesh;
mod nearby;
mod passing;
mod placement;
mod predicates;
mod primitives;
mod quad;
mod sphere;
mod stitches;
mod surface;
mod triangle;
mod unseen;

pub use crate::ray::NONE;
pub use ahead::{NEAR_START, is_after_start};
pub use box3::{Box3, slabs_meet};
pub use counts::PrimitiveCounts;
pub use crevice::{Crevice, WallHit, hides, is_near};
pub use double_double::DoubleDouble3;
pub use doubles::doubles;
pub use exact::exact_position;
pub use gather::{prefetch_indices, prefetch_vertices};
pub use mesh::{RUN, TriangleMesh};
pub use nearby::Nearby;
pub use passing::{Passing, passing};
pub use placement::{Instance, Placement};
pub use predicates::{HalfLineIntersection, half_line, segment_crosses};
pub use primitives::{Geometry, GeometryKind};
pub use quad::{on_quad_half, quad_halves};
pub use sphere::Sphere;
pub use surface::{Surfaces, hit_triangle, refine, round_towards};
pub use triangle::{TrianglePoint, clamp_barycentrics, refine_triangle, triangle_error};
pub use unseen::Unseen;
