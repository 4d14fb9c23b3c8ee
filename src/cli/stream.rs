//! `orenx stream`: a recording to a running server, as a robot would send it.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::Context;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::json;

use super::credentials::CredentialArgs;
use crate::client::{Client, Pace, StreamReport, ZenohClient, load_ahead, send};
use crate::dataset::{self, Format, FrameRange};
use crate::engine::QueuePolicy;
use crate::service::DEFAULT_MAP;

/// Frames without a verdict at a time: enough to hide a network's delay.
const WINDOW: NonZeroUsize = NonZeroUsize::new(8).unwrap();

/// Send a recording to a running server and report what became of its frames
#[derive(Debug, Args)]
pub struct StreamArgs {
    /// Folder of a recording, or a synthetic scene such as synthetic:room
    pub dataset: PathBuf,
    /// The server, as in http://127.0.0.1:7610, or the Zenoh router before it, as in
    /// zenoh+tcp://127.0.0.1:7447
    pub url: String,
    /// The map that takes them
    #[arg(long, default_value = DEFAULT_MAP)]
    pub map: String,
    /// Send so many frames a second, and drop what the server does not take, as a live sensor
    /// does. Without it, every frame is sent as soon as the server takes it
    #[arg(long, value_name = "HZ", value_parser = parse_rate)]
    pub rate: Option<f64>,
    /// Frames A..B of the recording, half-open
    #[arg(long, value_name = "A..B", default_value = "..")]
    pub frames: FrameRange,
    /// Every N-th frame
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub stride: usize,
    /// Send the classes of each frame too, where the recording has them; the server embeds their names
    #[arg(long)]
    pub labels: bool,
    /// How the recording is laid out
    #[arg(long, value_enum, default_value = "auto")]
    pub format: Format,
    /// Write the report here as JSON
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl StreamArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(self.stream())
    }

    async fn stream(self) -> anyhow::Result<()> {
        let dataset: Arc<dyn dataset::Dataset> = dataset::open(&self.dataset, self.format)?.into();
        let indices = self.frames.indices(dataset.len(), self.stride)?;
        let bar = progress_bar(indices.len() as u64)?;
        let pace = Pace {
            map_id: self.map.clone(),
            policy: match self.rate {
                Some(_) => QueuePolicy::Latest,
                None => QueuePolicy::Block,
            },
            rate_hz: self.rate,
            window: WINDOW,
        };
        let name = dataset.name().to_owned();
        let frames = load_ahead(dataset, indices.into_iter(), self.labels, |_| {})?;
        let progress = |report: &StreamReport| {
            bar.set_position(report.settled);
            bar.set_message(format!("{:.1} frames/s", report.frames_per_second()));
        };
        let report = if self.url.starts_with("zenoh+") {
            send(&ZenohClient::connect(&self.url).await?, pace, frames, progress).await?
        } else {
            let client = Client::connect_with(&self.url, &self.credentials.read()?).await?;
            send(&client, pace, frames, progress).await?
        };
        bar.finish_and_clear();
        print(&name, &report);
        if let Some(path) = &self.report {
            let text = serde_json::to_string_pretty(&as_json(&name, &self.url, &report))?;
            std::fs::write(path, text + "\n").with_context(|| path.display().to_string())?;
        }
        Ok(())
    }
}

fn parse_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(hz) if (0.001..=10_000.0).contains(&hz) => Ok(hz),
        _ => Err("must be a number within 0.001..=10000".into()),
    }
}

fn progress_bar(frames: u64) -> anyhow::Result<ProgressBar> {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} frames  {msg}  {eta} left")?;
    Ok(ProgressBar::new(frames).with_style(style))
}

fn print(name: &str, report: &StreamReport) {
    println!(
        "{name}: {} frames, {} integrated in {:.1} s ({:.1} frames/s), epoch {}",
        report.settled,
        report.integrated,
        report.elapsed.as_secs_f64(),
        report.frames_per_second(),
        report.epoch
    );
    if report.durable > 0 {
        println!("on disk, whatever happens to the server: {}", report.durable);
    }
    if let Some((median, p95)) = visible_after_ms(report) {
        println!("visible to queries after {median:.1} ms (median), {p95:.1} ms (95 %)");
    }
    for (what, reasons) in [("dropped", &report.dropped), ("rejected", &report.rejected)] {
        for (reason, count) in reasons {
            println!("{what} {count}: {}", reason.to_lowercase());
        }
    }
    if report.unanswered > 0 {
        println!("without an answer {}", report.unanswered);
    }
    if let Some(message) = &report.first_refusal {
        println!("first refusal: {message}");
    }
}

/// Median and 95th percentile of the time from arrival to visibility, ms.
fn visible_after_ms(report: &StreamReport) -> Option<(f64, f64)> {
    let mut sorted = report.visible_after_us.clone();
    sorted.sort_unstable();
    let at = |share: f64| -> Option<f64> {
        let index = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
        sorted.get(index).map(|us| *us as f64 * 1e-3)
    };
    at(0.5).zip(at(0.95))
}

fn as_json(name: &str, url: &str, report: &StreamReport) -> serde_json::Value {
    let latency =
        visible_after_ms(report).map(|(median, p95)| json!({ "median": median, "p95": p95 }));
    json!({
        "dataset": name,
        "url": url,
        "frames": report.settled,
        "integrated": report.integrated,
        "durable": report.durable,
        "dropped": lower(&report.dropped),
        "rejected": lower(&report.rejected),
        "unanswered": report.unanswered,
        "epoch": report.epoch,
        "seconds": report.elapsed.as_secs_f64(),
        "frames_per_second": report.frames_per_second(),
        "visible_after_ms": latency,
    })
}

fn lower(reasons: &std::collections::BTreeMap<&'static str, u64>) -> serde_json::Value {
    reasons.iter().map(|(reason, count)| (reason.to_lowercase(), *count)).collect()
}
