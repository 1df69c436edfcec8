//! Lights: their colours, positions and shapes.

use glam::{DVec3, Vec3};

use super::environment::{Environment, TurnedMap};
use super::points::{Lanes, Lanes3, ShadowPoints, lane, set_lane};
use super::sun::Cone;
use crate::ray::LANES;
pub use crate::scene::Falloff;

/// A light, relative to the scene's origin, in f32.
#[derive(Debug, Clone)]
pub struct Light {
    /// Colour of the diffuse term (`id`).
    pub diffuse: Vec3,
    /// Colour of the specular term (`is`).
    pub specular: Vec3,
    /// Position and shape of the light.
    pub emitter: Emitter,
}

/// Position and shape of a light.
#[derive(Debug, Clone)]
pub enum Emitter {
    /// A point light and its position.
    Point(Vec3),
    /// A light with an extent: a rectangle, a sun or an environment.
    Area(Area),
}

impl Emitter {
    /// Four corners whose convex hull holds the light points of all shading points. `None` for
    /// light from beyond the scene.
    pub fn corners(&self) -> Option<[Vec3; 4]> {
        match self {
            Self::Point(position) => Some([*position; 4]),
            Self::Area(area) if area.distant.is_some() => None,
            Self::Area(area) => area.corners(&ShadowPoints::EMPTY),
        }
    }
}

/// A rectangle of light points: `corner + s edge + t height`, s, t in [0, 1). With `distant`,
/// directions instead.
#[derive(Debug, Clone)]
pub struct Area {
    /// Light from beyond the scene. The fields of the rectangle are then 0.
    pub distant: Option<Distant>,
    /// Corner at s = t = 0.
    pub corner: Vec3,
    /// Side along s, as a vector.
    pub edge: Vec3,
    /// Side along t, as a vector.
    pub height: Vec3,
    /// Unit normal of a one-sided cosine emitter. `None`: emits equally in all directions.
    pub normal: Option<Vec3>,
    /// Number of light points per shading point.
    pub samples: u32,
    /// Unit normal of the rectangle, in f64.
    pub plane: DVec3,
    /// Bound of the distance, along `plane`, between the light's rounded points and the surfaces
    /// that hold the light. 0 if no surface holds the light.
    pub plane_gap: f32,
}

impl Area {
    /// Four corners. The convex hull of these and the shading points holds all shadow rays. `None`
    /// for an environment, a wide sun, or a sun without shading points.
    #[inline(always)]
    pub fn corners(&self, points: &ShadowPoints) -> Option<[Vec3; 4]> {
        match &self.distant {
            Some(Distant::Sun(sun)) => return sun.corners(points),
            Some(Distant::Environment(_)) => return None,
            None => {}
        }
        let (edge, height) = (self.edge, self.height);
        Some([Vec3::ZERO, edge, height, edge + height].map(|side| self.corner + side))
    }

    /// Sets the number of light points per shading point. A sun of size 0 keeps one.
    pub fn set_samples(&mut self, samples: u32) {
        let is_point = matches!(&self.distant, Some(Distant::Sun(sun)) if sun.is_point());
        self.samples = if is_point { 1 } else { samples };
    }

    /// The map of an environment, if the light has one.
    #[inline(always)]
    pub fn map(&self) -> Option<&TurnedMap> {
        match &self.distant {
            Some(Distant::Environment(environment)) => environment.map(),
            _ => None,
        }
    }

    /// The scene's falloff, or none for light from beyond the scene.
    #[inline(always)]
    pub fn falloff(&self, of_scene: Falloff) -> Falloff {
        if self.distant.is_some() { Falloff::None } else { of_scene }
    }

    /// Light points for 16 points (s, t) in the unit square, seen from the shading points `from`.
    #[inline(always)]
    pub fn points(&self, square: &[Lanes; 2], from: &ShadowPoints) -> Lanes3 {
        match &self.distant {
            Some(Distant::Sun(sun)) => return sun.points(square, &from.position),
            Some(Distant::Environment(environment)) => return environment.points(square, from),
            None => {}
        }
        let [s, t] = square;
        let mut q = [[0.0; LANES]; 3];
        for i in 0..LANES {
            set_lane(&mut q, i, self.corner + self.edge * s[i] + self.height * t[i]);
        }
        q
    }
}

impl Area {
    /// Light points that may send the most light to `from`: the nearest one, and the one in the
    /// mirrored direction of view. Of a sun, both are the centre.
    pub fn brightest(&self, from: &ShadowPoints) -> [Lanes3; 2] {
        let mut found = [self.points(&[[0.5; LANES]; 2], from); 2];
        for i in 0..LANES {
            let (n, view) = (lane(&from.n, i), lane(&from.view, i));
            let position = lane(&from.position, i);
            let mirrored = n * (2.0 * n.dot(view)) - view;
            let q = match &self.distant {
                Some(Distant::Sun(_)) => continue,
                Some(Distant::Environment(environment)) => {
                    [n, mirrored].map(|direction| environment.point(position, direction))
                }
                None => {
                    let plane = self.plane.as_vec3();
                    let height = plane.dot(self.corner - position);
                    let along = height / plane.dot(mirrored);
                    let hit = if along > 0.0 { mirrored * along } else { plane * height };
                    [plane * height, hit].map(|to_plane| self.nearest(position + to_plane))
                }
            };
            set_lane(&mut found[0], i, q[0]);
            set_lane(&mut found[1], i, q[1]);
        }
        found
    }

    /// The point of the rectangle that is nearest to a point of its plane.
    fn nearest(&self, point: Vec3) -> Vec3 {
        let part = |side: Vec3| {
            let part = side.dot(point - self.corner) / side.dot(side);
            // NaN becomes 0.
            side * if part > 0.0 { part.min(1.0) } else { 0.0 }
        };
        self.corner + part(self.edge) + part(self.height)
    }
}

/// Light that arrives from beyond the scene.
#[derive(Debug, Clone)]
pub enum Distant {
    /// A disc in the sky.
    Sun(Cone),
    /// Light from all directions.
    Environment(Environment),
}

impl Distant {
    /// Whether the shadow rays leave the scene. Those of ambient occlusion have a given length.
    #[inline(always)]
    pub fn is_beyond(&self) -> bool {
        !matches!(self, Self::Environment(environment) if environment.is_near)
    }
}
