//! Which text encoder there is: as the settings file and the flags name it.

use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// What embeds text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EncoderKind {
    /// Nothing: questions and labels in words are refused.
    #[default]
    None,
    /// The mean of token vectors.
    Static,
    /// The text tower of a network.
    Onnx,
    /// The callers.
    External,
}

/// `[encoder]`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EncoderSettings {
    pub kind: EncoderKind,
    /// The files of a static or an ONNX encoder.
    pub folder: PathBuf,
    /// What callers call their encoder, and the numbers of its embeddings.
    pub id: String,
    pub dimension: u32,
}

impl EncoderSettings {
    /// Refuses a kind without what it needs; whether the files are good is found when they are opened.
    pub fn check(&self) -> Result<()> {
        let missing = |key: &str, what: &str| Err(Error::invalid(format!("encoder.{key}"), what));
        match self.kind {
            EncoderKind::Static | EncoderKind::Onnx if self.folder.as_os_str().is_empty() => {
                missing("folder", "is required: the encoder's files")
            }
            EncoderKind::External if self.id.trim().is_empty() => {
                missing("id", "is required: the name of the callers' encoder")
            }
            EncoderKind::External if self.dimension == 0 => {
                missing("dimension", "is required: the numbers of an embedding")
            }
            _ => Ok(()),
        }
    }
}

/// `static:FOLDER` or `onnx:FOLDER`, as a flag says it.
impl FromStr for EncoderSettings {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let (kind, folder) = match text.split_once(':') {
            Some(("static", folder)) => (EncoderKind::Static, folder),
            Some(("onnx", folder)) => (EncoderKind::Onnx, folder),
            _ => return Err("must be static:FOLDER or onnx:FOLDER".into()),
        };
        if folder.is_empty() {
            return Err("names no folder".into());
        }
        Ok(Self { kind, folder: folder.into(), ..Self::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_has_what_it_needs() {
        let settings = |kind, folder: &str, id: &str, dimension| EncoderSettings {
            kind,
            folder: folder.into(),
            id: id.into(),
            dimension,
        };
        use EncoderKind as Kind;
        for good in [
            EncoderSettings::default(),
            settings(Kind::Static, "table", "", 0),
            settings(Kind::Onnx, "clip", "", 0),
            settings(Kind::External, "", "clip", 512),
        ] {
            good.check().expect("complete");
        }
        for (wrong, field) in [
            (settings(Kind::Static, "", "table", 1), "encoder.folder"),
            (settings(Kind::Onnx, "", "", 0), "encoder.folder"),
            (settings(Kind::External, "", " ", 512), "encoder.id"),
            (settings(Kind::External, "", "clip", 0), "encoder.dimension"),
        ] {
            assert_eq!(wrong.check().expect_err(field).field(), Some(field));
        }
    }

    #[test]
    fn a_flag_names_kind_and_folder() {
        let read = |text: &str| text.parse::<EncoderSettings>();
        let read_static = read("static:a/b:c").expect("a folder");
        assert_eq!((read_static.kind, read_static.folder), (EncoderKind::Static, "a/b:c".into()));
        assert_eq!(read("onnx:x").expect("a folder").kind, EncoderKind::Onnx);
        for wrong in ["", "static", "static:", "clip:x", "external:x"] {
            assert!(read(wrong).is_err(), "{wrong}");
        }
    }
}
