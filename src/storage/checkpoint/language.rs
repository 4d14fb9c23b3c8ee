//! Language in sections.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::tags::*;
use crate::error::Result;
use crate::frame::Contract;
use crate::map::ViewCodesState;
use crate::modality::language::{DictionaryState, LanguageState, StoredCodes};
use crate::storage::sections::Sections;

/// The small part of a dictionary; absent before the first features.
#[derive(Serialize, Deserialize)]
struct DictionaryRecord {
    encoder_id: String,
    dimension: usize,
    energy: f64,
    frames: u64,
}

impl DictionaryRecord {
    fn contract(&self) -> Contract {
        Contract { encoder_id: self.encoder_id.as_str().into(), dimension: self.dimension }
    }
}

pub(super) fn put_language<'a>(out: &mut Sections<'a>, state: &'a LanguageState<'_>) -> Result<()> {
    out.put_array(CODE_CELLS, &state.cells)?;
    let Some((contract, dictionary)) = &state.learned else { return Ok(()) };
    let record = DictionaryRecord {
        encoder_id: contract.encoder_id.to_string(),
        dimension: contract.dimension,
        energy: dictionary.energy,
        frames: dictionary.frames,
    };
    out.put_record(DICTIONARY, &record)?;
    out.put_array(ATOMS, &dictionary.atoms)?;
    out.put_array(SCATTER, &dictionary.scatter)?;
    out.put_array(CODE_WEIGHTS, &state.weights)?;
    out.put_array(CODES, &state.codes)
}

pub(super) fn take_language(from: &mut Sections<'_>) -> Result<LanguageState<'static>> {
    let cells = Cow::Owned(from.take_array(CODE_CELLS)?);
    if !from.tags().any(|tag| tag == DICTIONARY) {
        return Ok(LanguageState {
            learned: None,
            cells,
            weights: Cow::Owned(Vec::new()),
            codes: Vec::new(),
        });
    }
    let record: DictionaryRecord = from.take_record(DICTIONARY)?;
    let dictionary = DictionaryState {
        dimension: record.dimension,
        atoms: from.take_array(ATOMS)?,
        scatter: from.take_array(SCATTER)?,
        energy: record.energy,
        frames: record.frames,
    };
    Ok(LanguageState {
        learned: Some((record.contract(), dictionary)),
        cells,
        weights: Cow::Owned(from.take_array(CODE_WEIGHTS)?),
        codes: from.take_array(CODES)?,
    })
}

pub(super) fn put_view_codes<'a>(out: &mut Sections<'a>, state: &'a ViewCodesState) -> Result<()> {
    out.put_array(CODE_CELLS, &state.cells)?;
    let Some((contract, atoms)) = &state.learned else { return Ok(()) };
    let record = DictionaryRecord {
        encoder_id: contract.encoder_id.to_string(),
        dimension: contract.dimension,
        energy: 0.0,
        frames: 0,
    };
    out.put_record(DICTIONARY, &record)?;
    out.put_array(ATOMS, atoms)?;
    out.put_array(VIEW_HALVES, &state.codes.halves)?;
    out.put_array(VIEW_FLOATS, &state.codes.floats)?;
    out.put_array(VIEW_ATOMS, &state.codes.atoms)
}

pub(super) fn take_view_codes(from: &mut Sections<'_>) -> Result<ViewCodesState> {
    let mut state = ViewCodesState { cells: from.take_array(CODE_CELLS)?, ..Default::default() };
    if !from.tags().any(|tag| tag == DICTIONARY) {
        return Ok(state);
    }
    let record: DictionaryRecord = from.take_record(DICTIONARY)?;
    state.learned = Some((record.contract(), from.take_array(ATOMS)?));
    state.codes = StoredCodes {
        halves: from.take_array(VIEW_HALVES)?,
        floats: from.take_array(VIEW_FLOATS)?,
        atoms: from.take_array(VIEW_ATOMS)?,
    };
    Ok(state)
}
