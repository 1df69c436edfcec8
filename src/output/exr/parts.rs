//! Decides which channels a file has, and in which parts.

use crate::film::{ChannelKind, Film};

use super::options::Options;

/// Name of the part with the beauty (R, G, B, A). With a single part, it holds all channels.
pub const FIRST: &str = "rgba";

/// A channel of the file and the source of its values.
#[derive(Debug)]
pub struct ValueSource<'a> {
    /// Name of the channel in the file.
    pub name: &'a str,
    /// Type of the channel in the file.
    pub kind: ChannelKind,
    /// Largest absolute value in the file.
    pub largest: f32,
    /// Where its values are in the film.
    pub from: ChannelSource,
}

/// The location of a channel's values in a film.
#[derive(Debug, Clone, Copy)]
pub enum ChannelSource {
    /// Index into R, G, B, A.
    Beauty(usize),
    /// Index into the words of a pixel in [`crate::film::Planes`].
    Words(usize),
}

/// A part of a file. Its name is written only with [`Options::multipart`].
#[derive(Debug)]
pub struct ExrPart<'a> {
    /// [`FIRST`], or the name of the layer.
    pub name: &'a str,
    /// Its channels in file order: sorted by name.
    pub sources: Vec<ValueSource<'a>>,
}

/// Returns the parts of a film's file: one with all channels, or one per layer with the beauty
/// first.
pub fn parts<'a>(film: &'a Film, options: &Options) -> Vec<ExrPart<'a>> {
    let kind = |kind| match kind {
        ChannelKind::Half if options.float => ChannelKind::Float,
        kind => kind,
    };
    let beauty = ["R", "G", "B", "A"].into_iter().enumerate().map(|(i, name)| ValueSource {
        name,
        kind: kind(ChannelKind::Half),
        largest: options.largest(name, ChannelKind::Half),
        from: ChannelSource::Beauty(i),
    });
    let mut parts = vec![ExrPart { name: FIRST, sources: beauty.collect() }];
    for (i, channel) in film.planes.channels.iter().enumerate() {
        let name = channel.name.as_str();
        let source = ValueSource {
            name,
            kind: kind(channel.kind),
            largest: options.largest(name, channel.kind),
            from: ChannelSource::Words(i),
        };
        let layer = if options.multipart { layer_of(name) } else { FIRST };
        match parts.iter_mut().find(|part| part.name == layer) {
            Some(part) => part.sources.push(source),
            None => parts.push(ExrPart { name: layer, sources: vec![source] }),
        }
    }
    for part in &mut parts {
        part.sources.sort_by_key(|source| source.name);
    }
    parts
}

/// Returns the layer of a channel: the name before the last `.`. A channel without a layer is its
/// own layer. All ranks of a cryptomatte (`CryptoObject00.R`, `CryptoObject01.R`) are in one layer.
pub fn layer_of(channel: &str) -> &str {
    match channel.rsplit_once('.') {
        Some((layer, _)) if layer.starts_with("Crypto") => {
            layer.trim_end_matches(|c: char| c.is_ascii_digit())
        }
        Some((layer, _)) => layer,
        None => channel,
    }
}
