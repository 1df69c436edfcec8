//! Finds whether a mesh is closed. Then the parity of crossings separates inside from outside.

use rayon::prelude::*;

use super::arrays::MeshArrays;
use crate::error::Result;
use crate::mesh::position_key;
use crate::monitor::Monitor;
use crate::parallel;
use crate::reserve;

/// In place of an edge from a vertex to itself. No edge has this number.
const NO_EDGE: u64 = u64::MAX;

/// Returns whether every edge belongs to an even number of faces. Vertices with equal coordinates
/// are the same vertex, whatever their indices are.
///
/// # Errors
/// `Retry` if there is too little memory; `Interrupted` if the monitor was stopped.
pub(super) fn is_closed(mesh: &dyn MeshArrays, monitor: &Monitor) -> Result<bool> {
    let (vertices, faces) = (mesh.vertices(), mesh.faces());
    let key = |i: usize| vertices.get(i).map_or([0; 3], position_key);
    let mut order: Vec<u32> = Vec::new();
    reserve::exact(&mut order, vertices.len(), "vertices")?;
    order.extend(0..vertices.len() as u32);
    monitor.check()?;
    order.par_sort_unstable_by_key(|&i| key(i as usize));
    monitor.check()?;
    let mut first = reserve::filled(0u32, vertices.len(), "vertices")?;
    for pair in 0..order.len() {
        let same = pair > 0 && key(order[pair] as usize) == key(order[pair - 1] as usize);
        let leader = if same { first[order[pair - 1] as usize] } else { order[pair] };
        first[order[pair] as usize] = leader;
    }
    let vertex = |index: Option<u64>| index.and_then(|i| first.get(i as usize)).copied();
    let edge = |(a, b): (u32, u32)| match a == b {
        true => NO_EDGE,
        false => u64::from(a.min(b)) << 32 | u64::from(a.max(b)),
    };
    let mut edges = reserve::filled([0u64; 3], faces.len(), "edges")?;
    parallel::fill(&mut edges, |i| {
        let [a, b, c] = faces.get(i).map(|index| vertex(index).unwrap_or(u32::MAX));
        [(a, b), (b, c), (c, a)].map(edge)
    });
    let mut edges = edges.into_flattened();
    monitor.check()?;
    edges.par_sort_unstable();
    let groups = edges.chunk_by(|a, b| a == b);
    Ok(groups.filter(|same| same[0] != NO_EDGE).all(|same| same.len() % 2 == 0))
}
