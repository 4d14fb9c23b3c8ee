//! The demo's questions over HTTP, as lines for `curl`, and their answers.

use anyhow::{Context, ensure};
use glam::Vec3;
use serde_json::{Value, json};

use crate::client::HttpClient;
use crate::map::{PointAnswers, State};
use crate::service::DEFAULT_MAP;

/// The paths to get.
const PATHS: [&str; 3] = ["/v1/maps", "/v1/maps/default/stats", "/metrics"];

fn points_path() -> String {
    format!("/v1/maps/{DEFAULT_MAP}/query/points")
}

/// The JSON of a question about every place.
pub(super) fn body(places: impl Iterator<Item = Vec3>) -> String {
    // As decimal places, so that they read as they are printed elsewhere.
    let rounded = |n: f32| (f64::from(n) * 100.0).round() / 100.0;
    let points: Vec<[f64; 3]> = places.map(|p| p.to_array().map(rounded)).collect();
    json!({ "points_m": points }).to_string()
}

/// Lines to paste.
pub(super) fn lines(url: &str, body: &str) -> String {
    let post = post(url, &points_path(), body);
    let gets = PATHS.iter().map(|path| format!("  curl -s {url}{path}"));
    gets.chain([post]).collect::<Vec<_>>().join("\n")
}

/// A line that posts JSON.
pub(super) fn post(url: &str, path: &str, body: &str) -> String {
    format!("  curl -s {url}{path} -H 'content-type: application/json' -d '{body}'")
}

/// Asks what the lines ask; the answers about the places.
pub(super) async fn ask(url: &str, body: String) -> anyhow::Result<PointAnswers> {
    let client = HttpClient::new(url)?;
    for path in PATHS {
        let answer = client.get(path).await?;
        ensure!(!answer.is_empty(), "{path} says nothing");
    }
    let answer = client.post_json(&points_path(), body).await?;
    let answer: Value = serde_json::from_slice(&answer)?;
    let column = |name: &str| answer[name].as_array().with_context(|| format!("no {name}"));
    let unknown = u64::from(State::Unknown as u8);
    Ok(PointAnswers {
        distance: column("distance_m")?
            .iter()
            .map(|d| d.as_f64().map_or(f32::NAN, |d| d as f32))
            .collect(),
        state: column("state")?.iter().map(|s| s.as_u64().unwrap_or(unknown) as u8).collect(),
        ..PointAnswers::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_printed_is_what_is_asked() {
        let body = body([Vec3::new(0.1, -2.25, 1.0), Vec3::ZERO].into_iter());
        assert_eq!(body, r#"{"points_m":[[0.1,-2.25,1.0],[0.0,0.0,0.0]]}"#);
        let lines = lines("http://127.0.0.1:7611", &body);
        assert_eq!(lines.lines().count(), 4);
        let path = "/v1/maps/default/query/points";
        assert!(lines.contains(path) && lines.ends_with(&format!("'{body}'")), "{lines}");
    }
}
