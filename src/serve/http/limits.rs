//! What bounds an HTTP client: bytes, requests, connections, time.

use std::time::Duration;

/// A point in a raw body: three f32.
pub(super) const RAW_POINT_BYTES: usize = 12;
/// Room for a point in a JSON body: three numbers of 20 digits and what is between them.
const JSON_POINT_BYTES: usize = 64;
/// Room for the rest of a JSON body: words, or ten embeddings of a thousand numbers.
const JSON_OPTIONS_BYTES: usize = 256 << 10;
/// A pixel of the largest image: three f32.
const PIXEL_BYTES: usize = 12;
/// Memory of the bodies under way, in bodies and in images of the largest size.
const LARGEST_BODIES: usize = 4;
const LARGEST_IMAGES: usize = 2;

/// The bounds of one server.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Limits {
    pub(super) max_points: usize,
    /// Connections at a time; the next one waits to be accepted.
    pub(super) connections: usize,
    /// Requests that are worked on at a time; the next one is refused.
    pub(super) requests: usize,
    /// The largest body, bytes.
    pub(super) json_bytes: usize,
    pub(super) raw_bytes: usize,
    /// The largest image, bytes.
    pub(super) image_bytes: usize,
    /// All bodies and answers under way, bytes.
    pub(super) body_bytes: usize,
    /// The request line and the headers, bytes.
    pub(super) header_bytes: usize,
    /// How long the headers of the next request may take, idle time included.
    pub(super) header_time: Duration,
    /// How long a body may take to arrive.
    pub(super) body_time: Duration,
    /// How long a request may take in all, where the client does not say less.
    pub(super) request_time: Duration,
    /// The same where a whole file comes in, whose pieces may each take as long as a body.
    pub(super) upload_time: Duration,
    /// How long a client may take no byte of its answer.
    pub(super) write_time: Duration,
    /// How long what a refused client still sends is read, so that it sees why, and how much of it.
    pub(super) linger_time: Duration,
    pub(super) linger_bytes: usize,
    /// How long connections may take to end once the server stops.
    pub(super) drain_time: Duration,
}

impl Limits {
    /// The bounds for questions of up to `max_points` points and images of up to `max_pixels` pixels.
    pub(super) fn new(max_points: usize, max_pixels: usize) -> Self {
        let json_bytes = max_points * JSON_POINT_BYTES + JSON_OPTIONS_BYTES;
        let image_bytes = max_pixels * PIXEL_BYTES;
        Self {
            max_points,
            connections: 256,
            requests: 64,
            json_bytes,
            raw_bytes: max_points * RAW_POINT_BYTES,
            image_bytes,
            body_bytes: json_bytes * LARGEST_BODIES + image_bytes * LARGEST_IMAGES,
            header_bytes: 16 << 10,
            header_time: Duration::from_secs(30),
            body_time: Duration::from_secs(30),
            request_time: Duration::from_secs(60),
            upload_time: Duration::from_secs(3600),
            write_time: Duration::from_secs(10),
            linger_time: Duration::from_secs(5),
            linger_bytes: 256 << 20,
            drain_time: Duration::from_secs(5),
        }
    }
}
