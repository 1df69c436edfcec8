//! Converts the lights of a scene to those of its world.

use glam::{DVec3, Vec3};

use super::bounds::Bounds;
use super::maps::Maps;
use super::origin::Origin;
use crate::error::Problem;
use crate::geometry::Geometry;
use crate::scene::{self, Layer, LightKind, MapUse, OcclusionRays, Scene};
use crate::shading::{Area, Cone, Distant, Emitter, Environment, Light, TurnedMap};

/// The image of a visible environment, as rays that hit nothing see it.
#[derive(Debug, Clone)]
pub struct VisibleEnvironment {
    map: TurnedMap,
    factor: Vec3,
}

impl VisibleEnvironment {
    /// Returns the radiance in a direction of any length but 0.
    pub fn seen(&self, direction: Vec3) -> Vec3 {
        self.map.seen(direction) * self.factor
    }
}

/// Returns the white light of the hemisphere whose shadow rays give the layer of ambient occlusion.
/// `None` if the scene lacks the layer.
pub(super) fn occlusion(scene: &Scene, geometry: &Geometry) -> Option<Light> {
    if !scene.layers.contains(&Layer::Occlusion) {
        return None;
    }
    let OcclusionRays { distance, samples } = scene.occlusion;
    let hemisphere = match distance {
        Some(distance) => Environment::within(distance),
        None => Environment::new(geometry, None),
    };
    let area = Area::from_distant(Distant::Environment(hemisphere), samples);
    Some(Light { diffuse: Vec3::ONE, specular: Vec3::ZERO, emitter: Emitter::Area(area) })
}

/// Returns a warning if `aodistance` is shorter than positions can express at the largest
/// coordinate that any surface may have.
pub(super) fn occlusion_warning(scene: &Scene, origin: &Origin) -> Option<Problem> {
    let distance = scene.occlusion.distance.filter(|_| scene.layers.contains(&Layer::Occlusion))?;
    raised(distance, origin).map(|message| Problem::new("/output/aodistance", message))
}

/// Returns where [`Environment::within`] raises a distance, if any surface can be there.
fn raised(distance: f64, origin: &Origin) -> Option<String> {
    let Origin { at_camera, extent, nearest, .. } = *origin;
    let beside = if nearest.is_finite() { nearest } else { 0.0 };
    let largest = if at_camera { extent + beside } else { extent / 2.0 };
    let (share, place) = (
        f64::from(Environment::LEAST_SHARE),
        if at_camera { "the camera" } else { "the middle of the scene" },
    );
    (distance < largest * share).then(|| {
        format!(
            "found {distance:e}, which the rounding of positions exceeds farther than {:.1e} from {place}: there, up to {:.1e} is used",
            distance / share,
            largest * share
        )
    })
}

/// Returns a warning for each one-sided area light that has all boxes of shapes behind it.
pub(super) fn facing_warnings<'s>(
    scene: &'s Scene,
    boxes: &'s [Bounds],
) -> impl Iterator<Item = Problem> + 's {
    let corners = || boxes.iter().flat_map(|bounds| bounds.corners()).filter(|c| c.is_finite());
    let is_empty = corners().next().is_none();
    let whole = corners().fold(Bounds::EMPTY, |all, c| all.union(Bounds { min: c, max: c }));
    // Corners in front of a light. Most lights have one of them in front, too, so not every light
    // is compared with every shape.
    let mut witnesses: Vec<DVec3> = Vec::new();
    scene.lights.iter().enumerate().filter_map(move |(number, light)| {
        let LightKind::Area { corner, edge, height, lambertian: true, .. } = light.kind else {
            return None;
        };
        let normal = edge.cross(height).normalize();
        // A shape in the light's plane receives nothing either, however its corners are rounded.
        let before = |point: &DVec3| normal.dot(*point - corner) > ROUNDED * point.distance(corner);
        if is_empty || witnesses.iter().any(before) {
            return None;
        }
        let is_behind_all = whole.corners().iter().all(|c| normal.dot(*c - corner) <= 0.0);
        let witness = if is_behind_all { None } else { corners().find(before) };
        if let Some(witness) = witness {
            witnesses.push(witness);
            return None;
        }
        let message = "emits away from every shape: nothing receives its light";
        let place = format!("/scene/lightsources/{number}");
        Some(
            Problem::new(place, message)
                .help("a lambertian light has one side: swap `v1` and `v2`"),
        )
    })
}

/// Largest sine of an angle to a plane that may come from the rounding of decimals in a file.
const ROUNDED: f64 = 1e-7;

fn turned(spec: &MapUse, maps: &Maps) -> Option<TurnedMap> {
    Some(TurnedMap::new(maps.get(&spec.path)?, spec.rotation_deg))
}

/// Returns the images of environments that rays see.
pub(super) fn visible_environments(scene: &Scene, maps: &Maps) -> Vec<VisibleEnvironment> {
    let seen = scene.lights.iter().filter_map(|light| match &light.kind {
        LightKind::Environment { map: Some(spec), .. } if spec.visible => {
            Some(VisibleEnvironment { map: turned(spec, maps)?, factor: light.diffuse })
        }
        _ => None,
    });
    seen.collect()
}

/// Returns the light relative to the geometry's origin, in f32. `known`: the same light in another
/// frame of the same geometry. If it has the same place, the shapes are not searched again.
pub(super) fn recentre(
    light: &scene::CheckedLight,
    geometry: &Geometry,
    maps: &Maps,
    known: Option<&Light>,
) -> Light {
    let origin = geometry.origin;
    let emitter = match &light.kind {
        LightKind::Point { position } => Emitter::Point((*position - origin).as_vec3()),
        LightKind::Area { corner, edge, height, samples, lambertian } => {
            let corner = (*corner - origin).as_vec3();
            let mut area = Area::new(corner, *edge, *height, *lambertian, *samples);
            match known.map(|light| &light.emitter) {
                Some(Emitter::Area(known)) if known.has_place_of(&area) => {
                    area.plane_gap = known.plane_gap;
                }
                _ => area.set_plane_gap(geometry),
            }
            Emitter::Area(area)
        }
        LightKind::Sun { towards, angle_deg, samples } => {
            let sun = Distant::Sun(Cone::new(*towards, *angle_deg, geometry));
            Emitter::Area(Area::from_distant(sun, *samples))
        }
        LightKind::Environment { samples, map } => {
            let map = map.as_ref().and_then(|spec| turned(spec, maps));
            let environment = Distant::Environment(Environment::new(geometry, map));
            Emitter::Area(Area::from_distant(environment, *samples))
        }
    };
    Light { diffuse: light.diffuse, specular: light.specular, emitter }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn a_distance_that_positions_exceed_is_told_with_its_place() {
        let middle = Origin {
            position: DVec3::ZERO,
            at_camera: false,
            extent: 1e6,
            nearest: 3.0,
            rounding: 0.0,
            pixels: 0.0,
            parallel: false,
        };
        assert_eq!(raised(1.0, &middle), None);
        let message = raised(0.5, &middle).unwrap();
        assert!(message.contains("farther than 2.6e5 from the middle of the scene"), "{message}");
        assert!(message.ends_with("up to 9.5e-1 is used"), "{message}");
        // The far side of the scene may be seen from its edge.
        let camera = Origin { at_camera: true, ..middle };
        let message = raised(1.0, &camera).unwrap();
        assert!(message.contains("farther than 5.2e5 from the camera"), "{message}");
        assert_eq!(raised(2.0, &Origin { nearest: f64::INFINITY, ..camera }), None);
    }
}
