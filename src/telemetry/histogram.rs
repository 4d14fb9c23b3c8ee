//! A histogram of times: fixed buckets, counted without a lock.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Upper bounds of the buckets, s: from a small question to a client that gave up.
pub const BOUNDS_S: [f64; 16] = [
    0.0001, 0.00025, 0.0005, 0.001, 0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0,
    10.0,
];

/// Counts times by size.
#[derive(Debug, Default)]
pub struct Histogram {
    /// By bucket, not cumulative; the last one has no upper bound.
    counts: [AtomicU64; BOUNDS_S.len() + 1],
    sum_ns: AtomicU64,
}

/// What a histogram held when it was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Distribution {
    /// Times up to each of [`BOUNDS_S`]; the last number is that of all times.
    pub cumulative: [u64; BOUNDS_S.len() + 1],
    pub sum_s: f64,
}

impl Histogram {
    /// Counts one time.
    pub fn observe(&self, time: Duration) {
        let seconds = time.as_secs_f64();
        let bucket = BOUNDS_S.partition_point(|bound| *bound < seconds);
        self.counts[bucket].fetch_add(1, Relaxed);
        self.sum_ns.fetch_add(time.as_nanos() as u64, Relaxed);
    }

    /// All times so far.
    pub fn read(&self) -> Distribution {
        let mut total = 0;
        let cumulative = std::array::from_fn(|bucket| {
            total += self.counts[bucket].load(Relaxed);
            total
        });
        Distribution { cumulative, sum_s: self.sum_ns.load(Relaxed) as f64 * 1e-9 }
    }
}

impl Distribution {
    /// The number of times.
    pub fn count(&self) -> u64 {
        self.cumulative[BOUNDS_S.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_fall_into_the_bucket_whose_bound_they_do_not_pass() {
        assert!(BOUNDS_S.is_sorted());
        let histogram = Histogram::default();
        for us in [0, 100, 101, 4_000, 60_000_000] {
            histogram.observe(Duration::from_micros(us));
        }
        let read = histogram.read();
        assert_eq!(read.cumulative[..2], [2, 3]);
        let below_5_ms = BOUNDS_S.iter().position(|bound| *bound == 0.005).expect("a bound");
        assert_eq!((read.cumulative[below_5_ms - 1], read.cumulative[below_5_ms]), (3, 4));
        assert_eq!((read.cumulative[BOUNDS_S.len() - 1], read.count()), (4, 5));
        assert!((read.sum_s - 60.004_201).abs() < 1e-9, "{}", read.sum_s);
    }
}
