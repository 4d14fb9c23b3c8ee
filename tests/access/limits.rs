//! What one client may take, and what becomes of one that takes more.

use std::time::Duration;

use orenx::client::{Client, HttpClient};
use orenx::config::{LimitSettings, Role};
use orenx::error::Error;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic_types::StatusExt;

use super::{ask, class, key, refused, showing, with_keys};
use crate::http::{exchange, request};
use crate::server::{bare, start};

#[tokio::test(flavor = "multi_thread")]
async fn who_asks_too_often_is_told_when_to_come_back() {
    let server = bare(|settings| {
        with_keys(settings);
        settings.limits = LimitSettings { requests_per_s: 1, burst: 5, ..settings.limits };
    })
    .await;
    let http = format!("http://{}", server.http);
    let bearer = ("authorization", "Bearer read-0123456789abcdef");
    let mut reply = exchange(&server.http, request("GET", "/v1/maps", &[bearer], b"")).await;
    while reply.status == 200 {
        reply = exchange(&server.http, request("GET", "/v1/maps", &[bearer], b"")).await;
    }
    assert_eq!(reply.status, 429);
    assert!((1..=2).contains(&reply.header("retry-after").parse::<u64>().unwrap()));
    let [code, _, message] = reply.error();
    assert_eq!(code, "RESOURCE_EXHAUSTED");
    assert!(message.contains("'read'") && message.contains("1 a second"), "{message}");

    // The same bucket over gRPC, where the details say when.
    let url = format!("http://{}", server.grpc);
    let channel = tonic::transport::Channel::from_shared(url).unwrap().connect().await.unwrap();
    let mut maps = orenx::wire::v1::maps_client::MapsClient::new(channel);
    let status = loop {
        let mut call = tonic::Request::new(orenx::wire::v1::ListMapsRequest {});
        call.metadata_mut().insert("api-key", key(Role::Read).parse().unwrap());
        if let Err(status) = maps.list_maps(call).await {
            break status;
        }
    };
    assert_eq!(status.code(), tonic::Code::ResourceExhausted);
    let wait = status.get_details_retry_info().unwrap().retry_delay.unwrap();
    assert!(wait > Duration::ZERO && wait <= Duration::from_secs(1), "{wait:?}");
    assert!(status.metadata().get("grpc-retry-pushback-ms").is_some());

    // Others are not held up, and probes never.
    let admin = HttpClient::with(&http, &showing(&key(Role::Admin))).unwrap();
    assert!(refused(&admin, "http", "requests").await >= 1.0);
    assert!(refused(&admin, "grpc", "requests").await >= 1.0);
    for _ in 0..20 {
        let probe = exchange(&server.http, request("GET", "/readyz", &[], b"")).await;
        assert_eq!(probe.status, 200);
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn streams_of_one_client_are_bounded_over_all_its_connections() {
    let server = start(|settings| settings.limits.streams = 3).await;
    let url = format!("grpc://{}", server.bare_grpc());
    let (mut held, mut clients) = (Vec::new(), Vec::new());
    for _ in 0..3 {
        let client = Client::connect(&url).await.unwrap();
        let (ending, questions) = mpsc::channel(1);
        let answers = client.stream_query(ReceiverStream::new(questions)).await.unwrap();
        held.push((ending, answers));
        clients.push(client);
    }
    let error = clients[0].stream_query(tokio_stream::pending()).await.err().expect("no place");
    assert!(matches!(error, Error::ResourceExhausted { .. }), "{error}");
    assert!(error.to_string().contains("3 at a time"), "{error}");
    assert_eq!(class(ask(&clients[0]).await), "done", "a question is no stream");
    let metrics = HttpClient::new(&format!("http://{}", server.http)).unwrap();
    assert_eq!(refused(&metrics, "grpc", "streams").await, 1.0);
    // One that ends makes room, once the server has heard of it.
    drop(held.pop());
    let again = async { while clients[0].stream_query(tokio_stream::pending()).await.is_err() {} };
    tokio::time::timeout(Duration::from_secs(60), again).await.expect("its place comes back");
    drop((held, clients));
    server.stop().await.0.unwrap();
}

/// HTTP/2 by hand: ten thousand streams at once on one connection, whatever the server allows.
#[tokio::test(flavor = "multi_thread")]
async fn ten_thousand_streams_on_one_connection_do_no_harm() {
    const STREAMS: u32 = 10_000;
    let server = start(|_| {}).await;
    let mut bytes = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec();
    bytes.extend([0, 0, 0, 4, 0, 0, 0, 0, 0]); // no settings of our own
    // POST, http, a path, and what gRPC wants; nothing is indexed.
    let mut head = vec![0x83, 0x86];
    let literal = |head: &mut Vec<u8>, name: &[u8], value: &[u8]| {
        head.push(0);
        for text in [name, value] {
            head.push(text.len() as u8);
            head.extend(text);
        }
    };
    literal(&mut head, b":path", b"/orenx.v1.Query/StreamQuery");
    literal(&mut head, b":authority", b"test");
    literal(&mut head, b"content-type", b"application/grpc");
    literal(&mut head, b"te", b"trailers");
    for stream in 0..STREAMS {
        bytes.extend([0, 0, head.len() as u8, 1, 4]);
        bytes.extend((2 * stream + 1).to_be_bytes());
        bytes.extend(&head);
    }
    let mut flood = TcpStream::connect(server.bare_grpc()).await.unwrap();
    // It may be cut off in the middle of it.
    let (mut from, mut to) = flood.split();
    let flooding = async {
        let _ = to.write_all(&bytes).await;
    };
    let said = async {
        let mut all = Vec::new();
        let _ = from.read_to_end(&mut all).await;
        all
    };
    let (said, ()) =
        tokio::time::timeout(Duration::from_secs(60), async { tokio::join!(said, flooding) })
            .await
            .expect("a connection that floods is ended");
    let (refused, goodbye) = (frames_of(&said, 3), frames_of(&said, 7));
    assert!(refused > 0 && goodbye > 0, "{refused} streams refused, {goodbye} goodbyes");
    assert_eq!(class(ask(&server.client).await), "done");
    server.stop().await.0.unwrap();
}

/// How many frames of HTTP/2 of a kind there are.
fn frames_of(mut bytes: &[u8], kind: u8) -> usize {
    let mut count = 0;
    while let [a, b, c, of, _, _, _, _, _, ..] = *bytes {
        count += usize::from(of == kind);
        let length = u32::from_be_bytes([0, a, b, c]) as usize;
        bytes = bytes.get(9 + length..).unwrap_or_default();
    }
    count
}
