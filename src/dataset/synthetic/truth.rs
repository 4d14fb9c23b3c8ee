//! Points with known distance, drawn where a sequence looked.

use glam::Vec3;

use super::Synthetic;
use crate::dataset::Dataset;
use crate::geometry::Pose;
use crate::geometry::random::{pcg4d, unit};

/// Keeps this stream of random numbers apart from others.
const STREAM: u32 = 0x7472_7574;

/// A point whose signed distance is known exactly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TruthPoint {
    pub point: Vec3,
    /// Signed distance to the nearest surface, m; negative inside.
    pub distance: f32,
    /// Unit vector towards increasing distance.
    pub gradient: Vec3,
    /// Whether the frames see the nearest point of the surface.
    pub closest_observed: bool,
}

/// Where to draw points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Region {
    /// Within `band_m` of a seen surface, on both sides.
    Near { band_m: f32 },
    /// In seen free space, at least `clear_m` from any surface.
    Far { clear_m: f32 },
}

/// Draws `count` points along random pixels of the frames `frames` (indices of `data`), in the
/// scene as it is at the last of them. Each lies in seen free space or, for [`Region::Near`], close
/// behind a seen surface. Fewer come back if the frames hardly see such a region.
pub fn points(
    data: &Synthetic,
    frames: &[usize],
    region: Region,
    count: usize,
    seed: u32,
) -> Vec<TruthPoint> {
    let poses: Vec<Pose> = frames.iter().map(|&i| data.pose(i)).collect();
    let k = data.intrinsics();
    let Some(&last) = frames.last() else { return Vec::new() };
    let scene = data.scene(last);
    let mut points = Vec::with_capacity(count);
    // A region that the scene hardly has must not keep this going for ever.
    for i in 0..(count as u32).saturating_mul(64) {
        if points.len() == count {
            break;
        }
        let random = pcg4d([seed, STREAM, 0, i]);
        let pose = &poses[(unit(random[0]) * poses.len() as f32) as usize];
        let (u, v) = (unit(random[1]) * k.width as f32, unit(random[2]) * k.height as f32);
        let direction = pose.rotation_f32() * k.direction(u - 0.5, v - 0.5);
        let Some(hit) = scene.cast(pose.position_f32(), direction) else { continue };
        if hit.t > data.range_m() {
            continue;
        }
        let share = unit(random[3]);
        let surface = pose.position_f32() + direction * hit.t;
        let point = match region {
            Region::Near { band_m } => surface + hit.normal * band_m * (2.0 * share - 1.0),
            Region::Far { .. } => pose.position_f32() + direction * (hit.t * share),
        };
        let nearest = scene.nearest(point);
        let inside = match region {
            Region::Near { band_m } => nearest.distance.abs() <= band_m && scene.is_exact(point),
            Region::Far { clear_m } => nearest.distance >= clear_m,
        };
        if inside {
            let foot = point - nearest.gradient * nearest.distance;
            let closest_observed = poses.iter().any(|pose| sees(data, last, pose, foot));
            let (distance, gradient) = (nearest.distance, nearest.gradient);
            points.push(TruthPoint { point, distance, gradient, closest_observed });
        }
    }
    points
}

/// Whether a point of the surface is in the image, in range and not hidden.
fn sees(data: &Synthetic, frame: usize, pose: &Pose, point: Vec3) -> bool {
    let k = data.intrinsics();
    let eye = pose.position_f32();
    let local = pose.rotation_f32().transpose() * (point - eye);
    let Some((u, v)) = k.project(local) else { return false };
    let inside = u >= -0.5
        && v >= -0.5
        && u < k.width as f32 - 0.5
        && v < k.height as f32 - 0.5
        && local.z <= data.range_m();
    // A millimetre at two metres: more than rounding, less than any part of a scene.
    inside && data.scene(frame).cast(eye, point - eye).is_some_and(|hit| hit.t > 0.9995)
}
