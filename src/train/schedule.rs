//! How much to train on a frame.

use std::time::Duration;

use crate::config::{self, MapConfig};

/// Steps are left out rather than made with fewer rays than this.
const MIN_RAYS: u32 = 256;

/// What remains of the measured cost of a ray after a frame without training.
const FORGET: f32 = 0.95;

/// Rays and steps of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pace {
    pub rays: u32,
    pub steps: u32,
}

/// Fits rays and steps into the frame's time under `adaptive`; constant under `fixed`, where no
/// clock may reach the map.
#[derive(Debug, Clone)]
pub struct Schedule {
    adaptive: bool,
    budget_s: f32,
    full: Pace,
    /// Smoothed cost of a ray, s; 0 before the first measurement.
    ray_s: f32,
    /// Smoothed cost of publishing, s: a part of every frame that comes after its training.
    publish_s: f32,
    /// Frames of live sensors that wait behind the current one.
    behind: u32,
}

impl Schedule {
    /// The schedule that the settings ask for.
    pub fn new(config: &MapConfig) -> Self {
        Self {
            adaptive: config.schedule == config::Schedule::Adaptive,
            budget_s: config.frame_budget_ms * 1e-3,
            full: Pace { rays: config.rays_per_step, steps: config.steps_per_frame },
            ray_s: 0.0,
            publish_s: 0.0,
            behind: 0,
        }
    }

    /// What to do in a frame that has already taken `spent`. The frames that wait behind it share
    /// its budget: what they would lose is a drop, what it loses is training that can be made up.
    pub fn pace(&mut self, spent: Duration) -> Pace {
        let full = self.full;
        if !self.adaptive || full.steps == 0 {
            return full;
        }
        let budget_s = self.budget_s / (1 + self.behind) as f32;
        let left_s = budget_s - spent.as_secs_f32() - self.publish_s;
        let affordable = match self.ray_s {
            0.0 if left_s > 0.0 => MIN_RAYS,
            0.0 => 0,
            ray_s => (left_s / ray_s).max(0.0) as u32,
        };
        if affordable < MIN_RAYS {
            // What is not tried is not measured: a machine that was busy for a while is believed to
            // be free again little by little.
            self.ray_s *= FORGET;
            Pace { rays: 0, steps: 0 }
        } else if affordable < full.rays {
            Pace { rays: affordable, steps: 1 }
        } else {
            Pace { rays: full.rays, steps: (affordable / full.rays).min(full.steps) }
        }
    }

    /// Rays of a refinement step that should not take much longer than `slice`.
    pub fn idle_rays(&self, slice: Duration) -> u32 {
        if !self.adaptive || self.ray_s == 0.0 {
            return self.full.rays;
        }
        ((slice.as_secs_f32() / self.ray_s) as u32)
            .clamp(MIN_RAYS.min(self.full.rays), self.full.rays)
    }

    /// Says how many frames of live sensors wait behind the next one.
    pub fn set_behind(&mut self, frames: u32) {
        self.behind = frames;
    }

    /// Learns what a step of `rays` rays took. Under `fixed` the clock must not reach the map.
    pub fn learn(&mut self, rays: u32, took: Duration) {
        if self.adaptive && rays > 0 {
            smooth(&mut self.ray_s, took.as_secs_f32() / rays as f32);
        }
    }

    /// Learns what publishing took.
    pub fn learn_publish(&mut self, took: Duration) {
        if self.adaptive {
            smooth(&mut self.publish_s, took.as_secs_f32());
        }
    }
}

/// The first value as it is, later ones a fifth at a time.
fn smooth(average: &mut f32, value: f32) {
    *average = if *average == 0.0 { value } else { 0.8 * *average + 0.2 * value };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{MapSettings, Profile, Schedule as Kind};

    const MS: Duration = Duration::from_millis(1);

    fn schedule(schedule: Kind, profile: Profile) -> Schedule {
        let settings =
            MapSettings { schedule, profile, frame_budget_ms: 20.0, ..MapSettings::default() };
        Schedule::new(&MapConfig::from_settings(&settings).expect("valid"))
    }

    #[test]
    fn fixed_knows_no_clock() {
        let mut fixed = schedule(Kind::Fixed, Profile::Full);
        let full = fixed.pace(Duration::ZERO);
        fixed.learn(100, 1000 * MS);
        fixed.learn_publish(1000 * MS);
        fixed.set_behind(9);
        assert_eq!(fixed.pace(1000 * MS), full);
        assert_eq!(fixed.idle_rays(MS), full.rays);
    }

    #[test]
    fn training_takes_what_allocation_and_publishing_leave() {
        let mut adaptive = schedule(Kind::Adaptive, Profile::Lite);
        assert_eq!(adaptive.pace(Duration::ZERO), Pace { rays: MIN_RAYS, steps: 1 });
        assert_eq!(adaptive.pace(21 * MS), Pace { rays: 0, steps: 0 });
        adaptive.learn(1000, 10 * MS); // 10 µs a ray
        adaptive.learn_publish(2 * MS);
        // 20 ms - 3 ms - 2 ms leave 15 ms.
        let pace = adaptive.pace(3 * MS);
        assert!(pace.steps == 1 && pace.rays.abs_diff(1500) <= 1, "{pace:?}");
        // Two frames behind: 20 / 3 - 3 - 2 = 1.7 ms are too few rays.
        adaptive.set_behind(2);
        assert_eq!(adaptive.pace(3 * MS), Pace { rays: 0, steps: 0 });
        adaptive.set_behind(0);
        assert_eq!(adaptive.pace(30 * MS), Pace { rays: 0, steps: 0 });
        adaptive.ray_s = 10e-6;
        assert!(adaptive.idle_rays(5 * MS).abs_diff(500) <= 1);
        assert_eq!(adaptive.idle_rays(Duration::ZERO), MIN_RAYS);
        assert_eq!(adaptive.idle_rays(1000 * MS), 2048);
    }

    #[test]
    fn training_comes_back_after_a_busy_time() {
        let mut adaptive = schedule(Kind::Adaptive, Profile::Lite);
        adaptive.learn(256, 100 * MS);
        let skipped = (0..1000).take_while(|_| adaptive.pace(3 * MS).steps == 0).count();
        assert!((10..100).contains(&skipped), "{skipped} frames without training");
    }

    #[test]
    fn a_fast_machine_takes_the_steps_of_its_profile_and_no_more() {
        let mut adaptive = schedule(Kind::Adaptive, Profile::Full);
        adaptive.learn(1_000_000, MS);
        assert_eq!(adaptive.pace(Duration::ZERO), Pace { rays: 20_480, steps: 4 });
        adaptive.ray_s = 0.4e-6; // 20 480 rays take 8 ms
        assert_eq!(adaptive.pace(Duration::ZERO), Pace { rays: 20_480, steps: 2 });
    }
}
