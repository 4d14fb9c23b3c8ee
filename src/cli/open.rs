//! What commands that read a map start from.

use std::path::Path;
use std::sync::Arc;

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
    ["http://", "https://", "grpc://"].iter().any(|scheme| map.starts_with(scheme))
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
