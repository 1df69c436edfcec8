//! The checked scene: every value is in range, every name is resolved, every path is absolute or
//! relative to the working folder. No mesh and no image has been loaded yet.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DAffine3, DVec2, DVec3, Vec3};

pub use super::description::{ColorMap, ColorSpace, Falloff, Filter, ToneOperator, Visible, Wrap};
pub use crate::sampler::SamplerKind;

use crate::calibration::{Calibration, Distortion, Inverse};

use super::backend::Backend;
use super::description::MeshColorDescription;
use super::layers::{Layer, LightGroups};

/// Minimum number of points of an area light that adaptive shadows always trace.
pub const FIRST_SHADOW_POINTS: u32 = 4;

/// A checked scene. World units, right-handed. Colours are linear BT.709, unbounded.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Number of mirror bounces after the primary ray.
    pub nbounces: u32,
    /// Trace shadow rays of area lights only where they are needed.
    pub adaptive_shadows: bool,
    /// Number of lights that each shading point draws, >= 1. `None`: it receives light from all.
    pub emitter_samples: Option<u32>,
    /// Number of camera samples per pixel, >= 1.
    pub spp: u32,
    /// Seed of all random numbers.
    pub seed: i64,
    /// Sampler that chooses the sample points.
    pub sampler: SamplerKind,
    /// The camera that takes the picture.
    pub camera: CheckedCamera,
    /// Radiance of rays that miss.
    pub background: Vec3,
    /// Ambient light of the scene.
    pub ambient: Vec3,
    /// How light decreases with distance.
    pub falloff: Falloff,
    /// Backend that finds the hits.
    pub backend: Backend,
    /// Lights in file order.
    pub lights: Vec<CheckedLight>,
    /// Shapes in file order; `material` is an index into `materials`.
    pub shapes: Vec<CheckedShape>,
    /// Named and inline materials.
    pub materials: Vec<CheckedMaterial>,
    /// Tone mapping of the PNG.
    pub tonemap: Tonemap,
    /// EXR layers in addition to the beauty, without repeats, in the order of [`Layer`].
    pub layers: Vec<Layer>,
    /// Number of entries in a pixel of a cryptomatte. It is even: each layer holds two.
    pub crypto_ranks: u32,
    /// Rays of the layer of ambient occlusion.
    pub occlusion: OcclusionRays,
    /// Groups of lights in layers.
    pub light_groups: LightGroups,
    /// True if alpha is coverage instead of 1.
    pub transparent: bool,
    /// True to draw the legend of a colour map into the PNG.
    pub legend: bool,
}

/// The rays of the layer of ambient occlusion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OcclusionRays {
    /// Their length in world units, > 0. `None`: they leave the scene.
    pub distance: Option<f64>,
    /// Their number for each camera sample, >= 1.
    pub samples: u32,
}

impl Scene {
    /// Returns true if a mesh shows a property by its `color`, which a legend can explain.
    pub fn shows_property(&self) -> bool {
        self.shapes.iter().any(|shape| match &shape.kind {
            ShapeKind::Trimesh(mesh) => {
                let color = mesh.color.as_ref().map(|request| &request.color);
                matches!(color, Some(MeshColorDescription::Property(_)))
            }
            _ => false,
        })
    }

    /// Returns true if adaptive shadows can skip any shadow ray. This needs an area light, sun or
    /// environment without image that has more points than are always traced. An area light that
    /// is drawn has one, except under a shadow catcher.
    pub fn can_skip_shadow_rays(&self) -> bool {
        self.can_skip_shadow_rays_with(None)
    }

    /// [`Scene::can_skip_shadow_rays`] if every such light has `points` points.
    pub fn can_skip_shadow_rays_with(&self, points: Option<u32>) -> bool {
        let many = |kind: &LightKind| {
            kind.has_extent() && points.unwrap_or(kind.samples()) > FIRST_SHADOW_POINTS
        };
        let spares = |kind: &LightKind| {
            let is_image = matches!(kind, LightKind::Environment { map: Some(_), .. });
            many(kind) && !is_image && !self.has_one_point(kind)
        };
        self.adaptive_shadows && self.lights.iter().any(|light| spares(&light.kind))
    }

    /// Returns true for a light that shading points draw, and of it one point, everywhere.
    pub fn has_one_point(&self, kind: &LightKind) -> bool {
        matches!(kind, LightKind::Area { .. }) && self.draws_lights() && !self.has_catchers()
    }

    /// Number of point and area lights: those that `emitter_samples` draws from.
    pub fn placed_lights(&self) -> usize {
        let placed = |light: &&CheckedLight| {
            matches!(light.kind, LightKind::Point { .. } | LightKind::Area { .. })
        };
        self.lights.iter().filter(placed).count()
    }

    /// Returns true if shading points draw some of the lights: there are more than
    /// `emitter_samples`.
    pub fn draws_lights(&self) -> bool {
        self.emitter_samples.is_some_and(|samples| self.placed_lights() > samples as usize)
    }

    /// Returns true if the `samples` of any light have an effect. Lights that shading points draw
    /// have one point each, except under a shadow catcher.
    pub fn uses_light_samples(&self) -> bool {
        let ignored = |kind: &LightKind| self.has_one_point(kind);
        self.lights.iter().any(|light| light.kind.has_extent() && !ignored(&light.kind))
    }

    /// Returns the images of the environments.
    pub fn maps(&self) -> impl Iterator<Item = &MapUse> {
        self.lights.iter().filter_map(|light| match &light.kind {
            LightKind::Environment { map, .. } => map.as_ref(),
            _ => None,
        })
    }

    /// Returns true if alpha may differ from 1.
    pub fn has_alpha(&self) -> bool {
        self.transparent || self.shapes.iter().any(|shape| shape.role != Role::Surface)
    }

    /// Returns true if any shape is a shadow catcher.
    pub fn has_catchers(&self) -> bool {
        self.shapes.iter().any(|shape| shape.role == Role::ShadowCatcher)
    }

    /// Returns, for each shape, how many accelerators hold it: one for each distinct set of shapes
    /// that a kind of ray can hit.
    pub fn accelerators(&self) -> Vec<u32> {
        let seen: Vec<[bool; 3]> = self.shapes.iter().map(|shape| shape.visible.kinds()).collect();
        let same = |a: usize, b: usize| seen.iter().all(|kinds| kinds[a] == kinds[b]);
        let distinct: Vec<usize> = (0..3).filter(|&k| (0..k).all(|j| !same(j, k))).collect();
        seen.iter().map(|kinds| distinct.iter().filter(|&&k| kinds[k]).count() as u32).collect()
    }
}

/// The checked camera. The formulas are in docs/guide/cameras.md.
#[derive(Debug, Clone)]
pub struct CheckedCamera {
    /// Width of the picture in pixels, >= 1.
    pub width: u32,
    /// Height of the picture in pixels, >= 1.
    pub height: u32,
    /// Position in world space.
    pub position: DVec3,
    /// View direction (not a point), of any length > 0.
    pub lookat: DVec3,
    /// Up direction, of any length > 0, not parallel to `lookat`.
    pub up: DVec3,
    /// How directions become pixels.
    pub projection: Projection,
}

impl CheckedCamera {
    /// Returns the vertical angle of view in degrees and the lens of a `pinhole` or `thinlens`.
    /// `None` for other cameras.
    pub fn perspective(&self) -> Option<(f64, Option<CheckedLens>)> {
        match self.projection {
            Projection::Perspective { fov_deg, lens } => Some((fov_deg, lens)),
            _ => None,
        }
    }
}

/// How the directions of a camera become pixels.
#[derive(Debug, Clone)]
pub enum Projection {
    /// A perspective view about the middle of the picture.
    Perspective {
        /// Full vertical angle of view in degrees, in (0, 180).
        fov_deg: f64,
        /// The lens; `None` for a pinhole.
        lens: Option<CheckedLens>,
    },
    /// A calibrated camera without distortion.
    Calibrated(Calibration),
    /// A calibrated camera with distortion, and the inverse of the distortion over the frame.
    Distorted(Calibration, Distortion, Arc<Inverse>),
    /// Parallel rays.
    Orthographic {
        /// Width of the view in world units, > 0.
        width: f64,
    },
    /// Directions by angles.
    Panorama {
        /// Angles of the left and the right border in degrees.
        longitude_deg: [f64; 2],
        /// Angles of the lower and the upper border in degrees.
        latitude_deg: [f64; 2],
    },
}

/// A thin lens for depth of field.
#[derive(Debug, Clone, Copy)]
pub struct CheckedLens {
    /// Diameter in world units, > 0.
    pub aperture: f64,
    /// Distance of the plane in focus along the view direction, in world units, > 0.
    pub focal_distance: f64,
}

/// A light with its names in the EXR.
#[derive(Debug, Clone)]
pub struct CheckedLight {
    /// Name of the light.
    pub name: Option<String>,
    /// Light group of the light.
    pub group: Option<String>,
    /// Colour of its diffuse light (`id`).
    pub diffuse: Vec3,
    /// Colour of its specular light (`is`).
    pub specular: Vec3,
    /// Geometry of the light.
    pub kind: LightKind,
}

/// Geometry of a light.
#[derive(Debug, Clone)]
pub enum LightKind {
    /// A point without extent.
    Point {
        /// Position in world space.
        position: DVec3,
    },
    /// The rectangle `corner + s edge + t height`, s, t in [0, 1).
    Area {
        /// The corner `v0`, in world space.
        corner: DVec3,
        /// The base edge `v1 - v0`.
        edge: DVec3,
        /// The component of `v2 - v0` perpendicular to `edge`.
        height: DVec3,
        /// Number of points on this light per shading point, >= 1.
        samples: u32,
        /// True for one-sided cosine emission (`lambertian`), false for `uniform`.
        lambertian: bool,
    },
    /// A cone of directions, from beyond the scene. Its light has no falloff.
    Sun {
        /// Unit direction towards the middle of the sun.
        towards: DVec3,
        /// Angular diameter in degrees, in [0, 179]; 0 for a directional light.
        angle_deg: f64,
        /// Number of directions per shading point, >= 1.
        samples: u32,
    },
    /// Light from all directions.
    Environment {
        /// Number of directions per shading point, >= 1.
        samples: u32,
        /// The image of its radiance. `None`: the radiance is the same in all directions.
        map: Option<MapUse>,
    },
}

impl LightKind {
    /// Returns true if shadow rays to the light differ in direction, so that its number of samples
    /// has an effect. False for points and for suns of size 0.
    pub fn has_extent(&self) -> bool {
        match self {
            Self::Point { .. } => false,
            Self::Sun { angle_deg, .. } => *angle_deg > 0.0,
            Self::Area { .. } | Self::Environment { .. } => true,
        }
    }

    /// Number of points or directions per shading point; 1 for a point light.
    pub fn samples(&self) -> u32 {
        match *self {
            Self::Point { .. } => 1,
            Self::Area { samples, .. }
            | Self::Sun { samples, .. }
            | Self::Environment { samples, .. } => samples,
        }
    }
}

/// The image of an environment.
#[derive(Debug, Clone)]
pub struct MapUse {
    /// Place in the scene file where `path` is written, for messages.
    pub place: String,
    /// Path of the image, joined to the scene's folder.
    pub path: PathBuf,
    /// Azimuth of its middle, in degrees from -z towards +x.
    pub rotation_deg: f64,
    /// True if camera rays and mirrors see it.
    pub visible: bool,
}

/// A shape with its material and its name in the EXR.
#[derive(Debug, Clone)]
pub struct CheckedShape {
    /// Name of the shape for object ids.
    pub name: Option<String>,
    /// Index of the material in [`Scene::materials`].
    pub material: usize,
    /// Geometry of the shape.
    pub kind: ShapeKind,
    /// Kinds of rays that can hit it.
    pub visible: Visible,
    /// What camera rays return that hit it.
    pub role: Role,
    /// Class in the picture of semantic ids; 0 for none.
    pub semantic: u16,
}

/// What camera rays return that hit a shape.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Role {
    /// The light of its surface, with alpha 1.
    #[default]
    Surface,
    /// Nothing, with alpha 0.
    Holdout,
    /// Black, with the share of light that shadows take as alpha.
    ShadowCatcher,
}

/// Geometry of a shape.
#[derive(Debug, Clone)]
pub enum ShapeKind {
    /// A sphere with centre and radius.
    Sphere {
        /// Centre in world space.
        center: DVec3,
        /// Radius in world units, > 0.
        radius: f64,
        /// Axis of the texture's poles: 0 x, 1 y, 2 z.
        pole: u8,
    },
    /// A convex planar quad, corners in order.
    Plane {
        /// The corners v0 v1 v2 v3.
        corners: [DVec3; 4],
    },
    /// A triangle with three corners.
    Triangle {
        /// The corners v0 v1 v2.
        corners: [DVec3; 3],
    },
    /// A mesh from a file.
    Trimesh(Box<Trimesh>),
    /// A further copy of the mesh of another shape. These shapes are the last of a scene.
    Instance {
        /// Index of the shape with the mesh, whose `transform` is that of the first copy.
        of: usize,
        /// From the placed mesh to world space.
        transform: Box<DAffine3>,
    },
}

/// A mesh file and its placement: fit, rotate, then `center + size * p`.
#[derive(Debug, Clone)]
pub struct Trimesh {
    /// Place in the scene file where `path` is written, for messages.
    pub place: String,
    /// Path of the PLY file, joined to the scene's folder.
    pub path: PathBuf,
    /// Length of the longest side before `size`, if `fit` is set. The bounding box is centred, too.
    pub fit: Option<f64>,
    /// Rotation in degrees about the x, then y, then z axis.
    pub rotate_deg: DVec3,
    /// Scale factor, > 0.
    pub size: f64,
    /// Offset in world units.
    pub center: DVec3,
    /// Edges across which normals are interpolated.
    pub smooth: Smooth,
    /// Switch of the coursework: false loops over the triangles (`coursework` backend only).
    pub bvh: bool,
    /// True to multiply `diffusecolor` by the colours of the file.
    pub vertex_colors: bool,
    /// Encoding of the colours; `None`: implied by their type in the file.
    pub vertex_color_space: Option<ColorSpace>,
    /// Source of the colours. `None`: the vertices of the file, else its faces, if `vertex_colors`.
    pub color: Option<MeshColor>,
    /// Radius of the spheres that replace the faces, in the units of the file.
    pub points: Option<f64>,
    /// The transform of the first instance, applied after all others. `None`: the mesh is not
    /// instanced.
    pub transform: Option<Box<DAffine3>>,
}

/// Source of the colours of a mesh.
#[derive(Debug, Clone)]
pub struct MeshColor {
    /// Place of the request in the scene file, for messages.
    pub place: String,
    /// The request. The ends of a range differ.
    pub color: MeshColorDescription,
}

/// Edges across which the normals of a mesh are interpolated. Normals of the file are used in every
/// mode but `Off`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Smooth {
    /// No edge: the mesh is faceted.
    Off,
    /// Every edge of the mesh.
    All,
    /// Edges whose faces differ by at most `angle` degrees, or between flat parts by at most
    /// `flat`.
    Below {
        /// Angle in degrees, in (0, 180].
        angle: f64,
        /// Angle between flat parts in degrees, in (0, 180].
        flat: f64,
    },
}

/// A Blinn-Phong material with an optional mirror.
#[derive(Debug, Clone)]
pub struct CheckedMaterial {
    /// Key under `materials`; `None` for an inline material.
    pub name: Option<String>,
    /// Coefficient of diffuse reflection.
    pub kd: f32,
    /// Coefficient of specular reflection.
    pub ks: f32,
    /// Coefficient of ambient light.
    pub ka: f32,
    /// Coefficient of mirror reflection.
    pub kr: f32,
    /// Exponent of the specular highlight, >= 0; 0^0 = 1.
    pub specular_exponent: f32,
    /// Base colour without a texture.
    pub diffuse_color: Vec3,
    /// Texture that replaces the base colour.
    pub texture: Option<TextureUse>,
    /// How `texture` is looked up, or without one, the images that mesh files name.
    pub lookup: TextureLookup,
}

/// The image that a material names.
#[derive(Debug, Clone)]
pub struct TextureUse {
    /// Place in the scene file where `path` is written, for messages.
    pub place: String,
    /// Path of the image, joined to the scene's folder.
    pub path: PathBuf,
    /// The keys `tWidth` and `tHeight` as written.
    pub declared_size: [Option<u32>; 2],
}

/// The parameters of a material's texture lookups.
#[derive(Debug, Clone)]
pub struct TextureLookup {
    /// Places in the scene file of the keys that it has, for messages.
    pub places: Vec<(&'static str, String)>,
    /// How texels are filtered. `None`: trilinear in images that a mesh file names, else bilinear.
    pub filter: Option<Filter>,
    /// Lookup outside the image. `None`: the default of the shape (sphere: repeat in u, clamp in v;
    /// mesh: repeat; others: clamp).
    pub wrap: Option<Wrap>,
    /// Encoding of the image. `None`: sRGB for integer images, linear for float images.
    pub color_space: Option<ColorSpace>,
    /// Factors of u and v, applied after v is flipped where the shape flips it.
    pub scale: DVec2,
}

/// Conversion of radiance to 8-bit pixels.
#[derive(Debug, Clone, Copy)]
pub struct Tonemap {
    /// Tone curve that is applied.
    pub operator: ToneOperator,
    /// Exposure: values are multiplied by 2^exposure.
    pub exposure: f32,
    /// True for the sRGB transfer curve, false for linear values.
    pub srgb: bool,
}
