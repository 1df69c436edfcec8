//! lightpath: a CPU ray tracer for big scanned meshes.
//!
//! [`LoadedScene`] is a scene with its meshes and textures: JSON with meshes from files or from
//! memory, or a mesh in the built-in studio. [`Renderer`] is a loaded scene with its acceleration
//! structure. It renders a [`Film`], writes it to EXR and PNG, and traces your own rays.
//! Nothing is printed and no error ends the process: an [`Error`] holds every problem.
//!
//! ```
//! use lightpath::{LoadedScene, Mesh, Positions};
//!
//! # fn main() -> lightpath::Result<()> {
//! let scene = r#"{ "camera": { "type": "pinhole", "width": 32, "height": 24, "fov": 40,
//!                              "position": [0, 0, 3], "target": [0, 0, 0], "up": [0, 1, 0] },
//!                  "scene": { "lightsources": [{ "type": "pointlight", "position": [0, 1, 3],
//!                                                "id": [3, 3, 3] }],
//!                             "materials": { "clay": { "diffusecolor": [0.8, 0.4, 0.3] } },
//!                             "shapes": [] } }"#;
//! let positions = vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
//! let mesh = Mesh::new(Positions::F32(positions), vec![[0, 1, 2]])?;
//! let scene = LoadedScene::with_meshes(scene, &[], vec![("triangle", "clay", mesh)])?;
//! let film = scene.renderer()?.render()?;
//! let [red, green, blue, _] = film.pixels[32 * 12 + 16];
//! assert!(red > green && green > blue);
//! # Ok(())
//! # }
//! ```
//!
//! More examples: [`LoadedScene`] reads a layer, [`LoadedScene::in_studio`] shows a PLY file,
//! [`Renderer`] traces rays. Everything runs on the threads of the current rayon pool.

mod colormap;
mod farm;
mod files;
mod memory;
mod nearest;
mod parallel;
mod paths;
mod picture;
mod process;
mod rays;
mod renderer;
mod report;
mod reserve;
mod threads;
mod units;

// Internals, public for the program, the tests and the benchmarks. Not part of the interface: they
// may change in any release.
#[doc(hidden)]
pub mod accel;
#[doc(hidden)]
pub mod batch;
#[doc(hidden)]
pub mod calibration;
#[doc(hidden)]
pub mod camera;
#[doc(hidden)]
pub mod cli;
#[doc(hidden)]
pub mod error;
#[doc(hidden)]
pub mod film;
#[doc(hidden)]
pub mod geometry;
#[doc(hidden)]
pub mod integrate;
#[doc(hidden)]
pub mod lab;
#[doc(hidden)]
pub mod layers;
#[doc(hidden)]
pub mod math;
#[doc(hidden)]
pub mod merge;
#[doc(hidden)]
pub mod mesh;
#[doc(hidden)]
pub mod monitor;
#[doc(hidden)]
pub mod output;
#[doc(hidden)]
pub mod poses;
#[doc(hidden)]
pub mod ray;
#[doc(hidden)]
pub mod render;
#[doc(hidden)]
pub mod sampler;
#[doc(hidden)]
pub mod scene;
#[doc(hidden)]
pub mod shading;
#[doc(hidden)]
pub mod simd;
#[doc(hidden)]
pub mod studio;
#[doc(hidden)]
pub mod world;

pub use error::{Error, ErrorKind, Problem, Result};
pub use film::{Channel, ChannelKind, Film, Planes, Window};
pub use mesh::{Colors, FaceTextures, Mesh, MeshElement, Positions, Property, Scalars, Uvs};
pub use monitor::{Monitor, Phase};
pub use rays::{
    AllHits, ClosestPoints, Faces, FirstHits, Limits, MeshArrays, RayBackend, RayBatch, RayScene,
    Vertices,
};
pub use renderer::{
    Hit, LoadedScene, MakeMesh, PictureWriter, Ray, Renderer, Views, WrittenPicture,
};
