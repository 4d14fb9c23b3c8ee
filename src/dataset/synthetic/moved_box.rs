//! A small room with one box that is somewhere else from some frame on.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::scene::{Scene, SceneBuilder};
use super::texture::Texture;
use crate::geometry::{Aabb, Pose};

/// Edge length of the box, m. It floats, so that free space can be seen on every side.
pub const EDGE_M: f32 = 0.4;
/// The centre of the box at first.
pub const BEFORE: Vec3 = Vec3::new(0.0, -0.4, 0.6);
/// The centre of the box after it moved.
pub const AFTER: Vec3 = Vec3::new(0.0, 0.6, 0.6);

/// The room with the box at a place, or without it.
pub fn scene(box_centre: Option<Vec3>) -> Scene {
    let mut scene =
        SceneBuilder::new(Aabb { min: Vec3::new(-2.0, -1.5, 0.0), max: Vec3::new(1.5, 1.5, 2.4) });
    scene.object("sideboard", "cabinet", [0.4, 0.26, 0.14], Texture::Planks { width: 0.1 }).block(
        [1.3, 0.0, 0.3],
        [0.44, 1.2, 0.7],
        0.0,
    );
    if let Some(centre) = box_centre {
        scene.object("moved box", "box", [0.7, 0.2, 0.15], Texture::Checker { size: 0.1 }).block(
            centre.to_array(),
            [EDGE_M; 3],
            0.0,
        );
    }
    scene.build()
}

/// The camera sways before the box; one sway lasts 60 frames.
pub fn sway(index: usize) -> Pose {
    let phase = TAU * index as f64 / 60.0;
    let eye = DVec3::new(-1.6, 0.8 * phase.sin(), 1.2 + 0.2 * phase.cos());
    Pose::looking_at(eye, DVec3::new(0.3, 0.1, 0.6), DVec3::Z)
}
