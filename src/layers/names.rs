//! What shapes and materials are called where the scene does not say it.

use std::borrow::Cow;
use std::collections::HashMap;

use crate::scene::{Scene, ShapeKind};

/// A name for every shape: its own, else its kind (a mesh's with the file's name), numbered from the
/// second on where several would have the same. Shapes with the same name of their own share it.
pub fn shapes(scene: &Scene) -> Vec<String> {
    let mut taken = Taken::new(scene.shapes.iter().filter_map(|shape| shape.name.as_ref()));
    let names = scene.shapes.iter().map(|shape| match &shape.name {
        Some(name) => name.clone(),
        None => taken.free(kind(&shape.kind)),
    });
    names.collect()
}

/// A name for every material: its key, else `material.` and the name of the shape that uses it.
pub fn materials(scene: &Scene) -> Vec<String> {
    let shapes = shapes(scene);
    let mut users = vec![""; scene.materials.len()];
    for (shape, name) in scene.shapes.iter().zip(&shapes).rev() {
        users[shape.material] = name;
    }
    let mut taken = Taken::new(scene.materials.iter().filter_map(|m| m.name.as_ref()));
    let names = scene.materials.iter().zip(users).map(|(material, user)| match &material.name {
        Some(name) => name.clone(),
        None => taken.free(format!("material.{user}")),
    });
    names.collect()
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
    }
}

/// Names that are taken, and the next number to try behind each.
struct Taken<'a>(HashMap<Cow<'a, str>, u32>);

impl<'a> Taken<'a> {
    fn new(names: impl Iterator<Item = &'a String>) -> Self {
        Self(names.map(|name| (Cow::from(name), 2)).collect())
    }

    /// `base`, or the first of `base.2`, `base.3`... that nobody has.
    fn free(&mut self, base: String) -> String {
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
