//! lightpath: a CPU ray tracer for big scanned meshes.
//!
//! The program is [`cli`]. Everything else is a library that neither prints nor ends the process.
//! Its main interface is [`Renderer`]: it takes a [`Scene`] and meshes, builds an [`Accelerator`]
//! and renders a [`Film`].
//!
//! ```
//! use lightpath::{Mesh, Positions, Renderer, Scene};
//!
//! # fn main() -> Result<(), lightpath::error::Error> {
//! let scene = Scene::from_json(
//!     r#"{ "camera": { "type": "pinhole", "width": 32, "height": 24, "fov": 40,
//!                      "position": [0, 0, 3], "target": [0, 0, 0], "up": [0, 1, 0] },
//!          "scene": {
//!                     "lightsources": [{ "type": "pointlight", "position": [0, 1, 3],
//!                                        "id": [3, 3, 3] }],
//!                     "materials": { "clay": { "diffusecolor": [0.8, 0.4, 0.3] } },
//!                     "shapes": [] } }"#,
//! )?;
//! let positions = vec![[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]];
//! let mesh = Mesh::new(Positions::F32(positions), vec![[0, 1, 2]])?;
//! let renderer = Renderer::with_meshes(scene, vec![("triangle", "clay", mesh)])?;
//! let accelerator = renderer.accelerator()?;
//! let film = renderer.render(accelerator.as_ref())?;
//! let [red, green, blue, _] = film.pixels[32 * 12 + 16];
//! assert!(red > green && green > blue);
//! # Ok(())
//! # }
//! ```
//!
//! `examples/mesh_from_memory.rs` also writes the files.
//!
//! Data flows in one direction, with one function per arrow:
//! scene file -> [`scene::Description`] -> [`scene::Scene`] -> [`world::World`] ->
//! [`accel::Accelerator`] -> [`film::Film`] -> EXR and PNG. ARCHITECTURE.md has the diagram.

pub mod accel;
pub mod batch;
pub mod camera;
pub mod cli;
pub mod error;
pub mod farm;
pub mod files;
pub mod film;
pub mod geometry;
pub mod integrate;
pub mod lab;
pub mod layers;
pub mod math;
pub mod memory;
pub mod merge;
pub mod mesh;
pub mod monitor;
pub mod output;
pub mod paths;
pub mod picture;
pub mod ray;
pub mod render;
pub mod renderer;
pub mod report;
pub mod reserve;
pub mod sampler;
pub mod scene;
pub mod shading;
pub mod simd;
pub mod studio;
pub mod threads;
pub mod units;
pub mod world;

pub use accel::Accelerator;
pub use film::Film;
pub use mesh::{Mesh, Positions};
pub use renderer::Renderer;
pub use scene::Scene;
