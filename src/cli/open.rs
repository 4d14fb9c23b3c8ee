//! What commands that read a map start from.

use std::path::Path;
use std::sync::Arc;

use tokio::runtime::Runtime;

use crate::error::{Error, Result};
use crate::map::MapView;
use crate::storage;

/// The view that a map file holds.
pub(super) fn open_view(path: &Path) -> Result<Arc<MapView>> {
    if !path.is_file() {
        return Err(Error::NotFound { what: format!("map file {}", path.display()) });
    }
    storage::load_view(path)
}

/// Whether a MAP argument names a server.
pub(super) fn is_url(map: &str) -> bool {
    ["http://", "https://", "grpc://", "grpcs://", "zenoh+"]
        .iter()
        .any(|scheme| map.starts_with(scheme))
}

/// What a command that asks a server waits in: Zenoh wants threads beside the one that waits.
pub(super) fn asking_runtime() -> Result<Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .map_err(|e| Error::Internal(format!("cannot start a runtime: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_told_from_files() {
        assert!(is_url("http://127.0.0.1:7610") && is_url("grpc://host:7610"));
        assert!(is_url("zenoh+tcp://host:7447/fleet"));
        assert!(!is_url("office.orenx") && !is_url("./http:/x"));
    }
}
