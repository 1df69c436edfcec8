//! Cuts a film into tiles, the units of work of the threads.

use crate::film::{Film, Window};
use crate::integrate::TILE;

/// A tile, with the pieces of the film's rows that it covers. The tiles' pieces are disjoint, so
/// threads can write them at the same time.
pub struct Tile<'f> {
    pub window: Window,
    pub rows: Vec<&'f mut [[f32; 4]]>,
    pub words: Vec<&'f mut [u32]>,
}

/// Cuts the film along the frame's absolute tile grid, and at the right and bottom end of the
/// camera's frame. The overscan is a multiple of [`TILE`] wide. So no tile holds pixels of both the
/// frame and its overscan.
pub fn tiles(film: &mut Film, [right, bottom]: [u32; 2]) -> Vec<Tile<'_>> {
    let window = film.window;
    let cuts = |from: u32, to: u32, end: u32| {
        let grid = (from / TILE + 1..to.div_ceil(TILE)).map(|t| t * TILE);
        let mut cuts: Vec<u32> = [from, to].into_iter().chain(grid).collect();
        cuts.extend((from + 1..to).contains(&end).then_some(end));
        cuts.sort_unstable();
        cuts.dedup();
        cuts
    };
    let pairs = |cuts: &[u32]| cuts.windows(2).map(|pair| (pair[0], pair[1])).collect::<Vec<_>>();
    let columns = pairs(&cuts(window.x0, window.x1, right));
    let mut tiles = Vec::new();
    let mut rows = film.pixels.chunks_mut(window.width() as usize);
    let stride = film.planes.channels.len();
    let mut words = film.planes.words.chunks_mut((window.width() as usize * stride).max(1));
    for (y0, y1) in pairs(&cuts(window.y0, window.y1, bottom)) {
        let first = tiles.len();
        for &(x0, x1) in &columns {
            let window = Window { x0, y0, x1, y1 };
            tiles.push(Tile { window, rows: Vec::new(), words: Vec::new() });
        }
        for mut row in rows.by_ref().take((y1 - y0) as usize) {
            for tile in &mut tiles[first..] {
                let (piece, rest) = row.split_at_mut(tile.window.width() as usize);
                tile.rows.push(piece);
                row = rest;
            }
        }
        // A film without layers has no rows of words.
        for mut row in words.by_ref().take((y1 - y0) as usize) {
            for tile in &mut tiles[first..] {
                let (piece, rest) = row.split_at_mut(tile.window.width() as usize * stride);
                tile.words.push(piece);
                row = rest;
            }
        }
    }
    tiles
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_a_window_once() {
        let window = Window { x0: 5, y0: 30, x1: 100, y1: 65 };
        let mut film = Film::new([200, 100], window).unwrap();
        let end = [70, 64];
        for tile in tiles(&mut film, end) {
            assert!(tile.window.x1 <= 70 || tile.window.x0 >= 70);
            assert_eq!(tile.rows.len(), tile.window.height() as usize);
            assert_eq!(tile.window.x0 / TILE, (tile.window.x1 - 1) / TILE);
            for (dy, row) in tile.rows.into_iter().enumerate() {
                for (dx, pixel) in row.iter_mut().enumerate() {
                    pixel[0] += (tile.window.x0 + dx as u32) as f32;
                    pixel[1] += (tile.window.y0 + dy as u32) as f32;
                    pixel[3] += 1.0;
                }
            }
        }
        for (i, pixel) in film.pixels.iter().enumerate() {
            let (x, y) = (5 + i % 95, 30 + i / 95);
            assert_eq!(*pixel, [x as f32, y as f32, 0.0, 1.0]);
        }
    }
}
