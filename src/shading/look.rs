//! Appearance of a surface: material, texture, colours of a mesh, shading normals.

use glam::{DVec2, Vec3};

use super::footprints::{Footprints, UvChanges};
use super::mesh_colors::MeshColors;
use super::points::{Lanes3, Points, set_lane};
use super::smooth::SmoothTriangles;
use super::texture::Texture;
use super::uv::UvSource;
use crate::error::Result;
use crate::geometry::{Geometry, Surfaces};
use crate::mesh::Normals;
use crate::ray::{LANES, Mask, RayPacket};
use crate::reserve::MemoryLimit;
use crate::scene::{Filter, Role, Wrap};

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
    /// One texture for the whole shape: an index into [`Shapes::textures`].
    One(u32),
    /// A texture for each triangle: [`Shape::textures`].
    ByFace,
}

/// The textures of the triangles of a mesh.
#[derive(Debug, Clone)]
pub struct TexturesByFace {
    /// For each triangle, an index into `textures`, or a larger number for none.
    pub indices: Vec<u16>,
    /// Indices into [`Shapes::textures`]; `None` for an image that is missing.
    pub textures: Vec<Option<u32>>,
}

impl TexturesByFace {
    fn of(&self, prim: u32) -> Option<u32> {
        self.textures.get(usize::from(self.indices[prim as usize])).copied().flatten()
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
    /// Colours that multiply the material's colour where there is no texture.
    pub colors: Option<MeshColors>,
    /// Textures of the triangles, if they have different ones.
    pub textures: Option<Box<TexturesByFace>>,
    /// What camera rays that hit the shape return.
    pub role: Role,
    /// Index of the shape's first primitive in its geometry.
    pub first: u32,
}

impl Shape {
    /// Memory of the vertex and face data in bytes: normals, texture coordinates, colours.
    pub fn vertex_bytes(&self) -> u64 {
        let uv = self.uv.bytes();
        let colors = self.colors.as_ref().map_or(0, MeshColors::bytes);
        let normals = self.normals.as_ref().map_or(0, Normals::bytes);
        let numbers = self.textures.as_ref().map_or(0, |all| size_of_val(&all.indices[..]));
        (uv + colors + numbers) as u64 + normals
    }
}

/// Maps the primitives of a geometry to shapes.
#[derive(Debug, Clone)]
pub enum Owner {
    /// All primitives belong to this shape.
    One(u32),
    /// The shape of each primitive.
    Each(Vec<u32>),
    /// All primitives belong to the shape `shape`, which looks like the shape `like`: an instance.
    Instance {
        /// Index of the instance's own shape.
        shape: u32,
        /// Index of the shape that holds the data of vertices and faces.
        like: u32,
    },
}

impl Owner {
    #[inline(always)]
    fn shape(&self, prim: u32) -> u32 {
        match self {
            Self::One(shape) | Self::Instance { shape, .. } => *shape,
            Self::Each(shapes) => shapes[prim as usize],
        }
    }

    /// The shape whose data of vertices and faces the primitive has.
    #[inline(always)]
    fn like(&self, prim: u32) -> u32 {
        match self {
            Self::One(shape) | Self::Instance { like: shape, .. } => *shape,
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
    /// Whether any shape is a holdout or a shadow catcher.
    pub has_roles: bool,
    /// Whether any shape has a texture that is averaged over areas.
    pub has_areas: bool,
}

impl Shapes {
    /// Computes the shading points of 16 surface points: material, base colour and shading normal.
    /// `areas` are the sides of the areas that the samples stand for, if textures are averaged over
    /// them.
    #[inline(always)]
    pub fn look(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        areas: Option<&[Lanes3; 2]>,
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
        if let Some((material, normals)) = self.one_untextured_shape(packet, surfaces) {
            splat(material, out);
            if let Some(normals) = normals {
                let mut smooth = SmoothTriangles::NONE;
                for i in (0..LANES).filter(|&i| surfaces.hit.0[i] != 0) {
                    gather(geometry, packet, surfaces, normals, i, &mut smooth);
                }
                smooth.interpolate(out);
            }
            return;
        }
        // No closures here: they would be compiled for the portable tier and called.
        let areas = match areas {
            Some(sides) => self.areas(geometry, packet, surfaces, sides),
            None => None,
        };
        let mut smooth = None;
        for i in 0..LANES {
            if surfaces.hit.0[i] == 0 {
                continue;
            }
            let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
            let (shape, material) = self.shape_like(geom, prim);
            set(material, i, out);
            if material.texture.is_some() || shape.colors.is_some() {
                let hit = ShadedHit { geometry, packet, surfaces, i };
                self.details(&hit, shape, areas.as_ref(), out);
            }
            if let Some(normals) = &shape.normals {
                let smooth = smooth.get_or_insert(SmoothTriangles::NONE);
                gather(geometry, packet, surfaces, normals, i, smooth);
            }
        }
        if let Some(smooth) = smooth {
            smooth.interpolate(out);
        }
    }

    /// Makes the smaller copies of the textures that are averaged over areas. `limit` is that of
    /// all textures.
    ///
    /// # Errors
    /// `Limit` or `Retry` if there is not enough memory.
    pub fn make_mip_maps(&mut self, limit: Option<MemoryLimit>) -> Result<()> {
        let mut wanted = vec![false; self.textures.len()];
        for shape in &self.shapes {
            let material = &self.materials[shape.material as usize];
            if material.filter == Filter::Trilinear {
                let by_face = shape.textures.iter().flat_map(|all| &all.textures).flatten();
                let one = match &material.texture {
                    Some(TextureChoice::One(texture)) => Some(texture),
                    _ => None,
                };
                by_face.chain(one).for_each(|&texture| wanted[texture as usize] = true);
            }
        }
        self.has_areas = wanted.contains(&true);
        let mut left = limit.map(|limit| limit.less(self.texture_bytes()));
        for (texture, _) in self.textures.iter_mut().zip(wanted).filter(|(_, wanted)| *wanted) {
            let held = texture.bytes();
            let what = "smaller copies of a texture";
            left.map_or(Ok(()), |left| left.check(texture.max_mip_map_bytes(), what))?;
            texture.make_mip_map(what)?;
            left = left.map(|left| left.less(texture.bytes() - held));
        }
        Ok(())
    }

    /// Returns an error if texels of a texture could not be read while they were looked up.
    ///
    /// # Errors
    /// `Retry`: the disk failed.
    pub fn check_textures(&self) -> Result<()> {
        self.textures.iter().try_for_each(Texture::check)
    }

    /// Shape of a primitive, as an index in file order.
    #[inline(always)]
    pub fn shape(&self, geom: u32, prim: u32) -> u32 {
        self.owners[geom as usize].shape(prim)
    }

    /// Index of a primitive in its shape.
    pub fn index_in_shape(&self, geom: u32, prim: u32) -> u32 {
        prim - self.shapes[self.shape(geom, prim) as usize].first
    }

    /// Role of the shape of a primitive.
    pub fn role(&self, geom: u32, prim: u32) -> Role {
        self.shapes[self.shape(geom, prim) as usize].role
    }

    /// The shape that all lanes of `hit` share: all lanes hit the same mesh or the same primitive.
    /// `None` if they differ or none hits.
    #[inline(always)]
    pub fn one_shape(&self, packet: &RayPacket, hit: &Mask) -> Option<u32> {
        self.one_owner(packet, hit).map(|(owner, prim)| owner.shape(prim))
    }

    /// The owner that all lanes of `hit` share, and the primitive of the first lane.
    #[inline(always)]
    fn one_owner(&self, packet: &RayPacket, hit: &Mask) -> Option<(&Owner, u32)> {
        if !hit.any() {
            return None;
        }
        let first = hit.first();
        let (geom, prim) = (packet.hits.geom[first], packet.hits.prim[first]);
        let owner = &self.owners[geom as usize];
        let any_prim = !matches!(owner, Owner::Each(_));
        // A loop, because a closure would be compiled for the portable tier and called.
        let mut others = 0;
        for i in 0..LANES {
            let own = (packet.hits.geom[i] == geom) & (any_prim | (packet.hits.prim[i] == prim));
            others |= hit.0[i] & -i32::from(!own);
        }
        (others == 0).then_some((owner, prim))
    }

    /// Whether all lanes of `hit` hit one shape, and it has no texture coordinates. A mesh has none
    /// if its file has none.
    #[inline(always)]
    pub fn lacks_uv(&self, packet: &RayPacket, hit: &Mask) -> bool {
        self.one_owner(packet, hit).is_some_and(|(owner, prim)| {
            matches!(self.shapes[owner.like(prim) as usize].uv, UvSource::None)
        })
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
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        let shape = self.owners[geom as usize].like(prim);
        self.shapes[shape as usize].uv.at(geometry, packet, surfaces, i)
    }

    /// Memory of the vertex and face data in bytes: normals, texture coordinates, colours.
    pub fn vertex_bytes(&self) -> u64 {
        self.shapes.iter().map(Shape::vertex_bytes).sum()
    }

    /// Memory of all textures in bytes.
    pub fn texture_bytes(&self) -> u64 {
        self.textures.iter().map(Texture::bytes).sum()
    }

    /// The material and the normals of all lanes, if they hit the same shape and its colour does
    /// not vary.
    #[inline(always)]
    fn one_untextured_shape(
        &self,
        packet: &RayPacket,
        surfaces: &Surfaces,
    ) -> Option<(&Material, Option<&Normals>)> {
        let (owner, prim) = self.one_owner(packet, &surfaces.hit)?;
        let shape = &self.shapes[owner.like(prim) as usize];
        let material = &self.materials[shape.material as usize];
        let plain = material.texture.is_none() && shape.colors.is_none();
        plain.then_some((material, shape.normals.as_ref()))
    }

    /// The shape whose data of vertices and faces a primitive has, and its material.
    #[inline(always)]
    fn shape_like(&self, geom: u32, prim: u32) -> (&Shape, &Material) {
        let shape = &self.shapes[self.owners[geom as usize].like(prim) as usize];
        (shape, &self.materials[shape.material as usize])
    }

    /// Returns the areas of textures with these sides on the surfaces. `None` if no lane needs one.
    #[inline(always)]
    fn areas(
        &self,
        geometry: &Geometry,
        packet: &RayPacket,
        surfaces: &Surfaces,
        sides: &[Lanes3; 2],
    ) -> Option<Footprints> {
        let mut changes = None;
        for i in 0..LANES {
            if surfaces.hit.0[i] == 0 {
                continue;
            }
            let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
            let (shape, material) = self.shape_like(geom, prim);
            if material.filter != Filter::Trilinear || material.texture.is_none() {
                continue;
            }
            let changes = changes.get_or_insert(UvChanges::NONE);
            match (shape.uv.of_triangle(geometry, geom, prim), mesh_corners(geometry, geom, prim)) {
                (Some(uv), Some(corners)) => changes.set_triangle(i, corners, uv),
                _ => {
                    let gradients = shape.uv.gradients(geometry, packet, surfaces, i);
                    changes.set_gradients(i, gradients);
                }
            }
        }
        let changes = changes.as_mut()?;
        Some(changes.footprints(sides))
    }

    /// Computes texture and colours of one lane. `areas` are those of the textures, if they are
    /// averaged.
    #[inline(never)]
    fn details(
        &self,
        hit: &ShadedHit,
        shape: &Shape,
        areas: Option<&Footprints>,
        out: &mut Points,
    ) {
        let &ShadedHit { geometry, packet, surfaces, i } = hit;
        let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
        let weights = weights(surfaces, i);
        let corners = geometry.mesh(geom).map(|(mesh, _)| mesh.triangles()[prim as usize]);
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
                let color = match (material.filter, areas) {
                    (Filter::Trilinear, Some(areas)) => {
                        let area = areas.of(i).scaled(material.uv_scale);
                        texture.lookup_area(uv, &area, wrap)
                    }
                    (filter, _) => texture.lookup(uv.x, uv.y, filter, wrap[0], wrap[1]),
                };
                set_lane(&mut out.base, i, color);
            }
        } else if let Some(colors) = &shape.colors {
            let color = match corners {
                Some(corners) => colors.at(prim, corners, weights),
                None => colors.of(prim - shape.first),
            };
            set_lane(&mut out.base, i, material.base * color);
        }
    }
}

/// The hit of one lane.
struct ShadedHit<'a> {
    geometry: &'a Geometry,
    packet: &'a RayPacket,
    surfaces: &'a Surfaces,
    i: usize,
}

/// Adds the triangle of lane `i`, which hit a mesh with these normals.
#[inline(always)]
fn gather(
    geometry: &Geometry,
    packet: &RayPacket,
    surfaces: &Surfaces,
    normals: &Normals,
    i: usize,
    smooth: &mut SmoothTriangles,
) {
    let (geom, prim) = (packet.hits.geom[i], packet.hits.prim[i]);
    let Some((mesh, placement)) = geometry.mesh(geom) else { return };
    let Some(corners) = mesh_corners(geometry, geom, prim) else { return };
    let mut normals = normals.of(prim, mesh.triangles()[prim as usize]);
    if let Some(placement) = placement {
        normals = normals.map(|normal| placement.normal(normal));
    }
    smooth.set(i, corners, normals, weights(surfaces, i));
}

/// Corners of a triangle of a mesh, in the scene. `None` if the geometry is no mesh.
#[inline(always)]
fn mesh_corners(geometry: &Geometry, geom: u32, prim: u32) -> Option<[[f32; 3]; 3]> {
    let (mesh, placement) = geometry.mesh(geom)?;
    let corners = mesh.corners(prim);
    // No closure: it would be compiled for the portable tier and called.
    Some(match placement {
        Some(placement) => placement.corners(corners),
        None => corners,
    })
}

/// Barycentric weights of the corners at the hit of lane `i`.
#[inline(always)]
fn weights(surfaces: &Surfaces, i: usize) -> [f32; 3] {
    let (u, v) = (surfaces.u[i] as f32, surfaces.v[i] as f32);
    [1.0 - u - v, u, v]
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
