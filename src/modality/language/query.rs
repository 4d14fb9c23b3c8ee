//! Text against codes: cosine and relevancy (paper eq:cossim, eq:relevancy).

use super::products::dot;
use crate::geometry::simd::InstructionSet;

/// τ of LERF: similarities are multiplied by 10 before they are compared.
pub const TEMPERATURE: f32 = 0.1;

/// What LERF compares every query with.
pub const NEGATIVES: [&str; 4] = ["object", "things", "stuff", "texture"];

/// Codes that are shorter have no direction.
const MIN_SQUARE: f32 = 1e-20;

/// A text in the space of codes: Dᵀφ / ‖φ‖.
#[derive(Debug, Clone)]
pub struct Query {
    set: InstructionSet,
    code: Vec<f32>,
}

impl Query {
    pub(super) fn new(set: InstructionSet, code: Vec<f32>) -> Self {
        Self { set, code }
    }

    /// The numbers.
    pub fn code(&self) -> &[f32] {
        &self.code
    }

    /// The cosine of the text with the feature of a code; NaN where the code is nothing. A code of
    /// another length than the dictionary's is taken as far as both go.
    pub fn score(&self, code: &[f32]) -> f32 {
        let code = &code[..code.len().min(self.code.len())];
        cosine(dot(self.set, code, &self.code), dot(self.set, code, code))
    }

    /// c · q for a code: [`Query::score`] without the length of the code.
    pub fn along(&self, code: &[f32]) -> f32 {
        dot(self.set, code, &self.code)
    }
}

/// ‖c‖².
#[inline]
pub fn square(set: InstructionSet, code: &[f32]) -> f32 {
    dot(set, code, code)
}

/// The cosine of a code with a text, of c · q and ‖c‖²; NaN where the code is nothing.
#[inline]
pub fn cosine(along: f32, square: f32) -> f32 {
    if square > MIN_SQUARE { along / square.sqrt() } else { f32::NAN }
}

/// How much more a place is what was asked for than any of the negatives, within 0..1: the least
/// favourable of the two-way softmaxes, which is that with the best negative; 1 without any.
pub fn relevancy(score: f32, negatives: &[f32], temperature: f32) -> f32 {
    let best = negatives.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    1.0 / (1.0 + ((best - score) / temperature).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relevancy_is_the_least_favourable_softmax() {
        let (score, negatives) = (0.3, [0.1, 0.25, -0.2]);
        let softmax = |other: f32| {
            let [a, b] = [score, other].map(|s: f32| (s / TEMPERATURE).exp());
            a / (a + b)
        };
        let expected = negatives.map(softmax).into_iter().fold(1.0, f32::min);
        assert!((relevancy(score, &negatives, TEMPERATURE) - expected).abs() < 1e-6);
        assert_eq!(relevancy(0.2, &[], TEMPERATURE), 1.0);
        assert_eq!(relevancy(0.2, &[0.2], TEMPERATURE), 0.5);
        assert!(relevancy(f32::NAN, &[0.1], TEMPERATURE).is_nan());
    }

    #[test]
    fn a_score_is_a_cosine() {
        for len in [1, 16, 37, 64] {
            let code: Vec<f32> = (0..len).map(|i| ((i * 7 % 11) as f32 - 4.0) / 8.0).collect();
            let text: Vec<f32> = (0..len).map(|i| ((i * 5 % 13) as f32 - 6.0) / 16.0).collect();
            let along: f32 = code.iter().zip(&text).map(|(a, b)| a * b).sum();
            let square: f32 = code.iter().map(|x| x * x).sum();
            let expected = along / square.sqrt();
            for set in InstructionSet::available() {
                let query = Query::new(set, text.clone());
                let found = query.score(&code);
                assert!((found - expected).abs() < 1e-6, "{set:?} {found}");
                assert!((query.along(&code) - along).abs() < 1e-5, "{set:?}");
            }
        }
    }

    #[test]
    fn nothing_has_no_score() {
        let query = Query::new(InstructionSet::detect(), vec![1.0; 20]);
        assert!(query.score(&[0.0; 20]).is_nan());
        assert!(query.score(&[]).is_nan());
    }
}
