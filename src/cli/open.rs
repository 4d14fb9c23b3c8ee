//! What commands that read a map start from.

use std::path::Path;
use std::sync::Arc;

use crate::error::{Error, Result};
use crate::map::MapView;

/// The view that a map file holds.
pub(super) fn open_view(path: &Path) -> Result<Arc<MapView>> {
    if !path.is_file() {
        return Err(Error::NotFound { what: format!("map file {}", path.display()) });
    }
    Err(Error::Unavailable("this build cannot read map files".to_owned()))
}

/// Whether a MAP argument names a server.
pub(super) fn is_url(map: &str) -> bool {
    ["http://", "https://", "grpc://"].iter().any(|scheme| map.starts_with(scheme))
}

/// Writes a file under a temporary name and renames it at the end, so that nobody reads half of
/// one, and a failure leaves what was there.
pub(super) fn write_whole<T>(
    path: &Path,
    write: impl FnOnce(&mut std::io::BufWriter<&mut std::fs::File>) -> std::io::Result<T>,
) -> Result<T> {
    let fail = |e| Error::io(path, e);
    let mut file = tempfile::NamedTempFile::new_in(folder_of(path)).map_err(fail)?;
    let mut out = std::io::BufWriter::new(file.as_file_mut());
    let value = write(&mut out).map_err(fail)?;
    std::io::Write::flush(&mut out).map_err(fail)?;
    drop(out);
    make_readable(file.path()).map_err(fail)?;
    file.persist(path).map_err(|e| Error::io(path, e.error))?;
    Ok(value)
}

/// The folder of a file, where its temporary neighbours go.
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Temporary files are private; results are for everybody that the folder is for.
#[cfg(unix)]
fn make_readable(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn make_readable(_path: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("out.txt");
        write_whole(&path, |out| out.write_all(b"old")).expect("written");
        let failed = write_whole(&path, |out| {
            out.write_all(b"half")?;
            Err::<(), _>(std::io::Error::other("disk full"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).expect("there"), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).expect("there").count(), 1);
    }

    #[test]
    fn urls_are_told_from_files() {
        assert!(is_url("http://127.0.0.1:7610") && is_url("grpc://host:7610"));
        assert!(!is_url("office.orenx") && !is_url("./http:/x"));
    }
}
