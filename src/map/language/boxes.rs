//! Boxes that stand upright around points.

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
    /// The box of the smallest footprint around points, each of which stands for a cube of `size_m`.
    pub(super) fn around(points: &[Vec3], size_m: f32) -> Self {
        let turned = |turn: usize| {
            let angle = turn as f32 * std::f32::consts::FRAC_PI_2 / TURNS as f32;
            (angle, bounds(points, angle))
        };
        let area = |(low, high): (Vec3, Vec3)| (high.x - low.x) * (high.y - low.y);
        let grown = |(low, high): (Vec3, Vec3)| (low - 0.5 * size_m, high + 0.5 * size_m);
        let (angle, (low, high)) = (0..TURNS)
            .map(turned)
            .map(|(angle, bounds)| (angle, grown(bounds)))
            .min_by(|a, b| area(a.1).total_cmp(&area(b.1)))
            .unwrap_or((0.0, (Vec3::ZERO, Vec3::ZERO)));
        let rotation = Quat::from_rotation_z(angle);
        Self { center: rotation * (0.5 * (low + high)), rotation, half_size: 0.5 * (high - low) }
    }
}

/// The corners of the box around points whose axes are turned by `angle`.
fn bounds(points: &[Vec3], angle: f32) -> (Vec3, Vec3) {
    let axis = Vec2::from_angle(angle);
    let (mut low, mut high) = (Vec3::MAX, Vec3::MIN);
    for point in points {
        let own = Vec3::new(axis.dot(point.truncate()), axis.perp_dot(point.truncate()), point.z);
        (low, high) = (low.min(own), high.max(own));
    }
    (low, high)
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
        let one = OrientedBox::around(&[Vec3::ONE], 0.2);
        assert!((one.half_size - 0.1).abs().max_element() < 1e-6, "{one:?}");
    }
}
