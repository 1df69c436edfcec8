//! Finds whether a mesh is closed. Then the parity of crossings separates inside from outside.

use rayon::prelude::*;

use super::arrays::MeshArrays;

/// Returns whether every edge belongs to an even number of faces. Vertices with equal coordinates
/// are the same vertex, whatever their indices are.
pub(super) fn is_closed(mesh: &dyn MeshArrays) -> bool {
    let (vertices, faces) = (mesh.vertices(), mesh.faces());
    // Adding 0 turns -0 into 0.
    let key =
        |i: usize| vertices.get(i).map_or([0; 3], |v| v.to_array().map(|x| (x + 0.0).to_bits()));
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.par_sort_unstable_by_key(|&i| key(i as usize));
    let mut first = vec![0u32; vertices.len()];
    for pair in 0..order.len() {
        let same = pair > 0 && key(order[pair] as usize) == key(order[pair - 1] as usize);
        let leader = if same { first[order[pair - 1] as usize] } else { order[pair] };
        first[order[pair] as usize] = leader;
    }
    let vertex = |index: Option<u64>| index.and_then(|i| first.get(i as usize)).copied();
    let mut edges: Vec<u64> = (0..faces.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let [a, b, c] = faces.get(i).map(|index| vertex(index).unwrap_or(u32::MAX));
            [(a, b), (b, c), (c, a)]
                .into_iter()
                .filter(|(a, b)| a != b)
                .map(|(a, b)| u64::from(a.min(b)) << 32 | u64::from(a.max(b)))
        })
        .collect();
    edges.par_sort_unstable();
    edges.chunk_by(|a, b| a == b).all(|same| same.len() % 2 == 0)
}
