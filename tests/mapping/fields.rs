//! Distance, sign, gradient and state against closed forms.

use glam::{DVec3, Vec3};

use orenx::dataset::synthetic::truth::{Region, TruthPoint, points};
use orenx::dataset::synthetic::{Renderer, Scene, SceneBuilder, Synthetic, Texture};
use orenx::dataset::{Dataset, ROBOT_ID, SENSOR_ID};
use orenx::frame::Frame;
use orenx::geometry::{Aabb, Pose};
use orenx::map::{Fields, MapView, Mapper, State};

use super::{integrate, lite, state};

/// Mean errors at points whose nearest surface was seen.
#[derive(Debug)]
struct Errors {
    distance_m: f32,
    gradient_rad: f32,
    /// How far the gradient's length is from one.
    unit: f32,
    /// Shares of all points.
    sign: f32,
    known: f32,
}

fn errors(view: &MapView, truth: &[TruthPoint]) -> Errors {
    let seen: Vec<&TruthPoint> = truth.iter().filter(|t| t.closest_observed).collect();
    assert!(seen.len() > 500, "{} points", seen.len());
    let at: Vec<Vec3> = seen.iter().map(|t| t.point).collect();
    let answers = view.query(&at, Fields::ALL);
    let mut sum = Errors { distance_m: 0.0, gradient_rad: 0.0, unit: 0.0, sign: 0.0, known: 0.0 };
    for (i, truth) in seen.iter().enumerate() {
        let (d, g) = (answers.distance[i], answers.gradient[i]);
        if answers.state[i] == State::Unknown as u8 {
            assert!(d.is_nan() && g.is_nan(), "an unknown point has no numbers");
            continue;
        }
        sum.known += 1.0;
        sum.distance_m += (d - truth.distance).abs();
        sum.gradient_rad += g.angle_between(truth.gradient);
        sum.unit += (g.length() - 1.0).abs();
        sum.sign += f32::from((d < 0.0) == (truth.distance < 0.0));
        let occupied = answers.state[i] == State::Occupied as u8;
        assert_eq!(occupied, d < 0.0, "state and sign are one");
        assert!((0.0..=1.0).contains(&answers.occupancy[i]));
    }
    let known = sum.known.max(1.0);
    Errors {
        distance_m: sum.distance_m / known,
        gradient_rad: sum.gradient_rad / known,
        unit: sum.unit / known,
        sign: sum.sign / known,
        known: sum.known / seen.len() as f32,
    }
}

#[test]
fn the_room_is_right_before_and_after_training() {
    const FRAMES: usize = 60;
    let data = Synthetic::room(FRAMES).with_width(320);
    let frames: Vec<usize> = (0..FRAMES).collect();
    let near = points(&data, &frames, Region::Near { band_m: 0.1 }, 4000, 1);
    let far = points(&data, &frames, Region::Far { clear_m: 0.1 }, 4000, 2);
    for steps in [0, 1] {
        let mut mapper = Mapper::new(lite(steps)).unwrap();
        integrate(&mut mapper, &data, 0..FRAMES);
        assert_eq!(mapper.stats().steps, u64::from(steps) * FRAMES as u64);
        let view = mapper.publish();
        let (near, far) = (errors(&view, &near), errors(&view, &far));
        assert!(near.distance_m < 0.0046 && far.distance_m < 0.0083, "{near:?} {far:?}");
        assert!(near.sign > 0.97 && far.sign > 0.999, "{near:?} {far:?}");
        assert!(near.known > 0.98 && far.known > 0.99, "{near:?} {far:?}");
        assert!(near.gradient_rad < 0.2 && far.gradient_rad < 0.21, "{near:?} {far:?}");
        assert!(near.unit < 0.12 && far.unit < 0.13, "{near:?} {far:?}");
    }
}

const CENTRE: Vec3 = Vec3::new(0.0, 0.0, 1.5);
const RADIUS_M: f32 = 0.5;

fn ball_in_a_box() -> Scene {
    let room = Aabb { min: Vec3::new(-2.5, -2.5, 0.0), max: Vec3::new(2.5, 2.5, 3.0) };
    let mut scene = SceneBuilder::new(room);
    scene.object("ball", "ball", [0.5; 3], Texture::Plain).sphere(CENTRE.to_array(), RADIUS_M);
    scene.build()
}

/// A frame of a camera on a circle around the ball, swaying up and down.
fn around(scene: &Scene, index: usize, of: usize) -> Frame {
    let intrinsics = Synthetic::room(1).with_width(320).intrinsics();
    let angle = std::f64::consts::TAU * index as f64 / of as f64;
    let centre = CENTRE.as_dvec3();
    let (sin, cos) = angle.sin_cos();
    let eye = centre + DVec3::new(1.6 * cos, 1.6 * sin, 1.1 * (3.0 * angle).sin());
    let world_from_camera = Pose::looking_at(eye, centre, DVec3::Z);
    let depth = Renderer::default().depth(scene, &intrinsics, &world_from_camera, 10.0);
    Frame {
        robot_id: ROBOT_ID.into(),
        sensor_id: SENSOR_ID.into(),
        seq: index as u64,
        stamp_ns: index as i64 + 1,
        world_from_camera,
        intrinsics,
        depth,
        color: None,
        features: None,
    }
}

#[test]
fn a_ball_in_a_box_has_its_distance_and_state() {
    const FRAMES: usize = 24;
    let scene = ball_in_a_box();
    for steps in [0, 1] {
        let mut mapper = Mapper::new(lite(steps)).unwrap();
        for index in 0..FRAMES {
            mapper.integrate(&around(&scene, index, FRAMES)).unwrap();
        }
        let view = mapper.publish();
        let (mut error, mut turned, mut count) = (0.0, 0.0, 0.0f32);
        let mut wrong = [0; 5];
        for i in 0..400 {
            // A spiral over the belt that every camera sees well.
            let (z, angle) = (0.7 * (i as f32 / 200.0 - 1.0), 2.4 * i as f32);
            let belt = (1.0 - z * z).sqrt();
            let out = Vec3::new(belt * angle.cos(), belt * angle.sin(), z);
            for (k, (height, expected)) in [
                (0.15, State::Free),
                (0.05, State::Free),
                (-0.03, State::Occupied),
                (-0.06, State::Occupied),
                (-0.35, State::Unknown),
            ]
            .into_iter()
            .enumerate()
            {
                let point = CENTRE + out * (RADIUS_M + height);
                wrong[k] += usize::from(state(&view, point) != expected);
                let answers = view.query(&[point], Fields::ALL);
                if answers.distance[0].is_finite() {
                    error += (answers.distance[0] - height).abs();
                    turned += answers.gradient[0].angle_between(out);
                    count += 1.0;
                }
            }
        }
        let (error, turned) = (error / count, turned / count);
        assert!(error < 0.006 && turned < 0.15, "{error} m, {turned} rad");
        assert!(wrong.iter().all(|&w| w <= 12), "wrong states of 400 by height: {wrong:?}");
        for (place, point) in [
            ("in the ball", CENTRE),
            ("behind a wall", Vec3::new(-3.2, 0.0, 1.5)),
            ("far away", Vec3::new(9.0, 9.0, 9.0)),
            ("outside the root", Vec3::splat(4000.0)),
            ("at no place", Vec3::new(f32::NAN, 0.0, 1.0)),
            ("at no place", Vec3::splat(f32::INFINITY)),
        ] {
            assert_eq!(state(&view, point), State::Unknown, "{place}");
            assert!(view.query(&[point], Fields::ALL).distance[0].is_nan(), "{place}");
        }
    }
}

#[test]
fn an_empty_map_knows_nothing() {
    let view = Mapper::new(lite(0)).unwrap().publish();
    assert_eq!(state(&view, Vec3::ZERO), State::Unknown);
    assert!(view.bounds().is_empty() && view.surface_leaves().is_empty());
}
