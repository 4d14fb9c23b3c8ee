//! One measured figure, and what it is held against.

use serde::Serialize;

/// The unit of a value; JSON has it as it is, a table in the size that reads best.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub(super) enum Unit {
    #[serde(rename = "m")]
    Metres,
    #[serde(rename = "rad")]
    Radians,
    #[serde(rename = "share")]
    Share,
    #[serde(rename = "s")]
    Seconds,
    #[serde(rename = "ms")]
    Milliseconds,
    #[serde(rename = "frames/s")]
    FramesPerSecond,
    #[serde(rename = "points/s")]
    PointsPerSecond,
    /// A ratio of two values.
    #[serde(rename = "times")]
    Times,
    /// Of a peak signal-to-noise ratio.
    #[serde(rename = "dB")]
    Decibels,
    #[serde(rename = "bytes")]
    Bytes,
    #[serde(rename = "count")]
    Count,
}

impl Unit {
    /// A value with its unit, for people.
    pub(super) fn show(self, value: f64) -> String {
        if !value.is_finite() {
            return "-".to_owned();
        }
        match self {
            Self::Metres => format!("{:.2} mm", value * 1e3),
            Self::Radians => format!("{value:.3} rad"),
            Self::Share => format!("{:.2} %", value * 1e2),
            Self::Seconds => format!("{value:.1} s"),
            Self::Milliseconds => format!("{value:.2} ms"),
            Self::FramesPerSecond => format!("{value:.1} frames/s"),
            Self::PointsPerSecond => format!("{:.2} M points/s", value * 1e-6),
            Self::Times => format!("{value:.2} times"),
            Self::Decibels => format!("{value:.1} dB"),
            Self::Bytes => format!("{:.1} MB", value * 1e-6),
            Self::Count => format!("{value:.0}"),
        }
    }
}

/// Which side of a target is good.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Bound {
    AtMost,
    AtLeast,
}

/// What a value must reach, and what it had better reach.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Target {
    #[serde(rename = "target")]
    limit: f64,
    bound: Bound,
    #[serde(skip_serializing_if = "Option::is_none")]
    aim: Option<f64>,
}

impl Target {
    pub(super) const fn at_most(limit: f64) -> Self {
        Self { limit, bound: Bound::AtMost, aim: None }
    }

    pub(super) const fn at_least(limit: f64) -> Self {
        Self { limit, bound: Bound::AtLeast, aim: None }
    }

    pub(super) const fn aiming_at(self, aim: f64) -> Self {
        Self { aim: Some(aim), ..self }
    }

    /// A value that is not a number meets nothing.
    pub(super) fn is_met_by(&self, value: f64) -> bool {
        match self.bound {
            Bound::AtMost => value <= self.limit,
            Bound::AtLeast => value >= self.limit,
        }
    }

    /// The target and the verdict, for people.
    pub(super) fn show(&self, value: f64, unit: Unit) -> String {
        let side = match self.bound {
            Bound::AtMost => "at most",
            Bound::AtLeast => "at least",
        };
        let aim = self.aim.map(|aim| format!(", aim {}", unit.show(aim))).unwrap_or_default();
        let verdict = if self.is_met_by(value) { "met" } else { "MISSED" };
        format!("{verdict}: {side} {}{aim}", unit.show(self.limit))
    }
}

/// One measured figure.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Figure {
    /// What was measured: data, settings.
    pub(super) case: String,
    /// Which of its numbers: words with underscores.
    pub(super) measure: String,
    pub(super) value: f64,
    pub(super) unit: Unit,
    pub(super) target: Option<Target>,
}

impl Figure {
    pub(super) fn new(case: &str, measure: impl Into<String>, value: f64, unit: Unit) -> Self {
        Self { case: case.to_owned(), measure: measure.into(), value, unit, target: None }
    }

    pub(super) fn against(self, target: Option<Target>) -> Self {
        Self { target, ..self }
    }
}

/// The middle value; the mean of the two in the middle of an even number; NaN of none.
pub(super) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    match (sorted.get(sorted.len() / 2), sorted.len() % 2) {
        (None, _) => f64::NAN,
        (Some(&middle), 1) => middle,
        (Some(&upper), _) => (sorted[sorted.len() / 2 - 1] + upper) * 0.5,
    }
}

/// The value below which a share of the others lies; NaN of none.
pub(super) fn percentile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let index = (share * sorted.len() as f64).ceil().max(1.0) as usize - 1;
    sorted.get(index).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn targets_have_a_good_side() {
        let (low, high) = (Target::at_most(2.0), Target::at_least(2.0));
        assert!(low.is_met_by(2.0) && low.is_met_by(1.0) && !low.is_met_by(2.1));
        assert!(high.is_met_by(2.0) && high.is_met_by(3.0) && !high.is_met_by(1.9));
        assert!(!low.is_met_by(f64::NAN) && !high.is_met_by(f64::NAN));
    }

    #[test]
    fn values_and_targets_are_shown_in_units_that_read_well() {
        let near = Target::at_most(0.0035).aiming_at(0.002);
        assert_eq!(near.show(0.003, Unit::Metres), "met: at most 3.50 mm, aim 2.00 mm");
        assert!(near.show(f64::NAN, Unit::Metres).starts_with("MISSED"));
        assert_eq!(Unit::PointsPerSecond.show(2.5e6), "2.50 M points/s");
        assert_eq!(Unit::Share.show(f64::NAN), "-");
    }

    #[test]
    fn medians() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert!(median(&[]).is_nan());
    }

    #[test]
    fn percentiles_are_values_that_were_measured() {
        let values: Vec<f64> = (1..=100).rev().map(f64::from).collect();
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|p| percentile(&values, p)), [1.0, 50.0, 99.0, 100.0]);
        assert_eq!(percentile(&[7.0], 0.99), 7.0);
        assert!(percentile(&[], 0.5).is_nan());
    }
}
