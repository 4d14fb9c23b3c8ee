//! The snapshots of one map: checkpoints with names, in a folder beside the map's own file.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{SystemTime, UNIX_EPOCH};

use super::Summary;
use crate::error::{Error, Result};

/// The folder of the snapshots in that of the map.
const FOLDER: &str = "snapshots";
const EXTENSION: &str = ".orenx";
/// How the names of those begin that the timer makes, and that it takes away again.
const TIMED: &str = "auto-";
/// Characters of a name.
const MAX_NAME: usize = 64;
/// Snapshots of one map.
const MAX_SNAPSHOTS: usize = 256;

/// What a list tells of a snapshot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Snapshot {
    pub name: String,
    pub bytes: u64,
    /// When its file was written here, Unix ns.
    pub created_ns: i64,
    pub epoch: u64,
    pub frames: u64,
    /// Why it cannot be read; empty if it can, as far as its first bytes tell.
    pub problem: String,
}

/// Where the snapshots of a map are.
#[derive(Debug, Clone)]
pub struct Shelf(PathBuf);

impl Shelf {
    /// That of the map whose folder this is.
    pub fn of(map_folder: &Path) -> Self {
        Self(map_folder.join(FOLDER))
    }

    /// Every snapshot, by name; timed ones by age.
    pub fn list(&self) -> Result<Vec<Snapshot>> {
        self.names()?.into_iter().map(|name| self.describe(&name)).collect()
    }

    /// One of them.
    pub fn describe(&self, name: &str) -> Result<Snapshot> {
        let path = self.find(name)?;
        let metadata = fs::metadata(&path).map_err(|e| Error::io(&path, e))?;
        let since = metadata.modified().ok().and_then(|at| at.duration_since(UNIX_EPOCH).ok());
        let created_ns = since.map_or(0, |since| since.as_nanos() as i64);
        let (epoch, frames, problem) = match Summary::peek(&path) {
            Ok(summary) => (summary.epoch, summary.frames, String::new()),
            Err(error) => (0, 0, error.to_string()),
        };
        Ok(Snapshot {
            name: name.into(),
            bytes: metadata.len(),
            created_ns,
            epoch,
            frames,
            problem,
        })
    }

    /// The file of a snapshot that is there.
    pub fn find(&self, name: &str) -> Result<PathBuf> {
        check_name(name)?;
        let path = self.path(name);
        match path.try_exists() {
            Ok(true) => Ok(path),
            Ok(false) => Err(Error::NotFound { what: format!("name: snapshot '{name}'") }),
            Err(error) => Err(Error::io(path, error)),
        }
    }

    /// Where a new snapshot goes; without a name, one that says when it was made. Makes the folder.
    pub fn place(&self, name: Option<&str>) -> Result<(String, PathBuf)> {
        let name = match name {
            Some(name) => name.to_owned(),
            None => self.unused("manual-")?,
        };
        check_name(&name)?;
        if name.starts_with(TIMED) {
            let problem = format!("'{name}': names that begin with {TIMED} are the timer's own");
            return Err(Error::invalid("name", problem));
        }
        fs::create_dir_all(&self.0).map_err(|e| Error::io(&self.0, e))?;
        let names = self.names()?;
        if names.contains(&name) {
            let problem = format!("snapshot '{name}' exists already; delete it first");
            return Err(Error::FailedPrecondition(problem));
        }
        if names.len() >= MAX_SNAPSHOTS {
            return Err(Error::ResourceExhausted {
                what: "snapshots of one map".into(),
                limit: format!("the limit is {MAX_SNAPSHOTS}; delete some"),
            });
        }
        let path = self.path(&name);
        Ok((name, path))
    }

    /// Takes one away.
    pub fn delete(&self, name: &str) -> Result<()> {
        let path = self.find(name)?;
        fs::remove_file(&path).map_err(|e| Error::io(&path, e))?;
        sync_folder(&self.0)
    }

    /// Keeps what `file` holds now as a timed snapshot, and of those the newest `keep`. The file is
    /// never written to again, only replaced, so that both names can stand for the same bytes.
    pub fn keep_timed(&self, file: &Path, keep: usize) -> Result<()> {
        if keep > 0 {
            fs::create_dir_all(&self.0).map_err(|e| Error::io(&self.0, e))?;
            let path = self.path(&self.unused(TIMED)?);
            if fs::hard_link(file, &path).is_err() {
                // Not every file system has links.
                super::write_file(&path, |out| std::io::copy(&mut File::open(file)?, out))?;
            }
        }
        let timed = |name: &String| name.starts_with(TIMED);
        let mut timed: Vec<String> = self.names()?.into_iter().filter(timed).collect();
        timed.truncate(timed.len().saturating_sub(keep));
        timed.iter().try_for_each(|name| self.delete(name))
    }

    /// Begins to take in a snapshot from outside, of at most `most` bytes.
    pub fn receive(&self, name: &str, most: u64) -> Result<Receiving> {
        static NUMBER: AtomicU64 = AtomicU64::new(0);
        let (name, path) = self.place(Some(name))?;
        let number = NUMBER.fetch_add(1, Relaxed);
        let temporary = self.0.join(format!(".{name}.{}-{number}.upload", std::process::id()));
        let file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .open(&temporary)
            .map_err(|e| Error::io(&temporary, e))?;
        Ok(Receiving { shelf: self.clone(), name, path, temporary, file, bytes: 0, most })
    }

    /// Removes what writers left that did not come to their end.
    pub fn tidy(&self) -> Result<()> {
        let Some(entries) = self.entries()? else { return Ok(()) };
        for name in entries.into_iter().filter(|name| name.starts_with('.')) {
            let path = self.0.join(name);
            fs::remove_file(&path).map_err(|e| Error::io(&path, e))?;
        }
        Ok(())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(format!("{name}{EXTENSION}"))
    }

    fn names(&self) -> Result<Vec<String>> {
        let entries = self.entries()?.unwrap_or_default();
        let named = |file: &String| {
            let name = file.strip_suffix(EXTENSION)?;
            check_name(name).is_ok().then(|| name.to_owned())
        };
        let mut names: Vec<String> = entries.iter().filter_map(named).collect();
        names.sort_unstable();
        Ok(names)
    }

    /// The names of all files; `None` where there is no folder yet.
    fn entries(&self) -> Result<Option<Vec<String>>> {
        let entries = match fs::read_dir(&self.0) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Error::io(&self.0, error)),
        };
        let name = |entry: std::io::Result<fs::DirEntry>| {
            let entry = entry.map_err(|e| Error::io(&self.0, e))?;
            Ok(entry.file_name().to_string_lossy().into_owned())
        };
        entries.map(name).collect::<Result<_>>().map(Some)
    }

    /// A name that says when it was made, after all those of the same moment.
    fn unused(&self, prefix: &str) -> Result<String> {
        let name = format!("{prefix}{}", stamp(SystemTime::now()));
        let number = |taken: &String| match taken.strip_prefix(&name)? {
            "" => Some(0),
            rest => rest.strip_prefix('-')?.parse::<u32>().ok(),
        };
        let last = self.names()?.iter().filter_map(number).max();
        Ok(last.map_or_else(|| name.clone(), |last| format!("{name}-{:03}", last + 1)))
    }
}

/// A snapshot on its way in. Unless it is finished, nothing of it stays.
#[derive(Debug)]
pub struct Receiving {
    shelf: Shelf,
    name: String,
    path: PathBuf,
    temporary: PathBuf,
    file: File,
    bytes: u64,
    most: u64,
}

impl Receiving {
    /// The next bytes.
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.bytes += bytes.len() as u64;
        if self.bytes > self.most {
            return Err(Error::ResourceExhausted {
                what: format!("snapshot '{}'", self.name),
                limit: format!("more than {} MiB (storage.max_snapshot_mib)", self.most >> 20),
            });
        }
        self.file.write_all(bytes).map_err(|e| Error::io(&self.temporary, e))
    }

    /// Checks every byte, and only then gives it its name.
    pub fn finish(self) -> Result<Snapshot> {
        self.file.sync_all().map_err(|e| Error::io(&self.temporary, e))?;
        Summary::verify(&self.temporary).map_err(|error| {
            let shown = self.temporary.display().to_string();
            let problem = error.to_string().replace(&shown, &self.name);
            Error::invalid("body", format!("is no snapshot: {problem}"))
        })?;
        // A link fails where a rename would replace what came in between.
        fs::hard_link(&self.temporary, &self.path)
            .or_else(|error| match error.kind() {
                ErrorKind::AlreadyExists => Err(error),
                _ => fs::rename(&self.temporary, &self.path),
            })
            .map_err(|e| Error::io(&self.path, e))?;
        sync_folder(&self.shelf.0)?;
        self.shelf.describe(&self.name)
    }
}

impl Drop for Receiving {
    fn drop(&mut self) {
        // Gone already where a rename gave it its name.
        let _ = fs::remove_file(&self.temporary);
    }
}

/// Gives what is in the way another name, `<name>.damaged-<time>`; `None` if nothing is. It is never
/// deleted here: who looks into it may want it back.
pub fn set_aside(path: &Path) -> Result<Option<PathBuf>> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let aside = path.with_file_name(format!("{name}.damaged-{}", stamp(SystemTime::now())));
    match fs::rename(path, &aside) {
        Ok(()) => Ok(Some(aside)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::io(path, error)),
    }
}

/// Makes the names in a folder last.
fn sync_folder(folder: &Path) -> Result<()> {
    File::open(folder).and_then(|dir| dir.sync_all()).map_err(|e| Error::io(folder, e))
}

/// Refuses what is no good name for a file and a part of a URL.
fn check_name(name: &str) -> Result<()> {
    let is_plain = |c: u8| c.is_ascii_lowercase() || c.is_ascii_digit();
    let is_good = name.len() <= MAX_NAME
        && name.bytes().next().is_some_and(is_plain)
        && name.bytes().all(|c| is_plain(c) || c == b'-' || c == b'_');
    if is_good {
        return Ok(());
    }
    let shown: String = name.chars().take(MAX_NAME).collect();
    let problem = format!(
        "'{shown}' must be 1 to {MAX_NAME} of a-z, 0-9, - and _, and begin with a letter or a digit"
    );
    Err(Error::invalid("name", problem))
}

/// A time as a part of a name, UTC: `20261129-093000-123`. Names sort by age.
fn stamp(at: SystemTime) -> String {
    let since = at.duration_since(UNIX_EPOCH).unwrap_or_default();
    let (days, seconds) = (since.as_secs() / 86_400, since.as_secs() % 86_400);
    let (year, month, day) = civil(days as i64);
    format!(
        "{year:04}{month:02}{day:02}-{:02}{:02}{:02}-{:03}",
        seconds / 3600,
        seconds / 60 % 60,
        seconds % 60,
        since.subsec_millis()
    )
}

/// The date of a day since 1970 (the proleptic Gregorian calendar, in years that begin in March).
fn civil(days: i64) -> (i64, i64, i64) {
    let days = days + 719_468;
    let era = days.div_euclid(146_097);
    let day_of_era = days.rem_euclid(146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    (year_of_era + era * 400 + i64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::config::{MapConfig, MapSettings};
    use crate::map::Mapper;
    use crate::storage::{Mark, save_marked};

    fn map_file(folder: &Path) -> PathBuf {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        let path = folder.join("map.orenx");
        save_marked(&Mapper::new(config).expect("empty"), Mark::default(), &path).expect("saved");
        path
    }

    fn names(shelf: &Shelf) -> Vec<String> {
        shelf.list().expect("a list").into_iter().map(|snapshot| snapshot.name).collect()
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, expected) in [
            (0, "19700101-000000-000"),
            (951_782_400, "20000229-000000-000"),
            (1_795_944_645, "20261129-093045-000"),
            (4_107_542_399, "21000228-235959-000"),
        ] {
            assert_eq!(stamp(UNIX_EPOCH + Duration::from_secs(seconds)), expected);
        }
    }

    #[test]
    fn timed_ones_go_and_named_ones_stay() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, shelf) = (map_file(folder.path()), Shelf::of(folder.path()));
        assert_eq!(names(&shelf), [""; 0], "no folder yet");
        let (_, place) = shelf.place(Some("before-lunch")).expect("free");
        fs::copy(&file, place).expect("copied");
        let mut timed = Vec::new();
        for _ in 0..5 {
            shelf.keep_timed(&file, 2).expect("kept");
            timed.extend(
                names(&shelf).into_iter().filter(|name| !timed.contains(name)).collect::<Vec<_>>(),
            );
        }
        timed.retain(|name| name.starts_with(TIMED));
        assert_eq!(names(&shelf), [&timed[3], &timed[4], "before-lunch"]);
        shelf.keep_timed(&file, 0).expect("none");
        assert_eq!(names(&shelf), ["before-lunch"]);
        shelf.delete("before-lunch").expect("there");
        assert_eq!(
            shelf.delete("before-lunch").expect_err("gone").status(),
            crate::error::Status::NotFound
        );
    }

    #[test]
    fn names_are_checked_and_not_taken_twice() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, shelf) = (map_file(folder.path()), Shelf::of(folder.path()));
        for bad in ["", "-a", "A", "../map", "a.b", "a b", &"a".repeat(65), "auto-mine"] {
            let error = shelf.place(Some(bad)).expect_err(bad).to_string();
            assert!(error.starts_with("name: ") && error.len() < 200, "{error}");
        }
        let (name, place) = shelf.place(None).expect("free");
        assert!(name.starts_with("manual-"), "{name}");
        fs::copy(&file, place).expect("copied");
        assert!(
            shelf.place(Some(&name)).expect_err("taken").to_string().contains("exists already")
        );
        assert_ne!(shelf.place(None).expect("free").0, name);
    }

    #[test]
    fn what_comes_in_is_checked_before_it_has_a_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, shelf) = (map_file(folder.path()), Shelf::of(folder.path()));
        let bytes = fs::read(&file).expect("a file");
        let receive = |bytes: &[u8], most: u64| {
            let mut receiving = shelf.receive("home", most)?;
            bytes.chunks(1000).try_for_each(|part| receiving.write(part))?;
            receiving.finish()
        };
        let most = bytes.len() as u64;
        let error = receive(&bytes, most - 1).expect_err("too large").to_string();
        assert!(error.contains("storage.max_snapshot_mib"), "{error}");
        let mut damaged = bytes.clone();
        damaged[bytes.len() / 2] ^= 4;
        for (bad, part) in [
            (&damaged[..], "body: is no snapshot: home: section"),
            (b"no map", "is not an orenx map"),
        ] {
            let error = receive(bad, most).expect_err(part).to_string();
            assert!(error.contains(part), "{error}");
        }
        drop(shelf.receive("home", most).expect("begun"));
        assert_eq!(fs::read_dir(&shelf.0).expect("a folder").count(), 0, "nothing is left");
        let snapshot = receive(&bytes, most).expect("a good one");
        assert_eq!(
            (snapshot.name.as_str(), snapshot.bytes, snapshot.problem.as_str()),
            ("home", most, "")
        );
        assert_eq!(fs::read(shelf.find("home").expect("there")).expect("read"), bytes);
        receive(&bytes, most).expect_err("it has that name already");
    }
}
