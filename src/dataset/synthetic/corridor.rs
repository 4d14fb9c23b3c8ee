//! A corridor of any length with things along its sides: a map that grows while the view stays
//! the same.

use glam::{DVec3, Vec3};

use super::scene::{Scene, SceneBuilder};
use super::texture::Texture;
use crate::geometry::random::{pcg4d, unit};
use crate::geometry::{Aabb, Pose};

const HALF_WIDTH_M: f32 = 1.2;
const HEIGHT_M: f32 = 2.6;
/// One thing stands in each bay, left and right in turn.
const BAY_M: f32 = 1.5;

/// A corridor from x = 0 to `length_m`, floor at z = 0.
pub fn scene(length_m: f32) -> Scene {
    let mut scene = SceneBuilder::new(Aabb {
        min: Vec3::new(0.0, -HALF_WIDTH_M, 0.0),
        max: Vec3::new(length_m, HALF_WIDTH_M, HEIGHT_M),
    });
    for bay in 0..((length_m / BAY_M) as u32).saturating_sub(1) {
        let random = pcg4d([bay, 0, 0, 23]);
        let side = if bay % 2 == 0 { 1.0 } else { -1.0 };
        let x = (bay as f32 + 1.0 + 0.3 * (unit(random[1]) - 0.5)) * BAY_M;
        thing(&mut scene, random[0] % 5, bay, [x, side]);
    }
    scene.build()
}

/// The camera at a step of `step_m` along the corridor, looking ahead and from side to side.
pub fn walk(index: usize, step_m: f64) -> Pose {
    let x = 0.8 + index as f64 * step_m;
    let eye = DVec3::new(x, 0.2 * (0.7 * x).sin(), 1.4);
    let yaw = 0.6 * (1.1 * x).sin();
    let gaze = DVec3::new(yaw.cos(), yaw.sin(), -0.15);
    Pose::looking_at(eye, eye + gaze, DVec3::Z)
}

/// The number of steps that leave the camera clear of the end.
pub fn steps(length_m: f32, step_m: f64) -> usize {
    (((f64::from(length_m) - 2.0) / step_m) as usize).max(1)
}

fn thing(scene: &mut SceneBuilder, kind: u32, bay: u32, [x, side]: [f32; 2]) {
    let wall = side * HALF_WIDTH_M;
    let at = |inward: f32, z: f32| [x, wall - side * inward, z];
    match kind {
        0 => scene
            .object(format!("cabinet {bay}"), "cabinet", [0.4, 0.42, 0.45], Texture::Plain)
            .block(at(0.15, 0.45), [0.8, 0.4, 1.1], 0.0)
            .sphere(at(0.36, 0.7), 0.03),
        1 => scene
            .object(
                format!("bench {bay}"),
                "bench",
                [0.45, 0.28, 0.14],
                Texture::Planks { width: 0.1 },
            )
            .block(at(0.2, 0.43), [1.0, 0.36, 0.05], 0.0)
            .cylinder([x - 0.4, wall - side * 0.2, -0.1], 0.03, 0.53)
            .cylinder([x + 0.4, wall - side * 0.2, -0.1], 0.03, 0.53),
        2 => scene
            .object(
                format!("plant {bay}"),
                "plant",
                [0.1, 0.4, 0.12],
                Texture::Speckles { size: 0.04 },
            )
            .sphere(at(0.3, 0.8), 0.24)
            .cylinder(at(0.3, 0.3), 0.02, 0.4)
            .object(format!("plant pot {bay}"), "pot", [0.6, 0.28, 0.16], Texture::Plain)
            .cylinder(at(0.3, -0.05), 0.17, 0.4),
        3 => scene
            .object(
                format!("boxes {bay}"),
                "box",
                [0.6, 0.45, 0.25],
                Texture::Stripes { size: 0.15 },
            )
            .block(at(0.3, 0.15), [0.5, 0.4, 0.4], 0.2)
            .block(at(0.28, 0.48), [0.34, 0.3, 0.3], -0.3),
        _ => scene
            .object(
                format!("notice board {bay}"),
                "picture",
                [0.7, 0.5, 0.3],
                Texture::Speckles { size: 0.1 },
            )
            .block(at(0.0, 1.5), [0.9, 0.06, 0.7], 0.0)
            .object(format!("bin {bay}"), "bin", [0.5, 0.52, 0.55], Texture::Plain)
            .cylinder(at(0.2, -0.05), 0.14, 0.5),
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_clear() {
        let scene = scene(30.0);
        for i in 0..steps(30.0, 0.1) {
            let eye = walk(i, 0.1).position_f32();
            assert!(scene.distance(eye) > 0.2, "{} m at {eye}", scene.distance(eye));
        }
    }
}
