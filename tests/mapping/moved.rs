//! A box that moves or vanishes is gone from state, distance and surface within 15 frames, and stays
//! gone while idle.

use std::time::Duration;

use glam::Vec3;

use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::moved_box::{AFTER, BEFORE, EDGE_M};
use orenx::dataset::synthetic::truth::{Region, points};
use orenx::map::{Fields, MapView, Mapper, State, extract_mesh, query_pool};

use super::{integrate, lite};

/// Frames before the box moves, and those that it may take to be gone.
const AT: usize = 40;
const PATIENCE: usize = 15;

/// Points on a grid in a cube of `edge` around `centre`.
fn cube(centre: Vec3, edge: f32) -> Vec<Vec3> {
    const N: i32 = 9;
    let step = edge / (N - 1) as f32;
    let axis = |i: i32| (i as f32) * step - edge * 0.5;
    (0..N * N * N)
        .map(|i| centre + Vec3::new(axis(i % N), axis(i / N % N), axis(i / N / N)))
        .collect()
}

fn share(view: &MapView, points: &[Vec3], wanted: State) -> f32 {
    let answers = view.query(points, Fields::ALL);
    let hits = answers.state.iter().filter(|&&s| s == wanted as u8).count();
    hits as f32 / points.len() as f32
}

/// Vertices of the mesh in a cube.
fn surface_in(view: &MapView, centre: Vec3, edge: f32) -> usize {
    let pool = query_pool(1).unwrap();
    let mesh = extract_mesh(view, &view.surface_leaves(), 0.04, &pool).unwrap();
    let within = |v: &&Vec3| (**v - centre).abs().max_element() < 0.5 * edge;
    mesh.vertices.iter().filter(within).count()
}

/// The box is not where it was, and what it hid is there.
fn check_gone(view: &MapView, data: &Synthetic, now: usize, when: &str) {
    let old = cube(BEFORE, EDGE_M + 0.04);
    let free = share(view, &old, State::Free);
    assert!(free > 0.99, "{when}: {free} of the old place is free");
    assert_eq!(surface_in(view, BEFORE, EDGE_M + 0.06), 0, "{when}: surface at the old place");
    let scene = data.scene(now);
    let distances = view.query(&old, Fields::DISTANCE).distance;
    let error = |(p, d): (&Vec3, &f32)| (d - scene.distance(*p)).abs();
    let mean = old.iter().zip(&distances).filter(|(_, d)| d.is_finite()).map(error).sum::<f32>()
        / old.len() as f32;
    assert!(mean < 0.005, "{when}: distance at the old place errs by {mean} m");
}

fn check_background(view: &MapView, data: &Synthetic, frames: &[usize]) {
    let near = points(data, frames, Region::Near { band_m: 0.08 }, 6000, 3);
    // What the box hid from where the camera sways: behind it, away from the camera.
    let hidden: Vec<_> = near
        .iter()
        .filter(|t| t.closest_observed && t.point.x > 0.3 && (-1.2..0.0).contains(&t.point.y))
        .collect();
    assert!(hidden.len() > 100, "{} points", hidden.len());
    let at: Vec<Vec3> = hidden.iter().map(|t| t.point).collect();
    let answers = view.query(&at, Fields::ALL);
    let (mut error, mut known, mut sign) = (0.0, 0.0f32, 0.0f32);
    for (t, &d) in hidden.iter().zip(&answers.distance).filter(|(_, d)| d.is_finite()) {
        known += 1.0;
        error += (d - t.distance).abs();
        sign += f32::from((d < 0.0) == (t.distance < 0.0));
    }
    let (share, mean, sign) = (known / hidden.len() as f32, error / known, sign / known);
    assert!(share > 0.98 && mean < 0.0030 && sign > 0.98, "{share} {mean} {sign}");
}

fn follow(data: &Synthetic) -> Mapper {
    let mut config = lite(1);
    config.rays_per_step = 1024;
    let mut mapper = Mapper::new(config).unwrap();
    integrate(&mut mapper, data, 0..AT);
    let view = mapper.publish();
    let side = BEFORE - Vec3::new(0.5 * EDGE_M - 0.03, 0.0, 0.0);
    assert_eq!(share(&view, &[side], State::Occupied), 1.0, "the box was there");
    assert!(surface_in(&view, BEFORE, EDGE_M + 0.06) > 50);
    integrate(&mut mapper, data, AT..AT + PATIENCE);
    let now = AT + PATIENCE - 1;
    check_gone(&mapper.publish(), data, now, "after 15 frames");
    while mapper.refine(Duration::from_secs(1)).unwrap() {}
    let view = mapper.publish();
    check_gone(&view, data, now, "after idling");
    check_background(&view, data, &(AT..AT + PATIENCE).collect::<Vec<_>>());
    mapper
}

#[test]
fn a_removed_box_is_gone_and_stays_gone() {
    follow(&Synthetic::removed_box(AT + PATIENCE, AT).with_width(240));
}

#[test]
fn a_moved_box_is_where_it_went() {
    let data = Synthetic::moved_box(AT + PATIENCE, AT).with_width(240);
    let view = follow(&data).publish();
    let side = AFTER - Vec3::new(0.5 * EDGE_M - 0.03, 0.0, 0.0);
    assert_eq!(share(&view, &[side], State::Occupied), 1.0, "the box is there");
    assert!(surface_in(&view, AFTER, EDGE_M + 0.06) > 50);
    assert_eq!(data.intrinsics().width, 240);
}
