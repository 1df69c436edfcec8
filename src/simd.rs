//! Selects the instruction set once, and calls code that is compiled for it.
//!
//! Kernels are plain Rust over arrays of 16 lanes. [`dispatch`] runs the version that is compiled
//! for the selected instruction set. Every version computes the same bits: no contraction and no
//! approximations.

use std::{fmt, sync::OnceLock};

use crate::error::{Error, ErrorKind, Problem, Result};

/// An instruction set for which kernels are compiled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
pub enum Isa {
    /// The instructions that the target guarantees: SSE2 on x86-64, NEON on 64-bit ARM.
    Portable,
    /// 64-bit ARM.
    ///
    /// NEON by name in the kernels of the tree. The rest is [`Isa::Portable`].
    Neon,
    /// AVX2, FMA, BMI1, BMI2, LZCNT and POPCNT.
    Avx2,
    /// AVX-512 F, BW, DQ, VL, and all of `avx2`.
    ///
    /// Compiled in only by rustc >= 1.89.
    Avx512,
}

impl Isa {
    /// Returns the best instruction set that this machine supports and this build contains.
    #[inline]
    pub fn detect() -> Self {
        static BEST: OnceLock<Isa> = OnceLock::new();
        *BEST.get_or_init(Self::look)
    }

    fn look() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("fma")
                && is_x86_feature_detected!("bmi1")
                && is_x86_feature_detected!("bmi2")
                && is_x86_feature_detected!("lzcnt")
                && is_x86_feature_detected!("popcnt");
            #[cfg(lightpath_avx512)]
            if avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
            {
                return Self::Avx512;
            }
            if avx2 {
                return Self::Avx2;
            }
        }
        #[cfg(target_arch = "aarch64")]
        return Self::Neon;
        #[cfg(not(target_arch = "aarch64"))]
        Self::Portable
    }

    /// Returns the instruction sets that this machine supports and this build contains, lowest
    /// first.
    pub fn available() -> impl Iterator<Item = Self> {
        let best = Self::detect();
        Self::compiled().iter().copied().filter(move |isa| *isa <= best)
    }

    /// Returns the instruction sets that this build contains, lowest first.
    pub const fn compiled() -> &'static [Self] {
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        return &[Self::Portable, Self::Avx2, Self::Avx512];
        #[cfg(all(target_arch = "x86_64", not(lightpath_avx512)))]
        return &[Self::Portable, Self::Avx2];
        #[cfg(target_arch = "aarch64")]
        return &[Self::Portable, Self::Neon];
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        return &[Self::Portable];
    }

    /// Returns the instruction set itself if this build contains it and this machine supports it.
    /// `flag` is the place in messages.
    ///
    /// # Errors
    /// `Unsupported` if this machine or this build lacks it.
    pub fn supported(self, flag: &str) -> Result<Self> {
        if Self::available().any(|isa| isa == self) {
            return Ok(self);
        }
        let lacks = if Self::compiled().contains(&self) { "this machine" } else { "this build" };
        let available: Vec<String> = Self::available().map(|isa| isa.to_string()).collect();
        let message = format!("found {self}, which {lacks} lacks");
        let help = format!("available: {}", available.join(", "));
        Err(Error::new(ErrorKind::Unsupported, Problem::new(flag, message).help(help)))
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Portable => "portable",
            Self::Neon => "NEON",
            Self::Avx2 => "AVX2",
            Self::Avx512 => "AVX-512",
        })
    }
}

/// Work that is compiled once per instruction set.
///
/// `run` and everything it calls in the hot path must be `#[inline(always)]`. Otherwise they are
/// compiled for the portable instruction set only.
pub trait Kernel {
    /// The type that `run` returns.
    type Output;
    /// Does the work and returns the result.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` compiled for `isa`, or for the best instruction set below it that this machine
/// supports.
#[inline]
pub fn dispatch<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    match isa.min(Isa::detect()) {
        // SAFETY: `detect` has just found every feature that `run_avx512` enables.
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        Isa::Avx512 => unsafe { run_avx512(kernel) },
        // SAFETY: `detect` has just found every feature that `run_avx2` enables.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { run_avx2(kernel) },
        _ => run_portable(kernel),
    }
}

/// Runs `kernel` compiled for [`Isa::Portable`]. Not inlined: every caller would get a copy.
#[inline(never)]
fn run_portable<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// Runs `kernel` compiled for [`Isa::Avx512`].
///
/// # Safety
/// [`Isa::detect`] must return at least [`Isa::Avx512`].
#[cfg(all(target_arch = "x86_64", lightpath_avx512))]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(crate) unsafe fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// Runs `kernel` compiled for [`Isa::Avx2`].
///
/// # Safety
/// [`Isa::detect`] must return at least [`Isa::Avx2`].
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
pub(crate) unsafe fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}

/// A part of kernels that is compiled once per instruction set as a function of its own, which the
/// kernels share. That takes a fraction of the compile time of a part that each of them inlines.
///
/// Its values are arguments of their own: references in a struct may alias for the compiler.
/// Everything that `run` calls in the hot path must be `#[inline(always)]`.
pub trait Stage<A, B, C> {
    /// The type that `run` returns.
    type Output;
    /// Does the work and returns the result.
    fn run(&mut self, a: &mut A, b: &mut B, c: &mut C) -> Self::Output;
}

/// [`dispatch`] for a stage.
#[inline(always)]
pub fn dispatch_stage<S: Stage<A, B, C>, A, B, C>(
    isa: Isa,
    stage: &mut S,
    a: &mut A,
    b: &mut B,
    c: &mut C,
) -> S::Output {
    match isa.min(Isa::detect()) {
        // SAFETY: `detect` has just found every feature that `stage_avx512` enables.
        #[cfg(all(target_arch = "x86_64", lightpath_avx512))]
        Isa::Avx512 => unsafe { stage_avx512(stage, a, b, c) },
        // SAFETY: `detect` has just found every feature that `stage_avx2` enables.
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => unsafe { stage_avx2(stage, a, b, c) },
        _ => stage_portable(stage, a, b, c),
    }
}

/// Runs `stage` compiled for [`Isa::Avx512`].
///
/// # Safety
/// [`Isa::detect`] must return at least [`Isa::Avx512`].
#[cfg(all(target_arch = "x86_64", lightpath_avx512))]
#[inline(never)]
#[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn stage_avx512<S: Stage<A, B, C>, A, B, C>(
    stage: &mut S,
    a: &mut A,
    b: &mut B,
    c: &mut C,
) -> S::Output {
    stage.run(a, b, c)
}

/// Runs `stage` compiled for [`Isa::Avx2`].
///
/// # Safety
/// [`Isa::detect`] must return at least [`Isa::Avx2`].
#[cfg(target_arch = "x86_64")]
#[inline(never)]
#[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
unsafe fn stage_avx2<S: Stage<A, B, C>, A, B, C>(
    stage: &mut S,
    a: &mut A,
    b: &mut B,
    c: &mut C,
) -> S::Output {
    stage.run(a, b, c)
}

/// Runs `stage` compiled for [`Isa::Portable`].
#[inline(never)]
fn stage_portable<S: Stage<A, B, C>, A, B, C>(
    stage: &mut S,
    a: &mut A,
    b: &mut B,
    c: &mut C,
) -> S::Output {
    stage.run(a, b, c)
}

/// Prefetches `values[index]` into the cache. The index may be out of bounds.
#[inline(always)]
pub fn prefetch<T>(values: &[T], index: usize) {
    prefetch_line(values, index, 0);
}

/// Prefetches one cache line, of 64 bytes, of `values[index]`. Index and line may be out of bounds.
#[inline(always)]
pub fn prefetch_line<T>(values: &[T], index: usize, line: usize) {
    #[cfg(target_arch = "x86_64")]
    // SAFETY: prefetching reads nothing and faults at no address; SSE is part of x86-64.
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let bytes = values.as_ptr().wrapping_add(index).cast::<i8>();
        _mm_prefetch::<_MM_HINT_T0>(bytes.wrapping_add(64 * line));
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (values, index, line);
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f32; 16]);

    impl Kernel for Sum<'_> {
        type Output = f32;
        #[inline(always)]
        fn run(self) -> f32 {
            self.0.iter().map(|x| x.sqrt() * 0.1 + 0.3).sum()
        }
    }

    #[test]
    fn every_instruction_set_computes_the_same_bits() {
        let values = std::array::from_fn(|i| i as f32 * 1.7);
        let portable = dispatch(Isa::Portable, Sum(&values));
        for &isa in Isa::compiled() {
            assert_eq!(dispatch(isa, Sum(&values)).to_bits(), portable.to_bits(), "{isa}");
        }
    }
}
