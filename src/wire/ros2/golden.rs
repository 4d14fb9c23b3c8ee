//! Every message and attachment against bytes that a script wrote from the specifications
//! (tests/data/ros2/make.py), in both directions.

use std::path::Path;

use proptest::prelude::*;
use serde::Deserialize;

use super::*;

fn golden(name: &str) -> Vec<u8> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/ros2");
    std::fs::read(folder.join(format!("{name}.bin"))).expect(name)
}

fn header(frame_id: &str) -> Header {
    let stamp = Time { sec: 1_700_000_000, nanosec: 123_456_789 };
    Header { stamp, frame_id: frame_id.into() }
}

/// Both orders of bytes are read as `message`, which is written as the little one; cut or longer
/// payloads are refused.
fn check<'a, M>(little: &'a [u8], big: &'a [u8], message: &M)
where
    M: Message + Deserialize<'a> + PartialEq + std::fmt::Debug,
{
    let name = M::TYPE.name;
    assert_eq!(&decode::<M>(little).expect(name), message);
    assert_eq!(&decode::<M>(big).expect(name), message);
    assert_eq!(encode(message).expect(name), little, "{name}");
    for end in 0..little.len() {
        let error = decode::<M>(&little[..end]).expect_err(name);
        assert_eq!(error.field(), Some(name), "{end}: {error}");
    }
}

macro_rules! check {
    ($name:literal, $message:expr) => {
        let (little, big) = (golden(concat!($name, ".le")), golden(concat!($name, ".be")));
        check(&little, &big, &$message);
    };
}

fn numbers<const N: usize>() -> [u8; N] {
    std::array::from_fn(|i| i as u8)
}

fn turned() -> Quaternion {
    Quaternion { x: 0.0, y: 0.0, z: 0.6, w: 0.8 }
}

fn transform(parent: &str, child: &str) -> TransformStamped {
    let translation = Vector3 { x: 1.5, y: -2.25, z: 0.125 };
    let transform = Transform { translation, rotation: turned() };
    TransformStamped { header: header(parent), child_frame_id: child.into(), transform }
}

#[test]
fn what_comes_in_is_as_the_specification_has_it() {
    check!("text", Text { data: "a chair by the window".into() });
    check!(
        "image",
        Image {
            header: header("camera"),
            height: 2,
            width: 3,
            encoding: "16UC1".into(),
            is_bigendian: 0,
            step: 6,
            data: &numbers::<12>(),
        }
    );
    check!(
        "compressed_image",
        CompressedImage {
            header: header("front"),
            format: "jpeg".into(),
            data: b"\xff\xd8\xff\xe0orenx",
        }
    );
    check!(
        "camera_info",
        CameraInfo {
            header: header("camera"),
            height: 480,
            width: 640,
            distortion_model: "plumb_bob".into(),
            d: vec![0.125, -0.25, 0.0, 0.001, 0.5],
            k: [600.5, 0.0, 320.25, 0.0, 601.5, 240.75, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [599.0, 0.0, 321.0, 0.0, 0.0, 598.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            binning_x: 1,
            binning_y: 1,
            roi: RegionOfInterest {
                x_offset: 2,
                y_offset: 4,
                height: 476,
                width: 636,
                do_rectify: true,
            },
        }
    );
    let position = Point { x: 1.5, y: -2.25, z: 0.125 };
    let pose = PoseMessage { position, orientation: turned() };
    check!("pose_stamped", PoseStamped { header: header("map"), pose });
    check!("transform_stamped", transform("map", "base_link"));
    let transforms = vec![transform("map", "base_link"), transform("base_link", "camera_optical")];
    check!("tf_message", TfMessage { transforms });
}

#[test]
fn what_goes_out_is_as_the_specification_has_it() {
    check!(
        "point_cloud",
        PointCloud2 {
            header: header("map"),
            height: 1,
            width: 2,
            fields: vec![
                PointField::float("x", 0),
                PointField::float("y", 4),
                PointField::float("z", 8),
                PointField::word("rgb", 12),
            ],
            is_bigendian: false,
            point_step: 16,
            row_step: 32,
            data: &numbers::<32>(),
            is_dense: true,
        }
    );
    let origin = Point { x: -1.5, y: 2.5, z: 0.25 };
    check!(
        "occupancy_grid",
        OccupancyGrid {
            header: header("map"),
            info: MapMetaData {
                map_load_time: Time { sec: 1_600_000_000, nanosec: 5 },
                resolution: 0.05,
                width: 3,
                height: 2,
                origin: PoseMessage { position: origin, orientation: Quaternion::default() },
            },
            data: &[255, 0, 50, 100, 1, 255],
        }
    );
    check!(
        "distance_slice",
        DistanceMapSlice {
            header: header("map"),
            resolution: 0.05,
            width: 2,
            height: 2,
            origin,
            unknown_value: -1000.0,
            data: vec![0.5, -0.125, -1000.0, 2.0],
        }
    );
}

#[test]
fn services_are_as_their_definitions_have_them() {
    let (min, size) = (Point { x: -1.0, y: -2.0, z: 0.25 }, Vector3 { x: 2.0, y: 1.5, z: 1.0 });
    check!(
        "esdf_request",
        EsdfRequest {
            update_esdf: true,
            visualize_esdf: false,
            use_aabb: true,
            frame_id: "map".into(),
            aabb_min_m: min,
            aabb_size_m: size,
            aabbs_to_clear_min_m: vec![Point { x: 0.5, y: 0.5, z: 0.5 }],
            aabbs_to_clear_size_m: vec![Vector3 { x: 0.1, y: 0.2, z: 0.3 }],
            spheres_to_clear_center_m: vec![Point { x: 3.0, y: 2.0, z: 1.0 }],
            spheres_to_clear_radius_m: vec![0.125],
        }
    );
    let dimension =
        |label: &str, size, stride| ArrayDimension { label: label.into(), size, stride };
    let dim = vec![dimension("x", 1, 4), dimension("y", 2, 4), dimension("z", 2, 2)];
    let layout = ArrayLayout { dim, data_offset: 0 };
    check!(
        "esdf_response",
        EsdfResponse {
            header: header("map"),
            origin_m: min,
            voxel_size_m: 0.05,
            esdf_and_gradients: FloatArray { layout, data: vec![0.5, -0.125, -1000.0, 2.0] },
            success: true,
        }
    );
}

#[test]
fn attachments_are_read_in_both_forms_and_written_in_the_new_one() {
    let expected = Attachment {
        sequence_number: 42,
        source_stamp_ns: 1_700_000_000_123_456_789,
        gid: std::array::from_fn(|i| 16 + i as u8),
    };
    let (new, old) = (golden("attachment"), golden("attachment.named"));
    assert_eq!((new.len(), old.len()), (ATTACHMENT_BYTES, 77));
    assert_eq!(Attachment::from_bytes(&new).expect("new"), expected);
    assert_eq!(Attachment::from_bytes(&old).expect("old"), expected);
    assert_eq!(expected.to_bytes()[..], new);
    // The published hash of nothing, low half first.
    let low_then_high = 0x99aa_06d3_0147_98d8_6001_c324_468d_497f_u128;
    assert_eq!(gid_of(""), low_then_high.to_le_bytes());
}

#[test]
fn other_headers_and_longer_payloads_are_refused() {
    let text = golden("text.le");
    let refused = |payload: &[u8]| decode::<Text>(payload).expect_err("wrong").to_string();
    assert!(refused(&[]).contains("no CDR header"));
    for header in [[0, 3], [0, 7], [1, 0]] {
        let error = refused(&[&header[..], &text[2..]].concat());
        assert!(error.contains("neither CDR_LE nor CDR_BE"), "{error}");
    }
    decode::<Text>(&[&text[..], &[0; 3]].concat()).expect("filled up");
    assert!(refused(&[&text[..], &[0; 8]].concat()).contains("8 bytes follow its end"));
    // A length that nothing could hold.
    let endless = [&text[..4], &[0xff; 4], &text[8..]].concat();
    assert!(refused(&endless).contains("end of input"));
}

/// Reads a payload as everything that comes in, up to what a map is given.
fn read_as_all(payload: &[u8]) {
    if let Ok(image) = decode::<Image<'_>>(payload) {
        let _ = (depth_from_image(&image), color_from_image(&image));
    }
    if let Ok(image) = decode::<CompressedImage<'_>>(payload) {
        let _ = (depth_from_compressed(&image), color_from_compressed(&image));
    }
    if let Ok(info) = decode::<CameraInfo>(payload) {
        let _ = (intrinsics_from_info(&info, true), intrinsics_from_info(&info, false));
    }
    if let Ok(pose) = decode::<PoseStamped>(payload) {
        let _ = pose_from_message(&pose);
    }
    if let Ok(message) = decode::<TfMessage>(payload) {
        message.transforms.iter().for_each(|t| drop(transform_from_message(t)));
    }
    let _ = (decode::<Text>(payload), decode::<PointCloud2<'_>>(payload));
    let _ = decode::<EsdfRequest>(payload);
}

proptest! {
    /// Bytes of any kind are a message or an error, never a panic.
    #[test]
    fn damage_does_no_harm(
        which in 0usize..7,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
        cut in any::<prop::sample::Index>(),
    ) {
        let names = [
            "image", "compressed_image", "camera_info", "pose_stamped", "tf_message", "text",
            "esdf_request",
        ];
        let mut payload = golden(&format!("{}.le", names[which]));
        for (place, value) in damage {
            let place = place.index(payload.len());
            payload[place] = value;
        }
        read_as_all(&payload);
        payload.truncate(cut.index(payload.len()));
        read_as_all(&payload);
    }

    #[test]
    fn noise_does_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..300), big in any::<bool>()) {
        read_as_all(&[&[0, u8::from(!big), 0, 0], &bytes[..]].concat());
    }

    #[test]
    fn stamps_come_back(ns in -1_000_000_000_000i64..2_000_000_000_000_000_000) {
        let time = Time::from_ns(ns);
        prop_assert!(time.nanosec < 1_000_000_000);
        prop_assert_eq!(time.to_ns(), ns);
    }
}
