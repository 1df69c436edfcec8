//! Appearance of a surface: material, texture, colours of a mesh, shading normals.

use glam::{DVec2, Vec3};

use super::mesh_colors::MeshColors;
use super::points::{Points, lane, set_lane};
use super::texture::Texture;
use super::uv::UvSource;
use crate::geometry::{Geometry, GeometryKind, Surfaces, round_towards};
use crate::mesh::Normals;
use crate::ray::{LANES, Mask, RayPacket};
use crate::scene::{Filter, Wrap};

/// Blinn-Phong coefficients, and the source of the base colour.
#[derive(Debug, Clone)]
pub struct Material {
    /// Coefficient kd of the diffuse term.
    pub kd: f32,
    /// Coefficient ks of the specular term.
    pub ks: f32,
    /// Coefficient ka of the ambient term.
    pub ka: f32,
    /// Coefficient kr of the mirror term.
    pub kr: f32,
    /// Exponent of the specular term.
    pub exponent: f32,
    /// Base colour where there is no texture.
    pub base: Vec3,
    /// Texture of the base colour.
    pub texture: Option<TextureChoice>,
    /// Filter of the texture lookup.
    pub filter: Filter,
    /// Wrap mode beyond the image; `None` is the shape's default.
    pub wrap: Option<Wrap>,
    /// Factor of u and v.
    pub uv_scale: DVec2,
}

/// The texture of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextureChoice {
    /// One for the whole shape: an index into [`Shapes::textures`].
    One(u32),
    /// That of each triangle, by [`Shape::textures`].
    ByFace,
}

/// The textures of the triangles of a mesh.
#[derive(Debug, Clone)]
pub struct FaceTextures {
    /// For each triangle, an index into `textures`, or a larger number for none.
    pub numbers: Vec<u16>,
    /// Indices into [`Shapes::textures`]; `None` for an image that is missing.
    pub textures: Vec<Option<u32>>,
}

impl FaceTextures {
    fn of(&self, prim: u32) -> Option<u32> {
        self.textures.get(usize::from(self.numbers[prim as usize])).copied().flatten()
    }
}

/// Material and per-vertex data of a shape.
#[derive(Debug, Clone)]
pub struct Shape {
    /// Material of the shape, as an index into [`Shapes::materials`].
    pub material: u32,
    /// Source of its texture coordinates.
    pub uv: UvSource,
    /// Unit normals of a smooth mesh.
    pub normals: Option<Normals>,
    /// Colours that multiply the material's colour.
    pub colors: Option<MeshColors>,
    /// Textures of the triangles, if they have different ones.
    pub textures: Option<Box<FaceTextures>>,
}

/// Maps the primitives of a geometry to shapes.
#[derive(Debug, Clone)]
pub enum Owner {
    /// All primitives belong to this shape.
    One(u32),
    /// The shape of each primitive.
    Each(Vec<u32>),
}

impl Owner {
    #[inline(always)]
    fn shape(&self, prim: u32) -> u32 {
        match self {
            Self::One(shape) => *shape,
            Self::Each(shapes) => shapes[prim as usize],
        }
    }
}

/// All shapes, materials and textures of a scene.
#[derive(Debug, Default)]
pub struct Shapes {
    /// Shapes of the primitives, by geometry id.
    pub owners: Vec<Owner>,
    /// Shapes in file order.
    pub shapes: Vec<Shape>,
    /// Materials that the shapes use.
    pub materials: Vec<Material>,
    /// Textures that the materials use.
    pub textures: Vec<Texture>,
}

impl Shapes {
    /// Computes the shading points of 16 surface points: material, base colour and shading normal.
    #[inline(always)]
    pub fn look(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        out: &mut Points,
    ) {
        out.at.position = surfaces.position;
        out.at.origin = surfaces.outside;
        out.at.ng = surfaces.ng;
        out.at.n = surfaces.ng;
        out.at.primitive = surfaces.primitive;
        out.at.hit = surfaces.hit;
        for axis in 0..3 {
            out.at.view[axis] = packet.rays.dir[axis].map(|d| -d);
        }
        if let Some(material) = self.one_plain_material(packet, surfaces) {
            return splat(material, out);
        }
        for i in 0..LANES {
            if surfaces.hit.0[i] == 0 {
                continue;
            }
            let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
            let shape = &self.shapes[self.owners[geom as usize].shape(prim) as usize];
            let material = &self.materials[shape.material as usize];
            set(material, i, out);
            if material.texture.is_some() || shape.normals.is_some() || shape.colors.is_some() {
                self.details(geometry, packet, surfaces, shape, i, out);
            }
        }
    }

    /// Shape of a primitive, as an index in file order.
    #[inline(always)]
    pub fn shape(&self, geom: u32, prim: u32) -> u32 {
        self.owners[geom as usize].shape(prim)
    }

    /// The shape that all lanes of `hit` share: all lanes hit the same mesh or the same primitive.
    /// `None` if they differ or none hits.
    #[inline(always)]
    pub fn one_shape(&self, packet: &RayPacket, hit: &Mask) -> Option<u32> {
        if !hit.any() {
            return None;
        }
        let first = hit.first();
        let (geom, prim) = (packet.hits.geom[first], packet.hits.prim[first]);
        let owner = &self.owners[geom as usize];
        let any_prim = matches!(owner, Owner::One(_));
        // A loop, because a closure would be compiled for the portable tier and called.
        let mut others = 0;
        for i in 0..LANES {
            let own = (packet.hits.geom[i] == geom) & (any_prim | (packet.hits.prim[i] == prim));
            others |= hit.0[i] & -i32::from(!own);
        }
        (others == 0).then(|| owner.shape(prim))
    }

    /// Whether a shape has texture coordinates. A mesh has none if its file has none.
    #[inline(always)]
    pub fn has_uv(&self, shape: u32) -> bool {
        !matches!(self.shapes[shape as usize].uv, UvSource::None)
    }

    /// Texture coordinates at the hit of lane `i`, which must have hit. v points down; `tScale` is
    /// not applied. `None` for a shape without coordinates.
    #[inline(always)]
    pub fn uv(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        i: usize,
    ) -> Option<DVec2> {
        let shape = self.shape(packet.hits.geom[i], packet.hits.prim[i]);
        self.shapes[shape as usize].uv.at(geometry, packet, surfaces, i)
    }

    /// Memory of the vertex and face data in bytes: normals, texture coordinates, colours.
    pub fn vertex_bytes(&self) -> u64 {
        let shapes = self.shapes.iter().map(|shape| {
            let uv = shape.uv.bytes();
            let colors = shape.colors.as_ref().map_or(0, MeshColors::bytes);
            let normals = shape.normals.as_ref().map_or(0, Normals::bytes);
            let numbers = shape.textures.as_ref().map_or(0, |all| size_of_val(&all.numbers[..]));
            (uv + colors + numbers) as u64 + normals
        });
        shapes.sum()
    }

    /// Memory of all textures in bytes.
    pub fn texture_bytes(&self) -> u64 {
        self.textures.iter().map(Texture::bytes).sum()
    }

    /// The material of all lanes, if they hit the same shape and nothing varies over it.
    #[inline(always)]
    fn one_plain_material(&self, packet: &RayPacket, surfaces: &Surfaces) -> Option<&Material> {
        let shape = &self.shapes[self.one_shape(packet, &surfaces.hit)? as usize];
        let material = &self.materials[shape.material as usize];
        let plain = material.texture.is_none() && shape.normals.is_none() && shape.colors.is_none();
        plain.then_some(material)
    }

    /// Computes texture, colours and shading normal of one lane.
    #[inline(never)]
    fn details(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        shape: &Shape,
        i: usize,
        out: &mut Points,
    ) {
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        let (u, v) = (surfaces.u[i] as f32, surfaces.v[i] as f32);
        let weights = [1.0 - u - v, u, v];
        let corners = match geometry.kind(geom) {
            GeometryKind::Mesh(mesh) => Some(geometry.meshes[mesh].triangles()[prim as usize]),
            _ => None,
        };
        let material = &self.materials[shape.material as usize];
        let texture = match material.texture {
            None => None,
            Some(TextureChoice::One(texture)) => Some(texture),
            Some(TextureChoice::ByFace) => shape.textures.as_ref().and_then(|all| all.of(prim)),
        };
        if let Some(texture) = texture {
            if let Some(uv) = shape.uv.at(geometry, packet, surfaces, i) {
                let uv = uv * material.uv_scale;
                let wrap = material.wrap.map_or_else(|| shape.uv.wrap(), |wrap| [wrap, wrap]);
                let texture = &self.textures[texture as usize];
                let color = texture.lookup(uv.x, uv.y, material.filter, wrap[0], wrap[1]);
                set_lane(&mut out.base, i, color);
            }
        } else if let Some(colors) = &shape.colors {
            let color = match corners {
                Some(corners) => colors.at(prim, corners, weights),
                None => colors.of_sphere(prim),
            };
            set_lane(&mut out.base, i, material.base * color);
        }
        if let (Some(normals), Some(corners), GeometryKind::Mesh(mesh)) =
            (&shape.normals, corners, geometry.kind(geom))
        {
            let positions = geometry.meshes[mesh].corners(prim).map(Vec3::from);
            smooth(positions, normals.of(prim, corners).map(Vec3::from), weights, i, out);
        }
    }
}

#[inline(always)]
fn splat(m: &Material, out: &mut Points) {
    out.at.kd = [m.kd; LANES];
    out.at.ks = [m.ks; LANES];
    out.at.exponent = [m.exponent; LANES];
    out.at.lifted.0 = [0; LANES];
    out.ka = [m.ka; LANES];
    out.kr = [m.kr; LANES];
    out.base = m.base.to_array().map(|c| [c; LANES]);
}

#[inline(always)]
fn set(m: &Material, i: usize, out: &mut Points) {
    (out.at.kd[i], out.at.ks[i], out.at.exponent[i]) = (m.kd, m.ks, m.exponent);
    (out.ka[i], out.kr[i]) = (m.ka, m.kr);
    out.at.lifted.0[i] = 0;
    set_lane(&mut out.base, i, m.base);
}

fn weighted(weights: [f32; 3], values: [Vec3; 3]) -> Vec3 {
    values[0] * weights[0] + values[1] * weights[1] + values[2] * weights[2]
}

/// Sets the interpolated normal, and lifts the shadow origin off the facets.
///
/// Hanika 2021, "Hacking the Shadow Terminator", Ray Tracing Gems II ch. 4: P' = P - sum w_i min(0,
/// (P - V_i).N_i) N_i. Corner normals are negated if N is. A corner normal that then faces away
/// from Ng would push the origin below the facet, so it lifts nothing. If the normals cancel or are
/// missing, N = Ng and P' = P.
fn smooth(corners: [Vec3; 3], normals: [Vec3; 3], weights: [f32; 3], i: usize, out: &mut Points) {
    let ng = lane(&out.at.ng, i);
    let Some(n) = weighted(weights, normals).try_normalize() else {
        return;
    };
    let side = if n.dot(ng) < 0.0 { -1.0 } else { 1.0 };
    set_lane(&mut out.at.n, i, n * side);
    let point = |c: usize| {
        // P - V_c from the edges, so that large coordinates do not cancel.
        weighted(weights, corners.map(|corner| corner - corners[c]))
    };
    let lift = (0..3).fold(Vec3::ZERO, |lift, c| {
        let normal = normals[c] * side;
        let weight = if normal.dot(ng) > 0.0 { weights[c] } else { 0.0 };
        lift - normal * (weight * point(c).dot(normal).min(0.0))
    });
    if lift != Vec3::ZERO {
        let origin = lane(&out.at.origin, i).as_dvec3() + lift.as_dvec3();
        for axis in 0..3 {
            let rounded = origin[axis] as f32;
            let outside = round_towards(origin[axis], rounded, f64::from(ng[axis]));
            out.at.origin[axis][i] = outside;
        }
        out.at.lifted.0[i] = -1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_convex_corner_lifts_the_shadow_origin() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let out_and_up = |x: f32, y: f32| Vec3::new(x, y, 3.0).normalize();
        let normals = [out_and_up(-1.0, -1.0), out_and_up(1.0, 0.0), out_and_up(0.0, 1.0)];
        let mut points = Points::EMPTY;
        set_lane(&mut points.at.ng, 0, Vec3::Z);
        smooth(corners, normals, [1.0 / 3.0; 3], 0, &mut points);
        assert!(lane(&points.at.origin, 0).z > 0.0);
        assert_eq!(points.at.lifted.0[0], -1);
        assert!(lane(&points.at.n, 0).z > 0.99);
    }

    #[test]
    fn normals_facing_away_never_push_the_shadow_origin_below_the_facet() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let away =
            [Vec3::new(-1.0, -1.0, -0.5), Vec3::new(1.0, 0.0, 3.0), Vec3::new(0.0, 1.0, 3.0)];
        let away = away.map(Vec3::normalize);
        for (normals, turned) in [(away, 1.0), (away.map(|n| -n), -1.0)] {
            let mut points = Points::EMPTY;
            set_lane(&mut points.at.ng, 0, Vec3::Z);
            smooth(corners, normals, [1.0 / 3.0; 3], 0, &mut points);
            assert!(lane(&points.at.origin, 0).z >= 0.0);
            let mean = (normals[0] + normals[1] + normals[2]).normalize() * turned;
            assert!((lane(&points.at.n, 0) - mean).length() < 1e-6, "turned to the viewer's side");
        }
    }

    #[test]
    fn cancelling_or_missing_normals_leave_the_facet_flat() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        for normals in [[Vec3::ZERO; 3], [Vec3::Z, -Vec3::Z, Vec3::ZERO]] {
            let mut points = Points::EMPTY;
            set_lane(&mut points.at.ng, 0, Vec3::Z);
            set_lane(&mut points.at.n, 0, Vec3::Z);
            smooth(corners, normals, [0.5, 0.5, 0.0], 0, &mut points);
            assert_eq!(lane(&points.at.n, 0), Vec3::Z);
            assert_eq!(points.at.lifted.0[0], 0);
        }
    }
}
