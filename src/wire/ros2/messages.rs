//! The messages that are read or written, field by field as their definitions have them, in the order
//! that CDR writes them. Large arrays of bytes are borrowed from the payload.

use serde::{Deserialize, Serialize};

use super::types::{Message, Type};

macro_rules! messages {
    ($($(#[$doc:meta])* $name:ident $(<$lifetime:lifetime>)? = $constant:ident {
        $($(#[$attribute:meta])* $field:ident: $kind:ty,)*
    })*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        pub struct $name $(<$lifetime>)? {
            $($(#[$attribute])* pub $field: $kind,)*
        }

        impl $(<$lifetime>)? Message for $name $(<$lifetime>)? {
            const TYPE: Type = Type::$constant;
        }
    )*};
}

/// `builtin_interfaces/Time`: Unix seconds, rounded down, and nanoseconds on top of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Time {
    pub sec: i32,
    pub nanosec: u32,
}

impl Time {
    pub fn to_ns(self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }

    /// What does not fit (after 2038) is the last second that does.
    pub fn from_ns(ns: i64) -> Self {
        let sec = i32::try_from(ns.div_euclid(1_000_000_000)).unwrap_or(i32::MAX);
        // A remainder below 10⁹ fits.
        Self { sec, nanosec: ns.rem_euclid(1_000_000_000) as u32 }
    }
}

/// `std_msgs/Header`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Header {
    pub stamp: Time,
    pub frame_id: String,
}

/// `geometry_msgs/Point`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Point {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/Vector3`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Vector3 {
    pub x: f64,
    pub y: f64,
    pub z: f64,
}

/// `geometry_msgs/Quaternion`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

/// `geometry_msgs/Pose`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseMessage {
    pub position: Point,
    pub orientation: Quaternion,
}

/// `geometry_msgs/Transform`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Transform {
    pub translation: Vector3,
    pub rotation: Quaternion,
}

/// `sensor_msgs/RegionOfInterest`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct RegionOfInterest {
    pub x_offset: u32,
    pub y_offset: u32,
    pub height: u32,
    pub width: u32,
    pub do_rectify: bool,
}

/// `sensor_msgs/PointField`: one number of a point.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointField {
    pub name: String,
    pub offset: u32,
    pub datatype: u8,
    pub count: u32,
}

impl PointField {
    const UINT32: u8 = 6;
    const FLOAT32: u8 = 7;

    /// One f32.
    pub fn float(name: &str, offset: u32) -> Self {
        Self { name: name.into(), offset, datatype: Self::FLOAT32, count: 1 }
    }

    /// One u32.
    pub fn word(name: &str, offset: u32) -> Self {
        Self { name: name.into(), offset, datatype: Self::UINT32, count: 1 }
    }
}

/// `nav_msgs/MapMetaData`; the origin is the low corner of the low cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapMetaData {
    pub map_load_time: Time,
    pub resolution: f32,
    pub width: u32,
    pub height: u32,
    pub origin: PoseMessage,
}

/// `std_msgs/MultiArrayDimension`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ArrayDimension {
    pub label: String,
    pub size: u32,
    /// Numbers from one index of this dimension to the next, times its size.
    pub stride: u32,
}

/// `std_msgs/MultiArrayLayout`.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ArrayLayout {
    pub dim: Vec<ArrayDimension>,
    pub data_offset: u32,
}

/// `std_msgs/Float32MultiArray`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct FloatArray {
    pub layout: ArrayLayout,
    pub data: Vec<f32>,
}

messages! {
    /// `std_msgs/String`.
    Text = STRING {
        data: String,
    }

    /// `sensor_msgs/Image`; a row takes `step` bytes.
    Image<'a> = IMAGE {
        header: Header,
        height: u32,
        width: u32,
        encoding: String,
        is_bigendian: u8,
        step: u32,
        #[serde(with = "serde_bytes", borrow)]
        data: &'a [u8],
    }

    /// `sensor_msgs/CompressedImage`.
    CompressedImage<'a> = COMPRESSED_IMAGE {
        header: Header,
        format: String,
        #[serde(with = "serde_bytes", borrow)]
        data: &'a [u8],
    }

    /// `sensor_msgs/CameraInfo`; matrices row by row.
    CameraInfo = CAMERA_INFO {
        header: Header,
        height: u32,
        width: u32,
        distortion_model: String,
        d: Vec<f64>,
        k: [f64; 9],
        r: [f64; 9],
        p: [f64; 12],
        binning_x: u32,
        binning_y: u32,
        roi: RegionOfInterest,
    }

    /// `sensor_msgs/PointCloud2`.
    PointCloud2<'a> = POINT_CLOUD {
        header: Header,
        height: u32,
        width: u32,
        fields: Vec<PointField>,
        is_bigendian: bool,
        point_step: u32,
        row_step: u32,
        #[serde(with = "serde_bytes", borrow)]
        data: &'a [u8],
        is_dense: bool,
    }

    /// `geometry_msgs/PoseStamped`.
    PoseStamped = POSE_STAMPED {
        header: Header,
        pose: PoseMessage,
    }

    /// `geometry_msgs/TransformStamped`: p_parent = T p_child, the parent being the header's frame.
    TransformStamped = TRANSFORM_STAMPED {
        header: Header,
        child_frame_id: String,
        transform: Transform,
    }

    /// `tf2_msgs/TFMessage`.
    TfMessage = TF_MESSAGE {
        transforms: Vec<TransformStamped>,
    }

    /// `nav_msgs/OccupancyGrid`: rows along x, from low y; 0..=100, and -1 (here 255) is unknown.
    OccupancyGrid<'a> = OCCUPANCY_GRID {
        header: Header,
        info: MapMetaData,
        #[serde(with = "serde_bytes", borrow)]
        data: &'a [u8],
    }

    /// `nvblox_msgs/DistanceMapSlice`: rows along x, from low y, m.
    DistanceMapSlice = DISTANCE_SLICE {
        header: Header,
        resolution: f32,
        width: u32,
        height: u32,
        origin: Point,
        unknown_value: f32,
        data: Vec<f32>,
    }

    /// The request of `nvblox_msgs/EsdfAndGradients`, m.
    EsdfRequest = ESDF_SERVICE {
        update_esdf: bool,
        visualize_esdf: bool,
        use_aabb: bool,
        frame_id: String,
        aabb_min_m: Point,
        aabb_size_m: Vector3,
        aabbs_to_clear_min_m: Vec<Point>,
        aabbs_to_clear_size_m: Vec<Vector3>,
        spheres_to_clear_center_m: Vec<Point>,
        spheres_to_clear_radius_m: Vec<f32>,
    }

    /// Its response: distances of voxels, z the fastest, m; -1000 where unknown. The origin is the low
    /// corner of the low voxel.
    EsdfResponse = ESDF_SERVICE {
        header: Header,
        origin_m: Point,
        voxel_size_m: f32,
        esdf_and_gradients: FloatArray,
        success: bool,
    }
}
