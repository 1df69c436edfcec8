//! EXR files of other programs: every reader accepts what the format allows, or names what it
//! cannot read.

use crate::support::program::{self, Scratch};
use exr::prelude::*;

const SCENE: &str = r#"{ "camera": { "type": "pinhole", "width": 12, "height": 8, "fov": 40,
    "position": [0, 0, 3], "target": [0, 0, 0], "up": [0, 1, 0] },
    "scene": { "ambient": [1, 1, 1], "shapes": [{ "type": "plane",
        "v0": [-2, 2, 0], "v1": [2, 2, 0], "v2": [2, -2, 0], "v3": [-2, -2, 0],
        "material": { "ka": 1, "kd": 0, "tPath": "picture.exr", "filter": "nearest" } }] } }"#;

/// Returns a channel of 12 x 8 pixels that no compression makes smaller.
fn noise(channel: usize) -> Vec<f32> {
    let hash = |i: usize| (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(23);
    (0..12 * 8).map(|i| (hash(i * 4 + channel) % 1000) as f32 / 1000.0 + 0.25).collect()
}

fn write(scratch: &Scratch, name: &str, compression: Compression, values: [Vec<f32>; 4]) {
    let named = ["R", "G", "B", "A"].into_iter().zip(values);
    let list = named.map(|(name, v)| AnyChannel::new(name, FlatSamples::F32(v))).collect();
    let encoding = Encoding { compression, ..Encoding::SMALL_LOSSLESS };
    let channels = AnyChannels::sort(list);
    let layer = Layer::new((12, 8), LayerAttributes::default(), encoding, channels);
    Image::from_layer(layer).write().non_parallel().to_file(scratch.path(name)).unwrap();
}

/// Commands that read `picture.exr`.
const READERS: [&[&str]; 4] = [
    &["render", "s.json", "-o", "out"],
    &["compare", "picture.exr", "picture.exr"],
    &["converge", "s.json", "--backend", "bvh", "--spp", "1", "--reference", "picture.exr"],
    &["merge", "picture.exr", "-o", "merged"],
];

/// A block that compression would enlarge is stored uncompressed, whatever compression the header
/// names.
#[test]
fn blocks_that_are_stored_as_they_are() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let values = [0, 1, 2, 3].map(noise);
    for compression in [Compression::DWAA(None), Compression::DWAB(None)] {
        write(&scratch, "picture.exr", compression, values.clone());
        // One uncompressed block: a line, a size, and 4 channels of 4 bytes.
        let raw = 12 * 8 * 16u32;
        let stored = [0u32.to_le_bytes(), raw.to_le_bytes()].concat();
        let file = scratch.read("picture.exr");
        assert!(file.windows(8).any(|eight| eight == stored), "{compression:?}: not stored");
        for arguments in READERS {
            let done = scratch.run(arguments);
            let said = done.stderr();
            // `merge` refuses it, because it is not a part of a picture of this program.
            let read = match arguments[0] {
                "merge" => said.contains("lightpath"),
                _ => done.code() == 0,
            };
            assert!(read, "{compression:?} {arguments:?}: {said}");
        }
        let seen = scratch.channels("out.exr");
        let red = &seen.iter().find(|(name, _)| name == "R").unwrap().1;
        let half = |x: &f32| u32::from(half::f16::from_f32(*x).to_bits());
        let stored: Vec<u32> = values[0].iter().map(half).collect();
        // The plane is 4 x 4, and the frame shows the 3.3 x 2.2 in its middle.
        let texel = |i: usize, size: usize, seen: f64| {
            let at = 0.5 + ((i as f64 + 0.5) / size as f64 - 0.5) * seen / 4.0;
            (at * size as f64) as usize
        };
        let high = 6.0 * 20f64.to_radians().tan();
        for (i, value) in red.iter().enumerate() {
            let (x, y) = (texel(i % 12, 12, high * 1.5), texel(i / 12, 8, high));
            assert_eq!(*value, stored[y * 12 + x], "{compression:?}: pixel {i}");
        }
        std::fs::remove_file(scratch.path("out.exr")).unwrap();
    }
}

/// A damaged header can declare pixels that need far more memory than the file has bytes.
#[test]
fn a_size_that_the_file_cannot_hold_is_refused() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    write(&scratch, "picture.exr", Compression::RLE, [0, 1, 2, 3].map(noise));
    let mut bytes = scratch.read("picture.exr");
    let key = b"dataWindow\0box2i\0\x10\0\0\0";
    let window = bytes.windows(key.len()).position(|window| window == key).unwrap() + key.len();
    bytes[window + 8..window + 12].copy_from_slice(&800_000_000i32.to_le_bytes());
    std::fs::write(scratch.path("picture.exr"), bytes).unwrap();
    for arguments in READERS {
        let done = scratch.run(arguments);
        assert_eq!(done.code(), 2, "{arguments:?}");
        let said = done.stderr();
        let words = "picture.exr: found fewer bytes than its size needs";
        assert!(said.contains(words), "{arguments:?}: {said}");
    }
}

/// A damaged header can declare tiles that need far more memory than the file has bytes.
#[cfg(unix)]
#[test]
fn a_tile_that_the_file_cannot_hold_is_refused() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let size = |bytes: u32| bytes.to_le_bytes();
    for parts in 1..=2 {
        let layer = |part: usize| {
            let values = ["R", "G", "B", "A"].into_iter().zip([0, 1, 2, 3].map(noise));
            let list = values.map(|(name, v)| AnyChannel::new(name, FlatSamples::F32(v))).collect();
            let encoding = Encoding {
                compression: Compression::Uncompressed,
                blocks: Blocks::Tiles(Vec2(12, 8)),
                line_order: LineOrder::Increasing,
            };
            let named = LayerAttributes::named(["one", "two"][part]);
            Layer::new((12, 8), named, encoding, AnyChannels::sort(list))
        };
        let layers = Layers::from_iter((0..parts).map(layer));
        let attributes = ImageAttributes::new(IntegerBounds::from_dimensions((12, 8)));
        let path = scratch.path("picture.exr");
        let image = Image::from_layers(attributes, layers);
        image.write().non_parallel().to_file(&path).unwrap();
        let whole = scratch.read("picture.exr");
        let done = scratch.run(&["info", "picture.exr"]);
        assert_eq!(done.code(), 0, "{}", done.stderr());
        let patched = |mut bytes: Vec<u8>, key: &[u8], at: usize, new: u32| {
            let starts = bytes.windows(key.len()).rposition(|window| window == key);
            let at = starts.unwrap() + at;
            bytes[at..at + 4].copy_from_slice(&size(new));
            bytes
        };
        // 12 x 2^25 pixels of 16 bytes, and a tile that is stored in 1 GiB of them.
        let tiles = [&b"tiles\0tiledesc\0\x09\0\0\0"[..], &size(12), &size(8)].concat();
        let tall = patched(whole, &tiles, tiles.len() - 4, 1 << 25);
        // The first coordinates of the tile are 0.
        let stored = [[0; 16].as_slice(), &size(12 * 8 * 16)].concat();
        std::fs::write(&path, patched(tall, &stored, 16, 1 << 30)).unwrap();
        for arguments in READERS.into_iter().chain([&["info", "picture.exr"][..]]) {
            let limited = "ulimit -v 800000; exec \"$0\" \"$@\"";
            let mut command = std::process::Command::new("sh");
            command.args(["-c", limited, env!("CARGO_BIN_EXE_lightpath")]).args(arguments);
            let done = program::Done::of(command.current_dir(scratch.path("")));
            let said = done.stderr();
            assert_eq!(done.code(), 2, "{parts} {arguments:?}: {said}");
            assert!(said.contains("reference to missing bytes"), "{parts} {arguments:?}: {said}");
        }
    }
}

/// So can wide rows: 16 of them are a block, even if there is only one.
#[cfg(unix)]
#[test]
fn a_block_of_rows_that_the_file_cannot_hold_is_refused() {
    let scratch = Scratch::new();
    let size = (1 << 22, 1);
    let values = vec![f16::ONE; size.0];
    let channel = |name: &str| AnyChannel::new(name, FlatSamples::F16(values.clone()));
    let channels = AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect());
    let encoding = Encoding { compression: Compression::ZIP16, ..Encoding::SMALL_LOSSLESS };
    let layer = Layer::new(size, LayerAttributes::default(), encoding, channels);
    let path = scratch.path("picture.exr");
    Image::from_layer(layer).write().non_parallel().to_file(&path).unwrap();
    let mut bytes = scratch.read("picture.exr");
    // The table has one offset, and the chunk after it begins with its row.
    let at = (0..bytes.len()).find(|&at| bytes[at..at + 8] == (at as u64 + 8).to_le_bytes());
    let stated = at.unwrap() + 12;
    let stored = u32::from_le_bytes(bytes[stated..stated + 4].try_into().unwrap());
    assert_eq!(stored as usize, bytes.len() - stated - 4);
    // A block may have 2^22 x 16 pixels of 6 bytes, 384 MiB.
    bytes[stated..stated + 4].copy_from_slice(&(380u32 << 20).to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    for arguments in [READERS[1], READERS[3], &["info", "picture.exr"]] {
        let limited = "ulimit -v 300000; exec \"$0\" \"$@\"";
        let mut command = std::process::Command::new("sh");
        command.args(["-c", limited, env!("CARGO_BIN_EXE_lightpath")]).args(arguments);
        let done = program::Done::of(command.current_dir(scratch.path("")));
        assert_eq!(done.code(), 2, "{arguments:?}: {}", done.stderr());
        assert!(done.stderr().contains("reference to missing bytes"), "{}", done.stderr());
    }
}

#[test]
fn info_reports_a_file_that_is_cut_short() {
    let scratch = Scratch::new();
    write(&scratch, "picture.exr", Compression::ZIP16, [0, 1, 2, 3].map(noise));
    let ok = |whole: bool| {
        let done = scratch.run(&["info", "--json", "picture.exr"]);
        assert_eq!(done.code(), if whole { 0 } else { 2 }, "{}", done.stderr());
        assert!(done.stdout().contains(&format!("\"ok\":{whole}")), "{}", done.stdout());
    };
    ok(true);
    let bytes = scratch.read("picture.exr");
    for length in [bytes.len() - 1, bytes.len() / 2] {
        std::fs::write(scratch.path("picture.exr"), &bytes[..length]).unwrap();
        ok(false);
    }
}

/// The best that each compression can do.
#[test]
fn a_picture_of_one_colour_is_read() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let size = (4096, 512);
    use Compression::{B44A, DWAA, DWAB, PIZ, PXR24, RLE, ZIP1, ZIP16};
    for compression in [RLE, ZIP1, ZIP16, PIZ, PXR24, B44A, DWAA(None), DWAB(None)] {
        let values = FlatSamples::F32(vec![0.5; size.0 * size.1]);
        let channel = |name: &str| AnyChannel::new(name, values.clone());
        let channels = AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect());
        let encoding = Encoding { compression, ..Encoding::SMALL_LOSSLESS };
        let layer = Layer::new(size, LayerAttributes::default(), encoding, channels);
        let path = scratch.path("picture.exr");
        Image::from_layer(layer).write().non_parallel().to_file(&path).unwrap();
        let done = scratch.run(&["render", "s.json", "-o", "out"]);
        assert_eq!(done.code(), 0, "{compression:?}: {}", done.stderr());
        let seen = scratch.rgba("out.exr");
        let shown: Vec<_> = seen.iter().flatten().filter(|pixel| pixel[3] == 1.0).collect();
        assert!(shown.len() > 12 * 8 / 4, "{}", shown.len());
        // DWA changes values; the others keep this one.
        let off = if let DWAA(_) | DWAB(_) = compression { 1e-3 } else { 0.0 };
        let is_read = |pixel: &&[f32; 4]| pixel[..3].iter().all(|x| (x - 0.5).abs() <= off);
        assert!(shown.iter().all(is_read), "{compression:?}: {:?}", shown[0]);
    }
}

/// A newer OpenEXR can write this compression, but this program cannot read it.
#[test]
fn an_unknown_compression_is_named() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    write(&scratch, "picture.exr", Compression::ZIP16, [0.25, 0.5, 0.75, 1.0].map(|v| vec![v; 96]));
    let whole = scratch.read("picture.exr");
    let key = b"compression\0compression\0\x01\0\0\0";
    let at = whole.windows(key.len()).position(|window| window == key).unwrap() + key.len();
    for (number, name) in [(10, "HTJ2K256"), (11, "HTJ2K32"), (13, "ZSTD"), (77, "number 77")] {
        let mut bytes = whole.clone();
        bytes[at] = number;
        std::fs::write(scratch.path("picture.exr"), bytes).unwrap();
        for arguments in READERS {
            let before = scratch.names();
            let done = scratch.run(arguments);
            let said = done.stderr();
            assert_eq!(done.code(), 2, "{arguments:?}: {said}");
            for words in [&format!("the compression {name}")[..], "DWAB", "picture.exr"] {
                assert!(said.contains(words), "{arguments:?}, {words}: {said}");
            }
            assert_eq!(scratch.names(), before, "{arguments:?}");
        }
        // `info` prints as much of the header as it understands.
        let done = scratch.run(&["info", "picture.exr"]);
        let told = done.stdout() + &done.stderr();
        assert!(
            told.to_lowercase().replace(' ', "").contains(&name.to_lowercase().replace(' ', "")),
            "{told}"
        );
    }
}

#[test]
fn negative_texels_are_kept_and_counted() {
    let scratch = Scratch::new();
    scratch.write("s.json", SCENE);
    let mut values = [0, 1, 2, 3].map(noise);
    // Texels (5, 4) and (0, 6), one of them in two channels. Alpha does not count.
    (values[0][53], values[2][53], values[1][72]) = (-0.5, -0.25, -1.0);
    values[3][3] = -1.0;
    write(&scratch, "picture.exr", Compression::ZIP16, values.clone());
    let done = scratch.run(&["render", "s.json", "-o", "out"]);
    assert_eq!(done.code(), 0, "{}", done.stderr());
    let said = done.stderr();
    assert!(said.contains("found 2 negative texels in"), "{said}");
    assert!(said.contains("the first at (5, 4)") && said.contains("kept"), "{said}");
    let seen = scratch.channels("out.exr");
    let red = &seen.iter().find(|(name, _)| name == "R").unwrap().1;
    let negative = u32::from(half::f16::from_f32(-0.5).to_bits());
    assert!(red.contains(&negative), "the value is what the file says");

    write(&scratch, "picture.exr", Compression::ZIP16, [0, 1, 2, 3].map(noise));
    let said = scratch.run(&["render", "s.json", "-o", "out"]).stderr();
    assert!(!said.contains("negative"), "{said}");
}
