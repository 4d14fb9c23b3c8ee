//! The classes of a segmenter as features: each pixel has the embedding of its class's name.

use super::TextEncoder;
use crate::error::Result;
use crate::frame::{FeatureImage, LabelImage, NO_FEATURE};

/// The features of an image of classes. Only the names of classes that occur are embedded, once each.
pub fn features_of(labels: &LabelImage, encoder: &TextEncoder) -> Result<FeatureImage> {
    labels.check()?;
    let mut index = labels.places();
    // Places of classes that occur, in the order of their ids, and then the features of each.
    let mut occurs = vec![false; labels.classes.len()];
    for &place in index.iter().filter(|place| **place != NO_FEATURE) {
        occurs[usize::from(place)] = true;
    }
    let places: Vec<usize> = (0..occurs.len()).filter(|place| occurs[*place]).collect();
    let mut feature_of = vec![NO_FEATURE; occurs.len()];
    for (feature, &place) in places.iter().enumerate() {
        feature_of[place] = feature as u16;
    }
    for place in index.iter_mut().filter(|place| **place != NO_FEATURE) {
        *place = feature_of[usize::from(*place)];
    }
    let names: Vec<&str> = places.iter().map(|place| &*labels.classes[*place].name).collect();
    let name_of = |at: usize| format!("labels.classes[{}].name", places[at]);
    let features = encoder.embed_named("labels", name_of, &names)?.concat();
    Ok(FeatureImage {
        contract: encoder.contract().clone(),
        width: labels.width,
        height: labels.height,
        index: Some(index),
        features,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encoder::test_files::static_folder;
    use crate::error::Status;
    use crate::frame::Class;

    fn labels(ids: &[u16]) -> LabelImage {
        let class = |id, name: &str| Class { id, name: name.into() };
        LabelImage {
            width: ids.len() as u32,
            height: 1,
            ids: ids.to_vec(),
            classes: [class(3, "xyz"), class(7, "table"), class(9, "red chair")].into(),
        }
    }

    #[test]
    fn pixels_get_the_embeddings_of_their_classes() {
        let folder = static_folder();
        let encoder = TextEncoder::open_static(folder.path()).expect("an encoder");
        let image = features_of(&labels(&[9, 0, 7, 5, 9]), &encoder).expect("features");
        image.check().expect("good features");
        assert_eq!(image.contract, *encoder.contract());
        // Table before red chair, by id; nothing for no class and for an id that no class has.
        assert_eq!(image.index, Some(vec![1, NO_FEATURE, 0, NO_FEATURE, 1]));
        assert_eq!(image.features, encoder.embed(&["table", "red chair"]).expect("two").concat());
        let nothing = features_of(&labels(&[0, 5]), &encoder).expect("no features");
        nothing.check().expect("nothing is fine");
        assert!(nothing.is_empty());
    }

    #[test]
    fn what_cannot_be_embedded_is_named() {
        let folder = static_folder();
        let encoder = TextEncoder::open_static(folder.path()).expect("an encoder");
        let error = features_of(&labels(&[7, 3]), &encoder).expect_err("an unknown word");
        assert_eq!(error.field(), Some("labels.classes[0].name"), "{error}");
        let mut small = labels(&[7]);
        small.height = 2;
        assert_eq!(
            features_of(&small, &encoder).expect_err("too small").field(),
            Some("labels.data")
        );
        let external = TextEncoder::external("clip", 512).expect("an encoder");
        let error = features_of(&labels(&[7]), &external).expect_err("no words");
        assert_eq!(error.status(), Status::FailedPrecondition);
        assert!(error.to_string().starts_with("labels: "), "{error}");
    }
}
