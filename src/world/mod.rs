//! Turns a [`Scene`] into a [`World`]: loads meshes and textures, and makes all coordinates
//! relative to one origin in f64.

mod bounds;
mod cameras;
mod colors;
mod fingerprint;
mod gather;
mod instances;
mod lights;
mod load_options;
mod maps;
mod origin;
mod place;
mod positions;
mod resolution;
mod sources;
mod textures;

use std::sync::Arc;

use glam::Vec3;

use crate::camera::{self, Camera};
use crate::error::{Error, Failures, Problem, Result};
use crate::geometry::{Geometry, PrimitiveCounts};
use crate::monitor::{Monitor, Phase};
use crate::output::legend::Legend;
use crate::reserve::MemoryLimit;
use crate::scene::{Falloff, SamplerKind, Scene, ShapeKind};
use crate::shading::{Light, LightTree, Shapes};

use self::gather::gather;
use self::lights::{occlusion, recentre, visible_environments};
use self::place::PlacedMesh;
use self::sources::LoadLog;
use self::textures::{MeshMaterial, TextureLimits};

pub use self::bounds::Bounds;
pub use self::colors::color_request;
pub use self::fingerprint::{ContentHashes, fingerprint};
pub use self::lights::VisibleEnvironment;
pub use self::load_options::LoadOptions;
pub use self::maps::Maps;
pub use self::origin::{Origin, View};
pub use self::place::{extent, placement};
pub use self::resolution::{Detail, Resolution, ulp};
pub use self::sources::{
    MissingImage, OwnImage, ReadFiles, Sources, mesh_sources, own_images, own_texture, sources,
};
pub use self::textures::{moved_texture_warning, several_textures_warning};

/// Everything that a render needs except the accelerator. All positions are relative to
/// `geometry.origin`. A clone shares geometry and shapes.
#[derive(Debug, Clone)]
pub struct World {
    /// The primitives, over which the accelerator is built.
    pub geometry: Arc<Geometry>,
    /// Materials and per-vertex data of the primitives.
    pub shapes: Arc<Shapes>,
    /// The lights in file order.
    pub lights: Vec<Light>,
    /// Draws some of the lights for each shading point. `None`: every shading point receives light
    /// from all.
    pub light_tree: Option<LightTree>,
    /// The camera, relative to the origin.
    pub camera: Camera,
    /// Rows of the rotation to camera space: x right, y up, z to the viewer.
    pub camera_axes: [Vec3; 3],
    /// Width and height of the area that can be rendered: the camera's frame and its overscan.
    pub frame: [u32; 2],
    /// Pixels of overscan on every side of the camera's frame.
    pub overscan: u32,
    /// True if shadow rays of area lights are traced adaptively.
    pub adaptive_shadows: bool,
    /// Camera samples per pixel; the maximum in an adaptive render.
    pub spp: u32,
    /// Camera samples that share the area of a pixel; those of the first pass in an adaptive
    /// render.
    pub area_spp: u32,
    /// Largest number of mirror bounces.
    pub nbounces: u32,
    /// Seed of all random choices.
    pub seed: i64,
    /// Sampler that chooses the sample points.
    pub sampler: SamplerKind,
    /// Radiance of rays that hit nothing.
    pub background: Vec3,
    /// Images of environments that these rays see in addition.
    pub visible_environments: Vec<VisibleEnvironment>,
    /// The loaded images of the environments.
    pub maps: Maps,
    /// Colour of the ambient light.
    pub ambient: Vec3,
    /// White light of the hemisphere for the layer of ambient occlusion, if there is one.
    pub occlusion: Option<Light>,
    /// Falloff of point lights and area lights with distance.
    pub falloff: Falloff,
    /// True if alpha is coverage; otherwise it is 1.
    pub transparent: bool,
    /// Resolution of the meshes in f32, if [`LoadOptions::resolutions`] is set.
    pub resolutions: Vec<Resolution>,
    /// Origin of the coordinates, and the precision near the camera.
    pub origin: Origin,
    /// The box of each shape of the scene, in world space.
    pub bounds: Arc<[Bounds]>,
    /// The files that were opened, with their stamps.
    pub read: ReadFiles,
    /// The colour map of the first mesh that shows a property.
    pub legend: Option<Legend>,
}

impl World {
    /// Opens the scene's files and prepares the data that rays need, on the threads of the current
    /// rayon pool. Problems that do not prevent a render are returned as warnings.
    ///
    /// # Errors
    /// All problems of meshes and textures; `Interrupted` after a signal.
    pub fn load(
        scene: &Scene,
        mut options: LoadOptions,
        monitor: &Monitor,
    ) -> Result<(Self, Vec<Problem>)> {
        let cameras = std::mem::take(&mut options.cameras);
        let (world, mut warnings) = Self::load_unseen(scene, options, monitor)?;
        let own = std::slice::from_ref(&scene.camera);
        let all = if cameras.is_empty() { own } else { &cameras };
        warnings.extend(world.camera_warnings(scene, all));
        warnings.extend(lights::occlusion_warning(scene, &world.origin));
        warnings.extend(world.origin.warning().filter(|_| cameras.is_empty()));
        Ok((world, warnings))
    }

    /// Does the same as [`World::load`] without the warnings about cameras.
    ///
    /// # Errors
    /// Those of [`World::load`].
    pub fn load_unseen(
        scene: &Scene,
        mut options: LoadOptions,
        monitor: &Monitor,
    ) -> Result<(Self, Vec<Problem>)> {
        monitor.begin(Phase::Load, scene.shapes.len() as u64);
        let (mut log, mut failures) = (LoadLog::default(), Failures::default());
        let asked = options.texture_bytes.map(|bytes| MemoryLimit { bytes, set_by_user: true });
        let budget = asked.or(options.memory_limit);
        let maps = failures.keep(Maps::load(scene, budget, &mut log));
        let maps = maps.unwrap_or_default();
        let left = budget.map(|budget| budget.less(maps.bytes()));
        let limits = TextureLimits::new(left, options.whole_texels);
        let looks = failures.keep(textures::load(scene, limits, &mut log));
        let mut bounds = Vec::with_capacity(scene.shapes.len());
        let mut meshes = Vec::new();
        let mut mesh_images = Vec::new();
        for (index, shape) in scene.shapes.iter().enumerate() {
            let mut own = Bounds::from_shape(&shape.kind);
            if let ShapeKind::Trimesh(spec) = &shape.kind {
                let textured = scene.materials[shape.material].texture.is_some();
                let mut mesh = options.mesh(spec, textured, monitor);
                monitor.check()?;
                if let Ok(mesh) = &mesh {
                    log.read.0.push((spec.path.clone(), mesh.notes.stamp));
                }
                if let (Ok(mesh), false) = (&mut mesh, textured || spec.color.is_some()) {
                    let images = textures::mesh_images(mesh, index, &spec.path, &mut log.warnings);
                    mesh_images.extend(failures.keep(images).flatten());
                }
                let mesh = mesh.and_then(|m| PlacedMesh::new(m, spec, textured, &mut log.warnings));
                let Some(mesh) = failures.keep(mesh) else { continue };
                own = mesh.bounds();
                if let Some(first) = &spec.transform {
                    own = own.transformed(first);
                }
                meshes.push((index, mesh));
            }
            if let ShapeKind::Instance { of, transform } = &shape.kind {
                // In the order of shapes; a mesh that could not be read is not among them.
                if let Ok(mesh) = meshes.binary_search_by_key(of, |(index, _)| *index) {
                    own = meshes[mesh].1.bounds().transformed(transform);
                }
            }
            bounds.push(own);
            monitor.set_done(index as u64 + 1);
            monitor.check()?;
        }
        failures.check()?;
        let mut looks = looks.unwrap_or_default();
        let mesh_materials =
            textures::load_mesh_images(mesh_images, scene, limits, &mut looks, &mut log)?;
        let (textures, materials) = looks;
        let whole = bounds.iter().copied().fold(Bounds::EMPTY, Bounds::union);
        check_size(whole, &mut log.warnings)?;
        log.warnings.extend(lights::facing_warnings(scene, &bounds));
        let shapes = scene.shapes.iter().map(|shape| &shape.kind);
        let boxed: Vec<_> = shapes.zip(bounds.iter().copied()).collect();
        let chosen = Origin::choose(&scene.camera, &boxed);
        let origin = chosen.position;
        // Meshes of instances keep an origin of their own.
        let faces =
            || meshes.iter().map(|(_, mesh)| mesh).filter(|m| !m.is_cloud() && !m.is_shared());
        let (mut resolutions, mut suspects) = (Vec::new(), Vec::new());
        if options.resolutions {
            resolutions.extend(faces().map(|mesh| mesh.resolution(origin)));
            log.warnings.extend(resolutions.iter().filter_map(Resolution::warning));
        } else {
            suspects.extend(faces().map(|mesh| mesh.collapse_suspect(origin)));
        }
        let legend = meshes.iter().find_map(|(_, mesh)| mesh.legend().cloned());
        let without_area: Vec<_> = faces().map(PlacedMesh::without_area).collect();
        let shared = meshes.iter().map(|(_, mesh)| mesh).filter(|mesh| mesh.is_shared());
        let shared_without_area: Vec<_> = shared.map(PlacedMesh::without_area).collect();
        let all_fit = |limit| meshes.iter().try_fold(limit, |left, (_, mesh)| mesh.fits(left));
        let mut room = options.memory_limit.map(all_fit).transpose()?;
        let (geometry, shapes, shared) = gather(scene, meshes, origin, &mut room)?;
        let found = without_area.iter().zip(&geometry.meshes);
        let found = found.chain(shared_without_area.iter().zip(shared.meshes()));
        log.warnings.extend(
            found.flat_map(|(found, mesh)| found.iter().flat_map(|found| found.warnings(mesh))),
        );
        log.warnings.extend(shared.collapse_warnings(scene, origin));
        let mut shapes = Shapes { materials, textures, ..shapes };
        for MeshMaterial { shape, material, textures } in mesh_materials {
            shapes.shapes[shape].material = material;
            shapes.shapes[shape].textures = textures.map(Box::new);
        }
        let copy = options.copy_instances || !scene.backend.traces_instances();
        if let (Some(room), true) = (room, copy) {
            shared.copies_fit(scene, &shapes.shapes, room)?;
        }
        let (geometry, mut shapes) = shared.place(scene, geometry, shapes, copy)?;
        shapes.make_mip_maps(left)?;
        monitor.check()?;
        let settled = suspects
            .iter()
            .zip(&geometry.meshes)
            .filter_map(|(suspect, mesh)| suspect.as_ref()?.settle(mesh));
        log.warnings.extend(settled);
        let lights = scene.lights.iter().map(|light| {
            monitor.check()?;
            Ok(recentre(light, &geometry, &maps, None))
        });
        let lights = lights.collect::<Result<_>>()?;
        let shared = (Arc::new(geometry), Arc::new(shapes), maps, bounds.into());
        let world = Self::over(shared, lights, chosen, scene);
        Ok((Self { resolutions, read: log.read, legend, ..world }, log.warnings))
    }

    /// Makes the world of a scene whose geometry, shapes, maps and lights are loaded.
    fn over(
        (geometry, shapes, maps, bounds): (Arc<Geometry>, Arc<Shapes>, Maps, Arc<[Bounds]>),
        lights: Vec<Light>,
        chosen: Origin,
        scene: &Scene,
    ) -> Self {
        let origin = chosen.position;
        let [right, up, forward] = camera::axes(&scene.camera);
        let tree = |samples| LightTree::new(&lights, samples, scene.falloff);
        Self {
            shapes,
            camera_axes: [right, up, -forward].map(|axis| axis.as_vec3()),
            light_tree: scene.emitter_samples.and_then(tree),
            lights,
            camera: Camera::new(&scene.camera, origin),
            frame: [scene.camera.width, scene.camera.height],
            overscan: 0,
            adaptive_shadows: scene.adaptive_shadows,
            spp: scene.spp,
            area_spp: scene.spp,
            nbounces: scene.nbounces,
            seed: scene.seed,
            sampler: scene.sampler,
            background: scene.background,
            visible_environments: visible_environments(scene, &maps),
            maps,
            ambient: scene.ambient,
            occlusion: occlusion(scene, &geometry),
            falloff: scene.falloff,
            transparent: scene.transparent,
            resolutions: Vec::new(),
            origin: chosen,
            bounds,
            geometry,
            read: ReadFiles::default(),
            legend: None,
        }
    }

    /// Returns the world of another frame: new camera, lights and settings, the same geometry and
    /// shapes. An accelerator over this world's geometry serves the new world, too. `scene` must
    /// not differ from the loaded scene in shapes, materials or images.
    pub fn frame_of(&self, scene: &Scene) -> Self {
        let (geometry, shapes) = (Arc::clone(&self.geometry), Arc::clone(&self.shapes));
        let shared = (geometry, shapes, self.maps.clone(), Arc::clone(&self.bounds));
        let lights = scene.lights.iter().enumerate().map(|(index, light)| {
            recentre(light, &self.geometry, &self.maps, self.lights.get(index))
        });
        Self::over(shared, lights.collect(), self.origin, scene)
    }

    /// Returns the world with `overscan` pixels of overscan on every side of the camera's frame.
    /// The pixels of the frame do not change. Coordinates of windows count from the top left of the
    /// overscan.
    pub fn with_overscan(mut self, overscan: u32) -> Self {
        self.frame = self.frame.map(|side| side - 2 * self.overscan + 2 * overscan);
        self.overscan = overscan;
        self
    }

    /// Right and bottom end (exclusive) of the camera's frame, in the coordinates of windows.
    pub fn frame_end(&self) -> [u32; 2] {
        self.frame.map(|side| side - self.overscan)
    }

    /// Number of triangles of meshes, of their instances, stitches included, and of single
    /// triangles. Planes and spheres are not counted.
    pub fn triangles(&self) -> u64 {
        let geometry = &self.geometry;
        let meshes = geometry.meshes.iter().map(|mesh| mesh.triangles().len() as u64);
        meshes.sum::<u64>() + geometry.count() - u64::from(geometry.own_count())
    }

    /// Number of primitives for the accelerator: one per triangle, two per plane, one per sphere. A
    /// mesh with instances counts once, and each instance as one primitive.
    /// If kinds of rays hit different shapes, a primitive counts once for each accelerator that
    /// holds it.
    pub fn primitives(&self) -> PrimitiveCounts {
        let quads = PrimitiveCounts::new(self.geometry.quads.len() as u64);
        self.geometry.accelerated().plus(quads)
    }

    /// Memory of primitives and vertex data, in bytes.
    pub fn mesh_bytes(&self) -> u64 {
        self.geometry.bytes() + self.shapes.vertex_bytes()
    }

    /// Memory of textures and of the environments' images, in bytes.
    pub fn texture_bytes(&self) -> u64 {
        self.shapes.texture_bytes() + self.maps.bytes()
    }
}

/// Upper bound of the extent of a scene. Its half bounds the coordinates relative to the middle:
/// Embree silently drops primitives beyond that (its `FLT_LARGE`, whose square is a hundredth of
/// the largest f32).
const MAX_EXTENT: f64 = 2.0 * 1.844e18;

/// Rejects a scene whose primitives Embree would silently drop. Warns if Embree's single-precision
/// products may overflow or underflow. `tests/library/hits/properties.rs` finds correct hits from
/// 1e-12 to 1e12.
fn check_size(bounds: Bounds, warnings: &mut Vec<Problem>) -> Result<()> {
    let size = bounds.longest_side();
    if size >= MAX_EXTENT {
        let message = format!("found shapes {size:e} apart, expected less than {MAX_EXTENT:e}");
        return Err(Error::invalid("scene", message));
    }
    if size > 1e12 || (0.0..1e-12).contains(&size) {
        let message = format!(
            "found a scene of size {size:.1e}: outside of 1e-12 to 1e12, rays may miss surfaces"
        );
        warnings.push(Problem::new("scene", message).help("choose another unit of length"));
    }
    Ok(())
}
