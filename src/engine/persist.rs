//! The map on disk, as the mapper thread needs it: loaded before it starts, with what its journal has
//! beyond its file.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::path::Path;

use super::journal::Segment;
use super::recovery;
use crate::config::{Kept, MapConfig};
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage::{self, Mark};

/// What there was of a map beside its file.
#[derive(Debug, Clone, Default)]
pub struct Past {
    /// Its journal, and how far the map has come in it.
    pub(super) mark: Mark,
    /// Whether a file says so, or there was no file.
    pub(super) is_anchored: bool,
    /// What the journal had, all of it in the map by now.
    pub(super) segments: Vec<Segment>,
    /// What was brought back, for people.
    pub(super) recovery: String,
}

impl Past {
    /// With a number for the journal, if there was none.
    pub(super) fn numbered(mut self) -> Self {
        if self.mark.journal == 0 {
            // Seeded by the system, and never zero.
            self.mark.journal = RandomState::new().build_hasher().finish() | 1;
        }
        self
    }
}

/// The map of the file at `path`, or an empty one with `config` if there is no file, and then what its
/// journal has and the file has not. `equip` is called in between: frames are mapped again with what the
/// map will be trained with.
pub fn recover(
    path: &Path,
    config: MapConfig,
    equip: impl FnOnce(&mut Mapper) -> Result<()>,
) -> Result<(Mapper, Past)> {
    let is_loaded = path.try_exists().map_err(|source| Error::io(path, source))?;
    let (mut mapper, mark) = load(path, config)?;
    equip(&mut mapper)?;
    let past = Past { mark, is_anchored: mark.journal != 0, ..Past::default() };
    let past = recovery::replay(&mut mapper, path, is_loaded, past)?;
    Ok((mapper, past))
}

/// The mapper of a snapshot, to take the place of a map with `config`.
pub fn load_snapshot(path: &Path, config: &MapConfig) -> Result<Mapper> {
    storage::load_with(path, |stored| Ok(stored.resumed(config)))
}

/// The mapper of the file at `path`, or an empty one with `config` if there is no file. A stored
/// map follows `config` in what describes the machine, and keeps the rest with a warning.
fn load(path: &Path, config: MapConfig) -> Result<(Mapper, Mark)> {
    match path.try_exists() {
        Ok(false) => Ok((Mapper::new(config)?, Mark::default())),
        Ok(true) => storage::load_marked(path, |stored| {
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
            "the map in {} keeps what it was made with: {}; reset it, or move its folder away, to \
             start anew",
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
        let (mut mapper, _) = load(&path, made.clone()).expect("a new map");
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
        let (mapper, _) = load(&path, current.clone()).expect("the stored map");
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
