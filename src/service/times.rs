//! How long things take: what a transport's answers waited for and worked on, and how soon frames
//! are seen.

use std::time::Duration;

use crate::telemetry::{Distribution, Histogram};

/// A verb on a transport.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Call {
    GrpcQueryPoints,
    GrpcStreamQuery,
    GrpcRender,
    GrpcRenderStream,
    GrpcQueryText,
    GrpcQueryEmbedding,
    GrpcClassify,
    GrpcQuerySpheres,
    GrpcCheckTrajectories,
    GrpcCastRays,
    GrpcGetGrid,
    GrpcGetSlice,
    GrpcFindNearest,
    HttpQueryPoints,
    HttpRender,
    HttpQueryText,
    HttpQueryEmbedding,
    HttpClassify,
    HttpQuerySpheres,
    HttpCheckTrajectories,
    HttpCastRays,
    HttpGetGrid,
    HttpGetSlice,
    HttpFindNearest,
    ZenohQueryPoints,
    ZenohRender,
    ZenohQueryText,
    ZenohQueryEmbedding,
    ZenohClassify,
    ZenohQuerySpheres,
    ZenohCheckTrajectories,
    ZenohCastRays,
    ZenohGetGrid,
    ZenohGetSlice,
    ZenohFindNearest,
    Ros2Grid,
    Ros2Cloud,
    Ros2Render,
    Ros2Text,
    Ros2Esdf,
}

impl Call {
    pub const ALL: [Self; 40] = [
        Self::GrpcQueryPoints,
        Self::GrpcStreamQuery,
        Self::GrpcRender,
        Self::GrpcRenderStream,
        Self::GrpcQueryText,
        Self::GrpcQueryEmbedding,
        Self::GrpcClassify,
        Self::GrpcQuerySpheres,
        Self::GrpcCheckTrajectories,
        Self::GrpcCastRays,
        Self::GrpcGetGrid,
        Self::GrpcGetSlice,
        Self::GrpcFindNearest,
        Self::HttpQueryPoints,
        Self::HttpRender,
        Self::HttpQueryText,
        Self::HttpQueryEmbedding,
        Self::HttpClassify,
        Self::HttpQuerySpheres,
        Self::HttpCheckTrajectories,
        Self::HttpCastRays,
        Self::HttpGetGrid,
        Self::HttpGetSlice,
        Self::HttpFindNearest,
        Self::ZenohQueryPoints,
        Self::ZenohRender,
        Self::ZenohQueryText,
        Self::ZenohQueryEmbedding,
        Self::ZenohClassify,
        Self::ZenohQuerySpheres,
        Self::ZenohCheckTrajectories,
        Self::ZenohCastRays,
        Self::ZenohGetGrid,
        Self::ZenohGetSlice,
        Self::ZenohFindNearest,
        Self::Ros2Grid,
        Self::Ros2Cloud,
        Self::Ros2Render,
        Self::Ros2Text,
        Self::Ros2Esdf,
    ];

    /// The names of the transport and of the verb.
    pub fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::GrpcQueryPoints => ("grpc", "query_points"),
            Self::GrpcStreamQuery => ("grpc", "stream_query"),
            Self::GrpcRender => ("grpc", "render"),
            Self::GrpcRenderStream => ("grpc", "render_stream"),
            Self::GrpcQueryText => ("grpc", "query_text"),
            Self::GrpcQueryEmbedding => ("grpc", "query_embedding"),
            Self::GrpcClassify => ("grpc", "classify"),
            Self::GrpcQuerySpheres => ("grpc", "query_spheres"),
            Self::GrpcCheckTrajectories => ("grpc", "check_trajectories"),
            Self::GrpcCastRays => ("grpc", "cast_rays"),
            Self::GrpcGetGrid => ("grpc", "get_grid"),
            Self::GrpcGetSlice => ("grpc", "get_slice"),
            Self::GrpcFindNearest => ("grpc", "find_nearest"),
            Self::HttpQueryPoints => ("http", "query_points"),
            Self::HttpRender => ("http", "render"),
            Self::HttpQueryText => ("http", "query_text"),
            Self::HttpQueryEmbedding => ("http", "query_embedding"),
            Self::HttpClassify => ("http", "classify"),
            Self::HttpQuerySpheres => ("http", "query_spheres"),
            Self::HttpCheckTrajectories => ("http", "check_trajectories"),
            Self::HttpCastRays => ("http", "cast_rays"),
            Self::HttpGetGrid => ("http", "get_grid"),
            Self::HttpGetSlice => ("http", "get_slice"),
            Self::HttpFindNearest => ("http", "find_nearest"),
            Self::ZenohQueryPoints => ("zenoh", "query_points"),
            Self::ZenohRender => ("zenoh", "render"),
            Self::ZenohQueryText => ("zenoh", "query_text"),
            Self::ZenohQueryEmbedding => ("zenoh", "query_embedding"),
            Self::ZenohClassify => ("zenoh", "classify"),
            Self::ZenohQuerySpheres => ("zenoh", "query_spheres"),
            Self::ZenohCheckTrajectories => ("zenoh", "check_trajectories"),
            Self::ZenohCastRays => ("zenoh", "cast_rays"),
            Self::ZenohGetGrid => ("zenoh", "get_grid"),
            Self::ZenohGetSlice => ("zenoh", "get_slice"),
            Self::ZenohFindNearest => ("zenoh", "find_nearest"),
            Self::Ros2Grid => ("ros2", "grid"),
            Self::Ros2Cloud => ("ros2", "cloud"),
            Self::Ros2Render => ("ros2", "render"),
            Self::Ros2Text => ("ros2", "query_text"),
            Self::Ros2Esdf => ("ros2", "esdf"),
        }
    }
}

/// The answered questions of one call.
#[derive(Debug, Clone, PartialEq)]
pub struct CallTimes {
    pub call: Call,
    /// Until a thread took the question up.
    pub queue: Distribution,
    /// From there to its answer.
    pub compute: Distribution,
}

#[derive(Debug)]
pub(super) struct Times {
    calls: [(Histogram, Histogram); Call::ALL.len()],
}

impl Default for Times {
    fn default() -> Self {
        Self { calls: std::array::from_fn(|_| Default::default()) }
    }
}

impl Times {
    pub(super) fn observe(&self, call: Call, queued: Duration, spent: Duration) {
        let (queue, compute) = &self.calls[call as usize];
        queue.observe(queued);
        compute.observe(spent.saturating_sub(queued));
    }

    pub(super) fn read(&self) -> Vec<CallTimes> {
        let read = |(call, (queue, compute)): (&Call, &(Histogram, Histogram))| CallTimes {
            call: *call,
            queue: queue.read(),
            compute: compute.read(),
        };
        Call::ALL.iter().zip(&self.calls).map(read).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waiting_and_working_are_told_apart() {
        let times = Times::default();
        let ms = Duration::from_millis;
        times.observe(Call::HttpQueryPoints, ms(3), ms(5));
        for read in times.read() {
            let seconds = (read.queue.sum_s, read.compute.sum_s);
            let expected =
                if read.call == Call::HttpQueryPoints { (0.003, 0.002) } else { (0.0, 0.0) };
            assert_eq!(seconds, expected, "{:?}", read.call);
        }
    }
}
