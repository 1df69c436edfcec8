//! The scale of a colour map: a row of colours with ticks.

use super::svg::{AXIS, Anchor, Svg};

/// A row of colours with values under it.
#[derive(Debug, Clone, Default)]
pub struct ColorScale {
    /// Text above the colours.
    pub title: String,
    /// Colours from left to right, 8-bit sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Position in [0, 1] and text of each tick.
    pub ticks: Vec<(f64, String)>,
}

const WIDTH: f64 = 420.0;
const EDGE: f64 = 24.0;

impl ColorScale {
    /// Returns the colour scale as SVG.
    pub fn svg(&self) -> String {
        let mut svg = Svg::new(WIDTH);
        svg.text([EDGE, 14.0], Anchor::Start, "", &self.title);
        let step = (WIDTH - 2.0 * EDGE) / self.colors.len().max(1) as f64;
        for (i, [r, g, b]) in self.colors.iter().enumerate() {
            let fill = format!("#{r:02x}{g:02x}{b:02x}");
            // Wider than a step, so that no gap shows.
            svg.rect([EDGE + i as f64 * step, 22.0, step + 1.5, 14.0], &fill);
        }
        for (place, text) in &self.ticks {
            let x = EDGE + place * (WIDTH - 2.0 * EDGE);
            svg.line([x, 36.0, x, 40.0], AXIS, 1.0);
            svg.text([x, 53.0], Anchor::Middle, "dim", text);
        }
        svg.finish(60.0, &self.title)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_colour_and_tick_is_drawn() {
        let scale = ColorScale {
            title: "a < b".into(),
            colors: vec![[0, 0, 4], [255, 1, 2]],
            ticks: vec![(0.0, "low".into()), (1.0, "high".into())],
        };
        let svg = scale.svg();
        for part in ["#000004", "#ff0102", "a &lt; b", ">low<", ">high<"] {
            assert!(svg.contains(part), "{part}");
        }
    }
}
