//! A chart of horizontal bars in groups, with intervals.

use super::svg::{AXIS, Anchor, COLORS, GRID, Svg, WRONG, number, text_width, ticks};

/// A bar chart: one group for each measurement, one bar in it for each backend.
#[derive(Debug, Clone, Default)]
pub struct Bars {
    /// Heading of the chart.
    pub title: String,
    /// Unit of the bars and its direction: `Mray/s, more is better`.
    pub unit: String,
    /// Names of the backends, in the order of their bars in each group.
    pub names: Vec<String>,
    /// The groups from top to bottom.
    pub groups: Vec<BarGroup>,
}

/// The bars of one measurement.
#[derive(Debug, Clone)]
pub struct BarGroup {
    /// Text at the left of the bars.
    pub label: String,
    /// The bars from top to bottom, in the order of [`Bars::names`].
    pub bars: Vec<Bar>,
}

/// One bar of a group, with its interval.
#[derive(Debug, Clone, Default)]
pub struct Bar {
    /// Length of the bar; NaN if the value is unknown.
    pub value: f64,
    /// Lower and upper end of the interval; `None` for an exact number.
    pub interval: Option<[f64; 2]>,
    /// Reason why the value does not count, shown in red.
    pub wrong: Option<String>,
}

const WIDTH: f64 = 550.0;
const BAR: f64 = 15.0;
const GAP: f64 = 12.0;

impl Bars {
    /// Returns the chart as SVG, or an empty string without bars.
    pub fn svg(&self) -> String {
        let bars = || self.groups.iter().flat_map(|g| &g.bars);
        if bars().next().is_none() {
            return String::new();
        }
        let widest = self.groups.iter().map(|g| text_width(&g.label)).fold(0.0, f64::max);
        let left = widest + 12.0;
        let ends = bars().map(|b| b.interval.map_or(b.value, |[_, high]| high.max(b.value)));
        let ticks = ticks(ends.filter(|v| v.is_finite()).fold(0.0, f64::max));
        let most = ticks[ticks.len() - 1];
        let notes = bars()
            .filter_map(|b| b.wrong.as_deref())
            .map(|t| 1.25 * text_width(t))
            .fold(0.0, f64::max);
        let right = WIDTH - 52.0 - notes;
        let x = |value: f64| left + (right - left) * value / most;
        let mut svg = Svg::new(WIDTH);
        svg.text([0.0, 16.0], Anchor::Start, "title", &self.title);
        svg.text([0.0, 34.0], Anchor::Start, "dim", &self.unit);
        let names: Vec<_> = self.names.iter().cloned().zip(COLORS.into_iter().cycle()).collect();
        let top = 66.0 + svg.legend([left, 52.0], &names);
        let heights = self.groups.iter().map(|g| g.bars.len() as f64 * BAR + GAP);
        let bottom = top + heights.sum::<f64>();
        for tick in &ticks {
            svg.line([x(*tick), top, x(*tick), bottom], GRID, 1.0);
            svg.text([x(*tick), bottom + 15.0], Anchor::Middle, "dim", &axis(*tick));
        }
        let mut y = top + GAP / 2.0;
        for group in &self.groups {
            let middle = y + group.bars.len() as f64 * BAR / 2.0 + 4.0;
            svg.text([left - 8.0, middle], Anchor::End, "", &group.label);
            for (bar, (_, color)) in group.bars.iter().zip(&names) {
                draw(&mut svg, bar, color, y, &x);
                y += BAR;
            }
            y += GAP;
        }
        svg.line([left, top, left, bottom], AXIS, 1.0);
        svg.finish(bottom + 24.0, &format!("{}: {}", self.title, self.unit))
    }
}

fn draw(svg: &mut Svg, bar: &Bar, color: &str, y: f64, x: &impl Fn(f64) -> f64) {
    let color = if bar.wrong.is_some() { WRONG } else { color };
    let (start, end, middle) = (x(0.0), x(bar.value), y + BAR / 2.0);
    if bar.value.is_nan() {
        return svg.text([start + 6.0, middle + 4.0], Anchor::Start, "dim", "not counted");
    }
    svg.rect([start, y + 1.0, end - start, BAR - 2.0], color);
    let mut after = end;
    if let Some([low, high]) = bar.interval {
        svg.whisker([x(low), x(high)], middle);
        after = after.max(x(high));
    }
    let label = number(bar.value);
    svg.text([after + 6.0, middle + 4.0], Anchor::Start, "", &label);
    if let Some(wrong) = &bar.wrong {
        svg.text([after + 14.0 + text_width(&label), middle + 4.0], Anchor::Start, "wrong", wrong);
    }
}

/// Formats the value of a tick without trailing zeros.
fn axis(tick: f64) -> String {
    let text = number(tick);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_string(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Bars {
        let bar = |value| Bar { value, interval: Some([value * 0.9, value * 1.1]), wrong: None };
        Bars {
            title: "Rays".into(),
            unit: "Mray/s".into(),
            names: vec!["a<b".into(), "c".into()],
            groups: vec![BarGroup { label: "primary".into(), bars: vec![bar(10.0), bar(5.0)] }],
        }
    }

    #[test]
    fn bars_are_proportional_and_names_are_escaped() {
        let svg = chart().svg();
        let widths: Vec<f64> = svg
            .lines()
            .filter(|line| line.contains("<rect") && line.contains("height=\"13.0\""))
            .filter_map(|line| line.split("width=\"").nth(1)?.split('"').next()?.parse().ok())
            .collect();
        assert_eq!(widths.len(), 2);
        assert!((widths[0] / widths[1] - 2.0).abs() < 0.01, "{widths:?}");
        assert!(svg.contains("a&lt;b") && !svg.contains("a<b"));
        assert!(!svg.contains(WRONG));
    }

    #[test]
    fn a_wrong_bar_is_red_with_its_reason() {
        let mut chart = chart();
        chart.groups[0].bars[1].wrong = Some("3 wrong".into());
        let svg = chart.svg();
        assert!(svg.contains(WRONG) && svg.contains("3 wrong"));
        assert_eq!(Bars::default().svg(), "");
    }
}
