//! Argument filters that reject some of Embree's candidates.
//!
//! Embree calls a filter only for candidates that passed its intersection test. After a rejection
//! it continues along the ray. Two kinds of candidates are rejected:
//!
//! - hits of the flat primitive that the ray leaves: the ray cannot hit it again;
//! - false hits: the ray misses the primitive by more than the error of Embree's test
//!   ([`passing`]), or the primitive lies behind the surface that the ray leaves.

use std::cell::Cell;
use std::ffi::c_void;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use super::candidate::Candidate;
use super::extent::Extent;
use super::ffi::FilterArguments;
use crate::accel::geometry_ref::GeometryRef;
use crate::geometry::{GeometryKind, Passing, doubles, is_after_start, passing, refine_triangle};

/// Decides which candidates are true hits, and counts the false ones.
pub struct HitValidator<'g> {
    pub geometry: GeometryRef<'g>,
    /// Bounds on the size of each mesh, by geometry id.
    extents: Vec<Extent>,
    /// Number of false hits. Only a false hit touches the counter.
    false_hits: AtomicU64,
}

/// Which of Embree's candidates count as hits.
#[derive(Clone, Copy)]
pub enum HitFilter<'a> {
    /// All candidates but those on the primitive that the ray leaves.
    Leaving,
    /// As [`HitFilter::Leaving`], but only true hits.
    TrueHits(&'a HitValidator<'a>),
    /// No candidate. So Embree visits all candidates along the ray, in any order, and
    /// `ClosestTrueHit` keeps the closest true one.
    ClosestTrueHit(&'a ClosestTrueHit<'a>),
}

impl HitFilter<'_> {
    /// Returns the callback that Embree calls with candidates.
    pub fn function(&self) -> unsafe extern "C" fn(*const FilterArguments) {
        match self {
            Self::Leaving => reject_leaving,
            Self::TrueHits(_) => reject_false,
            Self::ClosestTrueHit(_) => note,
        }
    }

    /// Returns the pointer that the callback gets through the query's context.
    pub fn data(&self) -> *const c_void {
        match *self {
            Self::Leaving => std::ptr::null(),
            Self::TrueHits(truth) => std::ptr::from_ref(truth).cast(),
            Self::ClosestTrueHit(look) => std::ptr::from_ref(look).cast(),
        }
    }
}

impl<'g> HitValidator<'g> {
    pub fn new(geometry: GeometryRef<'g>) -> Self {
        let extents = geometry.meshes.iter().map(Extent::new).collect();
        Self { geometry, extents, false_hits: AtomicU64::new(0) }
    }

    /// Returns the number of candidates found to be false so far.
    pub fn false_hits(&self) -> u64 {
        self.false_hits.load(Ordering::Relaxed)
    }

    /// Returns where the ray passes the triangle or quad of a candidate, or `None` for a false hit.
    ///
    /// A hit is false if the ray misses the triangle by more than the error of Embree's test. It is
    /// also false if the triangle lies behind the surface that the ray leaves. False hits are
    /// counted. Of the halves of a quad, that with the smaller t is returned.
    #[cold]
    pub fn passing(&self, candidate: &Candidate) -> Option<PassedTriangle> {
        // Our own callback tests spheres and calls no filter.
        let triangles = self.geometry.triangles(candidate.geom, candidate.prim);
        let passed = triangles.filter_map(|(corners, turned)| {
            let passing = passing(corners, candidate.origin, candidate.direction)?;
            Some(PassedTriangle { passing, corners, turned })
        });
        let found = passed.reduce(|a, b| if b.passing.t < a.passing.t { b } else { a });
        let Candidate { leaving, origin, direction, .. } = *candidate;
        let behind = |f: &PassedTriangle| {
            self.geometry.is_behind_leaving(leaving, origin, direction, f.corners)
        };
        let found = found.filter(|found| !behind(found));
        if found.is_none() {
            self.false_hits.fetch_add(1, Ordering::Relaxed);
        }
        found
    }

    /// Returns whether an occluding candidate is a true hit.
    #[inline(always)]
    fn holds(&self, candidate: &Candidate) -> bool {
        let extent = self.extents.get(candidate.geom as usize);
        extent.is_some_and(|extent| extent.sure(candidate)) || self.confirms(candidate)
    }

    /// As [`HitValidator::holds`], but reads the triangle. The first test, in f64, confirms nearly
    /// all candidates.
    fn confirms(&self, candidate: &Candidate) -> bool {
        let triangle = match self.geometry.kind(candidate.geom) {
            GeometryKind::Mesh(mesh) => self.geometry.meshes[mesh].corners(candidate.prim),
            _ => self.geometry.quad_half(candidate.prim, candidate.u, candidate.v).0,
        };
        let corners = triangle.map(doubles);
        let Candidate { origin, direction, tnear, tfar, .. } = *candidate;
        let point = refine_triangle(corners, origin, direction, (0.0, 0.0));
        let within = |t: f64| (t > tnear) & (t < tfar);
        if point.met & within(point.t) {
            return is_after_start(corners, origin, direction, point.t);
        }
        // A candidate whose t in f64 lies just outside the segment counts if Embree's t differs
        // from it by no more than the error bound.
        self.passing(candidate)
            .filter(|at| within(at.passing.t) || at.passing.explains(candidate.t))
            .is_some_and(|at| is_after_start(at.corners, origin, direction, at.passing.t))
    }
}

/// A triangle and where a ray passes it.
#[derive(Debug, Clone, Copy)]
pub struct PassedTriangle {
    pub passing: Passing,
    /// Corners of the triangle that was tested, in f64.
    pub corners: [DVec3; 3],
    /// Whether the triangle is the second half of a quad, for which Embree reports 1 - u and 1 - v.
    pub turned: bool,
}

/// Keeps the closest true candidate of one ray.
pub struct ClosestTrueHit<'a> {
    truth: &'a HitValidator<'a>,
    best: Cell<Option<(PassedTriangle, Candidate)>>,
}

impl<'a> ClosestTrueHit<'a> {
    /// Returns a record for one ray, without a candidate.
    pub fn new(truth: &'a HitValidator<'a>) -> Self {
        Self { truth, best: Cell::new(None) }
    }

    /// Returns the closest true candidate so far.
    pub fn best(&self) -> Option<(PassedTriangle, Candidate)> {
        self.best.get()
    }

    /// Keeps the candidate if it is true, lies in (`tnear`, `tfar`) and is nearer than all before.
    /// Of equally near candidates, the lowest (geometry id, primitive index) wins.
    pub fn note(&self, candidate: &Candidate) {
        let Some(found) = self.truth.passing(candidate) else { return };
        let t = found.passing.t;
        let number = |c: &Candidate| (c.geom, c.prim);
        let nearer = self.best.get().is_none_or(|(best_found, best)| {
            let least = best_found.passing.t;
            t < least || (t == least && number(candidate) < number(&best))
        });
        let Candidate { origin, direction, tnear, tfar, .. } = *candidate;
        let within = t > tnear && t < tfar && is_after_start(found.corners, origin, direction, t);
        if nearer && within {
            self.best.set(Some((found, *candidate)));
        }
    }
}

/// Offsets of members in `RTCRayN` and `RTCHitN`, in units of `n` lanes.
const RAY_TNEAR: usize = 3;
const RAY_DIRECTION: usize = 4;
const RAY_TIME: usize = 7;
const RAY_TFAR: usize = 8;
const RAY_ID: usize = 10;
const HIT_U: usize = 3;
const HIT_V: usize = 4;
const HIT_PRIM: usize = 5;
const HIT_GEOM: usize = 6;

/// Rejects hits of the primitive that the ray leaves, and candidates for which `counts` is false.
///
/// # Safety
/// `args` is valid, and the context is our `QueryContext`, whose `bases` has an entry for every
/// attached geometry.
#[inline(always)]
unsafe fn reject(args: &FilterArguments, mut counts: impl FnMut(Candidate) -> bool) {
    // SAFETY: Embree passes `n` valid flags and `n` lanes of every member.
    unsafe {
        let n = args.n as usize;
        for lane in 0..n {
            if *args.valid.add(lane) == 0 {
                continue;
            }
            let ray = |member: usize| *args.ray.add(member * n + lane);
            let hit = |member: usize| *args.hit.add(member * n + lane);
            let (geom, prim) = (hit(HIT_GEOM).to_bits(), hit(HIT_PRIM).to_bits());
            let vector = |first: usize| {
                DVec3::new(ray(first).into(), ray(first + 1).into(), ray(first + 2).into())
            };
            let candidate = Candidate {
                origin: vector(0),
                direction: vector(RAY_DIRECTION),
                normal: DVec3::new(hit(0).into(), hit(1).into(), hit(2).into()),
                tnear: ray(RAY_TNEAR).into(),
                tfar: ray(RAY_TIME).into(),
                t: ray(RAY_TFAR).into(),
                u: hit(HIT_U),
                v: hit(HIT_V),
                prim,
                geom,
                leaving: ray(RAY_ID).to_bits(),
            };
            if candidate.leaving == *(*args.context).bases.add(geom as usize) + prim
                || !counts(candidate)
            {
                *args.valid.add(lane) = 0;
            }
        }
    }
}

unsafe extern "C" fn reject_leaving(args: *const FilterArguments) {
    // SAFETY: Embree passes valid arguments with our context.
    unsafe { reject(&*args, |_| true) }
}

unsafe extern "C" fn reject_false(args: *const FilterArguments) {
    // SAFETY: as above; the context's filter is the `HitValidator` of `HitFilter::TrueHits`.
    unsafe {
        let truth = &*(*(*args).context).filter.cast::<HitValidator>();
        reject(&*args, |candidate| truth.holds(&candidate));
    }
}

unsafe extern "C" fn note(args: *const FilterArguments) {
    // SAFETY: as above; the context's filter is that of `HitFilter::ClosestTrueHit`.
    unsafe {
        let look = &*(*(*args).context).filter.cast::<ClosestTrueHit>();
        reject(&*args, |candidate| {
            look.note(&candidate);
            false
        });
    }
}
