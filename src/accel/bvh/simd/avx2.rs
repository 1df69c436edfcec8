//! Kernels for AVX2 and FMA. The 16 children of a node, or the 16 vertices of a leaf, fill two
//! vectors of 8 lanes.

use std::arch::x86_64::*;

use super::super::frustum::{Frustum, HorizontalMin, Side};
use super::super::node::{Block, Child, Node, WIDTH};
use super::super::query::{Lane, Slabs};
use super::{Candidates, EDGE_FLOOR, EDGE_SLACK, Stack, Tier};
use crate::ray::Mask;
use crate::simd::{Isa, Kernel, run_avx2};

/// The AVX2 [`Tier`]. A value is the proof that this machine supports AVX2 and FMA.
#[derive(Debug, Clone, Copy)]
pub struct Avx2(());

impl Avx2 {
    /// Returns the tier if this machine supports it.
    pub fn new() -> Option<Self> {
        (Isa::detect() >= Isa::Avx2).then_some(Self(()))
    }
}

/// Number of lanes of a vector: half of [`WIDTH`].
const HALF: usize = WIDTH / 2;

/// 16 lanes as two vectors.
type Pair = [__m256; 2];

/// For each mask of 8 lanes, the indices of the lanes that are set, one byte each. A byte shuffle
/// reads the filler 0x80 as zero.
static SET_LANES: [u64; 256] = set_lanes();

const fn set_lanes() -> [u64; 256] {
    let mut table = [u64::from_le_bytes([0x80; HALF]); 256];
    let mut mask = 0;
    while mask < table.len() {
        let (mut bytes, mut lane, mut n) = ([0x80; HALF], 0, 0);
        while lane < HALF {
            if (mask >> lane) & 1 != 0 {
                bytes[n] = lane as u8;
                n += 1;
            }
            lane += 1;
        }
        table[mask] = u64::from_le_bytes(bytes);
        mask += 1;
    }
    table
}

/// Returns the indices of the lanes that are set in a mask, in the low 8 bytes.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn lanes(mask: u32) -> __m128i {
    // SAFETY: reads 8 bytes; the caller guarantees the rest.
    unsafe { _mm_loadl_epi64(SET_LANES.as_ptr().add(mask as usize % SET_LANES.len()).cast()) }
}

/// Returns the value of one ray, from the array `member` of its query, in all 8 lanes.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn all(lane: &Lane, member: &[f32; WIDTH]) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_set1_ps(lane.value(member)) }
}

/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn min3(a: __m256, b: __m256, c: __m256) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_min_ps(_mm256_min_ps(a, b), c) }
}

/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn max3(a: __m256, b: __m256, c: __m256) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_max_ps(_mm256_max_ps(a, b), c) }
}

/// Selects 8 of 16 lanes by index: bits 0 to 2 are the lane, bit 3 is the half.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn pick([low, high]: Pair, index: __m256i) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let (low, high) =
            (_mm256_permutevar8x32_ps(low, index), _mm256_permutevar8x32_ps(high, index));
        _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index)))
    }
}

/// Converts 16 signed integers of 32 bits to signed bytes, with saturation.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn bytes([low, high]: Pair) -> __m128i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        // Packing works within halves of 128 bits, so the last shuffle restores the order.
        let words = _mm256_packs_epi32(_mm256_castps_si256(low), _mm256_castps_si256(high));
        let bytes =
            _mm_packs_epi16(_mm256_castsi256_si128(words), _mm256_extracti128_si256::<1>(words));
        _mm_shuffle_epi32::<0b11_01_10_00>(bytes)
    }
}

/// Returns `flag` in the lanes where a comparison holds, else 0.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn flag(holds: __m256, flag: i32) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_and_ps(holds, _mm256_castsi256_ps(_mm256_set1_epi32(flag))) }
}

/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn or4(a: __m256, b: __m256, c: __m256, d: __m256) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_or_ps(_mm256_or_ps(a, b), _mm256_or_ps(c, d)) }
}

/// Returns the scaled ray parameters at which a ray crosses one row of [`Node::planes`], for half
/// of the children.
///
/// # Safety
/// The processor must support AVX2 and FMA, `row < 6`, and `half < 2`.
#[inline(always)]
unsafe fn plane(node: &Node, (row, half): (usize, usize), inverse: f32, offset: f32) -> __m256 {
    // SAFETY: reads 8 aligned f32; the caller guarantees the rest.
    unsafe {
        let planes = self::row(node, row, half);
        _mm256_fmsub_ps(planes, _mm256_set1_ps(inverse), _mm256_set1_ps(offset))
    }
}

/// Returns the scaled ray parameters at which the ray enters the boxes of half of the children, at
/// least `tnear`, and the mask of the boxes that it enters before `tfar`. `max` and `min` return
/// their second operand if either is NaN, so NaN prunes nothing.
///
/// # Safety
/// The processor must support AVX2 and FMA, and `half < 2`.
#[inline(always)]
unsafe fn slabs(node: &Node, ray: &Slabs, tfar: f32, half: usize) -> (__m256, __m256) {
    // SAFETY: rows are below 6; the caller guarantees the rest.
    unsafe {
        let ([x, y, z], i, o) = (ray.enter, &ray.near_inverse, &ray.near_offset);
        let near = _mm256_set1_ps(ray.tnear);
        let near = _mm256_max_ps(plane(node, (x, half), i[0], o[0]), near);
        let near = _mm256_max_ps(plane(node, (y, half), i[1], o[1]), near);
        let near = _mm256_max_ps(plane(node, (z, half), i[2], o[2]), near);
        let ([x, y, z], i, o) = (ray.leave, &ray.far_inverse, &ray.far_offset);
        let far = _mm256_set1_ps(tfar);
        let far = _mm256_min_ps(plane(node, (x, half), i[0], o[0]), far);
        let far = _mm256_min_ps(plane(node, (y, half), i[1], o[1]), far);
        let far = _mm256_min_ps(plane(node, (z, half), i[2], o[2]), far);
        (near, _mm256_cmp_ps::<_CMP_NGT_UQ>(near, far))
    }
}

/// Returns the slots of the children in the order of an octant, from far to near, one byte each:
/// see [`Node::set_order`].
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn order(node: &Node, octant: usize) -> __m128i {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let packed = _mm_cvtsi64_si128(node.order[octant % 8] as i64);
        let nibble = _mm_set1_epi8(15);
        let low = _mm_and_si128(packed, nibble);
        let high = _mm_and_si128(_mm_srli_epi64::<4>(packed), nibble);
        let even_then_odd = _mm_unpacklo_epi8(low, high);
        _mm_unpacklo_epi8(even_then_odd, _mm_unpackhi_epi64(even_then_odd, even_then_odd))
    }
}

/// Returns the children of a node.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn children(node: &Node) -> Pair {
    // SAFETY: reads 16 aligned values of 32 bits; the caller guarantees the rest.
    unsafe {
        let children: *const f32 = node.children.as_ptr().cast();
        [_mm256_load_ps(children), _mm256_load_ps(children.add(HALF))]
    }
}

/// Returns one coordinate of half of a leaf's vertices.
///
/// # Safety
/// The processor must support AVX2, `axis < 3`, and `half < 2`.
#[inline(always)]
unsafe fn coordinate(block: &Block, axis: usize, half: usize) -> __m256 {
    // SAFETY: reads 8 aligned f32; the caller guarantees the rest.
    unsafe {
        let row: *const f32 = block.vertices.as_ptr().add(axis).cast();
        _mm256_load_ps(row.add(HALF * half))
    }
}

/// Returns 16 numbers of 4 bits as bytes.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn unpacked(row: &[u8; HALF]) -> __m128i {
    // SAFETY: reads the 8 bytes of the row; the caller guarantees the rest.
    unsafe {
        let low = _mm_loadl_epi64(row.as_ptr().cast());
        let both = _mm_unpacklo_epi64(low, _mm_srli_epi64::<4>(low));
        _mm_and_si128(both, _mm_set1_epi8(15))
    }
}

/// Returns the triangles whose three corners have no common flag, as bits. Each flag marks the
/// vertices outside one plane.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn astride(block: &Block, flags: Pair) -> u32 {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let flags = bytes(flags);
        let [a, b, c] = &block.corners;
        let a = _mm_shuffle_epi8(flags, unpacked(a));
        let b = _mm_shuffle_epi8(flags, unpacked(b));
        let c = _mm_shuffle_epi8(flags, unpacked(c));
        let common = _mm_and_si128(_mm_and_si128(a, b), c);
        let none = _mm_cmpeq_epi8(common, _mm_setzero_si128());
        _mm_movemask_epi8(none) as u32 & u32::from(block.present)
    }
}

/// Returns the coordinate of a side plane of a frustum at depths `z`.
///
/// # Safety
/// The processor must support AVX2 and FMA.
#[inline(always)]
unsafe fn side(side: &Side, z: __m256) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe { _mm256_fmadd_ps(_mm256_set1_ps(side.b), z, _mm256_set1_ps(side.a)) }
}

/// Returns half of a row of a node's planes.
///
/// # Safety
/// The processor must support AVX2, `row < 6`, and `half < 2`.
#[inline(always)]
unsafe fn row(node: &Node, row: usize, half: usize) -> __m256 {
    // SAFETY: reads 8 aligned f32; the caller guarantees the rest.
    unsafe {
        let row: *const f32 = node.planes.as_ptr().add(row).cast();
        _mm256_load_ps(row.add(HALF * half))
    }
}

/// Tests half of the children: all bits set if a box lies outside a frustum, or beyond `end`.
///
/// # Safety
/// The processor must support AVX2 and FMA, and `half < 2`.
#[inline(always)]
unsafe fn outside(node: &Node, frustum: &Frustum, end: f32, half: usize) -> __m256 {
    let ([kx, ky, _], [low_x, low_y], [high_x, high_y]) =
        (frustum.axes, frustum.low(), frustum.high());
    // SAFETY: axes are below 3, rows below 6; the caller guarantees the rest.
    unsafe {
        let sign = _mm256_and_ps(_mm256_set1_ps(frustum.forward), _mm256_set1_ps(-0.0));
        let enter = _mm256_xor_ps(row(node, frustum.enter, half), sign);
        let leave = _mm256_xor_ps(row(node, frustum.leave, half), sign);
        let at = [
            side(&low_x, row(node, low_x.row, half)),
            side(&high_x, row(node, high_x.row, half)),
            side(&low_y, row(node, low_y.row, half)),
            side(&high_y, row(node, high_y.row, half)),
        ];
        let beside = or4(
            _mm256_cmp_ps::<_CMP_LT_OQ>(row(node, kx + 3, half), at[0]),
            _mm256_cmp_ps::<_CMP_GT_OQ>(row(node, kx, half), at[1]),
            _mm256_cmp_ps::<_CMP_LT_OQ>(row(node, ky + 3, half), at[2]),
            _mm256_cmp_ps::<_CMP_GT_OQ>(row(node, ky, half), at[3]),
        );
        let beyond = _mm256_cmp_ps::<_CMP_GT_OQ>(enter, _mm256_set1_ps(end));
        let behind = _mm256_cmp_ps::<_CMP_LT_OQ>(leave, _mm256_set1_ps(frustum.start));
        _mm256_or_ps(beside, _mm256_or_ps(beyond, behind))
    }
}

/// Returns the flags of half of the vertices for the planes of a frustum.
///
/// # Safety
/// The processor must support AVX2 and FMA, and `half < 2`.
#[inline(always)]
unsafe fn sides_of(block: &Block, frustum: &Frustum, end: f32, half: usize) -> __m256 {
    let ([kx, ky, kz], [low_x, low_y], [high_x, high_y]) =
        (frustum.axes, frustum.low(), frustum.high());
    // SAFETY: axes are below 3; the caller guarantees the rest.
    unsafe {
        let (x, y) = (coordinate(block, kx, half), coordinate(block, ky, half));
        let z = coordinate(block, kz, half);
        let sides = or4(
            flag(_mm256_cmp_ps::<_CMP_LT_OQ>(x, side(&low_x, z)), 1),
            flag(_mm256_cmp_ps::<_CMP_GT_OQ>(x, side(&high_x, z)), 2),
            flag(_mm256_cmp_ps::<_CMP_LT_OQ>(y, side(&low_y, z)), 4),
            flag(_mm256_cmp_ps::<_CMP_GT_OQ>(y, side(&high_y, z)), 8),
        );
        let sign = _mm256_and_ps(_mm256_set1_ps(frustum.forward), _mm256_set1_ps(-0.0));
        let depth = _mm256_xor_ps(z, sign);
        let start = _mm256_set1_ps(frustum.start);
        let behind = flag(_mm256_cmp_ps::<_CMP_LT_OQ>(depth, start), 16);
        let beyond = flag(_mm256_cmp_ps::<_CMP_GT_OQ>(depth, _mm256_set1_ps(end)), 32);
        _mm256_or_ps(sides, _mm256_or_ps(behind, beyond))
    }
}

/// Shears half of the vertices. Returns x and y relative to the ray, and the flags of the vertices:
/// on which sides of the ray, behind the origin, beyond `end`.
///
/// # Safety
/// The processor must support AVX2, and `half < 2`.
#[inline(always)]
unsafe fn sheared(block: &Block, lane: &Lane, end: f32, half: usize) -> ([__m256; 2], __m256) {
    // SAFETY: axes are below 3; the caller guarantees the rest.
    unsafe {
        let (q, [kx, ky, kz]) = (lane.query, lane.axes);
        // Multiply, then subtract, for the same bits in every instruction set.
        let depth = _mm256_sub_ps(coordinate(block, kz, half), all(lane, &q.origin[2]));
        let x = _mm256_sub_ps(coordinate(block, kx, half), all(lane, &q.origin[0]));
        let y = _mm256_sub_ps(coordinate(block, ky, half), all(lane, &q.origin[1]));
        let x = _mm256_sub_ps(x, _mm256_mul_ps(all(lane, &q.shear[0]), depth));
        let y = _mm256_sub_ps(y, _mm256_mul_ps(all(lane, &q.shear[1]), depth));
        let z = _mm256_xor_ps(
            depth,
            _mm256_and_ps(all(lane, &q.dominant_component), _mm256_set1_ps(-0.0)),
        );
        let zero = _mm256_setzero_ps();
        let sides = or4(
            flag(_mm256_cmp_ps::<_CMP_GT_OQ>(x, zero), 1),
            flag(_mm256_cmp_ps::<_CMP_LT_OQ>(x, zero), 2),
            flag(_mm256_cmp_ps::<_CMP_GT_OQ>(y, zero), 4),
            flag(_mm256_cmp_ps::<_CMP_LT_OQ>(y, zero), 8),
        );
        let behind = flag(_mm256_cmp_ps::<_CMP_LT_OQ>(z, zero), 16);
        let beyond = flag(_mm256_cmp_ps::<_CMP_GT_OQ>(z, _mm256_set1_ps(end)), 32);
        ([x, y], _mm256_or_ps(sides, _mm256_or_ps(behind, beyond)))
    }
}

/// Returns corner `k` of half of the triangles.
///
/// # Safety
/// The processor must support AVX2, `half < 2`, and `k < 3`.
#[inline(always)]
unsafe fn corner(block: &Block, (k, half): (usize, usize), x: Pair, y: Pair) -> (__m256, __m256) {
    // SAFETY: reads 8 bytes; the caller guarantees the rest.
    unsafe {
        let both = _mm_loadl_epi64(block.corners.as_ptr().add(k).cast());
        let own = if half == 0 { both } else { _mm_srli_epi64::<4>(both) };
        // The higher bits of an index do not matter.
        let index = _mm256_cvtepu8_epi32(own);
        (pick(x, index), pick(y, index))
    }
}

/// Tests the signs of the edge functions of half of the triangles. Returns those that the ray's
/// line may hit, and those that it certainly hits.
///
/// # Safety
/// The processor must support AVX2 and FMA, and `half < 2`.
#[inline(always)]
unsafe fn edges(block: &Block, x: Pair, y: Pair, half: usize) -> (u32, u32) {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let (ax, ay) = corner(block, (0, half), x, y);
        let (bx, by) = corner(block, (1, half), x, y);
        let (cx, cy) = corner(block, (2, half), x, y);
        let q0 = _mm256_mul_ps(cy, bx);
        let q1 = _mm256_mul_ps(ay, cx);
        let q2 = _mm256_mul_ps(by, ax);
        let u = _mm256_fmsub_ps(cx, by, q0);
        let v = _mm256_fmsub_ps(ax, cy, q1);
        let w = _mm256_fmsub_ps(bx, ay, q2);
        let sign = _mm256_set1_ps(-0.0);
        let largest = max3(
            _mm256_andnot_ps(sign, q0),
            _mm256_andnot_ps(sign, q1),
            _mm256_andnot_ps(sign, q2),
        );
        let (scale, floor) = (_mm256_set1_ps(EDGE_SLACK), _mm256_set1_ps(EDGE_FLOOR));
        let slack = _mm256_fmadd_ps(largest, scale, floor);
        let minus = _mm256_xor_ps(slack, sign);
        let (lowest, highest) = (min3(u, v, w), max3(u, v, w));
        let misses = _mm256_and_ps(
            _mm256_cmp_ps::<_CMP_LT_OQ>(lowest, minus),
            _mm256_cmp_ps::<_CMP_GT_OQ>(highest, slack),
        );
        let sure = _mm256_or_ps(
            _mm256_cmp_ps::<_CMP_GT_OQ>(lowest, slack),
            _mm256_cmp_ps::<_CMP_LT_OQ>(highest, minus),
        );
        (!_mm256_movemask_ps(misses) as u32 & 0xff, _mm256_movemask_ps(sure) as u32)
    }
}

/// Returns the lane-wise minimum of the two halves of a row.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn lesser_half(row: &[f32; WIDTH]) -> __m256 {
    // SAFETY: reads 8 f32 at the start of each half; the caller guarantees the rest.
    unsafe { _mm256_min_ps(_mm256_loadu_ps(row.as_ptr()), _mm256_loadu_ps(row.as_ptr().add(HALF))) }
}

/// Returns the lane-wise minimum of the four quarters of each of two rows: 4 lanes of `a`, then 4
/// of `b`.
///
/// # Safety
/// The processor must support AVX2.
#[inline(always)]
unsafe fn quarters(a: &[f32; WIDTH], b: &[f32; WIDTH]) -> __m256 {
    // SAFETY: guaranteed by the caller.
    unsafe {
        let (a, b) = (lesser_half(a), lesser_half(b));
        let low = _mm256_permute2f128_ps::<0x20>(a, b);
        _mm256_min_ps(low, _mm256_permute2f128_ps::<0x31>(a, b))
    }
}

impl HorizontalMin for Avx2 {
    #[inline(always)]
    fn horizontal_min(self, v: &[f32; WIDTH]) -> f32 {
        // SAFETY: `self` proves AVX2; reads 16 f32.
        unsafe {
            let low = _mm256_loadu_ps(v.as_ptr());
            let v = _mm256_min_ps(low, _mm256_loadu_ps(v.as_ptr().add(HALF)));
            let v = _mm_min_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps::<1>(v));
            let v = _mm_min_ps(v, _mm_movehl_ps(v, v));
            _mm_cvtss_f32(_mm_min_ss(v, _mm_movehdup_ps(v)))
        }
    }

    #[inline(always)]
    fn horizontal_min_rows(self, rows: &[[f32; WIDTH]; 8]) -> [f32; 8] {
        // SAFETY: `self` proves AVX2; reads 8 f32 at the start of each half of a row; writes the
        // 8 f32 of the result.
        unsafe {
            // Each vector holds 4 values of row i and 4 of row i + 4. They are transposed on the
            // way.
            let (a, b) = (quarters(&rows[0], &rows[4]), quarters(&rows[1], &rows[5]));
            let (c, d) = (quarters(&rows[2], &rows[6]), quarters(&rows[3], &rows[7]));
            let a = _mm256_min_ps(_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let c = _mm256_min_ps(_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            let low = _mm256_shuffle_ps::<0b01_00_01_00>(a, c);
            let found = _mm256_min_ps(low, _mm256_shuffle_ps::<0b11_10_11_10>(a, c));
            let mut lowest = [0.0; 8];
            _mm256_storeu_ps(lowest.as_mut_ptr(), found);
            lowest
        }
    }
}

impl Tier for Avx2 {
    const FUSED: bool = true;

    fn run<K: Kernel>(self, kernel: K) -> K::Output {
        // SAFETY: `self` proves that `Isa::detect` has found every feature of this instruction set.
        unsafe { run_avx2(kernel) }
    }

    #[inline(always)]
    fn first_in_order(self, node: &Node, lane: &Lane, tfar: f32, stack: &mut Stack) -> Child {
        let (to_children, to_distances) = stack.room();
        // SAFETY: `self` proves AVX2 and FMA. There is room for 16 entries, and the two writes of 8
        // entries start at most 8 places on.
        unsafe {
            let (n0, m0) = slabs(node, &lane.slabs(), tfar, 0);
            let (n1, m1) = slabs(node, &lane.slabs(), tfar, 1);
            let (near, order) = ([n0, n1], order(node, lane.octant));
            let hits = _mm_movemask_epi8(_mm_shuffle_epi8(bytes([m0, m1]), order)) as u32;
            let Some(place) = hits.checked_ilog2() else { return Child::EMPTY };
            let nearest = node.children[node.ordered(lane.octant, place as usize)];
            let others = hits ^ (1 << place);
            if others == 0 {
                return nearest;
            }
            let (farther, nearer) = (others & 0xff, others >> 8);
            let children = children(node);
            let index = _mm256_cvtepu8_epi32(_mm_shuffle_epi8(order, lanes(farther)));
            _mm256_storeu_ps(to_children.cast(), pick(children, index));
            _mm256_storeu_ps(to_distances, pick(near, index));
            let so_far = farther.count_ones() as usize;
            let order = _mm_unpackhi_epi64(order, order);
            let index = _mm256_cvtepu8_epi32(_mm_shuffle_epi8(order, lanes(nearer)));
            _mm256_storeu_ps(to_children.add(so_far).cast(), pick(children, index));
            _mm256_storeu_ps(to_distances.add(so_far), pick(near, index));
            stack.grow(others.count_ones() as usize);
            nearest
        }
    }

    #[inline(always)]
    fn hit_children(self, node: &Node, lane: &Lane, tfar: f32) -> u32 {
        // SAFETY: `self` proves AVX2 and FMA.
        unsafe {
            let (_, m0) = slabs(node, &lane.slabs(), tfar, 0);
            let (_, m1) = slabs(node, &lane.slabs(), tfar, 1);
            _mm256_movemask_ps(m0) as u32 | (_mm256_movemask_ps(m1) as u32) << HALF
        }
    }

    #[inline(always)]
    fn children_in_frustum(self, node: &Node, frustum: &Frustum, end: f32) -> u32 {
        // SAFETY: `self` proves AVX2 and FMA.
        unsafe {
            let outside = [outside(node, frustum, end, 0), outside(node, frustum, end, 1)];
            let places = _mm_shuffle_epi8(bytes(outside), order(node, frustum.octant));
            !_mm_movemask_epi8(places) as u32 & 0xffff
        }
    }

    #[inline(always)]
    fn triangles_in_frustum(self, block: &Block, frustum: &Frustum, end: f32) -> u32 {
        // SAFETY: `self` proves AVX2 and FMA.
        unsafe {
            let sides = [sides_of(block, frustum, end, 0), sides_of(block, frustum, end, 1)];
            astride(block, sides)
        }
    }

    #[inline(always)]
    fn bits(self, mask: &Mask) -> u32 {
        let mut lanes = 0;
        for half in 0..2 {
            // SAFETY: `self` proves AVX2; reads 8 i32 at the start of each half.
            unsafe {
                let half_lanes = _mm256_loadu_ps(mask.0.as_ptr().add(HALF * half).cast());
                lanes |= (_mm256_movemask_ps(half_lanes) as u32) << (HALF * half);
            }
        }
        lanes
    }

    #[inline(always)]
    fn at_most(self, a: &[f32; WIDTH], b: &[f32; WIDTH]) -> u32 {
        let mut lanes = 0;
        for half in 0..2 {
            // SAFETY: `self` proves AVX2; reads 8 f32 at the start of each half.
            unsafe {
                let x = _mm256_loadu_ps(a.as_ptr().add(HALF * half));
                let y = _mm256_loadu_ps(b.as_ptr().add(HALF * half));
                let hits = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(x, y));
                lanes |= (hits as u32) << (HALF * half);
            }
        }
        lanes
    }

    #[inline(always)]
    fn candidates(self, block: &Block, lane: &Lane, tfar: f32) -> Candidates {
        // SAFETY: `self` proves AVX2 and FMA.
        unsafe {
            let end = lane.depth(tfar);
            let ([x0, y0], sides0) = sheared(block, lane, end, 0);
            let ([x1, y1], sides1) = sheared(block, lane, end, 1);
            // The line misses a triangle that lies on one side of the line. This test does not
            // round.
            let around = astride(block, [sides0, sides1]);
            let (mut maybe, mut sure) = (0, 0);
            if around & 0xff != 0 {
                (maybe, sure) = edges(block, [x0, x1], [y0, y1], 0);
            }
            if around >> HALF != 0 {
                let (m, s) = edges(block, [x0, x1], [y0, y1], 1);
                (maybe, sure) = (maybe | m << HALF, sure | s << HALF);
            }
            maybe &= around;
            Candidates { maybe, sure: maybe & sure }
        }
    }
}
