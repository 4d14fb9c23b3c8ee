//! A depth frame turned into oriented surface points.
//!
//! On a plane the inverse depth is linear in the pixel, so that a least-squares fit of 1/z over a
//! window gives point and normal at once, and averages the noise. The window grows with the noise.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::noise::DepthNoise;
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
    /// Standard deviation of the point along the normal, m.
    pub sigma_m: f32,
}

/// Depth up to which an observation has full weight, m.
const FULL_WEIGHT_DEPTH_M: f32 = 1.5;
/// Surfaces seen more obliquely than this (cosine) are left out: their normals are noise.
const MIN_COSINE: f32 = 0.1;
/// A window wide enough that the noise tilts the plane by less than this (radians).
const MAX_TILT: f32 = 0.35;
/// The share of a window's pixels that must lie on one plane; fewer is an edge.
const MIN_INLIERS: f32 = 0.7;

/// Pixels to either side of the centre, and how far apart the pixels of the fit are.
#[derive(Debug, Clone, Copy)]
struct Window {
    reach: i32,
    step: usize,
}

/// Narrow first; about half a degree, one and two degrees for a focal length of 500 pixels.
const WINDOWS: [Window; 3] =
    [Window { reach: 4, step: 2 }, Window { reach: 8, step: 2 }, Window { reach: 16, step: 4 }];

/// Oriented points of every `stride`-th pixel in u and v, in row-major order. Pixels at depth
/// edges are left out, since their neighbours lie on different surfaces.
pub(super) fn observe(
    frame: &Frame,
    noise: &DepthNoise,
    stride: u32,
    pool: &rayon::ThreadPool,
) -> Vec<Observation> {
    let k = &frame.intrinsics;
    let rotation = frame.world_from_camera.rotation_f32();
    let origin = frame.world_from_camera.position_f32();
    let rows: Vec<u32> = (stride / 2..k.height).step_by(stride as usize).collect();
    let per_row = |v: u32| -> Vec<Observation> {
        (stride / 2..k.width)
            .step_by(stride as usize)
            .filter_map(|u| oriented_point(frame, noise, u, v))
            .map(|o| Observation {
                point: rotation * o.point + origin,
                normal: rotation * o.normal,
                ..o
            })
            .collect()
    };
    let parts: Vec<Vec<Observation>> =
        pool.install(|| rows.par_iter().with_min_len(8).map(|&v| per_row(v)).collect());
    parts.concat()
}

/// The point and unit normal of a pixel in camera axes; `None` without a return, at a depth edge,
/// or where the surface is seen edge-on.
fn oriented_point(frame: &Frame, noise: &DepthNoise, u: u32, v: u32) -> Option<Observation> {
    let k = &frame.intrinsics;
    let z = frame.depth.at(u, v);
    if z <= 0.0 {
        return None;
    }
    let sigma = noise.sigma_m(z);
    let metres_per_pixel = z / k.fx as f32;
    let wide_enough = |w: &&Window| sigma <= MAX_TILT * w.reach as f32 * metres_per_pixel;
    let window = WINDOWS.iter().find(wide_enough).unwrap_or(&WINDOWS[2]);
    let plane = Plane::fit(frame, u as i32, v as i32, *window, sigma)?;
    let [a, b, c] = plane.coefficients;
    let (du, dv) = (u as f32 - k.cx as f32, v as f32 - k.cy as f32);
    let toward = Vec3::new(b * k.fx as f32, c * k.fy as f32, a - b * du - c * dv);
    // n·P = D with positive D points away from the camera.
    let normal = -toward.normalize_or_zero();
    let point = k.direction(u as f32, v as f32) / a;
    let cosine = -normal.dot(point) / point.length();
    if cosine.is_nan() || cosine <= MIN_COSINE {
        return None;
    }
    let weight = (FULL_WEIGHT_DEPTH_M / point.z).min(1.0);
    let sigma_m = sigma * cosine / (plane.inliers as f32).sqrt();
    Some(Observation { point, normal, weight: weight * weight, sigma_m })
}

/// 1/z = a + b (u − u₀) + c (v − v₀).
struct Plane {
    coefficients: [f32; 3],
    inliers: u32,
}

impl Plane {
    /// Fits twice: to all that may belong to the centre's surface, then to what lies on the plane.
    fn fit(frame: &Frame, u: i32, v: i32, window: Window, sigma: f32) -> Option<Self> {
        let z = frame.depth.at(u as u32, v as u32);
        let spacing = z / frame.intrinsics.fx as f32;
        // A surface at 80 degrees rises by 6 spacings a pixel.
        let first = Self::solve(frame, (u, v), window, |du, dv, other| {
            let rise = (du.abs() + dv.abs()) as f32 * spacing;
            (other - z).abs() <= 6.0 * rise + 4.0 * sigma
        })?;
        let [a, b, c] = first.coefficients;
        let gate = 3.0 * sigma + 0.001 + 0.25 * window.reach as f32 * spacing;
        let plane = Self::solve(frame, (u, v), window, |du, dv, other| {
            let inverse = a + b * du as f32 + c * dv as f32;
            (other * inverse - 1.0).abs() <= gate * inverse
        })?;
        let side = (2 * window.reach / window.step as i32 + 1) as f32;
        let a = plane.coefficients[0];
        let believable = a > 0.0 && (1.0 / a - z).abs() <= 4.0 * sigma + 0.5 * gate;
        (believable && plane.inliers as f32 >= MIN_INLIERS * side * side).then_some(plane)
    }

    /// Least squares over the window's pixels that `belongs` lets in.
    fn solve(
        frame: &Frame,
        (u, v): (i32, i32),
        window: Window,
        belongs: impl Fn(i32, i32, f32) -> bool,
    ) -> Option<Self> {
        let (width, height) = (frame.depth.width as i32, frame.depth.height as i32);
        let mut normal = Mat3::ZERO;
        let mut right = Vec3::ZERO;
        let mut inliers = 0;
        for dv in (-window.reach..=window.reach).step_by(window.step) {
            for du in (-window.reach..=window.reach).step_by(window.step) {
                if !(0..width).contains(&(u + du)) || !(0..height).contains(&(v + dv)) {
                    continue;
                }
                let z = frame.depth.at((u + du) as u32, (v + dv) as u32);
                if z > 0.0 && belongs(du, dv, z) {
                    let row = Vec3::new(1.0, du as f32, dv as f32);
                    normal += Mat3::from_cols(row, row * row.y, row * row.z);
                    right += row / z;
                    inliers += 1;
                }
            }
        }
        if inliers < 6 || normal.determinant().abs() < 1e-3 {
            return None;
        }
        let solution = normal.inverse() * right;
        Some(Self { coefficients: solution.to_array(), inliers })
    }
}
