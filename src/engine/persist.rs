//! The map on disk, as the mapper thread needs it: loaded before it starts, saved when it stops.

use std::path::Path;

use crate::config::{Kept, MapConfig};
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage;

/// The mapper of the file at `path`, or an empty one with `config` if there is no file. A stored
/// map follows `config` in what describes the machine, and keeps the rest with a warning.
pub fn load(path: &Path, config: MapConfig) -> Result<Mapper> {
    match path.try_exists() {
        Ok(false) => Mapper::new(config),
        Ok(true) => storage::load_with(path, |stored| {
            if let Some(warning) = warning(path, &stored.kept(&config)) {
                tracing::warn!("{warning}");
            }
            Ok(stored.resumed(&config))
        }),
        Err(source) => Err(Error::io(path, source)),
    }
}

/// One line that names every setting that a map keeps.
fn warning(path: &Path, kept: &[Kept]) -> Option<String> {
    let fields: Vec<String> = kept.iter().map(Kept::to_string).collect();
    (!fields.is_empty()).then(|| {
        format!(
            "the map in {} keeps what it was made with: {}; move the file away to start anew",
            path.display(),
            fields.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{MapSettings, Schedule};

    #[test]
    fn a_stored_map_follows_the_machine_and_says_what_it_keeps() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("map.orenx");
        let made = MapSettings { r0_m: 0.2, memory_mib: 512, ..MapSettings::default() };
        let made = MapConfig::from_settings(&made).expect("valid");
        let mut mapper = load(&path, made.clone()).expect("a new map");
        assert_eq!(*mapper.config(), made);
        storage::save(&mut mapper, &path, false).expect("saved");

        let current = MapSettings {
            schedule: Schedule::Adaptive,
            frame_budget_ms: 11.0,
            memory_mib: 256,
            seed: 9,
            ..MapSettings::default()
        };
        let current = MapConfig::from_settings(&current).expect("valid");
        let mapper = load(&path, current.clone()).expect("the stored map");
        assert_eq!(*mapper.config(), made.clone().resumed(&current));
        assert_eq!((mapper.config().r0_m, mapper.config().memory_mib), (0.2, 256));
        assert_eq!(mapper.config().schedule, Schedule::Adaptive);

        let warning = warning(&path, &made.kept(&current)).expect("two settings differ");
        for part in ["map.orenx", "r0_m 0.2 (not 0.1)", "seed 0 (not 9)"] {
            assert!(warning.contains(part), "{part} in {warning}");
        }
        assert!(!warning.contains("memory") && !warning.contains('\n'), "{warning}");
        assert_eq!(super::warning(&path, &made.kept(&made)), None);
    }
}
