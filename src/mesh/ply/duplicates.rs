//! Triangles that a file has more than once: the first one stays.
//!
//! Two triangles over the same three vertices, in whatever order, are the same surface; both sides
//! of it are shaded. To find them among millions without a table of all, every triangle sets one of
//! 16 bits that its lowest vertex has; neighbours in the file have neighbouring vertices, so this
//! stays in the caches. Only triangles that share a bit are looked at again, with other bits, and
//! what is left after some rounds is sorted.

use std::sync::atomic::{AtomicU16, Ordering::Relaxed};

use rayon::prelude::*;

use super::face::Faces;
use super::job::Job;
use crate::error::Result;
use crate::mesh::mesh::unset;

/// Triangles that one task looks at.
const GRAIN: usize = 1 << 14;

/// Odd multipliers for the second and third vertex: the bits of each round.
const ROUNDS: [[u32; 2]; 3] =
    [[0x9e37_79b1, 0x85eb_ca77], [0xc2b2_ae3d, 0x27d4_eb2f], [0x1656_67b1, 0xd3a2_646d]];

/// Drops all triangles over the same vertices as an earlier one, and counts them.
pub(super) fn drop(faces: &mut Faces, vertices: usize, job: &Job) -> Result<u64> {
    // A scene cannot hold more primitives than that.
    let Ok(count) = u32::try_from(faces.triangles.len()) else {
        return Ok(0);
    };
    let triangles = &faces.triangles;
    let bits: Vec<AtomicU16> = unset(vertices);
    let mut suspects = None;
    for round in ROUNDS {
        job.check()?;
        suspects = Some(match suspects {
            None => sharing(&bits, triangles, (0..count).into_par_iter(), round),
            Some(some) => {
                let some: Vec<u32> = some;
                sharing(&bits, triangles, some.into_par_iter(), round)
            }
        });
    }
    std::mem::drop(bits);
    let mut suspects = suspects.unwrap_or_default();
    suspects.par_sort_unstable_by_key(|&t| (sorted(triangles[t as usize]), t));
    let repeats = |pair: &[u32]| {
        let [a, b] = [pair[0], pair[1]].map(|t| sorted(triangles[t as usize]));
        (a == b).then_some(pair[1])
    };
    let mut repeated: Vec<u32> = suspects.windows(2).filter_map(repeats).collect();
    repeated.sort_unstable();
    remove(&mut faces.triangles, &repeated);
    if let Some(uvs) = &mut faces.uvs {
        remove(uvs, &repeated);
    }
    Ok(repeated.len() as u64)
}

/// Those of `among` that share a bit with another of them.
fn sharing<I>(bits: &[AtomicU16], triangles: &[[u32; 3]], among: I, round: [u32; 2]) -> Vec<u32>
where
    I: IndexedParallelIterator<Item = u32> + Clone,
{
    let bit = |t: u32| {
        let [a, b, c] = sorted(triangles[t as usize]);
        let hash = b.wrapping_mul(round[0]) ^ c.wrapping_mul(round[1]);
        (a as usize, 1u16 << (hash.wrapping_mul(0x9e37_79b1) >> 28))
    };
    let clear = || bits.par_iter().with_min_len(1 << 16).for_each(|b| b.store(0, Relaxed));
    clear();
    let second = |t: &u32| {
        let (vertex, bit) = bit(*t);
        bits[vertex].fetch_or(bit, Relaxed) & bit != 0
    };
    let seconds: Vec<u32> = among.clone().with_min_len(GRAIN).filter(second).collect();
    clear();
    seconds.into_par_iter().with_min_len(GRAIN).for_each(|t| {
        let (vertex, bit) = bit(t);
        bits[vertex].fetch_or(bit, Relaxed);
    });
    let shared = |t: &u32| {
        let (vertex, bit) = bit(*t);
        bits[vertex].load(Relaxed) & bit != 0
    };
    among.with_min_len(GRAIN).filter(shared).collect()
}

#[inline(always)]
fn sorted([a, b, c]: [u32; 3]) -> [u32; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), low.max(c.min(high)), high.max(c)]
}

/// Takes out the elements at `places`, which ascend.
fn remove<T>(all: &mut Vec<T>, places: &[u32]) {
    if places.is_empty() {
        return;
    }
    let (mut at, mut places) = (0u32, places.iter().peekable());
    all.retain(|_| {
        let gone = places.next_if_eq(&&at).is_some();
        at += 1;
        !gone
    });
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn exactly_the_repeated_ones_go() {
        let job = Job { name: "", monitor: None };
        let mut seed = 1u64;
        let mut random = move |below: u32| {
            seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (seed >> 33) as u32 % below
        };
        for (vertices, count) in [(4, 40), (60, 3000), (3000, 40_000), (50_000, 100_000)] {
            let triangles: Vec<[u32; 3]> = (0..count)
                .map(|_| [random(vertices), random(vertices), random(vertices)])
                .filter(|[a, b, c]| a != b && b != c && c != a)
                .collect();
            let mut seen = HashSet::new();
            let mut key = |t: &[u32; 3]| {
                let mut key = *t;
                key.sort_unstable();
                assert_eq!(key, sorted(*t));
                seen.insert(key)
            };
            let expected: Vec<[u32; 3]> = triangles.iter().copied().filter(|t| key(t)).collect();
            let uvs = triangles.iter().map(|t| t.map(|v| [v as f32; 2])).collect();
            let mut faces = Faces { triangles, uvs: Some(uvs), ..Faces::default() };
            let before = faces.triangles.len();
            let dropped = drop(&mut faces, vertices as usize, &job).unwrap();
            assert_eq!(dropped as usize, before - expected.len());
            assert!(faces.triangles == expected);
            let uvs = faces.uvs.unwrap();
            assert!(expected.iter().zip(&uvs).all(|(t, uv)| t.map(|v| [v as f32; 2]) == *uv));
        }
    }
}
