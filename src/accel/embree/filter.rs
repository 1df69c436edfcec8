//! A ray that leaves a planar primitive cannot meet it again: the filter says so to Embree.

use super::ffi::FilterArguments;

/// Members of `RTCRayN` and `RTCHitN` in units of `n` lanes.
const RAY_ID: usize = 10;
const HIT_PRIM: usize = 5;
const HIT_GEOM: usize = 6;

/// Rejects hits of the primitive that the ray leaves. Embree calls it for candidates that passed
/// the intersection test only, so rays that meet nothing pay nothing.
pub unsafe extern "C" fn reject_leaving(args: *const FilterArguments) {
    // SAFETY: Embree passes valid arguments with `n` lanes; the context is our `QueryContext`,
    // whose `bases` has an entry for every attached geometry.
    unsafe {
        let args = &*args;
        let n = args.n as usize;
        for lane in 0..n {
            if *args.valid.add(lane) == 0 {
                continue;
            }
            let leaving = (*args.ray.add(RAY_ID * n + lane)).to_bits();
            let geom = (*args.hit.add(HIT_GEOM * n + lane)).to_bits();
            let prim = (*args.hit.add(HIT_PRIM * n + lane)).to_bits();
            if leaving == *(*args.context).bases.add(geom as usize) + prim {
                *args.valid.add(lane) = 0;
            }
        }
    }
}
