//! Bad input over the wire: what is sent, and the status, the words and the counters that answer it.
//! After each the server is asked something, and answers.

mod calls;
mod clients;
mod frames;
mod images;
mod questions;
mod wire;

use glam::Vec3;
use orenx::map::Fields;
use orenx::service::{DEFAULT_MAP, FrameCounts};

use tonic::Code;

use super::Running;
use crate::http::metric;

/// The server answers a question, and says what became of the frames so far.
async fn well(server: &Running) -> FrameCounts {
    let points = [Vec3::ONE; 3];
    let reply = server.client.query_points(DEFAULT_MAP, &points, Fields::ALL, 0).await.unwrap();
    assert_eq!(reply.answers.state.len(), points.len());
    server.service.frame_counts()
}

/// How many calls of `path` ended with `code`.
async fn ended(server: &Running, path: &str, code: Code) -> f64 {
    let rpc = if path.contains("QueryFuture") { "other" } else { &path[1..] };
    // As in `InvalidArgument`, but written as everywhere else.
    let mut name = String::new();
    for letter in format!("{code:?}").chars() {
        if letter.is_uppercase() && !name.is_empty() {
            name.push('_');
        }
        name.push(letter.to_ascii_uppercase());
    }
    let sample = format!("orenx_grpc_requests_total{{rpc=\"{rpc}\",code=\"{name}\"}}");
    metric(&server.http, &sample).await
}
