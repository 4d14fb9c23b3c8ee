//! What Prometheus reads: its text format, version 0.0.4.

use std::fmt::{Display, Write};

use super::super::zenoh::Tally;
use super::Edge;
use crate::engine::Reason;
use crate::service::{FrameCounts, MapReport, Service};
use crate::telemetry::{BOUNDS_S, Distribution, resident_bytes};

/// Labels of a sample. Values are our own names, in which nothing must be escaped.
type Labels<'a> = &'a [(&'a str, &'a str)];

/// The whole page.
pub(super) fn page(edge: &Edge) -> String {
    let mut page = Page::default();
    page.family("orenx_build_info", "gauge", "The version that runs.");
    page.sample("orenx_build_info", &[("version", env!("CARGO_PKG_VERSION"))], 1);
    page.gauge("orenx_ready", "Whether questions are answered.", edge.ready().is_ok() as u8);
    page.gauge("orenx_resident_bytes", "Memory held by the process.", resident_bytes());
    if let Some(service) = edge.service.get() {
        frames(&mut page, service);
        queries(&mut page, service);
        maps(&mut page, service);
    }
    requests(&mut page, edge);
    refusals(&mut page, edge);
    page.text
}

fn frames(page: &mut Page, service: &Service) {
    let FrameCounts { received, integrated, dropped, rejected, waiting, lost } =
        service.frame_counts();
    page.counter("orenx_frames_received_total", "Frames that came.", received);
    page.counter("orenx_frames_integrated_total", "Frames that are in the map.", integrated);
    let help = "Frames that were sent over Zenoh and never came, by the gaps in their numbers.";
    page.counter("orenx_frames_lost_total", help, lost);
    for (name, help, counts) in [
        ("orenx_frames_dropped_total", "Good frames that gave way.", dropped),
        ("orenx_frames_rejected_total", "Frames that were refused.", rejected),
    ] {
        page.family(name, "counter", help);
        for reason in Reason::ALL {
            let count = counts.iter().find(|(of, _)| *of == reason).map_or(0, |(_, count)| *count);
            page.sample(name, &[("reason", reason.name())], count);
        }
    }
    page.gauge("orenx_frames_waiting", "Frames without a verdict.", waiting);
    let name = "orenx_frame_to_queryable_seconds";
    page.family(name, "histogram", "From a frame's last byte until questions see it.");
    page.histogram(name, &[], &service.frame_times());
}

fn queries(page: &mut Page, service: &Service) {
    let times = service.call_times();
    let name = "orenx_query_queue_seconds";
    page.family(name, "histogram", "How long questions waited for a thread.");
    for call in &times {
        let (transport, verb) = call.call.names();
        page.histogram(name, &[("transport", transport), ("verb", verb)], &call.queue);
    }
    let name = "orenx_query_compute_seconds";
    page.family(name, "histogram", "How long questions took once a thread had them.");
    for call in &times {
        let (transport, verb) = call.call.names();
        page.histogram(name, &[("transport", transport), ("verb", verb)], &call.compute);
    }
}

fn maps(page: &mut Page, service: &Service) {
    let maps = service.list_maps();
    let reports: Vec<MapReport> =
        maps.iter().filter_map(|map| service.map_stats(&map.map_id).ok()).collect();
    page.gauge("orenx_maps", "Maps, also those that are not served.", maps.len());
    page.gauge("orenx_maps_closed", "Maps that could not be loaded.", maps.len() - reports.len());
    type Value = fn(&MapReport) -> u64;
    let families: [(&str, &str, &str, Value); 11] = [
        ("orenx_map_epoch", "gauge", "The newest published epoch.", |m| m.summary.epoch),
        ("orenx_map_frames", "gauge", "Frames in the map.", |m| m.stats.frames),
        ("orenx_map_bytes", "gauge", "Memory held by the map.", |m| m.stats.map_bytes),
        ("orenx_map_voxels", "gauge", "Voxels.", |m| m.stats.voxels),
        ("orenx_map_rows", "gauge", "Vertices with values.", |m| m.stats.rows),
        ("orenx_map_surfels", "gauge", "Surface elements.", |m| m.stats.surfels),
        ("orenx_map_key_frames", "gauge", "Views kept for training.", |m| m.stats.key_frames),
        ("orenx_map_saved_epoch", "gauge", "The epoch on disk.", |m| m.storage.saved_epoch),
        ("orenx_map_journal_bytes", "gauge", "Bytes of the journal.", |m| m.storage.journal_bytes),
        ("orenx_map_steps_total", "counter", "Training steps taken.", |m| m.stats.steps),
        (
            "orenx_map_voxels_refused_total",
            "counter",
            "Voxels refused because the memory budget was reached.",
            |m| m.stats.voxels_refused,
        ),
    ];
    for (name, kind, help, value) in families {
        page.family(name, kind, help);
        for report in &reports {
            page.sample(name, &[("map", report.summary.map_id.as_str())], value(report));
        }
    }
    let name = "orenx_map_storage_problem";
    let help = "Whether saving the map or its journal has a problem; the stats say which.";
    page.family(name, "gauge", help);
    for MapReport { summary, storage, .. } in &reports {
        let labels = [("map", summary.map_id.as_str())];
        page.sample(name, &labels, u8::from(!storage.problem.is_empty()));
    }
    let name = "orenx_map_newest_stamp_seconds";
    page.family(name, "gauge", "Capture time of the newest frame, Unix.");
    for MapReport { summary, .. } in &reports {
        let stamp_s = summary.newest_stamp_ns as f64 * 1e-9;
        page.sample(name, &[("map", summary.map_id.as_str())], stamp_s);
    }
}

fn requests(page: &mut Page, edge: &Edge) {
    let name = "orenx_grpc_requests_total";
    page.family(name, "counter", "Ended calls; the clients of CANCELLED left before.");
    for (call, code, count) in edge.calls.get().map(|calls| calls.read()).unwrap_or_default() {
        page.sample(name, &[("rpc", call), ("code", code)], count);
    }
    if let Some(tally) = edge.zenoh.get() {
        zenoh(page, tally);
    }
    let all = edge.requests.read();
    let name = "orenx_http_requests_total";
    page.family(name, "counter", "Answered requests; the clients of 499 left before.");
    for route in &all {
        for (status, count) in &route.statuses {
            let status = status.to_string();
            page.sample(name, &[("route", route.route), ("status", &status)], count);
        }
    }
    let name = "orenx_http_request_seconds";
    page.family(name, "histogram", "From a request's headers to its answer's.");
    for route in all.iter().filter(|route| route.times.count() > 0) {
        page.histogram(name, &[("route", route.route)], &route.times);
    }
}

/// Who did not get in, and how much those with keys ask.
fn refusals(page: &mut Page, edge: &Edge) {
    let gate = &edge.entrance.gate;
    let name = "orenx_refused_total";
    let help = "Refused before anyone looked at what was asked: for want of a key or of its role, by \
                the limits of a client, for want of TLS, or silent for too long.";
    page.family(name, "counter", help);
    for (transport, why, count) in gate.refusals.read() {
        page.sample(name, &[("transport", transport), ("reason", why)], count);
    }
    let name = "orenx_client_requests_total";
    page.family(name, "counter", "Requests within the limits, by the key that they came with.");
    for (client, count) in gate.requests() {
        page.sample(name, &[("client", client)], count);
    }
}

fn zenoh(page: &mut Page, tally: &Tally) {
    page.gauge("orenx_zenoh_joined", "Whether Zenoh is served.", tally.is_joined() as u8);
    page.counter("orenx_zenoh_frames_total", "Frames that came over Zenoh.", tally.frames.frames());
    let help = "Acks that were not said: nobody took them as fast as they came.";
    page.counter("orenx_zenoh_acks_dropped_total", help, tally.frames.acks_dropped());
    let name = "orenx_zenoh_queries_total";
    page.family(name, "counter", "Questions over Zenoh.");
    for (verb, code, count) in tally.questions() {
        page.sample(name, &[("verb", verb), ("code", code)], count);
    }
}

#[derive(Default)]
struct Page {
    text: String,
}

impl Page {
    /// Writing to a string cannot fail.
    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        let _ = writeln!(self.text, "{line}");
    }

    fn family(&mut self, name: &str, kind: &str, help: &str) {
        self.line(format_args!("# HELP {name} {help}"));
        self.line(format_args!("# TYPE {name} {kind}"));
    }

    fn sample(&mut self, name: &str, labels: Labels, value: impl Display) {
        let labels: Vec<String> =
            labels.iter().map(|(key, value)| format!("{key}=\"{value}\"")).collect();
        let labels =
            if labels.is_empty() { String::new() } else { format!("{{{}}}", labels.join(",")) };
        self.line(format_args!("{name}{labels} {value}"));
    }

    fn counter(&mut self, name: &str, help: &str, value: impl Display) {
        self.family(name, "counter", help);
        self.sample(name, &[], value);
    }

    fn gauge(&mut self, name: &str, help: &str, value: impl Display) {
        self.family(name, "gauge", help);
        self.sample(name, &[], value);
    }

    fn histogram(&mut self, name: &str, labels: Labels, times: &Distribution) {
        let bucket = format!("{name}_bucket");
        for (at, count) in times.cumulative.iter().enumerate() {
            let bound = BOUNDS_S.get(at).map_or("+Inf".to_owned(), f64::to_string);
            self.sample(&bucket, &[labels, &[("le", &bound)]].concat(), count);
        }
        self.sample(&format!("{name}_sum"), labels, times.sum_s);
        self.sample(&format!("{name}_count"), labels, times.count());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::Histogram;

    #[test]
    fn a_histogram_has_its_buckets_its_sum_and_its_count() {
        let times = Histogram::default();
        times.observe(std::time::Duration::from_micros(1500));
        let mut page = Page::default();
        page.family("t_seconds", "histogram", "Times.");
        page.histogram("t_seconds", &[("route", "/")], &times.read());
        let lines: Vec<&str> = page.text.lines().collect();
        assert_eq!(lines[..2], ["# HELP t_seconds Times.", "# TYPE t_seconds histogram"]);
        for line in [
            "t_seconds_bucket{route=\"/\",le=\"0.001\"} 0",
            "t_seconds_bucket{route=\"/\",le=\"0.0025\"} 1",
            "t_seconds_bucket{route=\"/\",le=\"+Inf\"} 1",
            "t_seconds_sum{route=\"/\"} 0.0015",
            "t_seconds_count{route=\"/\"} 1",
        ] {
            assert!(lines.contains(&line), "{line} in\n{}", page.text);
        }
    }
}
