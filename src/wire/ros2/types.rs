//! The names and hashes of the types of messages and services.

use serde::Serialize;

/// In place of a hash: whatever the publisher says.
pub const ANY_HASH: &str = "*";
/// What ROS 2 Humble has in place of hashes.
pub const NO_HASH: &str = "TypeHashNotSupported";

/// A type, as the two worlds spell it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Type {
    /// As in `sensor_msgs/msg/Image`.
    pub name: &'static str,
    /// As in `sensor_msgs::msg::dds_::Image_`.
    pub dds_name: &'static str,
    /// The hash of the definition (REP-2016); tests/data/ros2/hashes.py works it out.
    pub hash: &'static str,
}

/// What has a type of its own on a topic, or is the one or the other half of a service.
pub trait Message: Serialize {
    const TYPE: Type;
}

macro_rules! types {
    ($($constant:ident = $package:literal $kind:literal $name:literal $hash:literal)*) => {
        impl Type {
            $(pub const $constant: Self = Self {
                name: concat!($package, "/", $kind, "/", $name),
                dds_name: concat!($package, "::", $kind, "::dds_::", $name, "_"),
                hash: concat!("RIHS01_", $hash),
            };)*

            /// Every type.
            pub const ALL: &[Self] = &[$(Self::$constant),*];
        }
    };
}

types! {
    STRING = "std_msgs" "msg" "String"
        "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    IMAGE = "sensor_msgs" "msg" "Image"
        "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"
    COMPRESSED_IMAGE = "sensor_msgs" "msg" "CompressedImage"
        "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a"
    CAMERA_INFO = "sensor_msgs" "msg" "CameraInfo"
        "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275"
    POINT_CLOUD = "sensor_msgs" "msg" "PointCloud2"
        "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"
    POSE_STAMPED = "geometry_msgs" "msg" "PoseStamped"
        "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
    TRANSFORM_STAMPED = "geometry_msgs" "msg" "TransformStamped"
        "0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206"
    TF_MESSAGE = "tf2_msgs" "msg" "TFMessage"
        "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"
    OCCUPANCY_GRID = "nav_msgs" "msg" "OccupancyGrid"
        "8d348150c12913a31ee0ec170fbf25089e4745d17035792a1ba94d6f0bc0cfc7"
    DISTANCE_SLICE = "nvblox_msgs" "msg" "DistanceMapSlice"
        "74904d5bb26abebc1fbbcd52fb06f77442f823c9a2e7cddc7700080733c4c1e8"
    ESDF_SERVICE = "nvblox_msgs" "srv" "EsdfAndGradients"
        "e080f96a14304e6d24c9598b72b80e0aa20a2cfc1bbc2414a629c907a10eb5b0"
}
