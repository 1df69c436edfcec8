//! Builds an Embree scene that reads the arrays of a [`Geometry`] without copies.

use std::ffi::{c_uint, c_void};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicI64, Ordering};

use super::device::Device;
use super::ffi::{self, Enum, GeometryHandle, SceneHandle};
use super::fixed::PinnedBox;
use super::sphere::{self, SphereSet};
use crate::accel::accelerator::BuildInfo;
use crate::accel::geometry_ref::GeometryRef;
use crate::error::Result;
use crate::geometry::{Geometry, Unseen};
use crate::monitor::Monitor;
use crate::ray::NONE;
use crate::scene::EmbreeMode;

/// A committed Embree scene that reads the arrays of a geometry.
pub struct EmbreeScene<'g> {
    handle: NonNull<SceneHandle>,
    // These are dropped after the scene is released.
    /// The geometry whose arrays Embree reads, and the user data of the spheres.
    spheres: PinnedBox<SphereSet<'g>>,
    device: Device,
}

// SAFETY: a committed scene is immutable and Embree's queries are thread-safe.
unsafe impl Send for EmbreeScene<'_> {}
// SAFETY: as above.
unsafe impl Sync for EmbreeScene<'_> {}

impl<'g> EmbreeScene<'g> {
    /// Hands all meshes, quads and spheres to Embree, without the primitives of `unseen`, and
    /// builds its tree.
    pub fn build(
        device: Device,
        (geometry, unseen): (GeometryRef<'g>, &Unseen),
        mode: EmbreeMode,
        monitor: &Monitor,
    ) -> Result<Self> {
        let base = geometry.bases()[geometry.spheres_id() as usize];
        let spheres = SphereSet { geometry: geometry.clone(), base, unseen: unseen.clone() };
        let mode_flags = match mode {
            EmbreeMode::Robust => ffi::RTC_SCENE_FLAG_ROBUST,
            EmbreeMode::Fast => 0,
            EmbreeMode::Compact => ffi::RTC_SCENE_FLAG_ROBUST | ffi::RTC_SCENE_FLAG_COMPACT,
        };
        let flags = mode_flags | ffi::RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS;
        let scene = Self::new(device, flags, spheres)?;
        let quads = geometry.quads_id();
        let own = |id: u32| geometry.bases()[id as usize]..geometry.bases()[id as usize + 1];
        for id in 0..quads {
            match unseen.count(&own(id)) {
                0 => scene.attach_mesh(id)?,
                _ if unseen.has_all(&own(id)) => {}
                _ => scene.attach_part_of_mesh(id, |prim| unseen.has(own(id).start + prim))?,
            }
        }
        if !unseen.has_all(&own(quads)) {
            let base = own(quads).start;
            scene.attach_quads(&geometry.quads, quads, |prim| unseen.has(base + prim))?;
        }
        if !unseen.has_all(&own(geometry.spheres_id())) {
            scene.attach_spheres(geometry.spheres_id())?;
        }
        scene.commit(monitor)?;
        Ok(scene)
    }

    fn new(device: Device, flags: Enum, spheres: SphereSet<'g>) -> Result<Self> {
        // SAFETY: a live device.
        let handle = unsafe { (device.api().new_scene)(device.handle()) };
        let Some(handle) = NonNull::new(handle) else {
            device.check()?;
            return Err(crate::error::Error::invalid("Embree", "no scene was created"));
        };
        let scene = Self { handle, spheres: PinnedBox::new(spheres), device };
        // SAFETY: live handles.
        unsafe {
            (scene.api().set_scene_flags)(scene.handle(), flags);
            (scene.api().set_scene_build_quality)(scene.handle(), ffi::RTC_BUILD_QUALITY_MEDIUM);
        }
        scene.device.check()?;
        Ok(scene)
    }

    /// Returns the entry points of the loaded library.
    pub fn api(&self) -> &ffi::Api {
        self.device.api()
    }

    /// Returns the `RTCScene`, which this value owns.
    pub fn handle(&self) -> *mut SceneHandle {
        self.handle.as_ptr()
    }

    /// Returns version and instruction set of Embree, and the memory of the device.
    pub fn info(&self) -> BuildInfo {
        let [major, minor, patch] = self.device.version();
        let load = |n: &AtomicI64| n.load(Ordering::Relaxed).max(0) as u64;
        let watch = self.device.watch();
        BuildInfo {
            version: format!("Embree {major}.{minor}.{patch}"),
            isa: self.device.isa().to_owned(),
            bytes: load(&watch.bytes),
            peak_bytes: load(&watch.peak_bytes),
        }
    }

    fn attach_mesh(&self, id: c_uint) -> Result<()> {
        let geometry = self.geometry(ffi::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        let (kind, format) = (ffi::RTC_BUFFER_TYPE_INDEX, ffi::RTC_FORMAT_UINT3);
        self.share(&geometry, kind, format, |all| all.meshes[id as usize].triangles(), 0);
        self.share_vertices(&geometry, id);
        self.attach(&geometry, id)
    }

    /// Attaches a mesh without the triangles that are `left_out`. The others keep their indices.
    fn attach_part_of_mesh(&self, id: c_uint, left_out: impl Fn(u32) -> bool) -> Result<()> {
        let geometry = self.geometry(ffi::RTC_GEOMETRY_TYPE_TRIANGLE)?;
        let mesh = &self.spheres.geometry.meshes[id as usize];
        // Embree leaves out a primitive whose indices are beyond the vertices.
        let triangles = (0..).zip(mesh.triangles());
        let triangles: Vec<[u32; 3]> = triangles
            .map(|(prim, &corners)| if left_out(prim) { [NONE; 3] } else { corners })
            .collect();
        let (kind, format) = (ffi::RTC_BUFFER_TYPE_INDEX, ffi::RTC_FORMAT_UINT3);
        self.fill(&geometry, kind, format, &triangles)?;
        self.share_vertices(&geometry, id);
        self.attach(&geometry, id)
    }

    fn share_vertices(&self, geometry: &OwnedGeometry, id: c_uint) {
        let (kind, format) = (ffi::RTC_BUFFER_TYPE_VERTEX, ffi::RTC_FORMAT_FLOAT3);
        // Embree reads 16 bytes from each vertex, so an unused vertex follows the last one.
        self.share(geometry, kind, format, |all| all.meshes[id as usize].padded_vertices(), 1);
    }

    /// Attaches the quads that are not `left_out`. They keep their indices.
    fn attach_quads(
        &self,
        quads: &[[[f32; 3]; 4]],
        id: c_uint,
        left_out: impl Fn(u32) -> bool,
    ) -> Result<()> {
        let geometry = self.geometry(ffi::RTC_GEOMETRY_TYPE_QUAD)?;
        let corners = |i: u32| [0, 1, 2, 3].map(|k| 4 * i + k);
        let indices: Vec<[u32; 4]> = (0..quads.len() as u32)
            .map(|i| if left_out(i) { [NONE; 4] } else { corners(i) })
            .collect();
        self.fill(
            &geometry,
            ffi::RTC_BUFFER_TYPE_VERTEX,
            ffi::RTC_FORMAT_FLOAT3,
            quads.as_flattened(),
        )?;
        self.fill(&geometry, ffi::RTC_BUFFER_TYPE_INDEX, ffi::RTC_FORMAT_UINT4, &indices)?;
        self.attach(&geometry, id)
    }

    /// Lets Embree read an array of the scene's geometry, without its last `unused` elements.
    fn share<T>(
        &self,
        geometry: &OwnedGeometry,
        kind: Enum,
        format: Enum,
        array: impl FnOnce(&Geometry) -> &[[T; 3]],
        unused: usize,
    ) {
        let array = array(&self.spheres.geometry);
        let count = array.len() - unused;
        let (data, stride) = (array.as_ptr().cast::<c_void>(), size_of::<[T; 3]>());
        // SAFETY: `spheres` keeps the geometry, which nobody changes, until the scene is released.
        // So the array stays where it is. It holds `count` elements.
        unsafe {
            (self.api().set_shared_buffer)(geometry.0, kind, 0, format, data, 0, stride, count);
        }
    }

    /// Copies `data` into a buffer that Embree owns.
    fn fill<T: Copy>(
        &self,
        geometry: &OwnedGeometry,
        kind: Enum,
        format: Enum,
        data: &[T],
    ) -> Result<()> {
        // SAFETY: a live geometry; Embree returns null (checked) or room for the elements.
        unsafe {
            let (stride, count) = (size_of::<T>(), data.len());
            let room = (self.api().set_new_buffer)(geometry.0, kind, 0, format, stride, count);
            self.device.check()?;
            if !room.is_null() {
                std::ptr::copy_nonoverlapping(data.as_ptr(), room.cast::<T>(), count);
            }
        }
        Ok(())
    }

    /// Attaches the spheres as user geometry. All callbacks are set: a query that lacks one
    /// crashes.
    fn attach_spheres(&self, id: c_uint) -> Result<()> {
        let geometry = self.geometry(ffi::RTC_GEOMETRY_TYPE_USER)?;
        // SAFETY: live geometry; the user data lives as long as this scene.
        unsafe {
            let count = self.spheres.geometry.spheres.len() as c_uint;
            (self.api().set_user_primitive_count)(geometry.0, count);
            (self.api().set_user_data)(geometry.0, self.spheres.user_data());
            (self.api().set_bounds_function)(geometry.0, Some(sphere::bounds), std::ptr::null());
            (self.api().set_intersect_function)(geometry.0, Some(sphere::intersect));
            (self.api().set_occluded_function)(geometry.0, Some(sphere::occluded));
        }
        self.attach(&geometry, id)
    }

    fn geometry(&self, kind: Enum) -> Result<OwnedGeometry<'_>> {
        // SAFETY: a live device.
        let handle = unsafe { (self.api().new_geometry)(self.device.handle(), kind) };
        self.device.check()?;
        Ok(OwnedGeometry(handle, self.api()))
    }

    fn attach(&self, geometry: &OwnedGeometry, id: c_uint) -> Result<()> {
        self.device.check()?;
        // SAFETY: live handles; the scene keeps its own reference to the geometry.
        unsafe {
            (self.api().commit_geometry)(geometry.0);
            (self.api().attach_geometry_by_id)(self.handle(), geometry.0, id);
        }
        self.device.check()
    }

    fn commit(&self, monitor: &Monitor) -> Result<()> {
        let user = std::ptr::from_ref(monitor).cast_mut().cast::<c_void>();
        // SAFETY: the callback is taken back before `monitor`'s borrow ends.
        unsafe {
            (self.api().set_progress_function)(self.handle(), Some(on_progress), user);
            (self.api().commit_scene)(self.handle());
            (self.api().set_progress_function)(self.handle(), None, std::ptr::null_mut());
        }
        let committed = self.device.check();
        monitor.check()?;
        committed
    }
}

impl Drop for EmbreeScene<'_> {
    fn drop(&mut self) {
        // SAFETY: created by `rtcNewScene`, released once, before the device.
        unsafe { (self.api().release_scene)(self.handle()) };
    }
}

/// An `RTCGeometry` reference that is released when dropped.
struct OwnedGeometry<'a>(*mut GeometryHandle, &'a ffi::Api);

impl Drop for OwnedGeometry<'_> {
    fn drop(&mut self) {
        // SAFETY: created by `rtcNewGeometry`, released once.
        unsafe { (self.1.release_geometry)(self.0) };
    }
}

unsafe extern "C" fn on_progress(monitor: *mut c_void, done: f64) -> bool {
    // SAFETY: `commit` passes a live monitor.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    monitor.set_done((done * 1000.0) as u64);
    !monitor.stopped()
}
