//! Settings of a server: the file as written, and the checked values that the code runs on.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{
    AccessConfig, AuthSettings, BackendChoice, BusConfig, BusSettings, EncoderSettings,
    FrameLimits, KeepConfig, LimitSettings, LogSettings, MapConfig, MapSettings, Ros2Config,
    Ros2Settings, Schedule, StorageSettings, TlsSettings,
};
use crate::error::{Error, Result};

/// The file that documents every key. It is the lowest layer of every configuration.
pub const DEFAULT_FILE: &str = include_str!("../../deploy/orenx.toml");

/// A whole settings file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    pub server: ServerSettings,
    pub auth: AuthSettings,
    pub tls: TlsSettings,
    pub limits: LimitSettings,
    pub log: LogSettings,
    #[serde(rename = "zenoh")]
    pub bus: BusSettings,
    pub ros2: Ros2Settings,
    pub storage: StorageSettings,
    pub encoder: EncoderSettings,
    pub map: MapSettings,
    pub gpu: GpuSettings,
}

/// `[server]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ServerSettings {
    pub grpc: String,
    pub http: String,
    pub insecure_public: bool,
    pub cors_origins: Vec<String>,
    pub query_threads: u32,
    pub max_points: u32,
    pub max_pixels: u32,
    pub max_maps: u32,
    pub lane_frames: u32,
    pub lanes: u32,
    pub queued_mib: u32,
    pub max_frame_age_s: f64,
    pub publish_interval_ms: u32,
    pub trainer_nice: u32,
}

/// `[gpu]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GpuSettings {
    pub memory_mib: u32,
}

impl Default for GpuSettings {
    fn default() -> Self {
        Self { memory_mib: 2048 }
    }
}

impl Default for Settings {
    /// A server's map follows the stream; everything else is as for `orenx map`.
    fn default() -> Self {
        Self {
            server: ServerSettings::default(),
            auth: AuthSettings::default(),
            tls: TlsSettings::default(),
            limits: LimitSettings::default(),
            log: LogSettings::default(),
            bus: BusSettings::default(),
            ros2: Ros2Settings::default(),
            storage: StorageSettings::default(),
            encoder: EncoderSettings::default(),
            map: MapSettings { schedule: Schedule::Adaptive, ..MapSettings::default() },
            gpu: GpuSettings::default(),
        }
    }
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self {
            grpc: "127.0.0.1:7610".into(),
            http: "127.0.0.1:7611".into(),
            insecure_public: false,
            cors_origins: Vec::new(),
            query_threads: 0,
            max_points: 1_000_000,
            max_pixels: 4_000_000,
            max_maps: 16,
            lane_frames: 2,
            lanes: 64,
            queued_mib: 512,
            max_frame_age_s: 2.0,
            publish_interval_ms: 33,
            trainer_nice: 19,
        }
    }
}

/// Checked settings of a server, without those of its map.
#[derive(Debug, Clone, PartialEq)]
pub struct ServerConfig {
    pub grpc: SocketAddr,
    /// `None`: no HTTP.
    pub http: Option<SocketAddr>,
    /// Who may ask, and how much.
    pub access: AccessConfig,
    /// All settings as they were written, for who asks for them.
    pub written: Arc<Settings>,
    /// At least one.
    pub query_threads: usize,
    pub max_points: usize,
    pub max_pixels: usize,
    pub max_maps: usize,
    /// What maps are made with, as written.
    pub map: MapSettings,
    /// Frames that may wait for each sensor.
    pub lane_frames: usize,
    /// Sensors with waiting frames at a time.
    pub lanes: usize,
    /// Memory of all waiting frames, bytes.
    pub queued_bytes: usize,
    /// How much older than the newest of its sensor a frame may be.
    pub max_frame_age: Duration,
    pub publish_interval: Duration,
    /// The nice value of the trainer threads, at most 19.
    pub trainer_nice: u8,
    pub backend: BackendChoice,
    /// Memory of the GPU that a map's rows may take, MiB.
    pub gpu_memory_mib: u32,
    /// The folder that holds the maps; `None` keeps them in memory.
    pub storage: Option<PathBuf>,
    pub keep: KeepConfig,
    pub encoder: EncoderSettings,
    /// `None`: no Zenoh.
    pub bus: Option<BusConfig>,
    /// `None`: no ROS 2. With it there is a `bus`.
    pub ros2: Option<Ros2Config>,
}

impl ServerConfig {
    /// Checks a settings file, its map included.
    pub fn from_settings(settings: &Settings) -> Result<(Self, MapConfig)> {
        let server = &settings.server;
        let query_threads = match within("query_threads", server.query_threads, 0..=256)? {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            threads => threads,
        };
        let lane_frames = within("lane_frames", server.lane_frames, 1..=1024)?;
        let lanes = within("lanes", server.lanes, 1..=4096)?;
        let queued_bytes = within("queued_mib", server.queued_mib, 1..=1 << 20)? << 20;
        let frames = FrameLimits {
            sensors: lanes,
            bytes: queued_bytes,
            live: lane_frames,
            recorded: lane_frames,
        };
        let config = Self {
            grpc: address("grpc", &server.grpc, 7610)?,
            http: match server.http.as_str() {
                "" => None,
                text => Some(address("http", text, 7611)?),
            },
            access: AccessConfig::new(
                &settings.auth,
                &settings.tls,
                settings.limits,
                &server.cors_origins,
            )?,
            written: Arc::new(settings.clone()),
            query_threads,
            // The reply of the largest question must fit in one message.
            max_points: within("max_points", server.max_points, 1..=2_000_000)?,
            // A colour in f32, 12 bytes a pixel, must fit in an answer.
            max_pixels: within("max_pixels", server.max_pixels, 1..=4_800_000)?,
            max_maps: within("max_maps", server.max_maps, 1..=1024)?,
            map: settings.map.clone(),
            lane_frames,
            lanes,
            queued_bytes,
            max_frame_age: max_frame_age(server.max_frame_age_s)?,
            publish_interval: Duration::from_millis(within(
                "publish_interval_ms",
                server.publish_interval_ms,
                0..=10_000,
            )? as u64),
            backend: settings.map.backend,
            gpu_memory_mib: gpu_memory_mib(settings.gpu.memory_mib)?,
            trainer_nice: within("trainer_nice", server.trainer_nice, 0..=19)? as u8,
            storage: (!settings.storage.path.as_os_str().is_empty())
                .then(|| settings.storage.path.clone()),
            keep: KeepConfig::from_settings(&settings.storage)?,
            encoder: settings.encoder.clone(),
            bus: BusConfig::from_settings(&settings.bus, frames)?,
            ros2: Ros2Config::from_settings(&settings.ros2)?,
        };
        config.check_ros2()?;
        config.check_ports()?;
        config.encoder.check()?;
        let map = MapConfig::from_settings(&settings.map).map_err(|e| match e {
            Error::InvalidArgument { field, problem } => {
                Error::InvalidArgument { field: format!("map.{field}"), problem }
            }
            other => other,
        })?;
        Ok((config, map))
    }
}

/// An address of `[server]`.
fn address(key: &str, text: &str, port: u16) -> Result<SocketAddr> {
    text.parse().map_err(|_| {
        let problem = format!("'{text}' is no address and port, as in 127.0.0.1:{port}");
        Error::invalid(format!("server.{key}"), problem)
    })
}

/// A number of `[server]` within its range.
fn within(key: &str, value: u32, range: std::ops::RangeInclusive<u32>) -> Result<usize> {
    if range.contains(&value) {
        return Ok(value as usize);
    }
    let (low, high) = range.into_inner();
    let problem = format!("{value} must be within {low}..={high}");
    Err(Error::invalid(format!("server.{key}"), problem))
}

impl ServerConfig {
    /// Nobody gets in from the network who does not say who they are, unless that is wanted.
    fn check_ports(&self) -> Result<()> {
        if self.written.server.insecure_public {
            return Ok(());
        }
        self.access.check_port("grpc", self.grpc)?;
        self.http.map_or(Ok(()), |http| self.access.check_port("http", http))
    }

    fn check_ros2(&self) -> Result<()> {
        if self.ros2.is_some() && self.bus.is_none() {
            let problem = "needs Zenoh: say where the bridge is in zenoh.connect";
            return Err(Error::invalid("ros2.bridge", problem));
        }
        Ok(())
    }
}

/// Checks `gpu.memory_mib`.
fn gpu_memory_mib(mib: u32) -> Result<u32> {
    if (64..=1 << 20).contains(&mib) {
        return Ok(mib);
    }
    Err(Error::invalid("gpu.memory_mib", format!("{mib} must be within 64..=1048576")))
}

fn max_frame_age(seconds: f64) -> Result<Duration> {
    if !(0.0..=86_400.0).contains(&seconds) {
        return Err(Error::invalid(
            "server.max_frame_age_s",
            format!("{seconds} must be within 0..=86400 s"),
        ));
    }
    Ok(Duration::from_secs_f64(seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_compiled_in_file_is_the_default() {
        let parsed: Settings = toml::from_str(DEFAULT_FILE).expect("it parses");
        assert_eq!(parsed, Settings::default());
        assert_eq!(Settings::parse("", "empty").expect("nothing is fine"), Settings::default());
        ServerConfig::from_settings(&parsed).expect("the defaults pass their checks");
    }

    /// The keys of a section, out of the error that lists them: those of optional values too.
    fn keys(section: &str) -> Vec<String> {
        let text = format!("[{section}]\nno_such_key = 1\n");
        let error = toml::from_str::<Settings>(&text).expect_err("unknown key").to_string();
        let expected = error.split_once("expected").expect("lists what is expected").1;
        expected.split('`').skip(1).step_by(2).map(str::to_owned).collect()
    }

    #[test]
    fn the_compiled_in_file_mentions_every_key_in_its_section() {
        for (section, at_least) in [
            ("server", 14),
            ("auth", 1),
            ("tls", 3),
            ("limits", 3),
            ("log", 3),
            ("zenoh", 10),
            ("ros2", 31),
            ("storage", 6),
            ("encoder", 4),
            ("map", 10),
        ] {
            let (_, rest) = DEFAULT_FILE.split_once(&format!("\n[{section}]\n")).expect(section);
            let body = rest.split("\n[").next().unwrap_or_default();
            let keys = keys(section);
            assert!(keys.len() >= at_least, "{section}: {keys:?}");
            for key in keys {
                let is_key = |line: &str| {
                    line.trim_start_matches("# ").split_once(" = ").is_some_and(|(k, _)| k == key)
                };
                assert!(body.lines().any(is_key), "[{section}] lacks {key}");
            }
        }
    }

    #[test]
    fn a_section_keeps_the_defaults_of_a_server() {
        let settings = Settings::parse("[map]\nprofile = \"full\"\n", "test").expect("fine");
        assert_eq!(settings.map.schedule, Schedule::Adaptive);
        assert_eq!(settings.map.profile, crate::config::Profile::Full);
    }

    #[test]
    fn http_is_on_loopback_unless_it_is_off() {
        let http = |text: &str| {
            let settings = Settings::parse(text, "test").expect("parses");
            ServerConfig::from_settings(&settings).expect("good").0.http
        };
        assert_eq!(http(""), Some("127.0.0.1:7611".parse().expect("an address")));
        assert_eq!(http("[server]\nhttp = \"\"\n"), None);
    }

    #[test]
    fn a_typo_is_named_with_its_line() {
        let error = Settings::parse("[server]\nlanes = 3\nlane_frame = 2\n", "my.toml")
            .expect_err("unknown key")
            .to_string();
        for part in ["my.toml", "line 3", "lane_frame"] {
            assert!(error.contains(part), "{part} in {error}");
        }
    }

    #[test]
    fn values_out_of_range_are_named() {
        for (text, key) in [
            ("[server]\nlanes = 0\n", "server.lanes"),
            ("[server]\ngrpc = \"here\"\n", "server.grpc"),
            ("[server]\nhttp = \"7611\"\n", "server.http"),
            ("[server]\ntrainer_nice = 20\n", "server.trainer_nice"),
            ("[server]\nmax_points = 4000000\n", "server.max_points"),
            ("[server]\nmax_pixels = 0\n", "server.max_pixels"),
            ("[server]\nmax_frame_age_s = -1.0\n", "server.max_frame_age_s"),
            ("[encoder]\nkind = \"static\"\n", "encoder.folder"),
            ("[map]\nr0_m = 5.0\n", "map.r0_m"),
            ("[map]\ncolor_degree = 4\n", "map.color_degree: at most 3"),
        ] {
            let settings = Settings::parse(text, "test").expect("parses");
            let error = ServerConfig::from_settings(&settings).expect_err(key).to_string();
            assert!(error.starts_with(key), "{error}");
        }
    }
}
