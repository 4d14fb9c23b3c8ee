//! What keeps messages from becoming frames, told now and then instead of thirty times a second.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The time between two tellings.
const PAUSE: Duration = Duration::from_secs(5);
/// Kinds of complaints that are told apart.
const KINDS: usize = 32;

/// Complaints since the last telling, with the newest words of each kind.
#[derive(Debug, Default)]
pub(super) struct Complaints(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    kinds: BTreeMap<String, (u64, String)>,
    told: Option<Instant>,
}

impl Complaints {
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn note(&self, what: &str, problem: &str) {
        let mut kept = self.kept();
        if kept.kinds.len() >= KINDS && !kept.kinds.contains_key(what) {
            return;
        }
        let (count, words) = kept.kinds.entry(what.into()).or_default();
        *count += 1;
        problem.clone_into(words);
    }

    /// Tells what there is, if the last time is long enough ago.
    pub(super) fn tell(&self) {
        for line in self.due(Instant::now()) {
            tracing::warn!("ROS 2: {line}");
        }
    }

    fn due(&self, now: Instant) -> Vec<String> {
        let mut kept = self.kept();
        let is_due = kept.told.is_none_or(|told| now >= told + PAUSE);
        if !is_due || kept.kinds.is_empty() {
            return Vec::new();
        }
        kept.told = Some(now);
        let kinds = std::mem::take(&mut kept.kinds);
        kinds.into_iter().map(|(what, (n, words))| format!("{n} times {what}: {words}")).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complaints_are_counted_and_told_now_and_then() {
        let complaints = Complaints::default();
        let now = Instant::now();
        assert_eq!(complaints.due(now), [""; 0]);
        complaints.note("a frame", "no pose");
        assert_eq!(complaints.due(now), ["1 times a frame: no pose"]);
        complaints.note("a frame", "no pose");
        complaints.note("a frame", "no camera");
        assert_eq!(complaints.due(now + PAUSE / 2), [""; 0]);
        assert_eq!(complaints.due(now + PAUSE), ["2 times a frame: no camera"]);
        for kind in 0..100 {
            complaints.note(&kind.to_string(), "strange");
        }
        assert_eq!(complaints.due(now + PAUSE * 2).len(), KINDS);
    }
}
