//! Texels of a large image: square tiles in a temporary file without a name. Each thread keeps the
//! tiles that it looked at last.

use std::fs::File;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::{Mutex, OnceLock};

use crate::error::{Error, Result};
use crate::reserve;
use crate::threads::lock;

/// Width and height of a tile in texels.
pub const SIDE: usize = 64;

/// Number of caches. Threads with the same number modulo this share one.
const CACHES: usize = 16;

/// Columns and rows of tiles that a cache holds. Tiles of any square of this size do not displace
/// each other.
const KEPT: usize = 8;

/// Texels of a fixed number of bytes. A lookup reads the tiles that its thread does not keep.
#[derive(Debug)]
pub struct Tiles {
    file: File,
    width: u32,
    height: u32,
    texel_bytes: usize,
    caches: [Mutex<TileCache>; CACHES],
    /// The first error of a lookup. Its tile is black.
    failed: OnceLock<io::Error>,
}

/// Tiles that one thread looked at last. The place of a tile follows from its column and row.
#[derive(Debug, Default)]
pub struct TileCache(Vec<KeptTile>);

/// A tile in memory. `bytes` is empty before the first.
#[derive(Debug, Clone, Default)]
struct KeptTile {
    index: usize,
    bytes: Vec<u8>,
}

/// Number of tiles along a side.
fn tiles_along(side: u32) -> usize {
    (side as usize).div_ceil(SIDE)
}

/// Upper bound of the memory of an image in tiles, in bytes.
pub fn max_bytes((width, height): (u32, u32), texel_bytes: usize) -> u64 {
    let tiles = tiles_along(width) * tiles_along(height);
    (CACHES * tiles.min(KEPT * KEPT) * SIDE * SIDE * texel_bytes) as u64
}

impl Tiles {
    /// Texels that are all 0. Space on the disk is reserved for them. `None` if no folder for
    /// temporary files has the space, or if the folders are in memory.
    pub fn new((width, height): (u32, u32), texel_bytes: usize) -> Option<Self> {
        let tiles = tiles_along(width) as u64 * tiles_along(height) as u64;
        let file = on_disk(tiles.checked_mul((SIDE * SIDE * texel_bytes) as u64)?)?;
        let (caches, failed) = Default::default();
        Some(Self { file, width, height, texel_bytes, caches, failed })
    }

    /// Width and height in texels.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Upper bound of the memory of the kept tiles, in bytes.
    pub fn bytes(&self) -> u64 {
        max_bytes(self.size(), self.texel_bytes)
    }

    /// Calls `look` with the kept tiles of this thread.
    pub fn with<T>(&self, look: impl FnOnce(&mut TileCache) -> T) -> T {
        let thread = rayon::current_thread_index().unwrap_or(0);
        look(&mut lock(&self.caches[thread % CACHES]))
    }

    /// Returns the error of the first lookup that failed.
    pub fn check(&self) -> Result<()> {
        self.failed.get().map_or(Ok(()), |error| Err(failed("read", error)))
    }

    fn tile_bytes(&self) -> usize {
        SIDE * SIDE * self.texel_bytes
    }

    fn row_bytes(&self) -> usize {
        self.width as usize * self.texel_bytes
    }

    /// Size of a row of tiles in bytes.
    fn tile_row_bytes(&self) -> usize {
        tiles_along(self.width) * self.tile_bytes()
    }
}

impl TileCache {
    /// The bytes of the texel in column `x` of row `y`. The cache must be one of `tiles`.
    #[inline(always)]
    pub fn texel(&mut self, tiles: &Tiles, x: usize, y: usize) -> &[u8] {
        let (column, row) = (x / SIDE, y / SIDE);
        let index = row * tiles_along(tiles.width) + column;
        if self.0.is_empty() {
            self.0 = vec![KeptTile::default(); KEPT * KEPT];
        }
        let kept = &mut self.0[row % KEPT * KEPT + column % KEPT];
        if kept.index != index || kept.bytes.is_empty() {
            kept.read(tiles, index);
        }
        let at = (y % SIDE * SIDE + x % SIDE) * tiles.texel_bytes;
        &kept.bytes[at..at + tiles.texel_bytes]
    }
}

impl KeptTile {
    #[cold]
    #[inline(never)]
    fn read(&mut self, tiles: &Tiles, index: usize) {
        self.index = index;
        self.bytes.resize(tiles.tile_bytes(), 0);
        let start = (index * tiles.tile_bytes()) as u64;
        if let Err(error) = read_at(&tiles.file, &mut self.bytes, start) {
            self.bytes.fill(0);
            let _ = tiles.failed.set(error);
        }
    }
}

/// Writes an image row by row, from the top.
pub struct TileWriter {
    tiles: Tiles,
    /// Rows that do not fill a row of tiles yet.
    rows: Vec<u8>,
    /// Space for a row of tiles.
    tile_row: Vec<u8>,
    /// Index of the next row of tiles.
    next: u64,
}

impl TileWriter {
    /// Starts with the first row. `what` names the image in errors.
    ///
    /// # Errors
    /// `Retry` if the system refuses the memory.
    pub fn new(tiles: Tiles, what: &str) -> Result<Self> {
        let mut rows = Vec::new();
        reserve::exact(&mut rows, SIDE * tiles.row_bytes(), what)?;
        let tile_row = reserve::filled(0, tiles.tile_row_bytes(), what)?;
        Ok(Self { tiles, rows, tile_row, next: 0 })
    }

    /// Appends one row.
    ///
    /// # Errors
    /// Errors of the disk.
    pub fn push(&mut self, row: &[u8]) -> Result<()> {
        self.rows.extend_from_slice(row);
        if self.rows.len() < SIDE * self.tiles.row_bytes() { Ok(()) } else { self.flush() }
    }

    fn flush(&mut self) -> Result<()> {
        let bytes = SIDE * self.tiles.texel_bytes;
        for (y, row) in self.rows.chunks_exact(self.tiles.row_bytes()).enumerate() {
            for (column, part) in row.chunks(bytes).enumerate() {
                let at = column * self.tiles.tile_bytes() + y * bytes;
                self.tile_row[at..at + part.len()].copy_from_slice(part);
            }
        }
        let start = self.next * self.tile_row.len() as u64;
        write_at(&self.tiles.file, &self.tile_row, start).map_err(|e| failed("write", &e))?;
        self.rows.clear();
        self.next += 1;
        Ok(())
    }

    /// Returns the finished image.
    ///
    /// # Errors
    /// Errors of the disk.
    pub fn finish(mut self) -> Result<Tiles> {
        if !self.rows.is_empty() {
            self.flush()?;
        }
        Ok(self.tiles)
    }
}

/// Some rows of an image in memory.
#[derive(Default)]
pub struct Band {
    first_tile_row: usize,
    bytes: Vec<u8>,
}

impl Band {
    /// Reads the tiles of these rows.
    ///
    /// # Errors
    /// Errors of the disk; `Retry` if the system refuses the memory.
    pub fn read(&mut self, tiles: &Tiles, rows: Range<usize>, what: &str) -> Result<()> {
        self.first_tile_row = rows.start / SIDE;
        let length = (rows.end.div_ceil(SIDE) - self.first_tile_row) * tiles.tile_row_bytes();
        let more = length.saturating_sub(self.bytes.len());
        reserve::exact(&mut self.bytes, more, what)?;
        self.bytes.resize(length, 0);
        let start = (self.first_tile_row * tiles.tile_row_bytes()) as u64;
        read_at(&tiles.file, &mut self.bytes, start).map_err(|e| failed("read", &e))
    }

    /// The bytes of the texel in column `x` of row `y` of the image.
    pub fn texel(&self, tiles: &Tiles, x: usize, y: usize) -> &[u8] {
        let tile_row = y / SIDE - self.first_tile_row;
        let tile = tile_row * tiles_along(tiles.width) + x / SIDE;
        let at = tile * tiles.tile_bytes() + (y % SIDE * SIDE + x % SIDE) * tiles.texel_bytes;
        &self.bytes[at..at + tiles.texel_bytes]
    }
}

/// Makes the error of the disk that holds the texels.
pub fn failed(action: &str, error: &io::Error) -> Error {
    Error::io(Path::new("temporary file"), &format!("{action} the texels of a texture"), error)
}

/// A file without a name, on a disk, with `length` bytes of reserved space.
#[cfg(target_os = "linux")]
pub fn on_disk(length: u64) -> Option<File> {
    use rustix::fs::{FallocateFlags, fallocate, fstatfs};
    let reserved = |folder: &Path| {
        let file = tempfile::tempfile_in(folder).ok()?;
        let in_memory = fstatfs(&file).ok()?.f_type == libc::TMPFS_MAGIC;
        (!in_memory && fallocate(&file, FallocateFlags::empty(), 0, length).is_ok()).then_some(file)
    };
    reserved(&std::env::temp_dir()).or_else(|| reserved(Path::new("/var/tmp")))
}

/// Other systems have no calls for this: large images are held in memory.
#[cfg(not(target_os = "linux"))]
pub fn on_disk(_: u64) -> Option<File> {
    None
}

#[cfg(unix)]
use std::os::unix::fs::FileExt;

#[cfg(unix)]
pub fn read_at(file: &File, bytes: &mut [u8], start: u64) -> io::Result<()> {
    file.read_exact_at(bytes, start)
}

#[cfg(unix)]
fn write_at(file: &File, bytes: &[u8], start: u64) -> io::Result<()> {
    file.write_all_at(bytes, start)
}

#[cfg(not(unix))]
pub fn read_at(_: &File, _: &mut [u8], _: u64) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(not(unix))]
fn write_at(_: &File, _: &[u8], _: u64) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ErrorKind;

    /// Bytes that differ between neighbours in any direction.
    fn byte(x: usize, y: usize, i: usize) -> u8 {
        (x * 7 + y * 131 + i * 59 + x / 64 * 3) as u8
    }

    /// `None` if this machine has no disk for temporary files.
    fn image(size: (u32, u32), texel_bytes: usize) -> Option<Tiles> {
        let mut writer = TileWriter::new(Tiles::new(size, texel_bytes)?, "test").unwrap();
        for y in 0..size.1 as usize {
            let texel = |x| (0..texel_bytes).map(move |i| byte(x, y, i));
            let row: Vec<u8> = (0..size.0 as usize).flat_map(texel).collect();
            writer.push(&row).unwrap();
        }
        Some(writer.finish().unwrap())
    }

    #[test]
    fn every_texel_is_found_again() {
        let sizes =
            [(1, 1), (1, 200), (200, 1), (64, 64), (65, 63), (128, 129), (1100, 70), (70, 1100)];
        for (size, texel_bytes) in sizes.into_iter().flat_map(|size| [(size, 3), (size, 6)]) {
            let Some(tiles) = image(size, texel_bytes) else { return };
            let (width, height) = (size.0 as usize, size.1 as usize);
            let expected = |x, y| (0..texel_bytes).map(|i| byte(x, y, i)).collect::<Vec<u8>>();
            // By columns, so that tiles displace each other.
            for (x, y) in (0..width).flat_map(|x| (0..height).map(move |y| (x, y))) {
                let found = tiles.with(|cache| cache.texel(&tiles, x, y).to_vec());
                assert_eq!(found, expected(x, y), "{size:?} {x} {y}");
            }
            let mut band = Band::default();
            for rows in [0..height, height - 1..height, height / 3..height / 2 + 1] {
                band.read(&tiles, rows.clone(), "test").unwrap();
                for (x, y) in rows.flat_map(|y| (0..width).map(move |x| (x, y))) {
                    assert_eq!(band.texel(&tiles, x, y), expected(x, y), "{size:?} {x} {y}");
                }
            }
            let kept = tiles.caches.iter().flat_map(|cache| lock(cache).0.clone());
            let kept: usize = kept.map(|tile| tile.bytes.capacity()).sum();
            assert!(kept as u64 <= tiles.bytes() / CACHES as u64, "{size:?} {kept}");
        }
    }

    #[test]
    fn a_disk_that_fails_is_an_error() {
        let Some(tiles) = image((200, 100), 3) else { return };
        let texel = |x, y| tiles.with(|cache| cache.texel(&tiles, x, y).to_vec());
        let first = texel(0, 0);
        tiles.file.set_len(0).unwrap();
        assert_eq!((texel(0, 0), tiles.check()), (first, Ok(())));
        assert_eq!(texel(150, 90), [0; 3]);
        let error = tiles.check().unwrap_err();
        assert_eq!(error.kind, ErrorKind::Retry);
        assert!(error.to_string().contains("cannot read the texels"), "{error}");
    }

    #[test]
    fn an_image_larger_than_any_disk_has_no_file() {
        assert!(Tiles::new((u32::MAX, u32::MAX), 3).is_none());
        // 2^50 + 1 tiles of 2^14 bytes: one tile more than 2^64 bytes.
        let side = SIDE as u32;
        assert!(Tiles::new((27_118_601 * side, 41_517_625 * side), 4).is_none());
    }
}
