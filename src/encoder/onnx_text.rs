//! The text tower of a network: a tokenizer, an ONNX file, and which of its outputs is the meaning.
//!
//! Exports differ in three ways, and tell them by the names and shapes of what goes in and out: whether
//! they pool themselves, whether they tell padding from text, and how long texts must be.

use std::path::Path;

use super::network::{Network, Tensor};
use super::text::Source;
use super::tokens::{Encoded, Tokens, read_bounded};
use crate::error::{Error, Result};
use crate::frame::MAX_DIMENSION;

/// The largest network file.
const MAX_MODEL_BYTES: u64 = 1 << 30;
/// The most tokens of a text, padding included; what a tokenizer cuts off itself does not count.
const MAX_TOKENS: usize = 1024;
/// What every encoder embeds, to see what comes out.
const PROBE: &str = "a chair";

/// Outputs that are one embedding a text: CLIP's, and that of sentence transformers.
const POOLED: [&str; 2] = ["text_embeds", "sentence_embedding"];
/// Outputs that are one vector a token.
const STATES: [&str; 2] = ["last_hidden_state", "token_embeddings"];
/// SigLIP's embedding; in BERT's family it is of no use and the states are.
const POOLER: &str = "pooler_output";

/// What an input wants to know of the tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Ids,
    Mask,
    Types,
}

pub(super) struct OnnxText {
    name: String,
    network: Network,
    tokens: Tokens,
    inputs: Vec<Role>,
    output: usize,
    dimension: usize,
}

impl OnnxText {
    /// Reads a network and its tokenizer, and runs it once; also says what tells their content from
    /// another's.
    pub(super) fn load(model: &Path, tokenizer: &Path) -> Result<(Self, u32)> {
        let mut content = crc32fast::Hasher::new();
        content.update(&read_bounded(model, MAX_MODEL_BYTES)?);
        let json = Tokens::read(tokenizer)?;
        content.update(&json);
        let name = model.display().to_string();
        let network = Network::load(model)?;
        let damaged = |problem: String| Error::corrupt(name.as_str(), problem);
        let inputs = roles(&network.input_names()).map_err(damaged)?;
        let masks = inputs.contains(&Role::Mask);
        let output = output(&network.output_names(), masks).map_err(damaged)?;
        let ids = inputs.iter().position(|role| *role == Role::Ids);
        let length = ids.and_then(|ids| network.fixed_length(ids));
        let tokens = Tokens::parse(tokenizer, &json)?;
        let tokens = match length {
            Some(length @ 1..=MAX_TOKENS) => tokens.padded_to(length),
            Some(length) => return Err(damaged(format!("takes {length} tokens a text"))),
            // What tells padding from text needs none; what does not was trained with the file's.
            None if masks => tokens.without_padding(),
            None => tokens,
        };
        let mut this = Self { name, network, tokens, inputs, output, dimension: 0 };
        this.dimension = match this.embed(PROBE) {
            Ok(embedding) => embedding.len(),
            Err(Error::InvalidArgument { problem, .. }) => {
                return Err(Error::corrupt(this.name, format!("'{PROBE}': {problem}")));
            }
            Err(other) => return Err(other),
        };
        if !(1..=MAX_DIMENSION).contains(&this.dimension) {
            let problem = format!("gives {} numbers, not 1 to {MAX_DIMENSION}", this.dimension);
            return Err(Error::corrupt(this.name, problem));
        }
        Ok((this, content.finalize()))
    }

    pub(super) fn dimension(&self) -> usize {
        self.dimension
    }
}

impl Source for OnnxText {
    fn embed(&self, text: &str) -> Result<Vec<f32>> {
        let tokens = self.tokens.marked(text)?;
        let count = tokens.ids.len();
        if count > MAX_TOKENS {
            let problem = format!("is {count} tokens long; the limit is {MAX_TOKENS}");
            return Err(Error::invalid("text", problem));
        }
        let row = |role: &Role| {
            let numbers = match role {
                Role::Ids => &tokens.ids,
                Role::Mask => &tokens.mask,
                Role::Types => &tokens.types,
            };
            numbers.iter().map(|number| *number as i32).collect() // vocabularies are far smaller
        };
        let rows = self.inputs.iter().map(row).collect();
        let answer = self.network.run_rows(rows, self.output).map_err(|error| match error {
            // It ran before, on another text: this one has more tokens than it knows places, mostly.
            Error::InvalidArgument { problem, .. } => {
                Error::invalid("text", format!("the network refuses its {count} tokens: {problem}"))
            }
            other => other,
        })?;
        let wrong = |problem| Error::corrupt(self.name.as_str(), problem);
        pooled(answer, &tokens).map_err(wrong)
    }
}

/// What each input is, by its name.
fn roles(names: &[String]) -> std::result::Result<Vec<Role>, String> {
    let mut roles = Vec::with_capacity(names.len());
    for name in names {
        roles.push(match name.as_str() {
            "input_ids" => Role::Ids,
            "attention_mask" => Role::Mask,
            "token_type_ids" => Role::Types,
            other => return Err(format!("takes '{other}', which a text does not have")),
        });
    }
    if roles.contains(&Role::Ids) { Ok(roles) } else { Err("takes no 'input_ids'".to_owned()) }
}

/// Which output is the embedding or, failing that, has one vector a token.
fn output(names: &[String], masks: bool) -> std::result::Result<usize, String> {
    let [first, second] = POOLED;
    let [states, embeddings] = STATES;
    let wanted = match masks {
        true => [first, second, states, embeddings, POOLER],
        false => [first, second, POOLER, states, embeddings],
    };
    let place = |wanted: &&str| names.iter().position(|name| name == wanted);
    match wanted.iter().find_map(place) {
        Some(output) => Ok(output),
        None if names.len() == 1 => Ok(0),
        None => Err(format!("gives {names:?}, none of which is known: {wanted:?}")),
    }
}

/// The embedding in an output: as it is, or the mean over the tokens that are no padding.
fn pooled(output: Tensor, tokens: &Encoded) -> std::result::Result<Vec<f32>, String> {
    let Tensor { shape, values } = output;
    match shape.as_slice() {
        [_] | [1, _] => Ok(values),
        &[1, count, dimension] if count == tokens.mask.len() && dimension > 0 => {
            let mut sum = vec![0.0; dimension];
            let mut texts = 0.0;
            for (row, mask) in values.chunks_exact(dimension).zip(&tokens.mask) {
                if *mask != 0 {
                    texts += 1.0;
                    sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
                }
            }
            sum.iter_mut().for_each(|sum| *sum /= f32::max(texts, 1.0));
            Ok(sum)
        }
        _ => Err(format!("gives an array {shape:?} for {} tokens", tokens.mask.len())),
    }
}

#[cfg(feature = "onnx")]
#[cfg(test)]
mod tests {
    use tempfile::TempDir;

    use super::*;
    use crate::encoder::onnx_bytes::token_rows;
    use crate::encoder::test_files::{tokenizer, tokenizer_with};

    const BERT: [&str; 3] = ["input_ids", "attention_mask", "token_type_ids"];
    /// Padding to six tokens of `table`.
    const PADDED: &str = r#""truncation": null, "padding": {"strategy": {"Fixed": 6},
        "direction": "Right", "pad_to_multiple_of": null, "pad_id": 5, "pad_type_id": 0,
        "pad_token": "table"}"#;

    /// A tower whose token i is (i, 1).
    fn folder(inputs: &[&str], outputs: [&str; 2], tokenizer: &str) -> TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        let rows: Vec<f32> = (0..7).flat_map(|i| [i as f32, 1.0]).collect();
        let model = token_rows(inputs, outputs, &rows, 2);
        std::fs::write(folder.path().join("tiny.onnx"), model).expect("written");
        std::fs::write(folder.path().join("tokenizer.json"), tokenizer).expect("written");
        folder
    }

    fn load(folder: &TempDir) -> Result<OnnxText> {
        let [model, json] = ["tiny.onnx", "tokenizer.json"].map(|name| folder.path().join(name));
        OnnxText::load(&model, &json).map(|(text, _)| text)
    }

    #[test]
    fn states_are_averaged_over_the_text_and_its_marks() {
        let folder = folder(&BERT, ["last_hidden_state", "pooler_output"], &tokenizer());
        let text = load(&folder).expect("an encoder");
        assert_eq!(text.dimension(), 2);
        // [CLS] 1, chair 3, red 4, [SEP] 2.
        assert_eq!(text.embed("chair red").expect("an embedding"), [2.5, 1.0]);
    }

    #[test]
    fn padding_is_for_networks_that_see_no_mask() {
        let states = ["last_hidden_state", "pooler_output"];
        let masked = load(&folder(&BERT, states, &tokenizer_with(PADDED))).expect("an encoder");
        assert_eq!(masked.embed("chair red").expect("an embedding"), [2.5, 1.0]);
        let blind = folder(&BERT[..1], states, &tokenizer_with(PADDED));
        let blind = load(&blind).expect("an encoder");
        let mean = blind.embed("chair red").expect("its own mean over all six");
        assert!((mean[0] - 20.0 / 6.0).abs() < 1e-6, "{mean:?}");
    }

    #[test]
    fn the_networks_own_embedding_comes_first() {
        let names = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        let chosen = |of: &[&str], masks| output(&names(of), masks);
        assert_eq!(chosen(&["last_hidden_state", "text_embeds"], true), Ok(1));
        assert_eq!(chosen(&["token_embeddings", "sentence_embedding"], true), Ok(1));
        assert_eq!(chosen(&["pooler_output", "last_hidden_state"], true), Ok(1));
        assert_eq!(chosen(&["pooler_output", "last_hidden_state"], false), Ok(0));
        assert_eq!(chosen(&["anything"], true), Ok(0));
        let problem = chosen(&["a", "b"], true).expect_err("neither");
        assert!(problem.contains("none of which is known"), "{problem}");

        let pooled = folder(&BERT[..2], ["tokens", "sentence_embedding"], &tokenizer());
        let pooled = load(&pooled).expect("an encoder");
        assert_eq!(pooled.embed("chair red").expect("an embedding"), [2.5, 1.0]);
    }

    #[test]
    fn what_takes_or_gives_something_else_is_refused_by_name() {
        let states = ["last_hidden_state", "pooler_output"];
        let cases: [(&[&str], &str); 3] = [
            (&["input_ids", "pixel_values"], "takes 'pixel_values'"),
            (&["attention_mask", "token_type_ids"], "takes no 'input_ids'"),
            (&["tokens"], "takes 'tokens'"),
        ];
        for (inputs, expected) in cases {
            let error = load(&folder(inputs, states, &tokenizer())).err().expect("refused");
            assert!(error.to_string().contains(expected), "{error}");
        }
        let tokens = || Encoded { ids: vec![1; 3], mask: vec![1; 3], types: vec![0; 3] };
        for shape in [vec![], vec![2, 2], vec![1, 4, 1], vec![1, 3, 0], vec![1, 1, 2, 2]] {
            let values = vec![0.0; shape.iter().product()];
            assert!(pooled(Tensor { shape, values }, &tokens()).is_err());
        }
    }

    #[test]
    fn a_token_that_the_network_lacks_is_an_error_and_no_crash() {
        let larger = tokenizer().replace("\"chair\": 3", "\"chair\": 900");
        let folder = folder(&BERT, ["last_hidden_state", "pooler_output"], &larger);
        let error = load(&folder).err().expect("the probe finds it").to_string();
        assert!(error.contains("tiny.onnx is damaged: 'a chair': the network refuses"), "{error}");
        let other = tokenizer().replace("\"red\": 4", "\"red\": 900");
        let other = self::folder(&BERT, ["last_hidden_state", "pooler_output"], &other);
        let error = load(&other).expect("an encoder").embed("red").expect_err("beyond the rows");
        assert_eq!(error.field(), Some("text"), "{error}");
    }
}
