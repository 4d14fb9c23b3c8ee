//! The maps of a server: each with its thread, its counters and its folder.

mod opening;
mod shelves;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use tokio::sync::watch;

use super::counters::Tallies;
use super::{DEFAULT_MAP, MapDetail, MapSummary};
use crate::config::{MapConfig, MapSettings, ServerConfig};
use crate::engine::{Engine, EngineSettings, Handle};
use crate::error::{Error, Result};
use crate::map::Trainer;
use crate::storage::Shelf;

/// A map's state in its folder.
const MAP_FILE: &str = "map.orenx";
/// How the folder of a deleted map begins, until all of it is gone.
const DELETED: &str = ".deleted-";
/// Characters of a map's id.
const MAX_ID: usize = 64;

/// All maps, by id.
pub(super) struct Registry {
    maps: RwLock<BTreeMap<String, Entry>>,
    /// Their ids, for those who follow what maps there are.
    ids: watch::Sender<BTreeSet<String>>,
    /// Maps come and go one at a time.
    changing: tokio::sync::Mutex<()>,
    ground: Ground,
}

/// What every map stands on.
struct Ground {
    settings: MapSettings,
    trainer: Trainer,
    trainer_nice: u8,
    engine: EngineSettings,
    storage: Option<PathBuf>,
    max_maps: usize,
}

#[derive(Clone)]
enum Entry {
    Open(Arc<Map>),
    /// Its file could not be read, and stays as it is.
    Closed(Arc<str>),
}

/// One map that is served.
pub(super) struct Map {
    pub(super) handle: Handle,
    pub(super) tallies: Tallies,
    engine: Mutex<Option<Engine>>,
}

impl Map {
    fn take_engine(&self) -> Option<Engine> {
        self.engine.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// The threads of all maps. Dropping it stops them and waits for their ends.
pub struct Mappers(Arc<Registry>);

impl Mappers {
    /// Finishes the frames at hand, drops those that wait, saves every map, and waits for the ends.
    /// Fails with the first thread that failed, or the first map that could not be saved.
    pub fn stop(self) -> Result<()> {
        self.0.close()
    }
}

impl Drop for Mappers {
    fn drop(&mut self) {
        if let Err(error) = self.0.close() {
            tracing::error!(%error, "a mapper thread ended badly");
        }
    }
}

impl Registry {
    /// Loads every map of the storage folder, and makes the default one if there is none: with `map`,
    /// as every map is that is made without settings of its own.
    pub(super) fn open(config: &ServerConfig, map: MapConfig) -> Result<(Arc<Self>, Mappers)> {
        let registry = Arc::new(Self {
            maps: RwLock::default(),
            ids: watch::Sender::default(),
            changing: tokio::sync::Mutex::default(),
            ground: Ground {
                settings: config.map.clone(),
                trainer: Trainer { backend: config.backend, gpu_memory_mib: config.gpu_memory_mib },
                trainer_nice: config.trainer_nice,
                engine: EngineSettings {
                    lane_frames: config.lane_frames,
                    lanes: config.lanes,
                    queued_bytes: config.queued_bytes,
                    max_frame_age: config.max_frame_age,
                    publish_interval: config.publish_interval,
                    store: None,
                    keep: config.keep.clone(),
                },
                storage: config.storage.clone(),
                max_maps: config.max_maps,
            },
        });
        let mut ids = BTreeSet::from([DEFAULT_MAP.to_owned()]);
        if let Some(folder) = &config.storage {
            ids.extend(stored_maps(folder)?);
        }
        let mappers = Mappers(registry.clone());
        for id in ids {
            let opened = registry.ground.open(&id, map.clone());
            match (opened, &config.storage) {
                (Ok(map), _) => registry.put(&id, Entry::Open(map)),
                // The others are served; who fixes the file finds it as it was.
                (Err(error), Some(_)) => {
                    tracing::error!("map '{id}' is not served: {error}");
                    registry.put(&id, Entry::Closed(error.to_string().into()));
                }
                (Err(error), None) => return Err(error),
            }
        }
        Ok((registry, mappers))
    }

    /// A map that is served.
    pub(super) fn get(&self, map_id: &str) -> Result<Arc<Map>> {
        match self.read().get(map_id) {
            Some(Entry::Open(map)) => Ok(map.clone()),
            Some(Entry::Closed(problem)) => Err(Error::FailedPrecondition(format!(
                "map '{map_id}' could not be loaded: {problem}"
            ))),
            None if map_id.is_empty() => {
                Err(Error::invalid("map_id", format!("is required; try '{DEFAULT_MAP}'")))
            }
            None => Err(not_found(map_id)),
        }
    }

    /// Every map, served or not, by id.
    pub(super) fn list(&self) -> Vec<MapSummary> {
        let maps = self.read().clone();
        let summary = |(id, entry): (String, Entry)| match entry {
            Entry::Open(map) => MapSummary::of(id, &map.handle.published().view),
            Entry::Closed(problem) => MapSummary::of_closed(id, problem.as_ref().into()),
        };
        maps.into_iter().map(summary).collect()
    }

    /// Those that are served, by id.
    pub(super) fn open_maps(&self) -> Vec<(String, Arc<Map>)> {
        let open = |(id, entry): (&String, &Entry)| match entry {
            Entry::Open(map) => Some((id.clone(), map.clone())),
            Entry::Closed(_) => None,
        };
        self.read().iter().filter_map(open).collect()
    }

    /// The ids of those that are served, now and from now on.
    pub(super) fn ids(&self) -> watch::Receiver<BTreeSet<String>> {
        self.ids.subscribe()
    }

    /// Makes an empty map. `changes` go over the settings that the server's maps have. It is on disk
    /// before it is served, so that it is there after a crash.
    pub(super) async fn create(
        self: &Arc<Self>,
        map_id: &str,
        changes: &BTreeMap<String, String>,
    ) -> Result<MapDetail> {
        check_id(map_id)?;
        let config = MapConfig::from_settings(&self.ground.settings.with(changes)?)?;
        let (registry, id) = (self.clone(), map_id.to_owned());
        // On a task of its own, so that a client that leaves does not leave half a map.
        let making = tokio::spawn(async move {
            let _changing = registry.changing.lock().await;
            registry.check_room(&id)?;
            let made = {
                let (registry, id) = (registry.clone(), id.clone());
                tokio::task::spawn_blocking(move || registry.ground.make(&id, config)).await
            };
            let map = made.map_err(|_| Error::Internal("making a map failed".into()))??;
            let view = map.handle.published().view;
            registry.put(&id, Entry::Open(map));
            Ok(MapDetail { config: view.config().clone(), summary: MapSummary::of(id, &view) })
        });
        making.await.map_err(|_| Error::Internal("making a map failed".into()))?
    }

    /// Takes a map away, with everything in its folder. Questions that are under way are answered.
    pub(super) async fn delete(self: &Arc<Self>, map_id: &str) -> Result<()> {
        if map_id == DEFAULT_MAP {
            let problem = format!("map '{DEFAULT_MAP}' stays; it can be reset");
            return Err(Error::FailedPrecondition(problem));
        }
        check_id(map_id)?;
        let (registry, id) = (self.clone(), map_id.to_owned());
        let deleting = tokio::spawn(async move {
            let _changing = registry.changing.lock().await;
            let entry = registry.remove(&id).ok_or_else(|| not_found(&id))?;
            let registry = registry.clone();
            tokio::task::spawn_blocking(move || {
                if let Entry::Open(map) = entry {
                    // It saves once more, into a folder that goes next.
                    map.take_engine().map_or(Ok(()), Engine::stop)?;
                }
                registry.ground.delete(&id)
            })
            .await
            .map_err(|_| Error::Internal("deleting a map failed".into()))?
        });
        deleting.await.map_err(|_| Error::Internal("deleting a map failed".into()))?
    }

    /// Takes no more frames.
    pub(super) fn stop(&self) {
        for (_, map) in self.open_maps() {
            map.handle.stop();
        }
    }

    /// Waits until every thread has ended, or one has failed; for ever where there is none.
    pub(super) async fn ended(&self) -> Result<()> {
        let mut ids = self.ids();
        loop {
            let is_none = ids.borrow_and_update().is_empty();
            let ended = async {
                if is_none {
                    std::future::pending::<()>().await;
                }
                let mut threads = tokio::task::JoinSet::new();
                for (_, map) in self.open_maps() {
                    let handle = map.handle.clone();
                    threads.spawn(async move { handle.ended().await });
                }
                while let Some(ended) = threads.join_next().await {
                    ended.map_err(|_| Error::Internal("waiting for a mapper failed".into()))??;
                }
                Ok(())
            };
            tokio::select! {
                ended = ended => return ended,
                // Its sender is our own.
                _ = ids.changed() => {}
            }
        }
    }

    fn close(&self) -> Result<()> {
        self.stop();
        let mut closed = Ok(());
        for (_, map) in self.open_maps() {
            let ended = map.take_engine().map_or(Ok(()), Engine::stop);
            closed = closed.and(ended);
        }
        closed
    }

    fn check_room(&self, map_id: &str) -> Result<()> {
        let maps = self.read();
        if maps.contains_key(map_id) {
            return Err(Error::FailedPrecondition(format!("map '{map_id}' exists already")));
        }
        if maps.len() >= self.ground.max_maps {
            return Err(Error::ResourceExhausted {
                what: "maps".into(),
                limit: format!("the limit is {} (server.max_maps)", self.ground.max_maps),
            });
        }
        Ok(())
    }

    fn put(&self, map_id: &str, entry: Entry) {
        let is_open = matches!(entry, Entry::Open(_));
        self.write().insert(map_id.to_owned(), entry);
        if is_open {
            self.ids.send_modify(|ids| {
                ids.insert(map_id.to_owned());
            });
        }
    }

    fn remove(&self, map_id: &str) -> Option<Entry> {
        let entry = self.write().remove(map_id);
        self.ids.send_if_modified(|ids| ids.remove(map_id));
        entry
    }

    fn read(&self) -> RwLockReadGuard<'_, BTreeMap<String, Entry>> {
        self.maps.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, BTreeMap<String, Entry>> {
        self.maps.write().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Ground {
    /// Where a map is kept. Makes its folder, so that a wrong path is found at the start and not at
    /// the end.
    fn store(&self, map_id: &str) -> Result<Option<PathBuf>> {
        let Some(storage) = &self.storage else { return Ok(None) };
        let folder = storage.join(map_id);
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
        if let Err(error) = Shelf::of(&folder).tidy() {
            tracing::warn!("map '{map_id}': {error}");
        }
        Ok(Some(folder.join(MAP_FILE)))
    }

    /// Removes a map's folder. First its name, so that no half of it is ever taken for a map.
    fn delete(&self, map_id: &str) -> Result<()> {
        let Some(storage) = &self.storage else { return Ok(()) };
        let (folder, gone) = (storage.join(map_id), storage.join(format!("{DELETED}{map_id}")));
        std::fs::rename(&folder, &gone).map_err(|e| Error::io(&folder, e))?;
        std::fs::remove_dir_all(&gone).map_err(|e| Error::io(&gone, e))
    }
}

/// The maps that have a folder. What an earlier version kept as a file of its own moves into one, and
/// what was left of a deletion goes.
fn stored_maps(storage: &Path) -> Result<BTreeSet<String>> {
    std::fs::create_dir_all(storage).map_err(|e| Error::io(storage, e))?;
    let old = storage.join(format!("{DEFAULT_MAP}.orenx"));
    let new = storage.join(DEFAULT_MAP).join(MAP_FILE);
    if old.is_file() && !new.exists() {
        let folder = storage.join(DEFAULT_MAP);
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
        std::fs::rename(&old, &new).map_err(|e| Error::io(&old, e))?;
    }
    let mut ids = BTreeSet::new();
    for entry in std::fs::read_dir(storage).map_err(|e| Error::io(storage, e))? {
        let entry = entry.map_err(|e| Error::io(storage, e))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with(DELETED) {
            std::fs::remove_dir_all(entry.path()).map_err(|e| Error::io(entry.path(), e))?;
        } else if check_id(&name).is_ok() && entry.path().is_dir() {
            ids.insert(name);
        }
    }
    Ok(ids)
}

/// Refuses an id that is no good name for a folder, a part of a URL and a part of a key.
fn check_id(map_id: &str) -> Result<()> {
    let is_plain = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit();
    let is_good = map_id.len() <= MAX_ID
        && map_id.bytes().next().is_some_and(is_plain)
        && map_id.bytes().all(|c| is_plain(c) || c == b'-' || c == b'_');
    if is_good {
        return Ok(());
    }
    let problem = format!(
        "'{}' must be 1 to {MAX_ID} of a-z, 0-9, - and _, and begin with a letter or a digit",
        shown(map_id)
    );
    Err(Error::invalid("map_id", problem))
}

fn not_found(map_id: &str) -> Error {
    Error::NotFound { what: format!("map_id: map '{}'", shown(map_id)) }
}

/// As much of an id from outside as a message should repeat.
fn shown(map_id: &str) -> String {
    map_id.chars().take(MAX_ID).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_names_everywhere() {
        for good in ["default", "0", "floor-2_east", &"a".repeat(MAX_ID)] {
            check_id(good).expect(good);
        }
        for bad in ["", "-a", "_a", ".deleted-a", "A", "a/b", "..", "a b", "ä", &"a".repeat(65)] {
            let error = check_id(bad).expect_err(bad).to_string();
            assert!(error.starts_with("map_id: ") && error.len() < 200, "{error}");
        }
    }

    #[test]
    fn the_file_of_an_earlier_version_moves_and_remains_of_a_deletion_go() {
        let storage = tempfile::tempdir().expect("a folder");
        let path = |name: &str| storage.path().join(name);
        std::fs::write(path("default.orenx"), b"map").expect("written");
        std::fs::create_dir_all(path(".deleted-old/snapshots")).expect("made");
        std::fs::create_dir_all(path("yard")).expect("made");
        std::fs::write(path("notes"), b"").expect("written");
        let ids = stored_maps(storage.path()).expect("a good folder");
        assert_eq!(ids, ["default", "yard"].map(str::to_owned).into());
        assert_eq!(std::fs::read(path("default/map.orenx")).expect("moved"), b"map");
        assert!(!path("default.orenx").exists() && !path(".deleted-old").exists());
        assert_eq!(stored_maps(storage.path()).expect("again"), ids);
    }
}
