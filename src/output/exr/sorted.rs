//! Sorts the attributes in the bytes of an EXR header by name.
//!
//! The `exr` crate writes custom attributes in the order of a hash map, which differs from run to
//! run. OpenEXR's own library sorts them by name, and so does this module. Nothing in the file
//! depends on their order.
//!
//! An attribute is `name NUL type NUL size:i32 data`. The list ends with an empty name.

use std::io::{BufReader, Error, ErrorKind, Read, Result};

/// Size in bytes of the magic number and the version field.
const PREAMBLE_BYTES: usize = 8;

/// Offset in the file of the byte that holds the flags of the version field.
pub const FLAGS: usize = 5;

/// Flag: the file has several headers.
const MULTI_PART: u8 = 0x10;

/// Flag: the name of a channel, an attribute or a type has 32 to 255 bytes (0x400 of the version
/// field).
pub const LONG_NAMES: u8 = 0x04;

/// Maximum length of a name in bytes without [`LONG_NAMES`].
pub const SHORT_NAME_BYTES: usize = 31;

/// Reads all headers, from the first byte of the file. Returns their bytes with the attributes of
/// each header sorted by name. The number of bytes is the same as in the file.
///
/// # Errors
/// `InvalidData` for bytes that are no EXR header, `UnexpectedEof` for a truncated one.
pub fn read_sorted(file: &mut impl Read) -> Result<Vec<u8>> {
    let mut file = BufReader::new(file);
    let mut sorted = vec![0; PREAMBLE_BYTES];
    file.read_exact(&mut sorted)?;
    if sorted[..4] != [0x76, 0x2f, 0x31, 0x01] {
        return Err(broken());
    }
    let multi_part = is_multi_part(&sorted);
    loop {
        let mut attributes = attributes(&mut file)?;
        attributes.sort();
        let none = attributes.is_empty();
        for (name, rest) in attributes {
            sorted.extend([name.as_slice(), &[0], &rest].concat());
        }
        sorted.push(0);
        // A list of several headers ends with an empty one.
        if none || !multi_part {
            return Ok(sorted);
        }
    }
}

/// Returns true if the start of a file says that it has several headers.
pub fn is_multi_part(start: &[u8]) -> bool {
    start[FLAGS] & MULTI_PART != 0
}

/// Reads the attributes of one header. Returns each name, and the bytes after its NUL.
fn attributes(file: &mut impl Read) -> Result<Vec<(Vec<u8>, Vec<u8>)>> {
    let mut attributes = Vec::new();
    loop {
        let name = read_text(file)?;
        if name.is_empty() {
            return Ok(attributes);
        }
        let kind = read_text(file)?;
        let mut size = [0; 4];
        file.read_exact(&mut size)?;
        let count = u64::try_from(i32::from_le_bytes(size)).map_err(|_| broken())?;
        let mut rest = [kind.as_slice(), &[0], &size].concat();
        let start = rest.len() as u64;
        file.by_ref().take(count).read_to_end(&mut rest)?;
        if rest.len() as u64 != start + count {
            return Err(broken());
        }
        attributes.push((name, rest));
    }
}

/// Reads bytes up to a NUL, which is dropped. Accepts at most 255 bytes, the format's longest name.
fn read_text(file: &mut impl Read) -> Result<Vec<u8>> {
    let mut text = Vec::new();
    let mut byte = [0];
    loop {
        file.read_exact(&mut byte)?;
        match byte[0] {
            0 => return Ok(text),
            _ if text.len() == 255 => return Err(broken()),
            byte => text.push(byte),
        }
    }
}

fn broken() -> Error {
    Error::new(ErrorKind::InvalidData, "the header is not an EXR's")
}
