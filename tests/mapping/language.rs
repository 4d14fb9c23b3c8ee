//! Features of frames become codes that texts find: at points, as things, after a file, and no
//! longer once the thing is gone.

use glam::Vec3;

use orenx::config::{CodeForm, DictionaryKind, MapConfig, MapSettings};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::moved_box::{AFTER, BEFORE, EDGE_M};
use orenx::frame::{Contract, FeatureImage, Frame, NO_FEATURE};
use orenx::map::{
    Camera, Channels, FindSettings, MapView, Mapper, Match, RenderSettings, query_pool, render_with,
};
use orenx::numpy::write_array;
use orenx::storage;

use super::lite;

const DIMENSION: usize = 48;

/// The direction of a class, in which classes share much.
fn direction(class: usize) -> Vec<f32> {
    let number = |i: usize| ((i * 37 + class * 101 + i * i * class) % 29) as f32 / 14.0 - 1.0;
    (0..DIMENSION).map(|i| 1.0 + number(i)).collect()
}

/// What stands at a place: the box, the floor, or anything else.
fn class(point: Vec3, at: Vec3) -> usize {
    match () {
        () if (point - at).abs().max_element() < 0.5 * EDGE_M + 0.02 => 1,
        () if point.z < 0.05 => 2,
        () => 0,
    }
}

fn contract() -> Contract {
    Contract { encoder_id: "classes".into(), dimension: DIMENSION }
}

/// A frame of a scene with a box at `at`, with the feature of its class at each pixel.
fn frame(data: &Synthetic, index: usize, at: Vec3) -> Frame {
    let mut frame = data.load(index, false).unwrap();
    let k = frame.intrinsics;
    let of = |pixel: u32| {
        let (u, v) = (pixel % k.width, pixel / k.width);
        let z = frame.depth.at(u, v);
        if z > 0.0 { class(frame.world_point(u, v, z), at) as u16 } else { NO_FEATURE }
    };
    frame.features = Some(FeatureImage {
        contract: contract(),
        width: k.width,
        height: k.height,
        index: Some((0..k.pixels() as u32).map(of).collect()),
        features: (0..3).flat_map(direction).collect(),
    });
    frame
}

/// World points of some pixels and their classes.
fn seen(frame: &Frame, at: Vec3) -> (Vec<Vec3>, Vec<i32>) {
    let k = frame.intrinsics;
    let pixels = (0..k.pixels() as u32).step_by(7).map(|i| (i % k.width, i / k.width));
    let returns = pixels.filter(|(u, v)| frame.depth.at(*u, *v) > 0.0);
    let point = |(u, v)| frame.world_point(u, v, frame.depth.at(u, v));
    returns.map(|place| (point(place), class(point(place), at) as i32)).unzip()
}

fn find(view: &MapView) -> Vec<Match> {
    let scorer = view.scorer(&[direction(1)], &[direction(0), direction(2)]).unwrap();
    let settings = FindSettings { region: None, min_score: 0.5, top_k: 5, places: false };
    view.find(&scorer, &settings, &|| false).unwrap().matches
}

fn mapped(config: MapConfig, data: &Synthetic, frames: std::ops::Range<usize>) -> Mapper {
    let mut mapper = Mapper::new(config).unwrap();
    for index in frames {
        mapper.integrate(&frame(data, index, BEFORE)).unwrap();
    }
    mapper
}

#[test]
fn a_text_finds_its_thing_and_its_places() {
    let data = Synthetic::removed_box(20, 20).with_width(240);
    let view = mapped(lite(0), &data, 0..10).publish();
    assert_eq!(view.contract(), Some(&contract()));
    let counts = view.language().unwrap();
    assert!((1..=3).contains(&counts.atoms) && counts.vertices > 1000, "{counts:?}");

    let matches = find(&view);
    let thing = &matches[0];
    assert!(thing.centroid.distance(BEFORE) < 0.5 * EDGE_M, "{thing:?}");
    let wrong = (thing.extent - EDGE_M).abs().max_element();
    assert!(wrong < 0.25 && thing.score > 0.6, "{thing:?}");
    assert!((thing.obb.center - thing.centroid).length() < 0.2, "{thing:?}");
    assert!(matches[1..].iter().all(|other| other.voxels * 4 < thing.voxels), "{matches:?}");
    let camera = thing.best_view.unwrap().inverse();
    let own = camera.transform(thing.centroid.as_dvec3());
    assert!(own.z > 0.3 && own.truncate().length() < own.z, "{own}");

    let camera =
        Camera { world_from_camera: thing.best_view.unwrap(), intrinsics: data.intrinsics() };
    let text = view.scorer(&[direction(1)], &[direction(0), direction(2)]).unwrap();
    let channels = Channels { heat: true, ..Channels::NONE };
    let settings = RenderSettings::default();
    let pool = query_pool(1).unwrap();
    let heat = render_with(&view, &camera, channels, &settings, Some(&text), &pool, &|| false);
    let heat = heat.unwrap();
    assert!(heat.depth_m.is_empty() && heat.color.is_empty());
    let hot = heat.heat.iter().filter(|score| **score > 0.6).count();
    assert!((500..heat.heat.len() / 3).contains(&hot), "{hot} of {}", heat.heat.len());

    let (points, classes) = seen(&frame(&data, 9, BEFORE), BEFORE);
    let scores = view.text_scores(&points, &text);
    let hot =
        classes.iter().zip(&scores).filter(|(class, score)| (**class == 1) == (**score > 0.5));
    assert!(hot.count() * 100 > points.len() * 95);
    let all = view.scorer(&[direction(0), direction(1), direction(2)], &[]).unwrap();
    let (found, cosine) = view.classify(&points, &all);
    let right = found.iter().zip(&classes).filter(|(a, b)| a == b).count();
    assert!(right * 100 > points.len() * 95, "{right} of {}", points.len());
    let cosines = view.class_scores(&points, &all);
    for (i, class) in found.iter().enumerate().filter(|(_, class)| **class >= 0) {
        assert_eq!(cosine[i], cosines[3 * i + *class as usize]);
    }
    let decoded = view.features(&points[..1]);
    let truth = direction(classes[0] as usize);
    let along: f32 = decoded.iter().zip(&truth).map(|(a, b)| a * b).sum();
    let norm = |x: &[f32]| x.iter().map(|x| x * x).sum::<f32>().sqrt();
    assert!(along > 0.98 * norm(&decoded) * norm(&truth));
    // Nothing was seen in the middle of the room.
    assert_eq!(view.classify(&[BEFORE + Vec3::new(-1.0, 0.0, 0.6)], &all).0, [-1]);
    assert!(view.scorer(&[vec![1.0; 7]], &[]).is_err() && view.scorer(&[], &[]).is_err());
}

#[test]
fn what_was_said_is_said_after_a_file_and_mapping_goes_on_as_if_it_had_not_stopped() {
    let data = Synthetic::removed_box(20, 20).with_width(160);
    let folder = tempfile::tempdir().unwrap();
    for form in [CodeForm::F16, CodeForm::F32, CodeForm::TopK] {
        let mut config = lite(1);
        (config.language.codes, config.language.terms) = (form, 2);
        let mut mapper = mapped(config, &data, 0..4);
        let said = find(&mapper.publish());
        assert!(!said.is_empty());
        let path = folder.path().join("map");
        for compact in [true, false] {
            storage::save(&mut mapper, &path, compact).unwrap();
            let view = storage::load_view(&path).unwrap();
            assert_eq!(find(&view), said, "{form:?}, compact: {compact}");
            assert_eq!(view.contract(), Some(&contract()));
        }
        let mut resumed = storage::load(&path).unwrap();
        let bytes = [&mut mapper, &mut resumed].map(|mapper| {
            for index in 4..7 {
                mapper.integrate(&frame(&data, index, BEFORE)).unwrap();
            }
            mapper.publish();
            storage::save(mapper, &path, false).unwrap();
            std::fs::read(&path).unwrap()
        });
        assert!(bytes[0] == bytes[1], "{form:?}");
    }
}

#[test]
fn what_is_gone_is_not_found() {
    for (data, now) in [
        (Synthetic::removed_box(60, 30).with_width(160), None),
        (Synthetic::moved_box(60, 30).with_width(160), Some(AFTER)),
    ] {
        let mut mapper = mapped(lite(0), &data, 0..30);
        for index in 30..50 {
            let at = now.unwrap_or(Vec3::splat(1e3));
            mapper.integrate(&frame(&data, index, at)).unwrap();
        }
        let matches = find(&mapper.publish());
        let at = |place: Vec3| matches.iter().filter(|m| m.centroid.distance(place) < 0.4).count();
        assert_eq!(at(BEFORE), 0, "{matches:?}");
        if let Some(now) = now {
            assert!(matches[0].centroid.distance(now) < 0.5 * EDGE_M, "{matches:?}");
        }
    }
}

#[test]
fn features_of_another_encoder_are_refused_and_change_nothing() {
    let data = Synthetic::removed_box(20, 20).with_width(160);
    let mut mapper = mapped(lite(0), &data, 0..2);
    let before = find(&mapper.publish());
    let mut other = frame(&data, 2, BEFORE);
    if let Some(features) = &mut other.features {
        features.contract.encoder_id = "others".into();
    }
    let problem = mapper.integrate(&other).unwrap_err().to_string();
    assert!(problem.contains("'others'") && problem.contains("'classes'"), "{problem}");
    let view = mapper.publish();
    assert_eq!((view.epoch(), find(&view)), (1, before));
    assert!(Mapper::new(lite(0)).unwrap().publish().scorer(&[direction(1)], &[]).is_err());
}

#[test]
fn patches_of_a_grid_blend_into_each_other() {
    let data = Synthetic::removed_box(20, 20).with_width(160);
    let mut config = lite(0);
    config.language.dictionary = DictionaryKind::Full;
    let mut mapper = Mapper::new(config).unwrap();
    let mut frame = data.load(0, false).unwrap();
    // From the first axis at the left to the second at the right.
    let features = (0..8 * 6).flat_map(|patch| [7.0 - (patch % 8) as f32, (patch % 8) as f32, 0.0]);
    frame.features = Some(FeatureImage {
        contract: Contract { encoder_id: "axes".into(), dimension: 3 },
        width: 8,
        height: 6,
        index: None,
        features: features.collect(),
    });
    mapper.integrate(&frame).unwrap();
    let view = mapper.publish();
    assert_eq!(view.language().unwrap().atoms, 3);
    let k = frame.intrinsics;
    let (mut worst, mut checked) = (0.0f32, 0);
    for u in (10..k.width - 10).step_by(5) {
        let v = k.height / 2;
        let point = frame.world_point(u, v, frame.depth.at(u, v));
        let feature = view.features(&[point]);
        if frame.depth.is_edge(u, v) || feature[0].is_nan() {
            continue;
        }
        let share = ((u as f32 + 0.5) * 8.0 / k.width as f32 - 0.5) / 7.0;
        let expected = share.clamp(0.0, 1.0).atan2(1.0 - share.clamp(0.0, 1.0));
        worst = worst.max((feature[1].atan2(feature[0]) - expected).abs());
        checked += 1;
    }
    assert!(checked > 20 && worst < 0.12, "{worst} rad at worst of {checked}");
}

/// What a reader holds is of one moment: codes, atoms and the scores that they give.
#[test]
fn a_view_keeps_its_atoms_while_the_map_learns_others() {
    let data = Synthetic::removed_box(20, 20).with_width(160);
    let mut mapper = Mapper::new(lite(0)).unwrap();
    let mut floor = frame(&data, 0, BEFORE);
    if let Some(index) = floor.features.as_mut().and_then(|features| features.index.as_mut()) {
        index.iter_mut().filter(|class| **class == 1).for_each(|class| *class = 0);
    }
    if let Some(features) = &mut floor.features {
        features.features[DIMENSION..2 * DIMENSION].fill(0.0);
    }
    mapper.integrate(&floor).unwrap();
    let old = mapper.publish();
    let said = find(&old);
    let (points, _) = seen(&floor, BEFORE);
    let text = old.scorer(&[direction(2)], &[direction(0)]).unwrap();
    let scores = old.text_scores(&points, &text);
    let atoms = old.language().unwrap().atoms;
    for index in 1..6 {
        mapper.integrate(&frame(&data, index, BEFORE)).unwrap();
    }
    let new = mapper.publish();
    assert!(new.language().unwrap().atoms > atoms, "the box is a direction of its own");
    assert_eq!((old.language().unwrap().atoms, find(&old)), (atoms, said));
    let again = old.text_scores(&points, &text);
    assert!(scores.iter().zip(&again).all(|(a, b)| a.to_bits() == b.to_bits()));
    assert!(find(&new)[0].centroid.distance(BEFORE) < 0.5 * EDGE_M);
}

#[test]
fn atoms_of_a_file_are_taken_once_and_stay() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("atoms.npy");
    // The classes' directions, made orthonormal.
    let mut atoms: Vec<Vec<f32>> = Vec::new();
    for class in 0..3 {
        let mut atom = direction(class);
        for other in &atoms {
            let along: f32 = atom.iter().zip(other).map(|(a, b)| a * b).sum();
            atom.iter_mut().zip(other).for_each(|(a, b)| *a -= along * b);
        }
        let length = atom.iter().map(|x| x * x).sum::<f32>().sqrt();
        atoms.push(atom.into_iter().map(|x| x / length).collect());
    }
    let mut bytes = Vec::new();
    write_array(&mut bytes, &[3, DIMENSION], &atoms.concat()).unwrap();
    std::fs::write(&path, bytes).unwrap();
    let settings = MapSettings {
        dictionary: path.display().to_string(),
        steps: Some(0),
        ..MapSettings::default()
    };
    let config = || MapConfig::from_settings(&settings);
    let data = Synthetic::removed_box(20, 20).with_width(160);
    let mut mapper = mapped(config().unwrap(), &data, 0..3);
    let view = mapper.publish();
    let counts = view.language().unwrap();
    assert_eq!(counts.atoms, 3);
    assert!(mapper.code_rows() as usize >= counts.vertices && counts.vertices > 500, "{counts:?}");
    assert!(find(&view)[0].centroid.distance(BEFORE) < 0.5 * EDGE_M);
    let map = folder.path().join("map");
    storage::save(&mut mapper, &map, false).unwrap();
    std::fs::remove_file(&path).unwrap();
    let mut resumed = storage::load(&map).unwrap();
    resumed.integrate(&frame(&data, 3, BEFORE)).unwrap();
    assert_eq!(resumed.publish().language().unwrap().atoms, 3);
    let missing = Mapper::new(config().unwrap()).err().unwrap().to_string();
    assert!(missing.contains("atoms.npy"), "{missing}");
    for dictionary in ["offline", "atoms.txt", ""] {
        let wrong = MapSettings { dictionary: dictionary.into(), ..MapSettings::default() };
        let problem = MapConfig::from_settings(&wrong).unwrap_err().to_string();
        assert!(problem.contains("dictionary") && problem.contains("online"), "{problem}");
    }
}
