//! Sorts the shapes of a scene into geometries, relative to the scene's origin.

use glam::DVec3;

use super::instances::{SharedMeshes, too_many};
use super::place::PlacedMesh;
use crate::error::Result;
use crate::geometry::{Geometry, Sphere, TriangleMesh};
use crate::reserve::{self, MemoryLimit};
use crate::scene::{Role, Scene, ShapeKind};
use crate::shading::{Owner, Shape, Shapes, UvFrame, UvSource};

/// Sorts the shapes into geometries: one per mesh, then one each for all single triangles, all
/// quads and all spheres. Points of clouds are spheres. `meshes` holds indices of shapes with their
/// meshes. Meshes of instances are returned apart, for [`SharedMeshes::place`].
///
/// # Errors
/// A lack of memory, or too many primitives. `room` is that of [`PlacedMesh::into_triangles`].
pub(super) fn gather(
    scene: &Scene,
    meshes: Vec<(usize, PlacedMesh)>,
    origin: DVec3,
    room: &mut Option<MemoryLimit>,
) -> Result<(Geometry, Shapes, SharedMeshes)> {
    let local = |p: DVec3| (p - origin).as_vec3().to_array();
    let mut shapes: Vec<Shape> = Vec::with_capacity(scene.shapes.len());
    let (mut quads, mut quad_shapes) = (Vec::new(), Vec::new());
    let (mut spheres, mut sphere_shapes) = (Vec::new(), Vec::new());
    let (mut corners, mut triangle_shapes) = (Vec::new(), Vec::new());
    for (index, shape) in scene.shapes.iter().enumerate() {
        let index = index as u32;
        let textured = scene.materials[shape.material].texture.is_some();
        let mut first = 0;
        let uv = match &shape.kind {
            ShapeKind::Sphere { center, radius, pole } => {
                first = spheres.len() as u32;
                spheres.push(Sphere { center: *center - origin, radius: *radius });
                sphere_shapes.push(index);
                UvSource::Sphere { pole: *pole }
            }
            ShapeKind::Plane { corners } => {
                first = quads.len() as u32;
                quads.push(corners.map(local));
                quad_shapes.push(index);
                linear(textured, || UvFrame::from_quad(&corners.map(|p| p - origin)))
            }
            ShapeKind::Triangle { corners: triangle } => {
                first = triangle_shapes.len() as u32;
                corners.extend(triangle.map(local));
                triangle_shapes.push(index);
                linear(textured, || UvFrame::from_triangle(&triangle.map(|p| p - origin)))
            }
            ShapeKind::Trimesh(_) | ShapeKind::Instance { .. } => UvSource::None,
        };
        let (material, role) = (shape.material as u32, shape.role);
        let (normals, colors, textures) = (None, None, None);
        shapes.push(Shape { material, uv, normals, colors, textures, role, first });
    }
    let (mut arrays, mut shared) = (Vec::new(), SharedMeshes::default());
    let mut owners = Vec::new();
    // The index of the shape of each cloud of points, and the end of its spheres.
    let mut clouds: Vec<(u32, usize)> = Vec::new();
    let single_spheres = spheres.len();
    for (index, mesh) in meshes {
        if mesh.is_cloud() {
            mesh.append_spheres(origin, &mut shapes[index], &mut spheres)?;
            clouds.push((index as u32, spheres.len()));
            continue;
        }
        if mesh.is_shared() {
            shared.add(index, mesh, &mut shapes[index], room)?;
            continue;
        }
        owners.push(Owner::One(index as u32));
        arrays.push(mesh.into_triangles(origin, &mut shapes[index], room)?);
    }
    if !triangle_shapes.is_empty() {
        let triangles =
            (0..triangle_shapes.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
        arrays.push(TriangleMesh::new(corners, triangles, false));
        owners.push(Owner::Each(triangle_shapes));
    }
    let sphere_owner = match clouds[..] {
        [(cloud, _)] if single_spheres == 0 => Owner::One(cloud),
        _ => {
            reserve::exact(&mut sphere_shapes, spheres.len() - single_spheres, "scene")?;
            for (cloud, end) in clouds {
                sphere_shapes.resize(end, cloud);
            }
            Owner::Each(sphere_shapes)
        }
    };
    owners.extend([Owner::Each(quad_shapes), sphere_owner]);
    let geometry = Geometry::new(origin, arrays, quads, spheres).map_err(too_many)?;
    let has_roles = shapes.iter().any(|shape| shape.role != Role::Surface);
    let (materials, textures) = (Vec::new(), Vec::new());
    let shapes = Shapes { owners, shapes, materials, textures, has_roles, has_areas: false };
    Ok((geometry, shapes, shared))
}

/// Returns the texture coordinates of a plane or a triangle. Only textured shapes store a frame.
fn linear(textured: bool, frame: impl FnOnce() -> UvFrame) -> UvSource {
    if textured { UvSource::Linear(Box::new(frame())) } else { UvSource::Corners }
}
