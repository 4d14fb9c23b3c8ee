//! The one writer: a frame in, an epoch out.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::budget::Sizes;
use super::language::Viewpoint;
use super::robots::Robots;
use super::timeline::Timeline;
use super::trainer::Trainer;
use super::view::Store;
use crate::backend::{
    Backend, Changes, LABELS, Pass, RadianceParameters, Scene, StepParameters, Work, WorkReport,
};
use crate::config::{MapConfig, Prior};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::modality::language::LanguageField;
use crate::modality::losses::{LossWeights, Stencil};
use crate::octree::{Explicit, Topology};
use crate::surface::{Surface, SurfaceChange};
use crate::train::{KeyFrame, KeyFrames, Pace, RayPlan, Schedule};

/// Sign consistency joins the losses after this many frames (algorithms.md §8).
const CONSISTENCY_FROM_FRAME: u64 = 50;
/// Colours are compared after this many frames (algorithms.md §7).
const COLORS_FROM_FRAME: u64 = 3;
/// s of the density in training, 1/m: soft while a learned surface finds its place, and hard after
/// this many steps (algorithms.md §7).
const SHARPNESS: [f32; 2] = [40.0, 200.0];
const HARDENING_STEPS: f32 = 300.0;
/// Refinement steps after the last frame, at a falling rate.
const IDLE_STEPS: u32 = 300;

/// What a frame did to the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOutcome {
    /// The first epoch that holds the frame: that of the next [`Mapper::publish`].
    pub epoch: u64,
    /// Depth pixels with a return; 0 means that the frame was accepted and added nothing.
    pub valid_pixels: u32,
    /// Training steps taken for this frame.
    pub steps: u32,
}

/// Counters and sizes of a map.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct MapStats {
    /// Published updates: frames taken together, or refinement while no frame came.
    pub epoch: u64,
    /// Frames in the map.
    pub frames: u64,
    /// Frames without a single valid depth pixel.
    pub frames_empty: u64,
    pub steps: u64,
    pub voxels: u64,
    pub rows: u64,
    pub surfels: u64,
    pub key_frames: u64,
    /// Bytes in use by the map (topology, rows, surfels, evidence, key frames, optimiser, the
    /// published pages).
    pub map_bytes: u64,
    /// Voxels, bricks of evidence and surfels that were refused because the memory budget was
    /// reached.
    pub voxels_refused: u64,
    /// Mean losses of the last training step by name.
    pub losses: Vec<(String, f32)>,
    /// Wall time of the last frame by stage, ms: allocate, labels, train, publish. Not stored: the
    /// same input gives the same file.
    #[serde(skip)]
    pub stages_ms: Vec<(String, f32)>,
    /// Passes of the training that was finished last.
    #[serde(skip)]
    pub passes: Vec<Pass>,
}

/// Owns the map and its backend; used by one thread.
pub struct Mapper {
    pub(super) config: Arc<MapConfig>,
    /// Fuses frames: what must keep up with a camera.
    pub(super) pool: Arc<rayon::ThreadPool>,
    /// Trains, in the time that is left. Apart, so that a lower priority for training does not hold
    /// up fusion.
    pub(super) trainers: Arc<rayon::ThreadPool>,
    pub(super) topology: Topology,
    pub(super) surface: Surface,
    /// Where the map has language.
    pub(super) language: Option<LanguageField>,
    pub(super) robots: Robots,
    pub(super) timeline: Timeline,
    pub(super) key_frames: KeyFrames,
    pub(super) schedule: Schedule,
    pub(super) backend: Box<dyn Backend>,
    pub(super) trainer: Trainer,
    /// What the backend learned for (d, g), by row, as of the last publication.
    pub(super) learned: Vec<Explicit>,
    /// What it learned for colours, by vertex of the band; shorter than the band where nothing was
    /// learned.
    pub(super) learned_colors: Vec<[f32; 3]>,
    /// What the backend takes for the prior under [`Prior::Learned`]: zeros.
    pub(super) no_prior: Vec<Explicit>,
    pub(super) store: Store,
    pub(super) stats: MapStats,
    pub(super) newest_stamp_ns: i64,
    /// Rows whose prior changed, bricks and nodes, since the last publication.
    pub(super) changed_rows: Vec<u32>,
    pub(super) changed_bricks: Vec<u32>,
    pub(super) changed_nodes: Vec<u32>,
    /// Blocks of colour that changed since the last publication; may hold repeats.
    pub(super) changed_colors: Vec<u32>,
    /// Blocks of codes that changed since the last publication; may hold repeats.
    pub(super) changed_codes: Vec<u32>,
    /// Where key frames were taken from, as published last.
    pub(super) viewpoints: Arc<[Viewpoint]>,
    /// Idle steps since the last frame.
    pub(super) idle_steps: u32,
    /// Whether the map has changed since its newest epoch.
    pub(super) changed: bool,
}

impl Mapper {
    /// The map's settings.
    pub fn config(&self) -> &MapConfig {
        &self.config
    }

    /// Takes one checked frame into the map. On an error the map is as before.
    pub fn integrate(&mut self, frame: &Frame) -> Result<FrameOutcome> {
        frame.check()?;
        if let (Some(language), Some(features)) = (&self.language, &frame.features) {
            language.admit(features)?;
        }
        let start = Instant::now();
        let valid_pixels = frame.depth.valid_pixels() as u32;
        self.stats.frames += 1;
        self.changed = true;
        self.newest_stamp_ns = self.newest_stamp_ns.max(frame.stamp_ns);
        self.stats.stages_ms.clear();
        self.idle_steps = 0;
        let mut steps = 0;
        if valid_pixels == 0 {
            self.stats.frames_empty += 1;
        } else {
            let view = self.allocate(frame)?;
            self.stage("allocate", start);
            steps = self.train_within(&view, start)?;
        }
        Ok(FrameOutcome { epoch: self.stats.epoch + 1, valid_pixels, steps })
    }

    /// Surfels, evidence, voxels and prior; returns what training keeps of the frame.
    fn allocate(&mut self, frame: &Frame) -> Result<KeyFrame> {
        let number = self.timeline.number(self.stats.frames);
        self.timeline.note(number, frame.stamp_ns);
        self.grant_room()?;
        let rows = self.topology.rows() as u32;
        let robot = self.robots.number(&frame.robot_id);
        let change = self.surface.integrate(frame, robot, number, &mut self.topology, &self.pool);
        let gain = (self.config.radiance.rays_per_step > 0).then_some(change.gain);
        if let Some(language) = &mut self.language {
            language.integrate(frame, number)?;
            self.changed_codes.extend(language.take_changed());
            self.topology.refuse(language.band.take_refused());
        }
        self.follow(change, rows)?;
        let pixels = self.config.key_frame_pixels as usize;
        Ok(KeyFrame::new(frame, robot, pixels, self.config.r0_m, gain))
    }

    /// Tells the backend and the next view what changed; before, there were `rows` rows.
    pub(super) fn follow(&mut self, change: SurfaceChange, rows: u32) -> Result<()> {
        // A new row that keeps its first value is no change of the prior, but new to every page.
        let changed = self.changed_rows.len();
        self.changed_rows.extend(rows..self.topology.rows() as u32);
        self.changed_rows.extend(change.prior.rows);
        self.changed_bricks.extend(change.changed_bricks);
        self.changed_colors.extend(&change.colors);
        if self.config.prior == Prior::Learned {
            self.no_prior.resize(self.topology.rows(), [0.0; 4]);
        }
        let nodes = self.topology.take_changed_nodes();
        let changes = Changes {
            nodes: &nodes,
            rows: &self.changed_rows[changed..],
            voided: &change.prior.voided,
            measured: &change.prior.measured,
            surfels: &change.surfels,
            bricks: &change.touched_bricks,
            colors: &change.colors,
        };
        let scene = scene(&self.config, &self.topology, &self.surface, &self.no_prior);
        self.backend.follow(&scene, &changes)?;
        self.changed_nodes.extend(nodes);
        Ok(())
    }

    /// Lets the frame take its share of what the memory budgets leave.
    pub(super) fn grant_room(&mut self) -> Result<()> {
        let sizes = Sizes {
            rows: self.topology.rows(),
            nodes: self.topology.node_slots(),
            surfels: self.surface.surfels.slots(),
            bricks: self.surface.evidence.bricks(),
            blocks: self.surface.color.as_ref().map_or(0, |color| color.band.blocks()),
            code_blocks: self.language.as_ref().map_or(0, |language| language.band.blocks()),
        };
        let room = sizes.room(&self.config);
        let rows = (sizes.rows + room.rows).min(self.backend.reserve(sizes.rows)?);
        self.topology.limit(rows, sizes.nodes + room.nodes);
        self.surface.surfels.limit(sizes.surfels + room.surfels);
        self.surface.evidence.limit(sizes.bricks + room.bricks);
        if let Some(color) = &mut self.surface.color {
            color.band.limit(sizes.blocks + room.blocks);
        }
        if let Some(language) = &mut self.language {
            language.limit(sizes.code_blocks + room.code_blocks);
        }
        Ok(())
    }

    fn train_within(&mut self, view: &KeyFrame, start: Instant) -> Result<u32> {
        let pace = self.schedule.pace(start.elapsed());
        if pace.steps == 0 {
            self.key_frames.offer(view);
            return Ok(0);
        }
        let window = self.key_frames.select(view);
        self.train(&window, Some(view), pace, 1.0)?;
        self.key_frames.offer(view);
        Ok(pace.steps)
    }

    /// Training steps on rays of key frames and, if given, of the current view.
    fn train(
        &mut self,
        window: &[u32],
        view: Option<&KeyFrame>,
        pace: Pace,
        rate: f32,
    ) -> Result<()> {
        let parameters = self.parameters(rate, pace.rays);
        let held = window.iter().filter_map(|&id| self.key_frames.get(id));
        let frames: Vec<&KeyFrame> = held.chain(view).collect();
        let plan = RayPlan {
            rays: pace.rays,
            seed: self.config.seed,
            step: self.stats.steps as u32,
            eikonal_share: self.config.eikonal_share,
        };
        let work = Work { frames: &frames, plan, steps: pace.steps, parameters };
        let scene = scene(&self.config, &self.topology, &self.surface, &self.no_prior);
        let start = Instant::now();
        self.backend.train(&scene, &work)?;
        self.stats.steps += u64::from(pace.steps);
        self.hear();
        let ms = start.elapsed().as_secs_f32() * 1e3;
        let labels = self.stats.passes.iter().find(|pass| pass.name == LABELS);
        let labels_ms = labels.map_or(0.0, |pass| pass.ms);
        self.add_to_stage("labels", labels_ms);
        self.add_to_stage("train", ms - labels_ms);
        Ok(())
    }

    /// Takes note of what the backend has finished.
    pub(super) fn hear(&mut self) {
        let Some(WorkReport { step, rays, took, passes }) = self.backend.report() else { return };
        self.schedule.learn(rays, took);
        self.stats.losses =
            step.losses.named().map(|(name, loss)| (name.to_owned(), loss as f32)).to_vec();
        self.stats.passes = passes;
    }

    fn parameters(&self, rate: f32, rays: u32) -> StepParameters {
        let mut weights = LossWeights::default();
        if self.stats.frames <= CONSISTENCY_FROM_FRAME {
            weights.consistency = 0.0;
        }
        let full = self.config.eikonal_share >= 1.0;
        StepParameters {
            rate: self.config.learning_rate * rate,
            occupancy_rate: self.config.occupancy_learning_rate * rate,
            decoder_rate: self.config.decoder_learning_rate * rate,
            stencil: if full { Stencil::Central } else { Stencil::Forward },
            weights,
            radiance: self.radiance(rate, rays),
        }
    }

    /// How a step of `rays` rays compares colours: with its share of the rays that a full step has.
    fn radiance(&self, rate: f32, rays: u32) -> Option<RadianceParameters> {
        let config = &self.config.radiance;
        let share = f64::from(rays) / f64::from(self.config.rays_per_step.max(1));
        let rays = (f64::from(config.rays_per_step) * share).round() as u32;
        let trained = self.stats.frames > COLORS_FROM_FRAME && self.config.has("radiance");
        let hardened = (self.stats.steps as f32 / HARDENING_STEPS).min(1.0);
        (trained && rays > 0).then_some(RadianceParameters {
            rays,
            renderer: config.renderer,
            rate: config.learning_rate * rate,
            sharpness: match self.config.prior {
                Prior::Closed => SHARPNESS[1],
                Prior::Learned => SHARPNESS[0] + (SHARPNESS[1] - SHARPNESS[0]) * hardened,
            },
            weight: config.weight,
            sharpens: config.sharpens,
        })
    }

    /// Adds the time since `start` to a stage of the frame.
    pub(super) fn stage(&mut self, name: &str, start: Instant) {
        self.add_to_stage(name, start.elapsed().as_secs_f32() * 1e3);
    }

    fn add_to_stage(&mut self, name: &str, took: f32) {
        match self.stats.stages_ms.iter_mut().find(|(n, _)| n == name) {
            Some((_, sum)) => *sum += took,
            None => self.stats.stages_ms.push((name.to_owned(), took)),
        }
    }

    /// Says how many frames of live sensors wait behind the next one. Under `adaptive` they share its
    /// time.
    pub fn set_behind(&mut self, frames: u32) {
        self.schedule.set_behind(frames);
    }

    /// Gives the trainer threads the lowest share of the processor that `nice` stands for: 0 is
    /// normal, 19 yields to everyone. Linux alone keeps a nice value for each thread; elsewhere
    /// nothing changes.
    pub fn set_trainer_nice(&self, nice: u8) -> Result<()> {
        #[cfg(target_os = "linux")]
        for set in
            self.trainers.broadcast(|_| rustix::process::setpriority_process(None, nice.into()))
        {
            set.map_err(|e| Error::Internal(format!("the priority of trainer threads: {e}")))?;
        }
        Ok(())
    }

    /// Refines from key frames when no frame waits, for about `budget`. Returns whether more
    /// refinement is worth doing.
    pub fn refine(&mut self, budget: Duration) -> Result<bool> {
        let start = Instant::now();
        if self.key_frames.is_empty() || self.config.steps_per_frame == 0 {
            return Ok(false);
        }
        while self.idle_steps < IDLE_STEPS && start.elapsed() < budget {
            let window = self.key_frames.select_idle();
            let rate = 1.0 - self.idle_steps as f32 / IDLE_STEPS as f32;
            let pace = Pace { rays: self.schedule.idle_rays(budget), steps: 1 };
            self.train(&window, None, pace, rate)?;
            self.idle_steps += 1;
            self.changed = true;
        }
        Ok(self.idle_steps < IDLE_STEPS)
    }

    /// Vertices of codes.
    pub fn code_rows(&self) -> u64 {
        self.language.as_ref().map_or(0, |language| language.band.rows() as u64)
    }

    /// Vertices of colour.
    pub fn color_rows(&self) -> u64 {
        self.surface.color.as_ref().map_or(0, |color| color.band.rows() as u64)
    }

    /// Counters and sizes.
    pub fn stats(&self) -> MapStats {
        MapStats {
            voxels: self.topology.voxels(),
            rows: self.topology.rows() as u64,
            surfels: self.surface.surfels.len() as u64,
            voxels_refused: self.topology.refused(),
            key_frames: self.key_frames.len() as u64,
            map_bytes: self.topology.bytes()
                + self.surface.bytes()
                + self.language.as_ref().map_or(0, LanguageField::bytes)
                + self.key_frames.bytes()
                + self.backend.memory_bytes()
                + self.store.bytes()
                + size_of_val(&self.learned[..]) as u64
                + size_of_val(&self.learned_colors[..]) as u64,
            ..self.stats.clone()
        }
    }
}

/// What the backend reads. Fields instead of the mapper, so that the backend can be borrowed beside.
pub(super) fn scene<'a>(
    config: &MapConfig,
    topology: &'a Topology,
    surface: &'a Surface,
    no_prior: &'a [Explicit],
) -> Scene<'a> {
    let closed = config.prior == Prior::Closed;
    Scene { topology, surface, prior: if closed { surface.prior.values() } else { no_prior } }
}
