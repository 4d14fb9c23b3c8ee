//! A depth frame turned into oriented surface points.

use glam::Vec3;
use rayon::prelude::*;

use crate::frame::Frame;

/// One oriented surface point of one frame.
#[derive(Debug, Clone, Copy)]
pub struct Observation {
    /// World metres.
    pub point: Vec3,
    /// Unit normal in world axes, towards the camera.
    pub normal: Vec3,
    /// Confidence within (0, 1]: falls with the square of the depth.
    pub weight: f32,
    /// z-depth, m.
    pub depth: f32,
}

/// Depth up to which an observation has full weight, m.
const FULL_WEIGHT_DEPTH_M: f32 = 1.5;
/// Surfaces seen more obliquely than this (cosine) are left out: their normals are noise.
const MIN_COSINE: f32 = 0.1;

/// Oriented points of every `stride`-th pixel in u and v, in row-major order. Pixels at depth
/// edges are left out, since their neighbours lie on different surfaces.
pub fn observe(frame: &Frame, stride: u32, pool: &rayon::ThreadPool) -> Vec<Observation> {
    let k = &frame.intrinsics;
    let reach = normal_reach(k.fx as f32);
    let rotation = frame.world_from_camera.rotation_f32();
    let origin = frame.world_from_camera.position_f32();
    let first = reach.next_multiple_of(stride);
    let rows: Vec<u32> = (first..k.height.saturating_sub(reach)).step_by(stride as usize).collect();
    let per_row = |v: u32| -> Vec<Observation> {
        (first..k.width.saturating_sub(reach))
            .step_by(stride as usize)
            .filter_map(|u| {
                let (point, normal) = oriented_point(frame, u, v, reach)?;
                let weight = (FULL_WEIGHT_DEPTH_M / point.z).min(1.0);
                Some(Observation {
                    point: rotation * point + origin,
                    normal: rotation * normal,
                    weight: weight * weight,
                    depth: point.z,
                })
            })
            .collect()
    };
    let parts: Vec<Vec<Observation>> =
        pool.install(|| rows.par_iter().with_min_len(8).map(|&v| per_row(v)).collect());
    parts.concat()
}

/// How many pixels to either side a normal is taken over: about half a degree, at least 2.
fn normal_reach(fx: f32) -> u32 {
    ((fx * 0.0075).round() as u32).clamp(2, 8)
}

/// The point and unit normal of a pixel in camera axes, from the central differences over `reach`
/// pixels; `None` without a return, at a depth edge, or where the surface is seen edge-on.
fn oriented_point(frame: &Frame, u: u32, v: u32, reach: u32) -> Option<(Vec3, Vec3)> {
    let k = &frame.intrinsics;
    let z = frame.depth.at(u, v);
    if z <= 0.0 {
        return None;
    }
    let spacing = reach as f32 * z / k.fx as f32;
    let pair = |a: (u32, u32), b: (u32, u32)| -> Option<Vec3> {
        let (za, zb) = (frame.depth.at(a.0, a.1), frame.depth.at(b.0, b.1));
        if za <= 0.0 || zb <= 0.0 {
            return None;
        }
        // A bend of more than the lateral spacing, or a slope beyond about 80 degrees, is an edge.
        let bend = (za + zb - 2.0 * z).abs();
        if bend > spacing + 0.004 || (zb - za).abs() > 12.0 * spacing {
            return None;
        }
        Some(k.direction(b.0 as f32, b.1 as f32) * zb - k.direction(a.0 as f32, a.1 as f32) * za)
    };
    let du = pair((u - reach, v), (u + reach, v))?;
    let dv = pair((u, v - reach), (u, v + reach))?;
    // x right, y down, z forward: dv × du points to the camera.
    let normal = dv.cross(du).normalize_or_zero();
    let point = k.direction(u as f32, v as f32) * z;
    let cosine = -normal.dot(point) / point.length();
    (cosine > MIN_COSINE).then_some((point, normal))
}
