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
pub(super) fn occlusion(scene: &Scene, geometry: &Geometry, origin: &Origin) -> Option<Light> {
    if !scene.layers.contains(&Layer::Occlusion) {
        return None;
    }
    let OcclusionRays { distance, samples } = scene.occlusion;
    let hemisphere = match distance {
        Some(distance) => Environment::within(distance.max(shortest_occlusion(origin))),
        None => Environment::new(geometry, None),
    };
    let area = Area::from_distant(Distant::Environment(hemisphere), samples);
    Some(Light { diffuse: Vec3::ONE, specular: Vec3::ZERO, emitter: Emitter::Area(area) })
}

/// Returns the shortest distance for ambient occlusion, in world units. Rounding would turn the
/// rays of a shorter one below the surface. Coordinates are as large as the scene's box, or as the
/// distance from the camera if that is their origin.
fn shortest_occlusion(origin: &Origin) -> f64 {
    let nearest = if origin.nearest.is_finite() { origin.nearest } else { 0.0 };
    let largest = if origin.at_camera { nearest } else { origin.extent };
    largest / (1u64 << 20) as f64
}

/// Returns a warning if `aodistance` is shorter than positions can express.
pub(super) fn occlusion_warning(scene: &Scene, origin: &Origin) -> Option<Problem> {
    let distance = scene.occlusion.distance.filter(|_| scene.layers.contains(&Layer::Occlusion))?;
    let shortest = shortest_occlusion(origin);
    let message = format!(
        "found {distance:e}, which the rounding of positions exceeds: {shortest:.1e} is used"
    );
    (distance < shortest).then(|| Problem::new("/output/aodistance", message))
}

/// Returns a warning for each one-sided area light that has all boxes of shapes behind it.
pub(super) fn facing_warnings<'s>(
    scene: &'s Scene,
    boxes: &'s [Bounds],
) -> impl Iterator<Item = Problem> + 's {
    let corners = || boxes.iter().flat_map(|bounds| bounds.corners()).filter(|c| c.is_finite());
    scene.lights.iter().enumerate().filter_map(move |(number, light)| {
        let LightKind::Area { corner, edge, height, lambertian: true, .. } = light.kind else {
            return None;
        };
        let normal = edge.cross(height).normalize();
        // A shape in the light's plane receives nothing either, however its corners are rounded.
        let behind = |point: DVec3| normal.dot(point - corner) <= ROUNDED * point.distance(corner);
        if corners().next().is_none() || !corners().all(behind) {
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

/// Returns the light relative to the geometry's origin, in f32.
pub(super) fn recentre(light: &scene::CheckedLight, geometry: &Geometry, maps: &Maps) -> Light {
    let origin = geometry.origin;
    let emitter = match &light.kind {
        LightKind::Point { position } => Emitter::Point((*position - origin).as_vec3()),
        LightKind::Area { corner, edge, height, samples, lambertian } => {
            let corner = (*corner - origin).as_vec3();
            let mut area = Area::new(corner, *edge, *height, *lambertian, *samples);
            area.set_plane_gap(geometry);
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
    fn short_occlusion_rays_are_limited_by_the_rounding_of_positions() {
        let position = DVec3::ZERO;
        let middle = Origin {
            position,
            at_camera: false,
            extent: 1e6,
            nearest: 3.0,
            rounding: 0.0,
            pixels: 0.0,
            parallel: false,
        };
        assert!((0.9..1.0).contains(&shortest_occlusion(&middle)));
        let camera = Origin { at_camera: true, ..middle };
        assert!((2.8e-6..3e-6).contains(&shortest_occlusion(&camera)));
        assert_eq!(shortest_occlusion(&Origin { nearest: f64::INFINITY, ..camera }), 0.0);
    }
}
