//! The bytes of an EXR header, attributes in the order of their names.
//!
//! The `exr` crate writes custom attributes in the order of a hash map, which differs from run to
//! run. OpenEXR's own library sorts them; so do we, on the bytes: an attribute is
//! `name NUL type NUL size:i32 data`, the list ends with an empty name, and nothing in the file
//! depends on their order.

use std::io::{BufReader, Error, ErrorKind, Read, Result};

/// Magic number and version field.
const PREAMBLE_BYTES: usize = 8;

/// Flags of the version field that mean more than one header, or deep data.
const MULTI_PART_OR_DEEP: u8 = 0x18;

/// Reads the header of a single-part file from its first byte and returns it sorted: as many bytes
/// as it takes in the file.
pub fn read_sorted(file: &mut impl Read) -> Result<Vec<u8>> {
    let mut file = BufReader::new(file);
    let mut header = vec![0; PREAMBLE_BYTES];
    file.read_exact(&mut header)?;
    if header[..4] != [0x76, 0x2f, 0x31, 0x01] || header[5] & MULTI_PART_OR_DEEP != 0 {
        return Err(broken());
    }
    let mut attributes: Vec<(Vec<u8>, Vec<u8>)> = Vec::new();
    loop {
        let name = read_text(&mut file)?;
        if name.is_empty() {
            break;
        }
        let kind = read_text(&mut file)?;
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
    attributes.sort();
    for (name, rest) in attributes {
        header.extend([name.as_slice(), &[0], &rest].concat());
    }
    header.push(0);
    Ok(header)
}

/// Bytes up to a NUL, without it; at most 255, the format's longest name.
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
    Error::new(ErrorKind::InvalidData, "the header is not a single-part EXR's")
}
