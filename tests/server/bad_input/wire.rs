//! HTTP/2 by hand: what a client can do that keeps no rule.

use orenx::wire::v1;
use tokio::net::TcpStream;
use tonic::Code;
use tonic::codegen::http::{HeaderMap, Request};
use tonic_prost::prost::Message;
use tonic_prost::prost::bytes::Bytes;

/// A call whose request is still open.
pub(super) struct Call {
    pub(super) request: h2::SendStream<Bytes>,
    pub(super) response: h2::client::ResponseFuture,
    _connection: tokio::task::JoinHandle<Result<(), h2::Error>>,
}

/// Begins a call. `window` is how much of the answer the server may send before it is asked for
/// more.
pub(super) async fn begin(url: &str, path: &str, timeout: Option<&str>, window: u32) -> Call {
    let socket = TcpStream::connect(url.strip_prefix("http://").unwrap()).await.unwrap();
    let (client, connection) = h2::client::Builder::new()
        .initial_window_size(window)
        .handshake::<_, Bytes>(socket)
        .await
        .unwrap();
    let connection = tokio::spawn(connection);
    let mut request = Request::post(format!("{url}{path}"))
        .header("content-type", "application/grpc")
        .header("te", "trailers");
    if let Some(timeout) = timeout {
        request = request.header("grpc-timeout", timeout);
    }
    let mut client = client.ready().await.unwrap();
    let (response, request) = client.send_request(request.body(()).unwrap(), false).unwrap();
    Call { request, response, _connection: connection }
}

impl Call {
    /// Leaves as a process that is killed: in the middle of whatever it was doing.
    pub(super) fn die(self) {
        self._connection.abort();
    }

    /// The status that ends the call.
    pub(super) async fn status(self) -> (Code, String) {
        let (head, mut body) = self.response.await.unwrap().into_parts();
        if head.headers.contains_key("grpc-status") {
            return status_of(&head.headers);
        }
        while let Some(data) = body.data().await {
            let _ = body.flow_control().release_capacity(data.unwrap().len());
        }
        status_of(&body.trailers().await.unwrap().expect("a status"))
    }
}

fn status_of(headers: &HeaderMap) -> (Code, String) {
    let text = |name: &str| headers.get(name).map_or("", |v| v.to_str().unwrap()).to_owned();
    let status = tonic::Status::from_header_map(headers).expect("a status");
    assert_eq!(text("grpc-status"), i32::from(status.code()).to_string());
    (status.code(), status.message().to_owned())
}

/// A message in its envelope.
pub(super) fn envelope(bytes: &[u8]) -> Bytes {
    let length = u32::try_from(bytes.len()).unwrap();
    [&[0], &length.to_be_bytes()[..], bytes].concat().into()
}

/// A question about so many points, in its envelope.
pub(super) fn question(map_id: &str, points: usize) -> v1::QueryPointsRequest {
    let points_m = vec![0.5; 3 * points];
    v1::QueryPointsRequest { map_id: map_id.into(), points_m, ..Default::default() }
}

/// The bytes of a message in its envelope.
pub(super) fn sent(message: &impl Message) -> Bytes {
    envelope(&message.encode_to_vec())
}
