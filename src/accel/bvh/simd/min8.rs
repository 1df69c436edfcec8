//! The smaller of two numbers in eight lanes.

/// Returns the smaller number of each pair; that of `b` if either is NaN.
///
/// A loop would compile to a masked store if `a` comes from memory. A masked store cannot be
/// forwarded to the next load.
#[inline(always)]
pub fn min8(a: [f32; 8], b: [f32; 8]) -> [f32; 8] {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: SSE is part of x86-64; all addresses are within the arrays.
    unsafe {
        use std::arch::x86_64::{_mm_loadu_ps, _mm_min_ps, _mm_storeu_ps};
        let mut smaller = a;
        for half in [0, 4] {
            let (a, b) = (_mm_loadu_ps(a.as_ptr().add(half)), _mm_loadu_ps(b.as_ptr().add(half)));
            _mm_storeu_ps(smaller.as_mut_ptr().add(half), _mm_min_ps(a, b));
        }
        smaller
    }
    #[cfg(not(target_arch = "x86_64"))]
    std::array::from_fn(|i| if a[i] < b[i] { a[i] } else { b[i] })
}
