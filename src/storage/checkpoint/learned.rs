//! What was learned, in sections.

use super::tags::*;
use crate::backend::{BackendState, ColorRows, DecoderState, LearnedRow, RowMoments};
use crate::error::{Error, Result};
use crate::storage::sections::Sections;

/// Columns of a learned row on disk.
pub(super) const COLUMNS: usize = RowMoments::COLUMNS;

pub(super) fn take_backend(from: &mut Sections<'_>) -> Result<BackendState> {
    let learned: Vec<[f32; COLUMNS]> = from.take_array(ROWS)?;
    let moments: Vec<[f32; COLUMNS]> = from.take_array(ROW_MOMENTS)?;
    let steps: Vec<[u32; 2]> = from.take_array(ROW_STEPS)?;
    let (sdf, occupancy): (DecoderState, DecoderState) = from.take_record(DECODERS)?;
    let (pairs, rest) = moments.as_chunks::<2>();
    if pairs.len() != steps.len() || !rest.is_empty() {
        return Err(Error::corrupt("optimiser", "moments and step counts differ in number"));
    }
    let moments = pairs.iter().zip(&steps).map(|(&[first, second], &[sdf, occupancy])| {
        RowMoments { first, second, sdf_steps: sdf, occupancy_steps: occupancy }
    });
    Ok(BackendState {
        learned: learned.iter().map(learned_row).collect(),
        moments: moments.collect(),
        sdf,
        occupancy,
        colors: ColorRows::default(),
    })
}

pub(super) fn take_colors(from: &mut Sections<'_>) -> Result<ColorRows> {
    let mut first: Vec<[f32; 3]> = from.take_array(COLOR_MOMENTS)?;
    let second = first.split_off(first.len() / 2);
    let (learned, steps) = (from.take_array(COLOR_LEARNED)?, from.take_array(COLOR_STEPS)?);
    let colors = ColorRows { learned, first, second, steps };
    colors.check()?;
    Ok(colors)
}

/// The numbers of a row in the order of its columns: feature, occupancy feature, explicit.
fn numbers(row: &mut LearnedRow) -> impl Iterator<Item = &mut f32> {
    row.sdf_feature.iter_mut().chain(&mut row.occupancy_feature).chain(&mut row.explicit)
}

pub(super) fn columns(row: &LearnedRow) -> [f32; COLUMNS] {
    let (mut row, mut columns) = (*row, [0.0; COLUMNS]);
    numbers(&mut row).zip(&mut columns).for_each(|(number, column)| *column = *number);
    columns
}

fn learned_row(columns: &[f32; COLUMNS]) -> LearnedRow {
    let mut row = LearnedRow::default();
    numbers(&mut row).zip(columns).for_each(|(number, column)| *number = *column);
    row
}
