//! Maps the journal's tail again: the frames that a map's file has not.

use std::fs::OpenOptions;
use std::path::Path;

use super::journal::Segment;
use super::persist::Past;
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage::{self, End, Reading, folder_of, journal_folder};

/// Frames between two publications, which keep small what is noted for the next one.
const PUBLISH_EVERY: u64 = 32;

/// What reading the journal brought.
#[derive(Default)]
struct Tally {
    mapped: u64,
    refused: u64,
    /// Frames that were in the map and that nothing is left of.
    missing: u64,
    newest_epoch: u64,
    notes: Vec<String>,
}

/// Brings `mapper`, which was loaded from the file at `path` or is empty, to where its journal ends. What
/// is wrong with the journal is noted and does not keep the map from being served.
pub(super) fn replay(
    mapper: &mut Mapper,
    path: &Path,
    is_loaded: bool,
    mut past: Past,
) -> Result<Past> {
    let mut tally = Tally::default();
    let listed = storage::segments(&journal_folder(folder_of(path))).unwrap_or_else(|error| {
        tally.notes.push(error.to_string());
        Vec::new()
    });
    let count = listed.len();
    for (number, (first, file)) in listed.into_iter().enumerate() {
        let is_last = number + 1 == count;
        match Reading::open(&file, first) {
            Ok(reading) => {
                let adopts = !is_loaded && past.mark.journal == 0;
                match take(mapper, &mut past, &mut tally, reading, adopts)? {
                    Some(taken) => past.segments.extend(ended(taken, &file, is_last, &mut tally)),
                    None => tally.set_aside(&file),
                }
            }
            Err(error) => {
                tally.notes.push(error.to_string());
                tally.set_aside(&file);
            }
        }
    }
    if tally.mapped > 0 {
        // Later than any epoch that a sender was told.
        mapper.succeed(tally.newest_epoch);
    }
    past.recovery = tally.told();
    if !past.recovery.is_empty() {
        tracing::warn!("{}: {}", path.display(), past.recovery);
    }
    Ok(past)
}

/// A segment that was read, and how that ended.
struct Taken {
    frames: u64,
    last: u64,
    bytes: u64,
    end: End,
}

/// Maps the frames of a segment that are not in the map; `None` if it is of another journal.
fn take(
    mapper: &mut Mapper,
    past: &mut Past,
    tally: &mut Tally,
    mut reading: Reading,
    adopts: bool,
) -> Result<Option<Taken>> {
    let mut frames = 0;
    let first = reading.next_position();
    while let Some(entry) = reading.next_entry() {
        if adopts && past.mark.journal == 0 {
            past.mark.journal = reading.journal().unwrap_or(0);
            past.is_anchored = true;
        }
        if reading.journal() != Some(past.mark.journal) {
            let problem = format!("frames from {first} on are of another map's journal");
            tally.notes.push(problem);
            return Ok(None);
        }
        frames += 1;
        if entry.position <= past.mark.position {
            continue;
        }
        tally.missing += entry.position - past.mark.position - 1;
        past.mark.position = entry.position;
        tally.newest_epoch = tally.newest_epoch.max(entry.epoch);
        match mapper.integrate(&entry.frame) {
            Ok(_) => tally.mapped += 1,
            Err(lost @ Error::DeviceLost(_)) => return Err(lost),
            Err(error) => {
                tracing::warn!("frame {} of the journal: {error}", entry.position);
                tally.refused += 1;
            }
        }
        if tally.mapped.is_multiple_of(PUBLISH_EVERY) {
            mapper.publish();
        }
    }
    let last = reading.next_position().saturating_sub(1);
    Ok(Some(Taken { frames, last, bytes: reading.bytes(), end: reading.end() }))
}

/// Notes how a segment ended. What a crash left behind the last whole frames is cut off.
/// A file without any is in the way of the next one of its name.
fn ended(taken: Taken, file: &Path, is_last: bool, tally: &mut Tally) -> Option<Segment> {
    let Taken { frames, last, mut bytes, end } = taken;
    let is_damaged = match end {
        End::Whole => false,
        End::Torn { at } if is_last => {
            let cut = OpenOptions::new().write(true).open(file).and_then(|f| f.set_len(at));
            tally.notes.push(match cut {
                Ok(()) => format!("{} bytes that were not whole were cut off", bytes - at),
                Err(error) => format!("{} bytes are not whole: {error}", bytes - at),
            });
            bytes = at;
            false
        }
        End::Torn { at } => {
            tally.notes.push(format!("{} is cut at byte {at}", file.display()));
            true
        }
        End::Damaged { at, problem } => {
            tally.notes.push(format!("{problem}, at byte {at}; what follows there is lost"));
            true
        }
    };
    if frames > 0 {
        return Some(Segment { path: file.into(), last, frames, bytes, is_damaged });
    }
    if is_damaged {
        tally.set_aside(file);
    } else if let Err(error) = std::fs::remove_file(file) {
        tally.notes.push(Error::io(file, error).to_string());
    }
    None
}

impl Tally {
    /// Moves a segment that is of no use here out of the way.
    fn set_aside(&mut self, file: &Path) {
        match storage::set_aside(file) {
            Ok(Some(aside)) => self.notes.push(format!("it is now {}", aside.display())),
            Ok(None) => {}
            Err(error) => self.notes.push(error.to_string()),
        }
    }

    /// For people; empty if there is nothing to tell.
    fn told(&self) -> String {
        let counts = [
            (self.mapped, "frames of the journal were mapped again"),
            (self.refused, "were refused"),
            (self.missing, "are missing: they were mapped without the journal, or lost with it"),
        ];
        let counts = counts.iter().filter(|(count, _)| *count > 0);
        let mut told: Vec<String> = counts.map(|(count, what)| format!("{count} {what}")).collect();
        told.extend(self.notes.iter().cloned());
        told.join("; ")
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::config::{MapConfig, MapSettings};
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;
    use crate::engine::persist::recover;
    use crate::storage::{Entry, Mark, SegmentWriter, save_marked};

    fn config() -> MapConfig {
        let settings = MapSettings { steps: Some(0), ..MapSettings::default() };
        MapConfig::from_settings(&settings).expect("valid")
    }

    /// A folder with a map file that is empty and says `mark`, if it is there.
    fn folder(mark: Option<Mark>) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("map.orenx");
        if let Some(mark) = mark {
            save_marked(&Mapper::new(config()).expect("empty"), mark, &path).expect("saved");
        }
        (folder, path)
    }

    /// A segment of the positions, each frame in a chunk of its own; its file.
    fn segment(map: &Path, journal: u64, positions: std::ops::Range<u64>) -> PathBuf {
        let room = Synthetic::room(100).with_width(32);
        let folder = journal_folder(folder_of(map));
        let mut writer =
            SegmentWriter::create(&folder, "m", journal, positions.start).expect("a segment");
        for position in positions {
            let frame = room.load(position as usize, false).expect("a frame");
            writer.append([&Entry { position, epoch: 10 + position, frame }]).expect("written");
        }
        let path = writer.path().to_owned();
        writer.finish();
        path
    }

    fn recovered(path: &Path) -> (Mapper, Past) {
        recover(path, config(), |_| Ok(())).expect("a map")
    }

    #[test]
    fn what_the_file_has_is_not_mapped_twice() {
        let (_folder, path) = folder(Some(Mark { journal: 7, position: 2 }));
        segment(&path, 7, 1..4);
        segment(&path, 7, 4..6);
        let (mut mapper, past) = recovered(&path);
        assert_eq!(mapper.stats().frames, 3);
        assert_eq!((past.mark, past.is_anchored), (Mark { journal: 7, position: 5 }, true));
        assert_eq!(past.recovery, "3 frames of the journal were mapped again");
        assert_eq!(
            past.segments.iter().map(|s| (s.last, s.frames)).collect::<Vec<_>>(),
            [(3, 3), (5, 2)]
        );
        assert_eq!(mapper.publish().epoch(), 16, "after every epoch that was told");
        // Mapped directly, the same frames give the same map.
        let mut plain = Mapper::new(config()).expect("empty");
        let room = Synthetic::room(100).with_width(32);
        for index in 3..6 {
            plain.integrate(&room.load(index, false).expect("a frame")).expect("taken");
        }
        assert_eq!(plain.stats().surfels, mapper.stats().surfels);
    }

    #[test]
    fn without_a_file_the_journal_is_the_map_and_another_map_s_is_set_aside() {
        let (_folder, path) = folder(None);
        segment(&path, 7, 1..3);
        let (mapper, past) = recovered(&path);
        assert_eq!(
            (mapper.stats().frames, past.mark, past.is_anchored),
            (2, Mark { journal: 7, position: 2 }, true)
        );

        for mark in [Mark { journal: 8, position: 0 }, Mark::default()] {
            let (_folder, path) = folder(Some(mark));
            let file = segment(&path, 7, 1..3);
            let (mapper, past) = recovered(&path);
            assert_eq!((mapper.stats().frames, past.segments.len()), (0, 0));
            assert!(past.recovery.contains("another map's journal"), "{}", past.recovery);
            assert!(!file.exists(), "it is out of the way, and not gone");
            let names = std::fs::read_dir(journal_folder(folder_of(&path))).expect("a folder");
            assert_eq!(names.count(), 1);
        }
    }

    #[test]
    fn damage_ends_a_segment_and_not_the_next() {
        let (_folder, path) = folder(Some(Mark { journal: 7, position: 0 }));
        let file = segment(&path, 7, 1..4);
        segment(&path, 7, 4..6);
        let mut bytes = std::fs::read(&file).expect("read");
        let at = bytes.len() / 2;
        bytes[at] ^= 1;
        std::fs::write(&file, &bytes).expect("written");
        let (mapper, past) = recovered(&path);
        let frames = mapper.stats().frames;
        assert!((2..5).contains(&frames), "{frames}");
        assert_eq!(past.mark.position, 5);
        assert!(
            past.recovery.contains(&format!("{} are missing", 5 - frames)),
            "{}",
            past.recovery
        );
        assert!(past.recovery.contains("what follows there is lost"), "{}", past.recovery);
        assert!(past.segments.iter().all(|s| s.is_damaged == (s.path == file)), "{past:?}");
    }
}
