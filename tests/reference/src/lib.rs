//! A second ray tracer, written only from `scene-format.md`, to check the first one.
//!
//! It shares no code with the crate. It reads the scene with `serde_json`, works in f64, and tests
//! every primitive (meshes through a plain median-split tree). It replaces every random choice by a
//! dense regular one, so its pictures are the integrals that the renderer estimates. Clarity comes
//! before speed; errors cause a panic that names the input. Quotes in doc comments name the section
//! of `scene-format.md` that a formula comes from.

pub mod camera;
pub mod geometry;
pub mod json;
pub mod mesh;
pub mod ply;
pub mod scene;
pub mod shade;
pub mod texture;
pub mod tree;
pub mod winding;

use glam::DVec3;
use scene::Scene;

/// A picture: premultiplied linear RGBA, rows from the top, with an estimate of its noise.
pub struct Picture {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// `width * height` pixels, red green blue alpha.
    pub pixels: Vec<[f64; 4]>,
    /// Expected standard deviation of a renderer that draws the scene's numbers of random samples
    /// independently; zero where it makes no random choice. Empty for a picture from a file.
    pub deviation: Vec<[f64; 4]>,
}

impl Picture {
    /// The pixel in column `i` and row `j`.
    pub fn at(&self, i: usize, j: usize) -> [f64; 4] {
        self.pixels[j * self.width + i]
    }
}

/// Density of the reference's sample grids.
#[derive(Clone, Copy)]
pub struct Density {
    /// Area lights are sampled on a `light` x `light` grid.
    pub light: usize,
    /// With `spp` > 1 a pixel is divided into `pixel` x `pixel` cells.
    pub pixel: usize,
    /// With a thin lens, each cell sends this many rays through the lens.
    pub lens: usize,
}

impl Default for Density {
    fn default() -> Self {
        Density { light: 32, pixel: 16, lens: 4 }
    }
}

/// Renders the whole picture; the machine's cores share the rows.
pub fn render(scene: &Scene, density: Density) -> Picture {
    let (width, height) = (scene.camera.width, scene.camera.height);
    let next = std::sync::atomic::AtomicUsize::new(0);
    let rows = std::sync::Mutex::new(vec![Vec::new(); height]);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|threads| {
        for _ in 0..cores {
            threads.spawn(|| {
                loop {
                    let j = next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    if j >= height {
                        break;
                    }
                    let row: Vec<_> = (0..width).map(|i| pixel(scene, density, i, j)).collect();
                    rows.lock().unwrap()[j] = row;
                }
            });
        }
    });
    let (pixels, deviation) = rows.into_inner().unwrap().into_iter().flatten().unzip();
    Picture { width, height, pixels, deviation }
}

/// Returns one pixel and its deviation: the mean over the camera rays ("Top level", `spp`), with
/// alpha and the treatment of misses from "Shading", Alpha.
fn pixel(scene: &Scene, density: Density, i: usize, j: usize) -> ([f64; 4], [f64; 4]) {
    let rays = scene.camera.rays(i, j, scene.spp, density);
    let n = rays.len() as f64;
    let (mut sum, mut squares, mut light_noise) = ([0.0; 4], [0.0; 4], DVec3::ZERO);
    for ray in &rays {
        let got = scene.cast(ray, 0, density.light);
        let seen = got.hit || !scene.transparent;
        let rgb = if seen { got.rgb } else { DVec3::ZERO };
        let sample = [rgb.x, rgb.y, rgb.z, if seen { 1.0 } else { 0.0 }];
        for c in 0..4 {
            sum[c] += sample[c];
            squares[c] += sample[c] * sample[c];
        }
        light_noise += got.deviation * got.deviation;
    }
    let mean = sum.map(|s| s / n);
    let light_noise = (light_noise / n).extend(0.0).to_array();
    let deviation = std::array::from_fn(|c| {
        // The renderer's camera samples are `spp` of a population whose variance the dense set
        // shows. 1/n is added for the error of the dense set itself.
        let camera_noise = (squares[c] / n - mean[c] * mean[c]).max(0.0);
        let camera_share = if scene.spp > 1 { 1.0 / scene.spp as f64 + 1.0 / n } else { 0.0 };
        (camera_noise * camera_share + light_noise[c] / scene.spp as f64).sqrt()
    });
    (mean, deviation)
}
