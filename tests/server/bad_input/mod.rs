//! Bad input over the wire: what is sent, and the status, the words and the counters that answer it.
//! After each the server is asked something, and answers.

mod calls;
mod clients;
mod frames;
mod questions;
mod wire;

use glam::Vec3;
use orenx::map::Fields;
use orenx::service::{DEFAULT_MAP, FrameCounts};

use super::Running;

/// The server answers a question, and says what became of the frames so far.
async fn well(server: &Running) -> FrameCounts {
    let points = [Vec3::ONE; 3];
    let reply = server.client.query_points(DEFAULT_MAP, &points, Fields::ALL, 0).await.unwrap();
    assert_eq!(reply.answers.state.len(), points.len());
    server.client.map_stats(DEFAULT_MAP).await.unwrap().counts
}
