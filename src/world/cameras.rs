//! What cameras see of a loaded scene: its meshes or none, and its origin of coordinates.

use std::collections::BTreeMap;

use super::{Bounds, Origin, View, World, lights, positions};
use crate::error::Problem;
use crate::scene::{CheckedCamera, Layer, Scene, ShapeKind};

impl World {
    /// Returns what a camera sees of the loaded scene, whose origin another camera may have chosen.
    pub fn view(&self, scene: &Scene, camera: &CheckedCamera) -> View {
        let shapes = scene.shapes.iter().map(|shape| &shape.kind);
        let boxed: Vec<_> = shapes.zip(self.bounds.iter().copied()).collect();
        let own = Origin::choose(camera, &boxed);
        View { own, here: self.origin.seen_by(camera, &boxed) }
    }

    /// Returns warnings about meshes that no camera sees, and about a layer of positions that is
    /// too coarse for one of them.
    pub fn camera_warnings(&self, scene: &Scene, cameras: &[CheckedCamera]) -> Vec<Problem> {
        // By their shape. A mesh that a camera may see in a copy has none.
        let mut warnings = BTreeMap::new();
        let is_unseen = |bounds: &Bounds| cameras.iter().all(|camera| bounds.outside_view(camera));
        for (index, (shape, bounds)) in scene.shapes.iter().zip(self.bounds.iter()).enumerate() {
            match &shape.kind {
                ShapeKind::Trimesh(spec) if is_unseen(bounds) => {
                    let whose = match cameras.len() {
                        0 | 1 => "the camera's view".to_string(),
                        count => format!("the view of all {count} cameras"),
                    };
                    let message = format!("{} lies outside {whose}", spec.path.display());
                    warnings.insert(index, Problem::new(&spec.place, message));
                }
                ShapeKind::Instance { of, .. }
                    if warnings.contains_key(of) && !is_unseen(bounds) =>
                {
                    warnings.remove(of);
                }
                _ => {}
            }
        }
        let mut warnings: Vec<Problem> = warnings.into_values().collect();
        if scene.layers.contains(&Layer::Position) {
            let whole = self.bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
            let coarse = |camera| positions::warning(camera, whole);
            warnings.extend(cameras.iter().find_map(coarse));
        }
        warnings
    }

    /// Returns warnings about what the rounding of positions changes in a render of the scene's
    /// camera alone.
    pub fn origin_warnings(&self, scene: &Scene) -> impl Iterator<Item = Problem> {
        let own = self.view(scene, &scene.camera).own;
        lights::occlusion_warning(scene, &own).into_iter().chain(own.warning())
    }
}
