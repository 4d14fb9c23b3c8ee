//! The verbs: everything that a robot or a planner can ask for, whatever it speaks.
//!
//! Every transport converts its messages, calls these, and converts the answers; nothing is decided
//! anywhere else.

mod counters;
mod find;
mod grid;
mod image;
mod language;
mod local;
mod maps;
mod mirror;
mod nearest;
mod pieces;
mod question;
mod rays;
mod readers;
mod registry;
mod slice;
mod snapshots;
mod sought;
mod spheres;
mod studio;
mod tasks;
mod terms;
mod times;
mod trajectories;
mod watch;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use tokio::sync::{Semaphore, watch as channel};

use crate::config::{MapConfig, ServerConfig};
use crate::encoder::TextEncoder;
use crate::engine::{
    Emptied, FrameSink, Handle, Published, Queue, QueuePolicy, Reason, Session, Verdict,
};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::geometry::Aabb;
use crate::map::{Edit, Edited};
use crate::telemetry::Distribution;

use counters::{Counted, Counters};
pub use counters::{FrameCounts, RobotReport, Sighting};
pub use find::{
    ClassifyQuestion, ClassifyReply, Encoders, FindQuestion, FindReply, MAX_CLASS_SCORES,
    MAX_CLASSES, MAX_MATCHES,
};
pub use grid::{Grid, GridColumns, GridQuestion, GridReply, MAX_VOXELS, NumberFormat};
pub use image::{ImageKind, ImageQuestion, ImageReply, MAX_IMAGE_BYTES, MAX_IMAGES};
pub use local::Local;
pub use maps::{MapDetail, MapHealth, MapReport, MapSummary};
pub use mirror::Follower;
pub use nearest::{NearestQuestion, NearestReply};
use pieces::Pieces;
pub use pieces::{PiecesQuestion, PiecesReply};
use question::demand;
pub use question::{
    MAP_FRAME, PointsQuestion, PointsReply, Unknown, UnknownPolicy, check_frame_id,
    check_unknown_distance, points_of,
};
pub use rays::{RaysQuestion, RaysReply, vectors_of};
use readers::Readers;
pub use registry::Mappers;
use registry::Registry;
pub use slice::{Level, SliceQuestion, SliceReply};
pub use snapshots::{Download, PIECE_BYTES, Upload};
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

/// The id of the map that every server has.
pub const DEFAULT_MAP: &str = "default";

/// A running server without its transports.
pub struct Service {
    registry: Arc<Registry>,
    sessions: AtomicU64,
    readers: Readers,
    studio: Studio,
    counters: Arc<Counters>,
    times: Times,
    words: Words,
    /// Places of watches.
    watches: Arc<Semaphore>,
    /// Places of those who follow a map.
    mirrors: Arc<Semaphore>,
    /// Pieces of meshes for those who draw them.
    pieces: Pieces,
    /// Places of snapshots on their way in or out.
    transfers: Arc<Semaphore>,
    max_snapshot_bytes: u64,
    max_points: usize,
    max_pixels: usize,
}

impl Service {
    /// Loads the maps, makes the default one if there is none, and starts their threads and the
    /// readers. The caller keeps the [`Mappers`]: they end the threads and say whether the maps were
    /// saved.
    pub fn start(config: &ServerConfig, map: MapConfig) -> Result<(Arc<Self>, Mappers)> {
        let words = Words::new(TextEncoder::open(&config.encoder)?);
        let (registry, mappers) = Registry::open(config, map)?;
        let service = Self {
            registry,
            sessions: AtomicU64::new(1),
            readers: Readers::start(config.query_threads, config.max_points)?,
            studio: Studio::start(config.query_threads, config.backend)?,
            counters: Arc::default(),
            times: Times::default(),
            words,
            watches: Arc::new(Semaphore::new(MAX_WATCHES)),
            mirrors: mirror::places(),
            pieces: Pieces::default(),
            transfers: snapshots::places(),
            max_snapshot_bytes: config.keep.max_snapshot_bytes,
            max_points: config.max_points,
            max_pixels: config.max_pixels,
        };
        Ok((Arc::new(service), mappers))
    }

    /// A new connection of a sender: within it, sequence numbers and stamps of a sensor must go on.
    pub fn session(&self) -> Session {
        Session::numbered(self.sessions.fetch_add(1, Relaxed))
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
        let sink = self.counted(map_id, sink, arrived);
        let checked = self.registry.get(map_id).and_then(|map| {
            frame.check()?;
            self.check_contract(&frame, &map.handle.published().view)?;
            Ok(map)
        });
        match checked {
            Ok(map) => {
                let sink = map.tallies.of_robot(&frame, sink, arrived);
                map.handle.submit(session, frame, policy, sink).await;
            }
            Err(error) => sink.settle(Verdict::Rejected(error)),
        }
    }

    /// Refuses a frame that could not even be read, so that it is counted like any other: its map's, if
    /// there is one of this id.
    pub fn refuse_frame(
        &self,
        map_id: &str,
        error: Error,
        sink: Box<dyn FrameSink>,
        arrived: Instant,
    ) {
        self.settle_frame(map_id, Verdict::Rejected(error), sink, arrived);
    }

    /// Counts a frame that gave way, or was refused, before it was read.
    pub fn settle_frame(
        &self,
        map_id: &str,
        verdict: Verdict,
        sink: Box<dyn FrameSink>,
        arrived: Instant,
    ) {
        self.counted(map_id, sink, arrived).settle(verdict);
    }

    /// Counts frames that were sent and never came, where a transport can tell.
    pub fn lose_frames(&self, map_id: &str, frames: u64) {
        self.counters.lose(frames);
        if let Ok(map) = self.registry.get(map_id) {
            map.tallies.all.lose(frames);
        }
    }

    /// A sink that counts the frame for the server, and for its map.
    fn counted(
        &self,
        map_id: &str,
        sink: Box<dyn FrameSink>,
        arrived: Instant,
    ) -> Box<dyn FrameSink> {
        let sink = Counted::receive(&self.counters, sink, arrived);
        match self.registry.get(map_id) {
            Ok(map) => Counted::receive(&map.tallies.all, sink, arrived),
            Err(_) => sink,
        }
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

    /// Every map, also those that could not be loaded.
    pub fn list_maps(&self) -> Vec<MapSummary> {
        self.registry.list()
    }

    /// The ids of the maps that are served, now and from now on.
    pub fn map_ids(&self) -> channel::Receiver<BTreeSet<String>> {
        self.registry.ids()
    }

    /// Makes an empty map; `settings`, by the names of `[map]`, go over those of the server.
    pub async fn create_map(
        &self,
        map_id: &str,
        settings: &BTreeMap<String, String>,
    ) -> Result<MapDetail> {
        self.registry.create(map_id, settings).await
    }

    /// Deletes a map and everything that is stored of it. The default map stays.
    pub async fn delete_map(&self, map_id: &str) -> Result<()> {
        self.registry.delete(map_id).await
    }

    /// One map and its settings.
    pub fn map_detail(&self, map_id: &str) -> Result<MapDetail> {
        let published = self.map(map_id)?.published();
        let config = published.view.config().clone();
        Ok(MapDetail { summary: MapSummary::of(map_id.into(), &published.view), config })
    }

    /// Empties a map. Questions are answered meanwhile: from the old map until the empty one is
    /// published. That is on disk before this returns. Of a map that could not be loaded the file is
    /// set aside.
    pub async fn reset_map(&self, map_id: &str) -> Result<Emptied> {
        self.registry.reset(map_id).await
    }

    /// Changes a map by hand, after the frames that wait, and publishes it. Questions are answered from
    /// the old map until then.
    pub async fn edit_map(&self, map_id: &str, edit: Edit) -> Result<Edited> {
        let map = self.map(map_id)?;
        edit.check()?;
        map.edit(edit).await
    }

    /// Boxes (world metres) that may hold a part of a map's surface.
    pub fn surface_leaves(&self, map_id: &str) -> Result<Vec<Aabb>> {
        Ok(self.map(map_id)?.published().view.surface_leaves())
    }

    /// One map's counters.
    pub fn map_stats(&self, map_id: &str) -> Result<MapReport> {
        let map = self.registry.get(map_id)?;
        let published = map.handle.published();
        Ok(MapReport {
            summary: MapSummary::of(map_id.into(), &published.view),
            stats: (*published.stats).clone(),
            counts: map.tallies.all.read(),
            robots: map.tallies.robots(),
            storage: map.handle.storage(),
            resident_bytes: crate::telemetry::resident_bytes(),
        })
    }

    /// How soon one map's frames are seen, and how much it has learned of language.
    pub fn map_health(&self, map_id: &str) -> Result<MapHealth> {
        let map = self.registry.get(map_id)?;
        let atoms = map.handle.published().view.atoms();
        Ok(MapHealth { visible_after: map.tallies.all.visible_after(), atoms })
    }

    /// What became of the frames for all maps, and for none.
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

    /// A map's newest epoch and the capture time of its newest frame, for acks; zeros without a map.
    pub fn newest(&self, map_id: &str) -> (u64, i64) {
        let newest = |handle: Handle| {
            let view = handle.published().view;
            (view.epoch(), view.newest_stamp_ns())
        };
        self.map(map_id).map(newest).unwrap_or_default()
    }

    /// Takes no more frames: the one at hand is finished, those that wait are dropped.
    pub fn stop(&self) {
        self.registry.stop();
    }

    /// Waits for the ends of all mapper threads; an error as soon as one has failed.
    pub async fn ended(&self) -> Result<()> {
        self.registry.ended().await
    }

    fn map(&self, map_id: &str) -> Result<Handle> {
        Ok(self.registry.get(map_id)?.handle.clone())
    }
}
