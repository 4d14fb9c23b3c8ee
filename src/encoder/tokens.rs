//! Text into token ids, as a Hugging Face `tokenizer.json` says.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use tokenizers::{ModelWrapper, PaddingParams, PaddingStrategy, Tokenizer};

use crate::error::{Error, Result};

/// The largest file: a vocabulary of a million words takes half of it.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// The tokens of a text and what a network may ask about each.
pub(super) struct Encoded {
    pub(super) ids: Vec<u32>,
    /// 0 where a token is there to fill up, else 1.
    pub(super) mask: Vec<u32>,
    /// Which of a pair of texts a token is from.
    pub(super) types: Vec<u32>,
}

/// A tokenizer that says the same for the same text, always.
pub(super) struct Tokens {
    name: String,
    tokenizer: Tokenizer,
    unknown: Option<u32>,
}

impl Tokens {
    /// The tokenizer that `bytes`, the content of the file `path`, describe.
    pub(super) fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let name = path.display().to_string();
        let tokenizer = guarded(|| Tokenizer::from_bytes(bytes))
            .map_err(|problem| Error::corrupt(name.as_str(), problem))?;
        let unknown = match tokenizer.get_model() {
            ModelWrapper::BPE(model) => {
                if model.dropout.is_some_and(|dropout| dropout != 0.0) {
                    return Err(Error::corrupt(name, "dropout: must be 0, or answers are random"));
                }
                model.unk_token.clone()
            }
            ModelWrapper::WordPiece(model) => Some(model.unk_token.clone()),
            ModelWrapper::WordLevel(model) => Some(model.unk_token.clone()),
            ModelWrapper::Unigram(_) => None, // keeps its own to itself
        };
        let unknown = unknown.and_then(|token| tokenizer.token_to_id(&token));
        Ok(Self { name, tokenizer, unknown })
    }

    /// Content of the file `path`.
    pub(super) fn read(path: &Path) -> Result<Vec<u8>> {
        read_bounded(path, MAX_FILE_BYTES)
    }

    /// The largest id that may come out; none of an empty vocabulary.
    pub(super) fn largest_id(&self) -> Option<u32> {
        self.tokenizer.get_vocab(true).into_values().max()
    }

    /// Gives all of a text and nothing else: the file's limits of length do not count.
    pub(super) fn without_limits(mut self) -> Result<Self> {
        self.tokenizer
            .with_truncation(None)
            .map_err(|e| Error::corrupt(self.name.as_str(), e.to_string()))?
            .with_padding(None);
        Ok(self)
    }

    /// Texts get as many tokens as they have.
    pub(super) fn without_padding(mut self) -> Self {
        self.tokenizer.with_padding(None);
        self
    }

    /// Texts are filled up to `length` tokens, in the file's way if it has one.
    pub(super) fn padded_to(mut self, length: usize) -> Self {
        let file = self.tokenizer.get_padding().cloned().unwrap_or_default();
        let padding = PaddingParams { strategy: PaddingStrategy::Fixed(length), ..file };
        self.tokenizer.with_padding(Some(padding));
        self
    }

    /// The tokens that the text is made of, without those that stand for what the vocabulary lacks.
    pub(super) fn known(&self, text: &str) -> Result<Vec<u32>> {
        let mut ids = self.encode(text, false)?.ids;
        ids.retain(|id| Some(*id) != self.unknown);
        Ok(ids)
    }

    /// What a network takes: with the tokens that mark beginning and end.
    pub(super) fn marked(&self, text: &str) -> Result<Encoded> {
        self.encode(text, true)
    }

    fn encode(&self, text: &str, marks: bool) -> Result<Encoded> {
        let encoding = guarded(|| self.tokenizer.encode_fast(text, marks))
            .map_err(|problem| Error::corrupt(self.name.as_str(), problem))?;
        Ok(Encoded {
            ids: encoding.get_ids().to_vec(),
            mask: encoding.get_attention_mask().to_vec(),
            types: encoding.get_type_ids().to_vec(),
        })
    }
}

/// Runs the tokenizer library, which trusts its file: some damaged ones make it panic.
fn guarded<T>(run: impl FnOnce() -> tokenizers::Result<T>) -> std::result::Result<T, String> {
    // What a panic leaves half done is either dropped or a cache of words, behind a lock of its own.
    match catch_unwind(AssertUnwindSafe(run)) {
        Ok(outcome) => outcome.map_err(|e| e.to_string()),
        Err(_) => Err("the tokenizer cannot be used".to_owned()),
    }
}

/// The content of a file of at most `limit` bytes.
pub(super) fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let length = std::fs::metadata(path).map_err(|e| Error::io(path, e))?.len();
    if length > limit {
        let problem = format!("is {length} bytes long; the limit is {limit}");
        return Err(Error::invalid(path.display().to_string(), problem));
    }
    std::fs::read(path).map_err(|e| Error::io(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::test_files::{tokenizer, tokenizer_with};

    fn parse(json: &str) -> Result<Tokens> {
        Tokens::parse(Path::new("tokenizer.json"), json.as_bytes())
    }

    #[test]
    fn text_becomes_known_tokens_or_tokens_between_marks() {
        let tokens = parse(&tokenizer()).expect("a tokenizer");
        assert_eq!(tokens.largest_id(), Some(6));
        assert_eq!(tokens.known("red chair xyz").expect("tokens"), [4, 3]);
        let marked = tokens.marked("red xyz").expect("tokens");
        assert_eq!((marked.ids, marked.mask), (vec![1, 4, 0, 2], vec![1; 4]));
        assert_eq!(marked.types, [0; 4]);
    }

    #[test]
    fn padding_and_truncation_are_the_files_own_unless_told() {
        let limits = r#""truncation": {"max_length": 4, "strategy": "LongestFirst", "stride": 0},
            "padding": {"strategy": {"Fixed": 6}, "direction": "Right", "pad_to_multiple_of": null,
                        "pad_id": 5, "pad_type_id": 0, "pad_token": "table"}"#;
        let parse = || parse(&tokenizer_with(limits)).expect("a tokenizer");
        let ids = |tokens: Tokens| tokens.marked("red red red red red").expect("tokens").ids;
        assert_eq!(ids(parse()), [1, 4, 4, 2, 5, 5]);
        assert_eq!(ids(parse().without_padding()), [1, 4, 4, 2]);
        assert_eq!(ids(parse().padded_to(5)), [1, 4, 4, 2, 5]);
        let all = parse().without_limits().expect("no limits").known("red red red red red");
        assert_eq!(all.expect("tokens"), [4; 5]);
    }

    #[test]
    fn what_is_no_tokenizer_is_an_error_that_names_the_file() {
        let whole = tokenizer();
        for json in ["", "{}", "[]", "{\"model\": 3}", &whole[..whole.len() / 2]] {
            let error = parse(json).err().expect("no tokenizer");
            assert!(error.to_string().starts_with("tokenizer.json is damaged"), "{error}");
        }
        let random = r#"{"version": "1.0", "added_tokens": [], "model": {"type": "BPE",
            "dropout": 0.5, "vocab": {"a": 0}, "merges": []}}"#;
        let error = parse(random).err().expect("random").to_string();
        assert!(error.contains("dropout: must be 0"), "{error}");
    }

    #[test]
    fn a_library_that_panics_is_an_error() {
        assert_eq!(guarded(|| Ok(1)), Ok(1));
        let problem = guarded::<()>(|| panic!("on purpose")).expect_err("it panicked");
        assert_eq!(problem, "the tokenizer cannot be used");
    }

    #[test]
    fn a_file_beyond_the_limit_is_not_read() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(file.path(), [0; 9]).expect("written");
        assert_eq!(read_bounded(file.path(), 9).expect("fits").len(), 9);
        let error = read_bounded(file.path(), 8).expect_err("too long").to_string();
        assert!(error.contains("9 bytes long; the limit is 8"), "{error}");
    }
}
