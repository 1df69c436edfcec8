//! The checked scene: every value in range, every name resolved, every path absolute or relative
//! to the working folder. Nothing has been opened yet but the scene file.

use std::path::PathBuf;

use glam::{DVec2, DVec3, Vec3};

pub use crate::sampler::Kind as SamplerKind;

use super::{
    backend::Backend,
    layers::{Layer, LightGroups},
};

/// Points of an area light that adaptive shadows trace at least, before they leave any out.
pub const FIRST_SHADOW_POINTS: u32 = 4;

/// What a scene file means. World units, right-handed; colours linear BT.709, unbounded.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Mirror bounces after the primary ray.
    pub nbounces: u32,
    /// Shadow rays of area lights are traced where they are needed.
    pub adaptive_shadows: bool,
    /// Camera samples per pixel, >= 1.
    pub spp: u32,
    /// Seed of every random choice.
    pub seed: i64,
    /// How sample points are chosen.
    pub sampler: SamplerKind,
    /// The camera.
    pub camera: Camera,
    /// Radiance of rays that leave the scene.
    pub background: Vec3,
    /// Ambient light.
    pub ambient: Vec3,
    /// How light falls off with distance.
    pub falloff: Falloff,
    /// What finds the hits.
    pub backend: Backend,
    /// In file order.
    pub lights: Vec<Light>,
    /// In file order; `material` indexes `materials`.
    pub shapes: Vec<Shape>,
    /// Named and inline materials.
    pub materials: Vec<Material>,
    /// Of the PNG only.
    pub tonemap: Tonemap,
    /// EXR layers beside the beauty, each once, in the order of [`Layer`].
    pub layers: Vec<Layer>,
    /// Things that a pixel of a cryptomatte can hold, even: two in each of its layers.
    pub crypto_ranks: u32,
    /// How its lights are grouped in layers.
    pub light_groups: LightGroups,
    /// Alpha is coverage instead of 1.
    pub transparent: bool,
}

impl Scene {
    /// Whether adaptive shadows leave any ray out: an area light has more points than are always traced.
    pub fn spares_shadow_rays(&self) -> bool {
        let spares = |light: &Light| matches!(light.kind, LightKind::Area { samples, .. } if samples > FIRST_SHADOW_POINTS);
        self.adaptive_shadows && self.lights.iter().any(spares)
    }
}

/// Divisor of a light's contribution at distance d.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Falloff {
    /// 1
    None,
    /// d
    Linear,
    /// d^2
    Quadratic,
}

/// Camera as written; the formulas are in docs/guide/scene-format.md.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Pixels, both >= 1.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Full vertical angle in degrees, (0, 180).
    pub fov_deg: f64,
    /// World position.
    pub position: DVec3,
    /// View direction (not a point), any length > 0.
    pub lookat: DVec3,
    /// Up, any length, not parallel to `lookat`.
    pub up: DVec3,
    /// `None` is a pinhole.
    pub lens: Option<Lens>,
}

/// A thin lens.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    /// Diameter, world units, >= 0.
    pub aperture: f64,
    /// Distance of the plane in focus along the view direction, > 0.
    pub focal_distance: f64,
}

/// A light and what it is called in the EXR.
#[derive(Debug, Clone)]
pub struct Light {
    /// Its own name.
    pub name: Option<String>,
    /// The light group it belongs to.
    pub group: Option<String>,
    /// Diffuse colour (`id`).
    pub diffuse: Vec3,
    /// Specular colour (`is`).
    pub specular: Vec3,
    /// Where it shines from.
    pub kind: LightKind,
}

/// Where a light shines from.
#[derive(Debug, Clone)]
pub enum LightKind {
    /// One point.
    Point {
        /// World position.
        position: DVec3,
    },
    /// The rectangle `corner + s edge + t height`, s, t in [0, 1).
    Area {
        /// v0.
        corner: DVec3,
        /// v1 - v0.
        edge: DVec3,
        /// The part of v2 - v0 perpendicular to `edge`.
        height: DVec3,
        /// Points on this light per shading point, >= 1.
        samples: u32,
        /// One-sided cosine emission (`lambertian`) instead of `uniform`.
        lambertian: bool,
    },
}

/// A shape, its material and its name in the EXR.
#[derive(Debug, Clone)]
pub struct Shape {
    /// For object ids.
    pub name: Option<String>,
    /// Index into [`Scene::materials`].
    pub material: usize,
    /// The geometry.
    pub kind: ShapeKind,
}

/// Geometry of a shape.
#[derive(Debug, Clone)]
pub enum ShapeKind {
    /// A sphere.
    Sphere {
        /// World position.
        center: DVec3,
        /// > 0
        radius: f64,
        /// Axis of the texture's poles: 0 x, 1 y, 2 z.
        pole: u8,
    },
    /// A convex planar quad, corners in order.
    Plane {
        /// v0 v1 v2 v3.
        corners: [DVec3; 4],
    },
    /// One triangle.
    Triangle {
        /// v0 v1 v2.
        corners: [DVec3; 3],
    },
    /// A mesh file.
    Trimesh(Box<Trimesh>),
}

/// A mesh file and how it is placed: fit, rotate, then `center + size * p`.
#[derive(Debug, Clone)]
pub struct Trimesh {
    /// Where the scene file names it, for messages.
    pub place: String,
    /// The `.ply`, already joined to the scene's folder.
    pub path: PathBuf,
    /// Longest side after centring, if asked for.
    pub fit: Option<f64>,
    /// Degrees about x, then y, then z.
    pub rotate_deg: DVec3,
    /// > 0
    pub size: f64,
    /// World units.
    pub center: DVec3,
    /// Interpolated vertex normals.
    pub smooth: Smooth,
    /// The coursework's switch: false loops over the triangles (`coursework` backend only).
    pub bvh: bool,
    /// Multiply `diffusecolor` by the file's vertex colours.
    pub vertex_colors: bool,
    /// Overrides what the file's colour type implies.
    pub vertex_color_space: Option<ColorSpace>,
}

/// Where the normals of a mesh are interpolated. Those of its file are, but for `Off`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Smooth {
    /// Nowhere: facets.
    Off,
    /// Across every edge.
    All,
    /// Across edges whose faces stand at no more than `angle` degrees, between flat parts at no more than `flat`.
    Below {
        /// (0, 180].
        angle: f64,
        /// (0, 180].
        flat: f64,
    },
}

/// How stored colour values become linear light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ColorSpace {
    /// sRGB-encoded.
    Srgb,
    /// Linear.
    Linear,
}

/// Blinn-Phong coefficients.
#[derive(Debug, Clone)]
pub struct Material {
    /// Its key under `materials`; an inline one has none.
    pub name: Option<String>,
    /// Diffuse.
    pub kd: f32,
    /// Specular.
    pub ks: f32,
    /// Ambient.
    pub ka: f32,
    /// Mirror.
    pub kr: f32,
    /// >= 0; 0^0 = 1.
    pub specular_exponent: f32,
    /// Base colour without a texture.
    pub diffuse_color: Vec3,
    /// Base colour from an image.
    pub texture: Option<TextureUse>,
}

/// An image and how it is looked up.
#[derive(Debug, Clone)]
pub struct TextureUse {
    /// Where the scene file names it, for messages.
    pub place: String,
    /// The image, already joined to the scene's folder.
    pub path: PathBuf,
    /// `tWidth`, `tHeight` as written.
    pub declared_size: [Option<u32>; 2],
    /// Bilinear or nearest.
    pub filter: Filter,
    /// `None`: the shape's default (sphere: repeat, clamp; mesh: repeat; else clamp).
    pub wrap: Option<Wrap>,
    /// `None`: sRGB for integer images, linear for float images.
    pub color_space: Option<ColorSpace>,
    /// u, v are multiplied by it after any flip.
    pub scale: DVec2,
}

/// Texture filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Filter {
    /// Four texels, centres at half-integers.
    Bilinear,
    /// Texel (floor(u w), floor(v h)).
    Nearest,
}

/// What texel indices outside the image mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// Modulo the size.
    Repeat,
    /// The border texel.
    Clamp,
}

/// Radiance to 8-bit pixels.
#[derive(Debug, Clone, Copy)]
pub struct Tonemap {
    /// Which curve.
    pub operator: ToneOperator,
    /// Stops.
    pub exposure: f32,
    /// sRGB transfer instead of linear values.
    pub srgb: bool,
}

/// Tone curve.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ToneOperator {
    /// Divide by the largest channel value of the frame.
    Max,
    /// Clip at 1.
    Clamp,
    /// x / (1 + x) per channel.
    Reinhard,
}
