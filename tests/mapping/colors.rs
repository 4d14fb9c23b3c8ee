//! What was seen of colours is said, and survives a file; what was seen through is free at once.

use glam::Vec3;

use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::frame::Frame;
use orenx::map::{Fields, MapView, Mapper, State};
use orenx::storage;

use super::{integrate, lite};

/// World points of every `step`-th pixel, at `before` m of depth before the return, and its colour.
pub(super) fn pixels(frame: &Frame, step: usize, before: f32) -> (Vec<Vec3>, Vec<Vec3>) {
    let k = frame.intrinsics;
    let image = frame.color.as_ref().unwrap();
    let places =
        (0..k.height).step_by(step).flat_map(|v| (0..k.width).step_by(step).map(move |u| (u, v)));
    let returns = places.filter(|(u, v)| frame.depth.at(*u, *v) > 0.5);
    returns
        .map(|(u, v)| {
            let point = frame.world_point(u, v, frame.depth.at(u, v) - before);
            (point, image.beside(u, v, k.width, k.height))
        })
        .unzip()
}

pub(super) fn colors(view: &MapView, points: &[Vec3]) -> Vec<Vec3> {
    view.query(points, Fields { color: true, ..Fields::NONE }).color
}

#[test]
fn colours_are_those_that_were_seen_and_survive_a_file() {
    let data = Synthetic::room(40).with_width(160);
    let mut mapper = Mapper::new(lite(1)).unwrap();
    integrate(&mut mapper, &data, 0..8);
    let (points, seen) = pixels(&data.load(7, true).unwrap(), 3, 0.0);
    let view = mapper.publish();
    let said = colors(&view, &points);
    let errors: Vec<f32> = said
        .iter()
        .zip(&seen)
        .filter(|(said, _)| said.is_finite())
        .map(|(said, seen)| (*said - *seen).abs().max_element())
        .collect();
    assert!(errors.len() * 4 > points.len() * 3, "{} of {}", errors.len(), points.len());
    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
    assert!(mean < 0.05, "{mean}");
    assert!(mapper.color_rows() > 10_000);

    let folder = tempfile::tempdir().unwrap();
    for compact in [false, true] {
        let path = folder.path().join(format!("{compact}"));
        storage::save(&mut mapper, &path, compact).unwrap();
        let again = colors(&storage::load_view(&path).unwrap(), &points);
        let same = said.iter().zip(&again).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()));
        assert!(same, "compact: {compact}");
    }
}

#[test]
fn depth_alone_makes_a_map_without_colours() {
    let data = Synthetic::room(40).with_width(160);
    let mut mapper = Mapper::new(lite(1)).unwrap();
    mapper.integrate(&data.load(0, false).unwrap()).unwrap();
    let (points, _) = pixels(&data.load(0, true).unwrap(), 7, 0.0);
    assert!(colors(&mapper.publish(), &points).iter().all(|color| color.is_nan()));
    assert_eq!(mapper.color_rows(), 0);
}

/// A vertex that a plane puts behind a surface, and that the same frame sees through, is not.
#[test]
fn what_a_frame_sees_through_is_free_after_that_frame() {
    let data = Synthetic::room(40).with_width(160);
    let (mut solid, mut all) = (0, 0);
    for index in (0..40).step_by(4) {
        let mut mapper = Mapper::new(lite(0)).unwrap();
        integrate(&mut mapper, &data, [index]);
        let (points, _) = pixels(&data.load(index, true).unwrap(), 2, 0.12);
        let states = mapper.publish().query(&points, Fields { state: true, ..Fields::NONE }).state;
        solid += states.iter().filter(|state| **state == State::Occupied as u8).count();
        all += states.len();
    }
    assert!(solid * 1000 < all * 4, "{solid} of {all}");
}
