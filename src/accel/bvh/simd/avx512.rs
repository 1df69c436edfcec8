//! AVX-512: a node or a leaf is one vector.

use std::arch::x86_64::*;

use super::super::node::{Block, Node, WIDTH};
use super::super::query::Lane;
use super::{Candidates, EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
use crate::simd::Isa;

/// Proof that this machine has AVX-512.
#[derive(Debug, Clone, Copy)]
pub struct Avx512(());

impl Avx512 {
    /// The tier, if this machine runs it.
    pub fn new() -> Option<Self> {
        (Isa::detect() >= Isa::Avx512).then_some(Self(()))
    }
}

/// One ray's value in all lanes.
///
/// # Safety
/// AVX-512 F.
#[inline(always)]
unsafe fn all(lane: &Lane, member: &[f32; WIDTH]) -> __m512 {
    // SAFETY: the caller's promise.
    unsafe { _mm512_set1_ps(lane.of(member)) }
}

/// Distances at which the ray enters and leaves the children's boxes. `max` and `min` return their
/// second operand if either is NaN: a NaN prunes nothing.
///
/// # Safety
/// AVX-512 F.
#[inline(always)]
unsafe fn slabs(node: &Node, lane: &Lane, tfar: f32) -> (__m512, __m512) {
    // SAFETY: rows are below 6 and hold 16 aligned f32; the caller has AVX-512.
    unsafe {
        let q = lane.query;
        let row = |i: usize| _mm512_load_ps(node.planes.as_ptr().add(i).cast());
        let enter = |axis: usize| {
            let (inverse, offset) = (&q.near_inverse[axis], &q.near_offset[axis]);
            _mm512_fmsub_ps(row(lane.enter[axis]), all(lane, inverse), all(lane, offset))
        };
        let leave = |axis: usize| {
            let (inverse, offset) = (&q.far_inverse[axis], &q.far_offset[axis]);
            _mm512_fmsub_ps(row(lane.leave[axis]), all(lane, inverse), all(lane, offset))
        };
        let near = _mm512_max_ps(enter(0), all(lane, &q.tnear));
        let far = _mm512_min_ps(leave(0), _mm512_set1_ps(tfar));
        let near = _mm512_max_ps(enter(2), _mm512_max_ps(enter(1), near));
        let far = _mm512_min_ps(leave(2), _mm512_min_ps(leave(1), far));
        (near, far)
    }
}

/// # Safety
/// AVX-512 F.
#[inline(always)]
unsafe fn push(stack: &mut Stack, mask: __mmask16, children: __m512i, near: __m512) {
    let (to_children, to_distances) = stack.room();
    // SAFETY: there is room for 16 entries, of which the first ones are kept.
    unsafe {
        _mm512_storeu_si512(to_children.cast(), _mm512_maskz_compress_epi32(mask, children));
        _mm512_storeu_ps(to_distances, _mm512_maskz_compress_ps(mask, near));
        stack.grow(mask.count_ones() as usize);
    }
}

impl Tier for Avx512 {
    #[inline(always)]
    fn push_ordered(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) {
        // SAFETY: `self` proves AVX-512; the children are 16 aligned u32.
        unsafe {
            let (near, far) = slabs(node, lane, tfar);
            let shifts =
                _mm512_setr_epi32(0, 0, 4, 4, 8, 8, 12, 12, 16, 16, 20, 20, 24, 24, 28, 28);
            let order = _mm512_set1_epi64(node.order[lane.octant % 8] as i64);
            // A permutation reads the low 4 bits of each lane only.
            let order = _mm512_srlv_epi32(order, shifts);
            let children = _mm512_load_si512(node.children.as_ptr().cast());
            let near = _mm512_permutexvar_ps(order, near);
            let far = _mm512_permutexvar_ps(order, far);
            let children = _mm512_permutexvar_epi32(order, children);
            let mask = _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(near, far);
            push(stack, mask, children, near);
        }
    }

    #[inline(always)]
    fn push_any(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) {
        // SAFETY: as above.
        unsafe {
            let (near, far) = slabs(node, lane, tfar);
            let children = _mm512_load_si512(node.children.as_ptr().cast());
            push(stack, _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(near, far), children, near);
        }
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        let q = lane.query;
        // SAFETY: `self` proves AVX-512; axes are below 3; rows hold 16 aligned f32 or 16 bytes.
        unsafe {
            let row =
                |k: usize| _mm512_load_ps(block.vertices.as_ptr().add(lane.axes[k]).cast());
            let depth = _mm512_sub_ps(row(2), all(lane, &q.origin[2]));
            let sheared = |k: usize| {
                let relative = _mm512_sub_ps(row(k), all(lane, &q.origin[k]));
                _mm512_sub_ps(relative, _mm512_mul_ps(all(lane, &q.shear[k]), depth))
            };
            let (x, y) = (sheared(0), sheared(1));
            let corner =
                |k: usize| _mm512_cvtepu8_epi32(_mm_load_si128(block.corners[k].as_ptr().cast()));
            let (a, b, c) = (corner(0), corner(1), corner(2));
            let of = |index: __m512i, v: __m512| _mm512_permutexvar_ps(index, v);
            let ((ax, ay), (bx, by), (cx, cy)) =
                ((of(a, x), of(a, y)), (of(b, x), of(b, y)), (of(c, x), of(c, y)));
            let (q0, q1, q2) =
                (_mm512_mul_ps(cy, bx), _mm512_mul_ps(ay, cx), _mm512_mul_ps(by, ax));
            let u = _mm512_fmsub_ps(cx, by, q0);
            let v = _mm512_fmsub_ps(ax, cy, q1);
            let w = _mm512_fmsub_ps(bx, ay, q2);
            let largest = _mm512_max_ps(
                _mm512_max_ps(_mm512_abs_ps(q0), _mm512_abs_ps(q1)),
                _mm512_abs_ps(q2),
            );
            let (scale, floor) = (_mm512_set1_ps(EDGE_SLACK), _mm512_set1_ps(EDGE_FLOOR));
            let slack = _mm512_fmadd_ps(largest, scale, floor);
            let minus = _mm512_fnmsub_ps(largest, scale, floor);
            let least = _mm512_min_ps(_mm512_min_ps(u, v), w);
            let most = _mm512_max_ps(_mm512_max_ps(u, v), w);
            let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(least, minus);
            let misses = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(negative, most, slack);
            let maybe = !misses & block.present;
            if maybe == 0 {
                return Candidates { maybe: 0, sure: 0 };
            }
            let sign = _mm512_and_ps(all(lane, &q.along), _mm512_set1_ps(-0.0));
            let z = _mm512_xor_ps(depth, sign);
            let (az, bz, cz) = (of(a, z), of(b, z), of(c, z));
            let last = _mm512_max_ps(_mm512_max_ps(az, bz), cz);
            let first = _mm512_min_ps(_mm512_min_ps(az, bz), cz);
            let end = _mm512_set1_ps(lane.depth(tfar));
            let ahead = _mm512_mask_cmp_ps_mask::<_CMP_NLT_UQ>(maybe, last, _mm512_setzero_ps());
            let maybe = _mm512_mask_cmp_ps_mask::<_CMP_NGT_UQ>(ahead, first, end);
            let sure = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(least, slack)
                | _mm512_cmp_ps_mask::<_CMP_LT_OQ>(most, minus);
            Candidates { maybe: maybe.into(), sure: (maybe & sure).into() }
        }
    }
}

const _: () = assert!(WIDTH == 16);
