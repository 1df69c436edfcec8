//! Finds the primitives near a point by Embree's point query.

use std::ffi::c_void;

use super::ffi::{PointQuery, PointQueryArguments, PointQueryContext};
use super::scene::EmbreeScene;
use crate::geometry::Nearby;
use crate::ray::NONE;

/// Factor on the radius that exceeds its rounding.
const WIDER: f32 = 1.0 + 16.0 * f32::EPSILON;

type OnPrimitive<'f> = &'f mut dyn FnMut(u32, u32);

/// Calls `found` with geometry id and primitive index of every primitive near the point.
///
/// May also call `found` for other primitives: Embree searches a sphere that is as large as the
/// largest neighbours need.
pub fn near(scene: &EmbreeScene, nearby: &Nearby, mut found: OnPrimitive) {
    let [low, high] = nearby.bounds();
    let point = [0, 1, 2].map(|k| 0.5 * low[k] + 0.5 * high[k]);
    let diagonal = (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f32>().sqrt();
    let radius = 0.5 * diagonal * WIDER;
    let mut query = PointQuery { point, time: 0.0, radius };
    let mut context = PointQueryContext {
        world2inst: [0.0; 16],
        inst2world: [0.0; 16],
        inst_id: NONE,
        inst_prim_id: NONE,
        inst_stack_size: 0,
    };
    let user = std::ptr::from_mut(&mut found).cast::<c_void>();
    // SAFETY: a live scene; query and context are laid out as Embree's and outlive the call, as
    // does `found`, which the callback alone uses.
    unsafe {
        (scene.api().point_query)(scene.handle(), &mut query, &mut context, Some(on_found), user);
    }
}

unsafe extern "C" fn on_found(args: *const PointQueryArguments) -> bool {
    // SAFETY: Embree passes valid arguments with the user data of `near`.
    let (args, found) = unsafe { (&*args, &mut *(*args).user.cast::<OnPrimitive>()) };
    found(args.geom_id, args.prim_id);
    // False: the query's radius has not changed.
    false
}
