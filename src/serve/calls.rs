//! What became of the calls over gRPC, by name and code.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::task::{Context, Poll};

use http_body::{Body, Frame, SizeHint};
use tonic::codegen::http::{HeaderMap, Request, Response};
use tower_layer::Layer;
use tower_service::Service;

/// Every call of ours; the last counter is for all others.
const CALLS: [&str; 24] = [
    "/orenx.v1.Ingest/StreamFrames",
    "/orenx.v1.Query/QueryPoints",
    "/orenx.v1.Query/StreamQuery",
    "/orenx.v1.Render/Render",
    "/orenx.v1.Render/RenderStream",
    "/orenx.v1.Language/QueryText",
    "/orenx.v1.Language/QueryEmbedding",
    "/orenx.v1.Language/Classify",
    "/orenx.v1.Language/ListEncoders",
    "/orenx.v1.Planner/QuerySpheres",
    "/orenx.v1.Planner/CheckTrajectories",
    "/orenx.v1.Planner/CastRays",
    "/orenx.v1.Planner/GetGrid",
    "/orenx.v1.Planner/GetSlice",
    "/orenx.v1.Planner/FindNearest",
    "/orenx.v1.Planner/WatchRegion",
    "/orenx.v1.Planner/WatchTrajectory",
    "/orenx.v1.Mirror/Subscribe",
    "/orenx.v1.Maps/ListMaps",
    "/orenx.v1.Maps/GetMap",
    "/orenx.v1.Maps/GetMapStats",
    "/orenx.v1.Maps/ResetMap",
    "/orenx.v1.Maps/ClearRegion",
    "/orenx.v1.Maps/StampGeometry",
];

/// The codes of gRPC, by number.
pub(super) const CODES: [&str; 17] = [
    "OK",
    "CANCELLED",
    "UNKNOWN",
    "INVALID_ARGUMENT",
    "DEADLINE_EXCEEDED",
    "NOT_FOUND",
    "ALREADY_EXISTS",
    "PERMISSION_DENIED",
    "RESOURCE_EXHAUSTED",
    "FAILED_PRECONDITION",
    "ABORTED",
    "OUT_OF_RANGE",
    "UNIMPLEMENTED",
    "INTERNAL",
    "UNAVAILABLE",
    "DATA_LOSS",
    "UNAUTHENTICATED",
];
/// Of a call whose client left.
const CANCELLED: usize = 1;
const UNKNOWN: usize = 2;

/// The counters of one port.
#[derive(Debug, Default)]
pub(super) struct Calls([[AtomicU64; CODES.len()]; CALLS.len() + 1]);

impl Calls {
    /// Every call with its code and how often it was so, if ever.
    pub(super) fn read(&self) -> Vec<(&'static str, &'static str, u64)> {
        let names = CALLS.iter().map(|path| path.trim_start_matches('/')).chain(["other"]);
        let rows = names.zip(&self.0).flat_map(|(name, counts)| {
            CODES.iter().zip(counts).map(move |(code, count)| (name, *code, count.load(Relaxed)))
        });
        rows.filter(|(_, _, count)| *count > 0).collect()
    }
}

/// Counts the calls that pass.
#[derive(Debug, Clone)]
pub(super) struct Counting(pub(super) Arc<Calls>);

impl<S> Layer<S> for Counting {
    type Service = Counted<S>;

    fn layer(&self, inner: S) -> Counted<S> {
        Counted { inner, calls: self.0.clone() }
    }
}

/// A service whose calls are counted.
#[derive(Debug, Clone)]
pub(super) struct Counted<S> {
    inner: S,
    calls: Arc<Calls>,
}

impl<S, Q, A> Service<Request<Q>> for Counted<S>
where
    S: Service<Request<Q>, Response = Response<A>>,
    S::Future: Send + 'static,
{
    type Response = Response<CountedBody<A>>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Q>) -> Self::Future {
        let path = request.uri().path();
        let call = CALLS.iter().position(|known| *known == path).unwrap_or(CALLS.len());
        let mut count = Count { calls: self.calls.clone(), call, is_counted: false };
        let answer = self.inner.call(request);
        Box::pin(async move {
            let answer = answer.await?;
            // A call that fails before it says anything has its status here, others behind the body.
            count.read(answer.headers());
            Ok(answer.map(|body| CountedBody { body, count }))
        })
    }
}

/// A call under way; counted when its status is known, or else when it is dropped.
#[derive(Debug)]
struct Count {
    calls: Arc<Calls>,
    call: usize,
    is_counted: bool,
}

impl Count {
    fn read(&mut self, headers: &HeaderMap) {
        let Some(status) = headers.get("grpc-status") else { return };
        let code = status.to_str().ok().and_then(|text| text.parse().ok());
        self.count(code.filter(|code| *code < CODES.len()).unwrap_or(UNKNOWN));
    }

    fn count(&mut self, code: usize) {
        if !self.is_counted {
            self.is_counted = true;
            self.calls.0[self.call][code].fetch_add(1, Relaxed);
        }
    }
}

impl Drop for Count {
    fn drop(&mut self) {
        self.count(CANCELLED);
    }
}

/// An answer on its way out.
#[derive(Debug)]
pub(super) struct CountedBody<A> {
    body: A,
    count: Count,
}

impl<A: Body + Unpin> Body for CountedBody<A> {
    type Data = A::Data;
    type Error = A::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<A::Data>, A::Error>>> {
        let frame = Pin::new(&mut self.body).poll_frame(context);
        if let Poll::Ready(Some(Ok(frame))) = &frame
            && let Some(trailers) = frame.trailers_ref()
        {
            self.count.read(trailers);
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
