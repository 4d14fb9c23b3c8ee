//! `ingest.proto`: frames in, acks out.

use std::sync::Arc;
use std::time::Duration;

use super::features::{features_from_wire, features_to_wire, labels_from_wire, labels_to_wire};
use super::geometry::{
    intrinsics_from_wire, intrinsics_to_wire, pose_from_wire, pose_to_wire, required,
};
use super::image::{check_size, color_from_wire, depth_from_wire};
use super::v1;
use super::v1::frame::Meaning;
use crate::engine::{Queue, QueuePolicy, Reason, Verdict};
use crate::error::{Error, Result};
use crate::frame::{Frame, LabelImage, MAX_NAME_BYTES};

/// A frame as it came in. Sizes and encodings are right; the service checks the rest.
#[derive(Debug)]
pub struct IncomingFrame {
    pub map_id: String,
    pub policy: QueuePolicy,
    pub frame: Frame,
    /// Classes whose names are yet to become the features of the frame.
    pub labels: Option<LabelImage>,
}

impl TryFrom<v1::Frame> for IncomingFrame {
    type Error = Error;

    fn try_from(message: v1::Frame) -> Result<Self> {
        let policy = match v1::QueuePolicy::try_from(message.queue_policy) {
            Ok(v1::QueuePolicy::Latest) => QueuePolicy::Latest,
            Ok(v1::QueuePolicy::Block) => QueuePolicy::Block,
            Err(_) => {
                return Err(Error::invalid(
                    "queue_policy",
                    format!("{} is neither LATEST nor BLOCK", message.queue_policy),
                ));
            }
        };
        let world_from_camera =
            pose_from_wire(required("world_from_camera", message.world_from_camera)?)?;
        let intrinsics = intrinsics_from_wire(required("intrinsics", message.intrinsics)?);
        check_size(&intrinsics)?;
        let depth = depth_from_wire(required("depth", message.depth)?, &intrinsics)?;
        let color = message.color.map(|color| color_from_wire(color, &intrinsics)).transpose()?;
        let (features, labels) = match message.meaning {
            None => (None, None),
            Some(Meaning::Features(features)) => (Some(features_from_wire(features)?), None),
            Some(Meaning::Labels(labels)) => (None, Some(labels_from_wire(labels, &intrinsics)?)),
        };
        let frame = Frame {
            robot_id: message.robot_id.into(),
            sensor_id: message.sensor_id.into(),
            seq: message.seq,
            stamp_ns: message.stamp_ns,
            world_from_camera,
            intrinsics,
            depth,
            color,
            features,
        };
        Ok(Self { map_id: message.map_id, policy, frame, labels })
    }
}

/// The message of a frame, depth as it is here: f32 metres, so that the map on the other side is the
/// same as one made without a wire.
pub fn frame_to_wire(map_id: &str, frame: &Frame, policy: QueuePolicy) -> v1::Frame {
    let metres: Vec<[u8; 4]> = frame.depth.metres.iter().map(|z| z.to_le_bytes()).collect();
    v1::Frame {
        map_id: map_id.into(),
        robot_id: frame.robot_id.to_string(),
        sensor_id: frame.sensor_id.to_string(),
        seq: frame.seq,
        stamp_ns: frame.stamp_ns,
        world_from_camera: Some(pose_to_wire(&frame.world_from_camera)),
        intrinsics: Some(intrinsics_to_wire(&frame.intrinsics)),
        depth: Some(v1::DepthImage {
            encoding: v1::DepthEncoding::F32Metres.into(),
            units_per_metre: 1.0,
            data: metres.into_flattened(),
        }),
        color: frame.color.as_ref().map(|color| v1::ColorImage {
            encoding: v1::ColorEncoding::Rgb8.into(),
            data: color.rgb.clone(),
        }),
        queue_policy: match policy {
            QueuePolicy::Latest => v1::QueuePolicy::Latest.into(),
            QueuePolicy::Block => v1::QueuePolicy::Block.into(),
        },
        meaning: frame.features.as_ref().map(|f| Meaning::Features(features_to_wire(f))),
    }
}

/// The same with labels, where there are some, in the place of features.
pub fn labelled_frame_to_wire(
    map_id: &str,
    frame: &Frame,
    labels: Option<&LabelImage>,
    policy: QueuePolicy,
) -> v1::Frame {
    let mut message = frame_to_wire(map_id, frame, policy);
    if let Some(labels) = labels {
        message.meaning = Some(Meaning::Labels(labels_to_wire(labels)));
    }
    message
}

/// Which frame an ack is about, kept while the frame itself is on its way.
#[derive(Debug, Clone)]
pub struct FrameSummary {
    pub robot_id: Arc<str>,
    pub sensor_id: Arc<str>,
    pub seq: u64,
}

impl From<&v1::Frame> for FrameSummary {
    fn from(message: &v1::Frame) -> Self {
        // A name that is too long is refused; the refusal need not repeat all of it.
        let name = |name: &str| name.chars().take(MAX_NAME_BYTES).collect::<String>().into();
        Self {
            robot_id: name(&message.robot_id),
            sensor_id: name(&message.sensor_id),
            seq: message.seq,
        }
    }
}

/// An ack. Without a verdict it says ACCEPTED. `newest` is the newest published epoch and its stamp.
pub fn ack_to_wire(
    frame: &FrameSummary,
    verdict: Option<&Verdict>,
    newest: (u64, i64),
    queue: &Queue,
    spent: Duration,
) -> v1::FrameAck {
    let mut ack = v1::FrameAck {
        robot_id: frame.robot_id.to_string(),
        sensor_id: frame.sensor_id.to_string(),
        seq: frame.seq,
        status: v1::FrameStatus::Accepted.into(),
        epoch: newest.0,
        newest_stamp_ns: newest.1,
        server_us: spent.as_micros() as u64,
        queue_depth: queue.waiting() as u32,
        queue_capacity: queue.capacity() as u32,
        credit: queue.credit() as u32,
        ..v1::FrameAck::default()
    };
    match verdict {
        None => {}
        Some(Verdict::Integrated { epoch, lapse }) => {
            ack.set_status(v1::FrameStatus::Integrated);
            ack.epoch = *epoch;
            if let Some(reason) = lapse {
                ack.message = format!("not durable: {reason}");
            }
        }
        Some(Verdict::Dropped(reason)) => {
            ack.set_status(v1::FrameStatus::Dropped);
            ack.set_reason(reason_to_wire(*reason));
        }
        Some(Verdict::Rejected(error)) => {
            ack.set_status(v1::FrameStatus::Rejected);
            ack.set_reason(reason_to_wire(Reason::of(error)));
            ack.message = error.to_string();
            ack.field = error.field().unwrap_or_default().to_owned();
        }
    }
    ack
}

fn reason_to_wire(reason: Reason) -> v1::FrameReason {
    match reason {
        Reason::Replaced => v1::FrameReason::Replaced,
        Reason::Stopping => v1::FrameReason::Stopping,
        Reason::Abandoned => v1::FrameReason::Abandoned,
        Reason::InvalidField => v1::FrameReason::InvalidField,
        Reason::UnknownMap => v1::FrameReason::UnknownMap,
        Reason::Exhausted => v1::FrameReason::Exhausted,
        Reason::Internal => v1::FrameReason::Internal,
        Reason::Reset => v1::FrameReason::Reset,
        Reason::PoseNotFinite => v1::FrameReason::PoseNotFinite,
        Reason::PoseNotRigid => v1::FrameReason::PoseNotRigid,
        Reason::SizeMismatch => v1::FrameReason::SizeMismatch,
        Reason::DepthUnit => v1::FrameReason::DepthUnit,
        Reason::Intrinsics => v1::FrameReason::Intrinsics,
        Reason::TooOld => v1::FrameReason::TooOld,
        Reason::OutOfOrder => v1::FrameReason::OutOfOrder,
        Reason::Encoder => v1::FrameReason::Encoder,
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use glam::{DQuat, DVec3};
    use image::{DynamicImage, ImageFormat};
    use proptest::prelude::*;
    use prost::Message;

    use super::*;
    use crate::frame::{Class, ColorImage, Contract, DepthImage, FeatureImage};
    use crate::geometry::{Intrinsics, Pose};

    fn intrinsics(width: u32, height: u32) -> Intrinsics {
        Intrinsics { fx: 50.5, fy: 51.25, cx: 3.0, cy: 2.5, width, height }
    }

    prop_compose! {
        fn frames()(width in 1u32..12, height in 1u32..9)(
            metres in prop::collection::vec(prop_oneof![Just(0.0f32), 0.01f32..10.0],
                (width * height) as usize),
            rgb in prop::option::of(prop::collection::vec(any::<u8>(), (width * height * 3) as usize)),
            names in ("[a-z/]{1,20}", "[a-z0-9_]{1,20}"),
            (seq, stamp_ns) in (any::<u64>(), any::<i64>()),
            axis in prop::array::uniform3(-1.0f64..1.0),
            angle in -3.0f64..3.0,
            translation in prop::array::uniform3(-9000.0f64..9000.0),
            (width, height) in (Just(width), Just(height)),
        ) -> Frame {
            let axis = (DVec3::from(axis) + DVec3::new(2.0, 0.0, 0.0)).normalize();
            Frame {
                robot_id: names.0.into(),
                sensor_id: names.1.into(),
                seq,
                stamp_ns,
                world_from_camera: Pose {
                    rotation: DQuat::from_axis_angle(axis, angle),
                    translation: translation.into(),
                },
                intrinsics: intrinsics(width, height),
                depth: DepthImage { width, height, metres },
                color: rgb.map(|rgb| ColorImage { width, height, rgb }),
                features: None,
            }
        }
    }

    /// Through bytes, as on the wire.
    fn received(message: &v1::Frame) -> Result<IncomingFrame> {
        let bytes = message.encode_to_vec();
        IncomingFrame::try_from(v1::Frame::decode(bytes.as_slice()).expect("our own bytes"))
    }

    proptest! {
        #[test]
        fn a_frame_comes_back_as_it_was(frame in frames(), block in any::<bool>()) {
            let policy = if block { QueuePolicy::Block } else { QueuePolicy::Latest };
            let back = received(&frame_to_wire("default", &frame, policy)).expect("a good frame");
            prop_assert_eq!((back.map_id.as_str(), back.policy), ("default", policy));
            let got = back.frame;
            prop_assert_eq!(
                (&got.robot_id, &got.sensor_id, got.seq, got.stamp_ns),
                (&frame.robot_id, &frame.sensor_id, frame.seq, frame.stamp_ns)
            );
            prop_assert_eq!(got.intrinsics, frame.intrinsics);
            prop_assert_eq!(&got.depth, &frame.depth);
            prop_assert_eq!(&got.color, &frame.color);
            let (a, b) = (got.world_from_camera, frame.world_from_camera);
            prop_assert_eq!(a.translation, b.translation);
            // Reading normalises once more: rounding only.
            prop_assert!((a.rotation - b.rotation).length() < 1e-12);
        }

        /// Raw u16 and PNG say the same depth.
        #[test]
        fn integer_depth_reads_alike_raw_and_compressed(
            frame in frames(),
            seed in any::<u16>(),
            units in prop::sample::select(vec![1000.0f32, 5000.0, 256.0]),
        ) {
            let k = frame.intrinsics;
            let raw: Vec<u16> =
                (0..k.pixels()).map(|i| (i as u16).wrapping_mul(7919).wrapping_add(seed)).collect();
            let mut message = frame_to_wire("default", &frame, QueuePolicy::Latest);
            let depth = message.depth.get_or_insert_default();
            depth.units_per_metre = units;
            depth.set_encoding(v1::DepthEncoding::U16);
            depth.data = raw.iter().flat_map(|d| d.to_le_bytes()).collect();
            let plain = received(&message).expect("u16").frame.depth;
            prop_assert_eq!(&plain, &DepthImage::from_u16(k.width, k.height, &raw, units));

            let image = image::ImageBuffer::from_raw(k.width, k.height, raw).expect("its size");
            let depth = message.depth.get_or_insert_default();
            depth.set_encoding(v1::DepthEncoding::Png16);
            depth.data = compressed(&DynamicImage::ImageLuma16(image), ImageFormat::Png);
            prop_assert_eq!(&plain, &received(&message).expect("png").frame.depth);
        }

        /// Bytes of any kind are a message or an error, never a panic.
        #[test]
        fn noise_is_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(message) = v1::Frame::decode(bytes.as_slice()) {
                prop_assert!(IncomingFrame::try_from(message).is_err(), "noise is no frame");
            }
        }

        /// A good message with damaged bytes is read or refused, never a panic, and what is read
        /// still has the sizes that it claims.
        #[test]
        fn damaged_messages_do_no_harm(
            frame in frames(),
            damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
            cut in any::<prop::sample::Index>(),
            is_cut in any::<bool>(),
        ) {
            let mut bytes = frame_to_wire("default", &frame, QueuePolicy::Latest).encode_to_vec();
            for (place, value) in damage {
                let place = place.index(bytes.len());
                bytes[place] = value;
            }
            if is_cut {
                bytes.truncate(cut.index(bytes.len()));
            }
            if let Ok(message) = v1::Frame::decode(bytes.as_slice())
                && let Ok(incoming) = IncomingFrame::try_from(message)
            {
                let frame = incoming.frame;
                prop_assert_eq!(frame.depth.metres.len(), frame.intrinsics.pixels());
            }
        }
    }

    fn compressed(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).expect("memory");
        bytes.into_inner()
    }

    fn grey_frame() -> Frame {
        Frame {
            robot_id: "robot".into(),
            sensor_id: "camera".into(),
            seq: 1,
            stamp_ns: 2,
            world_from_camera: Pose::IDENTITY,
            intrinsics: intrinsics(8, 6),
            depth: DepthImage { width: 8, height: 6, metres: vec![1.0; 48] },
            color: None,
            features: None,
        }
    }

    #[test]
    fn color_comes_raw_or_compressed() {
        let grey = image::RgbImage::from_pixel(8, 6, image::Rgb([128, 128, 128]));
        for (encoding, data) in [
            (v1::ColorEncoding::Rgb8, grey.as_raw().clone()),
            (v1::ColorEncoding::Png, compressed(&grey.clone().into(), ImageFormat::Png)),
            (v1::ColorEncoding::Jpeg, compressed(&grey.clone().into(), ImageFormat::Jpeg)),
        ] {
            let mut message = frame_to_wire("default", &grey_frame(), QueuePolicy::Latest);
            message.color = Some(v1::ColorImage { encoding: encoding.into(), data });
            let color = received(&message).expect("good").frame.color.expect("color");
            assert_eq!((color.width, color.height), (8, 6));
            // JPEG rounds.
            assert!(color.rgb.iter().all(|c| c.abs_diff(128) <= 1), "{encoding:?}");
        }
    }

    #[test]
    fn compressed_images_of_another_size_or_kind_are_refused() {
        let wide = image::RgbImage::new(9, 6);
        let mut message = frame_to_wire("default", &grey_frame(), QueuePolicy::Latest);
        let data = compressed(&wide.into(), ImageFormat::Png);
        message.color = Some(v1::ColorImage { encoding: v1::ColorEncoding::Png.into(), data });
        let error = received(&message).expect_err("9 wide").to_string();
        assert_eq!(error, "color.data: is 9x6, but intrinsics say 8x6");

        let eight_bit = image::GrayImage::new(8, 6);
        let mut message = frame_to_wire("default", &grey_frame(), QueuePolicy::Latest);
        message.depth = Some(v1::DepthImage {
            encoding: v1::DepthEncoding::Png16.into(),
            units_per_metre: 1000.0,
            data: compressed(&eight_bit.into(), ImageFormat::Png),
        });
        let error = received(&message).expect_err("8 bit").to_string();
        assert!(error.starts_with("depth.data: PNG16 must be 16-bit grey"), "{error}");
    }

    #[test]
    fn a_frame_has_features_or_labels() {
        let contract = Contract { encoder_id: "clip".into(), dimension: 2 };
        let features = FeatureImage {
            contract,
            width: 2,
            height: 1,
            index: None,
            features: vec![1.0, 0.0, 0.5, 0.25],
        };
        let frame = Frame { features: Some(features), ..grey_frame() };
        let message = frame_to_wire("default", &frame, QueuePolicy::Latest);
        let back = received(&message).expect("good");
        assert_eq!((back.frame.features, back.labels), (frame.features.clone(), None));
        let chair = Class { id: 4, name: "chair".into() };
        let ids = vec![4; 48];
        let labels = LabelImage { width: 8, height: 6, ids, classes: [chair].into() };
        let message = labelled_frame_to_wire("default", &frame, Some(&labels), QueuePolicy::Latest);
        let back = received(&message).expect("good");
        assert_eq!((back.frame.features, back.labels), (None, Some(labels)));
    }

    #[test]
    fn acks_say_what_happened() {
        let frame = FrameSummary { robot_id: "robot".into(), sensor_id: "camera".into(), seq: 4 };
        let queue = Queue::new(1, 2);
        let ack = |verdict: Option<&Verdict>| {
            ack_to_wire(&frame, verdict, (8, 99), &queue, Duration::from_micros(7))
        };
        let accepted = ack(None);
        assert_eq!((accepted.status(), accepted.epoch), (v1::FrameStatus::Accepted, 8));
        assert_eq!((accepted.seq, accepted.newest_stamp_ns, accepted.server_us), (4, 99, 7));
        assert_eq!((accepted.queue_depth, accepted.queue_capacity, accepted.credit), (1, 2, 1));
        let integrated = ack(Some(&Verdict::Integrated { epoch: 7, lapse: None }));
        assert_eq!((integrated.status(), integrated.epoch), (v1::FrameStatus::Integrated, 7));
        let lapse = Some("the disk is full".into());
        let lapsed = ack(Some(&Verdict::Integrated { epoch: 7, lapse }));
        assert_eq!(lapsed.message, "not durable: the disk is full");
        assert_eq!(lapsed.status(), integrated.status());
        assert_eq!(integrated.message, "");
        let error = Error::invalid("depth.data", "12 bytes");
        let rejected = ack(Some(&Verdict::Rejected(error)));
        assert_eq!(rejected.status(), v1::FrameStatus::Rejected);
        assert_eq!(
            (rejected.field.as_str(), rejected.message.as_str()),
            ("depth.data", "depth.data: 12 bytes")
        );
        // Every reason has its own number on the wire.
        let mut numbers: Vec<i32> =
            Reason::ALL.map(|r| ack(Some(&Verdict::Dropped(r))).reason).to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), Reason::ALL.len());
        assert!(!numbers.contains(&0));
    }
}
