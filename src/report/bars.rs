//! Horizontal bars in groups, with intervals.

use super::svg::{AXIS, Anchor, COLORS, GRID, Svg, WRONG, number, text_width, ticks};

/// A chart: one group per thing measured, one bar per contestant.
#[derive(Debug, Clone, Default)]
pub struct Bars {
    /// Heading.
    pub title: String,
    /// What the numbers are: `Mray/s, more is better`.
    pub unit: String,
    /// Contestants, in the order of their bars.
    pub names: Vec<String>,
    /// From top to bottom.
    pub groups: Vec<Group>,
}

/// Bars of one thing.
#[derive(Debug, Clone)]
pub struct Group {
    /// Beside the bars.
    pub label: String,
    /// One per contestant.
    pub bars: Vec<Bar>,
}

/// One bar.
#[derive(Debug, Clone, Default)]
pub struct Bar {
    /// Its length; NaN where nothing is known.
    pub value: f64,
    /// Ends of its interval; none for exact numbers.
    pub interval: Option<[f64; 2]>,
    /// Why it does not count: shown in red.
    pub wrong: Option<String>,
}

const WIDTH: f64 = 550.0;
const BAR: f64 = 15.0;
const GAP: f64 = 12.0;

impl Bars {
    /// The chart as SVG; empty without bars.
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

/// A tick's number without zeros at its end.
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
            groups: vec![Group { label: "primary".into(), bars: vec![bar(10.0), bar(5.0)] }],
        }
    }

    #[test]
    fn lengths_are_in_proportion_and_names_are_safe() {
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
    fn what_is_wrong_is_red_and_says_so() {
        let mut chart = chart();
        chart.groups[0].bars[1].wrong = Some("3 wrong".into());
        let svg = chart.svg();
        assert!(svg.contains(WRONG) && svg.contains("3 wrong"));
        assert_eq!(Bars::default().svg(), "");
    }
}
