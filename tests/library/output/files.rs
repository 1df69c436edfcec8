//! Written files can be read by the crates' own readers, are the same every time, and are complete
//! or absent.

use clap::ValueEnum;
use std::{fs, io::Cursor, path::Path};

use lightpath::{
    error::ErrorKind,
    film::{Channel, ChannelKind, Dropped, Film, ReservedFilm, Window},
    monitor::Monitor,
    output::{
        Outputs, ValueCounts, ValueLocation, WriteOptions, atomic::PartFile, exr, exr_read, png,
        tonemap::Depth,
    },
    scene::{ToneOperator, Tonemap},
};

const CLAMP: Tonemap = Tonemap { operator: ToneOperator::Clamp, exposure: 0.0, srgb: false };

/// A 7 x 5 crop of a 20 x 10 frame with different pixels.
fn film() -> Film {
    let window = Window { x0: 3, y0: 2, x1: 10, y1: 7 };
    let mut film = Film::new([20, 10], window).unwrap();
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        *pixel = [i as f32 / 8.0, 0.25, 1e-3 * i as f32, 1.0];
    }
    film
}

fn attributes() -> Vec<(String, String)> {
    let pairs = ["backend", "scene_hash", "seed", "versions", "a", "b", "c"];
    pairs.map(|name| (format!("lightpath:{name}"), format!("value of {name}"))).to_vec()
}

fn exr_bytes(film: &Film) -> Vec<u8> {
    let attributes = attributes();
    exr_bytes_with(film, &exr::Options { attributes: &attributes, ..Default::default() })
}

fn exr_bytes_with(film: &Film, options: &exr::Options) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    exr::write(film, options, &mut file, Path::new("x.exr")).unwrap();
    file.into_inner()
}

type Pixels = Vec<Vec<[f32; 4]>>;

fn read_exr(bytes: &[u8]) -> ::exr::image::RgbaImage<Pixels> {
    use ::exr::prelude::*;
    read()
        .no_deep_data()
        .largest_resolution_level()
        .rgba_channels(
            |size, _| vec![vec![[0.0; 4]; size.width()]; size.height()],
            |pixels: &mut Pixels, at, (r, g, b, a): (f32, f32, f32, f32)| {
                pixels[at.y()][at.x()] = [r, g, b, a];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(Cursor::new(bytes))
        .unwrap()
}

#[test]
fn exr_round_trip() {
    let film = film();
    let image = read_exr(&exr_bytes(&film));
    let layer = &image.layer_data;
    assert_eq!(image.attributes.display_window.size, (20, 10).into());
    assert_eq!(image.attributes.display_window.position, (0, 0).into());
    assert_eq!(layer.attributes.layer_position, (3, 2).into());
    assert_eq!(layer.size, (7, 5).into());
    assert!(image.attributes.chromaticities.is_some());
    let software = layer.attributes.software_name.as_ref().unwrap();
    assert!(software.to_string().starts_with("lightpath "));
    for (y, row) in layer.channel_data.pixels.iter().enumerate() {
        for (x, read) in row.iter().enumerate() {
            let wrote = film.pixels[y * 7 + x];
            for (read, wrote) in read.iter().zip(wrote) {
                assert_eq!(*read, half::f16::from_f32(wrote).to_f32());
            }
        }
    }
}

#[test]
fn exr_header_is_as_documented_and_sorted() {
    let bytes = exr_bytes(&film());
    let meta = ::exr::meta::MetaData::read_from_buffered(Cursor::new(&bytes), true).unwrap();
    let [header] = meta.headers.as_slice() else { panic!("expected one part") };
    let channels: Vec<String> = header.channels.list.iter().map(|c| c.name.to_string()).collect();
    assert_eq!(channels, ["A", "B", "G", "R"]);
    use ::exr::prelude::SampleType::F16;
    assert!(header.channels.list.iter().all(|c| c.sample_type == F16));
    assert_eq!(header.compression, ::exr::prelude::Compression::ZIP16);
    assert_eq!(header.line_order, ::exr::prelude::LineOrder::Increasing);
    assert_eq!(header.own_attributes.other.len(), 7);

    let names = attribute_names(&bytes);
    let mut sorted = names.clone();
    sorted.sort();
    assert_eq!(names, sorted);
    assert!(names.contains(&"lightpath:seed".to_string()));
}

fn attribute_names(bytes: &[u8]) -> Vec<String> {
    let mut names = Vec::new();
    let mut at = 8;
    let text = |at: &mut usize| {
        let end = *at + bytes[*at..].iter().position(|b| *b == 0).unwrap();
        let text = String::from_utf8(bytes[*at..end].to_vec()).unwrap();
        *at = end + 1;
        text
    };
    loop {
        let name = text(&mut at);
        if name.is_empty() {
            return names;
        }
        text(&mut at);
        let size = i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        at += 4 + size as usize;
        names.push(name);
    }
}

#[test]
fn exr_bytes_are_the_same_every_time() {
    let film = film();
    let first = exr_bytes(&film);
    for _ in 0..20 {
        assert_eq!(first, exr_bytes(&film));
    }
}

#[test]
fn values_beyond_half_floats_are_clamped_and_counted() {
    let mut film = film();
    film.pixels[8] = [1e6, 0.0, -1e6, 1.0];
    film.pixels[9] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.0];
    film.pixels[11] = [65510.0, 0.0, f32::NAN, 1.0];
    let image = read_exr(&exr_bytes(&film));
    let row = &image.layer_data.channel_data.pixels[1];
    assert_eq!(row[1], [65504.0, 0.0, -65504.0, 1.0]);
    assert_eq!(row[2], [0.0, 65504.0, -65504.0, 1.0]);
    assert_eq!(row[4], [65504.0, 0.0, 0.0, 1.0]);
    let spot = |pixel, channel: &str| Some(ValueLocation { pixel, channel: channel.to_string() });
    let expected = ValueCounts {
        dropped: Dropped::default(),
        legend_left_out: false,
        non_finite: 2,
        first_non_finite: spot([5, 3], "R"),
        // Pixel 11 has both kinds.
        clamped: 2,
        first_clamped: spot([4, 3], "R"),
        clamped_to: 65504.0,
    };
    let count = |film: &Film, options: &exr::Options| {
        ValueCounts::count(film, |name, kind| options.largest(name, kind))
    };
    let halves = exr::Options::default();
    assert_eq!(count(&film, &halves), expected);
    let floats = exr::Options { float: true, ..halves };
    let as_float =
        ValueCounts { clamped: 0, first_clamped: None, clamped_to: 0.0, ..expected.clone() };
    assert_eq!(count(&film, &floats), as_float);
    let row = &read_exr(&exr_bytes_with(&film, &floats)).layer_data.channel_data.pixels[1];
    assert_eq!(row[1], [1e6, 0.0, -1e6, 1.0]);
    assert_eq!(row[2], [0.0, f32::MAX, f32::MIN, 1.0]);
    // This compression makes halves of R, G, B and Y.
    let lossy = exr::Options { compression: exr::Compression::Dwaa, ..floats };
    assert_eq!(count(&film, &lossy), ValueCounts { clamped_to: 50_000.0, ..expected });
    film.pixels.fill([65504.0, 0.0, 1.0, 1.0]);
    assert_eq!(count(&film, &halves), ValueCounts::default());
    film.pixels.fill([50_000.0, 0.0, 1.0, 1e6]);
    assert_eq!(count(&film, &lossy), ValueCounts::default());
}

#[test]
fn lossy_channels_stay_finite_at_their_limit() {
    let mut film = Film::new([64, 64], Window::full(64, 64)).unwrap();
    let mut random = 1_u32;
    for color in film.pixels.iter_mut().flatten() {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *color = [0.0, 1e6, 1e6, -1e6][(random >> 30) as usize];
    }
    for float in [false, true] {
        let compression = exr::Compression::Dwaa;
        let options = exr::Options { float, compression, ..Default::default() };
        let image = read_exr(&exr_bytes_with(&film, &options));
        let mut pixels = image.layer_data.channel_data.pixels.iter().flatten().zip(&film.pixels);
        let near = |read: f32, wrote: f32| match wrote {
            0.0 => read.abs() < 1.0,
            _ => (40_000.0..=65_504.0).contains(&(read * wrote.signum())),
        };
        // A is not lossy.
        assert!(pixels.all(|(read, wrote)| (0..3).all(|axis| near(read[axis], wrote[axis]))));
    }
}

fn read_png(bytes: &[u8]) -> (::png::Info<'static>, Vec<u8>) {
    let mut reader = ::png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    (reader.info().clone(), pixels)
}

fn options(tonemap: &Tonemap, transparent: bool, depth: Depth) -> WriteOptions<'_> {
    let (over, legend, fingerprint, exr) = (None, None, None, Default::default());
    WriteOptions { tonemap, transparent, over, depth, legend, fingerprint, exr }
}

fn png_bytes(film: &Film, tonemap: &Tonemap, transparent: bool) -> Vec<u8> {
    let mut file = Vec::new();
    let options = options(tonemap, transparent, Depth::Eight);
    png::write(film, &options, &mut file, Path::new("x.png")).unwrap();
    file
}

#[test]
fn png_round_trip_linear_says_gamma_one() {
    let mut film = film();
    film.pixels[1] = [0.0, 0.5, 2.0, 1.0];
    let (info, pixels) = read_png(&png_bytes(&film, &CLAMP, false));
    assert_eq!((info.width, info.height), (7, 5));
    assert_eq!(info.color_type, ::png::ColorType::Rgb);
    assert_eq!(info.srgb, None);
    assert_eq!(info.gama_chunk.map(|g| g.into_scaled()), Some(100_000));
    assert_eq!(pixels[3..6], [0, 128, 255]);
}

#[test]
fn png_srgb_has_the_chunk() {
    let srgb = Tonemap { srgb: true, ..CLAMP };
    let mut film = film();
    film.pixels[0] = [0.5, 0.0, 1.0, 1.0];
    let (info, pixels) = read_png(&png_bytes(&film, &srgb, false));
    assert!(info.srgb.is_some());
    assert_eq!(pixels[..3], [188, 0, 255]);
}

#[test]
fn transparent_png_has_straight_alpha() {
    let mut film = film();
    film.pixels[0] = [0.25, 0.1, 0.0, 0.5];
    film.pixels[1] = [0.0, 0.0, 0.0, 0.0];
    let (info, pixels) = read_png(&png_bytes(&film, &CLAMP, true));
    assert_eq!(info.color_type, ::png::ColorType::Rgba);
    assert_eq!(pixels[..8], [128, 51, 0, 128, 0, 0, 0, 0]);
}

#[test]
fn sixteen_bits_hold_more_and_mean_the_same() {
    let mut film = film();
    film.pixels[0] = [0.25, 0.1, 0.0, 0.5];
    film.pixels[1] = [0.5, 2.0, f32::NAN, 1.0];
    for srgb in [false, true] {
        let tonemap = Tonemap { srgb, ..CLAMP };
        let mut file = Vec::new();
        let options = options(&tonemap, true, Depth::Sixteen);
        png::write(&film, &options, &mut file, Path::new("x.png")).unwrap();
        let (info, wide) = read_png(&file);
        assert_eq!(
            (info.bit_depth, info.color_type),
            (::png::BitDepth::Sixteen, ::png::ColorType::Rgba)
        );
        let wide: Vec<u16> = wide.chunks(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
        if !srgb {
            assert_eq!(wide[..8], [32768, 13107, 0, 32768, 32768, 65535, 0, 65535]);
        }
        let (_, narrow) = read_png(&png_bytes(&film, &tonemap, true));
        for (wide, narrow) in wide.iter().zip(narrow) {
            let off = f64::from(*wide) / 65535.0 - f64::from(narrow) / 255.0;
            assert!(off.abs() <= 0.5 / 255.0 + 0.5 / 65535.0, "{wide} {narrow}");
        }
    }
}

/// Layers of every kind and 33 rows: three blocks of ZIP, the last one short.
fn layered() -> Film {
    let channels =
        [("N.X", ChannelKind::Half), ("Z", ChannelKind::Float), ("id.id", ChannelKind::Uint)];
    let channels = channels.map(|(name, kind)| Channel { name: name.to_string(), kind });
    let window = Window { x0: 1, y0: 2, x1: 12, y1: 35 };
    let mut film = ReservedFilm::new([20, 40], window, channels.to_vec()).unwrap().film();
    for (i, pixel) in film.pixels.iter_mut().enumerate() {
        *pixel = [i as f32 / 7.0, (i as f32).sin(), 1e-3, 1.0];
    }
    for (i, words) in film.planes.words.chunks_mut(3).enumerate() {
        words.copy_from_slice(&[
            (i as f32).cos().to_bits(),
            (i as f32 * 1e6).to_bits(),
            !(i as u32),
        ]);
    }
    film
}

#[test]
fn every_compression_and_part_holds_the_same_values() {
    let film = layered();
    for (compression, multipart) in
        exr::Compression::value_variants().iter().flat_map(|c| [(*c, false), (*c, true)])
    {
        if compression == exr::Compression::Dwaa {
            continue; // is lossy
        }
        let write = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut file = Cursor::new(Vec::new());
            let attributes = attributes();
            let options = exr::Options {
                attributes: &attributes,
                compression,
                multipart,
                ..Default::default()
            };
            pool.install(|| exr::write(&film, &options, &mut file, Path::new("x.exr"))).unwrap();
            file.into_inner()
        };
        let bytes = write(1);
        assert_eq!(bytes, write(3), "{compression:?}");
        use ::exr::prelude::{FlatSamples, ReadChannels, ReadLayers};
        let reader = ::exr::prelude::read().no_deep_data().largest_resolution_level();
        let reader = reader.all_channels().all_layers().all_attributes();
        let image = reader.from_buffered(Cursor::new(&bytes)).unwrap();
        assert_eq!(image.layer_data.len(), if multipart { 4 } else { 1 });
        let channels = image.layer_data.iter().flat_map(|layer| &layer.channel_data.list);
        for channel in channels {
            let index = film.planes.index(&channel.name.to_string());
            let axis = ["R", "G", "B", "A"].iter().position(|axis| channel.name.eq(axis));
            let value = |i: usize| match (index, axis) {
                (Some(index), _) => film.planes.float(index, i),
                (None, axis) => film.pixels[i][axis.unwrap()],
            };
            match &channel.sample_data {
                FlatSamples::F16(found) => {
                    assert!((0..11 * 33).all(|i| found[i] == half::f16::from_f32(value(i))));
                }
                FlatSamples::F32(found) => assert!((0..11 * 33).all(|i| found[i] == value(i))),
                FlatSamples::U32(found) => assert!((0..11 * 33).all(|i| found[i] == !(i as u32))),
            }
        }
    }
}

/// OpenEXR sets bit 10 of the version field only if a name has 32 to 255 bytes.
#[test]
fn long_names_of_channels_and_attributes_are_announced() {
    let flag = |channel: usize, attribute: usize, multipart: bool| {
        let channels = [Channel { name: "c".repeat(channel), kind: ChannelKind::Half }];
        let window = Window { x0: 0, y0: 0, x1: 4, y1: 3 };
        let film = ReservedFilm::new([4, 3], window, channels.to_vec()).unwrap().film();
        let attributes = [("a".repeat(attribute), "value".repeat(20))];
        let options = exr::Options { attributes: &attributes, multipart, ..Default::default() };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.exr");
        let mut file = Cursor::new(Vec::new());
        exr::write(&film, &options, &mut file, &path).unwrap();
        fs::write(&path, file.get_ref()).unwrap();
        if !multipart {
            let reader = exr_read::ExrReader::open(&path).unwrap();
            assert!(reader.channels.iter().any(|found| *found == channels[0]));
            assert_eq!(reader.attribute(&attributes[0].0), Some(attributes[0].1.as_str()));
            // Rows outside of the data window are left out.
            for rows in [0..0, 1..9, 3..4, 7..9] {
                assert!(reader.rows(rows).is_ok());
            }
        }
        u32::from_le_bytes(file.get_ref()[4..8].try_into().unwrap()) & 0x400 != 0
    };
    for multipart in [false, true] {
        assert!(!flag(31, 31, multipart));
        assert!(flag(32, 31, multipart));
        assert!(flag(31, 32, multipart));
        assert!(flag(255, 255, multipart));
    }
}

#[test]
fn both_files_appear_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path().join("frame.0001");
    let outputs = Outputs::create(&prefix).unwrap();
    assert_eq!(names_in(folder.path()).len(), 2);
    assert!(names_in(folder.path()).iter().all(|n| n.ends_with(".part")));
    let attributes = attributes();
    let exr = exr::Options { attributes: &attributes, ..Default::default() };
    let options = WriteOptions { exr, ..options(&CLAMP, false, Depth::Eight) };
    let (paths, odd) = outputs.write(&film(), &options, &Monitor::default()).unwrap();
    assert_eq!(odd, ValueCounts::default());
    assert_eq!(names_in(folder.path()), ["frame.0001.exr", "frame.0001.png"]);
    assert_eq!(fs::read(&paths[0].0).unwrap(), exr_bytes(&film()));
    assert_eq!(fs::read(&paths[1].0).unwrap(), png_bytes(&film(), &CLAMP, false));
}

#[test]
fn a_signal_before_the_renames_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let prefix = folder.path().join("x");
    let monitor = Monitor::default();
    monitor.signal.store(15, std::sync::atomic::Ordering::Relaxed);
    let options = options(&CLAMP, false, Depth::Eight);
    let outputs = Outputs::create(&prefix).unwrap();
    let error = outputs.write(&film(), &options, &monitor).unwrap_err();
    assert_eq!(error.exit_code(), 143);
    assert!(names_in(folder.path()).is_empty());
}

fn names_in(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn an_old_file_stays_until_the_new_one_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.json");
    fs::write(&target, "old").unwrap();
    let dropped = PartFile::create(&target).unwrap();
    drop(dropped);
    assert_eq!(fs::read_to_string(&target).unwrap(), "old");
    assert_eq!(names_in(folder.path()), ["a.json"]);
    PartFile::create(&target).unwrap().finish("new").unwrap();
    assert_eq!(fs::read_to_string(&target).unwrap(), "new");
}

#[cfg(unix)]
#[test]
fn permissions_are_what_umask_gives() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let [plain, ours] = ["plain", "ours"].map(|name| folder.path().join(name));
    fs::write(&plain, "").unwrap();
    PartFile::create(&ours).unwrap().finish("").unwrap();
    let mode = |path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&ours), mode(&plain));
}

#[test]
fn bad_targets_are_named_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let cases = [
        (folder.path().join("missing/x.exr"), "no such folder"),
        (file.join("x.exr"), "expected a folder"),
        (folder.path().to_owned(), "it is a folder"),
    ];
    for (target, expected) in cases {
        let error = PartFile::create(&target).unwrap_err();
        assert_eq!(error.kind, ErrorKind::Invalid, "{error}");
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn special_files() {
    let error = PartFile::create(Path::new("/proc/x.exr")).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
    let error = PartFile::create(Path::new("/dev/null")).unwrap_err();
    assert_eq!(error.exit_code(), 2, "{error}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_device_is_no_prefix() {
    let error = Outputs::create(Path::new("/dev/null")).unwrap_err();
    assert_eq!(error.exit_code(), 2);
    assert!(error.to_string().contains("/dev/null: is a device or a pipe"), "{error}");
}
