//! A static text encoder whose words and numbers are known.

use std::path::Path;

use tempfile::TempDir;

/// Words, and how far each points along eight axes: `seat` is nearly a chair, and `object` and the
/// other words that everything is compared with are a little of all.
const WORDS: [(&str, [f32; 8]); 12] = [
    ("chair", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ("table", [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ("wall", [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ("floor", [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
    ("lamp", [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
    ("seat", [0.95, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1]),
    ("desk", [0.2, 0.95, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0]),
    ("nothing", [0.0; 8]),
    ("object", [0.3, 0.3, 0.3, 0.3, 0.3, 0.9, 0.0, 0.0]),
    ("things", [0.3, 0.3, 0.3, 0.3, 0.3, 0.0, 0.9, 0.0]),
    ("stuff", [0.3, 0.3, 0.3, 0.3, 0.3, 0.0, 0.0, 0.9]),
    ("texture", [0.2, 0.2, 0.3, 0.3, 0.2, 0.5, 0.5, 0.5]),
];

/// A folder with such an encoder, called `words`.
pub(crate) fn words() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &WORDS.map(|(word, row)| (word, row.to_vec())));
    folder
}

/// Writes an encoder that has these words and numbers into a new folder.
pub(crate) fn write(folder: &Path, words: &[(&str, Vec<f32>)]) {
    std::fs::create_dir_all(folder).unwrap();
    let dimension = words[0].1.len();
    // Token 0 stands for words that the encoder does not know.
    let rows =
        std::iter::once(vec![0.0; dimension]).chain(words.iter().map(|(_, row)| row.clone()));
    let data: Vec<u8> = rows.flatten().flat_map(f32::to_le_bytes).collect();
    let header = format!(
        r#"{{"t":{{"dtype":"F32","shape":[{},{dimension}],"data_offsets":[0,{}]}}}}"#,
        words.len() + 1,
        data.len()
    );
    let table = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &data].concat();
    std::fs::write(folder.join("words.safetensors"), table).unwrap();
    let known = (1..).zip(words).map(|(id, (word, _))| format!(r#", "{word}": {id}"#));
    let tokenizer = format!(
        r#"{{"version": "1.0", "truncation": null, "padding": null, "added_tokens": [],
        "normalizer": null, "pre_tokenizer": {{"type": "Whitespace"}}, "decoder": null,
        "post_processor": null, "model": {{"type": "WordLevel", "unk_token": "[UNK]",
        "vocab": {{"[UNK]": 0{}}}}}}}"#,
        known.collect::<String>()
    );
    std::fs::write(folder.join("tokenizer.json"), tokenizer).unwrap();
}
