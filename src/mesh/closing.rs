//! Which triangles without area close a mesh: with them, fewer edges belong to an odd number of
//! faces.

use std::collections::{HashMap, HashSet};

use glam::DVec3;

use super::places::{Places, edges};

/// A change of an edge that more candidates have is not passed on to them. So the time stays
/// proportional to the candidates, even if all have one edge.
const MOST_NEIGHBOURS: usize = 64;

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
/// vertex, in any unit.
pub fn closing_stitches(
    candidates: &[[u32; 3]],
    triangles: &[[u32; 3]],
    vertices: usize,
    position: impl Fn(u32) -> DVec3 + Sync,
) -> Vec<[u32; 3]> {
    if candidates.is_empty() {
        return Vec::new();
    }
    let places = Places::new(candidates, vertices, position);
    let mut numbers = HashMap::new();
    let mut corners = Vec::new();
    // Indices of the candidates with the same corners.
    let mut copies: Vec<Vec<usize>> = Vec::new();
    for (index, &candidate) in candidates.iter().enumerate() {
        let own = places.of(candidate);
        let mut sorted = own;
        sorted.sort_unstable();
        let number = *numbers.entry(sorted).or_insert(corners.len());
        if number == corners.len() {
            corners.push(own);
            copies.push(Vec::new());
        }
        copies[number].push(index);
    }
    let mut links = Links::new(&corners);
    let mut kept = vec![false; candidates.len()];
    let taken = links.taken(triangles.iter().flat_map(|&triangle| places.edges(triangle)));
    for (same, _) in copies.iter().zip(taken).filter(|(_, taken)| *taken) {
        kept[same[0]] = true;
    }
    if corners.len() < candidates.len() {
        let beside = |&&triangle: &&[u32; 3]| places.edges(triangle).any(|edge| links.has(edge));
        let mut seen = HashSet::new();
        let different = triangles.iter().filter(beside).filter(|&&t| seen.insert(places.key(t)));
        let edges: Vec<[u32; 2]> = different.flat_map(|&t| places.edges(t)).collect();
        let taken = links.taken(edges.into_iter());
        for (same, _) in copies.iter().zip(taken).filter(|(_, taken)| *taken) {
            if same.len() > 1 && !kept[same[0]] {
                (kept[same[0]], kept[same[1]]) = (true, true);
            }
        }
    }
    candidates.iter().zip(kept).filter_map(|(&candidate, kept)| kept.then_some(candidate)).collect()
}

/// The edges of candidates.
struct Links {
    numbers: HashMap<[u32; 2], u32>,
    /// Edges of each candidate.
    edges: Vec<[u32; 3]>,
    /// Candidates of each edge.
    users: Vec<Vec<u32>>,
    /// Whether an odd number of faces has the edge.
    odd: Vec<bool>,
}

impl Links {
    fn new(candidates: &[[u32; 3]]) -> Self {
        let mut numbers = HashMap::new();
        let mut users: Vec<Vec<u32>> = Vec::new();
        let of = |(candidate, &corners): (usize, &[u32; 3])| {
            edges(corners).map(|edge| {
                let number = *numbers.entry(edge).or_insert(users.len() as u32);
                if number as usize == users.len() {
                    users.push(Vec::new());
                }
                users[number as usize].push(candidate as u32);
                number
            })
        };
        let edges = candidates.iter().enumerate().map(of).collect();
        let odd = vec![false; users.len()];
        Self { numbers, edges, users, odd }
    }

    /// Whether a candidate has an edge.
    fn has(&self, edge: [u32; 2]) -> bool {
        self.numbers.contains_key(&edge)
    }

    /// Returns whether each candidate is taken, beside faces with these `edges`.
    fn taken(&mut self, edges: impl Iterator<Item = [u32; 2]>) -> Vec<bool> {
        self.odd.fill(false);
        for edge in edges {
            if let Some(&number) = self.numbers.get(&edge) {
                self.odd[number as usize] ^= true;
            }
        }
        self.choose()
    }

    /// Returns whether each candidate is taken, beside the odd edges.
    fn choose(&mut self) -> Vec<bool> {
        let without = self.odd.clone();
        let mut taken = self.decide();
        let mut waiting: Vec<u32> = (0..taken.len() as u32).rev().collect();
        while let Some(candidate) = waiting.pop() {
            let own = self.edges[candidate as usize];
            if own.iter().filter(|&&edge| self.odd[edge as usize]).count() < 2 {
                continue;
            }
            taken[candidate as usize] ^= true;
            for edge in own.map(|edge| edge as usize) {
                self.odd[edge] ^= true;
                if self.users[edge].len() <= MOST_NEIGHBOURS {
                    waiting.extend(&self.users[edge]);
                }
            }
        }
        self.drop_useless_groups(&without, &mut taken);
        taken
    }

    /// Decides about candidates by edges that no other undecided candidate has: they become even.
    /// Where there is no such edge, the last candidate is left out.
    fn decide(&mut self) -> Vec<bool> {
        let mut taken: Vec<Option<bool>> = vec![None; self.edges.len()];
        let mut undecided: Vec<usize> = self.users.iter().map(Vec::len).collect();
        let mut lonely: Vec<usize> = (0..undecided.len()).filter(|&e| undecided[e] == 1).collect();
        let mut rest = (0..taken.len()).rev();
        loop {
            let (candidate, take) = match lonely.pop() {
                Some(edge) => {
                    let mut users = self.users[edge].iter().map(|&user| user as usize);
                    let user = users.find(|&user| taken[user].is_none());
                    let Some(user) = user else { continue };
                    (user, self.odd[edge])
                }
                None => match rest.find(|&candidate| taken[candidate].is_none()) {
                    Some(candidate) => (candidate, false),
                    None => break,
                },
            };
            taken[candidate] = Some(take);
            for edge in self.edges[candidate].map(|edge| edge as usize) {
                self.odd[edge] ^= take;
                undecided[edge] -= 1;
                if undecided[edge] == 1 {
                    lonely.push(edge);
                }
            }
        }
        taken.into_iter().map(|taken| taken == Some(true)).collect()
    }

    /// Leaves out the candidates of each group whose edges are not fewer times odd than `without`.
    /// The candidates of a group are linked by shared edges.
    fn drop_useless_groups(&self, without: &[bool], taken: &mut [bool]) {
        let mut known = vec![false; without.len()];
        for start in 0..known.len() {
            if known[start] {
                continue;
            }
            known[start] = true;
            let mut group = vec![start];
            let mut next = 0;
            while let Some(&edge) = group.get(next) {
                next += 1;
                let neighbours = self.users[edge].iter();
                for &edge in neighbours.flat_map(|&c| &self.edges[c as usize]) {
                    if !std::mem::replace(&mut known[edge as usize], true) {
                        group.push(edge as usize);
                    }
                }
            }
            let odd = |of: &[bool]| group.iter().filter(|&&edge| of[edge]).count();
            if odd(&self.odd) >= odd(without) {
                let members = group.iter().flat_map(|&edge| &self.users[edge]);
                members.for_each(|&c| taken[c as usize] = false);
            }
        }
    }
}
