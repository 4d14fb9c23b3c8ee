//! Spheres: what robots are made of for planners.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A sphere, as planners send it: x y z r.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Sphere {
    /// Metres, in the world or in a body's frame.
    pub center: Vec3,
    pub radius_m: f32,
}
