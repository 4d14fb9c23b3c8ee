//! Files that are there whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Leftovers of crashed writers that are stepped over before giving up.
const MAX_LEFTOVERS: u32 = 16;

/// Writes `path` by way of a temporary file beside it, which takes its name once its bytes are on
/// the disk. Readers see the old file or the new one; after a crash or an error the old one stands.
pub fn write_file<T>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
) -> Result<T> {
    let name = path.file_name().ok_or_else(|| Error::invalid("path", "must name a file"))?;
    let dir = folder_of(path);
    let (temporary, file) = create_beside(dir, &name.to_string_lossy())?;
    let written = write_and_sync(file, write)
        .and_then(|value| fs::rename(&temporary, path).map(|()| value))
        .map_err(|source| {
            // The first error is the one to tell; a temporary file that stays is stepped over.
            let _ = fs::remove_file(&temporary);
            Error::io(path, source)
        })?;
    // The new name lives in the folder: without this a power cut may bring the old one back.
    File::open(dir).and_then(|dir| dir.sync_all()).map_err(|source| Error::io(dir, source))?;
    Ok(written)
}

/// The folder that a file is in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."))
}

fn create_beside(dir: &Path, name: &str) -> Result<(PathBuf, File)> {
    for attempt in 0..MAX_LEFTOVERS {
        let path = dir.join(format!(".{name}.{attempt}.tmp"));
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => return Ok((path, file)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(Error::io(path, error)),
        }
    }
    Err(Error::FailedPrecondition(format!(
        "{}: {MAX_LEFTOVERS} files .{name}.*.tmp are in the way; remove them",
        dir.display()
    )))
}

fn write_and_sync<T>(
    file: File,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<T>,
) -> io::Result<T> {
    let mut buffered = BufWriter::new(file);
    let value = write(&mut buffered)?;
    buffered.flush()?;
    buffered.get_ref().sync_all()?;
    Ok(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(dir)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.orenx");
        write_file(&path, |out| out.write_all(b"old")).unwrap();
        let error = write_file(&path, |out| {
            out.write_all(b"half of the new")?;
            Err::<(), _>(io::Error::other("disk full"))
        });
        assert!(error.unwrap_err().to_string().contains("disk full"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.orenx"]);
    }

    #[test]
    fn a_leftover_is_stepped_over_and_many_are_an_error() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.orenx");
        fs::write(dir.path().join(".a.orenx.0.tmp"), b"crashed").unwrap();
        write_file(&path, |out| out.write_all(b"new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()), [".a.orenx.0.tmp", "a.orenx"]);
        for attempt in 0..MAX_LEFTOVERS {
            fs::write(dir.path().join(format!(".a.orenx.{attempt}.tmp")), b"").unwrap();
        }
        let error = write_file(&path, |out| out.write_all(b"newer")).unwrap_err();
        assert!(error.to_string().contains("remove them"), "{error}");
        assert_eq!(fs::read(&path).unwrap(), b"new");
    }

    #[test]
    fn a_missing_folder_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let error = write_file(&dir.path().join("no/a.orenx"), |_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("no/.a.orenx.0.tmp"), "{error}");
    }
}
