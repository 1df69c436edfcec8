//! Checks existing pictures: whether they are complete, and which fingerprint they hold.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use ::exr::meta::attribute::AttributeValue;
use ::exr::meta::header::Header;

use super::exr_check;

/// Name of the EXR attribute and of the PNG text with the fingerprint: a line of hashes that
/// identifies the inputs of the render.
pub const FINGERPRINT: &str = "lightpath:fingerprint";

/// The state of an output file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FileState {
    /// There is no file.
    Missing,
    /// The file is truncated, has another format, is no regular file, or cannot be read.
    Broken,
    /// The file is complete. It holds the fingerprint, or `None` if the file has none.
    Whole(Option<String>),
}

/// Checks an EXR file. It is complete if its table of blocks is, and if the block with the highest
/// offset ends where the file ends. Blocks are not decoded.
pub fn exr(path: &Path) -> FileState {
    inspect(path, |file| {
        let meta = exr_check::meta(file, false).ok()?;
        let header = meta.headers.first()?;
        let length = file.metadata().ok()?.len();
        let table = exr_check::table(file, length, &meta.headers).ok()??;
        let last = table.offsets.iter().max()?;
        // A block begins with its part number (if there are several parts), its first line and its
        // size.
        let size_at = last.checked_add(if table.several { 8 } else { 4 })?;
        file.seek(SeekFrom::Start(size_at)).ok()?;
        let mut size = [0; 4];
        file.read_exact(&mut size).ok()?;
        let whole = size_at.checked_add(4 + u64::from(u32::from_le_bytes(size)))? == length;
        whole.then_some(exr_fingerprint(header))
    })
}

fn exr_fingerprint(header: &Header) -> Option<String> {
    let mut others = header.own_attributes.other.iter().chain(&header.shared_attributes.other);
    others.find_map(|(name, value)| match value {
        AttributeValue::Text(text) if *name == *FINGERPRINT => Some(text.to_string()),
        _ => None,
    })
}

/// Checks a PNG file. It is complete if it ends with the chunk `IEND`. Pixels are not decoded.
pub fn png(path: &Path) -> FileState {
    /// Length, name and checksum of the last chunk of a PNG.
    const END: [u8; 12] = [0, 0, 0, 0, b'I', b'E', b'N', b'D', 0xae, 0x42, 0x60, 0x82];
    inspect(path, |file| {
        let fingerprint = png_fingerprint(file)?;
        let mut end = [0; END.len()];
        file.seek(SeekFrom::End(-(END.len() as i64))).ok()?;
        file.read_exact(&mut end).ok()?;
        (end == END).then_some(fingerprint)
    })
}

/// Returns the fingerprint of a PNG. The outer `None` is a file that is no PNG.
fn png_fingerprint(file: &mut File) -> Option<Option<String>> {
    let reader = ::png::Decoder::new(BufReader::new(file)).read_info().ok()?;
    let mut texts = reader.info().uncompressed_latin1_text.iter();
    Some(texts.find(|text| text.keyword == FINGERPRINT).map(|text| text.text.clone()))
}

/// Returns true if a file is there that no batch has written: neither a PNG nor an EXR with a
/// fingerprint in its header. A frame that is cut short still has one. An empty file does not
/// count: nothing is lost with it.
pub fn is_foreign(path: &Path) -> bool {
    if !std::fs::metadata(path).is_ok_and(|data| data.is_file() && data.len() > 0) {
        return false;
    }
    let Ok(mut file) = File::open(path) else { return true };
    if let Some(Some(_)) = png_fingerprint(&mut file) {
        return false;
    }
    let exr = || {
        let meta = exr_check::meta(&file, false).ok()?;
        exr_fingerprint(meta.headers.first()?)
    };
    exr().is_none()
}

fn inspect(path: &Path, read: impl FnOnce(&mut File) -> Option<Option<String>>) -> FileState {
    // Opening a pipe would wait for its writer.
    if std::fs::metadata(path).is_ok_and(|data| !data.is_file()) {
        return FileState::Broken;
    }
    match File::open(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => FileState::Missing,
        Err(_) => FileState::Broken,
        Ok(mut file) => read(&mut file).map_or(FileState::Broken, FileState::Whole),
    }
}
