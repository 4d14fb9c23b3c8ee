//! What commands that read a map start from.

use std::path::Path;
use std::sync::Arc;

use clap::Args;
use tokio::runtime::Runtime;

use crate::error::{Error, Result};
use crate::map::MapView;
use crate::service::DEFAULT_MAP;
use crate::storage;

/// Which of a server's maps is asked.
#[derive(Debug, Args)]
pub(super) struct MapName {
    /// Of a server's maps the one to ask; left out: "default"
    #[arg(long = "map", id = "map_name", value_name = "NAME")]
    name: Option<String>,
}

impl MapName {
    /// Its name on the server that `map` names; a file holds one map, whatever its name.
    pub(super) fn of(&self, map: &str) -> Result<String> {
        match &self.name {
            Some(_) if !is_url(map) => {
                Err(Error::invalid("map", "is for servers: a file holds one map"))
            }
            name => Ok(name.clone().unwrap_or_else(|| DEFAULT_MAP.to_owned())),
        }
    }
}

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
    fn maps_of_servers_have_names_and_those_of_files_have_none() {
        let (named, usual) = (MapName { name: Some("yard".into()) }, MapName { name: None });
        assert_eq!(named.of("grpc://host:7610").expect("a server"), "yard");
        assert_eq!(usual.of("grpc://host:7610").expect("a server"), DEFAULT_MAP);
        assert!(usual.of("office.orenx").is_ok());
        let error = named.of("office.orenx").expect_err("a file").to_string();
        assert!(error.contains("for servers"), "{error}");
    }

    #[test]
    fn urls_are_told_from_files() {
        assert!(is_url("http://127.0.0.1:7610") && is_url("grpc://host:7610"));
        assert!(is_url("zenoh+tcp://host:7447/fleet"));
        assert!(!is_url("office.orenx") && !is_url("./http:/x"));
    }
}
