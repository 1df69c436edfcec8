//! lightpath: a CPU ray tracer for big scanned meshes.
//!
//! Data flows one way, one function an arrow:
//! scene file -> [`scene::Description`] -> [`scene::Scene`] -> [`world::World`] ->
//! [`accel::Accelerator`] -> [`film::Film`] -> EXR and PNG. ARCHITECTURE.md draws it.

pub mod accel;
pub mod batch;
pub mod camera;
pub mod cli;
pub mod error;
pub mod film;
pub mod geometry;
pub mod integrate;
pub mod layers;
pub mod math;
pub mod measure;
pub mod memory;
pub mod mesh;
pub mod monitor;
pub mod output;
pub mod paths;
pub mod picture;
pub mod ray;
pub mod render;
pub mod report;
pub mod sampler;
pub mod scene;
pub mod shading;
pub mod simd;
pub mod studio;
pub mod units;
pub mod world;
