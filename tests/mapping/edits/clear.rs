//! What is cleared is unknown, what is left is right.

use glam::Vec3;

use orenx::config::{MapConfig, MapSettings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::moved_box::BEFORE;
use orenx::error::Status;
use orenx::frame::Frame;
use orenx::geometry::{Aabb, Region};
use orenx::map::{Clear, Fields, MapView, Mapper, State};

use super::{FRAMES, clear, clear_region, clear_robot, differ, frame, grid, map_of, refine, room};
use crate::mapping::{language, state};

#[test]
fn a_cleared_region_is_unknown_and_the_rest_is_as_it_was() {
    let mut mapper = map_of((0..FRAMES).map(|i| (i, "a")), 1);
    let before = mapper.publish_all().unwrap();
    let bounds = before.bounds();
    let middle = 0.5 * (bounds.min + bounds.max);
    // A corner of the room, with walls, floor and whatever stands there.
    let inside = Aabb { min: bounds.min - 1.0, max: Vec3::new(middle.x, middle.y, 1.5) };
    let edited = mapper.edit(&clear_region(Region::Box(inside))).unwrap();
    assert!(edited.surfels_removed > 500 && edited.cells_forgotten > 500, "{edited:?}");
    assert_eq!(edited.epoch, before.epoch() + 1);
    let cleared = mapper.publish_all().unwrap();
    assert_eq!(cleared.epoch(), edited.epoch);
    for when in ["at once", "after idle refinement"] {
        let view = mapper.publish_all().unwrap();
        // Close to what is left the distance is known, as it is around any surface.
        let deep = Aabb { min: bounds.min, max: inside.max - 0.25 };
        let points = grid(&deep, 0.07);
        let answers = view.query(&points, Fields::ALL);
        let known = answers.state.iter().filter(|&&s| s != State::Unknown as u8).count();
        assert_eq!(known, 0, "{when}: of {}", points.len());
        assert!(answers.color.iter().all(|color| color.is_nan()));
        // Far from the region, the nearest surface may be in it no more.
        let mut outside = bounds;
        outside.min.x = middle.x + 0.5;
        let points = grid(&outside, 0.11);
        let (old, new) = (before.query(&points, Fields::ALL), view.query(&points, Fields::ALL));
        // Training moves surfaces a little, and what is known with them.
        let changed = old.state.iter().zip(&new.state).filter(|(old, new)| old != new).count();
        let most = if when == "at once" { 0 } else { points.len() / 100 };
        assert!(changed <= most, "{when}: {changed} of {} states", points.len());
        let nearer = |(old, new): (&f32, &f32)| *new < *old - 0.01;
        let wrong = old.distance.iter().zip(&new.distance).filter(|&p| nearer(p)).count();
        assert!(wrong * 200 < points.len(), "{when}: {wrong} of {} are nearer", points.len());
        refine(&mut mapper);
    }
}

/// Codes and colours of a surface go with it, and those beside it stay.
#[test]
fn what_a_surface_was_called_goes_with_it() {
    let data = Synthetic::removed_box(20, 20).with_width(120);
    let settings = MapSettings {
        modalities: ["sdf", "occupancy", "radiance", "language"].map(String::from).to_vec(),
        steps: Some(0),
        ..MapSettings::default()
    };
    let mut mapper = Mapper::new(MapConfig::from_settings(&settings).unwrap()).unwrap();
    for index in 0..6 {
        let color = data.load(index, true).unwrap().color;
        let frame = Frame { color, ..language::frame(&data, index, BEFORE) };
        mapper.integrate(&frame).unwrap();
    }
    let scores = |view: &MapView, points: &[Vec3]| {
        let text = view.scorer(&[language::direction(1)], &[language::direction(0)]).unwrap();
        let fields = Fields { text_score: true, ..Fields::ALL };
        let answers = view.query_with(points, fields, Some(&text));
        let columns = answers.text_score.into_iter().zip(answers.color);
        columns.map(|(score, color)| [score, color.x]).collect::<Vec<_>>()
    };
    let ball = Region::Sphere { center: BEFORE, radius_m: 0.5 };
    let before = mapper.publish();
    let points = grid(&before.bounds(), 0.06);
    let old = scores(&before, &points);
    mapper.edit(&clear_region(ball)).unwrap();
    let new = scores(&mapper.publish(), &points);
    let (mut gone, mut kept) = (0, 0);
    for ((point, old), new) in points.iter().zip(&old).zip(&new) {
        let (is_old, is_new) = (old.map(f32::is_finite), new.map(f32::is_finite));
        if point.distance(BEFORE) < 0.35 {
            assert_eq!(is_new, [false; 2], "{point}");
            gone += usize::from(is_old == [true; 2]);
        } else if point.distance(BEFORE) > 0.75 {
            assert_eq!(is_new, is_old, "{point}");
            kept += usize::from(is_old == [true; 2]);
        }
    }
    assert!(gone > 50 && kept > 1000, "{gone} gone, {kept} kept");
}

#[test]
fn what_is_mapped_again_after_a_clear_is_there_again() {
    let mut mapper = map_of((0..FRAMES).map(|i| (i, "a")), 0);
    let before = mapper.publish();
    let bounds = before.bounds();
    let ball = Region::Sphere { center: Vec3::new(0.0, 0.0, 0.7), radius_m: 1.2 };
    mapper.edit(&clear_region(ball)).unwrap();
    let cleared = mapper.publish();
    assert_eq!(state(&cleared, Vec3::new(0.0, 0.0, 1.0)), State::Unknown);
    let data = room();
    (0..FRAMES).for_each(|i| {
        mapper.integrate(&frame(&data, i, "a")).unwrap();
    });
    let again = mapper.publish();
    let (states, off, known) = differ(&before, &again, &grid(&bounds, 0.13), 0.02);
    assert!(states < 0.01 && off < 0.02 && known > 5000, "{states} {off} {known}");
}

/// Two robots, whose views overlap in part; one is taken back.
#[test]
fn what_only_one_robot_saw_goes_with_it() {
    let of_a = || (0..FRAMES / 2 + 6).map(|i| (i, "a"));
    let of_b = || (FRAMES / 2 - 6..FRAMES).map(|i| (i, "b"));
    let mut both = map_of(of_a().chain(of_b()), 1);
    let all = both.publish_all().unwrap();
    let mut alone = map_of(of_b(), 1);
    let frames = both.stats().key_frames;
    let edited = both.edit(&clear_robot("a")).unwrap();
    assert!(edited.surfels_removed > 300 && edited.key_frames_dropped > 0, "{edited:?}");
    assert_eq!(both.stats().key_frames, frames - edited.key_frames_dropped);
    let points = grid(&all.bounds(), 0.09);
    for when in ["at once", "after idle refinement"] {
        let (left, expected) = (both.publish_all().unwrap(), alone.publish_all().unwrap());
        let (a, b) = (left.query(&points, Fields::ALL), expected.query(&points, Fields::ALL));
        let unknown = State::Unknown as u8;
        let kept = a.state.iter().zip(&b.state).filter(|(a, b)| **a != unknown && **b == unknown);
        let lost = a.state.iter().zip(&b.state).filter(|(a, b)| **a == unknown && **b != unknown);
        let (kept, lost) = (kept.count(), lost.count());
        // Voxels stay, so that the known band around surfaces is a little wider than of one alone, and
        // surfels that both saw lie a little elsewhere.
        assert!(kept * 50 < points.len(), "{when}: {kept} of {} stay", points.len());
        assert!(lost * 200 < points.len(), "{when}: {lost} of {} are lost", points.len());
        let (states, off, known) = differ(&left, &expected, &points, 0.03);
        assert!(states < 0.03 && off < 0.08, "{when}: {states} {off} of {known}");
        assert!(known > 3000);
        refine(&mut both);
        refine(&mut alone);
    }
    let error = both.edit(&clear_robot("c")).unwrap_err();
    assert_eq!(error.status(), Status::NotFound);
    let rest = both.edit(&clear_robot("b")).unwrap();
    assert_eq!((both.stats().surfels, both.stats().key_frames), (0, 0), "{rest:?}");
    let empty = both.publish_all().unwrap().query(&points, Fields::ALL);
    assert!(empty.state.iter().all(|s| *s == State::Unknown as u8));
}

#[test]
fn what_was_seen_long_ago_goes_and_conditions_add_up() {
    let data = room();
    let frames = || (0..FRAMES).map(|i| (i, "a"));
    let cut = data.load(FRAMES / 2, false).unwrap().stamp_ns;
    let older = Clear { older_than_ns: Some(cut), ..Clear::default() };
    let mut mapper = map_of(frames(), 0);
    let before = mapper.publish();
    let edited = mapper.edit(&clear(older.clone())).unwrap();
    assert!(edited.surfels_removed > 100, "{edited:?}");
    let mut late = map_of((FRAMES / 2..FRAMES).map(|i| (i, "a")), 0);
    let points = grid(&before.bounds(), 0.11);
    let (states, off, known) = differ(&mapper.publish(), &late.publish(), &points, 0.03);
    assert!(states < 0.03 && off < 0.08 && known > 2000, "{states} {off} {known}");

    let mut mapper = map_of(frames(), 0);
    let all = mapper.edit(&clear(Clear { robot_id: Some("a".into()), ..older.clone() })).unwrap();
    assert_eq!(all.surfels_removed, edited.surfels_removed);
    assert_eq!(all.key_frames_dropped, 0, "the later ones are as good as before");
    let mut mapper = map_of(frames(), 0);
    let far = Region::Sphere { center: Vec3::splat(500.0), radius_m: 1.0 };
    let none = mapper.edit(&clear(Clear { region: Some(far), ..older })).unwrap();
    assert_eq!((none.surfels_removed, none.cells_forgotten), (0, 0));
}
