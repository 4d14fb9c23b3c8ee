//! `[storage]`: where maps are kept, and how well.

use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// `[storage]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StorageSettings {
    pub path: PathBuf,
    pub snapshot_interval_s: u32,
    pub keep_snapshots: u32,
    pub max_snapshot_mib: u32,
    pub journal: JournalMode,
    pub journal_mib: u32,
}

/// Whether frames are kept until they are in the map's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JournalMode {
    #[default]
    Off,
    On,
}

impl Default for StorageSettings {
    fn default() -> Self {
        Self {
            path: "orenx-data".into(),
            snapshot_interval_s: 0,
            keep_snapshots: 4,
            max_snapshot_mib: 4096,
            journal: JournalMode::Off,
            journal_mib: 1024,
        }
    }
}

/// How a map that has a folder is kept, checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeepConfig {
    /// A map that has changed is saved this often; `None`: at the end alone.
    pub snapshot_interval: Option<Duration>,
    /// Timed snapshots that stay.
    pub keep_snapshots: usize,
    /// The largest snapshot that is taken in, bytes.
    pub max_snapshot_bytes: u64,
    /// The most that a map's journal may take, bytes; `None`: no journal.
    pub journal_bytes: Option<u64>,
}

impl Default for KeepConfig {
    fn default() -> Self {
        Self {
            snapshot_interval: None,
            keep_snapshots: 0,
            max_snapshot_bytes: 1 << 30,
            journal_bytes: None,
        }
    }
}

impl KeepConfig {
    /// Checks `[storage]`.
    pub fn from_settings(settings: &StorageSettings) -> Result<Self> {
        let within = |key: &str, value: u32, low: u32, high: u32| {
            if (low..=high).contains(&value) {
                return Ok(value);
            }
            let problem = format!("{value} must be within {low}..={high}");
            Err(Error::invalid(format!("storage.{key}"), problem))
        };
        let seconds = within("snapshot_interval_s", settings.snapshot_interval_s, 0, 604_800)?;
        let mib = |mib: u32| u64::from(mib) << 20;
        let journal_bytes = mib(within("journal_mib", settings.journal_mib, 16, 1 << 20)?);
        let journal = settings.journal == JournalMode::On;
        if journal && settings.path.as_os_str().is_empty() {
            return Err(Error::invalid("storage.journal", "needs a folder: storage.path"));
        }
        Ok(Self {
            snapshot_interval: (seconds > 0).then(|| Duration::from_secs(seconds.into())),
            keep_snapshots: within("keep_snapshots", settings.keep_snapshots, 0, 128)? as usize,
            max_snapshot_bytes: mib(within(
                "max_snapshot_mib",
                settings.max_snapshot_mib,
                1,
                1 << 20,
            )?),
            journal_bytes: journal.then_some(journal_bytes),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_named() {
        let check = |change: fn(&mut StorageSettings)| {
            let mut settings = StorageSettings::default();
            change(&mut settings);
            KeepConfig::from_settings(&settings).map_err(|error| error.to_string())
        };
        let usual = check(|_| {}).expect("the defaults");
        assert_eq!((usual.snapshot_interval, usual.journal_bytes), (None, None));
        let kept = check(|s| (s.snapshot_interval_s, s.journal) = (60, JournalMode::On));
        let kept = kept.expect("fine");
        assert_eq!(kept.snapshot_interval, Some(Duration::from_secs(60)));
        assert_eq!(kept.journal_bytes, Some(1 << 30));
        type Spoil = fn(&mut StorageSettings);
        let cases: [(Spoil, &str); 5] = [
            (|s| s.snapshot_interval_s = 604_801, "storage.snapshot_interval_s: "),
            (|s| s.keep_snapshots = 129, "storage.keep_snapshots: "),
            (|s| s.max_snapshot_mib = 0, "storage.max_snapshot_mib: "),
            (|s| s.journal_mib = 15, "storage.journal_mib: "),
            (|s| (s.path, s.journal) = ("".into(), JournalMode::On), "storage.journal: needs"),
        ];
        for (change, expected) in cases {
            let error = check(change).expect_err(expected);
            assert!(error.starts_with(expected), "{error}");
        }
    }
}
