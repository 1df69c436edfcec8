//! Fetches the corners of the triangles that the lanes of a packet hit.

use std::ops::Range;

use super::mesh::TriangleMesh;
use super::primitives::{Geometry, GeometryKind};
use crate::ray::{LANES, Mask, RayPacket};
use crate::simd::prefetch;

/// Prefetches the vertex indices of the triangles that were hit, for [`prefetch_vertices`] and
/// [`super::refine`].
#[inline(always)]
pub fn prefetch_indices(geometry: &Geometry, packet: &RayPacket) {
    for i in 0..LANES {
        if let Some(mesh) = geometry.meshes.get(packet.hits.geom[i] as usize) {
            prefetch(mesh.triangles(), packet.hits.prim[i] as usize);
        }
    }
}

/// Prefetches the vertices of the triangles that were hit, for some `lanes`.
#[inline(always)]
pub fn prefetch_vertices(geometry: &Geometry, packet: &RayPacket, lanes: Range<usize>) {
    for i in lanes {
        if let Some(mesh) = geometry.meshes.get(packet.hits.geom[i] as usize) {
            if let Some(corners) = mesh.triangles().get(packet.hits.prim[i] as usize) {
                for &corner in corners {
                    prefetch(mesh.vertices(), corner as usize);
                }
            }
        }
    }
}

/// Fetches the corners of the triangles and the scene-wide indices of the primitives, for the
/// lanes in `hit`. The `weights` of a quad are converted to its half. Returns the lanes that hit
/// spheres; their corners stay unchanged.
#[inline(always)]
pub fn gather(
    geometry: &Geometry,
    hit: &Mask,
    packet: &RayPacket,
    corners: &mut [[[f32; LANES]; 3]; 3],
    weights: &mut [[f32; LANES]; 2],
    primitive: &mut [u32; LANES],
) -> Mask {
    match one_geometry(geometry, hit, packet) {
        Some(GeometryKind::Mesh(mesh)) => {
            let base = geometry.primitive(mesh as u32, 0);
            one_mesh(&geometry.meshes[mesh], base, packet, corners, primitive);
            Mask::NONE
        }
        Some(GeometryKind::Instance(index)) => {
            let (mesh, instance) = geometry.instance(index);
            let base = geometry.primitive(packet.hits.geom[0], 0);
            one_mesh(mesh, base, packet, corners, primitive);
            for corner in corners.iter_mut() {
                *corner = instance.placement.place_lanes(*corner);
            }
            Mask::NONE
        }
        Some(GeometryKind::Quads) if one_primitive(packet) => {
            one_quad(geometry, packet, corners, weights, primitive);
            Mask::NONE
        }
        _ => one_by_one(geometry, hit, packet, corners, weights, primitive),
    }
}

/// The geometry that all lanes hit, if it is the same.
#[inline(always)]
fn one_geometry(geometry: &Geometry, hit: &Mask, packet: &RayPacket) -> Option<GeometryKind> {
    let geom = packet.hits.geom[0];
    let same =
        (0..LANES).fold(true, |same, i| same & (hit.0[i] != 0) & (packet.hits.geom[i] == geom));
    same.then(|| geometry.kind(geom))
}

/// Whether all lanes hit the same primitive of their geometry.
#[inline(always)]
fn one_primitive(packet: &RayPacket) -> bool {
    let prim = &packet.hits.prim;
    (0..LANES).fold(true, |same, i| same & (prim[i] == prim[0]))
}

/// Fetches the corners of the halves of one quad that all lanes hit.
#[inline(always)]
fn one_quad(
    geometry: &Geometry,
    packet: &RayPacket,
    corners: &mut [[[f32; LANES]; 3]; 3],
    weights: &mut [[f32; LANES]; 2],
    primitive: &mut [u32; LANES],
) {
    let prim = packet.hits.prim[0];
    *primitive = [geometry.primitive(packet.hits.geom[0], prim); LANES];
    let [v0, v1, v2, v3] = geometry.quads[prim as usize];
    let halves = [[v0, v2], [v1, v3], [v3, v1]];
    for i in 0..LANES {
        let (u, v) = (weights[0][i], weights[1][i]);
        let first = u + v <= 1.0;
        (weights[0][i], weights[1][i]) = if first { (u, v) } else { (1.0 - u, 1.0 - v) };
        for (corner, [a, b]) in corners.iter_mut().zip(halves) {
            for axis in 0..3 {
                corner[axis][i] = if first { a[axis] } else { b[axis] };
            }
        }
    }
}

/// Fetches the corners of triangles of one mesh that all lanes hit, in the coordinates of the mesh.
/// `base` is the scene-wide index of its first triangle.
#[inline(always)]
fn one_mesh(
    mesh: &TriangleMesh,
    base: u32,
    packet: &RayPacket,
    corners: &mut [[[f32; LANES]; 3]; 3],
    primitive: &mut [u32; LANES],
) {
    let triangles = fetch(mesh.triangles(), &packet.hits.prim);
    for k in 0..3 {
        corners[k] = fetch(mesh.vertices(), &triangles[k]);
    }
    for i in 0..LANES {
        primitive[i] = base + packet.hits.prim[i];
    }
}

/// Returns `rows[index[i]]` for all lanes i, as one array per component. With gather instructions
/// of AVX-512 it is no faster.
#[inline(always)]
fn fetch<T: Copy + Default>(rows: &[[T; 3]], index: &[u32; LANES]) -> [[T; LANES]; 3] {
    let mut fetched = [[T::default(); LANES]; 3];
    for i in 0..LANES {
        let row = rows[index[i] as usize];
        for k in 0..3 {
            fetched[k][i] = row[k];
        }
    }
    fetched
}

/// Fetches the corners lane by lane, for packets that hit several geometries.
#[inline(never)]
fn one_by_one(
    geometry: &Geometry,
    hit: &Mask,
    packet: &RayPacket,
    corners: &mut [[[f32; LANES]; 3]; 3],
    weights: &mut [[f32; LANES]; 2],
    primitive: &mut [u32; LANES],
) -> Mask {
    let mut spheres = Mask::NONE;
    for i in (0..LANES).filter(|&i| hit.0[i] != 0) {
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        primitive[i] = geometry.primitive(geom, prim);
        let triangle = match geometry.kind(geom) {
            GeometryKind::Mesh(mesh) => geometry.meshes[mesh].corners(prim),
            GeometryKind::Quads => {
                let half = geometry.quad_half(prim, weights[0][i], weights[1][i]);
                (weights[0][i], weights[1][i]) = (half.1, half.2);
                half.0
            }
            GeometryKind::Instance(index) => geometry.instance_corners(index, prim),
            GeometryKind::Spheres => {
                spheres.0[i] = -1;
                continue;
            }
        };
        for (corner, vertex) in corners.iter_mut().zip(&triangle) {
            for axis in 0..3 {
                corner[axis][i] = vertex[axis];
            }
        }
    }
    spheres
}

#[cfg(test)]
mod tests {
    use super::super::placement::{Instance, Placement};
    use super::super::sphere::Sphere;
    use super::*;
    use crate::ray::NONE;
    use glam::{DMat3, DVec3};

    /// Two meshes, two quads, two spheres and an instance. All vertices differ.
    fn geometry() -> Geometry {
        let mut next = 0.0;
        let mut vertices = |count| {
            let mut vertex = || [(); 3].map(|()| (next += 1.0, next).1);
            (0..count).map(|_| vertex()).collect::<Vec<[f32; 3]>>()
        };
        let mut mesh = |triangles: u32| {
            let indices = (0..triangles).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            TriangleMesh::new(vertices(3 * triangles), indices, false)
        };
        let (meshes, shared) = (vec![mesh(3), mesh(LANES as u32)], mesh(LANES as u32));
        let quads = [vertices(4), vertices(4)].map(|quad| [quad[0], quad[1], quad[2], quad[3]]);
        let spheres = vec![Sphere { center: DVec3::ZERO, radius: 1.0 }; 2];
        let shared = Geometry::new(DVec3::ZERO, vec![shared], vec![], vec![]).unwrap();
        let placement = Placement::new(DMat3::IDENTITY * 2.0, DVec3::new(1.0, 3.0, 5.0));
        let instance = Instance::new(0, placement, [DVec3::ZERO, DVec3::ONE]);
        let all = Geometry::new(DVec3::ZERO, meshes, quads.to_vec(), spheres).unwrap();
        all.with_instances(vec![shared], vec![instance]).unwrap()
    }

    /// A packet that hits the primitives `prim` of the geometries `geom`, by lane. The halves of
    /// quads alternate.
    fn packet(geom: impl Fn(usize) -> u32, prim: impl Fn(usize) -> u32) -> RayPacket {
        let mut packet = RayPacket::EMPTY;
        for i in 0..LANES {
            (packet.hits.geom[i], packet.hits.prim[i]) = (geom(i), prim(i));
            packet.hits.u[i] = 0.0625 * i as f32;
            packet.hits.v[i] = if i % 2 == 0 { 0.0 } else { 0.96875 };
        }
        packet
    }

    /// Checks the lanes in `hit`. All others keep the values that they had.
    fn check(geometry: &Geometry, hit: &Mask, packet: &RayPacket) {
        let mut corners = [[[-1.0; LANES]; 3]; 3];
        let mut weights = [packet.hits.u, packet.hits.v];
        let mut primitive = [NONE; LANES];
        let spheres = gather(geometry, hit, packet, &mut corners, &mut weights, &mut primitive);
        for i in 0..LANES {
            let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
            let (u, v) = (packet.hits.u[i], packet.hits.v[i]);
            let found = corners.map(|corner| corner.map(|axis| f64::from(axis[i])));
            let second = u + v > 1.0 && geom == geometry.quads_id();
            let is_hit = hit.0[i] != 0;
            let is_sphere = is_hit && geom == geometry.spheres_id();
            assert_eq!(spheres.0[i], -i32::from(is_sphere));
            let expected = if is_hit { geometry.primitive(geom, prim) } else { NONE };
            assert_eq!(primitive[i], expected);
            if !is_hit || is_sphere {
                assert_eq!(found, [[-1.0; 3]; 3]);
                continue;
            }
            let triangle = geometry.triangles(geom, prim).find(|&(_, half)| half == second);
            assert_eq!(found, triangle.unwrap().0.map(|corner| corner.to_array()));
            let expected = if second { [1.0 - u, 1.0 - v] } else { [u, v] };
            assert_eq!([weights[0][i], weights[1][i]], expected);
        }
    }

    #[test]
    fn every_packet_has_the_triangles_that_it_hits() {
        let geometry = geometry();
        let (quads, spheres) = (geometry.quads_id(), geometry.spheres_id());
        let lane = |i: usize| i as u32;
        let one_geometry = [
            packet(|_| 0, |i| lane(i % 3)),
            packet(|_| 1, lane),
            packet(|_| geometry.instance_id(0), lane),
            packet(|_| quads, |_| 1),
            packet(|_| quads, |i| lane(i % 2)),
            packet(|_| quads, |i| u32::from(i == LANES - 1)),
            packet(|_| spheres, |i| lane(i % 2)),
        ];
        let mixed = packet(|i| lane(i % 5), |i| lane(i / 5 % 2));
        let last = packet(|i| if i == LANES - 1 { quads } else { 1 }, |_| 1);
        let mut some = Mask::ALL;
        (some.0[0], some.0[7]) = (0, 0);
        for packet in one_geometry.iter().chain([&mixed, &last]) {
            check(&geometry, &Mask::ALL, packet);
            check(&geometry, &some, packet);
        }
    }
}
