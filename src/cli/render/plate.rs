//! `--over`: the image behind the PNG.

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};

use crate::error::{Error, Problem, Result};
use crate::film::Window;
use crate::scene::{Filter, Scene, Wrap};
use crate::shading::{DEFAULT_MAX_BYTES, Negative, Texture};
use crate::units::plural;

/// The flag `--over`.
#[derive(Debug, Args)]
pub struct OverArgs {
    /// Show the PNG over this image of the frame's size (PNG, EXR...); the EXR stays the foreground
    #[arg(long, value_name = "PLATE", value_hint = ValueHint::FilePath)]
    pub over: Option<PathBuf>,
}

/// An image behind the PNG: of the frame's size, as linear light.
#[derive(Debug)]
pub struct PlateImage {
    path: PathBuf,
    image: Texture,
}

impl OverArgs {
    /// Returns the bytes that the plate and the composite need.
    ///
    /// # Errors
    /// An image whose header cannot be read.
    pub fn bytes(&self, window: Window) -> Result<u64> {
        let Some(path) = &self.over else { return Ok(0) };
        // The plate's pixels in the window, and the pixels of the composite.
        let composite =
            window.pixels().saturating_mul((size_of::<[f32; 3]>() + size_of::<[f32; 4]>()) as u64);
        Ok(Texture::size(path)?.decoding.saturating_add(composite))
    }

    /// Reads the plate.
    ///
    /// # Errors
    /// A picture without alpha; an image that cannot be read or does not have the frame's size.
    pub fn plate(&self, scene: &Scene, max_memory: Option<u64>) -> Result<Option<PlateImage>> {
        let Some(path) = &self.over else { return Ok(None) };
        if !scene.has_alpha() {
            let message = "found with a picture whose alpha is 1, expected one with alpha";
            let help = "--transparent, or a shape with `shadow_catcher` or `holdout`";
            return Err(Error::invalid("--over", message).help(help));
        }
        let limit = max_memory.unwrap_or(DEFAULT_MAX_BYTES);
        let image = Texture::load_within(path, limit)?;
        let (found, frame) =
            ([image.width(), image.height()], [scene.camera.width, scene.camera.height]);
        if found != frame {
            return Err(wrong_size(path, found, frame));
        }
        Ok(Some(PlateImage { path: path.clone(), image }))
    }
}

fn wrong_size(path: &Path, found: [u32; 2], frame: [u32; 2]) -> Error {
    let [[width, height], [frame_width, frame_height]] = [found, frame];
    let message = format!(
        "found {}, an image of {width} x {height} pixels, expected the frame's {frame_width} x \
         {frame_height}",
        path.display()
    );
    Error::invalid("--over", message).help(format!("--size {width}x{height}, or scale the image"))
}

impl PlateImage {
    /// Returns warnings of alpha, and of texels below 0.
    pub fn warnings(&self) -> Vec<Problem> {
        let path = self.path.display();
        let alpha = self.image.file().had_alpha;
        let alpha = alpha.then(|| format!("the alpha channel of {path} is ignored"));
        let negative = self.image.file().negative.map(|Negative { texels, first: [x, y] }| {
            let texels = plural(texels as usize, "negative texel");
            let message = format!(
                "found {texels} in {path}, the first at ({x}, {y}); the PNG is too dark there"
            );
            let help = "a colour is at least 0: clip the image, or convert it to a wider gamut";
            Problem::new("--over", message).help(help)
        });
        alpha.map(|message| Problem::new("--over", message)).into_iter().chain(negative).collect()
    }

    /// Returns the colours at the pixels of a window of the frame, row by row.
    pub fn pixels(&self, window: Window) -> Vec<[f32; 3]> {
        let image = &self.image;
        let [width, height] = [image.width(), image.height()].map(f64::from);
        let rows = (window.y0..window.y1).flat_map(|y| (window.x0..window.x1).map(move |x| [x, y]));
        let color = |[x, y]: [u32; 2]| {
            let [u, v] = [(f64::from(x) + 0.5) / width, (f64::from(y) + 0.5) / height];
            image.lookup(u, v, Filter::Nearest, Wrap::Clamp, Wrap::Clamp).to_array()
        };
        rows.map(color).collect()
    }
}
