//! Times writing a film to an EXR.
//!
//! `exr_write IN.exr OUT.exr THREADS REPEATS` reads the channels of a file, writes them again with
//! ZIP, and prints the seconds of every run. `benches/exr_write.py` compares it with OpenEXR's own
//! library.

use std::{fs::File, path::Path, time::Instant};

use ::exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
use lightpath::{
    film::{Channel, ChannelKind, Film, Window},
    output::exr,
};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let [input, output, threads, repeats] = arguments.as_slice() else {
        println!("exr_write IN.exr OUT.exr THREADS REPEATS; run by benches/exr_write.py");
        return;
    };
    let film = film(Path::new(input));
    let threads = threads.parse().expect("a number of threads");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    for _ in 0..repeats.parse().expect("a number of repeats") {
        let path = Path::new(output);
        let began = Instant::now();
        let mut file =
            File::options().read(true).write(true).create(true).truncate(true).open(path);
        let file = file.as_mut().expect("a file to write");
        pool.install(|| exr::write(&film, &exr::Options::default(), file, path)).expect("writing");
        println!("{:.4}", began.elapsed().as_secs_f64());
    }
}

/// Reads the channels of a file that lightpath wrote.
fn film(path: &Path) -> Film {
    let reader = read().no_deep_data().largest_resolution_level().all_channels();
    let image = reader.first_valid_layer().all_attributes().from_file(path).expect("an EXR");
    let layer = image.layer_data;
    let [width, height] = [layer.size.width() as u32, layer.size.height() as u32];
    let mut film = Film::new([width, height], Window::full(width, height)).expect("memory");
    let is_beauty = |name: &str| ["R", "G", "B", "A"].iter().position(|axis| *axis == name);
    for channel in &layer.channel_data.list {
        let name = channel.name.to_string();
        let words: Vec<u32> = match &channel.sample_data {
            FlatSamples::F16(halves) => halves.iter().map(|h| h.to_f32().to_bits()).collect(),
            FlatSamples::F32(floats) => floats.iter().map(|f| f.to_bits()).collect(),
            FlatSamples::U32(words) => words.clone(),
        };
        if let Some(axis) = is_beauty(&name) {
            for (pixel, word) in film.pixels.iter_mut().zip(words) {
                pixel[axis] = f32::from_bits(word);
            }
            continue;
        }
        let kind = match &channel.sample_data {
            FlatSamples::F16(_) => ChannelKind::Half,
            FlatSamples::F32(_) => ChannelKind::Float,
            FlatSamples::U32(_) => ChannelKind::Uint,
        };
        film.planes.channels.push(Channel { name, kind });
        film.planes.words.extend(words);
    }
    // Transposes from channel by channel to pixel by pixel.
    let (count, pixels) = (film.planes.channels.len(), film.pixels.len());
    let planes = std::mem::take(&mut film.planes.words);
    let pixel = |i: usize| (0..count).map(move |channel| channel * pixels + i);
    film.planes.words = (0..pixels).flat_map(pixel).map(|i| planes[i]).collect();
    film
}
