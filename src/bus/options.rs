//! The configuration of Zenoh that our settings mean.

use std::path::Path;

use zenoh::config::{Config, EndPoint};

use crate::config::{BusConfig, BusMode};
use crate::error::{Error, Result};
use crate::wire::MAX_MESSAGE_BYTES;

/// What stands around the largest message, bytes: key, encoding, attachment.
const ENVELOPE_BYTES: usize = 1 << 20;

/// How long one attempt to reach a router may take, ms: long enough for a TLS handshake over a bad
/// line, and not much longer than somebody waits for a server to end.
const CONNECT_MS: &str = "4000";

/// The file, or what we take without one, and our settings over it.
pub(super) fn options(bus: &BusConfig) -> Result<Config> {
    let mut options = match &bus.file {
        Some(path) => from_file(path)?,
        None => ours()?,
    };
    if let Some(mode) = bus.mode {
        set(&mut options, "zenoh.mode", "mode", &json(mode.name()))?;
    }
    for (field, key, endpoints) in [
        ("zenoh.connect", "connect/endpoints", &bus.connect),
        ("zenoh.listen", "listen/endpoints", &bus.listen),
    ] {
        check_endpoints(field, endpoints)?;
        if !endpoints.is_empty() {
            set(&mut options, field, key, &serde_json::json!(endpoints).to_string())?;
        }
    }
    if is_client(&options) {
        set(&mut options, "zenoh", "connect/timeout_ms", CONNECT_MS)?;
        // And what we do not listen for is not listened for.
        if bus.listen.is_empty() {
            set(&mut options, "zenoh.mode", "listen/endpoints", "[]")?;
        }
    }
    Ok(options)
}

/// Whether the session is one connection to a router.
pub(super) fn is_client(options: &Config) -> bool {
    options.get_json("mode").is_ok_and(|mode| mode == json(BusMode::Client.name()))
}

/// Zenoh's defaults, but nothing is looked for in the network, no message may be larger than one of
/// ours, and a router that went away is found again soon.
fn ours() -> Result<Config> {
    let mut options = Config::default();
    let largest = (MAX_MESSAGE_BYTES + ENVELOPE_BYTES).to_string();
    for (key, value) in [
        ("scouting/multicast/enabled", "false"),
        ("listen/endpoints", "[]"),
        (
            "connect/retry",
            r#"{"period_init_ms":250,"period_max_ms":2000,"period_increase_factor":2}"#,
        ),
        ("transport/link/rx/max_message_size", &largest),
    ] {
        set(&mut options, "zenoh", key, value)?;
    }
    Ok(options)
}

fn from_file(path: &Path) -> Result<Config> {
    let named =
        |problem: String| Error::invalid("zenoh.config", format!("{}: {problem}", path.display()));
    // Zenoh tells a missing file as one that has no known extension.
    std::fs::metadata(path).map_err(|e| named(e.to_string()))?;
    Config::from_file(path).map_err(|e| named(e.to_string()))
}

fn check_endpoints(field: &str, endpoints: &[String]) -> Result<()> {
    for (at, endpoint) in endpoints.iter().enumerate() {
        endpoint.parse::<EndPoint>().map_err(|_| {
            let problem = format!("'{endpoint}' is no endpoint, as in tcp/127.0.0.1:7447");
            Error::invalid(format!("{field}[{at}]"), problem)
        })?;
    }
    Ok(())
}

fn set(options: &mut Config, field: &str, key: &str, value: &str) -> Result<()> {
    options
        .insert_json5(key, value)
        .map_err(|e| Error::invalid(field, format!("{key} cannot be {value}: {e}")))
}

fn json(text: &str) -> String {
    serde_json::json!(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{BusSettings, FrameLimits};

    fn of(change: impl FnOnce(&mut BusSettings)) -> Result<Config> {
        let mut settings = BusSettings::default();
        change(&mut settings);
        let frames = FrameLimits { sensors: 1, bytes: 1, live: 1, recorded: 1 };
        options(&BusConfig::from_settings(&settings, frames).expect("good").expect("on"))
    }

    fn read(options: &Config, key: &str) -> String {
        options.get_json(key).unwrap_or_else(|_| "none".into())
    }

    #[test]
    fn without_a_file_nothing_is_looked_for_in_the_network() {
        let client = of(|s| s.connect = vec!["tcp/127.0.0.1:7447".into()]).expect("good");
        assert_eq!(read(&client, "mode"), "\"client\"");
        assert_eq!(read(&client, "scouting/multicast/enabled"), "false");
        assert_eq!(read(&client, "listen/endpoints"), "[]");
        assert_eq!(read(&client, "connect/timeout_ms"), CONNECT_MS);
        let peer = of(|s| s.listen = vec!["tcp/127.0.0.1:0".into()]).expect("good");
        assert_eq!(read(&peer, "mode"), "\"peer\"");
        assert!(read(&peer, "listen/endpoints").contains("tcp/127.0.0.1:0"));
    }

    #[test]
    fn a_file_says_the_rest() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("zenoh.json5");
        let text = r#"{ mode: "peer", queries_default_timeout: 1234, // ours
            connect: { endpoints: ["tcp/10.0.0.1:7447"] } }"#;
        std::fs::write(&path, text).expect("written");
        let all = of(|s| s.config = path.clone()).expect("good");
        assert_eq!(read(&all, "queries_default_timeout"), "1234");
        assert!(read(&all, "connect/endpoints").contains("10.0.0.1"));
        assert_eq!(read(&all, "mode"), "\"peer\"");
        let over = of(|s| {
            s.config = path.clone();
            s.mode = "client".into();
            s.connect = vec!["tcp/10.0.0.2:7447".into()];
        });
        let over = over.expect("good");
        assert!(read(&over, "connect/endpoints").contains("10.0.0.2"));
        assert_eq!(read(&over, "mode"), "\"client\"");
    }

    #[test]
    fn the_examples_are_good_ones() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/zenoh");
        for (name, mode) in [("client", "\"client\""), ("router", "\"router\"")] {
            let path = folder.join(name).with_extension("json5");
            let example = of(|s| s.config = path).expect(name);
            assert_eq!(read(&example, "mode"), mode);
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let error = |change: &dyn Fn(&mut BusSettings)| {
            of(|settings| change(settings)).expect_err("refused").to_string()
        };
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("zenoh.json5");
        let told = error(&|s| s.config = path.clone());
        assert!(told.starts_with("zenoh.config: ") && told.contains("zenoh.json5"), "{told}");
        std::fs::write(&path, "{ mode: \"king\" }").expect("written");
        let told = error(&|s| s.config = path.clone());
        assert!(told.starts_with("zenoh.config: "), "{told}");
        let told = error(&|s| s.connect = vec!["tcp/a:1".into(), "robot".into()]);
        assert!(told.starts_with("zenoh.connect[1]: 'robot'"), "{told}");
    }
}
