//! A chart of speeds relative to a baseline, on a logarithmic axis around 1.

use super::svg::{Anchor, GRID, INK, Svg, WRONG, text_width};

/// A chart of speed ratios. A bar to the right of the line at 1: faster than the baseline.
#[derive(Debug, Clone, Default)]
pub struct Ratios {
    /// Heading of the chart.
    pub title: String,
    /// Subtitle: the meaning of the ratios, such as `how many times as fast as embree`.
    pub subtitle: String,
    /// The ratios from top to bottom.
    pub rows: Vec<Ratio>,
}

/// The speed of one measurement relative to the baseline.
#[derive(Debug, Clone, Default)]
pub struct Ratio {
    /// Text at the left of the row.
    pub label: String,
    /// Speed divided by the baseline's speed, > 0.
    pub value: f64,
    /// Lower and upper end of the 95% confidence interval of `value`.
    pub interval: [f64; 2],
    /// `faster`, `slower` or `no difference shown`.
    pub verdict: &'static str,
    /// The wrong answers of the backend, if there are any. Its speed then does not count, and the
    /// row is red.
    pub wrong: Option<String>,
}

const WIDTH: f64 = 550.0;
const ROW: f64 = 20.0;
/// Colour of each verdict.
const COLORS: [(&str, &str); 3] =
    [("faster", "#1a7f4b"), ("slower", "#b35900"), ("no difference shown", "#8a929c")];

impl Ratios {
    /// Returns the chart as SVG, or an empty string without rows.
    pub fn svg(&self) -> String {
        if self.rows.is_empty() {
            return String::new();
        }
        let widest = self.rows.iter().map(|r| text_width(&r.label)).fold(0.0, f64::max);
        // Red text is bold, so it is up to a quarter wider.
        let bold_factor = |r: &Ratio| if r.wrong.is_some() { 1.25 } else { 1.0 };
        let texts = self.rows.iter().map(|r| text_width(&r.text()) * bold_factor(r));
        let rightmost = texts.fold(0.0, f64::max);
        let (left, right) = (widest + 14.0, WIDTH - rightmost - 14.0);
        // The axis fits the values, with a margin of 20%, and shows at least 1/1.3 to 1.3. Wider
        // intervals are cut off: they would make the bars small.
        let lengths = self.rows.iter().map(|r| 1.2 * r.value.ln().abs());
        let span = lengths.filter(|v| v.is_finite()).fold(1.3f64.ln(), f64::max);
        let x = |v: f64| left + (right - left) * (0.5 + 0.5 * (v.ln() / span).clamp(-1.0, 1.0));
        let mut svg = Svg::new(WIDTH);
        svg.text([0.0, 16.0], Anchor::Start, "title", &self.title);
        svg.text([0.0, 34.0], Anchor::Start, "dim", &self.subtitle);
        let wrong = self.rows.iter().any(|r| r.wrong.is_some());
        let legend = COLORS.into_iter().chain(wrong.then_some(("wrong answers", WRONG)));
        let legend: Vec<_> = legend.map(|(name, color)| (name.to_string(), color)).collect();
        svg.legend([0.0, 52.0], &legend);
        let (top, bottom) = (62.0, 62.0 + ROW * self.rows.len() as f64);
        for tick in marks(span) {
            svg.line([x(tick), top, x(tick), bottom], GRID, 1.0);
            svg.text([x(tick), bottom + 15.0], Anchor::Middle, "dim", &format!("{tick}\u{d7}"));
        }
        svg.line([x(1.0), top, x(1.0), bottom], INK, 1.5);
        for (i, row) in self.rows.iter().enumerate() {
            let y = top + ROW * (i as f64 + 0.5);
            let (color, class) = row.color();
            svg.text([left - 10.0, y + 4.0], Anchor::End, "", &row.label);
            let (a, b) = (x(1.0), x(row.value));
            svg.rect([a.min(b), y - 5.0, (a - b).abs(), 10.0], color);
            svg.cut_whisker(row.interval.map(x), y, row.interval.map(|v| v.ln().abs() > span));
            svg.circle([b, y], 3.5, color);
            svg.text([right + 10.0, y + 4.0], Anchor::Start, class, &row.text());
        }
        svg.finish(bottom + 24.0, &format!("{}: {}", self.title, self.subtitle))
    }
}

impl Ratio {
    fn text(&self) -> String {
        let [low, high] = self.interval;
        let text = format!("{:.2} [{low:.2}, {high:.2}]", self.value);
        match &self.wrong {
            Some(wrong) => format!("{text} {wrong}"),
            None => text,
        }
    }

    /// Returns the colour of the bar and the CSS class of the text.
    fn color(&self) -> (&'static str, &'static str) {
        if self.wrong.is_some() {
            return (WRONG, "wrong");
        }
        let [faster, slower, (_, even)] = COLORS;
        match [faster, slower].into_iter().find(|(verdict, _)| *verdict == self.verdict) {
            Some((_, color)) => (color, ""),
            None => (even, "dim"),
        }
    }
}

/// Ratios to mark on an axis from exp(-span) to exp(span). 1 is always among them.
fn marks(span: f64) -> Vec<f64> {
    let wide = [0.01f64, 0.1, 1.0, 10.0, 100.0];
    let middle = [0.25, 0.5, 1.0, 2.0, 4.0];
    let close = [0.5, 0.7, 1.0, 1.4, 2.0];
    let narrow = [0.8, 0.9, 1.0, 1.1, 1.25];
    let marks = if span >= 10f64.ln() {
        wide
    } else if span >= 2f64.ln() {
        middle
    } else if span >= 1.45f64.ln() {
        close
    } else {
        narrow
    };
    marks.into_iter().filter(|m| m.ln().abs() <= span).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_show_the_verdict() {
        let of = |verdict, wrong: Option<&str>| {
            let wrong = wrong.map(str::to_string);
            Ratio { verdict, wrong, ..Ratio::default() }.color().0
        };
        for (verdict, color) in COLORS {
            assert_eq!(of(verdict, None), color);
            assert_eq!(of(verdict, Some("2 wrong")), WRONG);
        }
    }

    #[test]
    fn every_scale_has_three_marks_and_one_of_them_is_1() {
        for span in [1.3f64.ln(), 0.6, 0.7, 1.0, 2.0, 2.4, 5.0] {
            let marks = marks(span);
            assert!(marks.contains(&1.0) && marks.len() >= 3, "{span}: {marks:?}");
        }
        assert_eq!(Ratios::default().svg(), "");
    }
}
