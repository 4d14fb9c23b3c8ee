//! What was seen of colours is said, and survives a file; what was seen through is free at once.

use glam::Vec3;

use orenx::config::{MapConfig, MapSettings, Renderer};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::frame::{ColorImage, Frame};
use orenx::geometry::Region;
use orenx::map::{
    Camera, Channels, Clear, Edit, Fields, MapView, Mapper, RenderSettings, State, query_pool,
    render,
};
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

/// Vertices so wide apart that each has many pixels of a small image.
fn by_direction(color_degree: u8) -> MapConfig {
    let settings = MapSettings {
        steps: Some(0),
        r0_m: 0.2,
        color_spacing_m: 0.2,
        color_degree,
        ..MapSettings::default()
    };
    MapConfig::from_settings(&settings).unwrap()
}

/// A frame of the room whose surfaces all shine alike: their colour depends on the direction alone.
fn shining(data: &Synthetic, index: usize) -> Frame {
    let mut frame = data.load(index, true).unwrap();
    let k = frame.intrinsics;
    let eye = frame.world_from_camera.position_f32();
    let pixels = (0..k.height).flat_map(|v| (0..k.width).map(move |u| (u, v)));
    let rgb = pixels.flat_map(|(u, v)| {
        let color = 0.5 + 0.4 * (frame.world_point(u, v, 1.0) - eye).normalize();
        color.to_array().map(|c| (255.0 * c).round() as u8)
    });
    frame.color = Some(ColorImage { width: k.width, height: k.height, rgb: rgb.collect() });
    frame
}

/// An image from a frame's place.
fn image(view: &MapView, frame: &Frame, renderer: Renderer) -> Vec<Vec3> {
    let camera =
        Camera { world_from_camera: frame.world_from_camera, intrinsics: frame.intrinsics };
    let settings = RenderSettings { renderer, ..RenderSettings::default() };
    let (channels, pool) = (Channels { color: true, ..Channels::NONE }, query_pool(2).unwrap());
    render(view, &camera, channels, &settings, &pool, &|| false).unwrap().color
}

#[test]
fn colours_that_depend_on_the_direction_are_seen_in_images_and_survive_a_file() {
    let data = Synthetic::room(40).with_width(320);
    let frames: Vec<Frame> = (0..40).map(|index| shining(&data, index)).collect();
    let between = shining(&Synthetic::room(80).with_width(96), 41);
    let k = between.intrinsics;
    let truth = between.color.as_ref().unwrap();
    let truth: Vec<Vec3> = (0..k.height)
        .flat_map(|v| (0..k.width).map(move |u| (u, v)))
        .map(|(u, v)| truth.beside(u, v, k.width, k.height))
        .collect();
    let folder = tempfile::tempdir().unwrap();
    let mut errors = Vec::new();
    for color_degree in [0, 1, 3] {
        let mut mapper = Mapper::new(by_direction(color_degree)).unwrap();
        for frame in frames.iter().chain(&frames) {
            mapper.integrate(frame).unwrap();
        }
        let view = mapper.publish();
        let images = [Renderer::Tile, Renderer::Ray].map(|by| image(&view, &between, by));
        errors.push(images.each_ref().map(|image| {
            let painted = image.iter().zip(&truth).filter(|(shown, _)| **shown != Vec3::ZERO);
            let all: Vec<f32> = painted.map(|(a, b)| (*a - *b).abs().element_sum() / 3.0).collect();
            assert!(all.len() * 10 > image.len() * 8, "{} of {}", all.len(), image.len());
            all.iter().sum::<f32>() / all.len() as f32
        }));
        let held = view.state().harmonics.len();
        assert_eq!(held == 0, color_degree == 0, "nothing is held for nothing");
        for compact in [false, true] {
            let path = folder.path().join(format!("{color_degree}-{compact}"));
            storage::save(&mut mapper, &path, compact).unwrap();
            let again = storage::load_view(&path).unwrap();
            assert_eq!(again.config().settings().color_degree, color_degree);
            assert!(image(&again, &between, Renderer::Tile) == images[0], "compact: {compact}");
        }
        // What goes on from a file goes on as if it had not stopped.
        let mut resumed =
            storage::load(&folder.path().join(format!("{color_degree}-false"))).unwrap();
        for mapper in [&mut mapper, &mut resumed] {
            mapper.integrate(&frames[7]).unwrap();
        }
        let (a, b) = (mapper.publish().state(), resumed.publish().state());
        assert!(a.texels == b.texels && a.harmonics == b.harmonics, "degree {color_degree}");
    }
    println!("{errors:?}");
    for by in 0..2 {
        assert!(errors[1..].iter().all(|error| error[by] < 0.6 * errors[0][by]), "{errors:?}");
    }
}

/// What is painted by hand looks the same from all sides, and what is cleared is forgotten.
#[test]
fn edits_take_the_dependence_on_the_direction_away() {
    let data = Synthetic::room(40).with_width(160);
    let mut mapper = Mapper::new(by_direction(2)).unwrap();
    for index in (0..40).step_by(2) {
        mapper.integrate(&shining(&data, index)).unwrap();
    }
    let held = |mapper: &mut Mapper| {
        mapper.publish().state().harmonics.iter().filter(|by| **by != [0; 3]).count()
    };
    let before = held(&mut mapper);
    let region = Some(Region::Sphere { center: Vec3::new(0.0, 0.0, 1.0), radius_m: 100.0 });
    mapper.edit(&Edit::Clear(Clear { region, ..Clear::default() })).unwrap();
    assert!(before > 1000, "{before}");
    assert_eq!(held(&mut mapper), 0);
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
