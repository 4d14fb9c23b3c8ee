//! What the process says, as it goes along: to stderr, as text or JSON, at a level that can be changed.

use std::sync::OnceLock;

use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::reload::{self, Handle};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry, fmt};

use crate::config::{LogFormat, LogSettings};
use crate::error::{Error, Result};

/// Goes over the settings.
const VARIABLE: &str = "ORENX_LOG";
const LEVELS: [&str; 6] = ["off", "error", "warn", "info", "debug", "trace"];
/// The longest list of levels, bytes.
const MAX_BYTES: usize = 1024;

/// What lets messages through. A process has one log, and so one of these.
static FILTER: OnceLock<Handle<EnvFilter, Registry>> = OnceLock::new();

pub(super) type Writer = Box<dyn Layer<Filtered> + Send + Sync>;
type Filtered = tracing_subscriber::layer::Layered<reload::Layer<EnvFilter, Registry>, Registry>;

/// Logs warnings and worse to stderr, or what `ORENX_LOG` asks for (`info`, `orenx::engine=debug`).
pub fn log_to_stderr() {
    let filter = EnvFilter::try_from_env(VARIABLE).unwrap_or_else(|_| EnvFilter::new("warn"));
    start(filter, writer(LogFormat::Text), None);
}

/// Logs as the settings say, with `ORENX_LOG` over them. Within a runtime, if spans go to a collector.
pub fn log_as(settings: &LogSettings) -> Result<()> {
    let given = std::env::var(VARIABLE).ok().filter(|level| !level.is_empty());
    let (field, level) = match &given {
        Some(level) => (VARIABLE, level),
        None => ("log.level", &settings.level),
    };
    start(parse(field, level)?, writer(settings.format), exporter(settings)?);
    Ok(())
}

/// Refuses settings of the log that are none.
pub fn check_log(settings: &LogSettings) -> Result<()> {
    if !cfg!(feature = "otel") && !settings.otlp.is_empty() {
        let problem = "this program was built without OpenTelemetry: cargo build --features otel";
        return Err(Error::invalid("log.otlp", problem));
    }
    parse("log.level", &settings.level).map(drop)
}

/// Lets other messages through from now on; what was let through before. Fails where the log is not
/// ours: in a program that embeds this one.
pub fn set_log_level(level: &str) -> Result<String> {
    let filter = parse("level", level)?;
    let foreign = || Error::FailedPrecondition("the log is not this server's to change".into());
    let handle = FILTER.get().ok_or_else(foreign)?;
    let before = handle.with_current(ToString::to_string).map_err(|_| foreign())?;
    handle.reload(filter).map_err(|_| foreign())?;
    tracing::warn!("the log was set to '{level}', from '{before}'");
    Ok(before)
}

/// Sends what a collector has not got yet.
pub fn end_log() {
    #[cfg(feature = "otel")]
    super::otel::flush();
}

/// The first log of a process stays.
fn start(filter: EnvFilter, writer: Writer, exporter: Option<Writer>) {
    let (filter, handle) = reload::Layer::new(filter);
    let layers: Vec<Writer> = [Some(writer), exporter].into_iter().flatten().collect();
    if tracing_subscriber::registry().with(filter).with(layers).try_init().is_ok() {
        let _ = FILTER.set(handle);
    }
}

fn writer(format: LogFormat) -> Writer {
    match format {
        LogFormat::Text => fmt::layer().with_writer(std::io::stderr).boxed(),
        LogFormat::Json => fmt::layer().json().with_writer(std::io::stderr).boxed(),
    }
}

#[cfg(feature = "otel")]
fn exporter(settings: &LogSettings) -> Result<Option<Writer>> {
    match settings.otlp.as_str() {
        "" => Ok(None),
        endpoint => super::otel::layer(endpoint).map(Some),
    }
}

#[cfg(not(feature = "otel"))]
fn exporter(settings: &LogSettings) -> Result<Option<Writer>> {
    check_log(settings).map(|()| None)
}

/// A list of levels, each for all or for a room. A word that is no level would be read as the name of a
/// room, and nothing else would be told any more.
fn parse(field: &str, text: &str) -> Result<EnvFilter> {
    let wrong = |problem: String| Error::invalid(field, problem);
    if text.len() > MAX_BYTES {
        return Err(wrong(format!("at most {MAX_BYTES} bytes")));
    }
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    for part in &parts {
        let level = part.rsplit_once('=').map_or(*part, |(_, level)| level);
        if !LEVELS.contains(&level.to_lowercase().as_str()) {
            let problem = format!(
                "'{part}' is none of {}, also by room, as in orenx::serve=info",
                LEVELS.join(", ")
            );
            return Err(wrong(problem));
        }
    }
    EnvFilter::try_new(parts.join(",")).map_err(|e| wrong(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_read_or_refused_by_name() {
        for good in ["warn", "INFO", "warn,orenx::serve=debug", "off, orenx=trace"] {
            parse("log.level", good).expect(good);
        }
        for wrong in ["", "loud", "warn,", "orenx=loud", "info;debug", "orenx::serve"] {
            let error = parse("log.level", wrong).expect_err(wrong).to_string();
            assert!(error.starts_with("log.level: "), "{error}");
        }
    }
}
