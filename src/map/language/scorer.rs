//! Texts against codes.

use crate::error::{Error, Result};
use crate::geometry::simd::InstructionSet;
use crate::modality::language::{Dictionary, Query, TEMPERATURE, cosine, relevancy, square};

/// Texts in the space of a view's codes.
#[derive(Debug, Clone)]
pub struct Scorer {
    set: InstructionSet,
    prompts: Vec<Query>,
    negatives: Vec<Query>,
}

impl Scorer {
    pub(super) fn new(
        dictionary: &Dictionary,
        prompts: &[Vec<f32>],
        negatives: &[Vec<f32>],
    ) -> Result<Self> {
        if prompts.is_empty() {
            return Err(Error::invalid("prompts", "at least one is needed"));
        }
        let queries = |field: &str, texts: &[Vec<f32>]| -> Result<Vec<Query>> {
            let query = |(i, text): (usize, &Vec<f32>)| {
                dictionary.query(text).map_err(|error| match error {
                    Error::InvalidArgument { problem, .. } => {
                        Error::invalid(format!("{field}[{i}]"), problem)
                    }
                    other => other,
                })
            };
            texts.iter().enumerate().map(query).collect()
        };
        Ok(Self {
            set: InstructionSet::detect(),
            prompts: queries("prompts", prompts)?,
            negatives: queries("negatives", negatives)?,
        })
    }

    /// The number of prompts.
    pub fn len(&self) -> usize {
        self.prompts.len()
    }

    /// Whether there is no prompt: never.
    pub fn is_empty(&self) -> bool {
        self.prompts.is_empty()
    }

    /// Whether scores are relevancies, within 0..=1, and no cosines.
    pub fn is_relevancy(&self) -> bool {
        !self.negatives.is_empty()
    }

    /// The cosine of each prompt with a code.
    pub(super) fn prompts(&self, code: &[f32]) -> impl Iterator<Item = f32> {
        let square = square(self.set, code);
        self.prompts.iter().map(move |query| cosine(query.along(code), square))
    }

    /// How well the best prompt fits a code.
    pub(in crate::map) fn score(&self, code: &[f32]) -> f32 {
        let square = square(self.set, code);
        let best = |queries: &[Query]| {
            let along = queries.iter().map(|query| query.along(code));
            cosine(along.fold(f32::NEG_INFINITY, f32::max), square)
        };
        let score = best(&self.prompts);
        // Only the best negative matters.
        let against = || relevancy(score, &[best(&self.negatives)], TEMPERATURE);
        if self.negatives.is_empty() { score } else { against() }
    }
}
