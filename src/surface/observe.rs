//! A depth frame turned into oriented surface points.
//!
//! On a plane the inverse depth is linear in the pixel, so that a least-squares fit of 1/z over a
//! window gives point and normal at once, and averages the noise. The window grows with the noise.

#[cfg(test)]
mod tests;

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::noise::DepthNoise;
use crate::frame::Frame;

/// One oriented surface point of one frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    /// World metres.
    pub(super) point: Vec3,
    /// Unit normal in world axes, towards the camera.
    pub(super) normal: Vec3,
    /// Confidence within (0, 1]: falls with the square of the depth.
    pub(super) weight: f32,
    /// Standard deviation of the point along the normal, m.
    pub(super) sigma_m: f32,
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

/// Narrow first; a quarter of a degree to two degrees for a focal length of 500 pixels.
const WINDOWS: [Window; 4] = [
    Window { reach: 2, step: 1 },
    Window { reach: 4, step: 2 },
    Window { reach: 8, step: 2 },
    Window { reach: 16, step: 4 },
];
/// A window reaches at least this far, radians: fine images are averaged over what coarse ones see
/// in one pixel.
const MIN_REACH: f32 = 0.006;

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
    let wide_enough = |w: &&Window| {
        let reach = w.reach as f32;
        sigma <= MAX_TILT * reach * metres_per_pixel && reach >= MIN_REACH * k.fx as f32
    };
    let window = WINDOWS.iter().find(wide_enough).unwrap_or(&WINDOWS[3]);
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

/// Most pixels of a window.
const MAX_PIXELS: usize = 81;

/// The returns of a window, as offsets from its centre and inverse depths.
struct Returns {
    offsets: [(f32, f32); MAX_PIXELS],
    inverse: [f32; MAX_PIXELS],
    len: usize,
    /// Pixels of the window, with or without a return.
    pixels: usize,
}

impl Returns {
    fn gather(frame: &Frame, u: i32, v: i32, window: Window) -> Self {
        let depth = &frame.depth;
        let (width, height) = (depth.width as i32, depth.height as i32);
        let mut returns = Self {
            offsets: [(0.0, 0.0); MAX_PIXELS],
            inverse: [0.0; MAX_PIXELS],
            len: 0,
            pixels: 0,
        };
        for dv in (-window.reach..=window.reach).step_by(window.step) {
            for du in (-window.reach..=window.reach).step_by(window.step) {
                returns.pixels += 1;
                let (u, v) = (u + du, v + dv);
                if u < 0 || v < 0 || u >= width || v >= height {
                    continue;
                }
                let z = depth.at(u as u32, v as u32);
                if z > 0.0 {
                    returns.offsets[returns.len] = (du as f32, dv as f32);
                    returns.inverse[returns.len] = 1.0 / z;
                    returns.len += 1;
                }
            }
        }
        returns
    }

    /// Drops the returns that do not belong.
    fn keep(&mut self, belongs: impl Fn(f32, f32, f32) -> bool) {
        let mut kept = 0;
        for i in 0..self.len {
            let ((du, dv), inverse) = (self.offsets[i], self.inverse[i]);
            if belongs(du, dv, inverse) {
                self.offsets[kept] = (du, dv);
                self.inverse[kept] = inverse;
                kept += 1;
            }
        }
        self.len = kept;
    }

    /// The least-squares plane.
    fn plane(&self) -> Option<Plane> {
        let (mut n, mut r) = ([0.0f32; 6], Vec3::ZERO);
        for (&(du, dv), &inverse) in self.offsets[..self.len].iter().zip(&self.inverse) {
            for (sum, term) in n.iter_mut().zip([1.0, du, dv, du * du, du * dv, dv * dv]) {
                *sum += term;
            }
            r += Vec3::new(inverse, inverse * du, inverse * dv);
        }
        let normal = Mat3::from_cols_array(&[n[0], n[1], n[2], n[1], n[3], n[4], n[2], n[4], n[5]]);
        let determinant = normal.determinant();
        if self.len < 6 || determinant.abs() < 1e-3 {
            return None;
        }
        // A whole window is symmetric: the matrix is diagonal.
        let coefficients = if n[1] == 0.0 && n[2] == 0.0 && n[4] == 0.0 {
            r / Vec3::new(n[0], n[3], n[5])
        } else {
            normal.inverse() * r
        };
        Some(Plane { coefficients: coefficients.to_array(), inliers: self.len as u32 })
    }
}

impl Plane {
    /// Fits to all that may belong to the centre's surface and, if some of that does not lie on
    /// the plane, once more to what does.
    fn fit(frame: &Frame, u: i32, v: i32, window: Window, sigma: f32) -> Option<Self> {
        let z = frame.depth.at(u as u32, v as u32);
        let spacing = z / frame.intrinsics.fx as f32;
        let mut returns = Returns::gather(frame, u, v, window);
        // A surface at 80 degrees rises by 6 spacings a pixel.
        returns.keep(|du, dv, inverse| {
            let rise = (du.abs() + dv.abs()) * spacing;
            (1.0 - z * inverse).abs() <= (6.0 * rise + 4.0 * sigma) * inverse
        });
        let mut plane = returns.plane()?;
        let [a, b, c] = plane.coefficients;
        let gate = 3.0 * sigma + 0.001 + 0.25 * window.reach as f32 * spacing;
        returns.keep(|du, dv, inverse| {
            let fitted = a + b * du + c * dv;
            (fitted - inverse).abs() <= gate * fitted * inverse
        });
        if returns.len < plane.inliers as usize {
            plane = returns.plane()?;
        }
        let a = plane.coefficients[0];
        let believable = a > 0.0 && (1.0 / a - z).abs() <= 4.0 * sigma + 0.5 * gate;
        let enough = plane.inliers as f32 >= MIN_INLIERS * returns.pixels as f32;
        (believable && enough).then_some(plane)
    }
}
