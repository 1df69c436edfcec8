//! Draws the legend of a colour map into the PNG: a bar with ticks, and the property's name.

use serde::{Deserialize, Serialize};

use embedded_graphics::mono_font::MonoFont;
use embedded_graphics::mono_font::iso_8859_1::{FONT_6X10, FONT_10X20};

use crate::colormap::ColorMap;
use crate::film::Window;

use super::text::draw_text;
use super::tonemap::{Depth, PixelFormat};

/// The large font is used if both sides of the picture have at least this many pixels.
const LARGE: u32 = 500;
/// Maximum number of steps between ticks on a bar.
const MAX_STEPS: u32 = 6;
/// Maximum number of characters of a property's name; the rest is not drawn.
const MAX_NAME: u32 = 24;
/// Label of the values that are not finite.
const NOT_FINITE: &str = "NaN, inf";
const PAPER: [u8; 3] = [244, 245, 247];
const INK: [u8; 3] = [28, 33, 38];

/// The colour map of a property and the range of values that it shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Legend {
    /// Name of the property.
    pub name: String,
    /// Colour map.
    pub map: ColorMap,
    /// Values at the low and the high end of the map. They must differ; either may be the larger.
    pub range: [f64; 2],
    /// Colour of values that are not finite, as 8-bit sRGB; `None` if there are no such values.
    pub nan: Option<[u8; 3]>,
}

/// The pixels of a PNG, to draw into.
pub struct Canvas<'a> {
    /// Samples, row by row.
    pub bytes: &'a mut [u8],
    /// Width in pixels.
    pub width: u32,
    /// The part to draw into.
    pub shown: Window,
    /// Format of the pixels.
    pub color: PixelFormat,
}

/// The parts of a legend for one size of picture. Lengths are in pixels.
struct Layout {
    font: &'static MonoFont<'static>,
    /// Height of a line of text; half of it is the space between parts.
    line: u32,
    /// Length of the mark of a tick.
    mark: u32,
    /// Left end of the labels, from the left side of the bar.
    labels: u32,
    /// Height of the bar.
    tall: u32,
    /// The property's name, cut to the space for it.
    name: String,
    /// Values and labels of the ticks.
    ticks: Vec<(f64, String)>,
    /// Width and height of the panel.
    panel: [u32; 2],
}

impl Legend {
    /// Returns whether a picture of this size has room for the legend.
    pub fn fits(&self, size: [u32; 2]) -> bool {
        self.layout(size).is_some()
    }

    /// Chooses font, ticks and sizes. `None` if the panel would take more than two thirds of the
    /// width, or if the bar would be so short that the labels of its ends overlap.
    fn layout(&self, [width, height]: [u32; 2]) -> Option<Layout> {
        let large = width.min(height) >= LARGE;
        let font = if large { &FONT_10X20 } else { &FONT_6X10 };
        let (letter, line) = (font.character_size.width, font.character_size.height);
        let pad = line / 2;
        let rows = 1 + u32::from(self.nan.is_some());
        let texts = rows * (line + 2 * pad);
        let tall = (height * 3 / 5).max(3 * line).min(height.saturating_sub(texts + 3 * pad));
        if tall <= 2 * line {
            return None;
        }
        // Two pixels apart, so that labels do not touch.
        let ticks = self.ticks(f64::from(line + 2) / f64::from(tall - 1));
        let texts_of_bar = ticks.iter().map(|(_, text)| text.as_str());
        let longest = texts_of_bar.chain(self.nan.map(|_| NOT_FINITE)).map(str::len).max();
        // A mark so short, and so far from the number, is no minus sign.
        let mark = line / 5;
        let labels = line + mark + letter;
        let scale = labels + letter * longest.unwrap_or(0) as u32;
        let most = (width * 2 / 3).saturating_sub(3 * pad);
        let letters = (most / letter).min(MAX_NAME) as usize;
        let name: String = self.name.chars().take(letters).collect();
        let inner = scale.max(letter * name.chars().count() as u32);
        let panel = [inner + 2 * pad, tall + texts + 2 * pad];
        (scale <= most).then_some(Layout { font, line, mark, labels, tall, name, ticks, panel })
    }

    /// Draws the legend at the right border, on an opaque panel, if it [fits](Self::fits).
    pub fn draw(&self, canvas: &mut Canvas) {
        let size = [canvas.shown.width(), canvas.shown.height()];
        let Some(layout) = self.layout(size) else { return };
        let Layout { font, line, mark, labels, tall, name, ticks, panel } = layout;
        let (pad, bar, last) = (line / 2, line, tall - 1);
        let left = size[0].saturating_sub(panel[0] + pad);
        let top = size[1].saturating_sub(panel[1]) / 2;
        canvas.fill([left, top], panel, PAPER);
        let (x, mut y) = (left + pad, top + pad);
        canvas.text(font, [x, y], &name);
        y += line + 2 * pad;
        for row in 0..tall {
            // The high end of the map is at the top.
            let color = self.map.srgb(1.0 - f64::from(row) / f64::from(last));
            canvas.fill([x, y + row], [bar, 1], color);
        }
        for (value, text) in &ticks {
            let row = ((1.0 - self.position(*value)) * f64::from(last)).round() as u32;
            canvas.fill([x + bar, y + row], [mark, 1], INK);
            canvas.text(font, [x + labels, (y + row).saturating_sub(line / 2)], text);
        }
        if let Some(nan) = self.nan {
            y += tall + 2 * pad;
            canvas.fill([x, y], [bar, line], nan);
            canvas.text(font, [x + labels, y], NOT_FINITE);
        }
    }

    /// Position of a value on the map: 0 at `range[0]`, 1 at `range[1]`.
    fn position(&self, value: f64) -> f64 {
        let [low, high] = self.range;
        match (high - low).is_finite() {
            true => (value - low) / (high - low),
            // Half of the width is finite.
            false => (value / 2.0 - low / 2.0) / (high / 2.0 - low / 2.0),
        }
    }

    /// Values and texts of the ticks: the two ends of the range, and between them multiples of 1, 2
    /// or 5 times a power of ten, if an f64 can hold these. `line` is the height of a label as a
    /// share of the bar; no label overlaps one of an end.
    fn ticks(&self, line: f64) -> Vec<(f64, String)> {
        let [a, b] = self.range;
        let (low, high) = (a.min(b), a.max(b));
        let steps = ((1.0 / (1.5 * line)) as u32).clamp(1, MAX_STEPS);
        let least = (high - low) / f64::from(steps);
        let power = least.log10().floor();
        let step = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * 10f64.powf(power));
        let step = step.into_iter().find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(least);
        let (first, last) = ((low / step - 1e-6).ceil(), (high / step + 1e-6).floor());
        // Far from zero, a number and the next may round to the same f64.
        let distinct = first + 1.0 > first && last - 1.0 < last;
        if !(last - first <= f64::from(steps)) || !distinct || !step.is_finite() {
            return [low, high].map(|end| (end, format!("{end:e}"))).into();
        }
        let largest = low.abs().max(high.abs());
        let last_digit = step.log10().floor();
        let decimals = (-last_digit).max(0.0) as usize;
        let plain = (1e-4..1e7).contains(&largest) && decimals < 7;
        // Enough digits for neighbouring ticks to differ.
        let digits = (largest.log10().floor() - last_digit).max(2.0) as usize;
        let text = |value: f64, more: usize| {
            let text = match plain {
                true => format!("{value:.*}", decimals + more),
                false => format!("{value:.*e}", digits + more),
            };
            // Zero has no sign, also if a value is rounded to it.
            match text.strip_prefix('-') {
                Some(zero) if zero.parse() == Ok(0.0) => zero.to_string(),
                _ => text,
            }
        };
        // An end has up to two digits more, without zeros at their end.
        let end = |value: f64| {
            let exact = |more: &usize| {
                let value = |more| text(value, more).parse::<f64>().ok();
                value(*more) == value(2)
            };
            (value, text(value, (0..2).find(exact).unwrap_or(2)))
        };
        let count = (last - first).max(0.0) as usize;
        let values = (0..=count).map(|i| (first + i as f64) * step);
        let is_free = |value: &f64| (line..=1.0 - line).contains(&self.position(*value));
        let round = values.filter(is_free).map(|value| (value, text(value, 0)));
        [end(low)].into_iter().chain(round).chain([end(high)]).collect()
    }
}

impl Canvas<'_> {
    /// Fills a rectangle, given by its top left corner and its size.
    fn fill(&mut self, [left, top]: [u32; 2], [width, height]: [u32; 2], color: [u8; 3]) {
        for y in top..top.saturating_add(height).min(self.shown.height()) {
            for x in left..left.saturating_add(width).min(self.shown.width()) {
                self.put(x, y, color);
            }
        }
    }

    /// Draws a line of text, given by its top left corner.
    fn text(&mut self, font: &MonoFont, at: [u32; 2], text: &str) {
        let size = [self.shown.width(), self.shown.height()];
        draw_text(size, |x, y, color| self.put(x, y, color), (text, font), at, INK);
    }

    /// Sets a pixel of the shown part to an opaque 8-bit sRGB colour. `x` must be less than its
    /// width.
    fn put(&mut self, x: u32, y: u32, color: [u8; 3]) {
        let PixelFormat { alpha, srgb, depth } = self.color;
        let sample = usize::from(depth.bits() / 8);
        let channels = if alpha { 4 } else { 3 };
        let [x, y] = [self.shown.x0 + x, self.shown.y0 + y].map(|side| side as usize);
        let at = (y * self.width as usize + x) * channels * sample;
        let Some(pixel) = self.bytes.get_mut(at..at + channels * sample) else { return };
        let [r, g, b] = color.map(|c| f64::from(c) / 255.0);
        let levels = [r, g, b].map(|c| if srgb { c } else { super::srgb::to_linear(c) });
        for (to, level) in pixel.chunks_exact_mut(sample).zip(levels.into_iter().chain([1.0])) {
            match depth {
                Depth::Eight => to[0] = (255.0 * level).round() as u8,
                Depth::Sixteen => {
                    to.copy_from_slice(&((65535.0 * level).round() as u16).to_be_bytes());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn legend(range: [f64; 2]) -> Legend {
        Legend { name: "quality".into(), map: ColorMap::Viridis, range, nan: None }
    }

    fn whole(bytes: &mut [u8], [width, height]: [u32; 2], color: PixelFormat) -> Canvas<'_> {
        Canvas { bytes, width, shown: Window::full(width, height), color }
    }

    fn texts(range: [f64; 2]) -> Vec<String> {
        legend(range).ticks(0.05).into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_the_ends_and_round_numbers_between_them() {
        assert_eq!(texts([0.0, 1.0]), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(texts([-3.0, 12.0]), ["-3", "0", "5", "10", "12"]);
        assert_eq!(texts([12.0, -3.0]), ["-3", "0", "5", "10", "12"], "a reversed range");
        assert_eq!(texts([0.0312, 0.0349]), ["0.0312", "0.032", "0.033", "0.034", "0.0349"]);
        assert_eq!(texts([-0.1, 10.1]), ["-0.1", "2", "4", "6", "8", "10.1"], "no room for 0");
        assert_eq!(texts([-0.004, 600.0])[0], "0", "a minus sign before zero");
        assert_eq!(texts([-600.0, -0.0])[6], "0", "a minus sign before zero");
        assert_eq!(texts([0.123456, 9.0001]), ["0.12", "2", "4", "6", "8", "9"]);
        assert_eq!(
            texts([0.0, 3e9]),
            ["0.00e0", "5.00e8", "1.00e9", "1.50e9", "2.00e9", "2.50e9", "3.00e9"]
        );
        assert_eq!(
            texts([1e8, 1.0005e8]),
            ["1.0000e8", "1.0001e8", "1.0002e8", "1.0003e8", "1.0004e8", "1.0005e8"]
        );
        assert_eq!(texts([1e300, 1.0000000000000002e300]).len(), 2, "no digits for steps");
        assert_eq!(texts([-1.7e308, 1.7e308]), ["-1.7e308", "1.7e308"], "no finite width");
        for range in [[-1.0, 1.0], [3.7, 912.0], [-0.001, 0.02], [1e5, 1.0001e5]] {
            let ticks = legend(range).ticks(0.05);
            assert!((2..=9).contains(&ticks.len()), "{range:?} {ticks:?}");
            for (value, text) in ticks {
                assert!((range[0] - 1e-9..=range[1] * (1.0 + 1e-9)).contains(&value));
                assert!((text.parse::<f64>().unwrap() - value).abs() < 1e-9 * value.abs().max(1.0));
            }
        }
    }

    #[test]
    fn every_label_lies_on_the_panel() {
        let (size, background) = ([600, 600], [9, 9, 9]);
        let mut bytes = background.repeat(600 * 600);
        let color = PixelFormat { alpha: false, srgb: true, depth: Depth::Eight };
        let legend = Legend { nan: Some([255, 0, 255]), ..legend([0.0, 10.0]) };
        legend.draw(&mut whole(&mut bytes, size, color));
        let pixel = |x: usize, y: usize| &bytes[3 * (y * 600 + x)..][..3];
        let on_panel = |x: usize| (0..600).any(|y| pixel(x, y) == PAPER);
        let right = (0..600).rev().find(|&x| on_panel(x)).expect("a panel");
        assert!(right < 599, "{right}");
        let drawn = |x: usize| {
            (0..600).any(|y| ![&background, &PAPER].contains(&pixel(x, y).try_into().unwrap()))
        };
        assert!((right..600).all(|x| !drawn(x)), "ink at the panel's border or beside it");
    }

    #[test]
    fn the_bar_runs_through_the_map_in_every_format() {
        for (alpha, depth) in [(false, Depth::Eight), (true, Depth::Sixteen)] {
            let sample = usize::from(depth.bits() / 8);
            let channels = if alpha { 4 } else { 3 };
            let size = [300, 200];
            let mut bytes = vec![0; 300 * 200 * channels * sample];
            let color = PixelFormat { alpha, srgb: true, depth };
            legend([0.0, 1.0]).draw(&mut whole(&mut bytes, size, color));
            let pixel = |x: usize, y: usize| {
                let at = (y * 300 + x) * channels * sample;
                [0, 1, 2].map(|c| bytes[at + c * sample])
            };
            let column =
                (0..300).find(|x| (0..200).any(|y| pixel(*x, y) == ColorMap::Viridis.srgb(1.0)));
            let column = column.expect("the top of the bar");
            let row = |color| (0..200).find(|y| pixel(column, *y) == color).expect("the colour");
            let (top, bottom) =
                (row(ColorMap::Viridis.srgb(1.0)), row(ColorMap::Viridis.srgb(0.0)));
            assert!(bottom > top + 80, "{top} {bottom}");
            assert_eq!(pixel(5, 5), [0; 3], "beside the panel");
            if alpha {
                let at = ((top * 300 + column) * 4 + 3) * 2;
                assert_eq!(bytes[at..at + 2], [255, 255]);
            }
        }
    }

    #[test]
    fn a_legend_has_room_or_is_not_drawn() {
        let sizes = [([1, 1], false), ([3, 400], false), ([400, 3], false), ([64, 48], false)];
        for (size, fits) in sizes.into_iter().chain([([128, 96], true), ([640, 480], true)]) {
            let mut bytes = vec![0; (size[0] * size[1] * 3) as usize];
            let color = PixelFormat { alpha: false, srgb: false, depth: Depth::Eight };
            let legend = Legend { nan: Some([255, 0, 255]), ..legend([-0.005, 0.004]) };
            legend.draw(&mut whole(&mut bytes, size, color));
            assert_eq!(bytes.iter().any(|byte| *byte != 0), fits, "{size:?}");
            assert_eq!(legend.fits(size), fits);
            let Some(layout) = legend.layout(size) else { continue };
            let rows = layout.ticks.iter().map(|(value, _)| legend.position(*value));
            let rows: Vec<f64> = rows.map(|row| row * f64::from(layout.tall - 1)).collect();
            let apart = rows.windows(2).all(|pair| pair[1] - pair[0] >= f64::from(layout.line));
            assert!(apart, "{size:?}: {rows:?}");
        }
    }
}
