//! What the camera should see from where it was last: rendered colours and depth.

use super::Source;
use crate::error::Result;
use crate::map::{Camera, Encoding, Output};
use crate::service::{Call, ImageKind, ImageQuestion};
use crate::wire::ros2::{color_to_image, depth_to_image, encode};

/// Colours and depth, of those that somebody listens to.
pub(super) async fn pictures(
    source: &Source,
    camera: Camera,
    (wants_color, wants_depth): (bool, bool),
) -> Result<(Option<Vec<u8>>, Option<Vec<u8>>)> {
    let color = ImageKind { output: Output::Color, encoding: Encoding::U8 };
    let depth = ImageKind { output: Output::Depth, encoding: Encoding::F32 };
    let wanted = [(wants_color, color), (wants_depth, depth)];
    let images = wanted.into_iter().filter(|(wanted, _)| *wanted).map(|(_, kind)| kind);
    let question = ImageQuestion {
        map_id: source.map_id.clone(),
        ..ImageQuestion::new(camera, images.collect())
    };
    let reply = source.service.render(question, Call::Ros2Render).await?;
    let size = (reply.width, reply.height);
    let mut encoded = (None, None);
    for (kind, bytes) in reply.images {
        let header = source.header(reply.newest_stamp_ns);
        match kind.output {
            Output::Depth => {
                let metres: Vec<f32> =
                    bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                let mut data = Vec::with_capacity(bytes.len());
                let image = depth_to_image(header, size, &metres, &mut data);
                encoded.1 = Some(encode(&image)?);
            }
            _ => encoded.0 = Some(encode(&color_to_image(header, size, &bytes))?),
        }
    }
    Ok(encoded)
}
