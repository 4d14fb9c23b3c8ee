//! A whole server on free ports, asked through HTTP, by a client that may say anything.

mod contract;
mod dashboard;
mod edits;
mod images;
mod life;
mod numbers;
mod planner;
mod refusals;
mod snapshots;
mod watches;

use serde_json::Value;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

const POINTS: &str = "/v1/maps/default/query/points";
const RENDER: &str = "/v1/maps/default/render";
const JSON: (&str, &str) = ("content-type", "application/json");
const RAW: (&str, &str) = ("content-type", "application/octet-stream");

/// What came back.
#[derive(Debug)]
pub(crate) struct Reply {
    pub(crate) status: u16,
    head: String,
    pub(crate) body: Vec<u8>,
}

impl Reply {
    pub(crate) fn header(&self, name: &str) -> &str {
        let line = |line: &'_ &str| {
            line.split_once(':').is_some_and(|(key, _)| key.eq_ignore_ascii_case(name))
        };
        self.head.lines().find(line).map_or("", |line| line[name.len() + 1..].trim())
    }

    fn json(&self) -> Value {
        assert_eq!(self.header("content-type"), "application/json", "{}", self.head);
        serde_json::from_slice(&self.body).unwrap()
    }

    /// Code, field and message of an error.
    pub(crate) fn error(&self) -> [String; 3] {
        let error = &self.json()["error"];
        let text = |key: &str| error[key].as_str().unwrap_or_default().to_owned();
        [text("code"), text("field"), text("message")]
    }
}

/// A request on a connection of its own.
pub(crate) fn request(method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Vec<u8> {
    let mut text = format!("{method} {path} HTTP/1.1\r\nhost: test\r\nconnection: close\r\n");
    for (name, value) in headers {
        text += &format!("{name}: {value}\r\n");
    }
    if method == "POST" {
        text += &format!("content-length: {}\r\n", body.len());
    }
    text += "\r\n";
    [text.as_bytes(), body].concat()
}

/// Sends bytes, whatever they are, and reads what comes back until the server ends.
async fn answer(at: &str, bytes: Vec<u8>) -> Vec<u8> {
    let stream = TcpStream::connect(at).await.unwrap();
    let (mut from, mut to) = stream.into_split();
    // A server that has heard enough ends before it has read all.
    let sending = tokio::spawn(async move {
        let _ = to.write_all(&bytes).await;
        to
    });
    let mut answer = Vec::new();
    // Noise may be answered by a reset.
    let _ = from.read_to_end(&mut answer).await;
    sending.abort();
    answer
}

/// A request and its reply.
pub(crate) async fn exchange(at: &str, bytes: Vec<u8>) -> Reply {
    let answer = answer(at, bytes).await;
    let end = answer.windows(4).position(|w| w == b"\r\n\r\n").expect("a whole head") + 4;
    let head = String::from_utf8(answer[..end].to_vec()).unwrap();
    let status = head.split(' ').nth(1).unwrap().parse().unwrap();
    Reply { status, head, body: answer[end..].to_vec() }
}

async fn get(at: &str, path: &str) -> Reply {
    exchange(at, request("GET", path, &[], b"")).await
}

async fn post_json(at: &str, path: &str, body: &Value) -> Reply {
    exchange(at, request("POST", path, &[JSON], body.to_string().as_bytes())).await
}

/// The number on a line of the metrics.
pub(crate) async fn metric(at: &str, sample: &str) -> f64 {
    let page = String::from_utf8(get(at, "/metrics").await.body).unwrap();
    let value = page.lines().find_map(|line| line.strip_prefix(sample)?.strip_prefix(' '));
    value.map_or(0.0, |value| value.parse().unwrap())
}
