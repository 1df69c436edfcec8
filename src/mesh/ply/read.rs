//! Reads a mesh from a file or from memory.

use std::io::Cursor;
use std::path::Path;

use super::context::ReadContext;
use super::options::ReadOptions;
use super::source::{self, Bytes, MeshSource, Stream};
use super::stream;
use super::unpack::Packing;
use super::whole::whole;
use crate::error::Result;
use crate::mesh::arrays::Mesh;

/// Reads the PLY file at `path`, plain or compressed with gzip or zstd, in the caller's rayon pool.
pub fn read(path: &Path, options: ReadOptions) -> Result<Mesh> {
    let name = path.display().to_string();
    let context =
        ReadContext { name: &name, monitor: options.monitor, memory_limit: options.memory_limit };
    let MeshSource { bytes, stamp } = MeshSource::open(path, options.mmap, options.memory_limit)?;
    let mut mesh = match bytes {
        Bytes::Mapped(map) => {
            let mesh = whole(map.bytes(), &context, options);
            map.intact(path)?;
            mesh
        }
        Bytes::Stream(Stream { bytes, length, packing }) => {
            let failed = |error: &std::io::Error| source::failed(path, packing, error);
            stream::read(bytes, length, &failed, &context, options)
        }
    }?;
    mesh.notes.stamp = stamp;
    Ok(mesh)
}

/// Reads a PLY file from memory, plain or compressed with gzip or zstd. Messages name it as `name`.
pub fn read_bytes(bytes: &[u8], name: &str, options: ReadOptions) -> Result<Mesh> {
    let context =
        ReadContext { name, monitor: options.monitor, memory_limit: options.memory_limit };
    match Packing::detect(bytes) {
        None => whole(bytes, &context, options),
        Some(packing) => {
            let failed = |e: &std::io::Error| source::failed(name.as_ref(), Some(packing), e);
            let length = Some(bytes.len() as u64);
            let packed = Cursor::new(bytes.to_vec());
            let bytes =
                packing.open(packed, length, options.memory_limit).map_err(|e| failed(&e))?;
            stream::read(bytes, None, &failed, &context, options)
        }
    }
}
