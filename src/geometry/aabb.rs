//! Axis-aligned boxes in world metres.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use super::MAX_COORDINATE_M;

/// An axis-aligned box, `min <= max` on every axis, in world metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    pub min: Vec3,
    pub max: Vec3,
}

impl Aabb {
    /// The box that contains nothing; [`Aabb::extend`] makes it grow.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// Grows the box to contain `point`.
    pub fn extend(&mut self, point: Vec3) {
        self.min = self.min.min(point);
        self.max = self.max.max(point);
    }

    /// The smallest box around both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether `point` lies inside or on the border.
    pub fn contains(&self, point: Vec3) -> bool {
        point.cmpge(self.min).all() && point.cmple(self.max).all()
    }

    /// Whether no point lies inside.
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// Whether it is empty, or lies where maps lie.
    pub fn is_within_reach(&self) -> bool {
        let reach = 2.0 * MAX_COORDINATE_M as f32;
        let is_near = |corner: Vec3| corner.is_finite() && corner.abs().max_element() <= reach;
        *self == Self::EMPTY || (is_near(self.min) && is_near(self.max))
    }

    /// The edge lengths, m.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }
}
