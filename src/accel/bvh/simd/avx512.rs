//! Kernels for AVX-512. A node or a leaf is one vector of 16 lanes.

// build.rs compiles this file only if the compiler has these functions.
#![allow(clippy::incompatible_msrv)]

use std::arch::x86_64::*;

use super::super::frustum::{Frustum, HorizontalMin, Side};
use super::super::node::{Block, Child, Node, WIDTH};
use super::super::query::{Lane, Slabs};
use super::{Candidates, EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
use crate::ray::Mask;
use crate::simd::{Isa, Kernel, run_avx512};

/// The AVX-512 [`Tier`]. A value is the proof that this machine supports AVX-512.
#[derive(Debug, Clone, Copy)]
pub struct Avx512(());

impl Avx512 {
    /// Returns the tier if this machine supports it.
    pub fn new() -> Option<Self> {
        (Isa::detect() >= Isa::Avx512).then_some(Self(()))
    }
}

/// Returns one ray's value in all lanes.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn all(lane: &Lane, member: &[f32; WIDTH]) -> __m512 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_set1_ps(lane.value(member)) }
}

/// Returns the scaled ray parameters at one row of planes.
///
/// # Safety
/// The processor must support AVX-512 F, and `row < 6`.
#[inline(always)]
unsafe fn plane(node: &Node, row: usize, inverse: f32, offset: f32) -> __m512 {
    // SAFETY: reads 16 aligned f32; the caller guarantees the rest.
    unsafe {
        _mm512_fmsub_ps(self::row(node, row), _mm512_set1_ps(inverse), _mm512_set1_ps(offset))
    }
}

/// Returns one coordinate of a leaf's vertices.
///
/// # Safety
/// The processor must support AVX-512 F, and `axis < 3`.
#[inline(always)]
unsafe fn coordinate(block: &Block, axis: usize) -> __m512 {
    // SAFETY: reads 16 aligned f32; the caller guarantees the rest.
    unsafe { _mm512_load_ps(block.vertices.as_ptr().add(axis).cast()) }
}

/// Returns the vertex indices of the corners of a leaf's triangles, with meaningless higher bits.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn corners(block: &Block) -> [__m512i; 3] {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let [a, b, c] = &block.corners;
        [unpacked(a), unpacked(b), unpacked(c)]
    }
}

/// Returns 16 numbers of 4 bits, with meaningless higher bits.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn unpacked(row: &[u8; WIDTH / 2]) -> __m512i {
    // SAFETY: reads the 8 bytes of the row; the caller guarantees the rest.
    unsafe {
        let low = _mm_loadl_epi64(row.as_ptr().cast());
        _mm512_cvtepu8_epi32(_mm_unpacklo_epi64(low, _mm_srli_epi64::<4>(low)))
    }
}

/// Returns the values `v` of the vertices at the corners of the triangles. A permutation reads only
/// the low 4 bits of each index.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn at(corners: &[__m512i; 3], v: __m512) -> [__m512; 3] {
    // SAFETY: guaranteed by the caller.
    unsafe {
        [
            _mm512_permutexvar_ps(corners[0], v),
            _mm512_permutexvar_ps(corners[1], v),
            _mm512_permutexvar_ps(corners[2], v),
        ]
    }
}

/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn min3([a, b, c]: [__m512; 3]) -> __m512 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_min_ps(_mm512_min_ps(a, b), c) }
}

/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn max3([a, b, c]: [__m512; 3]) -> __m512 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_max_ps(_mm512_max_ps(a, b), c) }
}

/// Returns the coordinates of the sheared vertices along axis `k`, relative to the ray.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn sheared(block: &Block, lane: &Lane, k: usize, depth: __m512) -> __m512 {
    // SAFETY: axes are below 3; the caller guarantees the rest.
    unsafe {
        let q = lane.query;
        let relative = _mm512_sub_ps(coordinate(block, lane.axes[k]), all(lane, &q.origin[k]));
        _mm512_sub_ps(relative, _mm512_mul_ps(all(lane, &q.shear[k]), depth))
    }
}

/// Returns the coordinate of a side plane of a frustum at depths `z`.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn side(side: &Side, z: __m512) -> __m512 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_fmadd_ps(_mm512_set1_ps(side.b), z, _mm512_set1_ps(side.a)) }
}

/// Returns `flags` with `flag` added in the lanes of `mask`.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn with(flags: __m512i, mask: __mmask16, flag: i32) -> __m512i {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm512_mask_or_epi32(flags, mask, flags, _mm512_set1_epi32(flag)) }
}

/// Returns a row of a node's planes.
///
/// # Safety
/// The processor must support AVX-512 F, and `row < 6`.
#[inline(always)]
unsafe fn row(node: &Node, row: usize) -> __m512 {
    // SAFETY: reads 16 aligned f32; the caller guarantees the rest.
    unsafe { _mm512_load_ps(node.planes.as_ptr().add(row).cast()) }
}

/// Returns the scaled ray parameters at which the ray enters and leaves the children's boxes. `max`
/// and `min` return their second operand if either is NaN, so NaN prunes nothing.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn slabs(node: &Node, ray: &Slabs, tfar: f32) -> (__m512, __m512) {
    // SAFETY: rows are below 6; the caller guarantees the rest.
    unsafe {
        let near = _mm512_set1_ps(ray.tnear);
        let far = _mm512_set1_ps(tfar);
        let [n0, n1, n2] = [
            plane(node, ray.enter[0], ray.near_inverse[0], ray.near_offset[0]),
            plane(node, ray.enter[1], ray.near_inverse[1], ray.near_offset[1]),
            plane(node, ray.enter[2], ray.near_inverse[2], ray.near_offset[2]),
        ];
        let [f0, f1, f2] = [
            plane(node, ray.leave[0], ray.far_inverse[0], ray.far_offset[0]),
            plane(node, ray.leave[1], ray.far_inverse[1], ray.far_offset[1]),
            plane(node, ray.leave[2], ray.far_inverse[2], ray.far_offset[2]),
        ];
        let near = _mm512_max_ps(n2, _mm512_max_ps(n1, _mm512_max_ps(n0, near)));
        let far = _mm512_min_ps(f2, _mm512_min_ps(f1, _mm512_min_ps(f0, far)));
        (near, far)
    }
}

/// Returns the slots of the children in the order of an octant, from far to near. Only the low 4
/// bits of a lane are the slot, and a permutation reads only these.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn order(node: &Node, octant: usize) -> __m512i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let shifts = _mm512_setr_epi32(0, 0, 4, 4, 8, 8, 12, 12, 16, 16, 20, 20, 24, 24, 28, 28);
        _mm512_srlv_epi32(_mm512_set1_epi64(node.order[octant % 8] as i64), shifts)
    }
}

/// Pushes the children in the lanes of `mask`, with their distances `near`.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn push(stack: &mut Stack, mask: __mmask16, children: __m512i, near: __m512) {
    let (to_children, to_distances) = stack.room();
    // SAFETY: there is room for 16 entries. Only the first ones are kept, and they are initialised.
    unsafe {
        _mm512_storeu_si512(to_children.cast(), _mm512_maskz_compress_epi32(mask, children));
        _mm512_storeu_ps(to_distances, _mm512_maskz_compress_ps(mask, near));
        stack.grow(mask.count_ones() as usize);
    }
}

/// Returns the lane-wise minimum of the two halves of each of two rows: 8 lanes of `a`, then 8 of
/// `b`.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn halves(a: &[f32; WIDTH], b: &[f32; WIDTH]) -> __m512 {
    // SAFETY: reads 16 f32 each; the caller guarantees the rest.
    unsafe {
        let (a, b) = (_mm512_loadu_ps(a.as_ptr()), _mm512_loadu_ps(b.as_ptr()));
        let low = _mm512_shuffle_f32x4::<0b01_00_01_00>(a, b);
        _mm512_min_ps(low, _mm512_shuffle_f32x4::<0b11_10_11_10>(a, b))
    }
}

/// Reduces two results of [`halves`] once more, to 4 lanes for each of the four rows.
///
/// # Safety
/// The processor must support AVX-512 F.
#[inline(always)]
unsafe fn quarters(a: __m512, b: __m512) -> __m512 {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let even = _mm512_shuffle_f32x4::<0b10_00_10_00>(a, b);
        _mm512_min_ps(even, _mm512_shuffle_f32x4::<0b11_01_11_01>(a, b))
    }
}

impl HorizontalMin for Avx512 {
    #[inline(always)]
    fn horizontal_min(self, v: &[f32; WIDTH]) -> f32 {
        // SAFETY: `self` proves AVX-512; reads 16 f32.
        unsafe { _mm512_reduce_min_ps(_mm512_loadu_ps(v.as_ptr())) }
    }

    #[inline(always)]
    fn horizontal_min_rows(self, rows: &[[f32; WIDTH]; 8]) -> [f32; 8] {
        // SAFETY: `self` proves AVX-512; reads 16 f32 of each row; writes the 8 f32 of the result.
        unsafe {
            let a = quarters(halves(&rows[0], &rows[1]), halves(&rows[2], &rows[3]));
            let b = quarters(halves(&rows[4], &rows[5]), halves(&rows[6], &rows[7]));
            let both = _mm512_min_ps(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
            let both = _mm512_min_ps(both, _mm512_shuffle_ps::<0b01_00_11_10>(both, both));
            let order = _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 0, 0, 0, 0, 0, 0, 0, 0);
            let mut lowest = [0.0; 8];
            let found = _mm512_castps512_ps256(_mm512_permutexvar_ps(order, both));
            _mm256_storeu_ps(lowest.as_mut_ptr(), found);
            lowest
        }
    }
}

impl Tier for Avx512 {
    const FUSED: bool = true;

    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        // SAFETY: `self` proves that `Isa::detect` has found every feature of this instruction set.
        unsafe { run_avx512(kernel) }
    }

    #[inline(always)]
    fn first_in_order(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child {
        // SAFETY: `self` proves AVX-512; the children are 16 aligned u32.
        unsafe {
            let (near, far) = slabs(node, &lane.slabs(), tfar);
            let order = order(node, lane.octant);
            let near = _mm512_permutexvar_ps(order, near);
            let far = _mm512_permutexvar_ps(order, far);
            let mask = _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(near, far);
            let Some(place) = u32::from(mask).checked_ilog2() else { return Child::EMPTY };
            let others = mask ^ (1 << place);
            if others != 0 {
                let children = _mm512_load_si512(node.children.as_ptr().cast());
                push(stack, others, _mm512_permutexvar_epi32(order, children), near);
            }
            node.children[node.ordered(lane.octant, place as usize)]
        }
    }

    #[inline(always)]
    fn hit_children(self, node: &Node, lane: &Lane, tfar: f32) -> u32 {
        // SAFETY: `self` proves AVX-512.
        unsafe {
            let (near, far) = slabs(node, &lane.slabs(), tfar);
            _mm512_cmp_ps_mask::<_CMP_NGT_UQ>(near, far).into()
        }
    }

    #[inline(always)]
    fn children_in_frustum(self, node: &Node, frustum: &Frustum, end: f32) -> u32 {
        let ([kx, ky, _], [low_x, low_y], [high_x, high_y]) =
            (frustum.axes, frustum.low(), frustum.high());
        // SAFETY: `self` proves AVX-512; axes are below 3, rows below 6.
        unsafe {
            let sign = _mm512_and_ps(_mm512_set1_ps(frustum.forward), _mm512_set1_ps(-0.0));
            let enter = _mm512_xor_ps(row(node, frustum.enter), sign);
            let leave = _mm512_xor_ps(row(node, frustum.leave), sign);
            let outside = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(enter, _mm512_set1_ps(end))
                | _mm512_cmp_ps_mask::<_CMP_LT_OQ>(leave, _mm512_set1_ps(frustum.start))
                | _mm512_cmp_ps_mask::<_CMP_LT_OQ>(
                    row(node, kx + 3),
                    side(&low_x, row(node, low_x.row)),
                )
                | _mm512_cmp_ps_mask::<_CMP_GT_OQ>(
                    row(node, kx),
                    side(&high_x, row(node, high_x.row)),
                )
                | _mm512_cmp_ps_mask::<_CMP_LT_OQ>(
                    row(node, ky + 3),
                    side(&low_y, row(node, low_y.row)),
                )
                | _mm512_cmp_ps_mask::<_CMP_GT_OQ>(
                    row(node, ky),
                    side(&high_y, row(node, high_y.row)),
                );
            let places =
                _mm512_permutexvar_epi32(order(node, frustum.octant), _mm512_movm_epi32(outside));
            (!_mm512_movepi32_mask(places)).into()
        }
    }

    #[inline(always)]
    fn triangles_in_frustum(self, block: &Block, frustum: &Frustum, end: f32) -> u32 {
        let ([kx, ky, kz], [low_x, low_y], [high_x, high_y]) =
            (frustum.axes, frustum.low(), frustum.high());
        // SAFETY: `self` proves AVX-512; axes are below 3.
        unsafe {
            let (x, y) = (coordinate(block, kx), coordinate(block, ky));
            let z = coordinate(block, kz);
            let sign = _mm512_and_ps(_mm512_set1_ps(frustum.forward), _mm512_set1_ps(-0.0));
            let depth = _mm512_xor_ps(z, sign);
            let below = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(x, side(&low_x, z));
            let flags = with(_mm512_setzero_si512(), below, 1);
            let flags = with(flags, _mm512_cmp_ps_mask::<_CMP_GT_OQ>(x, side(&high_x, z)), 2);
            let flags = with(flags, _mm512_cmp_ps_mask::<_CMP_LT_OQ>(y, side(&low_y, z)), 4);
            let flags = with(flags, _mm512_cmp_ps_mask::<_CMP_GT_OQ>(y, side(&high_y, z)), 8);
            let start = _mm512_set1_ps(frustum.start);
            let flags = with(flags, _mm512_cmp_ps_mask::<_CMP_LT_OQ>(depth, start), 16);
            let end = _mm512_set1_ps(end);
            let flags = with(flags, _mm512_cmp_ps_mask::<_CMP_GT_OQ>(depth, end), 32);
            let [a, b, c] = corners(block);
            let a = _mm512_permutexvar_epi32(a, flags);
            let b = _mm512_permutexvar_epi32(b, flags);
            let c = _mm512_permutexvar_epi32(c, flags);
            let common = _mm512_ternarylogic_epi32::<0x80>(a, b, c);
            let astride = _mm512_testn_epi32_mask(common, common);
            u32::from(astride & block.present)
        }
    }

    #[inline(always)]
    fn bits(self, mask: &Mask) -> u32 {
        // SAFETY: `self` proves AVX-512; reads 16 i32.
        unsafe { _mm512_movepi32_mask(_mm512_loadu_si512(mask.0.as_ptr().cast())).into() }
    }

    #[inline(always)]
    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32 {
        // SAFETY: `self` proves AVX-512; reads 16 f32 each.
        unsafe {
            let (a, b) = (_mm512_loadu_ps(a.as_ptr()), _mm512_loadu_ps(b.as_ptr()));
            _mm512_cmp_ps_mask::<_CMP_LE_OQ>(a, b).into()
        }
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        let q = lane.query;
        // SAFETY: `self` proves AVX-512; axes are below 3.
        unsafe {
            let depth = _mm512_sub_ps(coordinate(block, lane.axes[2]), all(lane, &q.origin[2]));
            let corners = corners(block);
            let [ax, bx, cx] = at(&corners, sheared(block, lane, 0, depth));
            let [ay, by, cy] = at(&corners, sheared(block, lane, 1, depth));
            let (q0, q1, q2) =
                (_mm512_mul_ps(cy, bx), _mm512_mul_ps(ay, cx), _mm512_mul_ps(by, ax));
            let u = _mm512_fmsub_ps(cx, by, q0);
            let v = _mm512_fmsub_ps(ax, cy, q1);
            let w = _mm512_fmsub_ps(bx, ay, q2);
            let largest = max3([_mm512_abs_ps(q0), _mm512_abs_ps(q1), _mm512_abs_ps(q2)]);
            let (scale, floor) = (_mm512_set1_ps(EDGE_SLACK), _mm512_set1_ps(EDGE_FLOOR));
            let slack = _mm512_fmadd_ps(largest, scale, floor);
            let minus = _mm512_fnmsub_ps(largest, scale, floor);
            let (lowest, highest) = (min3([u, v, w]), max3([u, v, w]));
            let negative = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(lowest, minus);
            let misses = _mm512_mask_cmp_ps_mask::<_CMP_GT_OQ>(negative, highest, slack);
            let maybe = !misses & block.present;
            if maybe == 0 {
                return Candidates { maybe: 0, sure: 0 };
            }
            let sign = _mm512_and_ps(all(lane, &q.dominant_component), _mm512_set1_ps(-0.0));
            let z = _mm512_xor_ps(depth, sign);
            let depths = at(&corners, z);
            let (first, last) = (min3(depths), max3(depths));
            let end = _mm512_set1_ps(lane.depth(tfar));
            let ahead = _mm512_mask_cmp_ps_mask::<_CMP_NLT_UQ>(maybe, last, _mm512_setzero_ps());
            let maybe = _mm512_mask_cmp_ps_mask::<_CMP_NGT_UQ>(ahead, first, end);
            let sure = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(lowest, slack)
                | _mm512_cmp_ps_mask::<_CMP_LT_OQ>(highest, minus);
            Candidates { maybe: maybe.into(), sure: (maybe & sure).into() }
        }
    }
}

const _: () = assert!(WIDTH == 16);
