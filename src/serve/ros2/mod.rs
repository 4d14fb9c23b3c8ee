//! The map as ROS 2 topics: grids for Nav2, a cloud of the surface, what the camera should see, and
//! what words find. Nothing is worked out for topics that nobody listens to. And as a service, for
//! planners that read nvblox.

mod cloud;
mod esdf;
mod grid;
mod picture;

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::MissedTickBehavior;

use crate::bus::{Bus, RobotNode, RobotService, TopicPublisher, TopicSubscriber};
use crate::config::{Ros2Config, Ros2Outputs};
use crate::error::Result;
use crate::ingest::RobotFrames;
use crate::service::Service;
use crate::wire::ros2::{Header, Text, Time, Type, decode};
use cloud::{Cloud, cloud};
use grid::{Band, bands};
use picture::pictures;

/// Words that may wait to be looked for.
const TEXTS: usize = 4;
/// The longest text, bytes.
const MAX_TEXT_BYTES: usize = 4096;

/// Everything of ROS 2: frames in and topics out, until dropped.
pub(super) struct Robot {
    _frames: RobotFrames,
    _tasks: JoinSet<()>,
    _texts: Option<TopicSubscriber>,
    _esdf: Option<RobotService>,
    _node: RobotNode,
}

/// What all outputs share.
#[derive(Clone)]
struct Source {
    service: Arc<Service>,
    map_id: String,
    map_frame: String,
}

impl Source {
    /// In the map's frame, of the time of what was last seen.
    fn header(&self, newest_stamp_ns: i64) -> Header {
        Header { stamp: Time::from_ns(newest_stamp_ns), frame_id: self.map_frame.clone() }
    }
}

impl Robot {
    /// Joins the robots behind the bridge of the settings. Called within a runtime.
    pub(super) async fn declare(
        bus: &Bus,
        config: &Ros2Config,
        service: &Arc<Service>,
        map_id: &str,
    ) -> Result<Self> {
        let node = RobotNode::join(bus, &config.bridge).await?;
        let source = Source {
            service: service.clone(),
            map_id: map_id.to_owned(),
            map_frame: config.map_frame.clone(),
        };
        let out = &config.outputs;
        let frames = RobotFrames::declare(&node, config, service, map_id).await?;
        let mut tasks = JoinSet::new();
        tasks.spawn(say_grids(&node, &source, out).await?);
        tasks.spawn(say_clouds(&node, &source, out).await?);
        tasks.spawn(say_pictures(&node, &source, out, &frames).await?);
        let mut texts = None;
        if let Some((text, matches)) = &out.text {
            let publisher = node.publish(matches, Type::POINT_CLOUD).await?;
            let (asked, waiting) = mpsc::channel(TEXTS);
            let subscriber = node.subscribe(text, Type::STRING, move |sample| {
                // One more than may wait is not looked for: its sender asks again.
                if sample.payload().len() <= MAX_TEXT_BYTES
                    && let Ok(Text { data }) = decode(&sample.payload().to_bytes())
                    && asked.try_send(data).is_err()
                {
                    tracing::warn!("ROS 2: too many texts at a time");
                }
            });
            texts = Some(subscriber.await?);
            tasks.spawn(say_matches(source.clone(), waiting, publisher));
        }
        let mut esdf = None;
        if let Some(name) = &out.esdf {
            let (service, requests) = esdf::declare(&node, &source, name).await?;
            tasks.spawn(requests.answer(source, out.esdf_voxel_m));
            esdf = Some(service);
        }
        Ok(Self { _frames: frames, _tasks: tasks, _texts: texts, _esdf: esdf, _node: node })
    }
}

/// A topic, if it is wanted.
async fn publisher(
    node: &RobotNode,
    topic: Option<&String>,
    kind: Type,
) -> Result<Option<TopicPublisher>> {
    match topic {
        Some(topic) => node.publish(topic, kind).await.map(Some),
        None => Ok(None),
    }
}

async fn is_heard(publisher: Option<&TopicPublisher>) -> bool {
    match publisher {
        Some(publisher) => publisher.is_heard().await,
        None => false,
    }
}

/// Ticks at a rate; late ones are left out.
fn clock(interval: Duration) -> tokio::time::Interval {
    let mut clock = tokio::time::interval(interval);
    clock.set_missed_tick_behavior(MissedTickBehavior::Delay);
    clock
}

/// Says a message, or why there is none.
async fn say(publisher: &TopicPublisher, message: Result<Vec<u8>>) {
    match message {
        Ok(payload) => publisher.put(payload).await,
        Err(error) => tracing::debug!("ROS 2: {error}"),
    }
}

async fn say_grids(
    node: &RobotNode,
    source: &Source,
    out: &Ros2Outputs,
) -> Result<impl Future<Output = ()> + Send + use<>> {
    let grid = publisher(node, out.grid.as_ref(), Type::OCCUPANCY_GRID).await?;
    let distance = publisher(node, out.distance.as_ref(), Type::DISTANCE_SLICE).await?;
    let band = Band { cell_m: out.cell_m, heights_m: out.band_m, radius_m: out.radius_m };
    let (mut clock, source) = (clock(out.grid_interval), source.clone());
    Ok(async move {
        loop {
            clock.tick().await;
            let heard = (is_heard(grid.as_ref()).await, is_heard(distance.as_ref()).await);
            if !heard.0 && !heard.1 {
                continue;
            }
            let columns = match bands(&source, &band).await {
                Ok(Some(columns)) => columns,
                Ok(None) => continue,
                Err(error) => {
                    tracing::warn!("ROS 2: no grid: {error}");
                    continue;
                }
            };
            if let Some(grid) = grid.as_ref().filter(|_| heard.0) {
                say(grid, columns.occupancy(&source, &band)).await;
            }
            if let Some(distance) = distance.as_ref().filter(|_| heard.1) {
                say(distance, columns.distances(&source, &band)).await;
            }
        }
    })
}

async fn say_clouds(
    node: &RobotNode,
    source: &Source,
    out: &Ros2Outputs,
) -> Result<impl Future<Output = ()> + Send + use<>> {
    let publisher = publisher(node, out.cloud.as_ref(), Type::POINT_CLOUD).await?;
    let (mut clock, source) = (clock(out.cloud_interval), source.clone());
    Ok(async move {
        let Some(publisher) = publisher else { return };
        loop {
            clock.tick().await;
            if publisher.is_heard().await {
                say(&publisher, cloud(&source, None).await.and_then(Cloud::encode)).await;
            }
        }
    })
}

async fn say_pictures(
    node: &RobotNode,
    source: &Source,
    out: &Ros2Outputs,
    frames: &RobotFrames,
) -> Result<impl Future<Output = ()> + Send + use<>> {
    let color = publisher(node, out.image.as_ref(), Type::IMAGE).await?;
    let depth = publisher(node, out.image_depth.as_ref(), Type::IMAGE).await?;
    let (mut clock, source) = (clock(out.image_interval), source.clone());
    let camera = frames.camera();
    Ok(async move {
        loop {
            clock.tick().await;
            let heard = (is_heard(color.as_ref()).await, is_heard(depth.as_ref()).await);
            let seen = *camera.borrow();
            let Some(camera) = seen.filter(|_| heard.0 || heard.1) else { continue };
            match pictures(&source, camera, heard).await {
                Err(error) => tracing::debug!("ROS 2: no image: {error}"),
                Ok(images) => {
                    for (publisher, image) in [(&color, images.0), (&depth, images.1)] {
                        if let (Some(publisher), Some(image)) = (publisher, image) {
                            publisher.put(image).await;
                        }
                    }
                }
            }
        }
    })
}

async fn say_matches(source: Source, mut texts: mpsc::Receiver<String>, publisher: TopicPublisher) {
    while let Some(text) = texts.recv().await {
        match cloud(&source, Some(&text)).await {
            Ok(found) => say(&publisher, found.encode()).await,
            Err(error) => tracing::warn!("ROS 2: '{text}' is not found: {error}"),
        }
    }
}
