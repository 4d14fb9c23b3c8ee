//! Settings of the Zenoh session: where it connects, what its keys begin with, what bounds it.

use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Characters that mean something in key expressions and selectors, and `@`, which begins chunks that
/// no wildcard matches.
const RESERVED: [char; 6] = ['*', '$', '?', '#', '@', '/'];
/// The longest prefix, bytes: it is repeated in every key.
const MAX_PREFIX_BYTES: usize = 256;
/// The longest chunk of a key, bytes, as robots and sensors may have names.
const MAX_CHUNK_BYTES: usize = 128;
/// Endpoints of each kind.
const MAX_ENDPOINTS: usize = 64;

/// `[zenoh]`: off, unless it says where to connect, where to listen, or which file says so.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BusSettings {
    pub connect: Vec<String>,
    pub listen: Vec<String>,
    pub mode: String,
    pub config: PathBuf,
    pub prefix: String,
    pub queue_frames: u32,
    pub max_queries: u32,
    pub query_timeout_s: f64,
    pub status_interval_ms: u32,
}

impl Default for BusSettings {
    fn default() -> Self {
        Self {
            connect: Vec::new(),
            listen: Vec::new(),
            mode: String::new(),
            config: PathBuf::new(),
            prefix: "orenx".into(),
            queue_frames: 8,
            max_queries: 64,
            query_timeout_s: 10.0,
            status_interval_ms: 1000,
        }
    }
}

/// What a node is in a Zenoh network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusMode {
    /// One connection, to a router.
    Client,
    /// Listens, and connects to other peers and routers.
    Peer,
    /// Passes on what others say.
    Router,
}

impl BusMode {
    /// The word of Zenoh's configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Client => "client",
            Self::Peer => "peer",
            Self::Router => "router",
        }
    }
}

/// What bounds the frames that wait to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameLimits {
    /// Sensors at a time.
    pub sensors: usize,
    /// Memory of all waiting frames, bytes.
    pub bytes: usize,
    /// Frames of one live sensor.
    pub live: usize,
    /// Frames of one sensor that sends a recording.
    pub recorded: usize,
}

/// Checked settings of the Zenoh session. Endpoints and the file are checked by who opens it.
#[derive(Debug, Clone, PartialEq)]
pub struct BusConfig {
    pub connect: Vec<String>,
    pub listen: Vec<String>,
    /// `None`: what the file says.
    pub mode: Option<BusMode>,
    /// A Zenoh configuration, JSON5, on which the rest is laid.
    pub file: Option<PathBuf>,
    /// What every key begins with, without outer slashes.
    pub prefix: String,
    pub frames: FrameLimits,
    /// Questions that are worked on at a time.
    pub max_queries: usize,
    /// How long a question may take that does not say itself.
    pub query_timeout: Duration,
    /// The time between two publications of the map's state.
    pub status_interval: Duration,
}

impl BusConfig {
    /// Checks `[zenoh]`; `None` where it is off. What `frames` says for live sensors holds here too.
    pub fn from_settings(settings: &BusSettings, frames: FrameLimits) -> Result<Option<Self>> {
        check_prefix(&settings.prefix)?;
        for (key, endpoints) in [("connect", &settings.connect), ("listen", &settings.listen)] {
            if endpoints.len() > MAX_ENDPOINTS {
                return Err(invalid(key, format!("at most {MAX_ENDPOINTS} endpoints")));
            }
        }
        let file = (!settings.config.as_os_str().is_empty()).then(|| settings.config.clone());
        let config = Self {
            mode: mode(settings)?,
            connect: settings.connect.clone(),
            listen: settings.listen.clone(),
            file,
            prefix: settings.prefix.clone(),
            frames: FrameLimits {
                recorded: within("queue_frames", settings.queue_frames, 1, 1024)? as usize,
                ..frames
            },
            max_queries: within("max_queries", settings.max_queries, 1, 4096)? as usize,
            query_timeout: query_timeout(settings.query_timeout_s)?,
            status_interval: Duration::from_millis(
                within("status_interval_ms", settings.status_interval_ms, 10, 3_600_000)?.into(),
            ),
        };
        let is_on =
            config.file.is_some() || !config.connect.is_empty() || !config.listen.is_empty();
        Ok(is_on.then_some(config))
    }
}

/// What `mode` says. Without a file that says more, who listens is a peer and others are clients.
fn mode(settings: &BusSettings) -> Result<Option<BusMode>> {
    match settings.mode.as_str() {
        "client" => Ok(Some(BusMode::Client)),
        "peer" => Ok(Some(BusMode::Peer)),
        "router" => Ok(Some(BusMode::Router)),
        "" if !settings.config.as_os_str().is_empty() => Ok(None),
        "" if settings.listen.is_empty() => Ok(Some(BusMode::Client)),
        "" => Ok(Some(BusMode::Peer)),
        other => Err(invalid("mode", format!("'{other}' is none of client, peer, router"))),
    }
}

fn check_prefix(prefix: &str) -> Result<()> {
    if prefix.len() > MAX_PREFIX_BYTES {
        return Err(invalid("prefix", format!("at most {MAX_PREFIX_BYTES} bytes")));
    }
    prefix.split('/').try_for_each(|chunk| check_chunk("zenoh.prefix", chunk))
}

/// Checks one part of a key, between slashes; `field` names it in errors.
pub fn check_chunk(field: &str, chunk: &str) -> Result<()> {
    if chunk.is_empty() {
        return Err(Error::invalid(field, "a part of it is empty"));
    }
    if chunk.len() > MAX_CHUNK_BYTES {
        return Err(Error::invalid(field, format!("a part has at most {MAX_CHUNK_BYTES} bytes")));
    }
    match chunk.chars().find(|c| RESERVED.contains(c) || c.is_control()) {
        Some(found) => Err(Error::invalid(
            field,
            format!("{found:?} must not be part of a key, nor any of * $ ? # @ and no control"),
        )),
        None => Ok(()),
    }
}

fn query_timeout(seconds: f64) -> Result<Duration> {
    if !(0.001..=3600.0).contains(&seconds) {
        return Err(invalid("query_timeout_s", format!("{seconds} must be within 0.001..=3600 s")));
    }
    Ok(Duration::from_secs_f64(seconds))
}

fn within(key: &str, value: u32, low: u32, high: u32) -> Result<u32> {
    if (low..=high).contains(&value) {
        return Ok(value);
    }
    Err(invalid(key, format!("{value} must be within {low}..={high}")))
}

fn invalid(key: &str, problem: impl Into<String>) -> Error {
    Error::invalid(format!("zenoh.{key}"), problem)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: FrameLimits = FrameLimits { sensors: 64, bytes: 1 << 29, live: 2, recorded: 1 };

    fn checked(change: impl FnOnce(&mut BusSettings)) -> Result<Option<BusConfig>> {
        let mut settings = BusSettings::default();
        change(&mut settings);
        BusConfig::from_settings(&settings, LIMITS)
    }

    #[test]
    fn nothing_is_opened_unasked() {
        assert_eq!(checked(|_| {}).expect("good"), None);
        assert_eq!(checked(|s| s.prefix = "fleet/a".into()).expect("good"), None);
    }

    #[test]
    fn what_is_given_says_what_a_node_is() {
        let mode = |change: fn(&mut BusSettings)| {
            checked(change).expect("good").expect("on").mode.map(BusMode::name)
        };
        let tcp = || vec!["tcp/127.0.0.1:7447".to_owned()];
        assert_eq!(mode(|s| s.connect = vec!["tcp/127.0.0.1:7447".into()]), Some("client"));
        assert_eq!(mode(|s| s.listen = vec!["tcp/127.0.0.1:0".into()]), Some("peer"));
        assert_eq!(mode(|s| s.config = "zenoh.json5".into()), None);
        let router = checked(|s| (s.listen, s.mode) = (tcp(), "router".into()));
        assert_eq!(router.expect("good").expect("on").mode, Some(BusMode::Router));
    }

    #[test]
    fn wrong_values_are_named() {
        type Change = fn(&mut BusSettings);
        let cases: [(Change, &str); 9] = [
            (|s| s.prefix = "a//b".into(), "zenoh.prefix: a part"),
            (|s| s.prefix = "/orenx".into(), "zenoh.prefix: a part"),
            (|s| s.prefix = "".into(), "zenoh.prefix: a part"),
            (|s| s.prefix = "a/*".into(), "zenoh.prefix: '*'"),
            (|s| s.prefix = "@a".into(), "zenoh.prefix: '@'"),
            (|s| s.mode = "cluster".into(), "zenoh.mode: 'cluster'"),
            (|s| s.max_queries = 0, "zenoh.max_queries: 0"),
            (|s| s.query_timeout_s = f64::NAN, "zenoh.query_timeout_s: NaN"),
            (|s| s.connect = vec!["tcp/a:1".into(); 65], "zenoh.connect: at most 64"),
        ];
        for (change, expected) in cases {
            let error = checked(change).expect_err(expected).to_string();
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
