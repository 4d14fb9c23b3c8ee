//! The dashboard: a page and what it is made of, compiled in, compressed when it was built.

use axum::extract::Path;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::media::Media;
use super::openapi;
use super::probes::{self, About};
use super::refusal::Refusal;
use crate::error::Error;

/// A file of the page.
struct File {
    name: &'static str,
    media: &'static str,
    plain: &'static [u8],
    gzip: &'static [u8],
    brotli: &'static [u8],
}

include!(concat!(env!("OUT_DIR"), "/dashboard.rs"));

/// The page itself.
const PAGE: &str = "index.html";

/// What the page may load, and from where: from here alone.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
    img-src 'self' blob: data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Said in place of the page by a server that was built without.
const ABSENT: &str = "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>orenx</title>\
    <h1>orenx is running</h1><p>This program was built without its dashboard. <code>make web</code> \
    builds it with Node.js, then <code>cargo build --release</code> takes it in.</p>\
    <p>Everything else is here: <a href=\"/openapi.json\">what it answers</a>, \
    <a href=\"/v1/maps\">its maps</a>, <a href=\"/metrics\">its metrics</a>.</p></html>";

/// The dashboard for a browser; name, version, links for everybody else
#[utoipa::path(get, path = "/", tag = "server",
    responses(
        (status = 200, description = "What this is, or with `accept: text/html` a page that shows it.",
            content((About = "application/json"), (String = "text/html"))),
        (status = 304, description = "The page that `if-none-match` names."), openapi::Any))]
pub(super) async fn root(headers: HeaderMap) -> Result<Response, Refusal> {
    // Whoever likes neither gets what everybody got who does not say.
    let mut response = match Media::best(&headers, &["application/json", "text/html"]) {
        Ok(1) => page(&headers),
        _ => probes::about()?,
    };
    response.headers_mut().append(header::VARY, HeaderValue::from_static("accept"));
    Ok(response)
}

/// What the dashboard is made of, by names that change with what is in them
#[utoipa::path(get, path = "/assets/{file}", tag = "server",
    params(("file" = String, Path, description = "A name that the page has.")),
    responses((status = 200, description = "The file.", content((openapi::Raw = "*/*"))),
        openapi::MapRefusals))]
pub(super) async fn asset(
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Refusal> {
    let file = FILES.iter().find(|file| file.name == name && file.name != PAGE);
    let file = file.ok_or_else(|| {
        let shown: String = name.chars().take(64).collect();
        Error::NotFound { what: format!("asset {shown}") }
    })?;
    let mut response = send(file, &headers);
    let forever = HeaderValue::from_static("public, max-age=31536000, immutable");
    response.headers_mut().insert(header::CACHE_CONTROL, forever);
    Ok(response)
}

fn page(headers: &HeaderMap) -> Response {
    let file = FILES.iter().find(|file| file.name == PAGE);
    let tag = format!("\"{:08x}\"", crc32fast::hash(file.map_or(ABSENT.as_bytes(), |f| f.plain)));
    let is_known = headers.get(header::IF_NONE_MATCH).is_some_and(|known| known == tag.as_str());
    let mut response = match file {
        _ if is_known => StatusCode::NOT_MODIFIED.into_response(),
        Some(file) => send(file, headers),
        None => ([(header::CONTENT_TYPE, "text/html; charset=utf-8")], ABSENT).into_response(),
    };
    // Kept, and asked about each time: a new server has a new page.
    let fixed = [
        (header::CACHE_CONTROL, "no-cache"),
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    for (name, value) in fixed {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    if let Ok(tag) = HeaderValue::from_str(&tag) {
        response.headers_mut().insert(header::ETAG, tag);
    }
    response
}

/// A file in the form that takes the fewest bytes of those that the client can read.
fn send(file: &File, headers: &HeaderMap) -> Response {
    let fixed = |name: HeaderName, value| (name, HeaderValue::from_static(value));
    let base = [
        fixed(header::CONTENT_TYPE, file.media),
        fixed(header::VARY, "accept-encoding"),
        fixed(header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    ];
    let packed = [("br", file.brotli), ("gzip", file.gzip)];
    let found = packed.into_iter().find(|(name, body)| !body.is_empty() && takes(headers, name));
    match found {
        Some((name, body)) => (base, [fixed(header::CONTENT_ENCODING, name)], body).into_response(),
        None => (base, file.plain).into_response(),
    }
}

/// Whether a client says that it can read a coding.
fn takes(headers: &HeaderMap, coding: &str) -> bool {
    let values = headers.get_all(header::ACCEPT_ENCODING).iter();
    let mut entries = values.flat_map(|value| value.to_str().unwrap_or_default().split(','));
    entries.any(|entry| {
        let mut parts = entry.split(';').map(str::trim);
        let is_named = parts.next().is_some_and(|name| name.eq_ignore_ascii_case(coding));
        let weight = parts.find_map(|part| part.strip_prefix("q=")?.parse::<f32>().ok());
        is_named && weight.is_none_or(|weight| weight > 0.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(name: HeaderName, value: &'static str) -> HeaderMap {
        HeaderMap::from_iter([(name, HeaderValue::from_static(value))])
    }

    const FILE: File =
        File { name: "a.js", media: "text/javascript", plain: b"plain", gzip: b"gz", brotli: b"" };

    #[test]
    fn a_file_comes_in_a_form_that_the_client_reads() {
        let form = |value| {
            let response = send(&FILE, &headers(header::ACCEPT_ENCODING, value));
            let coding = response.headers().get(header::CONTENT_ENCODING);
            coding.map_or("", |coding| coding.to_str().expect("a word")).to_owned()
        };
        assert_eq!(form("gzip, deflate, br, zstd"), "gzip", "there is no brotli of it");
        assert_eq!(form("deflate;q=0.5, GZIP;q=0.1"), "gzip");
        for without in ["", "identity", "gzip;q=0", "x-gzip", "br"] {
            assert_eq!(form(without), "", "{without}");
        }
    }

    #[tokio::test]
    async fn browsers_get_a_page_and_everybody_else_json() {
        let media = async |accept: &'static str| {
            let response = root(headers(header::ACCEPT, accept)).await.expect("an answer");
            let media =
                response.headers()[header::CONTENT_TYPE].to_str().expect("a word").to_owned();
            (response.status(), media)
        };
        let chrome = "text/html,application/xhtml+xml,application/xml;q=0.9,image/avif,*/*;q=0.8";
        assert_eq!(media(chrome).await.1, "text/html; charset=utf-8");
        for other in ["*/*", "application/json", "image/png", "application/json, text/html;q=0.9"] {
            assert_eq!(media(other).await, (StatusCode::OK, "application/json".into()), "{other}");
        }
        let response = root(headers(header::ACCEPT, chrome)).await.expect("a page");
        let mut again = headers(header::ACCEPT, chrome);
        again.insert(header::IF_NONE_MATCH, response.headers()[header::ETAG].clone());
        assert_eq!(root(again).await.expect("known").status(), StatusCode::NOT_MODIFIED);
        let policy = response.headers()[header::CONTENT_SECURITY_POLICY].to_str().expect("text");
        assert!(!policy.contains("http") && !policy.contains("unsafe"), "{policy}");
    }

    #[test]
    fn the_page_is_light_and_names_no_other_host() {
        let weight: usize = FILES.iter().map(|file| file.gzip.len().max(1)).sum();
        assert!(weight < 1_000_000, "{weight} bytes");
        for file in FILES.iter().filter(|file| file.name.ends_with(".html")) {
            let text = String::from_utf8_lossy(file.plain);
            assert!(!text.contains("://"), "{}", file.name);
        }
    }
}
