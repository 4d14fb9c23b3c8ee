//! The dictionary: orthonormal atoms that are appended where features of frames need them, and
//! never changed (paper Algorithm 1).

use super::features::{UnitFeatures, check_dimension, norm};
use super::growth::{TAKEN, dominant, project_out, unit};
use super::products::{add_scaled, dot};
use super::query::Query;
use super::scatter::{AtomRows, BUNDLE, Samples, Scatter, padded};
use crate::config::MAX_ATOMS;
use crate::error::{Error, Result};
use crate::geometry::simd::{InstructionSet, LINE};

/// Bound of the atoms.
pub const MAX_CAPACITY: usize = MAX_ATOMS as usize;

/// Atoms of a file are taken as orthonormal up to this.
const ORTHONORMAL: f32 = 1e-4;

/// A direction that keeps less of itself beside the atoms is none of its own.
const MIN_OWN: f32 = 1e-3;

/// How a dictionary learns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DictionarySettings {
    /// ρ: what is left of a frame's say after the next one; 0.9 remembers about ten frames.
    pub decay: f32,
    /// ε: a direction becomes an atom when it holds more than this share of all energy.
    pub threshold: f32,
    /// G_max: atoms at most.
    pub capacity: usize,
    /// Frames before the first atom.
    pub first_frames: u64,
}

impl Default for DictionarySettings {
    fn default() -> Self {
        Self { decay: 0.9, threshold: 0.002, capacity: 256, first_frames: 3 }
    }
}

impl DictionarySettings {
    /// Refuses what no dictionary can learn by.
    pub fn check(&self) -> Result<()> {
        let within = |field: &str, x: f32| {
            let problem = || format!("{x} is not between 0 and 1");
            (x > 0.0 && x < 1.0).then_some(()).ok_or_else(|| Error::invalid(field, problem()))
        };
        within("language.decay", self.decay)?;
        within("language.threshold", self.threshold)?;
        if !(1..=MAX_CAPACITY).contains(&self.capacity) {
            let problem = format!("{} is not within 1..={MAX_CAPACITY}", self.capacity);
            return Err(Error::invalid("language.capacity", problem));
        }
        Ok(())
    }
}

/// A dictionary as a checkpoint holds it.
#[derive(Debug, Clone, PartialEq)]
pub struct DictionaryState {
    pub dimension: usize,
    /// The atoms, one after another.
    pub atoms: Vec<f32>,
    /// The lower triangle of R, row by row; empty if the dictionary does not learn.
    pub scatter: Vec<f32>,
    /// E.
    pub energy: f64,
    pub frames: u64,
}

/// What a dictionary that learns keeps beside its atoms.
#[derive(Debug, Clone, PartialEq)]
struct Learning {
    settings: DictionarySettings,
    scatter: Scatter,
    frames: u64,
}

/// Orthonormal atoms; see the module.
#[derive(Debug, Clone)]
pub struct Dictionary {
    set: InstructionSet,
    dimension: usize,
    /// One atom a row, zeros behind the last; rows come in eights, as products want them.
    atoms: Vec<f32>,
    count: usize,
    capacity: usize,
    /// None where the atoms were given.
    learning: Option<Learning>,
}

impl Dictionary {
    /// No atoms yet, for features of some dimension.
    pub fn new(dimension: usize, settings: DictionarySettings) -> Result<Self> {
        settings.check()?;
        let mut dictionary = Self::empty(dimension, settings.capacity)?;
        let scatter = Scatter::new(dimension);
        dictionary.learning = Some(Learning { settings, scatter, frames: 0 });
        Ok(dictionary)
    }

    /// Atoms that were found elsewhere, one after another; they stay as they are.
    pub fn fixed(atoms: &[f32], dimension: usize) -> Result<Self> {
        check_dimension(dimension)?;
        let (count, rest) = (atoms.len() / dimension, atoms.len() % dimension);
        if rest != 0 || !(1..=MAX_CAPACITY.min(dimension)).contains(&count) {
            let most = MAX_CAPACITY.min(dimension);
            let problem = format!("{} numbers are not 1 to {most} of {dimension}", atoms.len());
            return Err(Error::invalid("atoms", problem));
        }
        let mut dictionary = Self::empty(dimension, count)?;
        for (atom, row) in atoms.chunks_exact(dimension).enumerate() {
            dictionary.check_next(row).map_err(|p| Error::invalid(format!("atoms[{atom}]"), p))?;
            dictionary.push(row);
        }
        Ok(dictionary)
    }

    /// The axes themselves: codes are features as they are.
    pub fn identity(dimension: usize) -> Result<Self> {
        if dimension > MAX_CAPACITY {
            let problem =
                format!("{dimension} numbers are kept in full up to {MAX_CAPACITY} alone");
            return Err(Error::invalid("dictionary", problem));
        }
        let mut dictionary = Self::empty(dimension, dimension)?;
        let mut axis = vec![0.0; dimension];
        for i in 0..dimension {
            axis[i] = 1.0;
            dictionary.push(&axis);
            axis[i] = 0.0;
        }
        Ok(dictionary)
    }

    /// The same atoms, which stay as they are: what a view needs.
    pub fn atoms(&self) -> Self {
        Self { learning: None, ..self.clone() }
    }

    fn empty(dimension: usize, capacity: usize) -> Result<Self> {
        check_dimension(dimension)?;
        let set = InstructionSet::detect();
        let atoms = vec![0.0; capacity.next_multiple_of(8) * stride(dimension)];
        Ok(Self { set, dimension, atoms, count: 0, capacity, learning: None })
    }

    /// Numbers of a feature.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The number of atoms: |D|.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Whether there are no atoms.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Atoms at most: G_max.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Whether it learns, or its atoms were given.
    pub fn learns(&self) -> bool {
        self.learning.is_some()
    }

    /// An atom.
    pub fn atom(&self, atom: usize) -> Option<&[f32]> {
        let from = atom * stride(self.dimension);
        (atom < self.count).then(|| &self.atoms[from..from + self.dimension])
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(self.atoms.as_slice()) + self.learning.as_ref().map_or(0, |l| l.scatter.bytes())
    }

    /// Takes the features of a frame in, and appends the atoms that they call for: how many. A
    /// dictionary of given atoms stays as it is.
    pub fn learn(&mut self, features: &UnitFeatures) -> Result<usize> {
        self.accumulate(features)?;
        Ok(self.grow())
    }

    /// Takes the features of a frame in; zeros say nothing.
    pub fn accumulate(&mut self, features: &UnitFeatures) -> Result<()> {
        self.check_dimension_of("features", features.dimension())?;
        let set = self.set;
        let atoms = rows(&self.atoms, self.dimension, self.count);
        if let Some(learning) = &mut self.learning {
            learning.scatter.add(set, features, atoms, learning.settings.decay);
            learning.frames += 1;
        }
        Ok(())
    }

    /// Appends the directions that hold more than their share of energy and are no atoms yet,
    /// largest first, until there is none or no room: how many.
    pub fn grow(&mut self) -> usize {
        let Some(mut learning) = self.learning.take() else { return 0 };
        let before = self.count;
        if learning.frames >= learning.settings.first_frames {
            while self.grow_once(&mut learning) {}
        }
        self.learning = Some(learning);
        self.count - before
    }

    /// Appends some directions; whether there may be more.
    fn grow_once(&mut self, learning: &mut Learning) -> bool {
        let room = self.capacity.min(self.dimension) - self.count;
        let scatter = &mut learning.scatter;
        let threshold = f64::from(learning.settings.threshold) * scatter.energy;
        // No eigenvalue exceeds the norm.
        if room == 0 || scatter.norm() <= threshold {
            return false;
        }
        let counter = learning.frames as u32 ^ (self.count as u32) << 20;
        let atoms = rows(&self.atoms, self.dimension, self.count);
        let found = dominant(self.set, scatter, atoms, self.dimension, threshold, counter);
        let was_full = found.len() == TAKEN;
        let (padded, before) = (padded(self.dimension), self.count);
        let mut taken = vec![0.0; BUNDLE * padded];
        for mut direction in found.into_iter().take(room) {
            if self.append(&mut direction) {
                let from = (self.count - 1 - before) * padded;
                taken[from..from + padded].copy_from_slice(&direction);
            }
        }
        if self.count > before {
            learning.scatter.deflate(self.set, &taken);
        }
        was_full && self.count > before
    }

    /// Appends a direction, orthogonal to all atoms before; false where it is none of its own.
    fn append(&mut self, direction: &mut [f32]) -> bool {
        for _ in 0..2 {
            unit(self.set, direction);
            project_out(self.set, rows(&self.atoms, self.dimension, self.count), direction);
            // What is not finite is no direction either.
            let is_own = dot(self.set, direction, direction).sqrt() > MIN_OWN;
            if !is_own {
                return false;
            }
        }
        unit(self.set, direction);
        self.push(&direction[..self.dimension]);
        true
    }

    fn push(&mut self, atom: &[f32]) {
        let from = self.count * stride(self.dimension);
        self.atoms[from..from + self.dimension].copy_from_slice(atom);
        self.count += 1;
    }

    /// What keeps a row of a file from being the next atom.
    fn check_next(&self, row: &[f32]) -> std::result::Result<(), String> {
        let length = norm(row);
        let is_unit = (length - 1.0).abs() <= f64::from(ORTHONORMAL);
        if !is_unit {
            return Err(format!("has length {length}, not 1"));
        }
        let atoms = self.atoms.chunks_exact(stride(self.dimension)).take(self.count);
        match atoms.map(|atom| dot(self.set, atom, row)).position(|x| x.abs() > ORTHONORMAL) {
            Some(other) => Err(format!("is not orthogonal to atom {other}")),
            None => Ok(()),
        }
    }

    /// The codes Dᵀv of features, one after another, [`Dictionary::len`] numbers each.
    pub fn encode(&self, features: &UnitFeatures) -> Result<Vec<f32>> {
        self.check_dimension_of("features", features.dimension())?;
        let mut codes = vec![0.0; features.len() * self.count];
        if self.count == 0 {
            return Ok(codes);
        }
        let mut samples = Samples::new(padded(self.dimension));
        let pieces = features.values().chunks(Samples::COUNT * self.dimension);
        for (some, codes) in pieces.zip(codes.chunks_mut(Samples::COUNT * self.count)) {
            samples.load(some, self.dimension);
            let columns = samples.codes(self.set, rows(&self.atoms, self.dimension, self.count));
            for (s, code) in codes.chunks_exact_mut(self.count).enumerate() {
                for (x, row) in code.iter_mut().zip(columns.chunks_exact(Samples::COUNT)) {
                    *x = row[s];
                }
            }
        }
        Ok(codes)
    }

    /// The feature Dc of a code, which may be from before the last atoms.
    pub fn decode(&self, code: &[f32]) -> Vec<f32> {
        let mut feature = vec![0.0; self.dimension];
        let atoms = self.atoms.chunks_exact(stride(self.dimension)).take(self.count);
        for (atom, x) in atoms.zip(code) {
            add_scaled(self.set, *x, atom, &mut feature);
        }
        feature
    }

    /// A text's embedding as codes are asked for it.
    pub fn query(&self, text: &[f32]) -> Result<Query> {
        self.check_dimension_of("embedding", text.len())?;
        let length = norm(text);
        if !length.is_finite() || length == 0.0 {
            return Err(Error::invalid("embedding", "must be finite and not zero"));
        }
        // The whole length, not that of what the atoms keep: phrases stay comparable.
        let direction: Vec<f32> = text.iter().map(|x| (f64::from(*x) / length) as f32).collect();
        let atoms = self.atoms.chunks_exact(stride(self.dimension)).take(self.count);
        Ok(Query::new(self.set, atoms.map(|atom| dot(self.set, atom, &direction)).collect()))
    }

    fn check_dimension_of(&self, field: &str, dimension: usize) -> Result<()> {
        if dimension == self.dimension {
            return Ok(());
        }
        let problem = format!("dimension {dimension} is not the map's, {}", self.dimension);
        Err(Error::invalid(field, problem))
    }

    /// Everything that [`Dictionary::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> DictionaryState {
        let atoms = self.atoms.chunks_exact(stride(self.dimension)).take(self.count);
        let triangle = |learning: &Learning| {
            let pairs = (0..self.dimension).flat_map(|row| (0..=row).map(move |c| (row, c)));
            pairs.map(|(row, column)| learning.scatter.at(row, column)).collect()
        };
        let learning = self.learning.as_ref();
        DictionaryState {
            dimension: self.dimension,
            atoms: atoms.flat_map(|atom| &atom[..self.dimension]).copied().collect(),
            scatter: learning.map_or_else(Vec::new, triangle),
            energy: learning.map_or(0.0, |learning| learning.scatter.energy),
            frames: learning.map_or(0, |learning| learning.frames),
        }
    }

    /// A dictionary that goes on from a stored state.
    pub fn with_state(state: &DictionaryState, settings: DictionarySettings) -> Result<Self> {
        let damaged = |problem: &str| Error::corrupt("dictionary", problem);
        let n = state.dimension;
        check_dimension(n).map_err(|e| damaged(&e.to_string()))?;
        if state.scatter.is_empty() {
            return Self::fixed(&state.atoms, n).map_err(|e| damaged(&e.to_string()));
        }
        let mut dictionary = Self::new(n, settings)?;
        if !state.atoms.len().is_multiple_of(n)
            || state.atoms.len() / n > dictionary.capacity.min(n)
            || state.scatter.len() != n * (n + 1) / 2
        {
            return Err(damaged("atoms, scatter and capacity do not fit together"));
        }
        if !state.scatter.iter().all(|x| x.is_finite()) || !(0.0..1e30).contains(&state.energy) {
            return Err(damaged("scatter and energy must be finite"));
        }
        for row in state.atoms.chunks_exact(n) {
            dictionary.check_next(row).map_err(|p| damaged(&format!("an atom {p}")))?;
            dictionary.push(row);
        }
        if let Some(learning) = &mut dictionary.learning {
            let pairs = (0..n).flat_map(|row| (0..=row).map(move |column| (row, column)));
            for ((row, column), x) in pairs.zip(state.scatter.iter()) {
                learning.scatter.set(row, column, *x);
            }
            learning.scatter.energy = state.energy;
            learning.frames = state.frames;
        }
        Ok(dictionary)
    }
}

/// Numbers from one atom to the next. A line more than whole panels: atoms that are a power of two
/// apart would share a few sets of the caches.
fn stride(dimension: usize) -> usize {
    padded(dimension) + LINE
}

fn rows(atoms: &[f32], dimension: usize, count: usize) -> AtomRows<'_> {
    AtomRows { values: atoms, stride: stride(dimension), count }
}
