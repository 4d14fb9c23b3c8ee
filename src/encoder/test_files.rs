//! Small encoder files with known answers, for unit tests.

use tempfile::TempDir;

/// A tokenizer of words: [UNK] 0, [CLS] 1, [SEP] 2, chair 3, red 4, table 5, dull 6; texts that a
/// network gets stand between [CLS] and [SEP].
pub(super) fn tokenizer() -> String {
    tokenizer_with(r#""truncation": null, "padding": null"#)
}

/// The same with limits of its own.
pub(super) fn tokenizer_with(limits: &str) -> String {
    let special = |name: &str, id: u32| {
        format!(r#""{name}": {{"id": "{name}", "ids": [{id}], "tokens": ["{name}"]}}"#)
    };
    let one = r#"[{"SpecialToken": {"id": "[CLS]", "type_id": 0}},
        {"Sequence": {"id": "A", "type_id": 0}}, {"SpecialToken": {"id": "[SEP]", "type_id": 0}}]"#;
    format!(
        r#"{{"version": "1.0", {limits}, "added_tokens": [], "normalizer": null,
        "pre_tokenizer": {{"type": "Whitespace"}}, "decoder": null,
        "post_processor": {{"type": "TemplateProcessing", "single": {one}, "pair": {one},
            "special_tokens": {{{cls}, {sep}}}}},
        "model": {{"type": "WordLevel", "unk_token": "[UNK]", "vocab": {{"[UNK]": 0, "[CLS]": 1,
            "[SEP]": 2, "chair": 3, "red": 4, "table": 5, "dull": 6}}}}}}"#,
        cls = special("[CLS]", 1),
        sep = special("[SEP]", 2),
    )
}

/// A safetensors file of one tensor, as told, right or wrong.
pub(super) fn safetensors(dtype: &str, shape: &[usize], data: &[u8]) -> Vec<u8> {
    let end = data.len();
    let header =
        format!(r#"{{"t":{{"dtype":"{dtype}","shape":{shape:?},"data_offsets":[0,{end}]}}}}"#);
    [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), data].concat()
}

/// A static encoder whose token i is (i, 1), but for `dull`, which is (0, 0).
pub(crate) fn static_folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let rows = (0..7).flat_map(|i| if i == 6 { [0.0_f32, 0.0] } else { [i as f32, 1.0] });
    let data: Vec<u8> = rows.flat_map(f32::to_le_bytes).collect();
    let table = safetensors("F32", &[7, 2], &data);
    std::fs::write(folder.path().join("tiny.safetensors"), table).expect("written");
    std::fs::write(folder.path().join("tokenizer.json"), tokenizer()).expect("written");
    folder
}
