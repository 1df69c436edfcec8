//! Places the meshes that instances share: as instances of the geometry, or as copies.

use std::path::PathBuf;

use glam::{DAffine3, DVec3};

use super::bounds::Bounds;
use super::place::PlacedMesh;
use super::resolution::{CollapseSuspect, ulp};
use crate::error::{Error, ErrorKind, Problem, Result};
use crate::geometry::{Geometry, Instance, Placement, TriangleMesh, Unseen};
use crate::ray::RayKind;
use crate::reserve::MemoryLimit;
use crate::scene::{Scene, ShapeKind};
use crate::shading::{Owner, Shape, Shapes};

/// The meshes of a scene that instances share, each relative to an origin of its own.
#[derive(Default)]
pub struct SharedMeshes(Vec<SharedMesh>);

struct SharedMesh {
    /// Index of the shape with the mesh, which is also its first instance.
    shape: usize,
    origin: DVec3,
    /// Box of the used vertices, relative to `origin`.
    bounds: [DVec3; 2],
    mesh: TriangleMesh,
    /// Place in the scene file and path of the mesh, for messages.
    source: (String, PathBuf),
    /// True if the vertices of the file are f64.
    was_f64: bool,
}

impl SharedMeshes {
    /// Adds the mesh of the shape with this index. Moves the data of its vertices to `shape`.
    ///
    /// # Errors
    /// As [`PlacedMesh::into_triangles`].
    pub fn add(
        &mut self,
        index: usize,
        mesh: PlacedMesh,
        shape: &mut Shape,
        room: &mut Option<MemoryLimit>,
    ) -> Result<()> {
        let placed = mesh.bounds();
        let origin = placed.origin();
        let mut bounds = [placed.min - origin, placed.max - origin];
        // Vertices are rounded to f32 by at most half an ulp.
        let size = bounds[0].abs().max(bounds[1].abs()) * f64::from(f32::EPSILON);
        bounds = [bounds[0] - size, bounds[1] + size];
        let (source, was_f64) = (mesh.place_and_path(), mesh.is_f64());
        let mesh = mesh.into_triangles(origin, shape, room)?;
        self.0.push(SharedMesh { shape: index, origin, bounds, mesh, source, was_f64 });
        Ok(())
    }

    /// The meshes, in the order of their shapes.
    pub fn meshes(&self) -> impl Iterator<Item = &TriangleMesh> {
        self.0.iter().map(|shared| &shared.mesh)
    }

    /// Checks that a copy of each mesh for each of its instances fits into `limit`.
    ///
    /// # Errors
    /// As [`MemoryLimit::check`].
    pub fn copies_fit(&self, scene: &Scene, shapes: &[Shape], limit: MemoryLimit) -> Result<()> {
        let mut left = limit;
        for shared in &self.0 {
            let copies = placements(scene, shared.shape).count() as u64;
            let each = shared.mesh.bytes() + shapes[shared.shape].vertex_bytes();
            let bytes = each.saturating_mul(copies);
            left.check(bytes, &format!("copies of {}", shared.source.1.display()))?;
            left = left.less(bytes);
        }
        Ok(())
    }

    /// Returns a warning for each mesh that has collapsed edges in an instance. Of the instances of
    /// a mesh, only the one is examined where the steps of f32 are largest in its coordinates.
    pub fn collapse_warnings(&self, scene: &Scene, origin: DVec3) -> Vec<Problem> {
        self.0.iter().filter_map(|shared| shared.collapse_warning(scene, origin)).collect()
    }

    /// Completes geometry and shapes: adds all instances, or a mesh for each if `copy`. Then sets
    /// which primitives each kind of ray passes through.
    ///
    /// # Errors
    /// Too many primitives.
    pub fn place(
        self,
        scene: &Scene,
        mut geometry: Geometry,
        mut shapes: Shapes,
        copy: bool,
    ) -> Result<(Geometry, Shapes)> {
        let origin = geometry.origin;
        let (mut meshes, mut instances) = (Vec::new(), Vec::new());
        let (mut copies, mut copy_owners, mut owners) = (Vec::new(), Vec::new(), Vec::new());
        for shared in self.0 {
            let (mesh, like) = (meshes.len(), shared.shape as u32);
            for (shape, transform) in placements(scene, shared.shape) {
                let placement = shared.placement(transform, origin);
                if copy {
                    copies.push(shared.mesh.placed(&placement));
                    copy_owners.push(Owner::One(shape as u32));
                    // The first instance is also the original of the others: it comes last.
                    if shape != shared.shape {
                        shapes.shapes[shape] = copied(&shapes.shapes[shared.shape], &placement);
                    }
                } else {
                    instances.push(Instance::new(mesh, placement, shared.bounds));
                    owners.push(Owner::Instance { shape: shape as u32, like });
                }
            }
            if copy {
                if let Some((_, first)) = placements(scene, shared.shape).next() {
                    let placement = shared.placement(first, origin);
                    let original = &mut shapes.shapes[shared.shape];
                    *original = copied(original, &placement);
                }
            } else {
                let mesh = Geometry::new(shared.origin, vec![shared.mesh], vec![], vec![]);
                meshes.push(mesh.map_err(too_many)?);
            }
        }
        if !copies.is_empty() {
            let first = geometry.meshes.len();
            shapes.owners.splice(first..first, copy_owners);
            let Geometry { meshes: mut all, quads, spheres, .. } = geometry;
            let count = copies.len();
            all.extend(copies);
            geometry = Geometry::new(origin, all, quads, spheres).map_err(too_many)?;
            geometry.copies = count;
        }
        shapes.owners.extend(owners);
        let geometry = geometry.with_instances(meshes, instances).map_err(too_many)?;
        Ok((with_unseen(geometry, scene, &shapes.owners), shapes))
    }
}

impl SharedMesh {
    fn collapse_warning(&self, scene: &Scene, origin: DVec3) -> Option<Problem> {
        let [min, max] = self.bounds.map(|corner| corner + self.origin);
        let steps = |transform: &DAffine3| {
            let Bounds { min, max } = Bounds { min, max }.transformed(transform);
            let step = ulp((min - origin).abs().max((max - origin).abs()).max_element());
            // An upper bound of what the inverse stretches a length by.
            let inverse = transform.matrix3.inverse().to_cols_array();
            (step, step * inverse.iter().map(|x| x * x).sum::<f64>().sqrt())
        };
        let instances = placements(scene, self.shape).map(|(_, to)| (to, steps(to)));
        let (transform, (step, in_mesh)) =
            instances.max_by(|(_, a), (_, b)| a.1.total_cmp(&b.1))?;
        let own = self.bounds[0].abs().max(self.bounds[1].abs()).max_element();
        // As for `PlacedMesh::collapse_suspect`.
        if !self.was_f64 && in_mesh <= 4.0 * ulp(own) {
            return None;
        }
        let (place, path) = self.source.clone();
        CollapseSuspect { place, path, ulp: step }
            .settle_instance(&self.mesh, &self.placement(transform, origin))
    }

    /// From the coordinates of the mesh to those relative to `origin`.
    fn placement(&self, transform: &DAffine3, origin: DVec3) -> Placement {
        Placement::new(transform.matrix3, transform.transform_point3(self.origin) - origin)
    }
}

/// The instances of the mesh of a shape: the index of each instance's shape, and its transform.
fn placements(scene: &Scene, mesh: usize) -> impl Iterator<Item = (usize, &DAffine3)> {
    scene.shapes.iter().enumerate().filter_map(move |(index, shape)| match &shape.kind {
        ShapeKind::Trimesh(spec) if index == mesh => Some((index, spec.transform.as_deref()?)),
        ShapeKind::Instance { of, transform } if *of == mesh => Some((index, &**transform)),
        _ => None,
    })
}

/// The data of vertices and faces of a placed copy.
fn copied(shape: &Shape, placement: &Placement) -> Shape {
    let normals = shape.normals.as_ref();
    let normals = normals.map(|normals| normals.mapped(|normal| placement.normal(normal)));
    Shape { normals, ..shape.clone() }
}

/// The error of a scene with at least `count` primitives.
pub(super) fn too_many(count: u64) -> Error {
    let message = format!("{count} primitives are more than the 4294967294 that fit");
    Error::new(ErrorKind::Limit, Problem::new("scene", message))
}

/// Sets which primitives each kind of ray passes through. `owners` are the shapes of each geometry.
fn with_unseen(geometry: Geometry, scene: &Scene, owners: &[Owner]) -> Geometry {
    let unseen = RayKind::ALL.map(|kind| {
        let mut unseen = Unseen::NONE;
        let passes = |shape: u32| !scene.shapes[shape as usize].visible.kinds()[kind as usize];
        for (owner, ends) in owners.iter().zip(geometry.bases().windows(2)) {
            match owner {
                Owner::One(shape) | Owner::Instance { shape, .. } => {
                    if passes(*shape) {
                        unseen.push(ends[0]..ends[1]);
                    }
                }
                Owner::Each(shapes) => {
                    let hidden = (ends[0]..).zip(shapes).filter(|(_, shape)| passes(**shape));
                    hidden.for_each(|(primitive, _)| unseen.push(primitive..primitive + 1));
                }
            }
        }
        unseen
    });
    geometry.with_unseen(unseen)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::monitor::Monitor;
    use crate::scene::{self, Source};
    use crate::world::{LoadOptions, World};

    /// Backends without instances need a copy of the mesh for each.
    #[test]
    fn copies_are_within_the_limit_of_memory() {
        let load = |bytes: u64, copy_instances| {
            let at = |x: u32| format!("[[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]");
            let instances: Vec<String> = (0..8).map(at).collect();
            let text = format!(
                r#"{{ "camera": {{ "type": "pinhole", "width": 8, "height": 8, "fov": 50,
                "position": [0, 0, 9], "target": [0, 0, 0], "up": [0, 1, 0] }},
                "scene": {{ "shapes": [{{ "type": "trimesh", "path": "assets/teapot.ply",
                "fit": 1, "smooth": true, "material": {{}}, "instances": [{}] }}] }} }}"#,
                instances.join(", ")
            );
            let folder = std::path::Path::new("");
            let source = Source::Text { name: "s.json", text: text.as_bytes(), folder };
            let scene = scene::load(source, &[]).unwrap().scene;
            let memory_limit = Some(MemoryLimit { bytes, set_by_user: true });
            let options = LoadOptions { copy_instances, memory_limit, ..LoadOptions::default() };
            World::load(&scene, options, &Monitor::default()).map(|(world, _)| world.mesh_bytes())
        };
        let (one, copies) = (load(1 << 30, false).unwrap(), load(1 << 30, true).unwrap());
        assert!(copies > 6 * one, "{one} {copies}");
        assert!(load(copies / 2, false).is_ok());
        let error = load(copies / 2, true).unwrap_err().to_string();
        assert!(error.contains("copies of assets/teapot.ply"), "{error}");
        assert!(load(2 * copies, true).is_ok());
    }
}
