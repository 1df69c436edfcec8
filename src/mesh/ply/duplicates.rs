//! Removes duplicate triangles: the first one stays.
//!
//! Two triangles with the same three vertices, in any order, are the same surface, because both
//! sides are shaded. The triangles are distributed by their lowest vertex index. So each task owns
//! a range of vertices and needs no atomics. Neighbouring triangles in a file usually have
//! neighbouring vertices, so a task skips most blocks of triangles.
//!
//! Each vertex has 16 bits. Every triangle sets one bit of its lowest vertex, chosen by a hash of
//! the other two. Only triangles that share a bit are candidates for the next round, which uses
//! another hash. The candidates left after the last round are sorted and compared.

use std::ops::RangeInclusive;

use super::context::ReadContext;
use super::faces::PlyFaces;
use crate::error::Result;
use crate::parallel;
use crate::reserve;

/// Number of triangles in a block. The range of lowest vertices is stored for each block.
const BLOCK: usize = 1 << 14;
/// One triangle in this many is sampled to estimate how lowest vertices are distributed. It is
/// prime, because split faces repeat every 4 or 16 triangles in a file.
const SAMPLED: usize = 61;
/// Minimum number of samples per task.
const GRAIN: usize = 1 << 7;

/// Odd multipliers for the second and third vertex: the hash of each round.
const ROUNDS: [[u32; 2]; 3] =
    [[0x9e37_79b1, 0x85eb_ca77], [0xc2b2_ae3d, 0x27d4_eb2f], [0x1656_67b1, 0xd3a2_646d]];

/// Drops every triangle with the same vertices as an earlier one. Returns the number dropped. The
/// result is the same for any number of threads. Drops nothing from 2^32 triangles or more.
///
/// # Errors
/// If there is too little memory for 16 bits per vertex, or after a signal.
pub(super) fn drop(faces: &mut PlyFaces, vertices: usize, job: &ReadContext) -> Result<u64> {
    // A scene cannot hold so many primitives, so their duplicates do not matter.
    if u32::try_from(faces.triangles.len()).is_err() {
        return Ok(0);
    }
    // 16 bits per vertex.
    reserve::probe(2 * vertices as u64, job.name)?;
    let all = Triangles::new(&faces.triangles);
    let stretches = all.stretches(vertices);
    let repeated = |ends: &[u32]| match job.stopped() {
        true => Vec::new(),
        false => all.repeated(ends[0], (ends[1] - ends[0]) as usize),
    };
    let repeated = parallel::map(stretches.windows(2), repeated);
    job.check()?;
    let mut repeated = repeated.concat();
    repeated.sort_unstable();
    remove(&mut faces.triangles, &repeated);
    if let Some(uvs) = &mut faces.uvs {
        remove(uvs, &repeated);
    }
    if !repeated.is_empty() {
        faces.attributes.retain(|i| repeated.binary_search(&(i as u32)).is_err());
    }
    Ok(repeated.len() as u64)
}

struct Triangles<'a> {
    all: &'a [[u32; 3]],
    /// The range of lowest vertices of each block.
    lowest: Vec<RangeInclusive<u32>>,
}

impl<'a> Triangles<'a> {
    fn new(all: &'a [[u32; 3]]) -> Self {
        let range = |block: &[[u32; 3]]| {
            let (mut low, mut high) = (u32::MAX, 0);
            for &[a, b, c] in block {
                let lowest = a.min(b).min(c);
                (low, high) = (low.min(lowest), high.max(lowest));
            }
            low..=high
        };
        Self { all, lowest: parallel::map(all.chunks(BLOCK), range) }
    }

    /// Splits the vertices into at most one range per thread, each with about the same number of
    /// triangles by lowest vertex. Returns the boundaries of the ranges.
    fn stretches(&self, vertices: usize) -> Vec<u32> {
        let mut some: Vec<u32> =
            self.all.iter().step_by(SAMPLED).map(|&triangle| sorted(triangle)[0]).collect();
        some.sort_unstable();
        let tasks = rayon::current_num_threads().min(some.len() / GRAIN + 1);
        let mut ends = vec![0];
        ends.extend((1..tasks).map(|task| some[task * some.len() / tasks]));
        ends.push(vertices as u32);
        ends.dedup();
        ends
    }

    /// Returns the indices of the triangles that repeat an earlier triangle. Considers triangles
    /// whose lowest vertex is one of the `count` vertices from `first` on.
    fn repeated(&self, first: u32, count: usize) -> Vec<u32> {
        // One more for the triangles of other tasks.
        let mut bits = vec![0u16; count + 1];
        let mut suspects: Option<Vec<u32>> = None;
        for [second, third] in ROUNDS {
            let place = |[a, b, c]: [u32; 3]| {
                let hash = b.wrapping_mul(second) ^ c.wrapping_mul(third);
                let vertex = (a.wrapping_sub(first) as usize).min(count);
                (vertex, 1u16 << (hash.wrapping_mul(0x9e37_79b1) >> 28))
            };
            let mut later = Vec::new();
            self.visit(first, count, suspects.as_deref(), |t, corners| {
                let (vertex, bit) = place(corners);
                if bits[vertex] & bit != 0 && vertex < count {
                    later.push(t);
                }
                bits[vertex] |= bit;
            });
            bits.fill(0);
            for t in later {
                let (vertex, bit) = place(sorted(self.all[t as usize]));
                bits[vertex] |= bit;
            }
            let mut sharing = Vec::new();
            self.visit(first, count, suspects.as_deref(), |t, corners| {
                let (vertex, bit) = place(corners);
                if bits[vertex] & bit != 0 {
                    sharing.push(t);
                }
            });
            bits.fill(0);
            suspects = Some(sharing);
        }
        let mut suspects = suspects.unwrap_or_default();
        suspects.sort_unstable_by_key(|&t| (sorted(self.all[t as usize]), t));
        let repeats = |pair: &[u32]| {
            let [a, b] = [pair[0], pair[1]].map(|t| sorted(self.all[t as usize]));
            (a == b).then_some(pair[1])
        };
        suspects.windows(2).filter_map(repeats).collect()
    }

    /// Calls `visit` with the index and the sorted corners of each triangle in `some`. If `some` is
    /// `None`, it visits all triangles whose lowest vertex is one of `count` from `first` on, and
    /// others: a test of each would be mispredicted where files have no order.
    #[inline(always)]
    fn visit(
        &self,
        first: u32,
        count: usize,
        some: Option<&[u32]>,
        mut visit: impl FnMut(u32, [u32; 3]),
    ) {
        if let Some(some) = some {
            return some.iter().for_each(|&t| visit(t, sorted(self.all[t as usize])));
        }
        for (block, lowest) in self.lowest.iter().enumerate() {
            let outside =
                *lowest.end() < first || (*lowest.start() as usize) >= first as usize + count;
            if outside {
                continue;
            }
            let start = block * BLOCK;
            let end = self.all.len().min(start + BLOCK);
            for (i, triangle) in self.all[start..end].iter().enumerate() {
                visit((start + i) as u32, sorted(*triangle));
            }
        }
    }
}

#[inline(always)]
fn sorted([a, b, c]: [u32; 3]) -> [u32; 3] {
    let (low, high) = (a.min(b), a.max(b));
    [low.min(c), low.max(c.min(high)), high.max(c)]
}

/// Removes the elements at `places`, which are in ascending order.
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
    fn drop_removes_exactly_the_repeated_triangles() {
        let job = ReadContext { name: "", monitor: None, memory_limit: None };
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
            let mut faces = PlyFaces { triangles, uvs: Some(uvs), ..PlyFaces::default() };
            let before = faces.triangles.len();
            let dropped = drop(&mut faces, vertices as usize, &job).unwrap();
            assert_eq!(dropped as usize, before - expected.len());
            assert!(faces.triangles == expected);
            let uvs = faces.uvs.unwrap();
            assert!(expected.iter().zip(&uvs).all(|(t, uv)| t.map(|v| [v as f32; 2]) == *uv));
        }
    }
}
