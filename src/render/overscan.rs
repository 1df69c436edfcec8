//! Pixels around the camera's frame.

use crate::camera;
use crate::error::{Error, Result};
use crate::film::Window;
use crate::integrate::TILE;
use crate::scene::{CheckedCamera, MAX_PIXELS};

/// Returns `pixels` rounded up to whole tiles, and the window to render in the coordinates of the
/// enlarged frame, whose own size is `size`.
///
/// With an overscan of whole tiles, the packets of the frame stay the same.
///
/// # Errors
/// More pixels than a picture may have.
pub fn overscan_window(pixels: u32, [width, height]: [u32; 2]) -> Result<(u32, Window)> {
    let overscan = pixels.next_multiple_of(TILE);
    let [x0, y0] = [overscan - pixels; 2];
    let [x1, y1] = [width, height].map(|side| overscan + side + pixels);
    let window = Window { x0, y0, x1, y1 };
    if pixels > 0 && window.pixels() > MAX_PIXELS {
        let [w, h] = [window.width(), window.height()];
        let message = format!("found {pixels}, a picture of {w} x {h} pixels with the frame");
        let message = format!("{message}, expected at most {MAX_PIXELS} pixels");
        return Err(Error::invalid("--overscan", message));
    }
    Ok((overscan, window))
}

/// Does the same as [`overscan_window`], and checks that the camera has a ray for each pixel.
///
/// # Errors
/// More pixels than a picture may have; a lens whose distortion folds within the overscan.
pub fn checked_overscan(pixels: u32, camera: &CheckedCamera) -> Result<(u32, Window)> {
    let window = overscan_window(pixels, [camera.width, camera.height])?;
    if pixels == 0 {
        return Ok(window);
    }
    // The other pixels of the tiles need no rays: no picture keeps them.
    camera::check_overscan(camera, pixels).map_err(|fold| {
        let [x, y] = fold.raster.map(f64::floor);
        let message = format!(
            "found {pixels}, but the distortion of the camera folds around the frame, at pixel ({x}, {y})"
        );
        Error::invalid("--overscan", message).help("give fewer pixels")
    })?;
    Ok(window)
}
