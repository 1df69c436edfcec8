//! Names of all shapes and materials, also of those without a name in the scene file.

use std::borrow::Cow;
use std::collections::HashMap;

use crate::scene::{CheckedShape, Scene, ShapeKind};

/// Returns a name for every shape: its own name, or else its kind (for a mesh, `trimesh.` and the
/// file's stem). If that name is in use, `.2`, `.3`... is appended. Shapes with the same own name
/// keep it, except copies of a mesh with `instances`: each has a name of its own.
pub fn shapes(scene: &Scene) -> Vec<String> {
    let own = own_names(&scene.shapes);
    let mut used = UsedNames::new(own.iter().flatten());
    let names = scene.shapes.iter().zip(&own).map(|(shape, name)| match (name, &shape.kind) {
        (Some(name), _) => name.clone(),
        (None, ShapeKind::Instance { of, .. }) => used.unique(kind(&scene.shapes[*of].kind)),
        (None, own) => used.unique(kind(own)),
    });
    names.collect()
}

/// Returns the shapes' own names, of which those of copies are numbered.
fn own_names(shapes: &[CheckedShape]) -> Vec<Option<String>> {
    let mesh_of_copy = |(index, shape): (usize, &CheckedShape)| match &shape.kind {
        ShapeKind::Trimesh(mesh) if mesh.transform.is_some() => Some(index),
        ShapeKind::Instance { of, .. } => Some(*of),
        _ => None,
    };
    let meshes: Vec<Option<usize>> = shapes.iter().enumerate().map(mesh_of_copy).collect();
    let plain = shapes.iter().zip(&meshes).filter(|(_, mesh)| mesh.is_none());
    let mut used = UsedNames::new(plain.filter_map(|(shape, _)| shape.name.as_ref()));
    let mut names: Vec<_> = shapes.iter().map(|shape| shape.name.clone()).collect();
    let mut copies: Vec<usize> = (0..shapes.len()).filter(|&i| meshes[i].is_some()).collect();
    copies.sort_by_key(|&i| meshes[i]);
    for i in copies {
        names[i] = names[i].take().map(|name| used.unique(name));
    }
    names
}

/// Returns a name for every material: its own name, or else `material.` and the name of the first
/// shape that uses it. If that name is in use, `.2`, `.3`... is appended.
pub fn materials(scene: &Scene) -> Vec<String> {
    let shapes = shapes(scene);
    let mut users = vec![""; scene.materials.len()];
    for (shape, name) in scene.shapes.iter().zip(&shapes).rev() {
        users[shape.material] = name;
    }
    let mut used = UsedNames::new(scene.materials.iter().filter_map(|m| m.name.as_ref()));
    let mut unnamed = |user: &str| used.unique(format!("material.{user}"));
    let named = scene.materials.iter().zip(users);
    named.map(|(material, user)| material.name.clone().unwrap_or_else(|| unnamed(user))).collect()
}

fn kind(kind: &ShapeKind) -> String {
    match kind {
        ShapeKind::Sphere { .. } => "sphere".to_string(),
        ShapeKind::Plane { .. } => "plane".to_string(),
        ShapeKind::Triangle { .. } => "triangle".to_string(),
        ShapeKind::Trimesh(mesh) => {
            let stem = mesh.path.file_stem().unwrap_or_default();
            format!("trimesh.{}", stem.to_string_lossy())
        }
        ShapeKind::Instance { .. } => "instance".to_string(),
    }
}

/// The names in use. The value is the next number to append to the name.
struct UsedNames<'a>(HashMap<Cow<'a, str>, u32>);

impl<'a> UsedNames<'a> {
    fn new(names: impl Iterator<Item = &'a String>) -> Self {
        Self(names.map(|name| (Cow::from(name), 2)).collect())
    }

    /// Returns `base`, or the first of `base.2`, `base.3`... that is not in use.
    fn unique(&mut self, base: String) -> String {
        let mut name = base.clone();
        while self.0.contains_key(name.as_str()) {
            let next = self.0.entry(Cow::from(base.clone())).or_insert(2);
            name = format!("{base}.{next}");
            *next += 1;
        }
        self.0.insert(Cow::from(name.clone()), 2);
        name
    }
}
