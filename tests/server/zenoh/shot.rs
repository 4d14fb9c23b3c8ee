//! What a camera driver and a localisation publish of a frame of a small room.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::frame::{DepthImage, Frame};
use orenx::wire::ros2::{
    CameraInfo, Header, Image, Quaternion, RegionOfInterest, Time, Transform, TransformStamped,
    Vector3,
};

/// What a camera driver publishes of one frame.
pub(super) struct Shot {
    pub(super) frame: Frame,
    millimetres: Vec<u16>,
}

impl Shot {
    /// A frame of a small room, its depth in whole millimetres.
    pub(super) fn of(index: usize) -> Self {
        let room = Synthetic::room(100).with_width(64);
        let mut frame = room.load(3 * index, true).unwrap();
        frame.seq = index as u64 + 1;
        frame.robot_id = "bot".into();
        frame.sensor_id = "front".into();
        let millimetres: Vec<u16> =
            frame.depth.metres.iter().map(|z| (z * 1000.0).round() as u16).collect();
        let (width, height) = (frame.depth.width, frame.depth.height);
        frame.depth = DepthImage::from_u16(width, height, &millimetres, 1000.0);
        Self { frame, millimetres }
    }

    pub(super) fn header(&self, frame_id: &str) -> Header {
        Header { stamp: Time::from_ns(self.frame.stamp_ns), frame_id: frame_id.into() }
    }

    pub(super) fn info(&self) -> CameraInfo {
        let k = &self.frame.intrinsics;
        CameraInfo {
            header: self.header("camera"),
            height: k.height,
            width: k.width,
            distortion_model: "plumb_bob".into(),
            d: vec![0.0; 5],
            k: [k.fx, 0.0, k.cx, 0.0, k.fy, k.cy, 0.0, 0.0, 1.0],
            r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            p: [k.fx, 0.0, k.cx, 0.0, 0.0, k.fy, k.cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            binning_x: 0,
            binning_y: 0,
            roi: RegionOfInterest::default(),
        }
    }

    pub(super) fn rotation(&self) -> Quaternion {
        let q = self.frame.world_from_camera.rotation;
        Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }
    }

    pub(super) fn transform(&self, child: &str) -> TransformStamped {
        let t = self.frame.world_from_camera.translation;
        let translation = Vector3 { x: t.x, y: t.y, z: t.z };
        let transform = Transform { translation, rotation: self.rotation() };
        TransformStamped { header: self.header("map"), child_frame_id: child.into(), transform }
    }

    pub(super) fn color(&self) -> Image<'_> {
        let color = self.frame.color.as_ref().unwrap();
        Image {
            header: self.header("camera"),
            height: color.height,
            width: color.width,
            encoding: "rgb8".into(),
            is_bigendian: 0,
            step: 3 * color.width,
            data: &color.rgb,
        }
    }

    /// PNG behind its header.
    pub(super) fn compressed(&self) -> Vec<u8> {
        let (width, height) = (self.frame.depth.width, self.frame.depth.height);
        let grey = image::ImageBuffer::from_raw(width, height, self.millimetres.clone());
        let mut data = Cursor::new(vec![0; 12]);
        data.set_position(12);
        DynamicImage::ImageLuma16(grey.unwrap()).write_to(&mut data, ImageFormat::Png).unwrap();
        data.into_inner()
    }

    pub(super) fn depth<'a>(&self, bytes: &'a mut Vec<u8>) -> Image<'a> {
        bytes.extend(self.millimetres.iter().flat_map(|d| d.to_le_bytes()));
        let (width, height) = (self.frame.depth.width, self.frame.depth.height);
        Image {
            header: self.header("camera"),
            height,
            width,
            encoding: "16UC1".into(),
            is_bigendian: 0,
            step: 2 * width,
            data: bytes,
        }
    }
}
