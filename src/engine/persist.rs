//! The map on disk, as the mapper thread needs it: loaded before it starts, saved when it stops.

use std::path::Path;

use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::map::Mapper;
use crate::storage;

/// The mapper of the file at `path`, or an empty one with `config` if there is no file.
pub fn load(path: &Path, config: MapConfig) -> Result<Mapper> {
    match path.try_exists() {
        Ok(false) => Mapper::new(config),
        Ok(true) => storage::load(path),
        Err(source) => Err(Error::io(path, source)),
    }
}
