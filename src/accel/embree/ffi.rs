//! Embree 4's C API, declared by hand for the layout of 4.3 and later, and loaded at run time.
//!
//! Only the functions and types that are used are declared. The end of this file asserts the sizes
//! of most types and some offsets. `tests/repository/embree_layout.rs` compares [`LAYOUTS`] with
//! what a C program printed, and with the C headers if these are installed.
//!
//! The packets of 16 rays are declared in [`crate::ray`]: [`Rays`] is `RTCRay16`, `Hits` is
//! `RTCHit16`, and [`RayPacket`] (rays with their hits) is `RTCRayHit16`.

use std::ffi::{c_char, c_int, c_uint, c_void};
use std::mem::{align_of, offset_of, size_of};

use super::packet8::{Hits8, Mask8, RayPacket8, Rays8};
use crate::ray::{Hits, Mask, RayPacket, Rays};

/// A C enumeration or a set of flags (4 bytes).
pub type Enum = c_int;

/// Opaque C type `RTCDevice`.
#[repr(C)]
pub struct DeviceHandle([u8; 0]);
/// Opaque C type `RTCScene`.
#[repr(C)]
pub struct SceneHandle([u8; 0]);
/// Opaque C type `RTCGeometry`.
#[repr(C)]
pub struct GeometryHandle([u8; 0]);

pub const RTC_ERROR_OUT_OF_MEMORY: Enum = 4;
pub const RTC_GEOMETRY_TYPE_TRIANGLE: Enum = 0;
pub const RTC_GEOMETRY_TYPE_QUAD: Enum = 1;
pub const RTC_GEOMETRY_TYPE_USER: Enum = 120;
pub const RTC_BUFFER_TYPE_INDEX: Enum = 0;
pub const RTC_BUFFER_TYPE_VERTEX: Enum = 1;
pub const RTC_FORMAT_FLOAT3: Enum = 0x9003;
pub const RTC_FORMAT_UINT3: Enum = 0x5003;
pub const RTC_FORMAT_UINT4: Enum = 0x5004;
pub const RTC_SCENE_FLAG_COMPACT: Enum = 2;
pub const RTC_SCENE_FLAG_ROBUST: Enum = 4;
pub const RTC_SCENE_FLAG_FILTER_FUNCTION_IN_ARGUMENTS: Enum = 8;
pub const RTC_BUILD_QUALITY_MEDIUM: Enum = 1;
pub const RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER: Enum = 2;
pub const RTC_RAY_QUERY_FLAG_COHERENT: Enum = 0x10000;
pub const RTC_DEVICE_PROPERTY_VERSION: Enum = 0;
pub const RTC_DEVICE_PROPERTY_NATIVE_RAY8_SUPPORTED: Enum = 33;
pub const RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED: Enum = 34;

/// `RTCRay`: one ray of a single-ray query.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub struct RtcRay {
    pub org: [f32; 3],
    pub tnear: f32,
    pub dir: [f32; 3],
    pub time: f32,
    pub tfar: f32,
    pub mask: c_uint,
    pub id: c_uint,
    pub flags: c_uint,
}

/// `RTCHit`: one hit of a single-ray query.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub struct RtcHit {
    pub ng: [f32; 3],
    pub u: f32,
    pub v: f32,
    pub prim_id: c_uint,
    pub geom_id: c_uint,
    pub inst_id: c_uint,
    pub inst_prim_id: c_uint,
}

/// `RTCRayHit`: one ray and its hit.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
pub struct RtcRayHit {
    pub ray: RtcRay,
    pub hit: RtcHit,
}

/// `RTCBounds`: the bounding box of a primitive.
#[repr(C, align(16))]
pub struct RtcBounds {
    pub lower: [f32; 3],
    pub align0: f32,
    pub upper: [f32; 3],
    pub align1: f32,
}

/// `RTCRayQueryContext`, followed by two pointers that the filter callbacks read.
#[repr(C)]
pub struct QueryContext {
    pub inst_id: c_uint,
    pub inst_prim_id: c_uint,
    /// Scene-wide index of the first primitive of each geometry, by geometry id. Adding Embree's
    /// `prim_id` gives the scene-wide index of a primitive.
    pub bases: *const u32,
    /// Data of the filter function, from [`super::filter::HitFilter::data`].
    pub filter: *const c_void,
}

/// `RTCIntersectArguments` and `RTCOccludedArguments`. Both have the same layout.
#[repr(C)]
pub struct QueryArguments {
    pub flags: Enum,
    pub feature_mask: c_uint,
    pub context: *mut QueryContext,
    pub filter: Option<unsafe extern "C" fn(*const FilterArguments)>,
    /// `intersect` or `occluded` of the C structure: the callback for user geometries. Always null:
    /// the callbacks are set at the geometries.
    pub user_geometry: Option<unsafe extern "C" fn(*const c_void)>,
}

/// `RTCBoundsFunctionArguments`: arguments of a user geometry's bounds callback.
#[repr(C)]
pub struct BoundsArguments {
    /// `geometryUserPtr`: the pointer that `set_user_data` gave to the geometry.
    pub user: *const c_void,
    pub prim_id: c_uint,
    pub time_step: c_uint,
    pub bounds: *mut RtcBounds,
}

/// `RTCIntersectFunctionNArguments` and `RTCOccludedFunctionNArguments`. Both have the same layout;
/// `rays` is an `RTCRayHitN` or an `RTCRayN` of `n` lanes.
#[repr(C)]
pub struct UserArguments {
    /// `n` values: -1 for active lanes, 0 for the others.
    pub valid: *mut c_int,
    /// `geometryUserPtr`: the pointer that `set_user_data` gave to the geometry.
    pub user: *const c_void,
    pub prim_id: c_uint,
    pub context: *const c_void,
    pub rays: *mut f32,
    pub n: c_uint,
    pub geom_id: c_uint,
}

/// `RTCFilterFunctionNArguments`: arguments of a filter callback, for `n` lanes.
#[repr(C)]
pub struct FilterArguments {
    /// `n` values: -1 for lanes with a candidate, else 0. The filter rejects a candidate by writing
    /// 0.
    pub valid: *mut c_int,
    /// `geometryUserPtr`: the pointer that `set_user_data` gave to the geometry.
    pub user: *const c_void,
    pub context: *const QueryContext,
    pub ray: *mut f32,
    pub hit: *const f32,
    pub n: c_uint,
}

/// `RTCPointQuery`: a sphere to search.
#[repr(C, align(16))]
pub struct PointQuery {
    pub point: [f32; 3],
    pub time: f32,
    pub radius: f32,
}

/// `RTCPointQueryContext` for one level of instances.
#[repr(C, align(16))]
pub struct PointQueryContext {
    pub world2inst: [f32; 16],
    pub inst2world: [f32; 16],
    pub inst_id: c_uint,
    pub inst_prim_id: c_uint,
    pub inst_stack_size: c_uint,
}

/// `RTCPointQueryFunctionArguments`: arguments of the point query's callback.
#[repr(C, align(16))]
pub struct PointQueryArguments {
    pub query: *mut PointQuery,
    /// `userPtr`: the last argument of `rtcPointQuery`.
    pub user: *mut c_void,
    pub prim_id: c_uint,
    pub geom_id: c_uint,
    pub context: *mut PointQueryContext,
    pub similarity_scale: f32,
}

pub type PointQueryFunction = unsafe extern "C" fn(*const PointQueryArguments) -> bool;
pub type ErrorFunction = unsafe extern "C" fn(*mut c_void, Enum, *const c_char);
pub type MemoryFunction = unsafe extern "C" fn(*mut c_void, isize, bool) -> bool;
pub type ProgressFunction = unsafe extern "C" fn(*mut c_void, f64) -> bool;
pub type BoundsFunction = unsafe extern "C" fn(*const BoundsArguments);
pub type UserFunction = unsafe extern "C" fn(*const UserArguments);

macro_rules! api {
    ($($name:ident = $symbol:literal: fn($($arg:ty),*) $(-> $ret:ty)?;)*) => {
        /// The library's entry points.
        pub struct Api {
            $(pub $name: unsafe extern "C" fn($($arg),*) $(-> $ret)?,)*
        }

        impl Api {
            /// Resolves every entry point. The error names the first one that is missing.
            pub fn resolve(library: libloading::Library) -> Result<Self, libloading::Error> {
                $(
                    // SAFETY: the type is the C declaration of this symbol in Embree 4.
                    let $name = unsafe {
                        *library.get::<unsafe extern "C" fn($($arg),*) $(-> $ret)?>(
                            concat!($symbol, "\0").as_bytes(),
                        )?
                    };
                )*
                // Never unloaded: TBB's worker threads outlive the last device.
                std::mem::forget(library);
                Ok(Self { $($name,)* })
            }
        }
    };
}

type RtcDevice = *mut DeviceHandle;
type RtcScene = *mut SceneHandle;
type RtcGeometry = *mut GeometryHandle;

api! {
    new_device = "rtcNewDevice": fn(*const c_char) -> RtcDevice;
    release_device = "rtcReleaseDevice": fn(RtcDevice);
    get_device_property = "rtcGetDeviceProperty": fn(RtcDevice, Enum) -> isize;
    get_device_error = "rtcGetDeviceError": fn(RtcDevice) -> Enum;
    set_error_function = "rtcSetDeviceErrorFunction":
        fn(RtcDevice, Option<ErrorFunction>, *mut c_void);
    set_memory_function = "rtcSetDeviceMemoryMonitorFunction":
        fn(RtcDevice, Option<MemoryFunction>, *mut c_void);
    new_scene = "rtcNewScene": fn(RtcDevice) -> RtcScene;
    release_scene = "rtcReleaseScene": fn(RtcScene);
    set_scene_flags = "rtcSetSceneFlags": fn(RtcScene, Enum);
    set_scene_build_quality = "rtcSetSceneBuildQuality": fn(RtcScene, Enum);
    set_progress_function = "rtcSetSceneProgressMonitorFunction":
        fn(RtcScene, Option<ProgressFunction>, *mut c_void);
    attach_geometry_by_id = "rtcAttachGeometryByID": fn(RtcScene, RtcGeometry, c_uint);
    commit_scene = "rtcCommitScene": fn(RtcScene);
    new_geometry = "rtcNewGeometry": fn(RtcDevice, Enum) -> RtcGeometry;
    release_geometry = "rtcReleaseGeometry": fn(RtcGeometry);
    commit_geometry = "rtcCommitGeometry": fn(RtcGeometry);
    set_shared_buffer = "rtcSetSharedGeometryBuffer":
        fn(RtcGeometry, Enum, c_uint, Enum, *const c_void, usize, usize, usize);
    set_new_buffer = "rtcSetNewGeometryBuffer":
        fn(RtcGeometry, Enum, c_uint, Enum, usize, usize) -> *mut c_void;
    set_user_primitive_count = "rtcSetGeometryUserPrimitiveCount": fn(RtcGeometry, c_uint);
    set_user_data = "rtcSetGeometryUserData": fn(RtcGeometry, *const c_void);
    set_bounds_function = "rtcSetGeometryBoundsFunction":
        fn(RtcGeometry, Option<BoundsFunction>, *const c_void);
    set_intersect_function = "rtcSetGeometryIntersectFunction":
        fn(RtcGeometry, Option<UserFunction>);
    set_occluded_function = "rtcSetGeometryOccludedFunction": fn(RtcGeometry, Option<UserFunction>);
    intersect1 = "rtcIntersect1": fn(RtcScene, *mut RtcRayHit, *mut QueryArguments);
    intersect8 = "rtcIntersect8": fn(*const Mask8, RtcScene, *mut RayPacket8, *mut QueryArguments);
    intersect16 = "rtcIntersect16": fn(*const Mask, RtcScene, *mut RayPacket, *mut QueryArguments);
    occluded1 = "rtcOccluded1": fn(RtcScene, *mut RtcRay, *mut QueryArguments);
    occluded8 = "rtcOccluded8": fn(*const Mask8, RtcScene, *mut Rays8, *mut QueryArguments);
    occluded16 = "rtcOccluded16": fn(*const Mask, RtcScene, *mut Rays, *mut QueryArguments);
    point_query = "rtcPointQuery": fn(
        RtcScene, *mut PointQuery, *mut PointQueryContext, Option<PointQueryFunction>, *mut c_void
    ) -> bool;
}

/// Layout of one declared structure: `(C name, size, alignment, [(C member, offset)])`.
pub type StructLayout = (&'static str, usize, usize, &'static [(&'static str, usize)]);

macro_rules! layouts {
    ($($c_type:literal $type:ty { $($c_member:literal $member:ident),* })*) => {
        &[$((
            $c_type,
            size_of::<$type>(),
            align_of::<$type>(),
            &[$(($c_member, offset_of!($type, $member))),*],
        )),*]
    };
}

/// Rust's layouts of the structures declared here, for the test that compares them with the C
/// headers. `QueryContext` is missing, because it is longer than its C counterpart.
/// `RTCOccludedFunctionNArguments` lists only its last members. The others are those of
/// `RTCIntersectFunctionNArguments`. Embree never reads the id of a ray, so we store the primitive
/// that the ray leaves there.
pub const LAYOUTS: &[StructLayout] = layouts! {
    "RTCRay" RtcRay {
        "org_x" org, "tnear" tnear, "dir_x" dir, "time" time, "tfar" tfar, "mask" mask, "id" id,
        "flags" flags
    }
    "RTCHit" RtcHit {
        "Ng_x" ng, "u" u, "v" v, "primID" prim_id, "geomID" geom_id, "instID" inst_id,
        "instPrimID" inst_prim_id
    }
    "RTCRayHit" RtcRayHit { "hit" hit }
    "RTCRay16" Rays {
        "org_x" org, "tnear" tnear, "dir_x" dir, "time" time, "tfar" tfar, "mask" mask,
        "id" leaving, "flags" flags
    }
    "RTCRayHit16" RayPacket { "hit" hits }
    "RTCHit16" Hits {
        "Ng_x" ng, "u" u, "v" v, "primID" prim, "geomID" geom, "instID" instance,
        "instPrimID" instance_prim
    }
    "RTCRay8" Rays8 {
        "org_x" org, "tnear" tnear, "dir_x" dir, "time" time, "tfar" tfar, "mask" mask,
        "id" leaving, "flags" flags
    }
    "RTCRayHit8" RayPacket8 { "hit" hits }
    "RTCHit8" Hits8 {
        "Ng_x" ng, "u" u, "v" v, "primID" prim, "geomID" geom, "instID" instance,
        "instPrimID" instance_prim
    }
    "RTCBounds" RtcBounds { "lower_x" lower, "upper_x" upper }
    "RTCIntersectArguments" QueryArguments {
        "flags" flags, "feature_mask" feature_mask, "context" context, "filter" filter,
        "intersect" user_geometry
    }
    "RTCOccludedArguments" QueryArguments {
        "flags" flags, "feature_mask" feature_mask, "context" context, "filter" filter,
        "occluded" user_geometry
    }
    "RTCBoundsFunctionArguments" BoundsArguments {
        "geometryUserPtr" user, "primID" prim_id, "timeStep" time_step, "bounds_o" bounds
    }
    "RTCIntersectFunctionNArguments" UserArguments {
        "valid" valid, "geometryUserPtr" user, "primID" prim_id, "context" context, "rayhit" rays,
        "N" n, "geomID" geom_id
    }
    "RTCOccludedFunctionNArguments" UserArguments { "ray" rays, "N" n, "geomID" geom_id }
    "RTCFilterFunctionNArguments" FilterArguments {
        "valid" valid, "geometryUserPtr" user, "context" context, "ray" ray, "hit" hit, "N" n
    }
    "RTCPointQuery" PointQuery { "x" point, "time" time, "radius" radius }
    "RTCPointQueryContext" PointQueryContext {
        "world2inst" world2inst, "inst2world" inst2world, "instID" inst_id,
        "instPrimID" inst_prim_id, "instStackSize" inst_stack_size
    }
    "RTCPointQueryFunctionArguments" PointQueryArguments {
        "query" query, "userPtr" user, "primID" prim_id, "geomID" geom_id, "context" context,
        "similarityScale" similarity_scale
    }
};

const _: () = {
    assert!(size_of::<RtcRay>() == 48 && size_of::<RtcHit>() == 48 && size_of::<RtcRayHit>() == 96);
    assert!(size_of::<Rays>() == 768 && size_of::<RayPacket>() == 1344);
    assert!(align_of::<Rays>() == 64 && align_of::<RayPacket>() == 64 && align_of::<Mask>() == 64);
    assert!(offset_of!(RayPacket, hits) == 768 && offset_of!(Rays, leaving) == 640);
    assert!(size_of::<Rays8>() == 384 && size_of::<RayPacket8>() == 672);
    assert!(align_of::<RayPacket8>() == 32 && align_of::<Mask8>() == 32);
    assert!(size_of::<RtcBounds>() == 32 && size_of::<QueryArguments>() == 32);
    assert!(offset_of!(QueryContext, bases) == 8);
    assert!(size_of::<PointQuery>() == 32 && size_of::<PointQueryContext>() == 144);
    assert!(size_of::<PointQueryArguments>() == 48);
    assert!(size_of::<UserArguments>() == 48 && size_of::<FilterArguments>() == 48);
};
