//! What classes a recording in the 7-Scenes layout shows: `labels.json` names them,
//! `frame-*.label.png` has the id of one at each pixel, 0 for none.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use serde::Deserialize;

use super::text;
use crate::error::{Error, Result};
use crate::frame::{Class, LabelImage};

/// The names, beside the images: `{"classes": {"1": "chair", …}}`.
pub(super) const CLASSES_FILE: &str = "labels.json";
/// What the images' names end in.
pub(super) const SUFFIX: &str = ".label.png";

/// Whether a folder names classes of pixels.
pub fn has_labels(folder: &Path) -> bool {
    folder.join(CLASSES_FILE).exists()
}

#[derive(Deserialize)]
struct ClassesFile {
    classes: BTreeMap<String, String>,
}

/// The classes of a folder, sorted by id; `None` where nothing is labelled.
pub(super) fn classes(folder: &Path) -> Result<Option<Arc<[Class]>>> {
    let path = folder.join(CLASSES_FILE);
    if let Ok(false) = path.try_exists() {
        return Ok(None);
    }
    let place = path.display().to_string();
    let file: ClassesFile = serde_json::from_str(&text::read(&path)?).map_err(|e| {
        Error::invalid(&place, format!("must be {{\"classes\": {{id: name}}}}: {e}"))
    })?;
    let class = |(id, name): (String, String)| match id.parse() {
        Ok(id) => Ok(Class { id, name }),
        Err(_) => Err(Error::invalid(&place, format!("the id '{id}' must lie within 1..=65535"))),
    };
    let mut classes = file.classes.into_iter().map(class).collect::<Result<Vec<_>>>()?;
    classes.sort_by_key(|class| class.id);
    let classes: Arc<[Class]> = classes.into();
    // The same rules as for labels that come with a frame.
    let none = LabelImage { width: 1, height: 1, ids: vec![0], classes: Arc::clone(&classes) };
    none.check().map_err(|e| text::at(&place, &e))?;
    Ok(Some(classes))
}
