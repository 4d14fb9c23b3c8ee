//! Boxes that stand upright around points.

use std::f32::consts::FRAC_PI_2;

use glam::{Quat, Vec2, Vec3};

/// A box that stands upright and is turned about the vertical, as furniture is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    /// World metres.
    pub center: Vec3,
    /// World from box.
    pub rotation: Quat,
    /// Along the box's own axes, m.
    pub half_size: Vec3,
}

/// Directions that are tried, over a right angle.
const TURNS: usize = 45;

impl OrientedBox {
    /// The small box whose sides most points lie close to, each of which stands for a cube of `size_m`:
    /// of a thing in a corner only two sides are seen, and the smallest box around those may stand
    /// askew.
    pub(super) fn around(points: &[Vec3], size_m: f32) -> Self {
        let angles = (0..TURNS).map(|turn| turn as f32 * FRAC_PI_2 / TURNS as f32);
        let fit = |angle: f32| fit(points, angle, 0.5 * size_m);
        let best = angles.map(|angle| (fit(angle), angle)).max_by(|a, b| a.0.total_cmp(&b.0));
        let angle = best.map_or(0.0, |(_, angle)| angle);
        let (low, high) = bounds(points, angle);
        let rotation = Quat::from_rotation_z(angle);
        let half_size = 0.5 * (high - low + size_m);
        Self { center: rotation * (0.5 * (low + high)), rotation, half_size }
    }
}

/// A point along axes that are turned by `angle`.
fn turned(point: &Vec3, angle: f32) -> Vec3 {
    let axis = Vec2::from_angle(angle);
    Vec3::new(axis.dot(point.truncate()), axis.perp_dot(point.truncate()), point.z)
}

/// The corners of the box around points whose axes are turned by `angle`.
fn bounds(points: &[Vec3], angle: f32) -> (Vec3, Vec3) {
    let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
    for own in points.iter().map(|point| turned(point, angle)) {
        (low, high) = (low.min(own), high.max(own));
    }
    (low, high)
}

/// How close points lie to the upright sides of the box that is turned by `angle`, for its footprint;
/// nearer than `least_m` is as close as can be.
fn fit(points: &[Vec3], angle: f32, least_m: f32) -> f32 {
    let (low, high) = bounds(points, angle);
    let size = high - low + 2.0 * least_m;
    let one = |point: &Vec3| {
        let own = turned(point, angle);
        let side = (own - low).min(high - own);
        1.0 / side.x.min(side.y).max(least_m)
    };
    points.iter().map(one).sum::<f32>() / (size.x * size.y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_box_is_found() {
        let turn = Quat::from_rotation_z(0.5);
        let corner = |i: usize| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            Vec3::new(3.0, -2.0, 1.0)
                + turn * (Vec3::new(sign(0), sign(1), sign(2)) * Vec3::new(1.0, 0.4, 0.25))
        };
        let points: Vec<Vec3> = (0..8).map(corner).collect();
        let found = OrientedBox::around(&points, 0.1);
        assert!((found.center - Vec3::new(3.0, -2.0, 1.0)).length() < 1e-4, "{found:?}");
        let mut sides = found.half_size.to_array();
        sides.sort_by(f32::total_cmp);
        for (side, expected) in sides.into_iter().zip([0.3, 0.45, 1.05]) {
            assert!((side - expected).abs() < 0.02, "{found:?}");
        }
        let inside = |p: &Vec3| {
            let own = found.rotation.inverse() * (*p - found.center);
            (own.abs() - found.half_size).max_element() < 0.0
        };
        assert!(points.iter().all(inside));
        // Two sides of a box that is seen from a corner.
        let side = |i: usize| (i % 10) as f32 * 0.1;
        let seen: Vec<Vec3> =
            (0..20)
                .map(|i| {
                    if i < 10 { Vec3::new(side(i), 0.0, 1.0) } else { Vec3::new(0.0, side(i), 1.0) }
                })
                .map(|point| turn * point)
                .collect();
        let found = OrientedBox::around(&seen, 0.1);
        assert!(found.rotation.angle_between(turn) < 0.03, "{found:?}");
        let one = OrientedBox::around(&[Vec3::ONE], 0.2);
        assert!((one.half_size - 0.1).abs().max_element() < 1e-6, "{one:?}");
    }
}
