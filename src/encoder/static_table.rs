//! The static encoder: a text is the mean of its tokens' vectors. No network runs, and the order of
//! words does not count; it answers in microseconds.

use std::path::Path;

use half::f16;
use safetensors::{Dtype, SafeTensors};

use super::text::Source;
use super::tokens::{Tokens, read_bounded};
use crate::error::{Error, Result};
use crate::frame::MAX_DIMENSION;

/// The largest file: half a million tokens of 512 numbers in f32.
const MAX_TABLE_BYTES: u64 = 1 << 30;

/// A vector for each token.
pub(super) struct StaticTable {
    tokens: Tokens,
    dimension: usize,
    /// Row-major, one row a token, finite.
    rows: Vec<f32>,
}

impl StaticTable {
    /// Reads a table (safetensors, one tensor of tokens × numbers, f16 or f32) and its tokenizer; also
    /// says what tells their content from another's.
    pub(super) fn load(table: &Path, tokenizer: &Path) -> Result<(Self, u32)> {
        let bytes = read_bounded(table, MAX_TABLE_BYTES)?;
        let json = Tokens::read(tokenizer)?;
        let name = table.display().to_string();
        let damaged = |problem: String| Error::corrupt(name.as_str(), problem);
        let (rows, dimension) = parse(&bytes).map_err(damaged)?;
        let tokens = Tokens::parse(tokenizer, &json)?.without_limits()?;
        let count = rows.len() / dimension;
        if let Some(id) = tokens.largest_id().filter(|id| *id as usize >= count) {
            return Err(damaged(format!("has {count} rows, none for token {id} of the tokenizer")));
        }
        let mut content = crc32fast::Hasher::new();
        content.update(&bytes);
        content.update(&json);
        Ok((Self { tokens, dimension, rows }, content.finalize()))
    }

    pub(super) fn dimension(&self) -> usize {
        self.dimension
    }
}

impl Source for StaticTable {
    /// The sum points where the mean does. Nothing known: zero.
    fn embed(&self, text: &str) -> Result<Vec<f32>> {
        let mut sum = vec![0.0; self.dimension];
        for id in self.tokens.known(text)? {
            let row = &self.rows[id as usize * self.dimension..][..self.dimension];
            for (sum, value) in sum.iter_mut().zip(row) {
                *sum += value;
            }
        }
        Ok(sum)
    }
}

/// The numbers of the one tensor in `bytes`, and how many there are in a row.
fn parse(bytes: &[u8]) -> std::result::Result<(Vec<f32>, usize), String> {
    let file = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let tensors = file.tensors();
    let [(name, tensor)] = tensors.as_slice() else {
        return Err(format!("has {} tensors; a table of tokens is one", tensors.len()));
    };
    let &[_, dimension] = tensor.shape() else {
        let shape = tensor.shape();
        return Err(format!("{name}: has the shape {shape:?}, not tokens × numbers"));
    };
    if !(1..=MAX_DIMENSION).contains(&dimension) {
        return Err(format!("{name}: has {dimension} numbers a token, not 1 to {MAX_DIMENSION}"));
    }
    let rows: Vec<f32> = match tensor.dtype() {
        Dtype::F16 => chunks(tensor.data(), |bytes| f16::from_le_bytes(bytes).to_f32()),
        Dtype::F32 => chunks(tensor.data(), f32::from_le_bytes),
        other => return Err(format!("{name}: holds {other:?}, not F16 or F32")),
    };
    if rows.is_empty() {
        return Err(format!("{name}: is empty"));
    }
    match rows.iter().position(|value| !value.is_finite()) {
        Some(at) => Err(format!("{name}: a number of token {} is not finite", at / dimension)),
        None => Ok((rows, dimension)),
    }
}

fn chunks<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.as_chunks::<N>().0.iter().map(|chunk| number(*chunk)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::test_files::{safetensors, static_folder, tokenizer};

    fn f32s(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    #[test]
    fn a_text_is_the_mean_of_its_tokens_in_any_order() {
        let folder = static_folder();
        let table = folder.path().join("tiny.safetensors");
        let (table, _) =
            StaticTable::load(&table, &folder.path().join("tokenizer.json")).expect("a table");
        assert_eq!(table.dimension(), 2);
        // Row i is (i, 1): chair 3, red 4.
        assert_eq!(table.embed("red chair").expect("a sum"), [7.0, 2.0]);
        assert_eq!(table.embed("chair xyz red").expect("a sum"), [7.0, 2.0]);
        assert_eq!(table.embed("xyz").expect("a sum"), [0.0, 0.0]);
    }

    #[test]
    fn halves_and_floats_are_read() {
        let halves: Vec<u8> =
            [1.0, -0.5, 2.0, 0.25].iter().flat_map(|v| f16::from_f32(*v).to_le_bytes()).collect();
        let read = parse(&safetensors("F16", &[2, 2], &halves)).expect("a table");
        assert_eq!(read, (vec![1.0, -0.5, 2.0, 0.25], 2));
        let floats = safetensors("F32", &[1, 3], &f32s(&[1.0, 2.0, 3.0]));
        assert_eq!(parse(&floats).expect("a table"), (vec![1.0, 2.0, 3.0], 3));
    }

    #[test]
    fn a_table_that_is_none_is_refused_with_what_is_wrong() {
        let two = f32s(&[1.0, 2.0]);
        let whole = safetensors("F32", &[1, 2], &two);
        let mut long_header = whole.clone();
        long_header[..8].copy_from_slice(&u64::MAX.to_le_bytes());
        let cases: &[(&str, Vec<u8>, &str)] = &[
            ("nothing", vec![], ""),
            ("cut in the data", whole[..whole.len() - 1].to_vec(), ""),
            ("cut in the header", whole[..20].to_vec(), ""),
            ("a header that never ends", long_header, ""),
            ("more than the shape holds", safetensors("F32", &[1, 1], &two), ""),
            ("less than the shape wants", safetensors("F32", &[4, 2], &two), ""),
            ("a shape beyond all", safetensors("F32", &[usize::MAX, 2], &two), ""),
            ("one dimension", safetensors("F32", &[2], &two), "shape [2]"),
            ("integers", safetensors("I32", &[1, 2], &two), "not F16 or F32"),
            ("no rows", safetensors("F32", &[0, 2], &[]), "is empty"),
            ("no columns", safetensors("F32", &[2, 0], &[]), "has 0 numbers a token"),
            ("too wide", safetensors("F32", &[1, 5000], &f32s(&[0.0; 5000])), "5000 numbers"),
            (
                "not a number",
                safetensors("F32", &[2, 2], &f32s(&[0.0, 0.0, 0.0, f32::NAN])),
                "token 1 is not finite",
            ),
            ("infinite", safetensors("F16", &[1, 1], &f16::INFINITY.to_le_bytes()), "token 0"),
        ];
        for (what, bytes, expected) in cases {
            let problem = parse(bytes).expect_err(what);
            assert!(problem.contains(expected), "{what}: {problem}");
        }
    }

    #[test]
    fn each_token_of_the_tokenizer_needs_a_row() {
        let folder = tempfile::tempdir().expect("a folder");
        let [table, json] = ["t.safetensors", "tokenizer.json"].map(|n| folder.path().join(n));
        std::fs::write(&table, safetensors("F32", &[6, 1], &f32s(&[1.0; 6]))).expect("written");
        std::fs::write(&json, tokenizer()).expect("written");
        let error = StaticTable::load(&table, &json).err().expect("a row is missing");
        assert!(error.to_string().contains("has 6 rows, none for token 6"), "{error}");
    }
}
