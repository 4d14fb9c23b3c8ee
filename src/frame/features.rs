//! What a frame says of meaning: vision-language features, or the classes of a segmenter.

use std::sync::Arc;

use super::{Contract, MAX_SIDE};
use crate::error::{Error, Fault, Result};

/// Features of a frame at most, and their numbers together (64 MiB).
pub const MAX_FEATURES: usize = 16_384;
pub const MAX_FEATURE_NUMBERS: usize = 1 << 24;
/// Classes of a label image at most, and the longest name of one, bytes.
pub const MAX_CLASSES: usize = 4096;
pub const MAX_CLASS_BYTES: usize = 512;
/// What stands in [`FeatureImage::index`] where a pixel has no feature.
pub const NO_FEATURE: u16 = u16::MAX;

/// Features of a frame in the same view as its depth image.
///
/// Either a grid of patches, of which each has its own feature, or an image of indices into a few
/// features, which is what an image of labels becomes.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureImage {
    pub contract: Contract,
    /// Patches of the grid, or pixels of `index`.
    pub width: u32,
    pub height: u32,
    /// For each pixel, row-major, which feature it has, or [`NO_FEATURE`]. `None`: the features are
    /// the patches of the grid, row-major.
    pub index: Option<Vec<u16>>,
    /// One after another; of any length, since only their direction counts. Zeros say nothing.
    pub features: Vec<f32>,
}

impl FeatureImage {
    /// The number of features.
    pub fn len(&self) -> usize {
        self.features.len() / self.contract.dimension.max(1)
    }

    /// Whether there is no feature.
    pub fn is_empty(&self) -> bool {
        self.features.is_empty()
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.features[..]) + self.index.as_ref().map_or(0, |index| 2 * index.len())
    }

    /// Checks the encoder's name, the dimension, the sizes, the indices, and that numbers are finite.
    pub fn check(&self) -> Result<()> {
        self.contract.check("features")?;
        let dimension = self.contract.dimension;
        let pixels = check_sides("features.width/height", self.width, self.height)?;
        let count = self.len();
        if count > MAX_FEATURES || self.features.len() > MAX_FEATURE_NUMBERS {
            return Err(Error::invalid(
                "features",
                format!(
                    "{count} of {dimension} numbers; at most {MAX_FEATURES} with \
                     {MAX_FEATURE_NUMBERS} numbers together"
                ),
            ));
        }
        let expected = if self.index.is_some() { count } else { pixels };
        if self.features.len() != expected * dimension {
            let found = self.features.len();
            let problem = format!("{found} numbers are not {expected} features of {dimension}");
            return Err(Error::frame(Fault::SizeMismatch, "features.data", problem));
        }
        if let Some(index) = &self.index {
            check_pixels("features.index", index.len(), pixels)?;
            if index.iter().any(|&i| i != NO_FEATURE && usize::from(i) >= count) {
                let problem = format!("an index is none of {count} features");
                return Err(Error::invalid("features.index", problem));
            }
        }
        match self.features.iter().position(|x| !x.is_finite()) {
            Some(at) => Err(Error::invalid(format!("features.data[{at}]"), "must be finite")),
            None => Ok(()),
        }
    }
}

/// A class of things that a segmenter knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Class {
    /// What stands in the image; not 0.
    pub id: u16,
    /// In plain words: what a text encoder is given.
    pub name: String,
}

/// The class of each pixel, in the same view as the depth image.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelImage {
    pub width: u32,
    pub height: u32,
    /// Row-major; 0, and ids that no class has, say nothing.
    pub ids: Vec<u16>,
    /// Sorted by id.
    pub classes: Arc<[Class]>,
}

impl LabelImage {
    /// Checks sizes, and that classes have names and ids of their own.
    pub fn check(&self) -> Result<()> {
        let pixels = check_sides("labels.width/height", self.width, self.height)?;
        check_pixels("labels.data", self.ids.len(), pixels)?;
        if self.classes.len() > MAX_CLASSES {
            let problem = format!("are {}; the limit is {MAX_CLASSES}", self.classes.len());
            return Err(Error::invalid("labels.classes", problem));
        }
        for (i, class) in self.classes.iter().enumerate() {
            let wrong = |field: &str, problem: String| {
                Err(Error::invalid(format!("labels.classes[{i}].{field}"), problem))
            };
            if class.id == 0 {
                return wrong("id", "0 means no class".into());
            }
            if i > 0 && self.classes[i - 1].id >= class.id {
                return wrong("id", format!("{} must be above the one before", class.id));
            }
            if class.name.trim().is_empty() || class.name.len() > MAX_CLASS_BYTES {
                return wrong("name", format!("must be 1 to {MAX_CLASS_BYTES} bytes"));
            }
        }
        Ok(())
    }

    /// The place in `classes` of each pixel's class, or [`NO_FEATURE`].
    pub fn places(&self) -> Vec<u16> {
        let mut place_of = vec![NO_FEATURE; usize::from(u16::MAX) + 1];
        for (place, class) in self.classes.iter().enumerate() {
            place_of[usize::from(class.id)] = place as u16;
        }
        self.ids.iter().map(|&id| place_of[usize::from(id)]).collect()
    }
}

/// Refuses sides without or with too many pixels; how many pixels they make.
fn check_sides(field: &str, width: u32, height: u32) -> Result<usize> {
    let sides = 1..=MAX_SIDE;
    if sides.contains(&width) && sides.contains(&height) {
        return Ok(width as usize * height as usize);
    }
    let problem = format!("{width}x{height}; each side must lie within 1..={MAX_SIDE}");
    Err(Error::frame(Fault::SizeMismatch, field, problem))
}

fn check_pixels(field: &str, found: usize, pixels: usize) -> Result<()> {
    if found == pixels {
        return Ok(());
    }
    Err(Error::frame(Fault::SizeMismatch, field, format!("{found} pixels, not {pixels}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> FeatureImage {
        FeatureImage {
            contract: Contract { encoder_id: "clip".into(), dimension: 2 },
            width: 3,
            height: 2,
            index: None,
            features: vec![1.0; 12],
        }
    }

    fn labels() -> LabelImage {
        let class = |id, name: &str| Class { id, name: name.into() };
        LabelImage {
            width: 2,
            height: 2,
            ids: vec![0, 3, 7, 9],
            classes: [class(3, "chair"), class(7, "table")].into(),
        }
    }

    #[test]
    fn what_is_wrong_with_features_is_named() {
        assert!(grid().check().is_ok());
        let indexed = FeatureImage { index: Some(vec![0, 1, 2, 3, 5, NO_FEATURE]), ..grid() };
        assert!(indexed.check().is_ok());
        let of = |id: &str, dimension| FeatureImage {
            contract: Contract { encoder_id: id.into(), dimension },
            ..grid()
        };
        let index = |index| FeatureImage { index: Some(index), ..grid() };
        let mut infinite = grid();
        infinite.features[7] = f32::NAN;
        let cases = [
            (of("", 2), "features.encoder_id"),
            (of("clip", 0), "features.dimension"),
            (FeatureImage { width: 0, ..grid() }, "features.width/height"),
            (FeatureImage { width: 4, ..grid() }, "features.data"),
            (FeatureImage { features: vec![1.0; 13], ..grid() }, "features.data"),
            (FeatureImage { features: vec![1.0; 1 << 25], ..grid() }, "features"),
            (index(vec![0; 5]), "features.index"),
            (index(vec![6; 6]), "features.index"),
            (infinite, "features.data[7]"),
        ];
        for (image, field) in cases {
            assert_eq!(image.check().expect_err(field).field(), Some(field));
        }
    }

    #[test]
    fn labels_have_classes_and_places() {
        assert!(labels().check().is_ok());
        assert_eq!(labels().places(), [NO_FEATURE, 0, 1, NO_FEATURE]);
        let classes = |classes: &[(u16, &str)]| LabelImage {
            classes: classes
                .iter()
                .map(|(id, name)| Class { id: *id, name: (*name).into() })
                .collect(),
            ..labels()
        };
        let cases = [
            (LabelImage { height: 9000, ..labels() }, "labels.width/height"),
            (LabelImage { ids: vec![0; 3], ..labels() }, "labels.data"),
            (classes(&[(0, "nothing")]), "labels.classes[0].id"),
            (classes(&[(2, "b"), (2, "a")]), "labels.classes[1].id"),
            (classes(&[(2, " ")]), "labels.classes[0].name"),
        ];
        for (image, field) in cases {
            assert_eq!(image.check().expect_err(field).field(), Some(field));
        }
    }
}
