//! Features as the dictionary takes them: checked and of unit length.

use crate::error::{Error, Result};
use crate::frame::MAX_DIMENSION;

/// Shorter than this, a feature has no direction.
const MIN_NORM: f64 = 1e-12;

/// Features of one frame: finite, each of unit length, or zero where a sample says nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct UnitFeatures {
    dimension: usize,
    values: Vec<f32>,
}

impl UnitFeatures {
    /// Scales features, one after another in `values`, to unit length; those too short to have a
    /// direction become zero.
    pub fn new(mut values: Vec<f32>, dimension: usize) -> Result<Self> {
        check_dimension(dimension)?;
        if !values.len().is_multiple_of(dimension) {
            let problem = format!("{} numbers are no whole features of {dimension}", values.len());
            return Err(Error::invalid("features", problem));
        }
        for (sample, feature) in values.chunks_exact_mut(dimension).enumerate() {
            let norm = norm(feature);
            if !norm.is_finite() {
                return Err(Error::invalid(format!("features[{sample}]"), "must be finite"));
            }
            let scale = if norm < MIN_NORM { 0.0 } else { 1.0 / norm };
            feature.iter_mut().for_each(|x| *x = (f64::from(*x) * scale) as f32);
        }
        Ok(Self { dimension, values })
    }

    /// Numbers of a feature.
    pub fn dimension(&self) -> usize {
        self.dimension
    }

    /// The number of features, zeros included.
    pub fn len(&self) -> usize {
        self.values.len() / self.dimension
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The features, one after another.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Each feature.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[f32]> {
        self.values.chunks_exact(self.dimension)
    }
}

/// Refuses a dimension that no encoder has.
pub(super) fn check_dimension(dimension: usize) -> Result<()> {
    if (1..=MAX_DIMENSION).contains(&dimension) {
        return Ok(());
    }
    Err(Error::invalid("dimension", format!("{dimension} is not within 1..={MAX_DIMENSION}")))
}

/// The length of a vector; not finite where one of its numbers is not.
pub(super) fn norm(vector: &[f32]) -> f64 {
    vector.iter().map(|x| f64::from(*x) * f64::from(*x)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_become_unit_or_zero() {
        let features = UnitFeatures::new(vec![3.0, 4.0, 0.0, 0.0, 1e-30, 0.0], 2).unwrap();
        assert_eq!(features.values(), [0.6, 0.8, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((features.len(), features.is_empty()), (3, false));
        // The square of the largest number is no f32.
        let large = UnitFeatures::new(vec![f32::MAX, -f32::MAX], 2).unwrap();
        assert!((norm(large.values()) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let field = |values: &[f32], dimension| {
            let error = UnitFeatures::new(values.to_vec(), dimension).unwrap_err();
            error.field().unwrap().to_owned()
        };
        assert_eq!(field(&[1.0, 0.0, f32::NAN, 0.0], 2), "features[1]");
        assert_eq!(field(&[f32::NEG_INFINITY, 0.0], 2), "features[0]");
        assert_eq!(field(&[1.0; 3], 2), "features");
        assert_eq!(field(&[], 0), "dimension");
        assert_eq!(field(&[], MAX_DIMENSION + 1), "dimension");
    }
}
