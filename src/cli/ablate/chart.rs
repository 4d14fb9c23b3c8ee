//! A bar chart: groups side by side, a bar a series in each.

use svg::Document;
use svg::node::element::{Line, Rectangle, Text};

/// Pixels.
const WIDTH: f64 = 860.0;
const PLOT_HEIGHT: f64 = 260.0;
const LEFT: f64 = 52.0;
const TOP: f64 = 14.0;
const LINE_HEIGHT: f64 = 20.0;
/// Columns of the legend.
const LEGEND_COLUMNS: usize = 3;
const TICKS: usize = 4;

/// Told apart by those who confuse red and green, too (Wong, "Color blindness", Nature Methods 2011),
/// and two more.
const COLORS: [&str; 9] = [
    "#0072b2", "#e69f00", "#009e73", "#d55e00", "#cc79a7", "#56b4e9", "#8c8c84", "#f0e442",
    "#26282e",
];
const INK: &str = "#26282e";
const FAINT: &str = "#dcdcd8";

/// A bar in each group.
pub(super) struct Series<'a> {
    pub(super) name: &'a str,
    pub(super) values: Vec<f64>,
}

/// SVG. Values are 0 or more; what is not finite has no bar.
pub(super) fn chart(groups: &[&str], series: &[Series<'_>]) -> String {
    let largest = series.iter().flat_map(|s| &s.values).copied().filter(|v| v.is_finite());
    let top = round_up(largest.fold(0.0, f64::max));
    let legend_rows = series.len().div_ceil(LEGEND_COLUMNS) as f64;
    let height = TOP + PLOT_HEIGHT + LINE_HEIGHT * (2.0 + legend_rows);
    let base = TOP + PLOT_HEIGHT;
    let mut document = Document::new()
        .set("viewBox", (0.0, 0.0, WIDTH, height))
        .set("width", WIDTH)
        .set("height", height)
        .set("font-family", "system-ui, sans-serif")
        .set("font-size", 12);
    for tick in 0..=TICKS {
        let share = tick as f64 / TICKS as f64;
        let y = base - share * PLOT_HEIGHT;
        document = document
            .add(line((LEFT, y), (WIDTH, y)))
            .add(label(&number(top * share), (LEFT - 6.0, y + 4.0)).set("text-anchor", "end"));
    }
    let group_width = (WIDTH - LEFT) / groups.len().max(1) as f64;
    let bar_width = 0.84 * group_width / series.len().max(1) as f64;
    for (g, group) in groups.iter().enumerate() {
        let left = LEFT + g as f64 * group_width;
        for (s, Series { name, values }) in series.iter().enumerate() {
            let value = values.get(g).copied().filter(|v| v.is_finite()).unwrap_or(0.0);
            let bar_height = PLOT_HEIGHT * value / top;
            let x = left + 0.08 * group_width + s as f64 * bar_width;
            let bar = Rectangle::new()
                .set("x", x)
                .set("y", base - bar_height)
                .set("width", (bar_width - 1.0).max(1.0))
                .set("height", bar_height)
                .set("fill", color(s))
                .add(svg::node::element::Title::new(format!("{name}, {group}: {value:.3}")));
            document = document.add(bar);
        }
        let middle = (left + 0.5 * group_width, base + LINE_HEIGHT - 4.0);
        document = document.add(label(group, middle).set("text-anchor", "middle"));
    }
    for (s, Series { name, .. }) in series.iter().enumerate() {
        let x = LEFT + (s % LEGEND_COLUMNS) as f64 * (WIDTH - LEFT) / LEGEND_COLUMNS as f64;
        let y = base + LINE_HEIGHT * (2.0 + (s / LEGEND_COLUMNS) as f64);
        let square = Rectangle::new()
            .set("x", x)
            .set("y", y - 10.0)
            .set("width", 11)
            .set("height", 11)
            .set("fill", color(s));
        document = document.add(square).add(label(name, (x + 17.0, y)));
    }
    document.to_string()
}

fn color(series: usize) -> &'static str {
    COLORS[series % COLORS.len()]
}

fn line(from: (f64, f64), to: (f64, f64)) -> Line {
    Line::new()
        .set("x1", from.0)
        .set("y1", from.1)
        .set("x2", to.0)
        .set("y2", to.1)
        .set("stroke", FAINT)
}

fn label(text: &str, at: (f64, f64)) -> Text {
    Text::new(text).set("x", at.0).set("y", at.1).set("fill", INK)
}

/// The next 1, 2, 4 or 8 times a power of ten, so that ticks are round.
fn round_up(value: f64) -> f64 {
    if value <= 0.0 {
        return 1.0;
    }
    let power = 10f64.powf(value.log10().floor());
    [1.0, 2.0, 4.0, 8.0, 10.0]
        .into_iter()
        .map(|step| step * power)
        .find(|top| *top >= value * (1.0 - 1e-9))
        .unwrap_or(value)
}

fn number(value: f64) -> String {
    let digits = if value >= 10.0 || value == 0.0 { 0 } else { 2 };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_has_a_bar_of_its_height() {
        let series = [
            Series { name: "a < b", values: vec![2.0, 4.0] },
            Series { name: "c", values: vec![f64::NAN, 1.0] },
        ];
        let text = chart(&["none", "σ"], &series);
        // Four bars and two squares of the legend.
        assert_eq!(text.matches("<rect").count(), 6, "{text}");
        for height in ["130", "260", "65"] {
            assert!(text.contains(&format!("height=\"{height}\"")), "{height} in {text}");
        }
        assert!(text.contains("a &lt; b") && !text.contains("NaN"), "{text}");
    }

    #[test]
    fn axes_end_at_round_numbers() {
        let expected =
            [(0.0, 1.0), (0.03, 0.04), (1.0, 1.0), (3.1, 4.0), (8.5, 10.0), (28.0, 40.0)];
        for (value, top) in expected {
            assert!((round_up(value) - top).abs() < 1e-9, "{value}: {}", round_up(value));
        }
    }
}
