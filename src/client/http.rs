//! An HTTP client of one server: raw numbers out, raw columns back.

use std::fmt::Write;
use std::str::FromStr;
use std::time::Duration;

use bytes::Bytes;
use http_body_util::{BodyExt, Full, Limited};
use hyper::header::HeaderValue;
use hyper::header::{ACCEPT, CONTENT_TYPE, HOST, HeaderMap};
use hyper::{Method, Request, Uri};
use hyper_util::rt::TokioIo;

use super::credentials::{Bytes as Io, Credentials, Dial, KEY_HEADER, NoConnection};
use crate::error::{Error, Result};
use crate::map::Fields;
use crate::service::{PointsQuestion, PointsReply, Sought, UnknownPolicy};
use crate::wire::{
    COLUMNS, EPOCH, MAX_MESSAGE_BYTES, NEWEST_STAMP_NS, POINTS, SERVER_US, columns_from_wire,
    error_from_http,
};

/// How long an answer may take. The server gives up sooner.
const ANSWER: Duration = Duration::from_secs(90);
const RAW: &str = "application/octet-stream";

/// One server. Each request has a connection of its own.
#[derive(Clone)]
pub struct HttpClient {
    dial: Dial,
    /// Host and port.
    authority: String,
    key: Option<HeaderValue>,
}

/// An answer that is no error.
pub(super) struct Answer {
    headers: HeaderMap,
    pub(super) body: Bytes,
}

impl Answer {
    /// A number in a header.
    pub(super) fn number<T: FromStr>(&self, name: &str) -> Result<T> {
        let missing = || Error::corrupt("the server's answer", format!("has no {name}"));
        self.text(name).parse().map_err(|_| missing())
    }

    fn text(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|value| value.to_str().ok()).unwrap_or_default()
    }
}

impl HttpClient {
    /// The server at `http://host:port`. Nothing is sent yet.
    pub fn new(url: &str) -> Result<Self> {
        Self::with(url, &Credentials::default())
    }

    /// The same, or that at `https://host:port`, with what it asks for.
    pub fn with(url: &str, credentials: &Credentials) -> Result<Self> {
        let wrong = |problem: &str| Error::invalid("URL", format!("'{url}': {problem}"));
        let uri: Uri = url.parse().map_err(|_| wrong("is no URL"))?;
        let (Some(host), Some(scheme @ ("http" | "https"))) = (uri.host(), uri.scheme_str()) else {
            return Err(wrong("try http://host:7611"));
        };
        if !matches!(uri.path(), "" | "/") || uri.query().is_some() {
            return Err(wrong("must end after the port"));
        }
        let dial = match scheme {
            "https" => Dial::secure(host, uri.port_u16().unwrap_or(443), credentials, b"http/1.1")?,
            _ => Dial::plain(host, uri.port_u16().unwrap_or(80)),
        };
        let key = credentials.header()?.map(|key| {
            let mut value = HeaderValue::from_bytes(key.as_bytes());
            if let Ok(value) = &mut value {
                value.set_sensitive(true);
            }
            value
        });
        let key = key.transpose().map_err(|_| wrong("the key does not fit into a header"))?;
        Ok(Self { authority: dial.authority(), dial, key })
    }

    /// Whether the server answers in HTTP/1.1; an error if nothing listens there.
    pub(super) async fn is_spoken(&self) -> Result<bool> {
        let stream = match self.dial.connect().await {
            Err(NoConnection::OtherProtocol) => return Ok(false),
            connected => self.connected(connected)?,
        };
        Ok(self
            .exchange(stream, self.request(Method::GET, "/healthz", Bytes::new())?)
            .await
            .is_ok())
    }

    /// The answer to a question about points.
    pub async fn ask(&self, question: &PointsQuestion) -> Result<PointsReply> {
        let path = format!("/v1/maps/{}/query/points{}", question.map_id, options(question)?);
        let body = Bytes::copy_from_slice(bytemuck::cast_slice(&question.points));
        let mut request = self.request(Method::POST, &path, body)?;
        let raw = HeaderValue::from_static(RAW);
        request.headers_mut().insert(CONTENT_TYPE, raw.clone());
        request.headers_mut().insert(ACCEPT, raw);
        let answer = self.answer(request).await?;
        let points = answer.number(POINTS)?;
        Ok(PointsReply {
            answers: columns_from_wire(answer.text(COLUMNS), &answer.body, points)?,
            epoch: answer.number(EPOCH)?,
            newest_stamp_ns: answer.number(NEWEST_STAMP_NS)?,
            spent: Duration::from_micros(answer.number(SERVER_US)?),
        })
    }

    /// What a path says.
    pub async fn get(&self, path: &str) -> Result<Bytes> {
        Ok(self.answer(self.request(Method::GET, path, Bytes::new())?).await?.body)
    }

    /// What a path says to a body of JSON.
    pub async fn post_json(&self, path: &str, body: String) -> Result<Bytes> {
        Ok(self.posted_json(path, body).await?.body)
    }

    /// The same, with what the headers say.
    pub(super) async fn posted_json(&self, path: &str, body: String) -> Result<Answer> {
        let mut request = self.request(Method::POST, path, Bytes::from(body))?;
        let json = HeaderValue::from_static("application/json");
        request.headers_mut().insert(CONTENT_TYPE, json);
        self.answer(request).await
    }

    fn request(&self, method: Method, path: &str, body: Bytes) -> Result<Request<Full<Bytes>>> {
        let mut request = Request::builder().method(method).uri(path).header(HOST, &self.authority);
        if let Some(key) = &self.key {
            request = request.header(KEY_HEADER, key);
        }
        request
            .body(Full::new(body))
            .map_err(|e| Error::invalid("URL", format!("'{path}' is no path: {e}")))
    }

    async fn answer(&self, request: Request<Full<Bytes>>) -> Result<Answer> {
        let stream = self.connected(self.dial.connect().await)?;
        self.exchange(stream, request).await?
    }

    fn connected(
        &self,
        connected: std::result::Result<Box<dyn Io>, NoConnection>,
    ) -> Result<Box<dyn Io>> {
        connected.map_err(|error| {
            let problem = match error {
                NoConnection::Failed(problem) => problem,
                NoConnection::OtherProtocol => "it speaks no HTTP/1.1".into(),
            };
            Error::Unavailable(format!("no server answers at {}: {problem}", self.url()))
        })
    }

    fn url(&self) -> String {
        let scheme = if self.dial.is_secure() { "https" } else { "http" };
        format!("{scheme}://{}", self.authority)
    }

    /// Sends a request and reads its answer: the outer result is that of the connection, the inner
    /// one the server's.
    async fn exchange(
        &self,
        stream: Box<dyn Io>,
        request: Request<Full<Bytes>>,
    ) -> Result<Result<Answer>> {
        let at = self.url();
        let broken = |problem: String| {
            Error::Unavailable(format!("the server at {at} speaks no HTTP/1.1: {problem}"))
        };
        let exchange = async {
            let (mut sender, connection) =
                hyper::client::conn::http1::handshake(TokioIo::new(stream))
                    .await
                    .map_err(|e| broken(e.to_string()))?;
            // Ends with the sender.
            tokio::spawn(connection);
            let response = sender.send_request(request).await.map_err(|e| broken(e.to_string()))?;
            let (head, body) = response.into_parts();
            let body = Limited::new(body, MAX_MESSAGE_BYTES).collect().await;
            let body = body.map_err(|e| broken(e.to_string()))?.to_bytes();
            Ok(match head.status.is_success() {
                true => Ok(Answer { headers: head.headers, body }),
                false => Err(error_from_http(head.status.as_u16(), &body)),
            })
        };
        let late = |_| Error::DeadlineExceeded(format!("no answer from {at} within {ANSWER:?}"));
        tokio::time::timeout(ANSWER, exchange).await.map_err(late)?
    }
}

/// The query string of a question: what differs from the defaults.
fn options(question: &PointsQuestion) -> Result<String> {
    let Fields { distance, gradient, occupancy, state, color, text_score } = question.fields;
    let named = [
        (distance, "distance"),
        (gradient, "gradient"),
        (occupancy, "occupancy"),
        (state, "state"),
        (color, "color"),
        (text_score, "text_score"),
    ];
    let fields: Vec<&str> = named.iter().filter(|(asked, _)| *asked).map(|(_, n)| *n).collect();
    let mut text = format!("?fields={}&min_epoch={}", fields.join(","), question.min_epoch);
    let mut add = |key: &str, value: &dyn std::fmt::Display| {
        // Writing to a string cannot fail.
        let _ = write!(text, "&{key}={value}");
    };
    if let Some(age) = question.max_age {
        // At least 1: a limit of 0 would read as none.
        add("max_age_ms", &(age.as_millis() as u64).max(1));
    }
    match question.unknown.policy {
        UnknownPolicy::Report => {}
        UnknownPolicy::Free => add("unknown_policy", &"free"),
        UnknownPolicy::Occupied => add("unknown_policy", &"occupied"),
    }
    if let Some(distance_m) = question.unknown.distance_m {
        add("unknown_distance_m", &distance_m);
    }
    if !question.frame_id.is_empty() {
        let any = percent_encoding::NON_ALPHANUMERIC;
        add("frame_id", &percent_encoding::utf8_percent_encode(&question.frame_id, any));
    }
    match &question.text {
        None => {}
        Some(Sought::Words { prompts, negatives }) => {
            add("prompts", &words(prompts));
            if let Some(negatives) = negatives {
                add("negatives", &words(negatives));
            }
        }
        Some(Sought::Embeddings { .. }) => {
            let problem = "embeddings beside raw points go over gRPC alone";
            return Err(Error::invalid("text", problem));
        }
    }
    Ok(text)
}

/// Words with commas between them; one inside of a word is encoded.
fn words(words: &[String]) -> String {
    let any = percent_encoding::NON_ALPHANUMERIC;
    let encoded = words.iter().map(|word| percent_encoding::utf8_percent_encode(word, any));
    encoded.map(|word| word.to_string()).collect::<Vec<_>>().join(",")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::service::Unknown;

    #[test]
    fn urls_are_read_or_refused() {
        let authority = |url| HttpClient::new(url).map(|client| client.authority).ok();
        assert_eq!(authority("http://127.0.0.1:7611"), Some("127.0.0.1:7611".into()));
        assert_eq!(authority("http://[::1]:7611/"), Some("[::1]:7611".into()));
        assert_eq!(authority("http://robot"), Some("robot:80".into()));
        assert_eq!(authority("https://robot"), Some("robot:443".into()));
        for wrong in ["grpc://robot:7611", "robot:7611", "http://robot/v1", "http://", "http://a b"]
        {
            assert_eq!(authority(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_question_becomes_a_query_string() {
        let mut question = PointsQuestion::new(Vec::new());
        question.fields = Fields { gradient: true, ..Fields::DISTANCE };
        let options = |question: &PointsQuestion| options(question).expect("words alone");
        assert_eq!(options(&question), "?fields=distance,gradient&min_epoch=0");
        question.max_age = Some(Duration::from_millis(250));
        question.unknown = Unknown { policy: UnknownPolicy::Occupied, distance_m: Some(1.5) };
        question.frame_id = "a b".into();
        assert_eq!(
            options(&question),
            "?fields=distance,gradient&min_epoch=0&max_age_ms=250&unknown_policy=occupied\
             &unknown_distance_m=1.5&frame_id=a%20b"
        );
        question = PointsQuestion::new(Vec::new());
        question.fields = Fields { text_score: true, ..Fields::NONE };
        let prompts = vec!["red chair".into(), "a,b".into()];
        question.text = Some(Sought::Words { prompts, negatives: Some(Vec::new()) });
        let expected = "?fields=text_score&min_epoch=0&prompts=red%20chair,a%2Cb&negatives=";
        assert_eq!(options(&question), expected);
    }
}
