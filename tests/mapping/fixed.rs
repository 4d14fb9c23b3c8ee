//! `fixed`: the same input gives the same file, on any number of threads and however often mapping
//! was interrupted.

use std::time::Duration;

use orenx::config::{MapConfig, MapSettings, Profile};
use orenx::dataset::synthetic::Synthetic;
use orenx::map::Mapper;
use orenx::storage;

use super::{integrate, lite};

/// Trained on colours too.
fn colored(mut config: MapConfig) -> MapConfig {
    config.radiance.rays_per_step = 128;
    config.radiance.sharpens = true;
    config
}

/// `full` with fewer rays.
fn full() -> MapConfig {
    let settings = MapSettings { profile: Profile::Full, steps: Some(2), ..MapSettings::default() };
    let mut config = MapConfig::from_settings(&settings).unwrap();
    config.rays_per_step = 768;
    config
}

fn saved(mapper: &mut Mapper, compact: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map");
    storage::save(mapper, &path, compact).unwrap();
    std::fs::read(path).unwrap()
}

/// The first place where two files differ.
fn difference(a: &[u8], b: &[u8]) -> Option<usize> {
    let differs = a.iter().zip(b).position(|(a, b)| a != b);
    differs.or((a.len() != b.len()).then_some(a.len().min(b.len())))
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let data = Synthetic::room(40).with_width(160);
    for config in [MapConfig { rays_per_step: 256, ..colored(lite(1)) }, full()] {
        let run = |threads: usize| {
            let mut mapper = Mapper::with_threads(config.clone(), threads).unwrap();
            integrate(&mut mapper, &data, 0..6);
            // Idle steps end with a clock unless they may run to their end.
            if config.profile == Profile::Lite {
                assert!(!mapper.refine(Duration::MAX).unwrap(), "refined to the end");
            }
            mapper.publish();
            (saved(&mut mapper, false), saved(&mut mapper, true))
        };
        let one = run(1);
        for threads in [2, 3] {
            let more = run(threads);
            assert_eq!(
                difference(&one.0, &more.0),
                None,
                "{threads} threads, {:?}",
                config.profile
            );
            assert_eq!(
                difference(&one.1, &more.1),
                None,
                "{threads} threads, {:?}",
                config.profile
            );
        }
    }
}

#[test]
fn a_resumed_map_is_as_if_it_had_not_stopped() {
    let data = Synthetic::room(40).with_width(160);
    let folder = tempfile::tempdir().unwrap();
    for (name, config) in [("lite", lite(1)), ("colored", colored(lite(1))), ("full", full())] {
        let mut whole = Mapper::new(config.clone()).unwrap();
        let path = folder.path().join(name);
        let mut part = Mapper::new(config).unwrap();
        for (from, to) in [(0, 2), (2, 6), (6, 9)] {
            // Epochs count what is published.
            for mapper in [&mut whole, &mut part] {
                integrate(mapper, &data, from..to);
                mapper.publish();
            }
            storage::save(&mut part, &path, false).unwrap();
            part = storage::load(&path).unwrap();
        }
        let (whole, part) = (saved(&mut whole, false), saved(&mut part, false));
        assert_eq!(difference(&whole, &part), None, "{name}");
    }
}

#[test]
fn another_seed_gives_another_map() {
    let data = Synthetic::room(40).with_width(160);
    let run = |seed: u32| {
        let mut mapper = Mapper::new(MapConfig { seed, ..lite(1) }).unwrap();
        integrate(&mut mapper, &data, 0..2);
        saved(&mut mapper, true)
    };
    assert!(difference(&run(1), &run(2)).is_some(), "the comparison can fail");
    assert_eq!(difference(&run(1), &run(1)), None);
}
