//! [`Scene`] -> [`World`]: meshes and textures loaded, everything relative to one f64 origin.

mod bounds;
mod fingerprint;
mod origin;
mod place;
mod resolution;
mod sources;
mod textures;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DVec3, Vec3};

use crate::camera::Camera;
use crate::error::{Error, Failures, Kind, Problem, Result};
use crate::geometry::{Geometry, Sphere, TriangleMesh};
use crate::mesh::{self, Mesh};
use crate::monitor::{Monitor, Phase};
use crate::reserve::Room;
use crate::scene::{Falloff, LightKind, SamplerKind, Scene, ShapeKind};
use crate::shading::{Area, Emitter, Light, Owner, Shape, Shapes, UvFrame, UvSource};

use self::place::{LARGEST, PlacedMesh};

pub use self::bounds::Bounds;
pub use self::fingerprint::{Contents, fingerprint};
pub use self::origin::Origin;
pub use self::place::placement;
pub use self::resolution::{Resolution, ulp};
pub use self::sources::{Read, mesh_sources, own_texture, sources};
pub use self::textures::one_of_several;

/// How files are read.
#[derive(Debug, Default)]
pub struct LoadOptions {
    /// Drop triangles that use bad vertices instead of refusing the mesh.
    pub repair: bool,
    /// Read meshes through a window instead of mapping their files into memory.
    pub no_mmap: bool,
    /// Meshes that have been read already, by the path that the scene names.
    pub ready: Vec<(PathBuf, Mesh)>,
    /// The most that the arrays of all meshes may take.
    pub room: Option<Room>,
    /// The most that all textures may take, decoding included; without it each may take 4 GiB.
    pub texture_bytes: Option<u64>,
    /// Measure the [`Resolution`] of every mesh. Without it edges that collapsed are looked for
    /// where there may be any.
    pub resolutions: bool,
}

impl LoadOptions {
    fn mesh(&mut self, path: &Path, monitor: &Monitor) -> Result<Mesh> {
        let ready = self.ready.iter().position(|(ready, _)| ready == path);
        // What the machine has left was asked for when such a mesh was there already.
        let counts = ready.is_none() || self.room.is_some_and(|room| room.asked);
        let mesh = match ready {
            Some(index) => self.ready.swap_remove(index).1,
            None => {
                let options = mesh::ReadOptions::default().repair(self.repair).room(self.room);
                mesh::read_ply(path, options.mmap(!self.no_mmap).monitor(monitor))?
            }
        };
        let left = |room: Room| if counts { room.less(mesh.bytes()) } else { room };
        self.room = self.room.map(left);
        Ok(mesh)
    }
}

/// Everything a render needs except the accelerator; all positions relative to
/// `geometry.origin`. A clone shares geometry and shapes.
#[derive(Debug, Clone)]
pub struct World {
    /// What the accelerator is built over.
    pub geometry: Arc<Geometry>,
    /// What the primitives look like.
    pub shapes: Arc<Shapes>,
    /// In file order.
    pub lights: Vec<Light>,
    /// The camera.
    pub camera: Camera,
    /// Pixels across and down that can be rendered: the camera's frame and the margin around it.
    pub frame: [u32; 2],
    /// Pixels of overscan on every side of the camera's frame.
    pub margin: u32,
    /// Shadow rays of area lights are traced where they are needed.
    pub adaptive_shadows: bool,
    /// Camera samples per pixel; of an adaptive render the most.
    pub spp: u32,
    /// Mirror bounces.
    pub nbounces: u32,
    /// Of every random choice.
    pub seed: i64,
    /// How sample points are chosen.
    pub sampler: SamplerKind,
    /// Radiance of rays that leave the scene.
    pub background: Vec3,
    /// Ambient light.
    pub ambient: Vec3,
    /// Of all lights.
    pub falloff: Falloff,
    /// Alpha is coverage.
    pub transparent: bool,
    /// What single precision leaves of the meshes, if [`LoadOptions::resolutions`] asked.
    pub resolutions: Vec<Resolution>,
    /// Why coordinates are relative to `geometry.origin`, and what that leaves near the camera.
    pub origin: Origin,
    /// The files that were opened.
    pub read: Read,
}

impl World {
    /// Opens the scene's files and prepares what rays need, on the threads of the current rayon
    /// pool. Problems that do not stop a render are returned as warnings.
    ///
    /// # Errors
    /// All problems of meshes and textures; `Interrupted` after a signal.
    pub fn load(
        scene: &Scene,
        mut options: LoadOptions,
        monitor: &Monitor,
    ) -> Result<(Self, Vec<Problem>)> {
        monitor.begin(Phase::Load, scene.shapes.len() as u64);
        let mut warnings = Vec::new();
        let mut failures = Failures::default();
        let mut read = Read::default();
        let asked = options.texture_bytes.map(|bytes| Room { bytes, asked: true });
        let left = asked.or(options.room);
        let looks = failures.keep(textures::load(scene, left, &mut read, &mut warnings));
        let mut bounds = Vec::with_capacity(scene.shapes.len());
        let mut meshes = Vec::new();
        let mut own_textures = Vec::new();
        for (index, shape) in scene.shapes.iter().enumerate() {
            let mut own = Bounds::of_shape(&shape.kind);
            if let ShapeKind::Trimesh(spec) = &shape.kind {
                let textured = scene.materials[shape.material].texture.is_some();
                let mesh = options.mesh(&spec.path, monitor);
                monitor.check()?;
                if let Ok(mesh) = &mesh {
                    read.0.push((spec.path.clone(), mesh.notes.stamp));
                }
                if let (Ok(mesh), false) = (&mesh, textured) {
                    own_textures.extend(textures::own(mesh, index, &spec.path, &mut warnings));
                }
                let mesh = mesh.and_then(|m| PlacedMesh::new(m, spec, textured, &mut warnings));
                let Some(mesh) = failures.keep(mesh) else { continue };
                own = mesh.bounds();
                if mesh.bounds().outside_view(&scene.camera) {
                    warnings.push(Problem::new(
                        &spec.place,
                        format!("{} lies outside the camera's view", spec.path.display()),
                    ));
                }
                meshes.push((index, mesh));
            }
            bounds.push(own);
            monitor.set_done(index as u64 + 1);
            monitor.check()?;
        }
        failures.check()?;
        let mut looks = looks.unwrap_or_default();
        let said = (&mut read, &mut warnings);
        let own = textures::load_own(&own_textures, scene, left, &mut looks, said)?;
        let (textures, materials) = looks;
        check_size(bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union), &mut warnings)?;
        let shapes = scene.shapes.iter().map(|shape| &shape.kind);
        let chosen = Origin::choose(&scene.camera, shapes.zip(bounds));
        warnings.extend(chosen.warning());
        let origin = chosen.position;
        let (mut resolutions, mut doubts) = (Vec::new(), Vec::new());
        if options.resolutions {
            resolutions.extend(meshes.iter().map(|(_, mesh)| mesh.resolution(origin)));
            warnings.extend(resolutions.iter().filter_map(Resolution::warning));
        } else {
            doubts.extend(meshes.iter().map(|(_, mesh)| mesh.doubt(origin)));
        }
        let without_area: Vec<_> = meshes.iter().map(|(_, mesh)| mesh.without_area()).collect();
        if let Some(room) = options.room {
            meshes.iter().try_fold(room, |room, (_, mesh)| mesh.fits(room))?;
        }
        let (geometry, shapes) = gather(scene, meshes, origin)?;
        for (found, mesh) in without_area.iter().zip(&geometry.meshes) {
            warnings.extend(found.iter().flat_map(|found| found.warnings(mesh)));
        }
        let mut shapes = Shapes { materials, textures, ..shapes };
        for (shape, material) in own {
            shapes.shapes[shape].material = material;
        }
        monitor.check()?;
        let settled = doubts.iter().zip(&geometry.meshes).filter_map(|(doubt, mesh)| {
            let doubt = doubt.as_ref()?;
            doubt.settle(mesh)
        });
        warnings.extend(settled);
        let world = Self::over(Arc::new(geometry), Arc::new(shapes), chosen, scene);
        let world = Self { resolutions, read, ..world };
        Ok((world, warnings))
    }

    /// Everything but the shapes, which are there.
    fn over(geometry: Arc<Geometry>, shapes: Arc<Shapes>, chosen: Origin, scene: &Scene) -> Self {
        let origin = chosen.position;
        Self {
            shapes,
            lights: scene.lights.iter().map(|light| recentre(light, &geometry)).collect(),
            camera: Camera::new(&scene.camera, origin),
            frame: [scene.camera.width, scene.camera.height],
            margin: 0,
            adaptive_shadows: scene.adaptive_shadows,
            spp: scene.spp,
            nbounces: scene.nbounces,
            seed: scene.seed,
            sampler: scene.sampler,
            background: scene.background,
            ambient: scene.ambient,
            falloff: scene.falloff,
            transparent: scene.transparent,
            resolutions: Vec::new(),
            origin: chosen,
            geometry,
            read: Read::default(),
        }
    }

    /// The same shapes in another frame of their scene: camera, lights, settings. What is built over
    /// this world's geometry serves that one too. `scene` differs from the one that was loaded in
    /// nothing that concerns shapes or materials.
    pub fn frame_of(&self, scene: &Scene) -> Self {
        Self::over(Arc::clone(&self.geometry), Arc::clone(&self.shapes), self.origin, scene)
    }

    /// Lets `margin` more pixels be rendered on every side of the camera's frame, whose own pixels stay
    /// what they are. Windows count from the margin's top left.
    pub fn with_margin(mut self, margin: u32) -> Self {
        self.frame = self.frame.map(|side| side - 2 * self.margin + 2 * margin);
        self.margin = margin;
        self
    }

    /// Right and bottom end, excluded, of the camera's frame in the coordinates of windows.
    pub fn frame_end(&self) -> [u32; 2] {
        self.frame.map(|side| side - self.margin)
    }

    /// Triangles of all meshes, and single triangles. Planes and spheres are not counted.
    pub fn triangles(&self) -> u64 {
        self.geometry.meshes.iter().map(|mesh| mesh.triangles().len() as u64).sum()
    }

    /// What an accelerator is built over: triangles, two for each plane, and spheres.
    pub fn primitives(&self) -> u64 {
        let others = 2 * self.geometry.quads.len() + self.geometry.spheres.len();
        self.triangles() + others as u64
    }

    /// Bytes held by primitives and vertex data.
    pub fn mesh_bytes(&self) -> u64 {
        self.geometry.bytes() + self.shapes.vertex_bytes()
    }

    /// Bytes held by textures.
    pub fn texture_bytes(&self) -> u64 {
        self.shapes.texture_bytes()
    }
}

/// Refuses what Embree would silently leave out, and warns where its single-precision products
/// leave their range: `tests/properties.rs` finds right answers from 1e-12 to 1e12.
fn check_size(bounds: Bounds, warnings: &mut Vec<Problem>) -> Result<()> {
    let size = bounds.longest_side();
    if size / 2.0 >= LARGEST {
        let message =
            format!("found shapes {size:e} apart, expected less than {:e}", 2.0 * LARGEST);
        return Err(Error::invalid("scene", message));
    }
    if size > 1e12 || (0.0..1e-12).contains(&size) {
        let message = format!(
            "found a scene of size {size:.1e}: outside of 1e-12 to 1e12 rays may miss what they should hit"
        );
        warnings.push(Problem::new("scene", message).help("choose another unit of length"));
    }
    Ok(())
}

fn recentre(light: &crate::scene::Light, geometry: &Geometry) -> Light {
    let origin = geometry.origin;
    let emitter = match &light.kind {
        LightKind::Point { position } => Emitter::Point((*position - origin).as_vec3()),
        LightKind::Area { corner, edge, height, samples, lambertian } => {
            let corner = (*corner - origin).as_vec3();
            let mut area = Area::new(corner, *edge, *height, *lambertian, *samples);
            area.set_flush(geometry);
            Emitter::Area(area)
        }
    };
    Light { diffuse: light.diffuse, specular: light.specular, emitter }
}

/// Sorts the shapes into geometries: one per mesh, one of all single triangles, quads, spheres.
fn gather(
    scene: &Scene,
    meshes: Vec<(usize, PlacedMesh)>,
    origin: DVec3,
) -> Result<(Geometry, Shapes)> {
    let local = |p: DVec3| (p - origin).as_vec3().to_array();
    let mut shapes: Vec<Shape> = Vec::with_capacity(scene.shapes.len());
    let (mut quads, mut quad_shapes) = (Vec::new(), Vec::new());
    let (mut spheres, mut sphere_shapes) = (Vec::new(), Vec::new());
    let (mut corners, mut triangle_shapes) = (Vec::new(), Vec::new());
    for (index, shape) in scene.shapes.iter().enumerate() {
        let index = index as u32;
        let textured = scene.materials[shape.material].texture.is_some();
        let uv = match &shape.kind {
            ShapeKind::Sphere { center, radius, pole } => {
                spheres.push(Sphere { center: *center - origin, radius: *radius });
                sphere_shapes.push(index);
                UvSource::Sphere { pole: *pole }
            }
            ShapeKind::Plane { corners } => {
                quads.push(corners.map(local));
                quad_shapes.push(index);
                linear(textured, || UvFrame::of_quad(&corners.map(|p| p - origin)))
            }
            ShapeKind::Triangle { corners: triangle } => {
                corners.extend(triangle.map(local));
                triangle_shapes.push(index);
                linear(textured, || UvFrame::of_triangle(&triangle.map(|p| p - origin)))
            }
            ShapeKind::Trimesh(_) => UvSource::None,
        };
        shapes.push(Shape { material: shape.material as u32, uv, normals: None, colors: None });
    }
    let mut arrays = Vec::new();
    let mut owners = Vec::new();
    for (index, mesh) in meshes {
        owners.push(Owner::One(index as u32));
        arrays.push(mesh.finish(origin, &mut shapes[index])?);
    }
    if !triangle_shapes.is_empty() {
        let triangles =
            (0..triangle_shapes.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
        arrays.push(TriangleMesh::new(corners, triangles, false));
        owners.push(Owner::Each(triangle_shapes));
    }
    owners.extend([Owner::Each(quad_shapes), Owner::Each(sphere_shapes)]);
    let geometry = Geometry::new(origin, arrays, quads, spheres).map_err(|count| {
        let message = format!("{count} primitives are more than the 4294967294 that fit");
        Error::new(Kind::Limit, Problem::new("scene", message))
    })?;
    Ok((geometry, Shapes { owners, shapes, materials: Vec::new(), textures: Vec::new() }))
}

/// The texture coordinates of a plane or a triangle: only what is textured keeps its frame.
fn linear(textured: bool, frame: impl FnOnce() -> UvFrame) -> UvSource {
    if textured { UvSource::Linear(Box::new(frame())) } else { UvSource::Corners }
}
