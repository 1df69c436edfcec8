//! Our leaves as user geometry: their boxes, and the callback that has them tested.

use std::ffi::c_uint;

use super::ffi::{Bounds, BoundsArguments, UserArguments};
use crate::accel::bvh::leaves::Leaves;
use crate::accel::bvh::search::Visitor;
use crate::geometry::NONE;
use crate::ray::LANES;

/// `RTCRayQueryContext`, and behind it who tests what Embree finds.
#[repr(C)]
pub struct Context<'v> {
    inst_id: c_uint,
    inst_prim_id: c_uint,
    visitor: &'v mut dyn Visitor,
}

impl Context<'_> {
    pub fn new(visitor: &mut dyn Visitor) -> Context<'_> {
        Context { inst_id: NONE, inst_prim_id: NONE, visitor }
    }
}

/// A leaf's box, grown.
pub unsafe extern "C" fn bounds(args: *const BoundsArguments) {
    // SAFETY: Embree passes valid arguments; the user data is a live `Leaves`.
    let (args, leaves) = unsafe { (&*args, &*(*args).user.cast::<Leaves>()) };
    let (lower, upper) = leaves.bounds(args.prim_id as usize);
    let margin = leaves.margin();
    // Rounded outwards: the sum is off by half an ulp of a coordinate at most.
    let down = lower.map(|x| x - margin - x.abs() * f32::EPSILON);
    let up = upper.map(|x| x + margin + x.abs() * f32::EPSILON);
    // SAFETY: Embree passes room for one box.
    unsafe { *args.bounds = Bounds { lower: down, align0: 0.0, upper: up, align1: 0.0 } };
}

/// Members of `RTCRayN` in units of `n` lanes.
const TFAR: usize = 8;
const ID: usize = 10;

/// Tests a leaf for the valid lanes and ends their segments where the visitor says: for closest hits
/// and for occlusion alike. The hit itself stays with the visitor.
pub unsafe extern "C" fn visit(args: *const UserArguments) {
    // SAFETY: Embree passes valid arguments: `n` valid flags, `n` lanes of every member of `RTCRayN`,
    // and the query's context, which is a `Context`; lane numbers were set by the query.
    unsafe {
        let args = &*args;
        let context = &mut *args.context.cast::<Context>().cast_mut();
        let n = args.n as usize;
        let (ids, ends) = (args.rays.add(ID * n).cast::<u32>(), args.rays.add(TFAR * n));
        let mut lanes = 0;
        for k in 0..n {
            let valid = u32::from(*args.valid.add(k) != 0);
            lanes |= valid << (*ids.add(k) % LANES as u32);
        }
        let shortened = context.visitor.visit(args.prim_id as usize, lanes);
        for k in 0..n {
            if *args.valid.add(k) != 0 {
                *ends.add(k) = shortened[*ids.add(k) as usize % LANES];
            }
        }
    }
}
