//! `geometry.proto`: poses, cameras, boxes.

use glam::{DQuat, DVec3, Vec3};

use super::v1;
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Intrinsics, Pose};

/// A part of a message that must be there.
pub(super) fn required<T>(field: &str, part: Option<T>) -> Result<T> {
    part.ok_or_else(|| Error::invalid(field, "is required"))
}

/// `world_from_camera`; range and unit length are checked by [`Pose::from_quaternion`].
pub(super) fn pose_from_wire(pose: v1::Pose) -> Result<Pose> {
    let t = required("world_from_camera.translation", pose.translation)?;
    let q = required("world_from_camera.rotation", pose.rotation)?;
    Pose::from_quaternion(DQuat::from_xyzw(q.x, q.y, q.z, q.w), DVec3::new(t.x, t.y, t.z))
}

pub(super) fn pose_to_wire(pose: &Pose) -> v1::Pose {
    let (t, q) = (pose.translation, pose.rotation);
    v1::Pose {
        translation: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
        rotation: Some(v1::Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
    }
}

/// Values are judged where the whole frame is, in [`crate::frame::Frame::check`].
pub(super) fn intrinsics_from_wire(k: v1::Intrinsics) -> Intrinsics {
    Intrinsics { fx: k.fx, fy: k.fy, cx: k.cx, cy: k.cy, width: k.width, height: k.height }
}

pub(super) fn intrinsics_to_wire(k: &Intrinsics) -> v1::Intrinsics {
    v1::Intrinsics { fx: k.fx, fy: k.fy, cx: k.cx, cy: k.cy, width: k.width, height: k.height }
}

/// An empty box has no numbers worth sending.
pub(super) fn aabb_to_wire(aabb: &Aabb) -> Option<v1::Aabb> {
    let corner = |p: Vec3| v1::Vector3 { x: f64::from(p.x), y: f64::from(p.y), z: f64::from(p.z) };
    (!aabb.is_empty())
        .then(|| v1::Aabb { min: Some(corner(aabb.min)), max: Some(corner(aabb.max)) })
}

pub(super) fn aabb_from_wire(aabb: Option<v1::Aabb>) -> Aabb {
    let corner = |p: v1::Vector3| Vec3::new(p.x as f32, p.y as f32, p.z as f32);
    match aabb.and_then(|b| b.min.zip(b.max)) {
        Some((min, max)) => Aabb { min: corner(min), max: corner(max) },
        None => Aabb::EMPTY,
    }
}
