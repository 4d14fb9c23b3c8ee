//! Depth, shaded colour and classes of a scene, by casting a ray through every pixel centre.

use std::sync::Arc;

use glam::Vec3;

use super::scene::{Beam, Hit, Scene};
use crate::frame::{ColorImage, DepthImage, LabelImage};
use crate::geometry::{Intrinsics, Pose};

/// Steps of the table that turns linear light into 8-bit sRGB.
const SHADES: usize = 2048;
/// Side of a tile of rays that are culled together, pixels.
const TILE: usize = 16;

/// Draws scenes on one thread.
#[derive(Debug, Clone)]
pub struct Renderer {
    srgb: Vec<u8>,
}

impl Default for Renderer {
    fn default() -> Self {
        let srgb = (0..=SHADES).map(|i| encode(i as f32 / SHADES as f32)).collect();
        Self { srgb }
    }
}

impl Renderer {
    /// The z-depth of every pixel; without a return beyond `range_m`.
    pub fn depth(&self, scene: &Scene, k: &Intrinsics, pose: &Pose, range_m: f32) -> DepthImage {
        let mut metres = vec![0.0; k.pixels()];
        each_ray(scene, k, pose, |pixel, ray| {
            metres[pixel] = ray.hit.map_or(0.0, |hit| hit.t);
        });
        cut(&mut metres, range_m);
        DepthImage::from_metres(k.width, k.height, metres)
    }

    /// Depth as [`Renderer::depth`], with colour.
    pub fn depth_and_color(
        &self,
        scene: &Scene,
        k: &Intrinsics,
        pose: &Pose,
        range_m: f32,
    ) -> (DepthImage, ColorImage) {
        let mut metres = vec![0.0; k.pixels()];
        let mut rgb = vec![0; k.pixels() * 3];
        each_ray(scene, k, pose, |pixel, ray| {
            let Some(hit) = ray.hit else { return };
            metres[pixel] = hit.t;
            let albedo = scene.albedo(&hit, ray.origin + ray.direction * hit.t);
            let light = (albedo * illumination(hit.normal)).to_array();
            let shade = |c: f32| self.srgb[((c * SHADES as f32) as usize).min(SHADES)];
            rgb[pixel * 3..][..3].copy_from_slice(&light.map(shade));
        });
        cut(&mut metres, range_m);
        let color = ColorImage { width: k.width, height: k.height, rgb };
        (DepthImage::from_metres(k.width, k.height, metres), color)
    }

    /// The class of every pixel; none beyond `range_m`.
    pub fn labels(&self, scene: &Scene, k: &Intrinsics, pose: &Pose, range_m: f32) -> LabelImage {
        let mut ids = vec![0; k.pixels()];
        each_ray(scene, k, pose, |pixel, ray| {
            let seen = ray.hit.filter(|hit| hit.t <= range_m);
            ids[pixel] = seen.map_or(0, |hit| scene.class_id(hit.object));
        });
        let classes = Arc::clone(scene.classes());
        LabelImage { width: k.width, height: k.height, ids, classes }
    }
}

/// A pixel's ray in the world; its direction has z = 1 in camera axes.
struct Ray {
    origin: Vec3,
    direction: Vec3,
    hit: Option<Hit>,
}

/// Casts a ray through every pixel, tile by tile: what a tile can see is found once for its rays.
fn each_ray(scene: &Scene, k: &Intrinsics, pose: &Pose, mut visit: impl FnMut(usize, Ray)) {
    let (rotation, origin) = (pose.rotation_f32(), pose.position_f32());
    let mut beam = Beam::default();
    for top in (0..k.height).step_by(TILE) {
        for left in (0..k.width).step_by(TILE) {
            let (right, bottom) =
                ((left + TILE as u32).min(k.width), (top + TILE as u32).min(k.height));
            let corner = |u: u32, v: u32| rotation * k.direction(u as f32 - 0.5, v as f32 - 0.5);
            let corners = [
                corner(left, top),
                corner(right, top),
                corner(right, bottom),
                corner(left, bottom),
            ];
            // Clockwise corners around z: each cross product points into the pyramid.
            let planes = [0, 1, 2, 3].map(|i| corners[i].cross(corners[(i + 1) % 4]));
            scene.gather(origin, &planes, &mut beam);
            for v in top..bottom {
                for u in left..right {
                    let direction = rotation * k.direction(u as f32, v as f32);
                    let hit = scene.cast_in(&beam, origin, direction);
                    let pixel = v as usize * k.width as usize + u as usize;
                    visit(pixel, Ray { origin, direction, hit });
                }
            }
        }
    }
}

/// Depth beyond the camera's range has no return.
fn cut(metres: &mut [f32], range_m: f32) {
    for z in metres {
        if *z > range_m {
            *z = 0.0;
        }
    }
}

/// Soft light from above and a little from one side, the same from every viewpoint.
fn illumination(normal: Vec3) -> f32 {
    0.68 + 0.2 * normal.z + 0.1 * normal.x + 0.05 * normal.y
}

/// Linear light in 0..=1 to 8-bit sRGB (IEC 61966-2-1).
fn encode(linear: f32) -> u8 {
    let s =
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (s * 255.0 + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::super::room;
    use super::*;

    #[test]
    fn tiles_see_what_single_rays_see() {
        // Sides that no tile divides.
        let k = Intrinsics { fx: 60.0, fy: 60.0, cx: 36.0, cy: 24.5, width: 75, height: 50 };
        let (scene, renderer) = (room::scene(), Renderer::default());
        for share in [0.0, 0.3, 0.55, 0.8] {
            let pose = room::walk(share);
            let (depth, color) = renderer.depth_and_color(&scene, &k, &pose, 10.0);
            assert_eq!(depth, renderer.depth(&scene, &k, &pose, 10.0));
            for (v, u) in (0..k.height).flat_map(|v| (0..k.width).map(move |u| (v, u))) {
                let direction = pose.rotation_f32() * k.direction(u as f32, v as f32);
                let hit = scene.cast(pose.position_f32(), direction).expect("a closed room");
                assert_eq!(depth.at(u, v), hit.t, "({u}, {v}) at {share}");
            }
            assert!(color.rgb.iter().any(|&c| c > 200) && color.rgb.iter().any(|&c| c < 120));
            let near = renderer.depth(&scene, &k, &pose, 1.5);
            assert!(
                near.metres
                    .iter()
                    .zip(&depth.metres)
                    .all(|(&n, &z)| n == if z <= 1.5 { z } else { 0.0 })
            );
        }
    }

    #[test]
    fn light_is_encoded_as_srgb() {
        assert_eq!([0.0, 0.216, 1.0].map(encode), [0, 128, 255]);
    }
}
