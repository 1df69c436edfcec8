//! How much memory the system can still provide, and whether an accelerator fits into it.

use super::available::{available_bytes, available_bytes_and_swap, bytes_before_a_kill};
use super::freed::release_freed;
use crate::accel::{MemoryFootprint, memory_footprint};
use crate::error::Result;
use crate::film::Window;
use crate::geometry::PrimitiveCounts;
use crate::process::kib;
use crate::reserve::MemoryLimit;
use crate::scene::Backend;
use crate::units;

/// Returns the largest resident set of this process so far, in bytes.
pub fn peak_bytes() -> u64 {
    kib("/proc/self/status".as_ref(), "VmHWM:").unwrap_or(0)
}

/// Returns the limit for meshes or textures if the user sets none: the memory that this process can
/// still get, swap included.
pub fn limit_of_machine() -> Option<MemoryLimit> {
    available_bytes_and_swap().map(|bytes| MemoryLimit { bytes, set_by_user: false })
}

/// Returns the same as [`limit_of_machine`]. If fewer than `bytes` are available without swap, it
/// first returns freed memory to the system.
pub fn machine_limit_for(bytes: u64) -> Option<MemoryLimit> {
    if available_bytes().is_some_and(|available| available < bytes) {
        release_freed();
    }
    limit_of_machine()
}

/// Returns the memory that this process can still get before the system kills it.
pub fn limit_before_kill() -> Option<MemoryLimit> {
    bytes_before_a_kill().map(|bytes| MemoryLimit { bytes, set_by_user: false })
}

/// Upper bound of the bytes per primitive of any accelerator, during the build and after it. It is
/// above every [`crate::accel::MemoryFootprint`].
const MAX_BYTES_PER_PRIMITIVE: u64 = 512;

/// Checks that an accelerator fits into the memory that the machine still has. After the build
/// there is also a film of `film_bytes`.
///
/// The footprint is computed only if memory may be short: for Embree it takes two small builds.
///
/// # Errors
/// `Retry`, with the numbers; a backend that cannot run here.
pub fn ensure_build_fits(
    backend: Backend,
    threads: usize,
    counts: PrimitiveCounts,
    film_bytes: u64,
) -> Result<()> {
    let Some(Lack { limit, needed, build }) = lack_for_build(backend, threads, counts, film_bytes)?
    else {
        return Ok(());
    };
    let built = |footprint: &MemoryFootprint| needed_by(footprint, counts, film_bytes);
    let smaller = smaller_backend(backend, built(&MemoryFootprint::BVH), limit.bytes);
    let less = less_than_predicted(backend, build, needed, limit.bytes);
    limit
        .check(needed, "the accelerator and the film")
        .map_err(|error| error.maybe_help(smaller.or(less)))
}

/// Checks the same without a film, for callers who cannot switch the check off: refuses only what
/// does not fit although the mesh is in order, see [`less_than_predicted`].
///
/// # Errors
/// `Retry`, with the numbers; a backend that cannot run here.
pub fn ensure_build_may_fit(
    backend: Backend,
    threads: usize,
    counts: PrimitiveCounts,
) -> Result<()> {
    match lack_for_build(backend, threads, counts, 0)? {
        Some(Lack { limit, needed, build })
            if less_than_predicted(backend, build, needed, limit.bytes).is_none() =>
        {
            limit.check(needed, "the accelerator")
        }
        _ => Ok(()),
    }
}

/// What an accelerator may need, if that is more than the machine still has.
struct Lack {
    limit: MemoryLimit,
    needed: u64,
    /// The share of the build.
    build: u64,
}

/// Returns what an accelerator and a film of `film_bytes` may need, if it is more than the machine
/// still has.
fn lack_for_build(
    backend: Backend,
    threads: usize,
    counts: PrimitiveCounts,
    film_bytes: u64,
) -> Result<Option<Lack>> {
    let maximum =
        counts.primitives.saturating_mul(MAX_BYTES_PER_PRIMITIVE).saturating_add(film_bytes);
    let Some(limit) = limit_below(maximum) else { return Ok(None) };
    let footprint = memory_footprint(backend, threads)?;
    let needed = needed_by(&footprint, counts, film_bytes);
    let build = footprint.peak_bytes(counts);
    Ok((needed > limit.bytes).then_some(Lack { limit, needed, build }))
}

/// Returns the most bytes at a time, of the build or of what is built and the film.
fn needed_by(footprint: &MemoryFootprint, counts: PrimitiveCounts, film_bytes: u64) -> u64 {
    let built = footprint.built_bytes(counts).saturating_add(film_bytes);
    footprint.peak_bytes(counts).max(built)
}

/// Checks that a film with `words` channels in addition to R, G, B, A fits into the memory that the
/// machine still has.
///
/// # Errors
/// `Retry`, with the numbers.
pub fn ensure_film_fits(window: Window, words: usize) -> Result<()> {
    let bytes = window.pixels().saturating_mul(4 * (4 + words as u64));
    limit_below(bytes).map_or(Ok(()), |limit| limit.check(bytes, "the film"))
}

/// Returns the memory that this process can still get, if it is below `bytes` although freed memory
/// was returned to the system.
fn limit_below(bytes: u64) -> Option<MemoryLimit> {
    let short = || limit_before_kill().filter(|limit| limit.bytes < bytes);
    short()?;
    release_freed();
    short()
}

/// Returns advice for a `bvh` that may fit into `limit` bytes although `needed` are predicted,
/// `build` of them for its build. The prediction holds for every mesh. Where most triangles lie
/// beside the one before them in the file, the build takes a third less.
pub fn less_than_predicted(
    backend: Backend,
    build: u64,
    needed: u64,
    limit: u64,
) -> Option<String> {
    let may_fit = matches!(backend, Backend::Bvh(_)) && needed.saturating_sub(build / 3) <= limit;
    let advice = "a large mesh whose triangles are in order needs a third less for the build: \
                  --max-memory SIZE, at least what `info` predicts, builds without this check";
    may_fit.then(|| advice.to_string())
}

/// Returns advice to use `bvh`, which needs `bytes`, if they are within `limit`.
pub(super) fn smaller_backend(backend: Backend, bytes: u64, limit: u64) -> Option<String> {
    let fits = !matches!(backend, Backend::Bvh(_)) && bytes <= limit;
    fits.then(|| format!("`--backend bvh` needs {}", units::bytes_rounded_up(bytes)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;

    #[test]
    fn what_no_machine_holds_is_refused() {
        let build = |n| ensure_build_may_fit(Backend::default(), 1, PrimitiveCounts::new(n));
        assert_eq!(build(10), Ok(()));
        let error = build(1 << 50).unwrap_err();
        assert!(error.kind == ErrorKind::Retry && error.to_string().contains("the accelerator"));
        assert_eq!(ensure_film_fits(Window::full(1, 1), 5), Ok(()));
        let error = ensure_film_fits(Window::full(u32::MAX, u32::MAX), 5).unwrap_err();
        assert!(error.kind == ErrorKind::Retry && error.to_string().contains("the film"));
    }

    #[test]
    fn only_a_tree_that_may_fit_is_tried() {
        let tree = Backend::default();
        let advice = |backend, limit| less_than_predicted(backend, 90, 100, limit);
        assert!(advice(tree, 70).is_some_and(|help| help.contains("--max-memory SIZE")));
        assert_eq!(advice(tree, 69), None);
        assert_eq!(advice(Backend::Coursework, 99), None);
    }
}
