//! The paper's own start, fewer modalities, noise.

use glam::Vec3;

use orenx::config::{MapConfig, MapSettings, Prior};
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::truth::{Region, points};
use orenx::dataset::{Dataset, Noise};
use orenx::map::{Fields, MapView, Mapper};

use super::{integrate, lite};

const FRAMES: usize = 24;

fn room() -> Synthetic {
    Synthetic::room(FRAMES).with_width(160)
}

/// Mean error in free space and in front of and behind surfaces, m, over known points.
fn error_m(view: &MapView, data: &Synthetic) -> f32 {
    let frames: Vec<usize> = (0..FRAMES).collect();
    let mut truth = points(data, &frames, Region::Far { clear_m: 0.1 }, 1500, 5);
    truth.extend(points(data, &frames, Region::Near { band_m: 0.1 }, 1500, 6));
    truth.retain(|t| t.closest_observed);
    let at: Vec<Vec3> = truth.iter().map(|t| t.point).collect();
    let distances = view.query(&at, Fields::DISTANCE).distance;
    let known: Vec<f32> = truth
        .iter()
        .zip(distances)
        .filter(|(_, d)| d.is_finite())
        .map(|(t, d)| (d - t.distance).abs())
        .collect();
    assert!(known.len() * 10 > truth.len() * 5, "{} of {} are known", known.len(), truth.len());
    known.iter().sum::<f32>() / known.len() as f32
}

#[test]
fn the_learned_prior_maps_and_gets_better_from_zero() {
    let data = room();
    let run = |steps: u32| {
        let settings =
            MapSettings { prior: Prior::Learned, steps: Some(steps), ..MapSettings::default() };
        let mut mapper = Mapper::new(MapConfig::from_settings(&settings).unwrap()).unwrap();
        integrate(&mut mapper, &data, 0..FRAMES);
        error_m(&mapper.publish(), &data)
    };
    let (untrained, little, more) = (run(0), run(1), run(6));
    assert!(untrained > 0.1, "it starts from zero: {untrained} m");
    assert!(little < 0.97 * untrained, "{untrained} to {little} m");
    assert!(more < 0.8 * untrained, "{little} to {more} m");
}

#[test]
fn a_map_of_distance_alone_has_no_occupancy() {
    let settings = MapSettings { modalities: vec!["sdf".into()], ..MapSettings::default() };
    let mut mapper = Mapper::new(MapConfig::from_settings(&settings).unwrap()).unwrap();
    let data = room();
    integrate(&mut mapper, &data, 0..4);
    let view = mapper.publish();
    let answers = view.query(&[data.pose(0).position_f32()], Fields::ALL);
    assert!(answers.distance[0] > 0.0 && answers.occupancy.is_empty());
    assert_eq!((answers.gradient.len(), answers.state.len()), (1, 1));
}

#[test]
fn noise_does_not_make_it_wrong() {
    let data = room();
    let run = |noise: &str| {
        let noise: Noise = noise.parse().unwrap();
        let mut mapper = Mapper::new(lite(0)).unwrap();
        for index in 0..FRAMES {
            let mut frame = data.load(index, false).unwrap();
            noise.apply(&mut frame.depth, 7, index as u32);
            mapper.integrate(&frame).unwrap();
        }
        error_m(&mapper.publish(), &data)
    };
    let (clean, noisy) = (run("gaussian:0"), run("gaussian:0.01"));
    assert!(clean != noisy && clean.max(noisy) < 0.022, "{clean} and {noisy} m");
}
