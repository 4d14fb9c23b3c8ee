//! Text encoders: a phrase becomes a direction, and what means the same points the same way.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::cache::{Cache, CacheCounts};
use super::onnx_text::OnnxText;
use super::static_table::StaticTable;
use crate::config::{EncoderKind, EncoderSettings};
use crate::error::{Error, Result};
use crate::frame::Contract;

/// The longest text: a sentence, not a page.
pub const MAX_TEXT_BYTES: usize = 512;
/// How many texts are embedded at a time: the classes of a large vocabulary.
pub const MAX_TEXTS: usize = 4096;
/// How many texts stay embedded: at most 16 MiB of 4096 numbers each.
const CACHE_TEXTS: usize = 1024;

/// What embeds a text, before it is scaled to length 1.
pub(super) trait Source: Send + Sync {
    /// Zero where the text says nothing to the encoder. An invalid argument is the text.
    fn embed(&self, text: &str) -> Result<Vec<f32>>;
}

/// An encoder and the contract that it stands for: embeddings may be compared if their encoders have
/// the same id, and so the same dimension. All have length 1.
pub struct TextEncoder {
    contract: Contract,
    /// None: callers embed.
    source: Option<Box<dyn Source>>,
    cache: Cache,
}

impl TextEncoder {
    /// The encoder that settings ask for, if they ask for one.
    pub fn open(settings: &EncoderSettings) -> Result<Option<Self>> {
        settings.check()?;
        match settings.kind {
            EncoderKind::None => Ok(None),
            EncoderKind::Static => Self::open_static(&settings.folder).map(Some),
            EncoderKind::Onnx => Self::open_onnx(&settings.folder).map(Some),
            EncoderKind::External => {
                Self::external(&settings.id, settings.dimension as usize).map(Some)
            }
        }
    }

    /// The mean of token vectors: `folder` has one `NAME.safetensors` and `tokenizer.json`. The id is
    /// `static:NAME:CHECKSUM`.
    pub fn open_static(folder: &Path) -> Result<Self> {
        let table = only_file(folder, "safetensors")?;
        let (source, content) = StaticTable::load(&table, &folder.join("tokenizer.json"))?;
        let dimension = source.dimension();
        Self::new(id_of("static", &table, content), dimension, Some(Box::new(source)))
    }

    /// The text tower of a network: `folder` has one `NAME.onnx` and `tokenizer.json`. The id is
    /// `onnx:NAME:CHECKSUM`.
    pub fn open_onnx(folder: &Path) -> Result<Self> {
        let model = only_file(folder, "onnx")?;
        let (source, content) = OnnxText::load(&model, &folder.join("tokenizer.json"))?;
        let dimension = source.dimension();
        Self::new(id_of("onnx", &model, content), dimension, Some(Box::new(source)))
    }

    /// An encoder that only callers have: they name it `id`, and send embeddings of `dimension`
    /// numbers instead of text.
    pub fn external(id: &str, dimension: usize) -> Result<Self> {
        Self::new(id.to_owned(), dimension, None)
    }

    fn new(id: String, dimension: usize, source: Option<Box<dyn Source>>) -> Result<Self> {
        let contract = Contract { encoder_id: id.into(), dimension };
        contract.check("encoder")?;
        Ok(Self { contract, source, cache: Cache::new(CACHE_TEXTS) })
    }

    /// Names the encoder and its content, and says how many numbers an embedding has.
    pub fn contract(&self) -> &Contract {
        &self.contract
    }

    /// How often a text was known already.
    pub fn cache_counts(&self) -> CacheCounts {
        self.cache.counts()
    }

    /// The embedding of each text, of length 1; [`TextEncoder::embed_field`] with a field `texts`.
    pub fn embed(&self, texts: &[&str]) -> Result<Vec<Vec<f32>>> {
        self.embed_field("texts", texts)
    }

    /// The embedding of each text, of length 1. Errors call them `field[0]`, `field[1]` and so on. All
    /// texts are checked before the first is embedded.
    pub fn embed_field(&self, field: &str, texts: &[&str]) -> Result<Vec<Vec<f32>>> {
        self.embed_named(field, |index| format!("{field}[{index}]"), texts)
    }

    /// The same, where `name_of` says what errors call the text of a place.
    pub(super) fn embed_named(
        &self,
        field: &str,
        name_of: impl Fn(usize) -> String,
        texts: &[&str],
    ) -> Result<Vec<Vec<f32>>> {
        let Some(source) = &self.source else {
            return Err(Error::FailedPrecondition(format!(
                "{field}: the encoder '{}' embeds no text here; send embeddings of {} numbers",
                self.contract.encoder_id, self.contract.dimension
            )));
        };
        if texts.len() > MAX_TEXTS {
            let problem = format!("are {}; the limit is {MAX_TEXTS}", texts.len());
            return Err(Error::invalid(field, problem));
        }
        let mut trimmed = Vec::with_capacity(texts.len());
        for (index, text) in texts.iter().enumerate() {
            let text = checked(text);
            trimmed.push(text.map_err(|problem| Error::invalid(name_of(index), problem))?);
        }
        let mut embeddings = Vec::with_capacity(texts.len());
        for (index, text) in trimmed.into_iter().enumerate() {
            let embedding = self.embed_one(source.as_ref(), text).map_err(|error| match error {
                Error::InvalidArgument { problem, .. } => Error::invalid(name_of(index), problem),
                other => other,
            })?;
            embeddings.push(embedding.to_vec());
        }
        Ok(embeddings)
    }

    /// No lock is held while a text is embedded.
    fn embed_one(&self, source: &dyn Source, text: &str) -> Result<Arc<[f32]>> {
        if let Some(known) = self.cache.get(text) {
            return Ok(known);
        }
        let raw = source.embed(text)?;
        if raw.len() != self.contract.dimension || !raw.iter().all(|value| value.is_finite()) {
            let problem = format!("gave no {} finite numbers for a text", self.contract.dimension);
            return Err(Error::corrupt(&*self.contract.encoder_id, problem));
        }
        let nothing = || Error::invalid("text", "has no word that the encoder knows");
        let embedding: Arc<[f32]> = normalized(&raw).ok_or_else(nothing)?.into();
        self.cache.put(text, Arc::clone(&embedding));
        Ok(embedding)
    }
}

/// The text without space around it, or the limit that it breaks.
fn checked(text: &str) -> std::result::Result<&str, String> {
    if text.len() > MAX_TEXT_BYTES {
        return Err(format!("is {} bytes long; the limit is {MAX_TEXT_BYTES}", text.len()));
    }
    let trimmed = text.trim();
    if trimmed.is_empty() { Err("is empty".to_owned()) } else { Ok(trimmed) }
}

/// Length 1, in the same direction; none of nothing.
fn normalized(values: &[f32]) -> Option<Vec<f32>> {
    let length = values.iter().map(|v| f64::from(*v) * f64::from(*v)).sum::<f64>().sqrt();
    (length > 0.0).then(|| values.iter().map(|v| (f64::from(*v) / length) as f32).collect())
}

/// The one file of `folder` whose name ends in `.ending`.
fn only_file(folder: &Path, ending: &str) -> Result<PathBuf> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(|e| Error::io(folder, e))?.path();
        if path.extension().is_some_and(|its| its == ending) {
            found.push(path);
        }
    }
    match <[PathBuf; 1]>::try_from(found) {
        Ok([path]) => Ok(path),
        Err(found) => {
            let count = found.len();
            let problem = format!("has {count} files *.{ending}, where one is the encoder");
            Err(Error::invalid(folder.display().to_string(), problem))
        }
    }
}

fn id_of(kind: &str, file: &Path, content: u32) -> String {
    let name = file.file_stem().unwrap_or_default().to_string_lossy();
    format!("{kind}:{name}:{content:08x}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::test_files::static_folder;

    #[test]
    fn embeddings_have_length_one_and_are_cached() {
        let folder = static_folder();
        let encoder = TextEncoder::open_static(folder.path()).expect("an encoder");
        assert_eq!(encoder.contract().dimension, 2);
        let found = encoder.embed(&["red chair", "table", " red chair\n"]).expect("embeddings");
        let length = 53.0_f32.sqrt();
        assert!((found[0][0] - 7.0 / length).abs() < 1e-6, "{found:?}");
        assert!((found[0][1] - 2.0 / length).abs() < 1e-6, "{found:?}");
        assert_eq!(found[0], found[2]);
        assert_eq!(encoder.cache_counts(), CacheCounts { hits: 1, misses: 2 });
        assert_eq!(encoder.embed(&[]).expect("none"), [[0.0; 0]; 0]);
    }

    #[test]
    fn the_id_names_the_model_and_changes_with_its_content() {
        let folder = static_folder();
        let id = || {
            let encoder = TextEncoder::open_static(folder.path()).expect("an encoder");
            encoder.contract().encoder_id.clone()
        };
        let before = id();
        assert!(before.starts_with("static:tiny:") && before.len() == 20, "{before}");
        assert_eq!(id(), before);
        for name in ["tiny.safetensors", "tokenizer.json"] {
            let path = folder.path().join(name);
            let mut bytes = std::fs::read(&path).expect("read");
            let whole = bytes.clone();
            match name {
                "tokenizer.json" => bytes.push(b'\n'),
                _ => *bytes.last_mut().expect("not empty") ^= 1,
            }
            std::fs::write(&path, bytes).expect("written");
            assert_ne!(id(), before, "{name}");
            std::fs::write(&path, whole).expect("written");
        }
    }

    #[test]
    fn texts_beyond_a_limit_are_refused_by_place_and_limit() {
        let folder = static_folder();
        let encoder = TextEncoder::open_static(folder.path()).expect("an encoder");
        let long = "x".repeat(MAX_TEXT_BYTES + 1);
        let cases = [
            (long.as_str(), "prompts[1]: is 513 bytes long; the limit is 512"),
            (" \t", "prompts[1]: is empty"),
            ("", "prompts[1]: is empty"),
            ("xyz", "prompts[1]: has no word that the encoder knows"),
            ("dull", "prompts[1]: has no word that the encoder knows"),
        ];
        for (text, expected) in cases {
            let error = encoder.embed_field("prompts", &["chair", text]).expect_err(expected);
            assert_eq!(error.to_string(), expected);
        }
        let error = encoder.embed(&["chair"; MAX_TEXTS + 1]).expect_err("too many").to_string();
        assert_eq!(error, "texts: are 4097; the limit is 4096");
    }

    #[test]
    fn an_external_encoder_has_a_contract_and_no_text() {
        let encoder = TextEncoder::external("clip-vit-b16", 512).expect("a contract");
        let clip = Contract { encoder_id: "clip-vit-b16".into(), dimension: 512 };
        assert_eq!(encoder.contract(), &clip);
        let error = encoder.embed_field("prompts", &["chair"]).expect_err("no text").to_string();
        assert!(error.contains("'clip-vit-b16' embeds no text"), "{error}");
        assert!(error.contains("embeddings of 512 numbers"), "{error}");
        for (id, dimension) in [("", 3), (" ", 3), ("a\nb", 3), ("a", 0), ("a", 4097)] {
            assert!(TextEncoder::external(id, dimension).is_err(), "{id} {dimension}");
        }
        assert!(TextEncoder::external(&"a".repeat(257), 3).is_err());
    }

    #[test]
    fn settings_open_what_they_ask_for() {
        let folder = static_folder();
        let settings = |kind, folder: &Path| EncoderSettings {
            kind,
            folder: folder.into(),
            id: "clip".into(),
            dimension: 3,
        };
        let open = |kind| TextEncoder::open(&settings(kind, folder.path()));
        assert!(open(EncoderKind::None).expect("none").is_none());
        let id = |kind| open(kind).expect("an encoder").map(|e| e.contract().clone());
        let opened = id(EncoderKind::Static).expect("one");
        assert!(opened.encoder_id.starts_with("static:tiny:") && opened.dimension == 2);
        let clip = Contract { encoder_id: "clip".into(), dimension: 3 };
        assert_eq!(id(EncoderKind::External), Some(clip));
        let nowhere = TextEncoder::open(&settings(EncoderKind::Static, Path::new("")));
        assert_eq!(nowhere.err().expect("no folder").field(), Some("encoder.folder"));
    }

    #[test]
    fn a_folder_has_one_encoder() {
        let folder = static_folder();
        let second = folder.path().join("more.safetensors");
        std::fs::write(&second, "").expect("written");
        let open = || TextEncoder::open_static(folder.path()).err().expect("none").to_string();
        assert!(open().contains("has 2 files *.safetensors"), "{}", open());
        std::fs::remove_file(second).expect("removed");
        std::fs::remove_file(folder.path().join("tiny.safetensors")).expect("removed");
        assert!(open().contains("has 0 files *.safetensors"), "{}", open());
        let absent = TextEncoder::open_static(Path::new("absent")).err().expect("none");
        assert!(absent.exit_code() == 2 && absent.to_string().contains("absent"), "{absent}");
    }
}
