//! AVX-512: a node or a leaf is one vector.

use std::arch::x86_64::*;

use super::super::node::{Block, Node, WIDTH};
use super::super::query::Lane;
use super::{EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
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

/// Distances at which the ray enters and leaves the children's boxes. `max` and `min` return their
/// second operand if either is NaN: a NaN prunes nothing.
///
/// # Safety
/// AVX-512 F.
#[inline(always)]
unsafe fn slabs(node: &Node, lane: &Lane) -> (__m512, __m512) {
    // SAFETY: rows are below 6 and hold 16 aligned f32; the caller has AVX-512.
    unsafe {
        let (mut near, mut far) = (_mm512_set1_ps(lane.tnear), _mm512_set1_ps(lane.tfar));
        for axis in 0..3 {
            let (enter, leave) = lane.rows(axis);
            let t0 = _mm512_fmsub_ps(
                _mm512_load_ps(node.planes.get_unchecked(enter).as_ptr()),
                _mm512_set1_ps(lane.near_inverse[axis]),
                _mm512_set1_ps(lane.near_offset[axis]),
            );
            let t1 = _mm512_fmsub_ps(
                _mm512_load_ps(node.planes.get_unchecked(leave).as_ptr()),
                _mm512_set1_ps(lane.far_inverse[axis]),
                _mm512_set1_ps(lane.far_offset[axis]),
            );
            near = _mm512_max_ps(t0, near);
            far = _mm512_min_ps(t1, far);
        }
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
    fn push_ordered(self, node: &Node, lane: &Lane, stack: &mut Stack) {
        // SAFETY: `self` proves AVX-512; the children are 16 aligned u32.
        unsafe {
            let (near, far) = slabs(node, lane);
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
    fn push_any(self, node: &Node, lane: &Lane, stack: &mut Stack) {
        // SAFETY: as above.
        unsafe {
            let (near, far) = slabs(node, lane);
            let children = _mm512_load_si512(node.children.as_ptr().cast());
            push(stack, _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(near, far), children, near);
        }
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane) -> u32 {
        // SAFETY: `self` proves AVX-512; axes are below 3; rows hold 16 aligned f32 or 16 bytes.
        unsafe {
            let row =
                |k: usize| _mm512_load_ps(block.vertices.get_unchecked(lane.axes[k]).as_ptr());
            let depth = _mm512_sub_ps(row(2), _mm512_set1_ps(lane.origin[2]));
            let sheared = |k: usize| {
                let relative = _mm512_sub_ps(row(k), _mm512_set1_ps(lane.origin[k]));
                _mm512_sub_ps(relative, _mm512_mul_ps(_mm512_set1_ps(lane.shear[k]), depth))
            };
            let (x, y) = (sheared(0), sheared(1));
            let corner = |k: usize| {
                let bytes = _mm_load_si128(block.corners[k].as_ptr().cast());
                let index = _mm512_cvtepu8_epi32(bytes);
                (_mm512_permutexvar_ps(index, x), _mm512_permutexvar_ps(index, y))
            };
            let ((ax, ay), (bx, by), (cx, cy)) = (corner(0), corner(1), corner(2));
            let (q0, q1, q2) =
                (_mm512_mul_ps(cy, bx), _mm512_mul_ps(ay, cx), _mm512_mul_ps(by, ax));
            let u = _mm512_fmsub_ps(cx, by, q0);
            let v = _mm512_fmsub_ps(ax, cy, q1);
            let w = _mm512_fmsub_ps(bx, ay, q2);
            let largest = _mm512_max_ps(
                _mm512_max_ps(_mm512_abs_ps(q0), _mm512_abs_ps(q1)),
                _mm512_abs_ps(q2),
            );
            let slack =
                _mm512_fmadd_ps(largest, _mm512_set1_ps(EDGE_SLACK), _mm512_set1_ps(EDGE_FLOOR));
            let least = _mm512_min_ps(_mm512_min_ps(u, v), w);
            let most = _mm512_max_ps(_mm512_max_ps(u, v), w);
            // NaN (an overflow) misses nothing: one of the comparisons is false... of `slack`.
            let negative =
                _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_add_ps(least, slack), _mm512_setzero_ps());
            let misses = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(negative, most, slack);
            u32::from(!misses & block.present)
        }
    }
}

const _: () = assert!(WIDTH == 16);
