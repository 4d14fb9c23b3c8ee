//! Errors of the distance, its gradient and the occupancy at points whose truth is known.

use std::f64::consts::FRAC_PI_2;

use super::report::{FieldErrors, Occupancy, Ranges};
use super::truth::SdfTruth;
use crate::map::{PointAnswers, State};

/// Whether the map knows point `i`.
fn is_known(answers: &PointAnswers, i: usize) -> bool {
    answers.state[i] != State::Unknown as u8 && answers.distance[i].is_finite()
}

/// The figures of the paper's table for a field that was asked at `truth.points`.
pub(super) fn field_errors(truth: &SdfTruth, answers: &PointAnswers) -> FieldErrors {
    let known = |i: usize| is_known(answers, i);
    let error = |i: usize| f64::from((answers.distance[i] - truth.distances[i]).abs());
    let sign = |i: usize| f64::from(same_side(answers.distance[i], truth.distances[i]));
    let sign = by_range(truth, |i| known(i).then(|| sign(i)), mean);
    FieldErrors {
        sdf_mae_m: by_range(truth, |i| known(i).then(|| error(i)), mean),
        sdf_p95_m: by_range(truth, |i| known(i).then(|| error(i)), percentile_95),
        gradient_mae_rad: by_range(truth, |i| known(i).then(|| angle(truth, answers, i)), mean),
        sign_accuracy_near: sign.near,
        sign_accuracy_near_observed: sign.near_observed,
        known_share: by_range(truth, |i| Some(f64::from(u8::from(known(i)))), mean),
    }
}

/// The classification rate of the occupancy at known points; `None` for a map without occupancy.
pub(super) fn occupancy(truth: &SdfTruth, answers: &PointAnswers) -> Option<Occupancy> {
    if answers.occupancy.is_empty() {
        return None;
    }
    let known = |i: usize| is_known(answers, i) && answers.occupancy[i].is_finite();
    let right: Vec<f64> = (0..truth.points.len())
        .filter(|&i| known(i))
        .map(|i| f64::from(u8::from((answers.occupancy[i] > 0.5) == (truth.distances[i] < 0.0))))
        .collect();
    let known_share = right.len() as f64 / truth.points.len() as f64;
    (!right.is_empty()).then(|| Occupancy { accuracy: mean(right), known_share })
}

fn same_side(a: f32, b: f32) -> u8 {
    u8::from((a < 0.0) == (b < 0.0))
}

/// The angle between the gradients, rad; a gradient without a direction is as good as none.
fn angle(truth: &SdfTruth, answers: &PointAnswers, i: usize) -> f64 {
    let (a, b) = (answers.gradient[i].as_dvec3(), truth.gradients[i].as_dvec3());
    let angle = a.cross(b).length().atan2(a.dot(b));
    let directed = a.is_finite() && a.length_squared() > 0.0;
    if directed { angle } else { FRAC_PI_2 }
}

/// One figure over each range of the truth; `value` is `None` where a point does not count.
fn by_range(
    truth: &SdfTruth,
    value: impl Fn(usize) -> Option<f64>,
    figure: impl Fn(Vec<f64>) -> f64,
) -> Ranges {
    let over = |member: &dyn Fn(usize) -> bool| {
        figure((0..truth.points.len()).filter(|&i| member(i)).filter_map(&value).collect())
    };
    let (near, seen) = (&truth.near, &truth.closest_observed);
    Ranges {
        near: over(&|i| near[i]),
        near_observed: over(&|i| near[i] && seen[i]),
        far: over(&|i| !near[i]),
        far_observed: over(&|i| !near[i] && seen[i]),
        all: over(&|_| true),
        all_observed: over(&|i| seen[i]),
    }
}

fn mean(values: Vec<f64>) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn percentile_95(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let rank = (values.len() * 95).div_ceil(100).clamp(1, values.len()) - 1;
    *values.select_nth_unstable_by(rank, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Five points: near observed, near observed, near unobserved, far observed, far unobserved.
    fn truth() -> SdfTruth {
        SdfTruth {
            points: vec![Vec3::ZERO; 5],
            distances: vec![0.05, -0.05, 0.02, 0.5, 0.8],
            gradients: vec![Vec3::X; 5],
            near: vec![true, true, true, false, false],
            closest_observed: vec![true, true, false, true, false],
        }
    }

    fn perfect() -> PointAnswers {
        PointAnswers {
            distance: truth().distances,
            gradient: truth().gradients,
            occupancy: vec![0.1, 0.9, 0.1, 0.0, 0.0],
            state: vec![1, 2, 1, 1, 1],
            ..PointAnswers::default()
        }
    }

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-6
    }

    #[test]
    fn the_truth_itself_is_perfect() {
        let errors = field_errors(&truth(), &perfect());
        assert_eq!(errors.sdf_mae_m.all, 0.0);
        assert_eq!(errors.gradient_mae_rad.all_observed, 0.0);
        assert_eq!(errors.sign_accuracy_near, 1.0);
        assert_eq!(errors.known_share.near_observed, 1.0);
        assert_eq!(occupancy(&truth(), &perfect()).expect("has it").accuracy, 1.0);
    }

    #[test]
    fn errors_land_in_their_ranges() {
        let mut answers = perfect();
        answers.distance = vec![0.06, -0.02, 0.04, 0.4, 1.1];
        let mae = field_errors(&truth(), &answers).sdf_mae_m;
        assert!(close(mae.near, 0.06 / 3.0) && close(mae.near_observed, 0.04 / 2.0), "{mae:?}");
        assert!(close(mae.far, 0.4 / 2.0) && close(mae.far_observed, 0.1), "{mae:?}");
        assert!(close(mae.all, 0.46 / 5.0) && close(mae.all_observed, 0.14 / 3.0), "{mae:?}");
        assert!(close(field_errors(&truth(), &answers).sdf_p95_m.near, 0.03));
    }

    #[test]
    fn unknown_points_leave_the_means_and_lower_the_known_share() {
        let mut answers = perfect();
        answers.distance[0] = f32::NAN;
        answers.state[0] = 0;
        // A distance under an unknown state is a number that nobody promised.
        answers.distance[3] = 99.0;
        answers.state[3] = 0;
        let errors = field_errors(&truth(), &answers);
        assert_eq!(errors.sdf_mae_m.near, 0.0);
        assert!(errors.sdf_mae_m.far_observed.is_nan(), "nothing is left to average");
        assert!(close(errors.known_share.near, 2.0 / 3.0));
        assert!(close(errors.known_share.near_observed, 0.5));
        assert!(close(errors.known_share.far_observed, 0.0));
        assert!(close(errors.known_share.all, 0.6));
    }

    #[test]
    fn gradients_are_judged_by_angle_not_by_length() {
        let mut answers = perfect();
        answers.gradient =
            vec![Vec3::X * 7.0, Vec3::Y, -Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::ZERO];
        let errors = field_errors(&truth(), &answers).gradient_mae_rad;
        assert!(close(errors.near_observed, FRAC_PI_2 / 2.0), "{errors:?}");
        assert!(close(errors.near, (FRAC_PI_2 + 2.0 * FRAC_PI_2) / 3.0), "{errors:?}");
        assert!(close(errors.far_observed, FRAC_PI_2 / 2.0), "{errors:?}");
        assert!(close(errors.far, FRAC_PI_2 * 0.75), "no direction counts as a right angle");
    }

    #[test]
    fn wrong_signs_and_wrong_occupancy_are_counted() {
        let mut answers = perfect();
        answers.distance[1] = 0.001;
        answers.occupancy[3] = 0.6;
        let errors = field_errors(&truth(), &answers);
        assert!(close(errors.sign_accuracy_near, 2.0 / 3.0));
        assert!(close(errors.sign_accuracy_near_observed, 0.5));
        assert!(close(occupancy(&truth(), &answers).expect("has it").accuracy, 0.8));
        answers.occupancy = vec![f32::NAN; 5];
        assert!(occupancy(&truth(), &answers).is_none());
    }
}
