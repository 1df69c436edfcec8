//! Fingerprint of a frame in one line. Two frames with the same fingerprint are the same picture.
//! With Embree, last bits may still depend on its version and on the processor.
//!
//! The form is `picture=HASH scene=HASH settings=... program=VERSION`. The first hash covers the
//! scene and the contents of its files. The second covers only the scene, so that a message can
//! name what differs. Paths of files do not count.

use crate::integrate::Relative;
use crate::output::exr::Sequence;
use crate::output::tonemap::Depth;
use crate::picture::Storage;
use crate::render::sampling::Sampling;
use crate::scene::{Backend, EmbreeMode, Loaded};

use super::job::Job;

/// Hexadecimal digits kept of a hash: 128 bits.
const DIGITS: usize = 32;

/// The setting of frames that were checked for NaN.
const STRICT: &str = ",strict";

/// Settings outside the scene that change the files of a picture.
#[derive(Debug, Clone, Copy)]
pub struct Settings {
    /// True if triangles with invalid vertices are dropped.
    pub repair: bool,
    /// Format of the pictures.
    pub storage: Storage,
    /// True if a frame with a NaN or infinite pixel is not written. So a run with `--strict` keeps
    /// no frame that was never checked.
    pub strict: bool,
    /// Adaptive sampling.
    pub sampling: Sampling,
    /// Pixels on every side of the camera's frame.
    pub overscan: u32,
    /// Frame number and frame rate in the header.
    pub sequence: Sequence,
}

impl Settings {
    /// Returns the settings of a job, with the sequence of its first frame.
    pub fn of(job: &Job) -> Self {
        let Job { repair, storage, strict, sampling, overscan, .. } = *job;
        Self { repair, storage, strict, sampling, overscan, sequence: job.sequence(0) }
    }
}

/// Returns the fingerprint of a frame. `hash` is its [`crate::world::fingerprint`].
pub fn fingerprint(loaded: &Loaded, settings: &Settings, hash: &str) -> String {
    let Settings { repair, storage, strict, sampling, overscan, sequence } = *settings;
    let (picture, scene) = (hash.get(..DIGITS).unwrap_or(hash), scene(loaded));
    let stored = if storage.float { "float" } else { "half" };
    let repair = if repair { ",repair" } else { "" };
    let parts = if storage.multipart { ",multipart" } else { "" };
    let sidecar = if storage.crypto_sidecar { ",sidecar" } else { "" };
    let deep = if storage.depth == Depth::Sixteen { ",png16" } else { "" };
    let strict = if strict { STRICT } else { "" };
    let around = match overscan {
        0 => String::new(),
        pixels => format!(",overscan{pixels}"),
    };
    let number = sequence.frame.map_or(String::new(), |frame| format!(",number{frame}"));
    let rate = sequence.per_second.map(|(above, below)| format!(",{above}/{below}"));
    let rate = rate.unwrap_or_default();
    let compression = storage.compression.name();
    let fast = if loaded.scene.backend == Backend::Embree(EmbreeMode::Fast) { ",fast" } else { "" };
    let stored = format!("{compression},{stored}{fast}{repair}{parts}{sidecar}{deep}{strict}");
    let set = format!("{stored}{}{around}{number}{rate}", adaptive(&sampling));
    let program = env!("CARGO_PKG_VERSION");
    format!("picture={picture} scene={scene} settings={set} program={program}")
}

/// Returns the settings of adaptive sampling, each after a comma. Its defaults depend only on the
/// scene and on the program.
fn adaptive(sampling: &Sampling) -> String {
    let Sampling { noise, noise_of, max_spp, .. } = sampling;
    let noise = noise.map_or(String::new(), |noise| format!(",noise{noise}"));
    let of = if *noise_of == Some(Relative::Picture) { ",picture" } else { "" };
    let most = max_spp.map_or(String::new(), |most| format!(",most{most}"));
    format!("{noise}{of}{most}")
}

/// Returns true if a frame with the fingerprint `there` is what a run with `now` would make. A
/// frame that `--strict` has checked is also one without it.
pub fn serves(there: &str, now: &str) -> bool {
    there == now || there.replacen(STRICT, "", 1) == now
}

/// Describes in words how two fingerprints differ.
pub fn difference(there: &str, now: &str) -> String {
    let changed = |key: &str| part(there, key) != part(now, key);
    let scene = changed("scene");
    let reasons = [
        (scene, "the scene changed"),
        (!scene && changed("picture"), "a mesh or a texture changed"),
        (changed("settings"), "settings changed"),
        (changed("program"), "another version of the program wrote it"),
    ];
    let reasons = reasons.into_iter().filter(|(changed, _)| *changed).map(|(_, reason)| reason);
    let reasons: Vec<&str> = reasons.collect();
    match reasons.is_empty() {
        true => "its fingerprint has an unknown form".to_string(),
        false => reasons.join(", "),
    }
}

fn part<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let mut words = text.split(' ').filter_map(|word| word.split_once('='));
    words.find(|(k, _)| *k == key).map(|(_, value)| value)
}

/// Returns a hash of the scene with all file names left out.
fn scene(loaded: &Loaded) -> String {
    let mut all = loaded.description.clone();
    all.paths_mut().into_iter().for_each(|path| path.0 = "-".to_string());
    let mut text = all.hash();
    text.truncate(DIGITS);
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_is_named() {
        let now = "picture=1 scene=2 settings=zip,half program=0.1.0";
        let named = |from: &str, to: &str| difference(&now.replace(from, to), now);
        assert_eq!(named("picture=1", "picture=9"), "a mesh or a texture changed");
        assert_eq!(named("picture=1 scene=2", "picture=9 scene=8"), "the scene changed");
        assert_eq!(named("half", "float"), "settings changed");
        assert_eq!(named("0.1.0", "0.0.9"), "another version of the program wrote it");
        assert_eq!(difference("something else", now).matches(',').count(), 2);
        assert_eq!(difference(now, now), "its fingerprint has an unknown form");
    }
}
