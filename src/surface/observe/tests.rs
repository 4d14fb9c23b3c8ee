//! The plane fit against planes that are known.

use super::*;
use crate::geometry::random::{normal, pcg4d};
use crate::surface::test_frame::frame;

/// World normal and offset of a wall 2 m ahead, turned away from the camera: n · p = d.
fn slanted() -> (Vec3, f32) {
    let n = Vec3::new(-1.0, 0.6, 0.3).normalize();
    (n, n.dot(Vec3::new(3.0, 2.0, 3.0)))
}

/// The z-depth at which a pixel's ray meets a world plane.
fn depth_of(plane: (Vec3, f32), focal: f64) -> impl Fn(u32, u32) -> f32 {
    let camera = frame(focal, |_, _| 0.0);
    move |u, v| {
        let origin = camera.world_point(u, v, 0.0);
        let direction = camera.world_point(u, v, 1.0) - origin;
        (plane.1 - plane.0.dot(origin)) / plane.0.dot(direction)
    }
}

fn observed(frame: &Frame) -> Vec<Observation> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    observe(frame, &DepthNoise::estimate(&frame.depth), 2, &pool)
}

/// Root mean square of the points' distances to a plane, m, and the largest angle of a normal, rad.
fn errors(observations: &[Observation], (n, d): (Vec3, f32)) -> (f32, f32) {
    let square: f32 = observations.iter().map(|o| (n.dot(o.point) - d).powi(2)).sum();
    let angle = |o: &Observation| o.normal.cross(n).length().atan2(o.normal.dot(n));
    let worst = observations.iter().map(angle).fold(0.0, f32::max);
    ((square / observations.len() as f32).sqrt(), worst)
}

#[test]
fn a_clean_plane_is_met_at_every_focal_length() {
    for focal in [100.0, 300.0, 600.0] {
        let clean = frame(focal, depth_of(slanted(), focal));
        let observations = observed(&clean);
        assert!(observations.len() > 4000, "{} at {focal}", observations.len());
        let (rms, angle) = errors(&observations, slanted());
        assert!(rms < 2e-4 && angle < 0.01, "{rms} m, {angle} rad at {focal}");
        assert!(observations.iter().all(|o| o.weight > 0.0 && o.weight <= 1.0));
    }
}

#[test]
fn noise_is_averaged_over_a_window_that_grows_with_it() {
    let exact = depth_of(slanted(), 300.0);
    for sigma in [0.01f32, 0.03] {
        let noisy = frame(300.0, |u, v| {
            let words = pcg4d([u, v, 7, 0]);
            exact(u, v) + sigma * normal(words[0], words[1])
        });
        let observations = observed(&noisy);
        assert!(observations.len() > 3000, "{} at {sigma}", observations.len());
        let (rms, angle) = errors(&observations, slanted());
        assert!(rms < 0.45 * sigma, "{rms} m of {sigma} m");
        assert!(angle < 1.0, "{angle} rad at {sigma}");
        let said: f32 =
            observations.iter().map(|o| o.sigma_m).sum::<f32>() / observations.len() as f32;
        assert!(rms / said < 2.0 && said / rms < 4.0, "says {said} m, is {rms} m");
    }
}

#[test]
fn nothing_is_seen_between_two_surfaces_or_along_one() {
    let step = frame(300.0, |u, _| if u < 80 { 1.0 } else { 2.0 });
    for o in observed(&step) {
        let depth = o.point.x - 1.0;
        assert!((depth - 1.0).abs() < 1e-3 || (depth - 2.0).abs() < 1e-3, "{depth} m");
        assert!((o.normal - Vec3::NEG_X).length() < 0.02, "{:?}", o.normal);
    }
    let grazing = Vec3::new(-0.05, 1.0, 0.0).normalize();
    let plane = (grazing, grazing.dot(Vec3::new(3.0, 2.0, 3.0)));
    let depths = depth_of(plane, 300.0);
    let edge_on = frame(300.0, |u, v| {
        let z = depths(u, v);
        if (0.2..9.0).contains(&z) { z } else { 0.0 }
    });
    let eye = Vec3::new(1.0, 2.0, 3.0);
    let cosine = |point: Vec3| -grazing.dot((point - eye).normalize());
    let seen = observed(&edge_on);
    assert!(seen.iter().all(|o| cosine(o.point) > 0.9 * MIN_COSINE));
    let flat = (0..120).flat_map(|v| (0..160).map(move |u| (u, v))).filter(|&(u, v)| {
        let z = edge_on.depth.at(u, v);
        z > 0.0 && cosine(edge_on.world_point(u, v, z)) < MIN_COSINE
    });
    assert!(flat.count() > 1000, "there was something to leave out");
}
