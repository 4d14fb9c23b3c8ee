//! The verbs: everything that a robot or a planner can ask for, whatever it speaks.
//!
//! Every transport converts its messages, calls these, and converts the answers; nothing is decided
//! anywhere else.

mod counters;
mod find;
mod grid;
mod image;
mod language;
mod maps;
mod mirror;
mod nearest;
mod question;
mod rays;
mod readers;
mod slice;
mod sought;
mod spheres;
mod studio;
mod tasks;
mod terms;
mod times;
mod trajectories;
mod watch;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use tokio::sync::Semaphore;

use crate::config::{MapConfig, ServerConfig};
use crate::encoder::TextEncoder;
use crate::engine::{
    Emptied, Engine, EngineSettings, FrameSink, Handle, Published, Queue, QueuePolicy, Reason,
    Session, Verdict, persist,
};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::geometry::Aabb;
use crate::map::{Mapper, Trainer};
use crate::telemetry::Distribution;

pub use counters::FrameCounts;
use counters::{Counted, Counters};
pub use find::{
    ClassifyQuestion, ClassifyReply, Encoders, FindQuestion, FindReply, MAX_CLASS_SCORES,
    MAX_CLASSES, MAX_MATCHES,
};
pub use grid::{Grid, GridColumns, GridQuestion, GridReply, MAX_VOXELS, NumberFormat};
pub use image::{ImageKind, ImageQuestion, ImageReply, MAX_IMAGE_BYTES, MAX_IMAGES};
pub use maps::{MapDetail, MapReport, MapSummary};
pub use mirror::Follower;
pub use nearest::{NearestQuestion, NearestReply};
use question::demand;
pub use question::{
    MAP_FRAME, PointsQuestion, PointsReply, Unknown, UnknownPolicy, check_frame_id,
    check_unknown_distance, points_of,
};
pub use rays::{RaysQuestion, RaysReply, vectors_of};
use readers::Readers;
pub use slice::{Level, SliceQuestion, SliceReply};
use sought::Words;
pub use sought::{MAX_PROMPTS, Sought};
pub use spheres::{SpheresQuestion, SpheresReply, spheres_of};
use studio::Studio;
use tasks::PointsTask;
pub use terms::{Answered, Terms};
use times::Times;
pub use times::{Call, CallTimes};
pub use trajectories::{TrajectoriesQuestion, TrajectoriesReply, waypoints_of};
use watch::MAX_WATCHES;
pub use watch::{
    RegionBrick, RegionChange, RegionQuestion, RegionWatch, TrajectoryWatch, WatchedTrajectories,
};

/// The id of the one map.
pub const DEFAULT_MAP: &str = "default";
/// Its file in the storage folder.
const MAP_FILE: &str = "default.orenx";

/// A running server without its transports.
pub struct Service {
    mapper: Handle,
    readers: Readers,
    studio: Studio,
    counters: Arc<Counters>,
    times: Times,
    words: Words,
    /// Places of watches.
    watches: Arc<Semaphore>,
    /// Places of those who follow a map.
    mirrors: Arc<Semaphore>,
    max_points: usize,
    max_pixels: usize,
}

impl Service {
    /// Loads or creates the map and starts its thread and the readers. The caller keeps the
    /// [`Engine`]: it ends the thread and says whether the map was saved.
    pub fn start(config: &ServerConfig, map: MapConfig) -> Result<(Arc<Self>, Engine)> {
        let words = Words::new(TextEncoder::open(&config.encoder)?);
        let store = config.storage.as_deref().map(prepare_storage).transpose()?;
        let mut mapper = match &store {
            Some(path) => persist::load(path, map)?,
            None => Mapper::new(map)?,
        };
        mapper
            .train_on(Trainer { backend: config.backend, gpu_memory_mib: config.gpu_memory_mib })?;
        mapper.set_trainer_nice(config.trainer_nice)?;
        let settings = EngineSettings {
            lane_frames: config.lane_frames,
            lanes: config.lanes,
            queued_bytes: config.queued_bytes,
            max_frame_age: config.max_frame_age,
            publish_interval: config.publish_interval,
            store,
        };
        let engine = Engine::start(mapper, settings)?;
        let service = Self {
            mapper: engine.handle(),
            readers: Readers::start(config.query_threads, config.max_points)?,
            studio: Studio::start(config.query_threads)?,
            counters: Arc::default(),
            times: Times::default(),
            words,
            watches: Arc::new(Semaphore::new(MAX_WATCHES)),
            mirrors: mirror::places(),
            max_points: config.max_points,
            max_pixels: config.max_pixels,
        };
        Ok((Arc::new(service), engine))
    }

    /// A new connection of a sender: within it, sequence numbers and stamps of a sensor must go on.
    pub fn session(&self) -> Session {
        self.mapper.session()
    }

    /// How full the lane of a sensor is, and will be; nothing of a map that is not there.
    pub fn queue(&self, map_id: &str, robot_id: &str, sensor_id: &str) -> Queue {
        self.map(map_id).map_or_else(|_| Queue::default(), |m| m.queue(robot_id, sensor_id))
    }

    /// Checks a frame and hands it to the mapper; `sink` hears of its way and its end. `arrived` is
    /// when the last byte of it had come.
    pub async fn submit_frame(
        &self,
        session: Session,
        map_id: &str,
        frame: Frame,
        policy: QueuePolicy,
        sink: Box<dyn FrameSink>,
        arrived: Instant,
    ) {
        let sink = Counted::receive(&self.counters, sink, arrived);
        let checked = self.map(map_id).and_then(|mapper| {
            frame.check()?;
            self.check_contract(&frame, &mapper.published().view)?;
            Ok(mapper)
        });
        match checked {
            Ok(mapper) => mapper.submit(session, frame, policy, sink).await,
            Err(error) => sink.settle(Verdict::Rejected(error)),
        }
    }

    /// Refuses a frame that could not even be read, so that it is counted like any other.
    pub fn refuse_frame(&self, error: Error, sink: Box<dyn FrameSink>, arrived: Instant) {
        self.settle_frame(Verdict::Rejected(error), sink, arrived);
    }

    /// Counts a frame that gave way, or was refused, before it was read.
    pub fn settle_frame(&self, verdict: Verdict, sink: Box<dyn FrameSink>, arrived: Instant) {
        Counted::receive(&self.counters, sink, arrived).settle(verdict);
    }

    /// Counts frames that were sent and never came, where a transport can tell.
    pub fn lose_frames(&self, frames: u64) {
        self.counters.lose(frames);
    }

    /// Answers points from the newest view, if it is as new as the question demands. Small questions
    /// are answered on the calling thread, others on the readers, chunk by chunk; a dropped future
    /// stops the work at the next chunk. `call` says whose times these are.
    pub async fn query_points(&self, question: PointsQuestion, call: Call) -> Result<PointsReply> {
        let started = Instant::now();
        let Published { view, framed_at, .. } = self.map(&question.map_id)?.published();
        question.check(self.max_points)?;
        let (epoch, newest_stamp_ns) = (view.epoch(), view.newest_stamp_ns());
        let age = framed_at.map(|at| started.saturating_duration_since(at));
        demand((question.min_epoch, question.max_age), (epoch, age))?;
        let fill = question.unknown.fill(view.config().max_distance_m);
        let PointsQuestion { points, fields, text, .. } = question;
        let text = self.words.text(&view, text).await?;
        let task = PointsTask { view, points, fields, fill, text };
        let (answers, queued) = self.readers.answer(task).await?;
        let spent = started.elapsed();
        self.times.observe(call, queued, spent);
        Ok(PointsReply { answers, epoch, newest_stamp_ns, spent })
    }

    /// Draws the newest view, if it is as new as the question demands, one question at a time; a
    /// dropped future stops the work at the next tile. `call` says whose times these are.
    pub async fn render(&self, mut question: ImageQuestion, call: Call) -> Result<ImageReply> {
        let started = Instant::now();
        let Published { view, framed_at, .. } = self.map(&question.map_id)?.published();
        question.check(self.max_pixels)?;
        let (epoch, newest_stamp_ns) = (view.epoch(), view.newest_stamp_ns());
        let age = framed_at.map(|at| started.saturating_duration_since(at));
        demand((question.min_epoch, question.max_age), (epoch, age))?;
        let (width, height) = (question.camera.intrinsics.width, question.camera.intrinsics.height);
        let text = self.words.text(&view, question.text.take()).await?;
        let (images, queued) = self.studio.draw(view, question, text).await?;
        let spent = started.elapsed();
        self.times.observe(call, queued, spent);
        Ok(ImageReply { images, width, height, epoch, newest_stamp_ns, spent })
    }

    /// Every map.
    pub fn list_maps(&self) -> Vec<MapSummary> {
        vec![MapSummary::from(&self.mapper.published())]
    }

    /// One map and its settings.
    pub fn map_detail(&self, map_id: &str) -> Result<MapDetail> {
        let published = self.map(map_id)?.published();
        let config = published.view.config().clone();
        Ok(MapDetail { summary: MapSummary::from(&published), config })
    }

    /// Empties a map. Questions are answered meanwhile: from the old map until the empty one is
    /// published. The file on disk is replaced when the server saves.
    pub async fn reset_map(&self, map_id: &str) -> Result<Emptied> {
        self.map(map_id)?.reset().await
    }

    /// Boxes (world metres) that may hold a part of a map's surface.
    pub fn surface_leaves(&self, map_id: &str) -> Result<Vec<Aabb>> {
        Ok(self.map(map_id)?.published().view.surface_leaves())
    }

    /// One map's counters.
    pub fn map_stats(&self, map_id: &str) -> Result<MapReport> {
        let published = self.map(map_id)?.published();
        Ok(MapReport {
            summary: MapSummary::from(&published),
            stats: (*published.stats).clone(),
            counts: self.counters.read(),
            resident_bytes: crate::telemetry::resident_bytes(),
        })
    }

    /// What became of the frames.
    pub fn frame_counts(&self) -> FrameCounts {
        self.counters.read()
    }

    /// How long answers took, by call.
    pub fn call_times(&self) -> Vec<CallTimes> {
        self.times.read()
    }

    /// How long integrated frames took from their arrival, decoding included, until questions saw them.
    pub fn frame_times(&self) -> Distribution {
        self.counters.visible_after()
    }

    /// The newest epoch and the capture time of its newest frame, for acks.
    pub fn newest(&self) -> (u64, i64) {
        let view = self.mapper.published().view;
        (view.epoch(), view.newest_stamp_ns())
    }

    /// Takes no more frames: the one at hand is finished, those that wait are dropped.
    pub fn stop(&self) {
        self.mapper.stop();
    }

    /// Waits for the end of the mapper thread; an error if it failed.
    pub async fn ended(&self) -> Result<()> {
        self.mapper.ended().await
    }

    fn map(&self, map_id: &str) -> Result<&Handle> {
        match map_id {
            DEFAULT_MAP => Ok(&self.mapper),
            "" => Err(Error::invalid("map_id", format!("is required; try '{DEFAULT_MAP}'"))),
            other => Err(Error::NotFound {
                what: format!("map_id: map '{}'", other.chars().take(64).collect::<String>()),
            }),
        }
    }
}

/// Makes the storage folder, so that a wrong path is found at the start and not at the end.
fn prepare_storage(folder: &std::path::Path) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
    Ok(folder.join(MAP_FILE))
}
