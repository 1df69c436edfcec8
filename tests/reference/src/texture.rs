//! Texture decoding and lookup ("Material" and "Texture coordinates").

use super::json::word_or;
use glam::{DVec2, DVec3};
use image::DynamicImage;
use serde_json::Value;
use std::path::Path;

/// An image with its lookup settings.
pub struct Texture {
    width: usize,
    height: usize,
    /// Linear RGB, rows from the top.
    texels: Vec<DVec3>,
    nearest: bool,
    /// Whether u and v repeat; otherwise they clamp.
    repeat: [bool; 2],
    scale: DVec2,
}

impl Texture {
    /// Reads the texture keys of a material; `wrap` is the shape's default in u and v.
    pub fn load(material: &Value, folder: &Path, wrap: [&str; 2]) -> Texture {
        let path = folder.join(word_or(material, "tPath", ""));
        let image = image::open(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let is_float =
            matches!(image, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
        let default_space = if is_float { "linear" } else { "srgb" };
        let srgb = word_or(material, "colorspace", default_space) == "srgb";
        let texels = raw_texels(&image)
            .into_iter()
            .map(|t| if srgb { DVec3::from_array(t.to_array().map(srgb_to_linear)) } else { t })
            .collect();
        let wrap = match material.get("wrap") {
            None => wrap.map(str::to_owned),
            Some(Value::String(both)) => [both.clone(), both.clone()],
            Some(pair) => [0, 1].map(|k| pair[k].as_str().expect("a wrap word").to_owned()),
        };
        let scale = |k: usize| material.get("tScale").map_or(1.0, |s| s[k].as_f64().unwrap());
        Texture {
            width: image.width() as usize,
            height: image.height() as usize,
            texels,
            nearest: word_or(material, "filter", "bilinear") == "nearest",
            repeat: wrap.map(|w| w == "repeat"),
            scale: DVec2::new(scale(0), scale(1)),
        }
    }

    /// The colour at (u, v), v down; "u, v are multiplied by [tScale] after any flip".
    pub fn lookup(&self, uv: DVec2) -> DVec3 {
        let uv = uv * self.scale;
        let (x, y) = (uv.x * self.width as f64, uv.y * self.height as f64);
        if self.nearest {
            return self.texel(x.floor(), y.floor());
        }
        let (left, top) = ((x - 0.5).floor(), (y - 0.5).floor());
        let (right, down) = (x - 0.5 - left, y - 0.5 - top);
        let above = self.texel(left, top).lerp(self.texel(left + 1.0, top), right);
        let below = self.texel(left, top + 1.0).lerp(self.texel(left + 1.0, top + 1.0), right);
        above.lerp(below, down)
    }

    /// "`wrap` applies to each texel index".
    fn texel(&self, column: f64, row: f64) -> DVec3 {
        let wrapped = |index: f64, size: usize, repeat: bool| {
            let size = size as f64;
            if repeat { index.rem_euclid(size) } else { index.clamp(0.0, size - 1.0) }
        };
        let i = wrapped(column, self.width, self.repeat[0]) as usize;
        let j = wrapped(row, self.height, self.repeat[1]) as usize;
        self.texels[j * self.width + i]
    }
}

/// Texels as stored: integers divided by their maximum, alpha dropped.
fn raw_texels(image: &DynamicImage) -> Vec<DVec3> {
    use DynamicImage as D;
    match image {
        D::ImageLuma8(_) | D::ImageLumaA8(_) | D::ImageRgb8(_) | D::ImageRgba8(_) => {
            let to_unit = |x: u8| f64::from(x) / 255.0;
            image.to_rgba8().pixels().map(|p| rgb(p.0.map(to_unit))).collect()
        }
        D::ImageRgb32F(_) | D::ImageRgba32F(_) => {
            image.to_rgba32f().pixels().map(|p| rgb(p.0.map(f64::from))).collect()
        }
        _ => {
            let to_unit = |x: u16| f64::from(x) / 65535.0;
            image.to_rgba16().pixels().map(|p| rgb(p.0.map(to_unit))).collect()
        }
    }
}

fn rgb([r, g, b, _]: [f64; 4]) -> DVec3 {
    DVec3::new(r, g, b)
}

/// Decodes one channel by IEC 61966-2-1.
pub fn srgb_to_linear(x: f64) -> f64 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}
