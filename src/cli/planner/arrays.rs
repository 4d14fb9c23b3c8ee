//! Arrays of planners' questions and answers.

use std::fs::File;
use std::io::{BufReader, BufWriter, Seek, Write};
use std::path::Path;

use crate::error::{Error, Result};
use crate::map::{PathPlace, PathVerdict};
use crate::numpy::{ArchiveWriter, ArrayReader};
use crate::storage::write_file;

/// Numbers of an array at most.
const MAX_NUMBERS: usize = 1 << 28;

fn open(path: &Path) -> Result<ArrayReader<BufReader<File>>> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    ArrayReader::new(BufReader::new(file), path.display().to_string())
}

/// The shape of an array.
pub(super) fn shape_of(path: &Path) -> Result<Vec<usize>> {
    Ok(open(path)?.shape().to_vec())
}

/// An array whose last axis is `width` long, flattened.
pub(super) fn rows(path: &Path, width: usize) -> Result<Vec<f32>> {
    let array = open(path)?;
    let numbers = array.shape().iter().fold(1usize, |all, n| all.saturating_mul(*n));
    let problem = match array.shape() {
        [.., last] if *last == width && array.shape().len() > 1 => (numbers > MAX_NUMBERS)
            .then(|| format!("{numbers} numbers; the limit is {MAX_NUMBERS}")),
        shape => Some(format!("has shape {shape:?}, but (N, {width}) is needed")),
    };
    match problem {
        Some(problem) => Err(Error::invalid(path.display().to_string(), problem)),
        None => array.into_values(),
    }
}

/// Writes an archive, whole or not at all.
pub(super) fn write(
    path: &Path,
    fill: impl FnOnce(&mut ArchiveWriter<&mut BufWriter<File>>) -> std::io::Result<()>,
) -> Result<()> {
    write_file(path, |file| {
        let mut archive = ArchiveWriter::new(file);
        fill(&mut archive)?;
        archive.finish().map(drop)
    })
}

/// Verdicts, column by column; -1 and NaN where there is no place.
#[derive(Debug, Default)]
pub(super) struct PathColumns {
    /// How many meet nothing.
    pub(super) safe: usize,
    clearance: Vec<f32>,
    least: Places,
    hit: Places,
    unknown_hits: Vec<i32>,
}

#[derive(Debug, Default)]
struct Places {
    pose: Vec<i32>,
    fraction: Vec<f32>,
    sphere: Vec<i32>,
}

impl Places {
    fn push(&mut self, place: Option<PathPlace>) {
        let index = |n: u32| i32::try_from(n).unwrap_or(i32::MAX);
        self.pose.push(place.map_or(-1, |at| index(at.pose)));
        self.fraction.push(place.map_or(f32::NAN, |at| at.fraction));
        self.sphere.push(place.map_or(-1, |at| index(at.sphere)));
    }

    fn write<W: Write + Seek>(
        &self,
        name: &str,
        archive: &mut ArchiveWriter<W>,
    ) -> std::io::Result<()> {
        let n = [self.pose.len()];
        archive.add(&format!("{name}_pose"), &n, &self.pose)?;
        archive.add(&format!("{name}_fraction"), &n, &self.fraction)?;
        archive.add(&format!("{name}_sphere"), &n, &self.sphere)
    }
}

impl PathColumns {
    pub(super) fn of(verdicts: &[PathVerdict]) -> Self {
        let mut columns = Self::default();
        for verdict in verdicts {
            columns.safe += usize::from(verdict.first_hit.is_none());
            columns.clearance.push(verdict.min_clearance_m);
            columns.least.push(verdict.min_at);
            columns.hit.push(verdict.first_hit);
            columns.unknown_hits.push(i32::try_from(verdict.unknown_hits).unwrap_or(i32::MAX));
        }
        columns
    }

    pub(super) fn write<W: Write + Seek>(
        &self,
        archive: &mut ArchiveWriter<W>,
    ) -> std::io::Result<()> {
        let n = [self.clearance.len()];
        archive.add("min_clearance", &n, &self.clearance)?;
        self.least.write("min", archive)?;
        self.hit.write("hit", archive)?;
        archive.add("unknown_hits", &n, &self.unknown_hits)
    }
}
