//! What the dashboard lives on: the page, the surface in pieces, events.

use std::collections::BTreeMap;
use std::time::Duration;

use orenx::map::{Fields, TriangleMesh};
use orenx::wire::v1::FrameStatus;
use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use super::{Reply, exchange, get, request};
use crate::server::images::mapped;
use crate::server::{good_frame, open_stream, start, verdict};

const PIECES: &str = "/v1/maps/default/mesh/pieces";

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn long(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

/// An answer with pieces, as its document says that it is read.
struct Pieces {
    generation: u64,
    next: u64,
    is_fresh: bool,
    has_more: bool,
    /// Triangles by key.
    pieces: BTreeMap<[i32; 3], u32>,
}

fn read(reply: &Reply) -> Pieces {
    assert_eq!(reply.status, 200, "{}", reply.head);
    let body = &reply.body[..];
    assert_eq!(&body[..4], b"OXP1");
    let (mut at, mut pieces) = (48, BTreeMap::new());
    for _ in 0..word(body, 4) {
        let key = [0, 4, 8].map(|i| word(body, at + i) as i32);
        let [vertices, triangles, flags] = [12, 16, 20].map(|i| word(body, at + i));
        let index = if flags & 2 == 2 { 12 } else { 6 };
        let vertex = if flags & 1 == 1 { 12 } else { 8 };
        at += 24 + (vertex * vertices + index * triangles).next_multiple_of(4) as usize;
        assert!(pieces.insert(key, triangles).is_none(), "{key:?} twice");
    }
    assert_eq!(at, body.len());
    let flags = word(body, 40);
    Pieces {
        generation: long(body, 8),
        next: long(body, 16),
        is_fresh: flags & 1 == 1,
        has_more: flags & 2 == 2,
        pieces,
    }
}

/// Asks until there is no more; all pieces, and where to go on.
async fn all(at: &str, options: &str) -> (BTreeMap<[i32; 3], u32>, u64, u64) {
    let (mut pieces, mut generation, mut since) = (BTreeMap::new(), 0, 0);
    loop {
        let query = format!("{PIECES}?generation={generation}&since={since}{options}");
        let told = read(&get(at, &query).await);
        pieces.extend(told.pieces);
        assert!(told.next > since || !told.has_more, "it goes on");
        (generation, since) = (told.generation, told.next);
        if !told.has_more {
            return (pieces, generation, since);
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_page_gets_the_surface_once_and_then_what_changed() {
    let server = mapped().await;
    let at = &server.http;
    let (pieces, generation, since) = all(at, "").await;
    let triangles: u32 = pieces.values().sum();
    assert!(pieces.len() > 8 && triangles > 2000, "{} pieces, {triangles}", pieces.len());
    // As many in small answers, and more of them where they are finer.
    assert_eq!(all(at, "&max_bytes=65536").await.0, pieces);
    let fine: u32 = all(at, "&detail=fine").await.0.values().sum();
    assert!(fine > 3 * triangles, "{fine} fine triangles, {triangles} usual ones");

    let known = format!("{PIECES}?generation={generation}&since={since}");
    let nothing = read(&get(at, &known).await);
    assert!(nothing.pieces.is_empty() && !nothing.is_fresh && nothing.next == since);
    // Of another count of changes everything is told.
    let other = read(&get(at, &format!("{PIECES}?generation=7&since={since}")).await);
    assert!(other.is_fresh && !other.pieces.is_empty());

    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(90)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    let news = loop {
        let news = read(&get(at, &known).await);
        if !news.pieces.is_empty() {
            break news;
        }
    };
    assert!(!news.is_fresh && news.pieces.len() < pieces.len(), "{}", news.pieces.len());

    exchange(at, request("POST", "/v1/maps/default/reset", &[], b"")).await;
    loop {
        let (pieces, ..) = all(at, "").await;
        if pieces.values().all(|triangles| *triangles == 0) {
            break;
        }
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_whole_surface_is_a_file_that_others_read() {
    let server = mapped().await;
    let at = &server.http;
    let reply = get(at, "/v1/maps/default/mesh.ply?resolution=0.05").await;
    assert_eq!((reply.status, reply.header("orenx-epoch")), (200, "4"));
    assert!(reply.header("content-disposition").contains("default.ply"));
    let mesh = TriangleMesh::read_ply(&reply.body[..], "mesh.ply").unwrap();
    assert!(mesh.triangles.len() > 2000, "{}", mesh.triangles.len());
    let glb = get(at, "/v1/maps/default/mesh.glb?resolution=0.05").await;
    assert_eq!((glb.status, glb.header("content-type")), (200, "model/gltf-binary"));
    assert!(glb.header("content-disposition").contains("default.glb"));
    assert_eq!((&glb.body[..4], word(&glb.body, 8) as usize), (&b"glTF"[..], glb.body.len()));
    let document: Value =
        serde_json::from_slice(&glb.body[20..][..word(&glb.body, 12) as usize]).unwrap();
    assert_eq!(document["accessors"][0]["count"], mesh.vertices.len());
    assert!(document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"].is_u64());
    let question = orenx::service::PointsQuestion {
        fields: Fields::DISTANCE,
        ..orenx::service::PointsQuestion::new(mesh.vertices)
    };
    let distance = server.client.ask(&question).await.unwrap().answers.distance;
    let on = distance.iter().filter(|d| d.abs() < 0.005).count();
    assert!(on * 10 > distance.len() * 9, "{on} of {}", distance.len());
    for (path, field) in [
        ("/v1/maps/default/mesh.ply?resolution=0", "resolution"),
        ("/v1/maps/default/mesh.glb?res=1", "res"),
        ("/v1/maps/default/mesh/pieces?max_bytes=1", "max_bytes"),
        ("/v1/maps/default/mesh/pieces?detail=finest", "detail"),
        ("/v1/events?maps=default", "maps"),
    ] {
        let reply = get(at, path).await;
        assert_eq!((reply.status, reply.error()[1].as_str()), (400, field), "{path}");
    }
    for path in ["/v1/maps/attic/mesh/pieces", "/v1/events?map=attic", "/assets/attic.js"] {
        assert_eq!(get(at, path).await.status, 404, "{path}");
    }
    server.stop().await.0.unwrap();
}

/// Reads events until one is as it should be; the counters that it has.
async fn until(stream: &mut TcpStream, rest: &mut String, is_it: impl Fn(&str, &Value) -> bool) {
    let reading = async {
        loop {
            while let Some((event, others)) = rest.split_once("\n\n") {
                let found = event.split_once("event: ").and_then(|(_, e)| {
                    let (name, rest) = e.split_once('\n')?;
                    Some((name, rest.split_once("data: ")?.1))
                });
                let is_found = found.is_some_and(|(name, data)| {
                    is_it(name, &serde_json::from_str(data).unwrap_or_default())
                });
                *rest = others.to_owned();
                if is_found {
                    return;
                }
            }
            let mut bytes = Vec::new();
            assert_ne!(stream.read_buf(&mut bytes).await.unwrap(), 0, "the events end: {rest}");
            rest.push_str(&String::from_utf8_lossy(&bytes));
        }
    };
    tokio::time::timeout(Duration::from_secs(60), reading).await.expect("it never comes");
}

#[tokio::test(flavor = "multi_thread")]
async fn events_tell_the_counters_as_they_change_and_end_with_the_server() {
    let server = start(|_| {}).await;
    let mut stream = TcpStream::connect(&server.http).await.unwrap();
    stream.write_all(&request("GET", "/v1/events", &[], b"")).await.unwrap();
    let mut rest = String::new();
    until(&mut stream, &mut rest, |name, stats| name == "status" && stats["map"]["epoch"] == 0)
        .await;
    let (frames, mut acks) = open_stream(&server.channel).await;
    frames.send(good_frame(0)).await.unwrap();
    assert_eq!(verdict(&mut acks).await.status(), FrameStatus::Integrated);
    until(&mut stream, &mut rest, |_, stats| {
        stats["map"]["epoch"] == 1
            && stats["counts"]["integrated"] == 1
            && stats["visible_after"]["frames"] == 1
            && stats["robots"][0]["world_from_camera"]["translation"].is_array()
    })
    .await;
    drop((frames, acks));
    let stopped = tokio::spawn(server.stop());
    until(&mut stream, &mut rest, |name, _| name == "end").await;
    stopped.await.unwrap().0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn listeners_have_a_bound_and_give_their_places_back() {
    let server = start(|_| {}).await;
    let mut listeners = Vec::new();
    for _ in 0..64 {
        let mut stream = TcpStream::connect(&server.http).await.unwrap();
        stream.write_all(&request("GET", "/v1/events", &[], b"")).await.unwrap();
        until(&mut stream, &mut String::new(), |name, _| name == "status").await;
        listeners.push(stream);
    }
    let refused = get(&server.http, "/v1/events").await;
    assert_eq!((refused.status, refused.error()[0].as_str()), (429, "RESOURCE_EXHAUSTED"));
    drop(listeners);
    loop {
        let mut stream = TcpStream::connect(&server.http).await.unwrap();
        stream.write_all(&request("GET", "/v1/events", &[], b"")).await.unwrap();
        let mut head = [0; 12];
        stream.read_exact(&mut head).await.unwrap();
        if &head == b"HTTP/1.1 200" {
            break;
        }
    }
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_and_its_assets_are_kept_by_browsers() {
    let server = start(|_| {}).await;
    let at = &server.http;
    let html = ("accept", "text/html,application/xhtml+xml,*/*;q=0.8");
    let page = exchange(at, request("GET", "/", &[html], b"")).await;
    assert_eq!(page.status, 200);
    assert!(page.header("content-type").starts_with("text/html"), "{}", page.head);
    assert!(page.header("content-security-policy").contains("default-src 'none'"));
    assert_eq!(page.header("cache-control"), "no-cache");
    let known = ("if-none-match", page.header("etag"));
    assert_eq!(exchange(at, request("GET", "/", &[html, known], b"")).await.status, 304);
    assert_eq!(get(at, "/").await.json()["name"], "orenx");

    let text = String::from_utf8(page.body).unwrap();
    // A build without the page says how to get one.
    let Some((_, rest)) = text.split_once("src=\"/assets/") else {
        assert!(text.contains("make web"), "{text}");
        return server.stop().await.0.unwrap();
    };
    let script = format!("/assets/{}", rest.split('"').next().unwrap());
    let plain = get(at, &script).await;
    assert!(plain.header("cache-control").contains("immutable"), "{}", plain.head);
    assert!(plain.header("content-type").starts_with("text/javascript"));
    let packed = ("accept-encoding", "gzip, br");
    let packed = exchange(at, request("GET", &script, &[packed], b"")).await;
    assert_eq!(packed.header("content-encoding"), "br");
    assert!(packed.body.len() * 3 < plain.body.len(), "{} bytes", packed.body.len());
    server.stop().await.0.unwrap();
}
