//! The report of `orenx map`: a stable format, changed only by adding keys.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use crate::backend::Pass;
use crate::config::{Prior, Profile, Schedule};
use crate::error::Result;
use crate::map::{FrameOutcome, Mapper};
use crate::storage::write_file;
use crate::telemetry;

/// The stages that every report has, in the order of a frame.
const STAGES: [&str; 5] = ["decode", "allocate", "labels", "train", "publish"];

/// What is counted while mapping.
#[derive(Debug)]
pub(in crate::cli) struct Tally {
    /// Frames that the map took, the empty ones among them.
    pub(in crate::cli) frames: u64,
    /// Frames without a valid depth pixel.
    pub(super) frames_empty: u64,
    /// Wall time from the start of the command to the last frame's epoch.
    pub(in crate::cli) seconds: f64,
    /// Frames that the recording lists but cannot give.
    skipped: Vec<(&'static str, u64)>,
    rejected: BTreeMap<String, u64>,
    /// Wall times by stage, ms, one a frame.
    pub(in crate::cli) stages_ms: BTreeMap<String, Vec<f32>>,
    /// Passes of training, in the order of their first run, one entry a frame.
    pub(in crate::cli) passes: Vec<(&'static str, Vec<Pass>)>,
}

impl Tally {
    pub(super) fn new(skipped: Vec<(&'static str, u64)>) -> Self {
        let stages_ms = STAGES.iter().map(|stage| ((*stage).to_owned(), Vec::new())).collect();
        Self {
            frames: 0,
            frames_empty: 0,
            seconds: 0.0,
            skipped,
            rejected: BTreeMap::new(),
            stages_ms,
            passes: Vec::new(),
        }
    }

    /// A frame that the map took; called after its epoch was published.
    pub(super) fn count(&mut self, outcome: &FrameOutcome, decode_ms: f32, mapper: &Mapper) {
        self.frames += 1;
        self.frames_empty += u64::from(outcome.valid_pixels == 0);
        self.stages_ms.entry("decode".to_owned()).or_default().push(decode_ms);
        let stats = mapper.stats();
        for pass in stats.passes {
            match self.passes.iter_mut().find(|(name, _)| *name == pass.name) {
                Some((_, passes)) => passes.push(pass),
                None => self.passes.push((pass.name, vec![pass])),
            }
        }
        for (stage, ms) in stats.stages_ms {
            self.stages_ms.entry(stage).or_default().push(ms);
        }
    }

    /// A frame that the map refused.
    pub(super) fn reject(&mut self, reason: &str) {
        *self.rejected.entry(reason.to_owned()).or_default() += 1;
    }

    /// Frames that the map refused.
    pub(super) fn rejections(&self) -> u64 {
        self.rejected.values().sum()
    }

    pub(in crate::cli) fn frames_per_second(&self) -> f64 {
        self.frames as f64 / self.seconds.max(1e-9)
    }

    /// Time spent in the mapper alone, s.
    pub(in crate::cli) fn mapping_seconds(&self) -> f64 {
        let stages = self.stages_ms.iter().filter(|(stage, _)| *stage != "decode");
        stages.flat_map(|(_, ms)| ms).map(|&ms| f64::from(ms) * 1e-3).sum()
    }
}

#[derive(Debug, Serialize)]
pub(super) struct Report {
    dataset: String,
    frames: u64,
    frames_empty: u64,
    frames_rejected: BTreeMap<String, u64>,
    seconds: f64,
    frames_per_second: f64,
    backend: &'static str,
    adapter: String,
    profile: Profile,
    schedule: Schedule,
    prior: Prior,
    modalities: Vec<String>,
    r0_m: f32,
    seed: u32,
    epoch: u64,
    steps: u64,
    rays_per_step: u32,
    voxels: u64,
    voxels_refused: u64,
    surfels: u64,
    key_frames: u64,
    rows: BTreeMap<String, u64>,
    map_bytes: u64,
    peak_rss_bytes: u64,
    gpu_peak_bytes: u64,
    stages_ms: BTreeMap<String, Spread>,
    losses: BTreeMap<String, f32>,
}

#[derive(Debug, Default, PartialEq, Serialize)]
pub(in crate::cli) struct Spread {
    pub(in crate::cli) median: f32,
    pub(in crate::cli) p95: f32,
}

/// The numbers of a run.
pub(super) fn report(dataset: &str, mapper: &Mapper, tally: &Tally) -> Report {
    let (config, stats) = (mapper.config(), mapper.stats());
    let skipped = tally.skipped.iter().map(|(reason, count)| ((*reason).to_owned(), *count));
    Report {
        dataset: dataset.to_owned(),
        frames: tally.frames,
        frames_empty: tally.frames_empty,
        frames_rejected: tally.rejected.clone().into_iter().chain(skipped).collect(),
        seconds: tally.seconds,
        frames_per_second: tally.frames_per_second(),
        backend: if mapper.adapter().is_some() { "gpu" } else { "cpu" },
        adapter: mapper.adapter().map_or_else(processor, str::to_owned),
        profile: config.profile,
        schedule: config.schedule,
        prior: config.prior,
        modalities: config.modalities.clone(),
        r0_m: config.r0_m,
        seed: config.seed,
        epoch: stats.epoch,
        steps: stats.steps,
        rays_per_step: config.rays_per_step,
        voxels: stats.voxels,
        voxels_refused: stats.voxels_refused,
        surfels: stats.surfels,
        key_frames: stats.key_frames,
        rows: config
            .modalities
            .iter()
            .map(|modality| {
                let rows = match modality.as_str() {
                    "radiance" => mapper.color_rows(),
                    "language" => mapper.code_rows(),
                    _ => stats.rows,
                };
                (modality.clone(), rows)
            })
            .collect(),
        map_bytes: stats.map_bytes,
        peak_rss_bytes: telemetry::peak_resident_bytes(),
        gpu_peak_bytes: mapper.gpu_peak_bytes(),
        stages_ms: tally.stages_ms.iter().map(|(s, ms)| (s.clone(), spread(ms))).collect(),
        losses: stats.losses.into_iter().collect(),
    }
}

/// Writes the report as indented JSON.
pub(super) fn write(path: &Path, report: &Report) -> Result<()> {
    write_file(path, |out| Ok(serde_json::to_writer_pretty(out, report)?))
}

/// Median and 95th percentile by nearest rank; zeros for a stage that never ran.
pub(in crate::cli) fn spread(values: &[f32]) -> Spread {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f32::total_cmp);
    let rank = |share: f64| ((share * sorted.len() as f64).ceil() as usize).saturating_sub(1);
    let at = |share: f64| sorted.get(rank(share)).copied().unwrap_or_default();
    Spread { median: at(0.5), p95: at(0.95) }
}

/// The processor's name and the threads that it lends us.
pub(in crate::cli) fn processor() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find_map(|line| {
        line.strip_prefix("model name").map(|rest| rest.trim_start_matches([' ', '\t', ':']))
    });
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!("{}, {threads} threads", name.unwrap_or(std::env::consts::ARCH))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{MapConfig, MapSettings};

    #[test]
    fn spreads_are_by_nearest_rank() {
        let values: Vec<f32> = (1..=100).rev().map(|i| i as f32).collect();
        assert_eq!(spread(&values), Spread { median: 50.0, p95: 95.0 });
        assert_eq!(spread(&[3.0]), Spread { median: 3.0, p95: 3.0 });
        assert_eq!(spread(&[]), Spread::default());
    }

    #[test]
    fn the_stable_keys_are_there() {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults are valid");
        let mapper = Mapper::new(config).expect("an empty map");
        let mut tally = Tally::new(vec![("no_pose", 2)]);
        tally.reject("depth.data");
        let outcome = FrameOutcome { epoch: 1, valid_pixels: 0, steps: 0 };
        tally.count(&outcome, 4.0, &mapper);
        tally.seconds = 0.5;
        let value = serde_json::to_value(report("room0", &mapper, &tally)).expect("JSON");
        for key in [
            "dataset",
            "frames",
            "frames_rejected",
            "seconds",
            "frames_per_second",
            "backend",
            "adapter",
            "profile",
            "schedule",
            "modalities",
            "seed",
            "epoch",
            "steps",
            "rays_per_step",
            "voxels",
            "rows",
            "map_bytes",
            "peak_rss_bytes",
            "gpu_peak_bytes",
            "stages_ms",
            "losses",
        ] {
            assert!(value.get(key).is_some(), "{key}");
        }
        assert_eq!(value["frames_rejected"], serde_json::json!({"no_pose": 2, "depth.data": 1}));
        assert_eq!((&value["frames"], &value["frames_empty"]), (&1.into(), &1.into()));
        assert_eq!((&value["backend"], &value["profile"]), (&"cpu".into(), &"lite".into()));
        assert_eq!(value["frames_per_second"], 2.0);
        for stage in STAGES {
            assert!(value["stages_ms"][stage]["p95"].is_number(), "{stage}");
        }
        assert_eq!(value["stages_ms"]["decode"]["median"], 4.0);
        assert!(value["rows"]["sdf"].is_number() && value["rows"]["occupancy"].is_number());
        assert!(value["peak_rss_bytes"].as_u64() > Some(1 << 20));
    }
}
