//! Poses of a body, as planners send them.

use bytemuck::{Pod, Zeroable};
use glam::{Quat, Vec3};

/// `world_from_body`: x y z in metres, then the unit quaternion x y z w.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Waypoint {
    pub translation: [f32; 3],
    pub rotation: [f32; 4],
}

impl Waypoint {
    /// A pose without rotation.
    pub fn at(position: Vec3) -> Self {
        Self { translation: position.to_array(), rotation: [0.0, 0.0, 0.0, 1.0] }
    }

    #[inline]
    pub(super) fn position(&self) -> Vec3 {
        Vec3::from(self.translation)
    }

    /// Of unit length.
    #[inline]
    pub(super) fn rotation(&self) -> Quat {
        Quat::from_array(self.rotation).normalize()
    }
}
