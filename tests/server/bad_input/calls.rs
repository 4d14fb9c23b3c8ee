//! What is wrong with a call before anyone looks into its message.

use orenx::service::DEFAULT_MAP;
use tonic::Code;
use tonic_prost::prost::Message;
use tonic_prost::prost::bytes::Bytes;

use super::super::{good_frame, start};
use super::wire::{begin, envelope, question, sent};
use super::{ended, well};

const POINTS: &str = "/orenx.v1.Query/QueryPoints";
const QUESTIONS: &str = "/orenx.v1.Query/StreamQuery";
const STATS: &str = "/orenx.v1.Maps/GetMapStats";
const RESET: &str = "/orenx.v1.Maps/ResetMap";
const FRAMES: &str = "/orenx.v1.Ingest/StreamFrames";
const IMAGE: &str = "/orenx.v1.Render/Render";
const IMAGES: &str = "/orenx.v1.Render/RenderStream";
const TEXT: &str = "/orenx.v1.Language/QueryText";
const CLASSES: &str = "/orenx.v1.Language/Classify";
const EVERY: &[&str] = &[POINTS, QUESTIONS, STATS, RESET, FRAMES, IMAGE, IMAGES, TEXT, CLASSES];
const GARBAGE: &[&str] = &["no valid protobuf"];

/// What is sent, to whom, with which time limit, whether the client goes on talking, and what it
/// hears.
struct Bad {
    what: &'static str,
    paths: &'static [&'static str],
    body: Bytes,
    timeout: Option<&'static str>,
    is_open: bool,
    code: Code,
    words: &'static [&'static str],
}

fn bad(
    what: &'static str,
    paths: &'static [&'static str],
    body: Bytes,
    code: Code,
    words: &'static [&'static str],
) -> Bad {
    Bad { what, paths, body, timeout: None, is_open: false, code, words }
}

/// Bytes that are no message of ours.
fn no_messages() -> Vec<Bad> {
    let invalid = Code::InvalidArgument;
    let no = |what, bytes: &[u8]| bad(what, EVERY, envelope(bytes), invalid, GARBAGE);
    let asked = question(DEFAULT_MAP, 5).encode_to_vec();
    let frame = good_frame(0).encode_to_vec();
    let short = |path, whole: &[u8]| {
        bad("truncated", path, envelope(&whole[..whole.len() - 7]), invalid, GARBAGE)
    };
    vec![
        no("a field that ends before its length", &[0x0a, 0x7f, b'x']),
        no("a field of wire type 7", &[0x0f, 0x01]),
        no("a varint without an end", &[0x80; 11]),
        no("text", b"GET / HTTP/1.1"),
        short(&[POINTS], &asked),
        short(&[FRAMES], &frame),
    ]
}

/// Calls that break a rule of gRPC, a limit of size or a limit of time.
fn no_calls() -> Vec<Bad> {
    use Code::{DeadlineExceeded, Internal, OutOfRange, Unimplemented};
    let half = |path, whole: Bytes| {
        bad("half an envelope", path, whole.slice(..whole.len() / 2), Internal, &["EOF"])
    };
    let huge = |what, path, body| bad(what, path, body, OutOfRange, &["the limit is"]);
    let no_such = |path| bad("no such verb", path, sent(&question("", 1)), Unimplemented, &[]);
    let compressed = Bytes::from_static(&[1, 0, 0, 0, 1, 9]);
    vec![
        half(&[POINTS, QUESTIONS], sent(&question(DEFAULT_MAP, 5))),
        half(&[FRAMES], sent(&good_frame(0))),
        bad("a compressed message", EVERY, compressed, Internal, &["grpc-encoding"]),
        huge("10 million points", &[POINTS, QUESTIONS], sent(&question(DEFAULT_MAP, 10_000_000))),
        huge("100 MB", EVERY, envelope(&vec![0; 100_000_000])),
        no_such(&["/orenx.v1.Query/QueryFuture"]),
        Bad {
            timeout: Some("20m"),
            is_open: true,
            ..bad("time is up", EVERY, Bytes::new(), DeadlineExceeded, &["no answer", "20ms"])
        },
    ]
}

#[tokio::test(flavor = "multi_thread")]
async fn each_has_its_status_and_the_server_stays_well() {
    let server = start(|_| {}).await;
    for case in no_messages().into_iter().chain(no_calls()) {
        for path in case.paths {
            let before = ended(&server, path, case.code).await;
            let mut call = begin(&server.url, path, case.timeout, 65_535).await;
            // Fails if the server has refused it already.
            let _ = call.request.send_data(case.body.clone(), !case.is_open);
            let (code, message) = call.status().await;
            assert_eq!(code, case.code, "{} to {path}: {message}", case.what);
            for word in case.words {
                assert!(message.contains(word), "{} to {path}: {word} in '{message}'", case.what);
            }
            let after = ended(&server, path, case.code).await;
            assert_eq!(after, before + 1.0, "{} to {path} is counted", case.what);
            assert_eq!(well(&server).await.received, 0, "{} to {path} is no frame", case.what);
        }
    }
    server.stop().await.0.unwrap();
}

#[test]
fn a_port_in_use_is_named() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_orenx"))
        .args(["serve", "--set", "storage.path=", "--set", &format!("server.grpc={address}")])
        .output()
        .unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    let told = stderr.lines().next().unwrap_or_default();
    assert!(told.contains("server.grpc") && told.contains(&address), "{stderr}");
}
