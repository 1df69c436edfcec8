//! Which channels a file has, in which parts.

use crate::film::{ChannelKind, Film};

use super::Options;

/// The part of the beauty; of everything, where there is one part.
pub const FIRST: &str = "rgba";

/// A channel of the file and where its values are.
#[derive(Debug)]
pub struct Source<'a> {
    /// As in the file.
    pub name: &'a str,
    /// As in the file.
    pub kind: ChannelKind,
    /// Where its values are.
    pub from: From,
}

/// Where values are in a film.
#[derive(Debug, Clone, Copy)]
pub enum From {
    /// Index into R, G, B, A.
    Beauty(usize),
    /// Index into a pixel's words.
    Words(usize),
}

/// A part of a file, whose name matters where there are several.
#[derive(Debug)]
pub struct Part<'a> {
    /// [`FIRST`], or the layer's name.
    pub name: &'a str,
    /// Its channels in the order of the file: by name.
    pub sources: Vec<Source<'a>>,
}

/// The parts of a film's file: one of all channels, or one for each layer, the beauty first.
pub fn parts<'a>(film: &'a Film, options: &Options) -> Vec<Part<'a>> {
    let kind = |kind| match kind {
        ChannelKind::Half if options.float => ChannelKind::Float,
        kind => kind,
    };
    let beauty = ["R", "G", "B", "A"].into_iter().enumerate().map(|(i, name)| Source {
        name,
        kind: kind(ChannelKind::Half),
        from: From::Beauty(i),
    });
    let mut parts = vec![Part { name: FIRST, sources: beauty.collect() }];
    for (i, channel) in film.planes.channels.iter().enumerate() {
        let name = channel.name.as_str();
        let source = Source { name, kind: kind(channel.kind), from: From::Words(i) };
        let layer = if options.multipart { layer_of(name) } else { FIRST };
        match parts.iter_mut().find(|part| part.name == layer) {
            Some(part) => part.sources.push(source),
            None => parts.push(Part { name: layer, sources: vec![source] }),
        }
    }
    for part in &mut parts {
        part.sources.sort_by_key(|source| source.name);
    }
    parts
}

/// The layer of a channel; one without a layer is a layer of its own. The ranks of a cryptomatte
/// (`CryptoObject00.R`) belong together.
fn layer_of(channel: &str) -> &str {
    match channel.rsplit_once('.') {
        Some((layer, _)) if layer.starts_with("Crypto") => {
            layer.trim_end_matches(|c: char| c.is_ascii_digit())
        }
        Some((layer, _)) => layer,
        None => channel,
    }
}
