//! A chart of lines over two logarithmic axes, for values that grow or shrink by powers.

use super::svg::{Anchor, COLORS, GRID, Svg, decades, prefixed};

/// A line chart with two logarithmic axes.
#[derive(Debug, Clone, Default)]
pub struct LineChart {
    /// Heading of the chart.
    pub title: String,
    /// Quantity and unit of the vertical axis.
    pub unit: String,
    /// Quantity and unit of the horizontal axis.
    pub across: String,
    /// The lines, one for each name in the legend.
    pub lines: Vec<ChartLine>,
    /// Single points for each line, drawn in its colour. Both coordinates > 0.
    pub dots: Vec<Vec<[f64; 2]>>,
    /// Value > 0 on the vertical axis that a horizontal line marks, and the label of the line.
    pub level: Option<(f64, String)>,
}

/// One line of the chart.
#[derive(Debug, Clone)]
pub struct ChartLine {
    /// Name of the line in the legend.
    pub name: String,
    /// Points (x, y) from left to right, both coordinates > 0.
    pub points: Vec<[f64; 2]>,
}

const WIDTH: f64 = 550.0;
const HEIGHT: f64 = 300.0;

impl LineChart {
    /// Returns the chart as SVG, or an empty string if no line has two points.
    pub fn svg(&self) -> String {
        if self.lines.iter().all(|line| line.points.len() < 2) {
            return String::new();
        }
        let range = |axis: usize| {
            let lines = self.lines.iter().flat_map(|l| &l.points);
            let values = lines.chain(self.dots.iter().flatten()).map(|p| p[axis]);
            let level = self.level.iter().map(|(height, _)| *height).filter(|_| axis == 1);
            let values: Vec<f64> = values.chain(level).collect();
            let least = values.iter().copied().fold(f64::INFINITY, f64::min);
            decades(least, values.iter().copied().fold(0.0, f64::max))
        };
        let (across, up) = (range(0), range(1));
        let mut svg = Svg::new(WIDTH);
        let (left, right) = (64.0, WIDTH - 20.0);
        let names: Vec<_> =
            self.lines.iter().map(|l| l.name.clone()).zip(COLORS.into_iter().cycle()).collect();
        let more = svg.legend([left, 52.0], &names);
        let (top, height) = (66.0 + more, HEIGHT + more);
        let bottom = height - 40.0;
        let part = |marks: &[f64], v: f64| {
            (v / marks[0]).log10() / (marks[marks.len() - 1] / marks[0]).log10()
        };
        let x = |v: f64| left + (right - left) * part(&across, v);
        let y = |v: f64| bottom - (bottom - top) * part(&up, v);
        svg.text([0.0, 16.0], Anchor::Start, "title", &self.title);
        svg.text([0.0, 34.0], Anchor::Start, "dim", &self.unit);
        for mark in &across {
            svg.line([x(*mark), top, x(*mark), bottom], GRID, 1.0);
            svg.text([x(*mark), bottom + 15.0], Anchor::Middle, "dim", &prefixed(*mark));
        }
        for mark in &up {
            svg.line([left, y(*mark), right, y(*mark)], GRID, 1.0);
            svg.text([left - 6.0, y(*mark) + 4.0], Anchor::End, "dim", &prefixed(*mark));
        }
        svg.text([(left + right) / 2.0, height - 6.0], Anchor::Middle, "dim", &self.across);
        if let Some((height, text)) = &self.level {
            svg.line([left, y(*height), right, y(*height)], "#9aa3ad", 1.5);
            svg.text([left + 6.0, y(*height) - 5.0], Anchor::Start, "dim", text);
        }
        for (dots, (_, color)) in self.dots.iter().zip(&names) {
            for &[px, py] in dots {
                svg.circle([x(px), y(py)], 2.0, color);
            }
        }
        for (line, (_, color)) in self.lines.iter().zip(&names) {
            for pair in line.points.windows(2) {
                let [[ax, ay], [bx, by]] = [pair[0], pair[1]];
                svg.line([x(ax), y(ay), x(bx), y(by)], color, 2.0);
            }
            for &[px, py] in &line.points {
                svg.circle([x(px), y(py)], 3.5, color);
            }
        }
        svg.finish(height, &format!("{}: {}", self.title, self.unit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_needs_two_points() {
        let line = |points: &[[f64; 2]]| ChartLine { name: "a".into(), points: points.to_vec() };
        let chart = |points| LineChart { lines: vec![line(points)], ..LineChart::default() };
        assert_eq!(chart(&[[1e3, 0.1]]).svg(), "");
        let svg = chart(&[[1e3, 0.1], [1e6, 20.0]]).svg();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert!(!svg.contains("NaN"), "{svg}");
    }

    #[test]
    fn dots_and_the_level_lie_within_the_axes() {
        let line = ChartLine { name: "a".into(), points: vec![[1.0, 1.0], [10.0, 0.1]] };
        let mut chart = LineChart { lines: vec![line], ..LineChart::default() };
        chart.dots = vec![vec![[100.0, 50.0]]];
        chart.level = Some((1e-6, "noise < floor".into()));
        let svg = chart.svg();
        assert_eq!(svg.matches("<circle").count(), 3);
        for part in ["noise &lt; floor", ">1e-6<", ">100<"] {
            assert!(svg.contains(part), "{part}: {svg}");
        }
    }
}
