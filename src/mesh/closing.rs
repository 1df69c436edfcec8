//! Which triangles without area close a mesh: with them, fewer edges belong to an odd number of
//! faces.

use std::hash::{BuildHasher, RandomState};

use glam::DVec3;

use super::places::Places;
use super::shared_edges::{Groups, SharedEdges};
use crate::error::Result;

/// A change of an edge that more candidates have is not passed on to them. So the time stays
/// proportional to the candidates, even if all have one edge.
const MOST_NEIGHBOURS: usize = 64;

/// Returns the most memory in bytes that the choice among `candidates` takes, and that the search
/// for triangles beside them takes. `vertices` is the number of vertices.
pub fn stitching_bytes(candidates: usize, vertices: usize) -> u64 {
    match candidates as u64 {
        0 => 0,
        // The sum of the arrays where no two candidates share an edge, with room for growth.
        candidates => 4 * vertices as u64 + 144 * candidates,
    }
}

/// Returns the `candidates` that close a mesh, in their order. Vertices at the same place are one
/// vertex, and equal candidates one candidate. Each candidate must have three different places.
///
/// An edge that only one undecided candidate has decides about it. Then each candidate is left out,
/// or taken again, if this makes fewer edges odd. At the end, candidates that share edges are all
/// left out if they make no fewer edges odd than the mesh has without them. So the mesh never has
/// more odd edges than without candidates.
///
/// Where all faces exist twice, no edge is odd. So if candidates are equal, all is decided once
/// more with equal faces as one face. What closes that mesh is taken in pairs, which change nothing
/// about odd edges.
///
/// `vertices` is the number of vertices, above every index. `position` returns the place of a
/// vertex, in any unit. Of so many candidates that a scene cannot hold them, none is returned.
///
/// # Errors
/// Those of `ready`. It is called before each step, with the bytes that all steps so far and this
/// one take.
pub fn closing_stitches(
    candidates: &[[u32; 3]],
    triangles: &[[u32; 3]],
    vertices: usize,
    position: impl Fn(u32) -> DVec3 + Sync,
    ready: impl Fn(u64) -> Result<()>,
) -> Result<Vec<[u32; 3]>> {
    let countable = candidates.len() < u32::MAX as usize / 3;
    if candidates.is_empty() || !countable || u32::try_from(triangles.len()).is_err() {
        return Ok(Vec::new());
    }
    let bytes = stitching_bytes(candidates.len(), vertices);
    ready(bytes)?;
    let places = Places::new(candidates, vertices, position);
    ready(bytes)?;
    let copies = different(candidates, &places);
    ready(bytes)?;
    let corners = copies.iter().map(|&[first, _]| places.of(candidates[first as usize])).collect();
    let links = Links(SharedEdges::new(corners, places.count()));
    ready(bytes)?;
    let mut kept = vec![false; candidates.len()];
    let taken = links.taken(triangles.iter().flat_map(|&triangle| places.edges(triangle)));
    for ([first, _], _) in copies.iter().zip(taken).filter(|(_, taken)| *taken) {
        kept[*first as usize] = true;
    }
    if copies.len() < candidates.len() {
        ready(bytes)?;
        let is_linked = |edge| links.0.number(edge).is_some();
        let is_beside = |t: &u32| places.edges(triangles[*t as usize]).any(is_linked);
        let beside: Vec<u32> = (0..triangles.len() as u32).filter(is_beside).collect();
        // Here an index, then beside a hash.
        ready(bytes + 20 * beside.len() as u64)?;
        let key = |triangle: u32| places.key(triangles[triangle as usize]);
        let hasher = RandomState::new();
        let hashed = |triangle: u32| (hasher.hash_one(key(triangle)), triangle);
        let mut beside: Vec<(u64, u32)> = beside.into_iter().map(hashed).collect();
        beside.sort_unstable_by(|a, b| a.0.cmp(&b.0).then_with(|| key(a.1).cmp(&key(b.1))));
        beside.dedup_by(|a, b| a.0 == b.0 && key(a.1) == key(b.1));
        let edges = beside.iter().flat_map(|&(_, t)| places.edges(triangles[t as usize]));
        let taken = copies.iter().zip(links.taken(edges)).filter(|(_, taken)| *taken);
        for (copies, _) in taken {
            let [first, second] = copies.map(|index| index as usize);
            if first != second && !kept[first] {
                (kept[first], kept[second]) = (true, true);
            }
        }
    }
    let kept = candidates.iter().zip(kept).filter(|(_, kept)| *kept);
    Ok(kept.map(|(&candidate, _)| candidate).collect())
}

/// Returns the different candidates, in their order: for each, the index of the first one with its
/// places and that of the second. If there is no second one, both are the same.
fn different<P: Fn(u32) -> DVec3 + Sync>(
    candidates: &[[u32; 3]],
    places: &Places<P>,
) -> Vec<[u32; 2]> {
    let key = |index: u32| {
        let mut key = places.of(candidates[index as usize]);
        key.sort_unstable();
        key
    };
    let mut groups = Groups::new(candidates.len(), places.count(), |index| key(index)[0]);
    let mut all = Vec::with_capacity(candidates.len());
    for place in 0..places.count() {
        let group = groups.of_mut(place);
        group.sort_unstable_by_key(|&index| (key(index), index));
        let equal = group.chunk_by(|&a, &b| key(a) == key(b));
        all.extend(equal.map(|equal| [equal[0], equal[1.min(equal.len() - 1)]]));
    }
    all.sort_unstable();
    all
}

/// Candidates that are linked by their edges.
struct Links(SharedEdges);

impl Links {
    /// Returns whether each candidate is taken, beside faces with these `edges`.
    fn taken(&self, edges: impl Iterator<Item = [u32; 2]>) -> Vec<bool> {
        // Whether an odd number of faces has each edge.
        let mut odd = vec![false; self.0.count()];
        for edge in edges {
            if let Some(number) = self.0.number(edge) {
                odd[number as usize] ^= true;
            }
        }
        let without = odd.clone();
        let mut taken = self.decide(&mut odd);
        let mut waiting: Vec<u32> = (0..taken.len() as u32).rev().collect();
        while let Some(candidate) = waiting.pop() {
            let own = self.0.of(candidate);
            if own.iter().filter(|&&edge| odd[edge as usize]).count() < 2 {
                continue;
            }
            taken[candidate as usize] ^= true;
            for edge in own {
                odd[edge as usize] ^= true;
                let users = self.0.users(edge);
                if users.len() <= MOST_NEIGHBOURS {
                    waiting.extend(users);
                }
            }
        }
        drop(waiting);
        self.drop_useless_groups(&without, &odd, &mut taken);
        taken
    }

    /// Decides about candidates by edges that no other undecided candidate has: they become even.
    /// Where there is no such edge, the last candidate is left out.
    fn decide(&self, odd: &mut [bool]) -> Vec<bool> {
        let mut taken: Vec<Option<bool>> = vec![None; self.0.triangles()];
        let all = 0..self.0.count() as u32;
        let mut undecided: Vec<u32> = all.clone().map(|e| self.0.users(e).len() as u32).collect();
        let mut lonely: Vec<u32> = all.filter(|&edge| undecided[edge as usize] == 1).collect();
        let mut rest = (0..taken.len() as u32).rev();
        loop {
            let (candidate, take) = match lonely.pop() {
                Some(edge) => {
                    let user = self.0.users(edge).find(|&user| taken[user as usize].is_none());
                    let Some(user) = user else { continue };
                    (user, odd[edge as usize])
                }
                None => match rest.find(|&candidate| taken[candidate as usize].is_none()) {
                    Some(candidate) => (candidate, false),
                    None => break,
                },
            };
            taken[candidate as usize] = Some(take);
            for edge in self.0.of(candidate) {
                odd[edge as usize] ^= take;
                undecided[edge as usize] -= 1;
                if undecided[edge as usize] == 1 {
                    lonely.push(edge);
                }
            }
        }
        taken.into_iter().map(|taken| taken == Some(true)).collect()
    }

    /// Leaves out the candidates of each group whose edges are not fewer times odd than `without`.
    /// The candidates of a group are linked by shared edges.
    fn drop_useless_groups(&self, without: &[bool], with: &[bool], taken: &mut [bool]) {
        let mut known = vec![false; without.len()];
        let mut group: Vec<u32> = Vec::new();
        for start in 0..known.len() as u32 {
            if known[start as usize] {
                continue;
            }
            known[start as usize] = true;
            group.clear();
            group.push(start);
            let mut next = 0;
            while let Some(&edge) = group.get(next) {
                next += 1;
                for edge in self.0.users(edge).flat_map(|user| self.0.of(user)) {
                    if !std::mem::replace(&mut known[edge as usize], true) {
                        group.push(edge);
                    }
                }
            }
            let odd = |of: &[bool]| group.iter().filter(|&&edge| of[edge as usize]).count();
            if odd(with) >= odd(without) {
                let members = group.iter().flat_map(|&edge| self.0.users(edge));
                members.for_each(|user| taken[user as usize] = false);
            }
        }
    }
}
