//! What may be asked: the last chunk of a key, the messages that go with it, and the verb that answers.

use std::time::Instant;

use bytes::Buf;
use prost::Message;

use crate::error::{Error, Result};
use crate::service::{Call, Service};
use crate::wire::{
    classify_reply_to_wire, encoders_to_wire, find_reply_to_wire, grid_reply_to_wire,
    image_reply_to_wire, map_detail_to_wire, map_stats_to_wire, nearest_reply_to_wire,
    points_reply_to_wire, rays_reply_to_wire, read_message, settle_name, slice_reply_to_wire,
    spheres_reply_to_wire, trajectories_reply_to_wire, v1,
};

/// An answer, ready to be sent.
pub(super) struct Answer {
    /// What kind of message it is, in `orenx.v1`.
    pub(super) message: &'static str,
    pub(super) bytes: Vec<u8>,
}

/// The table: `verb: Request => Reply = how`; and, after it, the verbs that begin something. The map of
/// a request is that of its key.
macro_rules! verbs {
    (|$service:ident, $asked:ident, $started:ident|
     $($verb:literal: $Request:ident => $Reply:ident = $answer:expr;)*
     begin { $($begun:literal: $Begun:ident;)* }) => {
        /// Every verb.
        pub(super) const VERBS: [&str; [$($verb,)* $($begun),*].len()] = [$($verb,)* $($begun),*];

        /// The kind of message that a verb is asked with; `None` if there is no such verb.
        pub(super) fn request_of(verb: &str) -> Option<&'static str> {
            match verb {
                $($verb => Some(stringify!($Request)),)*
                $($begun => Some(stringify!($Begun)),)*
                _ => None,
            }
        }

        /// Answers an encoded request about the map that its key names.
        pub(super) async fn answer(
            $service: &Service,
            map_id: &str,
            verb: &str,
            payload: impl Buf,
        ) -> Result<Answer> {
            let $started = Instant::now();
            match verb {
                $($verb => {
                    let mut $asked: v1::$Request = read_message(payload)?;
                    settle_name("map_id", &mut $asked.map_id, map_id)?;
                    let reply: v1::$Reply = $answer;
                    Ok(Answer { message: stringify!($Reply), bytes: reply.encode_to_vec() })
                })*
                other => Err(no_verb(other)),
            }
        }
    };
}

verbs! { |service, asked, started|
    "points": QueryPointsRequest => QueryPointsReply =
        points_reply_to_wire(service.query_points(asked.try_into()?, Call::ZenohQueryPoints).await?);
    "spheres": QuerySpheresRequest => QuerySpheresReply =
        spheres_reply_to_wire(service.query_spheres(asked.try_into()?, Call::ZenohQuerySpheres).await?);
    "trajectories": CheckTrajectoriesRequest => CheckTrajectoriesReply = trajectories_reply_to_wire(
        service.check_trajectories(asked.try_into()?, Call::ZenohCheckTrajectories).await?);
    "rays": CastRaysRequest => CastRaysReply =
        rays_reply_to_wire(service.cast_rays(asked.try_into()?, Call::ZenohCastRays).await?);
    "grid": GetGridRequest => GetGridReply =
        grid_reply_to_wire(service.get_grid(asked.try_into()?, Call::ZenohGetGrid).await?);
    "slice": GetSliceRequest => GetSliceReply =
        slice_reply_to_wire(service.get_slice(asked.try_into()?, Call::ZenohGetSlice).await?);
    "nearest": FindNearestRequest => FindNearestReply =
        nearest_reply_to_wire(service.find_nearest(asked.try_into()?, Call::ZenohFindNearest).await?);
    "render": RenderRequest => RenderReply =
        image_reply_to_wire(service.render(asked.try_into()?, Call::ZenohRender).await?);
    "text": QueryTextRequest => QueryTextReply =
        find_reply_to_wire(service.find(asked.try_into()?, Call::ZenohQueryText).await?);
    "embedding": QueryEmbeddingRequest => QueryTextReply =
        find_reply_to_wire(service.find(asked.try_into()?, Call::ZenohQueryEmbedding).await?);
    "classify": ClassifyRequest => ClassifyReply =
        classify_reply_to_wire(service.classify(asked.try_into()?, Call::ZenohClassify).await?);
    "encoders": ListEncodersRequest => ListEncodersReply =
        encoders_to_wire(service.encoders(&asked.map_id)?, started.elapsed());
    "map": GetMapRequest => GetMapReply =
        map_detail_to_wire(service.map_detail(&asked.map_id)?, started.elapsed());
    "stats": GetMapStatsRequest => GetMapStatsReply =
        map_stats_to_wire(service.map_stats(&asked.map_id)?, started.elapsed());
    begin {
        "watch_region": WatchRegionRequest;
        "watch_trajectories": WatchTrajectoryRequest;
    }
}

fn no_verb(verb: &str) -> Error {
    let verb: String = verb.chars().take(64).collect();
    Error::NotFound { what: format!("verb: '{verb}' (there are {})", VERBS.join(", ")) }
}
