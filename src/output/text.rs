//! Draws text into pictures of 8-bit colours.

use std::convert::Infallible;

use embedded_graphics::mono_font::{MonoFont, MonoTextStyle};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};

/// A picture whose pixels a function sets.
struct Pixels<F> {
    size: [u32; 2],
    put: F,
}

/// Draws a line of text, given by its top left corner. `put` sets a pixel; it is called only within
/// `size`.
pub fn draw_text(
    size: [u32; 2],
    put: impl FnMut(u32, u32, [u8; 3]),
    (text, font): (&str, &MonoFont),
    [x, y]: [u32; 2],
    [r, g, b]: [u8; 3],
) {
    let style = MonoTextStyle::new(font, Rgb888::new(r, g, b));
    let text = Text::with_baseline(text, Point::new(x as i32, y as i32), style, Baseline::Top);
    // Setting pixels cannot fail: the error type has no values.
    let _ = text.draw(&mut Pixels { size, put });
}

impl<F> OriginDimensions for Pixels<F> {
    fn size(&self) -> Size {
        self.size.into()
    }
}

impl<F: FnMut(u32, u32, [u8; 3])> DrawTarget for Pixels<F> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Infallible> {
        let [width, height] = self.size;
        for Pixel(at, color) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(at.x), u32::try_from(at.y)) else { continue };
            if x < width && y < height {
                (self.put)(x, y, [color.r(), color.g(), color.b()]);
            }
        }
        Ok(())
    }
}
