//! Round numbers for axes and scale bars.

/// The largest of 1, 2, 5 times a power of ten that is not above `value` (positive).
pub(super) fn round_down(value: f32) -> f32 {
    // Half a percent of slack takes 0.99999 for 1.
    let value = value * 1.005;
    let exponent = value.log10().floor() as i32;
    // Whole powers are exact and division is correctly rounded, so that 0.05 is 0.05 everywhere.
    let power = 10f32.powi(exponent.abs());
    let step = |lead: f32| if exponent < 0 { lead / power } else { lead * power };
    [5.0, 2.0].map(step).into_iter().find(|&step| value >= step).unwrap_or(step(1.0))
}

/// Multiples of a round step within [low, high], about `count` of them.
pub(super) fn ticks(low: f32, high: f32, count: f32) -> Vec<f32> {
    let step = round_down((high - low) / count);
    let slack = step * 1e-3;
    let first = ((low - slack) / step).ceil() as i32;
    let last = ((high + slack) / step).floor() as i32;
    (first..=last).map(|i| i as f32 * step).collect()
}

/// A number with the digits that a step of `step` needs.
pub(super) fn label(value: f32, step: f32) -> String {
    let digits = (-(step * 1.005).log10().floor()).max(0.0) as usize;
    // No "-0".
    let value = if value.abs() < step * 1e-3 { 0.0 } else { value };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_round_and_within_range() {
        for (value, expected) in
            [(1.0, 1.0), (0.99999, 1.0), (3.7, 2.0), (0.07, 0.05), (60.0, 50.0)]
        {
            assert_eq!(round_down(value), expected, "{value}");
        }
        assert_eq!(
            ticks(-2.1, 4.1, 7.0),
            [-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]
        );
        assert_eq!(ticks(0.0, 1.0, 5.0).len(), 6);
    }

    #[test]
    fn labels_have_the_digits_of_their_step() {
        assert_eq!(label(0.5, 0.5), "0.5");
        assert_eq!(label(-0.0, 0.5), "0.0");
        assert_eq!(label(2.0, 1.0), "2");
        assert_eq!(label(0.05, 0.05), "0.05");
        assert_eq!(label(-20.0, 20.0), "-20");
    }
}
