//! Parts of the world: boxes along its axes, and balls.

use glam::Vec3;

use super::Aabb;

/// A part of the world, in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Region {
    Box(Aabb),
    Sphere { center: Vec3, radius_m: f32 },
}

impl Region {
    /// Whether a point lies inside or on the border.
    pub fn contains(&self, point: Vec3) -> bool {
        match self {
            Self::Box(aabb) => aabb.contains(point),
            Self::Sphere { center, radius_m } => point.distance(*center) <= *radius_m,
        }
    }

    /// Whether it has a part of the inside of a box.
    pub fn touches(&self, other: &Aabb) -> bool {
        match self {
            Self::Box(aabb) => other.min.cmplt(aabb.max).all() && other.max.cmpgt(aabb.min).all(),
            Self::Sphere { center, radius_m } => {
                center.distance(center.clamp(other.min, other.max)) < *radius_m
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_only_borders_is_not_touched() {
        let aabb = |min: f32, max: f32| Aabb { min: Vec3::splat(min), max: Vec3::splat(max) };
        let cube = Region::Box(aabb(0.0, 1.0));
        let ball = Region::Sphere { center: Vec3::splat(0.5), radius_m: 0.5 };
        for region in [cube, ball] {
            assert!(region.contains(Vec3::splat(0.5)) && !region.contains(Vec3::splat(1.1)));
            assert!(region.touches(&aabb(0.6, 2.0)) && region.touches(&aabb(-9.0, 9.0)));
            assert!(!region.touches(&aabb(1.0, 2.0)));
        }
        let corner = aabb(0.9, 2.0);
        assert!(cube.touches(&corner) && !ball.touches(&corner));
    }
}
