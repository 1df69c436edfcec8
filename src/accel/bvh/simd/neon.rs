//! Operations of NEON (64-bit ARM) that the compiler does not use by itself: bits of masks, and
//! look-ups of bytes and of lanes by index. Every 64-bit ARM processor has NEON.

use std::arch::aarch64::*;

use super::super::frustum::HorizontalMin;
use super::super::node::{Block, Node, WIDTH};
use super::loops::{Loops, QUARTER};

/// The NEON [`Tier`](super::Tier).
#[derive(Debug, Clone, Copy)]
pub struct Neon;

/// The bit of each lane, for both halves of 16 lanes.
static LANE_BITS: [u8; WIDTH] = [1, 2, 4, 8, 16, 32, 64, 128, 1, 2, 4, 8, 16, 32, 64, 128];

/// Converts 16 lanes of 32 bits to bytes: the low byte of each.
#[inline(always)]
fn bytes(lanes: &[i32; WIDTH]) -> uint8x16_t {
    // SAFETY: reads 4 i32 at the start of each quarter.
    unsafe {
        let quarter = |i: usize| vreinterpretq_u16_s32(vld1q_s32(lanes.as_ptr().add(4 * i)));
        let low = vreinterpretq_u8_u16(vuzp1q_u16(quarter(0), quarter(1)));
        let high = vreinterpretq_u8_u16(vuzp1q_u16(quarter(2), quarter(3)));
        vuzp1q_u8(low, high)
    }
}

/// Returns the lanes whose byte is 255, as bits. The other bytes are 0.
#[inline(always)]
fn bits(mask: uint8x16_t) -> u32 {
    // SAFETY: reads 16 bytes.
    unsafe {
        let set = vandq_u8(mask, vld1q_u8(LANE_BITS.as_ptr()));
        let pairs = vzip1q_u8(set, vextq_u8::<8>(set, set));
        vaddvq_u16(vreinterpretq_u16_u8(pairs)).into()
    }
}

/// Returns the slots of the children in the order of an octant, from far to near, one byte each:
/// see [`Node::set_order`].
#[inline(always)]
fn order(node: &Node, octant: usize) -> uint8x16_t {
    let packed: *const u64 = &node.order[octant % 8];
    // SAFETY: reads 8 bytes.
    unsafe {
        let packed = vld1_u8(packed.cast());
        let (low, high) = (vand_u8(packed, vdup_n_u8(15)), vshr_n_u8::<4>(packed));
        let (even, odd) = (vzip1_u8(low, high), vzip2_u8(low, high));
        vcombine_u8(vzip1_u8(even, odd), vzip2_u8(even, odd))
    }
}

/// Returns corner `k` of each triangle: the index of its vertex.
#[inline(always)]
fn corner(block: &Block, k: usize) -> uint8x16_t {
    // SAFETY: reads the 8 bytes of the row.
    unsafe {
        let packed = vld1_u8(block.corners[k].as_ptr());
        vcombine_u8(vand_u8(packed, vdup_n_u8(15)), vshr_n_u8::<4>(packed))
    }
}

/// Returns the 16 lanes as a table of bytes.
#[inline(always)]
fn table(lanes: &[f32; WIDTH]) -> uint8x16x4_t {
    // SAFETY: reads 4 f32 at the start of each quarter.
    unsafe {
        let quarter = |i: usize| vreinterpretq_u8_f32(vld1q_f32(lanes.as_ptr().add(4 * i)));
        uint8x16x4_t(quarter(0), quarter(1), quarter(2), quarter(3))
    }
}

impl HorizontalMin for Neon {
    #[inline(always)]
    fn horizontal_min(self, v: &[f32; WIDTH]) -> f32 {
        // SAFETY: reads 4 f32 at the start of each quarter.
        unsafe {
            let quarter = |i: usize| vld1q_f32(v.as_ptr().add(4 * i));
            let low = vminnmq_f32(quarter(0), quarter(1));
            vminnmvq_f32(vminnmq_f32(low, vminnmq_f32(quarter(2), quarter(3))))
        }
    }
}

impl Loops for Neon {
    #[inline(always)]
    fn min(a: f32, b: f32) -> f32 {
        a.min(b)
    }

    #[inline(always)]
    fn max(a: f32, b: f32) -> f32 {
        a.max(b)
    }

    #[inline(always)]
    fn mask_bits(self, mask: &[i32; WIDTH]) -> u32 {
        bits(bytes(mask))
    }

    #[inline(always)]
    fn bits_in_order(self, mask: &[i32; WIDTH], node: &Node, octant: usize) -> u32 {
        // SAFETY: NEON is part of 64-bit ARM.
        bits(unsafe { vqtbl1q_u8(bytes(mask), order(node, octant)) })
    }

    #[inline(always)]
    fn astride(self, block: &Block, flags: &[i32; WIDTH]) -> u32 {
        let flags = bytes(flags);
        // SAFETY: NEON is part of 64-bit ARM.
        let none = unsafe {
            let of = |k: usize| vqtbl1q_u8(flags, corner(block, k));
            vceqzq_u8(vandq_u8(vandq_u8(of(0), of(1)), of(2)))
        };
        bits(none) & u32::from(block.present)
    }

    #[inline(always)]
    fn corners(
        self,
        block: &Block,
        quarter: usize,
        x: &[f32; WIDTH],
        y: &[f32; WIDTH],
    ) -> [[[f32; QUARTER]; 2]; 3] {
        /// For each quarter, its lanes, four bytes each.
        static LANES: [[u8; WIDTH]; 4] = [
            [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3],
            [4, 4, 4, 4, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7],
            [8, 8, 8, 8, 9, 9, 9, 9, 10, 10, 10, 10, 11, 11, 11, 11],
            [12, 12, 12, 12, 13, 13, 13, 13, 14, 14, 14, 14, 15, 15, 15, 15],
        ];
        let (x, y) = (table(x), table(y));
        let mut corners = [[[0.0; QUARTER]; 2]; 3];
        for k in 0..3 {
            // SAFETY: reads 16 bytes, writes 4 f32 each.
            unsafe {
                let vertices = vqtbl1q_u8(corner(block, k), vld1q_u8(LANES[quarter].as_ptr()));
                let within = vreinterpretq_u8_u32(vdupq_n_u32(0x0302_0100));
                let at = vorrq_u8(vshlq_n_u8::<2>(vertices), within);
                let [x_k, y_k] = &mut corners[k];
                vst1q_f32(x_k.as_mut_ptr(), vreinterpretq_f32_u8(vqtbl4q_u8(x, at)));
                vst1q_f32(y_k.as_mut_ptr(), vreinterpretq_f32_u8(vqtbl4q_u8(y, at)));
            }
        }
        corners
    }
}
