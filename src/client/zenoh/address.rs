//! URLs of Zenoh networks.

use crate::config::{BusConfig, BusSettings, FrameLimits};
use crate::error::{Error, Result};

/// The protocols that are compiled in and have a host and a port.
const PROTOCOLS: [&str; 3] = ["tcp", "udp", "tls"];

/// What `url` means: `zenoh+tcp://host:port[/prefix]`, or `zenoh+file:PATH[#prefix]`.
pub(super) fn read_address(url: &str) -> Result<BusConfig> {
    let wrong = |problem: &str| Error::invalid("URL", format!("'{url}': {problem}"));
    let mut settings = BusSettings::default();
    let rest = url.strip_prefix("zenoh+").ok_or_else(|| wrong("is no URL of Zenoh"))?;
    let prefix = match rest.strip_prefix("file:") {
        Some(file) => {
            let (path, prefix) = file.split_once('#').unwrap_or((file, ""));
            settings.config = path.into();
            prefix
        }
        None => {
            let try_tcp = || wrong("try zenoh+tcp://host:7447");
            let (protocol, rest) = rest.split_once("://").ok_or_else(try_tcp)?;
            let (host, prefix) = rest.split_once('/').unwrap_or((rest, ""));
            if !PROTOCOLS.contains(&protocol) || host.is_empty() {
                return Err(try_tcp());
            }
            settings.connect = vec![format!("{protocol}/{host}")];
            prefix
        }
    };
    if !prefix.is_empty() {
        settings.prefix = prefix.trim_end_matches('/').into();
    }
    // A client takes no frames.
    let frames = FrameLimits { sensors: 0, bytes: 0, live: 0, recorded: 0 };
    BusConfig::from_settings(&settings, frames)?.ok_or_else(|| wrong("names no file"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_or_refused() {
        let read = |url: &str| {
            let config = read_address(url).expect(url);
            (config.connect, config.prefix, config.file)
        };
        let tcp = |host: &str| vec![format!("tcp/{host}")];
        assert_eq!(read("zenoh+tcp://robot:7447"), (tcp("robot:7447"), "orenx".into(), None));
        assert_eq!(read("zenoh+tcp://[::1]:1/a/b/"), (tcp("[::1]:1"), "a/b".into(), None));
        let file = Some("/etc/my.json5".into());
        assert_eq!(read("zenoh+file:/etc/my.json5#fleet"), (vec![], "fleet".into(), file));
        for (wrong, part) in [
            ("zenoh+quic://a:1", "try zenoh+tcp"),
            ("zenoh+tcp:a:1", "try zenoh+tcp"),
            ("zenoh+tcp:///a", "try zenoh+tcp"),
            ("zenoh+file:", "names no file"),
            ("zenoh+tcp://a:1/b/*", "zenoh.prefix"),
            ("tcp://a:1", "is no URL of Zenoh"),
        ] {
            let error = read_address(wrong).expect_err(wrong).to_string();
            assert!(error.contains(part), "{error}");
        }
    }
}
