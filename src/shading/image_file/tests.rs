//! Values of decoded files, and the refusal of files that are damaged, too large or no images.

use std::path::PathBuf;

use glam::{DVec2, Vec3};
use image::{Rgb, RgbImage, Rgba, RgbaImage};
use tempfile::TempDir;

use super::*;
use crate::error::ErrorKind;
use crate::output::srgb;
use crate::scene::Wrap;

const R: Wrap = Wrap::Repeat;
const C: Wrap = Wrap::Clamp;

/// Reads an image into memory.
fn read(path: &Path, space: Option<ColorSpace>, max_bytes: u64) -> Result<DecodedImage> {
    super::read(ImageRequest { path, color_space: space, max_bytes, whole: u64::MAX })
}

/// Reads an image into tiles.
fn read_tiles(path: &Path, max_bytes: u64) -> Result<DecodedImage> {
    super::read(ImageRequest { path, color_space: None, max_bytes, whole: 0 })
}

/// Writes one file into a new folder.
fn file(name: &str, data: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, data).unwrap();
    (folder, path)
}

fn saved(name: &str, image: &DynamicImage) -> (TempDir, PathBuf) {
    let (folder, path) = file(name, b"");
    image.save(&path).unwrap();
    (folder, path)
}

fn load(name: &str, data: &[u8]) -> DecodedImage {
    let (_folder, path) = file(name, data);
    read(&path, None, DEFAULT_MAX_BYTES).unwrap()
}

fn error(name: &str, data: &[u8]) -> Error {
    let (_folder, path) = file(name, data);
    read(&path, None, DEFAULT_MAX_BYTES).unwrap_err()
}

fn linear_ppm(data: &str) -> DecodedImage {
    let (_folder, path) = file("t.ppm", data.as_bytes());
    read(&path, Some(ColorSpace::Linear), DEFAULT_MAX_BYTES).unwrap()
}

fn nearest(decoded: &DecodedImage, u: f64, v: f64) -> Vec3 {
    decoded.image.nearest(DVec2::new(u, v), [C; 2])
}

fn bilinear(decoded: &DecodedImage, u: f64, v: f64, wrap: [Wrap; 2]) -> Vec3 {
    decoded.image.bilinear(DVec2::new(u, v), wrap)
}

#[test]
fn integers_are_srgb_and_decoded_before_filtering() {
    let t = load("t.ppm", b"P6 2 1 255\n\x00\x80\xff\xff\x80\xff");
    let half = srgb::to_linear(128.0 / 255.0) as f32;
    assert!((half - 0.215_860_5).abs() < 1e-6);
    let middle = bilinear(&t, 0.5, 0.5, [C; 2]);
    assert_eq!(middle, Vec3::new(0.5, half, 1.0));
    assert_eq!(t.image.bytes(), 6 + 1024);
}

#[test]
fn a_linear_color_space_skips_the_srgb_curve() {
    let t = linear_ppm("P3 1 1 255 51 102 255");
    let rgb = nearest(&t, 0.5, 0.5);
    assert!((rgb - Vec3::new(0.2, 0.4, 1.0)).length() < 1e-6);
}

#[test]
fn sixteen_bits_are_kept() {
    let t = linear_ppm("P3 1 1 65535 1 32768 65535");
    let rgb = nearest(&t, 0.5, 0.5);
    assert_eq!(rgb, Vec3::new(1.0, 32768.0, 65535.0) / 65535.0);
    let t = load("t.ppm", b"P6 1 1 65535\n\x80\x00\x00\x00\xff\xff");
    let half = srgb::to_linear(32768.0 / 65535.0) as f32;
    assert_eq!(nearest(&t, 0.0, 0.0), Vec3::new(half, 0.0, 1.0));
}

/// Every sample of every kind of Netpbm file is divided by the header's white level.
#[test]
fn samples_of_any_maxval_are_exact() {
    for white in [1u32, 2, 100, 200, 254, 255, 256, 1000, 4095, 65534, 65535] {
        let wide = white > 255;
        let samples: Vec<u32> = (0..=white).collect();
        let ascii: Vec<String> = samples.iter().map(u32::to_string).collect();
        let two = |x: &u32| (*x as u16).to_be_bytes();
        let binary: Vec<u8> = match wide {
            true => samples.iter().flat_map(two).collect(),
            false => samples.iter().map(|x| *x as u8).collect(),
        };
        let count = samples.len();
        let header = |magic: &str| format!("{magic}\n{count} 1\n{white}\n").into_bytes();
        let grey = |texel: u32| vec![texel; 3];
        let thirds: Vec<u8> = match wide {
            true => samples.iter().flat_map(|x| grey(*x)).flat_map(|x| two(&x)).collect(),
            false => samples.iter().flat_map(|x| grey(*x)).map(|x| x as u8).collect(),
        };
        let pam = format!(
            "P7\nWIDTH {count}\nHEIGHT 1\nDEPTH 1\nMAXVAL {white}\nTUPLTYPE GRAYSCALE\nENDHDR\n"
        );
        let files = [
            [header("P2"), ascii.join(" ").into_bytes()].concat(),
            [header("P5"), binary.clone()].concat(),
            [header("P6"), thirds].concat(),
            [pam.into_bytes(), binary].concat(),
        ];
        for data in files {
            let (_folder, path) = file("t.ppm", &data);
            for space in [ColorSpace::Linear, ColorSpace::Srgb] {
                let texture = read(&path, Some(space), DEFAULT_MAX_BYTES).unwrap();
                for &sample in &samples {
                    let exact = f64::from(sample) / f64::from(white);
                    let exact = match space {
                        ColorSpace::Linear => exact,
                        ColorSpace::Srgb => srgb::to_linear(exact),
                    };
                    let u = (f64::from(sample) + 0.5) / count as f64;
                    let found = nearest(&texture, u, 0.5);
                    let start = String::from_utf8_lossy(&data[..2]);
                    assert_eq!(found, Vec3::splat(exact as f32), "{start}: {sample} of {white}");
                }
            }
        }
    }
}

#[test]
fn samples_above_the_maxval_are_refused() {
    for data in [&b"P3 2 1 100 1 2 3 4 101 6"[..], b"P5 2 1 100\n\x64\x65", b"P2 2 1 300 5 301"] {
        let message = error("t.ppm", data).to_string();
        assert!(message.contains("texel (1, 0)"), "{message}");
        assert!(
            message.contains("more than 100") || message.contains("more than 300"),
            "{message}"
        );
    }
}

#[test]
fn png_grey_alpha_and_sixteen_bits() {
    let rgba = RgbaImage::from_fn(2, 1, |x, _| Rgba([255 * x as u8, 255, 0, 9]));
    let (_folder, path) = saved("a.png", &rgba.into());
    let t = read(&path, None, DEFAULT_MAX_BYTES).unwrap();
    assert!(t.had_alpha);
    assert_eq!(nearest(&t, 0.6, 0.5), Vec3::new(1.0, 1.0, 0.0));

    let grey = image::GrayImage::from_pixel(1, 1, image::Luma([51]));
    let (_folder, path) = saved("g.png", &grey.into());
    let t = read(&path, Some(ColorSpace::Linear), DEFAULT_MAX_BYTES).unwrap();
    assert!((nearest(&t, 0.5, 0.5) - Vec3::splat(0.2)).length() < 1e-6);

    let deep = image::ImageBuffer::from_pixel(1, 1, Rgb([1u16, 2, 65535]));
    let (_folder, path) = saved("d.png", &DynamicImage::ImageRgb16(deep));
    let t = read(&path, Some(ColorSpace::Linear), DEFAULT_MAX_BYTES).unwrap();
    let expected = Vec3::new(1.0, 2.0, 65535.0) / 65535.0;
    assert_eq!(nearest(&t, 0.5, 0.5), expected);
    assert_eq!(t.image.bytes(), 12);
}

#[test]
fn content_decides_the_format() {
    let t = load("actually-a-ppm.png", b"P6 1 1 255\n\xff\xff\xff");
    assert_eq!(nearest(&t, 0.5, 0.5), Vec3::ONE);
}

#[test]
fn jpeg_is_decoded() {
    let image = RgbImage::from_pixel(16, 8, Rgb([200, 100, 50]));
    let (_folder, path) = saved("t.jpg", &image.into());
    let t = read(&path, Some(ColorSpace::Linear), DEFAULT_MAX_BYTES).unwrap();
    assert_eq!(t.image.size(), (16, 8));
    let rgb = nearest(&t, 0.5, 0.5) * 255.0;
    assert!((rgb - Vec3::new(200.0, 100.0, 50.0)).abs().max_element() < 4.0);
}

#[test]
fn hdr_and_exr_are_linear_and_unbounded() {
    let image = image::Rgb32FImage::from_pixel(3, 2, Rgb([4.0, 0.25, 0.0]));
    let image = DynamicImage::ImageRgb32F(image);
    for name in ["t.hdr", "t.exr"] {
        let (_folder, path) = saved(name, &image);
        let t = read(&path, None, DEFAULT_MAX_BYTES).unwrap();
        assert_eq!(t.image.size(), (3, 2));
        assert_eq!(bilinear(&t, 0.4, 0.6, [R, C]), Vec3::new(4.0, 0.25, 0.0));
        let t = read(&path, Some(ColorSpace::Srgb), DEFAULT_MAX_BYTES).unwrap();
        assert!(bilinear(&t, 0.4, 0.6, [R, C]).x > 20.0);
    }
}

#[test]
fn a_radiance_file_may_begin_with_its_other_name() {
    let image = image::Rgb32FImage::from_pixel(3, 2, Rgb([4.0, 0.25, 0.0]));
    let (folder, path) = saved("t.hdr", &DynamicImage::ImageRgb32F(image));
    let whole = std::fs::read(path).unwrap();
    let renamed = [&b"#?RGBE"[..], whole.strip_prefix(b"#?RADIANCE").unwrap()].concat();
    let path = folder.path().join("renamed.hdr");
    std::fs::write(&path, &renamed).unwrap();
    assert_eq!(super::size(&path, u64::MAX).unwrap().0, (3, 2));
    let t = read(&path, None, DEFAULT_MAX_BYTES).unwrap();
    assert_eq!(nearest(&t, 0.4, 0.6), Vec3::new(4.0, 0.25, 0.0));
    let cut = error("cut.hdr", &renamed[..renamed.len() - 3]).to_string();
    assert!(cut.contains("ends too early"), "{cut}");
    let (name, rest) = whole.split_at(b"#?RADIANCE\n".len());
    let long = [name, &b"a=\n".repeat(1 << 17), rest].concat();
    let long = error("long.hdr", &long);
    assert_eq!(long.kind, ErrorKind::Limit, "{long}");
    // The size does not follow an empty line of a line feed alone, however long the pixels are.
    let returns = b"#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r\n-Y 300 +X 400\r\n";
    let returns = error("crlf.hdr", &[&returns[..], &vec![7; 1 << 19]].concat()).to_string();
    assert!(returns.contains("no end of its header in the first 262144 bytes"), "{returns}");
    assert!(returns.contains("a line feed alone"), "{returns}");
}

#[test]
fn an_exr_of_integers_is_refused() {
    use ::exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
    let (_folder, path) = file("t.exr", b"");
    let channel = |name| AnyChannel::new(name, FlatSamples::U32(vec![7; 4]));
    let channels = AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect());
    Image::from_channels((2, 2), channels).write().to_file(&path).unwrap();
    let message = read(&path, None, DEFAULT_MAX_BYTES).unwrap_err().to_string();
    assert!(message.contains("of type uint, expected half or float"), "{message}");
}

/// Without a disk, a large image stays in memory.
#[test]
fn an_image_without_space_for_its_tiles_is_kept_and_told() {
    let t = load("t.ppm", b"P6 2 1 255\n\x00\x80\xff\xff\x80\xff");
    assert!(!t.lacks_disk);
    let expected = nearest(&t, 0.1, 0.5);
    let kept = into_tiles(t, None, Path::new("t.ppm")).unwrap();
    assert!(kept.lacks_disk && kept.image.tiles().is_none());
    assert_eq!(nearest(&kept, 0.1, 0.5), expected);
}

#[test]
fn an_exr_with_luminance_alone_is_grey() {
    use ::exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
    let saved = |names: &[&'static str]| {
        let (folder, path) = file("y.exr", b"");
        let values = FlatSamples::F32(vec![0.25, -1.0, 7.5, 0.0]);
        let channel = |name: &&'static str| AnyChannel::new(*name, values.clone());
        let channels = AnyChannels::sort(names.iter().map(channel).collect());
        Image::from_channels((2, 2), channels).write().to_file(&path).unwrap();
        (folder, read(&path, None, DEFAULT_MAX_BYTES))
    };
    for (names, alpha) in [(&["Y"][..], false), (&["A", "Y", "Z"], true)] {
        let texture = saved(names).1.unwrap();
        assert_eq!(texture.had_alpha, alpha);
        let texels = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
        let found = texels.map(|(u, v)| nearest(&texture, u, v));
        assert_eq!(found, [0.25, -1.0, 7.5, 0.0].map(Vec3::splat));
    }
    // Chroma makes it a colour file, which is not read. X and R belong to other colours.
    let colors = [&["Y", "RY", "BY"][..], &["X", "Y", "Z"], &["R", "G", "Y"], &["Z"]];
    for names in colors {
        let message = saved(names).1.unwrap_err().to_string();
        assert!(message.contains("no part with the channels R, G and B, or Y"), "{message}");
    }
}

#[test]
fn an_exr_texture_is_one_part() {
    use ::exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
    use ::exr::prelude::{Encoding, ImageAttributes, IntegerBounds, Layer, LayerAttributes};
    let (_folder, path) = file("parts.exr", b"");
    let part = |names: &[&'static str], value: f32| {
        let channel =
            |name: &&'static str| AnyChannel::new(*name, FlatSamples::F32(vec![value; 4]));
        let channels = AnyChannels::sort(names.iter().map(channel).collect());
        let attributes = LayerAttributes::named(names.concat().as_str());
        Layer::new((2, 2), attributes, Encoding::FAST_LOSSLESS, channels)
    };
    let parts = [part(&["BY", "RY", "Y"], 0.9), part(&["Y"], 0.25)];
    let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((2, 2)));
    let image = Image::empty(attributes).with_layer(parts[0].clone()).with_layer(parts[1].clone());
    image.write().to_file(&path).unwrap();
    let texture = read(&path, None, DEFAULT_MAX_BYTES).unwrap();
    assert_eq!(nearest(&texture, 0.25, 0.25), Vec3::splat(0.25));
}

#[test]
fn exr_alpha_is_dropped_and_nan_refused() {
    let rgba = image::Rgba32FImage::from_pixel(2, 2, Rgba([1.0, 2.0, 3.0, 0.5]));
    let mut image = DynamicImage::ImageRgba32F(rgba);
    let (_folder, path) = saved("t.exr", &image);
    let t = read(&path, None, DEFAULT_MAX_BYTES).unwrap();
    assert!(t.had_alpha);
    assert_eq!(nearest(&t, 0.5, 0.5), Vec3::new(1.0, 2.0, 3.0));

    if let DynamicImage::ImageRgba32F(rgba) = &mut image {
        rgba.put_pixel(1, 1, Rgba([0.0, f32::NAN, 0.0, 1.0]));
    }
    let (_folder, path) = saved("n.exr", &image);
    let message = read(&path, None, DEFAULT_MAX_BYTES).unwrap_err().to_string();
    assert!(message.contains("texel (1, 1) is NaN"), "{message}");
}

/// The data window lies inside the picture, leaves it on two sides, lies beside it, or contains
/// it.
#[test]
fn an_exr_texture_is_its_display_window() {
    use ::exr::prelude::*;
    for (first, size) in
        [((2, 1), (3, 2)), ((-2, -1), (4, 3)), ((9, 9), (2, 2)), ((-1, -1), (9, 8))]
    {
        let pixels = SpecificChannels::rgb(|at: Vec2<usize>| {
            (at.x() as f32 + 1.0, at.y() as f32 + 1.0, 0.5)
        });
        let attributes = LayerAttributes {
            layer_position: Vec2(first.0 + 5, first.1 - 7),
            ..Default::default()
        };
        let layer = Layer::new(size, attributes, Encoding::FAST_LOSSLESS, pixels);
        let window = IntegerBounds::new((5, -7), (6usize, 5usize));
        let image = Image { attributes: ImageAttributes::new(window), ..Image::from_layer(layer) };
        let (_folder, path) = file("w.exr", b"");
        image.write().to_file(&path).unwrap();
        let texture = self::read(&path, None, DEFAULT_MAX_BYTES).unwrap();
        assert_eq!(texture.image.size(), (6, 5));
        let mut has = 0;
        for (x, y) in (0..5).flat_map(|y| (0..6).map(move |x| (x, y))) {
            let (dx, dy) = (x - first.0, y - first.1);
            let inside = (0..size.0 as i32).contains(&dx) && (0..size.1 as i32).contains(&dy);
            let expected = match inside {
                true => Vec3::new(dx as f32 + 1.0, dy as f32 + 1.0, 0.5),
                false => Vec3::ZERO,
            };
            let (u, v) = ((f64::from(x) + 0.5) / 6.0, (f64::from(y) + 0.5) / 5.0);
            assert_eq!(nearest(&texture, u, v), expected, "{first:?} {x} {y}");
            has += u64::from(inside);
        }
        assert_eq!(texture.image.bytes(), 12 * has);
        assert_eq!(super::size(&path, u64::MAX).unwrap().1.decoding, 12 * has);
    }
}

#[test]
fn a_header_larger_than_memory_is_refused_before_decoding() {
    for header in ["P3 100000 100000 255 ", "P6 100000 100000 255\n"] {
        let e = error("t.ppm", header.as_bytes());
        assert_eq!(e.kind, ErrorKind::Limit);
        let message = e.to_string();
        assert!(message.contains("100000 x 100000 pixels need 60000000000 bytes"));
        assert!(message.contains("the limit is 4294967296"), "{message}");
    }
    let (_folder, path) = file("t.ppm", b"P6 2 2 255\n123456789012");
    assert!(read(&path, None, 24).is_ok());
    let e = read(&path, None, 23).unwrap_err();
    assert_eq!(e.kind, ErrorKind::Limit);
    error("t.ppm", b"P6 4294967295 4294967295 255\n");
    let beyond = error("t.ppm", b"P6 2000000000 2000000000 255\n").to_string();
    assert!(beyond.contains("need at least 18446744073709551615 bytes"), "{beyond}");
    error("t.ppm", b"P4 4294967295 4294967295\n");
    error("t.ppm", b"P6 99999999999999 1 255\n");
    error("t.ppm", b"P6 0 5 255\n");
}

#[test]
fn files_that_are_no_images_have_clear_errors() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| read(path, None, DEFAULT_MAX_BYTES).unwrap_err().to_string();
    let missing = message(&folder.path().join("no.png"));
    assert!(missing.contains("no.png: cannot read the texture: No such file"));
    assert!(message(folder.path()).contains("is a folder"));
    assert!(message(Path::new("/dev/null")).contains("not a regular file"));
    assert!(error("t.png", b"").to_string().contains("is empty"));
    let unknown = error("t.png", b"hello world, this is text").to_string();
    assert!(unknown.contains("not an image of a known format"), "{unknown}");
    assert!(unknown.contains("Netpbm (P1 to P7), PNG, JPEG"));
    let webp = error("t.webp", b"RIFF\x00\x00\x00\x00WEBPVP8 ");
    assert_eq!(webp.kind, ErrorKind::Unsupported);
}

#[test]
fn every_truncation_is_an_error() {
    let image = DynamicImage::ImageRgb8(RgbImage::from_fn(24, 16, |x, y| {
        Rgb([(x * 10) as u8, (y * 15) as u8, (x * y) as u8])
    }));
    for name in ["t.png", "t.jpg", "t.hdr", "t.exr", "t.ppm"] {
        let image = match name {
            "t.hdr" | "t.exr" => DynamicImage::ImageRgb32F(image.to_rgb32f()),
            _ => image.clone(),
        };
        let (_folder, path) = saved(name, &image);
        let whole = std::fs::read(&path).unwrap();
        // A PNG is complete once its pixels are; its last chunk holds no data.
        let end = whole.len() - if name == "t.png" { 13 } else { 1 };
        for length in (0..end).step_by(7).chain([end]) {
            std::fs::write(&path, &whole[..length]).unwrap();
            let e = read(&path, None, DEFAULT_MAX_BYTES);
            assert!(e.is_err(), "{name} cut at {length} of {}", whole.len());
        }
    }
    let short = error("t.ppm", b"P3 2 2 255 1 2 3 4");
    assert_eq!(short.kind, ErrorKind::Invalid);
}

#[test]
fn flipped_bytes_never_panic() {
    let image = DynamicImage::ImageRgb8(RgbImage::from_pixel(9, 7, Rgb([1, 200, 77])));
    for name in ["t.png", "t.jpg", "t.hdr", "t.exr", "t.ppm"] {
        let image = match name {
            "t.hdr" | "t.exr" => DynamicImage::ImageRgb32F(image.to_rgb32f()),
            _ => image.clone(),
        };
        let (_folder, path) = saved(name, &image);
        let whole = std::fs::read(&path).unwrap();
        for at in (0..whole.len().min(700)).step_by(5) {
            for bits in [0xff, 0x01] {
                let mut data = whole.clone();
                data[at] ^= bits;
                std::fs::write(&path, &data).unwrap();
                let _ = read(&path, None, 1 << 26);
            }
        }
    }
}

/// Images of all kinds of pixels, larger than a tile.
fn for_tiles() -> Vec<(TempDir, PathBuf)> {
    let rgba = DynamicImage::ImageRgba8(RgbaImage::from_fn(150, 70, |x, y| {
        Rgba([(x * y) as u8, (3 * x) as u8, (5 * y) as u8, (x + y) as u8])
    }));
    let rgb = DynamicImage::ImageRgb8(rgba.to_rgb8());
    vec![
        saved("rgba.png", &rgba),
        saved("rgb.png", &rgb),
        saved("grey.png", &DynamicImage::ImageLuma8(rgba.to_luma8())),
        saved("grey-alpha.png", &DynamicImage::ImageLumaA8(rgba.to_luma_alpha8())),
        saved("rgb.jpg", &rgb),
        saved("grey.jpg", &DynamicImage::ImageLuma8(rgba.to_luma8())),
        saved("rgb.ppm", &rgb),
        palette(),
        saved("deep.png", &DynamicImage::ImageRgb16(rgba.to_rgb16())),
        saved("float.exr", &DynamicImage::ImageRgb32F(rgba.to_rgb32f())),
    ]
}

/// A PNG of 4-bit indices.
fn palette() -> (TempDir, PathBuf) {
    let (folder, path) = file("palette.png", b"");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 130, 66);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Four);
    encoder.set_palette((0..48).map(|i| 5 * i).collect::<Vec<u8>>());
    let indices: Vec<u8> = (0..65 * 66).map(|i| (i * 7) as u8).collect();
    encoder.write_header().unwrap().write_image_data(&indices).unwrap();
    (folder, path)
}

#[test]
fn tiles_have_the_texels_of_the_whole_image() {
    for (_folder, path) in for_tiles() {
        let (whole, tiles) = (
            read(&path, None, DEFAULT_MAX_BYTES).unwrap(),
            read_tiles(&path, DEFAULT_MAX_BYTES).unwrap(),
        );
        assert_eq!((whole.had_alpha, whole.stamp), (tiles.had_alpha, tiles.stamp));
        let eight_bits = whole.image.is_stored_as_bytes();
        assert!(tiles.image.tiles().is_none() || eight_bits);
        let (width, height) = whole.image.size();
        assert_eq!(tiles.image.size(), (width, height));
        for (x, y) in (0..height as usize).flat_map(|y| (0..width as usize).map(move |x| (x, y))) {
            assert_eq!(tiles.image.texel(x, y), whole.image.texel(x, y), "{path:?} {x} {y}");
        }
    }
}

#[test]
fn damaged_files_have_the_same_errors_in_tiles() {
    let message = |result: Result<DecodedImage>| result.err().map(|error| error.to_string());
    for (_folder, path) in for_tiles() {
        let data = std::fs::read(&path).unwrap();
        let same = |damaged: &[u8]| {
            std::fs::write(&path, damaged).unwrap();
            let whole = read(&path, None, DEFAULT_MAX_BYTES);
            let tiles = read_tiles(&path, DEFAULT_MAX_BYTES);
            assert_eq!(message(whole), message(tiles), "{path:?}");
        };
        for length in (0..data.len()).step_by(data.len() / 50).chain(data.len() - 20..data.len()) {
            same(&data[..length]);
        }
        for at in (0..data.len()).step_by(data.len() / 90) {
            let mut damaged = data.clone();
            damaged[at] ^= 0x11;
            same(&damaged);
        }
    }
}

#[test]
fn an_image_in_tiles_may_be_larger_than_the_memory() {
    for (file, side) in [("flat.png", 2048), ("flat.jpg", 4096)] {
        let (_folder, path) = saved(file, &DynamicImage::new_rgb8(side, side));
        let size = super::size(&path, 0).unwrap().1;
        assert!(2 * size.decoding < 6 * u64::from(side * side) + 4096, "{size:?}");
        // Without a disk for temporary files, the image must fit.
        if let Ok(decoded) = read_tiles(&path, size.decoding) {
            assert!(decoded.image.tiles().is_some());
            assert_eq!(decoded.image.bytes(), size.stored);
        }
        assert_eq!(read_tiles(&path, size.decoding - 1).unwrap_err().kind, ErrorKind::Limit);
    }
}

/// The metadata of a file does not count against the memory of its pixels.
#[test]
fn metadata_needs_no_room_among_the_pixels() {
    let (_folder, path) = file("text.png", b"");
    let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 64, 64);
    encoder.set_color(png::ColorType::Rgb);
    encoder.add_itxt_chunk("XML:com.adobe.xmp".into(), "x".repeat(1 << 18)).unwrap();
    encoder.write_header().unwrap().write_image_data(&[7; 3 * 64 * 64]).unwrap();
    let needed = [u64::MAX, 0].map(|whole| super::size(&path, whole).unwrap().1.decoding);
    assert!(needed.iter().all(|bytes| *bytes < 1 << 18), "{needed:?}");
    assert!(read(&path, None, needed[0]).is_ok());
    assert!(read(&path, None, needed[0] - 1).is_err());
    assert!(read_tiles(&path, needed[0].max(needed[1])).is_ok());
}
