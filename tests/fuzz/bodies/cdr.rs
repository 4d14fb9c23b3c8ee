//! Messages of ROS 2 in CDR, with what is made of their contents. A byte that says which message, and
//! the payload.

use orenx::error::Result;
use orenx::wire::ros2::{
    Attachment, CameraInfo, CompressedImage, DistanceMapSlice, EsdfRequest, EsdfResponse, Image,
    Message, OccupancyGrid, PointCloud2, PoseStamped, Text, TfMessage, TransformStamped,
    color_from_compressed, color_from_image, decode, depth_from_compressed, depth_from_image,
    encode, intrinsics_from_info, pose_from_message, transform_from_message,
};
use serde::Deserialize;

use super::{Layout, Target, kind_of, of_kind};

pub(super) const TARGET: Target =
    Target { name: "cdr", read, seeds, layout: Layout::Plain, longest: 1024 };

type Read = fn(&[u8]) -> Result<()>;
const KINDS: [Read; 16] = [
    |bytes| depth_from_image(&whole::<Image<'_>>(bytes)?).map(drop),
    |bytes| color_from_image(&whole::<Image<'_>>(bytes)?).map(drop),
    |bytes| depth_from_compressed(&whole::<CompressedImage<'_>>(bytes)?).map(drop),
    |bytes| color_from_compressed(&whole::<CompressedImage<'_>>(bytes)?).map(drop),
    |bytes| camera(&whole(bytes)?, false),
    |bytes| camera(&whole(bytes)?, true),
    |bytes| pose_from_message(&whole::<PoseStamped>(bytes)?).map(drop),
    |bytes| transform_from_message(&whole::<TransformStamped>(bytes)?).map(drop),
    |bytes| {
        let tree = whole::<TfMessage>(bytes)?;
        tree.transforms.iter().try_for_each(|edge| transform_from_message(edge).map(drop))
    },
    |bytes| whole::<Text>(bytes).map(drop),
    |bytes| whole::<EsdfRequest>(bytes).map(drop),
    |bytes| whole::<EsdfResponse>(bytes).map(drop),
    |bytes| whole::<OccupancyGrid<'_>>(bytes).map(drop),
    |bytes| whole::<DistanceMapSlice>(bytes).map(drop),
    |bytes| whole::<PointCloud2<'_>>(bytes).map(drop),
    |bytes| Attachment::from_bytes(bytes).map(drop),
];

fn read(input: &[u8]) -> bool {
    kind_of(input, KINDS.len()).is_some_and(|(kind, bytes)| KINDS[kind](bytes).is_ok())
}

/// The golden files have numbers that are no camera's: refused after they were read.
fn camera(info: &CameraInfo, rectified: bool) -> Result<()> {
    let _ = intrinsics_from_info(info, rectified);
    Ok(())
}

/// What is read is written again, and read as the same.
fn whole<'a, M: Message + Deserialize<'a>>(payload: &'a [u8]) -> Result<M> {
    let message = decode::<M>(payload)?;
    encode(&message).expect("what was read can be written");
    Ok(message)
}

/// Bytes that a script wrote from the specifications.
macro_rules! golden {
    ($($kind:literal $name:literal)*) => {
        vec![$(
            of_kind($kind, include_bytes!(concat!("../../data/ros2/", $name, ".bin"))),
        )*]
    };
}

fn seeds() -> Vec<Vec<u8>> {
    golden! {
        0 "image.le" 0 "image.be" 5 "camera_info.le" 5 "camera_info.be" 6 "pose_stamped.le"
        6 "pose_stamped.be" 7 "transform_stamped.le" 7 "transform_stamped.be" 8 "tf_message.le"
        8 "tf_message.be" 9 "text.le" 9 "text.be" 10 "esdf_request.le" 10 "esdf_request.be"
        11 "esdf_response.le" 11 "esdf_response.be" 12 "occupancy_grid.le" 12 "occupancy_grid.be"
        13 "distance_slice.le" 13 "distance_slice.be" 14 "point_cloud.le" 14 "point_cloud.be"
        15 "attachment" 15 "attachment.named"
    }
}
