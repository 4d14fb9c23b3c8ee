//! Frames with one field wrong in turn.

use orenx::engine::Reason;
use orenx::service::DEFAULT_MAP;
use orenx::wire::v1;
use orenx::wire::v1::frame::Meaning;
use orenx::wire::v1::{DepthEncoding, FrameReason, FrameStatus};

use super::super::{good_frame, open_stream, start, verdict};
use super::well;

/// What is wrong with a frame, and the reason, the field and the words of its refusal.
type Fault = (&'static str, fn(&mut v1::Frame), FrameReason, &'static str, &'static str);

fn depth(frame: &mut v1::Frame) -> &mut v1::DepthImage {
    frame.depth.as_mut().unwrap()
}

fn camera(frame: &mut v1::Frame) -> &mut v1::Intrinsics {
    frame.intrinsics.as_mut().unwrap()
}

fn pose(frame: &mut v1::Frame) -> &mut v1::Pose {
    frame.world_from_camera.as_mut().unwrap()
}

fn position(frame: &mut v1::Frame) -> &mut v1::Vector3 {
    pose(frame).translation.as_mut().unwrap()
}

fn rotation(frame: &mut v1::Frame) -> &mut v1::Quaternion {
    pose(frame).rotation.as_mut().unwrap()
}

/// The frame's own depth, in other units.
fn in_units(frame: &mut v1::Frame, scale: f32) {
    let data = &mut depth(frame).data;
    let metres = data.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
    *data = metres.flat_map(|z| (z * scale).to_le_bytes()).collect();
}

/// The frame's own depth in millimetres, as whole numbers that are said to be in other units.
fn as_u16(frame: &mut v1::Frame, units_per_metre: f32) {
    let depth = depth(frame);
    let metres = depth.data.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
    depth.data = metres.flat_map(|z| ((z * 1000.0) as u16).to_le_bytes()).collect();
    depth.set_encoding(DepthEncoding::U16);
    depth.units_per_metre = units_per_metre;
}

/// Two patches of two numbers.
fn patches() -> v1::FeatureImage {
    v1::FeatureImage {
        encoder_id: "clip".into(),
        height: 1,
        width: 2,
        dimension: 2,
        encoding: v1::FeatureEncoding::F32.into(),
        data: vec![0; 16],
        index: Vec::new(),
    }
}

const FAULTS: &[Fault] = {
    use FrameReason::{
        DepthUnit, Intrinsics, InvalidField, PoseNotFinite, PoseNotRigid, SizeMismatch, UnknownMap,
    };
    const TRANSLATION: &str = "world_from_camera.translation";
    const ROTATION: &str = "world_from_camera.rotation";
    const SIZE: &str = "intrinsics.width/height";
    const UNITS: &str = "depth.units_per_metre";
    &[
        ("no map", |f| f.map_id.clear(), InvalidField, "map_id", "default"),
        ("another map", |f| f.map_id = "attic".into(), UnknownMap, "", "attic"),
        ("no robot", |f| f.robot_id.clear(), InvalidField, "robot_id", "1..=128"),
        ("no sensor", |f| f.sensor_id.clear(), InvalidField, "sensor_id", "1..=128"),
        ("a long name", |f| f.sensor_id = "x".repeat(129), InvalidField, "sensor_id", "129"),
        ("a policy of its own", |f| f.queue_policy = 9, InvalidField, "queue_policy", "9"),
        ("no pose", |f| f.world_from_camera = None, InvalidField, "world_from_camera", "required"),
        ("no translation", |f| pose(f).translation = None, InvalidField, TRANSLATION, "required"),
        ("no rotation", |f| pose(f).rotation = None, InvalidField, ROTATION, "required"),
        (
            "a place that is no number",
            |f| position(f).y = f64::NAN,
            PoseNotFinite,
            TRANSLATION,
            "finite",
        ),
        (
            "a rotation that is no number",
            |f| rotation(f).z = f64::INFINITY,
            PoseNotFinite,
            ROTATION,
            "finite",
        ),
        ("a place out of the lattice", |f| position(f).z = 1e7, InvalidField, TRANSLATION, "10000"),
        (
            "a rotation of length 2",
            |f| *rotation(f) = v1::Quaternion { w: 2.0, ..Default::default() },
            PoseNotRigid,
            ROTATION,
            "0.01",
        ),
        (
            "a rotation of length 0",
            |f| *rotation(f) = v1::Quaternion::default(),
            PoseNotRigid,
            ROTATION,
            "0.01",
        ),
        ("no intrinsics", |f| f.intrinsics = None, InvalidField, "intrinsics", "required"),
        ("no width", |f| camera(f).width = 0, Intrinsics, SIZE, "8192"),
        (
            "more pixels than memory",
            |f| (camera(f).width, camera(f).height) = (8192, 8192),
            Intrinsics,
            SIZE,
            "16777216",
        ),
        ("another size", |f| camera(f).width = 32, SizeMismatch, "depth.data", "32x48"),
        ("no focal length", |f| camera(f).fx = 0.0, Intrinsics, "intrinsics.fx", "3.2..=1280.0"),
        (
            "millimetres of focal length",
            |f| camera(f).fy = 1.9,
            Intrinsics,
            "intrinsics.fy",
            "2.4..=960.0",
        ),
        (
            "no number of focal length",
            |f| camera(f).fy = f64::NAN,
            Intrinsics,
            "intrinsics.fy",
            "NaN",
        ),
        ("a centre outside", |f| camera(f).cx = 64.0, Intrinsics, "intrinsics.cx", "-0.5..=63.5"),
        (
            "a centre far outside",
            |f| camera(f).cy = 1e4,
            Intrinsics,
            "intrinsics.cy",
            "-0.5..=47.5",
        ),
        ("no depth", |f| f.depth = None, InvalidField, "depth", "required"),
        ("no encoding", |f| depth(f).encoding = 0, InvalidField, "depth.encoding", "PNG16"),
        (
            "an encoding of its own",
            |f| depth(f).encoding = 12,
            InvalidField,
            "depth.encoding",
            "12",
        ),
        (
            "half an image",
            |f| depth(f).data.truncate(12),
            SizeMismatch,
            "depth.data",
            "12 bytes, but 64x48 f32 needs 12288",
        ),
        ("no unit", |f| as_u16(f, 0.0), InvalidField, UNITS, "1000 for millimetres"),
        ("a unit that is no number", |f| as_u16(f, f32::NAN), InvalidField, UNITS, "NaN"),
        (
            "metres in millimetres",
            |f| depth(f).units_per_metre = 1000.0,
            InvalidField,
            UNITS,
            "metres",
        ),
        ("millimetres as metres", |f| in_units(f, 1000.0), DepthUnit, "depth.data", "beyond 100 m"),
        ("kilometres as metres", |f| in_units(f, 0.001), DepthUnit, "depth.data", "within 0.01 m"),
        ("whole millimetres as metres", |f| as_u16(f, 1.0), DepthUnit, UNITS, "beyond 100 m"),
        ("whole millimetres as micrometres", |f| as_u16(f, 1e6), DepthUnit, UNITS, "within 0.01 m"),
        (
            "no PNG",
            |f| {
                depth(f).set_encoding(DepthEncoding::Png16);
                depth(f).units_per_metre = 1000.0;
            },
            InvalidField,
            "depth.data",
            "Png",
        ),
        (
            "half a color image",
            |f| {
                let encoding = v1::ColorEncoding::Rgb8.into();
                f.color = Some(v1::ColorImage { encoding, data: vec![0; 10] });
            },
            SizeMismatch,
            "color.data",
            "needs 9216",
        ),
        (
            "color of no kind",
            |f| f.color = Some(v1::ColorImage::default()),
            InvalidField,
            "color.encoding",
            "JPEG",
        ),
        (
            "features of no encoder",
            |f| f.meaning = Some(Meaning::Features(v1::FeatureImage::default())),
            InvalidField,
            "features.encoder_id",
            "1 to 256 bytes",
        ),
        (
            "fewer features than patches",
            |f| {
                f.meaning =
                    Some(Meaning::Features(v1::FeatureImage { data: vec![0; 8], ..patches() }))
            },
            SizeMismatch,
            "features.data",
            "8 bytes, but the features need 16",
        ),
        (
            "a feature that is no number",
            |f| {
                let data = [1.0, 2.0, f32::NAN, 0.0].map(f32::to_le_bytes).concat();
                f.meaning = Some(Meaning::Features(v1::FeatureImage { data, ..patches() }));
            },
            InvalidField,
            "features.data[2]",
            "finite",
        ),
        (
            "half an image of labels",
            |f| {
                let encoding = v1::LabelEncoding::U8.into();
                let data = vec![0; 10];
                f.meaning =
                    Some(Meaning::Labels(v1::LabelImage { encoding, data, ..Default::default() }));
            },
            SizeMismatch,
            "labels.data",
            "need 3072",
        ),
        (
            "labels of no kind",
            |f| f.meaning = Some(Meaning::Labels(v1::LabelImage::default())),
            InvalidField,
            "labels.encoding",
            "U8, U16, PNG",
        ),
    ]
};

#[tokio::test(flavor = "multi_thread")]
async fn each_is_refused_by_name_and_counted() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for (seq, (what, spoil, reason, field, message)) in (0..).zip(FAULTS) {
        let before = well(&server).await;
        let mut frame = good_frame(seq);
        spoil(&mut frame);
        frames.send(frame).await.unwrap();
        let ack = acks.message().await.unwrap().expect("an ack");
        assert_eq!((ack.seq, ack.status()), (seq, FrameStatus::Rejected), "{what}");
        assert_eq!((ack.reason(), ack.field.as_str()), (*reason, *field), "{what}: {ack:?}");
        assert!(ack.message.contains(message), "{what}: {}", ack.message);
        assert_eq!(ack.epoch, 0, "{what}");

        let name = reason.as_str_name().trim_start_matches("FRAME_REASON_").to_lowercase();
        let reason = Reason::ALL.into_iter().find(|r| r.name() == name).expect("the same names");
        let of = |counts: &[(Reason, u64)]| {
            counts.iter().find(|(r, _)| *r == reason).map_or(0, |(_, count)| *count)
        };
        let after = well(&server).await;
        assert_eq!(after.received, before.received + 1, "{what}");
        assert_eq!(of(&after.rejected), of(&before.rejected) + 1, "{what}");
        assert_eq!((after.integrated, after.waiting), (0, 0), "{what}");
    }
    frames.send(good_frame(99)).await.unwrap();
    let ack = verdict(&mut acks).await;
    assert_eq!((ack.seq, ack.status(), ack.epoch), (99, FrameStatus::Integrated, 1));
    server.stop().await.0.unwrap();
}

/// Small errors of a rotation are no fault: real recordings have them.
#[tokio::test(flavor = "multi_thread")]
async fn a_rotation_that_is_off_by_rounding_is_taken() {
    let server = start(|_| {}).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    let mut frame = good_frame(0);
    let v1::Quaternion { x, y, z, w } = rotation(&mut frame);
    for number in [x, y, z, w] {
        *number *= 1.004;
    }
    frames.send(frame).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    server.stop().await.0.unwrap();
}

/// The file of a map that saw a few good frames, and between them every bad one if `with_bad`.
async fn map_file(with_bad: bool) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let server = start(|settings| settings.storage.path = folder.path().into()).await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    for (round, index) in [0, 30, 60].into_iter().enumerate() {
        let mut good = good_frame(index);
        good.seq = 1000 * (round as u64 + 1);
        frames.send(good.clone()).await.unwrap();
        assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
        if !with_bad {
            continue;
        }
        for (seq, (what, spoil, ..)) in (good.seq + 1..).zip(FAULTS) {
            let mut bad = good.clone();
            bad.seq = seq;
            spoil(&mut bad);
            frames.send(bad).await.unwrap();
            assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Rejected, "{what}");
        }
        for (seq, stamp_ns) in
            [(good.seq, good.stamp_ns), (good.seq + 1, good.stamp_ns - (3 << 32))]
        {
            frames.send(v1::Frame { seq, stamp_ns, ..good.clone() }).await.unwrap();
            assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Rejected);
        }
    }
    drop((frames, acks));
    let (served, saved) = server.stop().await;
    served.unwrap();
    saved.unwrap();
    std::fs::read(folder.path().join(DEFAULT_MAP).join("map.orenx")).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn refused_frames_leave_no_trace_in_the_map() {
    let (clean, tried) = (map_file(false).await, map_file(true).await);
    assert!(clean.len() > 10_000);
    assert!(clean == tried, "{} and {} bytes", clean.len(), tried.len());
}
