//! How much to train on a frame.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::config::{self, MapConfig};

/// Rays are halved down to this before steps are left out.
const MIN_RAYS: u32 = 256;

/// Rays and steps of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pace {
    pub rays: u32,
    pub steps: u32,
}

/// Fits rays and steps into the frame's time under `adaptive`; constant under `fixed`.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Schedule {
    adaptive: bool,
    budget_s: f32,
    full: (u32, u32),
    /// Smoothed cost of a ray, s; 0 before the first measurement.
    ray_s: f32,
}

impl Schedule {
    /// The schedule that the settings ask for.
    pub fn new(config: &MapConfig) -> Self {
        Self {
            adaptive: config.schedule == config::Schedule::Adaptive,
            budget_s: config.frame_budget_ms * 1e-3,
            full: (config.rays_per_step, config.steps_per_frame),
            ray_s: 0.0,
        }
    }

    /// What to do in a frame that has already taken `spent`.
    pub fn pace(&self, spent: Duration) -> Pace {
        let (rays, steps) = self.full;
        if !self.adaptive || steps == 0 {
            return Pace { rays, steps };
        }
        if self.ray_s == 0.0 {
            return Pace { rays: MIN_RAYS, steps: 1 };
        }
        let affordable = ((self.budget_s - spent.as_secs_f32()) / self.ray_s).max(0.0) as u32;
        if affordable < MIN_RAYS {
            return Pace { rays: 0, steps: 0 };
        }
        if affordable < rays {
            return Pace { rays: affordable, steps: 1 };
        }
        Pace { rays, steps: (affordable / rays).min(steps.max(1)) }
    }

    /// Learns what a step of `rays` rays took. Under `fixed` the clock must not reach the map.
    pub fn learn(&mut self, rays: u32, took: Duration) {
        if self.adaptive && rays > 0 {
            let cost = took.as_secs_f32() / rays as f32;
            self.ray_s = if self.ray_s == 0.0 { cost } else { 0.8 * self.ray_s + 0.2 * cost };
        }
    }
}
