//! A frame on disk: laid out as `orenx.v1.Frame`, so that any viewer of MCAP can decode it, with what the
//! journal adds to it in fields that the others pass over.
//!
//! A family of types of its own: what changes here takes a new [`super::VERSION`]. A frame comes back to
//! the bit, so that mapping it again gives the same map.

use glam::{DQuat, DVec3};
use prost::Message;

use crate::error::{Error, Result};
use crate::frame::{ColorImage, Contract, DepthImage, FeatureImage, Frame};
use crate::geometry::{Intrinsics, Pose};

/// A frame of a journal.
#[derive(Debug, Clone)]
pub struct Entry {
    /// How many frames of the journal there were before, this one included.
    pub position: u64,
    /// The first epoch that held it.
    pub epoch: u64,
    pub frame: Frame,
}

/// Little-endian f32, as in `DEPTH_ENCODING_F32_METRES`.
const F32_METRES: i32 = 2;
/// As in `COLOR_ENCODING_RGB8`.
const RGB8: i32 = 1;
/// As in `FEATURE_ENCODING_F32`.
const F32: i32 = 2;

#[derive(Clone, PartialEq, Message)]
struct Record {
    #[prost(string, tag = "1")]
    map_id: String,
    #[prost(string, tag = "2")]
    robot_id: String,
    #[prost(string, tag = "3")]
    sensor_id: String,
    #[prost(uint64, tag = "4")]
    seq: u64,
    #[prost(int64, tag = "5")]
    stamp_ns: i64,
    #[prost(message, optional, tag = "6")]
    world_from_camera: Option<PoseRecord>,
    #[prost(message, optional, tag = "7")]
    intrinsics: Option<CameraRecord>,
    #[prost(message, optional, tag = "8")]
    depth: Option<DepthRecord>,
    #[prost(message, optional, tag = "9")]
    color: Option<ColorRecord>,
    #[prost(message, optional, tag = "11")]
    features: Option<FeatureRecord>,
    #[prost(uint64, tag = "1001")]
    position: u64,
    #[prost(uint64, tag = "1002")]
    epoch: u64,
}

#[derive(Clone, Copy, PartialEq, Message)]
struct VectorRecord {
    #[prost(double, tag = "1")]
    x: f64,
    #[prost(double, tag = "2")]
    y: f64,
    #[prost(double, tag = "3")]
    z: f64,
    /// Of rotations alone.
    #[prost(double, tag = "4")]
    w: f64,
}

#[derive(Clone, PartialEq, Message)]
struct PoseRecord {
    #[prost(message, optional, tag = "1")]
    translation: Option<VectorRecord>,
    #[prost(message, optional, tag = "2")]
    rotation: Option<VectorRecord>,
}

#[derive(Clone, PartialEq, Message)]
struct CameraRecord {
    #[prost(double, tag = "1")]
    fx: f64,
    #[prost(double, tag = "2")]
    fy: f64,
    #[prost(double, tag = "3")]
    cx: f64,
    #[prost(double, tag = "4")]
    cy: f64,
    #[prost(uint32, tag = "5")]
    width: u32,
    #[prost(uint32, tag = "6")]
    height: u32,
}

#[derive(Clone, PartialEq, Message)]
struct DepthRecord {
    #[prost(int32, tag = "1")]
    encoding: i32,
    #[prost(float, tag = "2")]
    units_per_metre: f32,
    #[prost(bytes = "vec", tag = "3")]
    data: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct ColorRecord {
    #[prost(int32, tag = "1")]
    encoding: i32,
    #[prost(bytes = "vec", tag = "2")]
    data: Vec<u8>,
    /// Where its size is not that of the depth image; passed over by others.
    #[prost(uint32, tag = "1001")]
    width: u32,
    #[prost(uint32, tag = "1002")]
    height: u32,
}

#[derive(Clone, PartialEq, Message)]
struct FeatureRecord {
    #[prost(string, tag = "1")]
    encoder_id: String,
    #[prost(uint32, tag = "2")]
    height: u32,
    #[prost(uint32, tag = "3")]
    width: u32,
    #[prost(uint32, tag = "4")]
    dimension: u32,
    #[prost(int32, tag = "5")]
    encoding: i32,
    #[prost(bytes = "vec", tag = "6")]
    data: Vec<u8>,
    #[prost(bytes = "vec", tag = "7")]
    index: Vec<u8>,
}

/// The bytes of an entry.
pub(super) fn encode(map_id: &str, entry: &Entry) -> Vec<u8> {
    let Entry { position, epoch, frame } = entry;
    let (t, q, k) = {
        let pose = &frame.world_from_camera;
        (pose.translation, pose.rotation, &frame.intrinsics)
    };
    let record = Record {
        map_id: map_id.into(),
        robot_id: frame.robot_id.to_string(),
        sensor_id: frame.sensor_id.to_string(),
        seq: frame.seq,
        stamp_ns: frame.stamp_ns,
        world_from_camera: Some(PoseRecord {
            translation: Some(VectorRecord { x: t.x, y: t.y, z: t.z, w: 0.0 }),
            rotation: Some(VectorRecord { x: q.x, y: q.y, z: q.z, w: q.w }),
        }),
        intrinsics: Some(CameraRecord {
            fx: k.fx,
            fy: k.fy,
            cx: k.cx,
            cy: k.cy,
            width: k.width,
            height: k.height,
        }),
        depth: Some(DepthRecord {
            encoding: F32_METRES,
            units_per_metre: 1.0,
            data: bytemuck::cast_slice(&frame.depth.metres).to_vec(),
        }),
        color: frame.color.as_ref().map(|color| ColorRecord {
            encoding: RGB8,
            data: color.rgb.clone(),
            width: color.width,
            height: color.height,
        }),
        features: frame.features.as_ref().map(|features| FeatureRecord {
            encoder_id: features.contract.encoder_id.to_string(),
            height: features.height,
            width: features.width,
            dimension: features.contract.dimension as u32,
            encoding: F32,
            data: bytemuck::cast_slice(&features.features).to_vec(),
            index: features.index.as_deref().map_or(&[][..], bytemuck::cast_slice).to_vec(),
        }),
        position: *position,
        epoch: *epoch,
    };
    record.encode_to_vec()
}

/// The entry of these bytes. Sizes are those that it claims; the rest is for [`Frame::check`].
pub(super) fn decode(bytes: &[u8]) -> Result<Entry> {
    let wrong = |problem: String| Error::corrupt("a frame of the journal", problem);
    let record = Record::decode(bytes).map_err(|error| wrong(error.to_string()))?;
    let missing = |part: &str| wrong(format!("{part} is missing"));
    let pose = record.world_from_camera.ok_or_else(|| missing("its pose"))?;
    let t = pose.translation.ok_or_else(|| missing("its translation"))?;
    let q = pose.rotation.ok_or_else(|| missing("its rotation"))?;
    let k = record.intrinsics.ok_or_else(|| missing("its camera"))?;
    let depth = record.depth.ok_or_else(|| missing("its depth"))?;
    let encodings = [
        depth.encoding == F32_METRES,
        record.color.as_ref().is_none_or(|color| color.encoding == RGB8),
        record.features.as_ref().is_none_or(|features| features.encoding == F32),
    ];
    if encodings != [true; 3] {
        return Err(wrong("an encoding is none of the journal's".into()));
    }
    let frame = Frame {
        robot_id: record.robot_id.into(),
        sensor_id: record.sensor_id.into(),
        seq: record.seq,
        stamp_ns: record.stamp_ns,
        world_from_camera: Pose {
            rotation: DQuat::from_xyzw(q.x, q.y, q.z, q.w),
            translation: DVec3::new(t.x, t.y, t.z),
        },
        intrinsics: Intrinsics {
            fx: k.fx,
            fy: k.fy,
            cx: k.cx,
            cy: k.cy,
            width: k.width,
            height: k.height,
        },
        depth: DepthImage {
            width: k.width,
            height: k.height,
            metres: numbers(&depth.data).ok_or_else(|| wrong("its depth is cut".into()))?,
        },
        color: record.color.map(|color| ColorImage {
            width: color.width,
            height: color.height,
            rgb: color.data,
        }),
        features: record.features.map(features_of).transpose()?,
    };
    Ok(Entry { position: record.position, epoch: record.epoch, frame })
}

fn features_of(record: FeatureRecord) -> Result<FeatureImage> {
    let cut = || Error::corrupt("a frame of the journal", "its features are cut");
    let index = numbers(&record.index).ok_or_else(cut)?;
    Ok(FeatureImage {
        contract: Contract {
            encoder_id: record.encoder_id.into(),
            dimension: record.dimension as usize,
        },
        width: record.width,
        height: record.height,
        index: (!index.is_empty()).then_some(index),
        features: numbers(&record.data).ok_or_else(cut)?,
    })
}

fn numbers<T: bytemuck::AnyBitPattern>(bytes: &[u8]) -> Option<Vec<T>> {
    let size = size_of::<T>();
    let whole = bytes.len().is_multiple_of(size);
    whole.then(|| bytes.chunks_exact(size).map(bytemuck::pod_read_unaligned).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;

    #[test]
    fn a_frame_comes_back_to_the_bit() {
        let mut frame = Synthetic::room(100).with_width(32).load(7, true).expect("a frame");
        let contract = Contract { encoder_id: "clip".into(), dimension: 2 };
        frame.features = Some(FeatureImage {
            contract,
            width: 2,
            height: 1,
            index: Some(vec![1, 0]),
            features: vec![0.5, -0.25, 1.0, 0.0],
        });
        let entry = Entry { position: 3, epoch: 2, frame };
        let back = decode(&encode("default", &entry)).expect("our own");
        assert_eq!(format!("{back:?}"), format!("{entry:?}"));
        frame_without_extras(entry);
    }

    fn frame_without_extras(mut entry: Entry) {
        (entry.frame.color, entry.frame.features) = (None, None);
        let back = decode(&encode("default", &entry)).expect("our own");
        assert_eq!(format!("{back:?}"), format!("{entry:?}"));
        assert!(decode(&[]).is_err(), "nothing is no frame");
    }
}
