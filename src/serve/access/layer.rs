//! The gate before the services of gRPC.

use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use http_body_util::BodyExt;
use tonic::body::Body;
use tonic::codegen::http::{Request, Response};
use tower_layer::Layer;
use tower_service::Service;

use super::{Asked, Gate, Transport, rule};
use crate::serve::connection::Peer;
use crate::wire::status_from_error;

/// Lets calls in, or answers why not.
#[derive(Clone)]
pub(in crate::serve) struct Admission(pub(in crate::serve) Arc<Gate>);

impl<S> Layer<S> for Admission {
    type Service = Guarded<S>;

    fn layer(&self, inner: S) -> Guarded<S> {
        Guarded { inner, gate: self.0.clone() }
    }
}

/// A service behind the gate.
#[derive(Clone)]
pub(in crate::serve) struct Guarded<S> {
    inner: S,
    gate: Arc<Gate>,
}

impl<S> Service<Request<Body>> for Guarded<S>
where
    S: Service<Request<Body>, Response = Response<Body>>,
    S::Future: Send + 'static,
    S::Error: Send + 'static,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, S::Error>> + Send>>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let asked = Asked {
            transport: Transport::Grpc,
            rule: Some(rule(request.method().as_str(), request.uri().path())),
            headers: request.headers(),
            peer: request.extensions().get::<Peer>().map(|peer| peer.0.ip()),
        };
        let admitted = match self.gate.admit(&asked) {
            Ok(admitted) => admitted,
            Err(error) => {
                let refused = status_from_error(&error).into_http();
                return Box::pin(async move { Ok(refused) });
            }
        };
        tracing::Span::current().record("client", &*admitted.client);
        let answer = self.inner.call(request);
        Box::pin(async move {
            let answer = answer.await?;
            let Some(place) = admitted.place else { return Ok(answer) };
            // The place is given back with the end of the answer.
            let holds = move |body: Body| {
                Body::new(body.map_frame(move |frame| {
                    let _held = &place;
                    frame
                }))
            };
            Ok(answer.map(holds))
        })
    }
}
