//! The features and labels of `ingest.proto`: bytes to numbers and classes, within limits.

use std::sync::Arc;

use half::f16;
use image::{DynamicImage, ImageFormat};

use super::image::decode;
use super::v1;
use crate::error::{Error, Fault, Result};
use crate::frame::{
    Class, Contract, FeatureImage, LabelImage, MAX_CLASSES, MAX_FEATURE_NUMBERS, MAX_FEATURES,
    MAX_SIDE,
};
use crate::geometry::Intrinsics;

/// Sizes and the length of `data` are checked before anything is made of it; numbers with the whole
/// frame, in [`crate::frame::Frame::check`].
pub(super) fn features_from_wire(message: v1::FeatureImage) -> Result<FeatureImage> {
    use v1::FeatureEncoding as Encoding;
    let dimension = message.dimension as usize;
    let contract = Contract { encoder_id: message.encoder_id.into(), dimension };
    contract.check("features")?;
    let (width, height) = (message.width, message.height);
    let pixels = pixels("features.width/height", width, height)?;
    let encoding = Encoding::try_from(message.encoding).unwrap_or(Encoding::Unspecified);
    let size = match encoding {
        Encoding::F16 => size_of::<f16>(),
        Encoding::F32 => size_of::<f32>(),
        Encoding::Unspecified => {
            let problem = format!("{} is none of F16, F32", message.encoding);
            return Err(Error::invalid("features.encoding", problem));
        }
    };
    let count = message.data.len() / (dimension * size);
    if count > MAX_FEATURES || count * dimension > MAX_FEATURE_NUMBERS {
        let problem = format!(
            "{count} of {dimension} numbers; at most {MAX_FEATURES} with {MAX_FEATURE_NUMBERS} \
             numbers together"
        );
        return Err(Error::invalid("features", problem));
    }
    let expected = if message.index.is_empty() { pixels } else { count };
    let needed = expected * dimension * size;
    check_bytes("features.data", message.data.len(), needed, "the features")?;
    let index = (!message.index.is_empty()).then_some(message.index);
    if let Some(index) = &index {
        check_bytes("features.index", index.len(), 2 * pixels, "u16 pixels")?;
    }
    let features = match encoding {
        Encoding::F16 => numbers(&message.data, |bytes| f16::from_le_bytes(bytes).to_f32()),
        _ => numbers(&message.data, f32::from_le_bytes),
    };
    let index = index.map(|index| numbers(&index, u16::from_le_bytes));
    Ok(FeatureImage { contract, width, height, index, features })
}

/// The message of features, in f32: as they are here.
pub(super) fn features_to_wire(image: &FeatureImage) -> v1::FeatureImage {
    let index = image.index.iter().flatten().flat_map(|place| place.to_le_bytes());
    v1::FeatureImage {
        encoder_id: image.contract.encoder_id.to_string(),
        width: image.width,
        height: image.height,
        dimension: image.contract.dimension as u32,
        encoding: v1::FeatureEncoding::F32.into(),
        data: image.features.iter().flat_map(|number| number.to_le_bytes()).collect(),
        index: index.collect(),
    }
}

/// Of the size that it says, or else of the camera's.
pub(super) fn labels_from_wire(message: v1::LabelImage, k: &Intrinsics) -> Result<LabelImage> {
    use v1::LabelEncoding as Encoding;
    if message.classes.len() > MAX_CLASSES {
        let problem = format!("are {}; the limit is {MAX_CLASSES}", message.classes.len());
        return Err(Error::invalid("labels.classes", problem));
    }
    let (width, height) = match (message.width, message.height) {
        (0, 0) => (k.width, k.height),
        size => size,
    };
    let pixels = pixels("labels.width/height", width, height)?;
    let data = &message.data;
    let ids = match Encoding::try_from(message.encoding) {
        Ok(Encoding::U8) => {
            check_bytes("labels.data", data.len(), pixels, "u8 pixels")?;
            data.iter().map(|id| u16::from(*id)).collect()
        }
        Ok(Encoding::U16) => {
            check_bytes("labels.data", data.len(), 2 * pixels, "u16 pixels")?;
            numbers(data, u16::from_le_bytes)
        }
        Ok(Encoding::Png) => ids_from_png(data, (width, height))?,
        Ok(Encoding::Unspecified) | Err(_) => {
            let problem = format!("{} is none of U8, U16, PNG", message.encoding);
            return Err(Error::invalid("labels.encoding", problem));
        }
    };
    let labels = LabelImage { width, height, ids, classes: classes_from_wire(message.classes)? };
    labels.check()?;
    Ok(labels)
}

fn ids_from_png(data: &[u8], size: (u32, u32)) -> Result<Vec<u16>> {
    match decode("labels.data", data, ImageFormat::Png, size, "its size is")? {
        DynamicImage::ImageLuma8(grey) => Ok(grey.iter().map(|id| u16::from(*id)).collect()),
        DynamicImage::ImageLuma16(grey) => Ok(grey.into_raw()),
        other => {
            let problem = format!("PNG must be grey, is {:?}", other.color());
            Err(Error::invalid("labels.data", problem))
        }
    }
}

/// In the order of their ids, as a frame has them; they may come in any.
fn classes_from_wire(messages: Vec<v1::LabelClass>) -> Result<Arc<[Class]>> {
    let class = |(at, class): (usize, v1::LabelClass)| {
        let wrong = |problem| Error::invalid(format!("labels.classes[{at}].id"), problem);
        let id = u16::try_from(class.id);
        let id = id.map_err(|_| wrong(format!("{} must be within 1..=65535", class.id)))?;
        Ok(Class { id, name: class.name })
    };
    let mut classes = messages.into_iter().enumerate().map(class).collect::<Result<Vec<_>>>()?;
    classes.sort_by_key(|class| class.id);
    Ok(classes.into())
}

/// The message of labels, ids in u16.
pub(super) fn labels_to_wire(labels: &LabelImage) -> v1::LabelImage {
    let class = |class: &Class| v1::LabelClass { id: class.id.into(), name: class.name.clone() };
    v1::LabelImage {
        encoding: v1::LabelEncoding::U16.into(),
        data: labels.ids.iter().flat_map(|id| id.to_le_bytes()).collect(),
        classes: labels.classes.iter().map(class).collect(),
        width: labels.width,
        height: labels.height,
    }
}

/// How many pixels there are of a size that may be allocated for.
fn pixels(field: &str, width: u32, height: u32) -> Result<usize> {
    let sides = 1..=MAX_SIDE;
    let pixels = width as usize * height as usize;
    if sides.contains(&width) && sides.contains(&height) && pixels <= super::MAX_PIXELS {
        return Ok(pixels);
    }
    let problem = format!(
        "{width}x{height} must be within 1..={MAX_SIDE} each and {} pixels in all",
        super::MAX_PIXELS
    );
    Err(Error::frame(Fault::SizeMismatch, field, problem))
}

fn check_bytes(field: &str, found: usize, needed: usize, what: &str) -> Result<()> {
    if found == needed {
        return Ok(());
    }
    let problem = format!("{found} bytes, but {what} need {needed}");
    Err(Error::frame(Fault::SizeMismatch, field, problem))
}

fn numbers<const N: usize, T>(bytes: &[u8], number: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|chunk| number(*chunk)).collect()
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use proptest::prelude::*;

    use super::*;
    use crate::frame::NO_FEATURE;

    fn camera() -> Intrinsics {
        Intrinsics { fx: 5.0, fy: 5.0, cx: 1.0, cy: 1.0, width: 3, height: 2 }
    }

    fn grid() -> FeatureImage {
        FeatureImage {
            contract: Contract { encoder_id: "clip".into(), dimension: 2 },
            width: 3,
            height: 2,
            index: None,
            features: (0..12).map(|i| i as f32 * 0.25).collect(),
        }
    }

    fn labels() -> LabelImage {
        let class = |id, name: &str| Class { id, name: name.into() };
        LabelImage {
            width: 3,
            height: 2,
            ids: vec![0, 7, 3, 3, 255, 7],
            classes: [class(3, "chair"), class(7, "table")].into(),
        }
    }

    proptest! {
        #[test]
        fn features_come_back_as_they_were(
            features in prop::collection::vec(any::<[f32; 3]>(), 1..20),
            index in prop::option::of(prop::collection::vec(any::<u16>(), 6)),
        ) {
            let count = features.len() as u32;
            let (width, height) = if index.is_some() { (3, 2) } else { (count, 1) };
            let image = FeatureImage {
                contract: Contract { encoder_id: "clip".into(), dimension: 3 },
                width,
                height,
                index,
                features: features.concat(),
            };
            let back = features_from_wire(features_to_wire(&image)).expect("our own");
            let bits = |f: &FeatureImage| f.features.iter().map(|n| n.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&back), bits(&image));
            prop_assert_eq!((back.contract, back.width, back.height, back.index),
                (image.contract, image.width, image.height, image.index));
        }

        #[test]
        fn labels_come_back_as_they_were(ids in prop::collection::vec(any::<u16>(), 6)) {
            let labels = LabelImage { ids, ..labels() };
            prop_assert_eq!(labels_from_wire(labels_to_wire(&labels), &camera()).expect("ours"), labels);
        }
    }

    #[test]
    fn halves_read_as_numbers() {
        let data: Vec<u8> =
            grid().features.iter().flat_map(|n| f16::from_f32(*n).to_le_bytes()).collect();
        let encoding = v1::FeatureEncoding::F16.into();
        let message = v1::FeatureImage { encoding, data, ..features_to_wire(&grid()) };
        assert_eq!(features_from_wire(message).expect("good"), grid());
    }

    #[test]
    fn labels_come_raw_or_compressed_in_any_order_of_classes() {
        let bytes: Vec<u8> = labels().ids.iter().map(|id| *id as u8).collect();
        let grey = image::GrayImage::from_raw(3, 2, bytes.clone()).expect("its size");
        let mut file = Cursor::new(Vec::new());
        grey.write_to(&mut file, ImageFormat::Png).expect("memory");
        for (encoding, data) in
            [(v1::LabelEncoding::U8, bytes), (v1::LabelEncoding::Png, file.into_inner())]
        {
            let mut message = labels_to_wire(&labels());
            (message.encoding, message.data) = (encoding.into(), data);
            message.classes.reverse();
            (message.width, message.height) = (0, 0);
            assert_eq!(labels_from_wire(message, &camera()).expect("good"), labels());
        }
    }

    #[test]
    fn what_is_wrong_with_features_is_named() {
        type Spoil = fn(&mut v1::FeatureImage);
        let cases: [(&str, &str, Spoil); 11] = [
            ("features.encoder_id", "plain text", |f| f.encoder_id.clear()),
            ("features.dimension", "1..=4096", |f| f.dimension = 0),
            ("features.dimension", "5000", |f| f.dimension = 5000),
            ("features.width/height", "0x2", |f| f.width = 0),
            ("features.width/height", "8193", |f| f.height = 8193),
            ("features.width/height", "16777216", |f| (f.width, f.height) = (8192, 8192)),
            ("features.encoding", "F16, F32", |f| f.encoding = 7),
            ("features.data", "47 bytes", |f| f.data.truncate(47)),
            ("features.data", "need 24", |f| f.encoding = v1::FeatureEncoding::F16.into()),
            ("features.index", "need 12", |f| f.index = vec![0; 11]),
            ("features", "16384", |f| {
                f.dimension = 1;
                f.data = vec![0; 4 * (MAX_FEATURES + 1)];
            }),
        ];
        for (field, words, spoil) in cases {
            let mut message = features_to_wire(&grid());
            spoil(&mut message);
            let error = features_from_wire(message).expect_err(words);
            assert_eq!(error.field(), Some(field), "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
        // What a size leaves open is checked with the frame.
        let index = Some(vec![6, 0, 0, 0, 0, NO_FEATURE]);
        let back = features_from_wire(features_to_wire(&FeatureImage { index, ..grid() }));
        assert_eq!(back.expect("read").check().expect_err("6").field(), Some("features.index"));
    }

    #[test]
    fn what_is_wrong_with_labels_is_named() {
        type Spoil = fn(&mut v1::LabelImage);
        let cases: [(&str, &str, Spoil); 9] = [
            ("labels.encoding", "U8, U16, PNG", |l| l.encoding = 0),
            ("labels.data", "need 12", |l| l.data.truncate(11)),
            ("labels.data", "need 6", |l| l.encoding = v1::LabelEncoding::U8.into()),
            ("labels.data", "Png", |l| l.encoding = v1::LabelEncoding::Png.into()),
            ("labels.width/height", "0x2", |l| l.width = 0),
            ("labels.classes[1].id", "65536", |l| l.classes[1].id = 65_536),
            ("labels.classes[0].id", "no class", |l| l.classes[1].id = 0),
            ("labels.classes[1].id", "above", |l| l.classes[1].id = 3),
            ("labels.classes[0].name", "512", |l| l.classes[0].name = "x".repeat(513)),
        ];
        for (field, words, spoil) in cases {
            let mut message = labels_to_wire(&labels());
            spoil(&mut message);
            let error = labels_from_wire(message, &camera()).expect_err(words);
            assert_eq!(error.field(), Some(field), "{error}");
            assert!(error.to_string().contains(words), "{error}");
        }
        let mut message = labels_to_wire(&labels());
        message.classes = vec![v1::LabelClass::default(); MAX_CLASSES + 1];
        let error = labels_from_wire(message, &camera()).expect_err("too many");
        assert_eq!(error.field(), Some("labels.classes"));
    }
}
