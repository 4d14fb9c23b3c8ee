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

/// The folder of a file, where its temporary neighbours go.
pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_told_from_files() {
        assert!(is_url("http://127.0.0.1:7610") && is_url("grpc://host:7610"));
        assert!(!is_url("office.orenx") && !is_url("./http:/x"));
    }
}
