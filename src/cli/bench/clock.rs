//! Two clocks: the wall's, and the processor time that this process got.
//!
//! On a machine that others use as well, the second says what the work costs; the first, what a
//! user waits.

use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};

/// Started clocks.
pub(super) struct Clock {
    wall: Instant,
    processor_s: f64,
}

/// Time that went by, s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Elapsed {
    pub(super) wall_s: f64,
    /// Of all threads together.
    pub(super) processor_s: f64,
}

impl Clock {
    pub(super) fn start() -> Self {
        Self { wall: Instant::now(), processor_s: processor_s() }
    }

    pub(super) fn elapsed(&self) -> Elapsed {
        Elapsed {
            wall_s: self.wall.elapsed().as_secs_f64(),
            processor_s: processor_s() - self.processor_s,
        }
    }
}

fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_takes_processor_time() {
        let clock = Clock::start();
        let mut sum = 0u64;
        for i in 0..1_000_000u64 {
            sum = std::hint::black_box(sum.wrapping_add(i));
        }
        let elapsed = clock.elapsed();
        assert!(elapsed.processor_s > 0.0 && elapsed.wall_s > 0.0, "{elapsed:?}");
    }
}
