//! Static text encoders whose words and numbers are known.

use std::path::Path;

use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use tempfile::TempDir;

/// What everything is compared with: a little of all, and something of its own.
const NEGATIVES: [&str; 4] = ["object", "things", "stuff", "texture"];

/// A folder with an encoder of a few words in eight numbers, called `words`: `seat` is nearly a chair,
/// `desk` nearly a table.
pub(crate) fn words() -> TempDir {
    let axis = |at: usize| (0..8).map(|i| f32::from(u8::from(i == at))).collect::<Vec<f32>>();
    let mut rows: Vec<(String, Vec<f32>)> = Vec::new();
    for (at, word) in ["chair", "table", "wall", "floor", "lamp"].into_iter().enumerate() {
        rows.push((word.into(), axis(at)));
    }
    rows.push(("seat".into(), vec![0.95, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1]));
    rows.push(("desk".into(), vec![0.2, 0.95, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0]));
    rows.push(("nothing".into(), vec![0.0; 8]));
    for (at, word) in NEGATIVES.into_iter().enumerate() {
        let own = (5..8).map(|i| if i - 5 == at { 0.9 } else { 0.2 });
        rows.push((word.into(), std::iter::repeat_n(0.3, 5).chain(own).collect()));
    }
    folder_of(&rows)
}

/// The same for the classes of the synthetic room, each with an axis of its own; `seat` is nearly a
/// chair.
pub(crate) fn room_words() -> TempDir {
    let classes = Synthetic::room(1).labels(0).unwrap().expect("labels").classes;
    let width = classes.len() + NEGATIVES.len();
    let axis = |at: usize| (0..width).map(|i| f32::from(u8::from(i == at))).collect::<Vec<f32>>();
    let mut rows: Vec<(String, Vec<f32>)> =
        classes.iter().enumerate().map(|(at, class)| (class.name.clone(), axis(at))).collect();
    let chair = classes.iter().position(|class| class.name == "chair").expect("a chair");
    let seat =
        axis(chair).into_iter().zip(axis((chair + 1) % classes.len())).map(|(a, b)| a + 0.2 * b);
    rows.push(("seat".into(), seat.collect()));
    for (at, word) in NEGATIVES.into_iter().enumerate() {
        let own = axis(classes.len() + at);
        rows.push((word.into(), own.iter().map(|x| 0.15 + x).collect()));
    }
    folder_of(&rows)
}

fn folder_of(rows: &[(String, Vec<f32>)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let words: Vec<(&str, Vec<f32>)> =
        rows.iter().map(|(word, row)| (word.as_str(), row.clone())).collect();
    write(folder.path(), &words);
    folder
}

/// Writes an encoder that has these words and numbers into a new folder.
pub(crate) fn write(folder: &Path, words: &[(&str, Vec<f32>)]) {
    std::fs::create_dir_all(folder).unwrap();
    let width = words[0].1.len();
    // Token 0 stands for words that the encoder does not know.
    let numbers = std::iter::repeat_n(0.0, width).chain(words.iter().flat_map(|w| w.1.clone()));
    let data: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
    let header = format!(
        r#"{{"t":{{"dtype":"F32","shape":[{},{width}],"data_offsets":[0,{}]}}}}"#,
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
