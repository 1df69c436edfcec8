//! An SVG drawing that grows downwards, and the numbers on its axes.

use std::fmt::Write;

/// Colours of the backends in order.
///
/// They are distinguishable with most kinds of colour blindness. The palette is from Okabe and Ito
/// 2008, with a grey added and a darker yellow. Its red is left out: red marks wrong values.
pub const COLORS: [&str; 8] =
    ["#7f8c9b", "#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", INK, "#d6c400"];

/// Colour of grid lines behind a chart.
pub const GRID: &str = "#e3e6ea";

/// Colour of axes and their ticks.
pub const AXIS: &str = "#444";

/// Colour of intervals and of the line at 1.
pub const INK: &str = "#222222";

/// Colour of wrong values.
pub const WRONG: &str = "#c8102e";

/// Average width of a character, relative to the font size.
const CHARACTER: f64 = 0.55;

/// Height of one row of a legend, in pixels.
const LEGEND: f64 = 17.0;

/// An SVG drawing of a fixed width, in CSS pixels.
#[derive(Debug)]
pub struct Svg {
    width: f64,
    body: String,
}

/// Position of a text relative to its point.
#[derive(Debug, Clone, Copy)]
pub enum Anchor {
    /// The text begins at the point.
    Start,
    /// The text is centred on the point.
    Middle,
    /// The text ends at the point.
    End,
}

impl Svg {
    pub fn new(width: f64) -> Self {
        Self { width, body: String::new() }
    }

    pub fn rect(&mut self, [x, y, width, height]: [f64; 4], fill: &str) {
        let width = width.max(0.0);
        let _ = writeln!(
            self.body,
            r#"<rect x="{x:.1}" y="{y:.1}" width="{width:.1}" height="{height:.1}" fill="{fill}"/>"#
        );
    }

    pub fn line(&mut self, [x1, y1, x2, y2]: [f64; 4], color: &str, width: f64) {
        let _ = writeln!(
            self.body,
            r#"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" stroke="{color}" stroke-width="{width}"/>"#
        );
    }

    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64, fill: &str) {
        let _ =
            writeln!(self.body, r#"<circle cx="{x:.1}" cy="{y:.1}" r="{radius}" fill="{fill}"/>"#);
    }

    /// Draws a text of 12 pixels with its baseline at `y`.
    pub fn text(&mut self, [x, y]: [f64; 2], anchor: Anchor, class: &str, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = escape(text);
        let _ = writeln!(
            self.body,
            r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}" class="{class}">{text}</text>"#
        );
    }

    /// Draws a horizontal interval with a cap at each end.
    pub fn whisker(&mut self, [low, high]: [f64; 2], y: f64) {
        self.cut_whisker([low, high], y, [false; 2]);
    }

    /// Draws a horizontal interval. An end that is `cut` lies outside the chart and has no cap.
    pub fn cut_whisker(&mut self, ends: [f64; 2], y: f64, cut: [bool; 2]) {
        self.line([ends[0], y, ends[1], y], INK, 1.2);
        for (x, _) in ends.into_iter().zip(cut).filter(|(_, cut)| !cut) {
            self.line([x, y - 3.0, x, y + 3.0], INK, 1.2);
        }
    }

    /// Draws names beside their colours, in as many rows as they need. Returns the height of all
    /// rows after the first.
    pub fn legend(&mut self, [left, top]: [f64; 2], names: &[(String, &str)]) -> f64 {
        let (mut x, mut y) = (left, top);
        for (name, color) in names {
            // Leave room for names with wide characters.
            let width = 15.0 + 1.15 * text_width(name);
            if x > left && x + width > self.width {
                (x, y) = (left, y + LEGEND);
            }
            self.rect([x, y - 9.0, 10.0, 10.0], color);
            self.text([x + 15.0, y], Anchor::Start, "", name);
            x += width + 20.0;
        }
        y - top
    }

    /// Returns the SVG, `height` pixels high, with `title` as its text for screen readers. Font and
    /// background are set for use outside a page.
    pub fn finish(self, height: f64, title: &str) -> String {
        let (width, title) = (self.width, escape(title));
        format!(
            "<svg viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\" role=\"img\" \
             xmlns=\"http://www.w3.org/2000/svg\" font-family=\"sans-serif\" font-size=\"12\" \
             style=\"background: #fff\">\n<title>{title}</title>\n{}</svg>\n",
            self.body
        )
    }
}

/// Approximate width of a text of 12 pixels, in pixels.
pub fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * 12.0 * CHARACTER
}

/// Escapes text for use in HTML and SVG.
pub fn escape(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            c => safe.push(c),
        }
    }
    safe
}

/// Formats a number with three significant digits and no exponent: `0.0123`, `1.23`, `123`,
/// `12300`.
pub fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = 2 - (value.abs().log10().floor() as i32);
    let rounded = 10f64.powi(digits);
    match digits {
        ..=0 => format!("{:.0}", (value * rounded).round() / rounded),
        _ => format!("{value:.*}", digits as usize),
    }
}

/// Ticks of an axis: 0 and 3 to 5 equal round steps, the last at `most` or above.
pub fn ticks(most: f64) -> Vec<f64> {
    if !(most > 0.0 && most.is_finite()) {
        return vec![0.0, 1.0];
    }
    let power = 10f64.powf((most / 3.0).log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|s| s * power);
    let step = steps.into_iter().find(|s| most / s <= 5.0).unwrap_or(10.0 * power);
    (0..=(most / step).ceil() as u32).map(|i| f64::from(i) * step).collect()
}

/// Formats a power of ten: `1e-5`, `0.01`, `1`, and from 1000 with an SI prefix, `100k`.
pub fn prefixed(power: f64) -> String {
    let exponent = power.log10().round() as i32;
    let prefixes = ["", "k", "M", "G", "T"];
    let group = exponent.div_euclid(3);
    match usize::try_from(group).ok().and_then(|i| prefixes.get(i)) {
        Some(prefix) => format!("{}{prefix}", 10u32.pow(exponent.rem_euclid(3) as u32)),
        None if (-3..0).contains(&exponent) => {
            format!("{power:.*}", exponent.unsigned_abs() as usize)
        }
        None => format!("1e{exponent}"),
    }
}

/// Powers of ten from at most `low` to at least `high`; at least two of them. Both limits are > 0.
pub fn decades(low: f64, high: f64) -> Vec<f64> {
    let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
    (first..=last.max(first + 1)).map(|e| 10f64.powi(e)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_significant_digits() {
        for (value, text) in [
            (0.0, "0"),
            (0.012345, "0.0123"),
            (1.2345, "1.23"),
            (12.345, "12.3"),
            (123.45, "123"),
            (12345.0, "12300"),
            (-0.5, "-0.500"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(number(value), text);
        }
    }

    #[test]
    fn ticks_reach_the_largest_value() {
        assert_eq!(ticks(8.6), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        for most in [1e-9, 0.3, 1.0, 7.7, 99.0, 1e6] {
            let ticks = ticks(most);
            assert!((3..=7).contains(&ticks.len()), "{ticks:?}");
            assert!(*ticks.last().unwrap() >= most * (1.0 - 1e-12));
        }
        assert_eq!(ticks(f64::NAN), [0.0, 1.0]);
        assert_eq!(decades(0.5, 20.0), [0.1, 1.0, 10.0, 100.0]);
        assert_eq!(decades(1.0, 1.0), [1.0, 10.0]);
    }

    #[test]
    fn powers_have_prefixes() {
        let of = |exponent| prefixed(10f64.powi(exponent));
        assert_eq!(
            [-5, -3, -1, 0, 2, 4, 8].map(of),
            ["1e-5", "0.001", "0.1", "1", "100", "10k", "100M"]
        );
        assert_eq!(of(-10), "1e-10");
    }

    #[test]
    fn markup_characters_are_escaped() {
        assert_eq!(escape("<a href=\"&\">"), "&lt;a href=&quot;&amp;&quot;&gt;");
    }
}
