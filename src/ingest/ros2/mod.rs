//! Frames from ROS 2 topics: images are decoded, put together with a camera and a pose (`sync`,
//! `tree`), and go the way of every frame.
//!
//! Threads of the network only put payloads into short queues; one task takes them out.

mod complaints;
mod sync;
mod tree;

use std::sync::Arc;
use std::time::Instant;

use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use zenoh::bytes::ZBytes;

use crate::bus::{RobotNode, TopicSubscriber};
use crate::config::Ros2Config;
use crate::engine::{FrameSink, Queue, QueuePolicy, Reason, Session, Verdict};
use crate::error::{Error, Fault, Result};
use crate::map::Camera;
use crate::service::Service;
use crate::wire::MAX_MESSAGE_BYTES;
use crate::wire::ros2::{
    Attachment, CameraInfo, CompressedImage, Header, Image, PoseStamped, TfMessage, Type,
    color_from_compressed, color_from_image, decode, depth_from_compressed, depth_from_image,
    intrinsics_from_info, pose_from_message, transform_from_message,
};
use complaints::Complaints;
use sync::{Outcome, Rules, Seen, Synchroniser};

/// Images that may wait to be decoded.
const IMAGES: usize = 8;
/// Other messages that may wait.
const SMALL: usize = 1024;
/// How image_transport ends the names of topics of compressed images.
const COMPRESSED: [&str; 2] = ["/compressed", "/compressedDepth"];
/// Transforms of one message.
const MAX_TRANSFORMS: usize = 1024;

/// Takes frames until dropped.
pub struct RobotFrames {
    _topics: Vec<TopicSubscriber>,
    _pump: JoinSet<()>,
    camera: watch::Receiver<Option<Camera>>,
}

/// A payload and when it came.
struct Arrival<K> {
    kind: K,
    payload: ZBytes,
    /// What rmw_zenoh puts beside it.
    attachment: Option<ZBytes>,
    arrived: Instant,
}

#[derive(Debug, Clone, Copy)]
enum Picture {
    Depth { is_compressed: bool },
    Color { is_compressed: bool },
}

#[derive(Debug, Clone, Copy)]
enum Small {
    Camera,
    Pose,
    Transforms { is_still: bool },
}

impl RobotFrames {
    /// Listens to the topics of the settings, for one map. Called within a runtime.
    pub async fn declare(
        node: &RobotNode,
        config: &Ros2Config,
        service: &Arc<Service>,
        map_id: &str,
    ) -> Result<Self> {
        let (pictures, incoming_pictures) = mpsc::channel(IMAGES);
        let (small, incoming_small) = mpsc::channel(SMALL);
        let (seen, camera) = watch::channel(None);
        let complaints = Arc::<Complaints>::default();
        let mut topics = Vec::new();
        let depth = config.depth.as_str();
        let depth_kind = Picture::Depth { is_compressed: is_compressed(depth) };
        let mut images = vec![(depth, depth_kind)];
        if let Some(color) = &config.color {
            images.push((color, Picture::Color { is_compressed: is_compressed(color) }));
        }
        for (topic, kind) in images {
            let wire = if is_compressed(topic) { Type::COMPRESSED_IMAGE } else { Type::IMAGE };
            let callback = queue(&pictures, kind, &complaints);
            topics.push(node.subscribe(topic, wire, callback).await?);
        }
        let mut others = vec![(config.camera_info.as_str(), Type::CAMERA_INFO, Small::Camera)];
        match &config.pose {
            Some(pose) => others.push((pose, Type::POSE_STAMPED, Small::Pose)),
            None => {
                let moving = Small::Transforms { is_still: false };
                others.push((&config.tf, Type::TF_MESSAGE, moving));
                let still = Small::Transforms { is_still: true };
                others.push((&config.tf_static, Type::TF_MESSAGE, still));
            }
        }
        for (topic, wire, kind) in others {
            let callback = queue(&small, kind, &complaints);
            topics.push(node.subscribe(topic, wire, callback).await?);
        }
        let pump = Pump {
            sync: Synchroniser::new(rules(config)),
            service: service.clone(),
            map_id: map_id.to_owned(),
            rectified: config.rectified,
            pose_child: config.camera_frame.clone().unwrap_or_default(),
            session: (0, service.session()),
            complaints,
            last: None,
            seen,
        };
        let mut pumps = JoinSet::new();
        pumps.spawn(pump.run(incoming_pictures, incoming_small));
        Ok(Self { _topics: topics, _pump: pumps, camera })
    }

    /// From where the newest frame was seen.
    pub fn camera(&self) -> watch::Receiver<Option<Camera>> {
        self.camera.clone()
    }
}

fn is_compressed(topic: &str) -> bool {
    COMPRESSED.iter().any(|end| topic.ends_with(end))
}

fn rules(config: &Ros2Config) -> Rules {
    Rules {
        robot_id: config.robot.as_str().into(),
        sensor_id: config.sensor.as_str().into(),
        map_frame: config.map_frame.clone(),
        // A pose without a name is the camera's.
        camera_frame: match (&config.camera_frame, &config.pose) {
            (None, Some(_)) => Some(String::new()),
            (frame, _) => frame.clone(),
        },
        has_color: config.color.is_some(),
        tolerance_ns: i64::try_from(config.tolerance.as_nanos()).unwrap_or(i64::MAX),
        patience: config.patience,
    }
}

/// Puts what comes into a queue; what finds no room is counted.
fn queue<K: Copy + Send + Sync + 'static>(
    into: &mpsc::Sender<Arrival<K>>,
    kind: K,
    complaints: &Arc<Complaints>,
) -> impl Fn(zenoh::sample::Sample) + Send + Sync + 'static {
    let (into, complaints) = (into.clone(), complaints.clone());
    move |sample| {
        let payload = sample.payload().clone();
        if payload.len() > MAX_MESSAGE_BYTES {
            let problem = format!("{} bytes; the limit is {MAX_MESSAGE_BYTES}", payload.len());
            complaints.note(sample.key_expr().as_str(), &problem);
            return;
        }
        let attachment = sample.attachment().cloned();
        let arrival = Arrival { kind, payload, attachment, arrived: Instant::now() };
        if into.try_send(arrival).is_err() {
            complaints.note(sample.key_expr().as_str(), "messages come faster than they are read");
        }
    }
}

/// Takes messages out of the queues and hands frames to the mapper.
struct Pump {
    sync: Synchroniser,
    service: Arc<Service>,
    map_id: String,
    rectified: bool,
    /// Whose pose `PoseStamped` is.
    pose_child: String,
    /// The run that frames are of, and its session.
    session: (u64, Session),
    complaints: Arc<Complaints>,
    /// Of the last depth image.
    last: Option<Attachment>,
    seen: watch::Sender<Option<Camera>>,
}

impl Pump {
    async fn run(
        mut self,
        mut pictures: mpsc::Receiver<Arrival<Picture>>,
        mut small: mpsc::Receiver<Arrival<Small>>,
    ) {
        loop {
            let deadline = self.sync.deadline();
            let given_up = async {
                match deadline {
                    Some(deadline) => tokio::time::sleep_until(deadline.into()).await,
                    None => std::future::pending().await,
                }
            };
            // What says where and with which camera goes before what was seen.
            tokio::select! {
                biased;
                Some(message) = small.recv() => self.take_small(&message),
                Some(picture) = pictures.recv() => self.take_picture(picture).await,
                () = given_up => {}
                else => return,
            }
            for outcome in self.sync.outcomes(Instant::now()) {
                self.settle(outcome).await;
            }
            self.complaints.tell();
        }
    }

    fn take_small(&mut self, message: &Arrival<Small>) {
        let payload = message.payload.to_bytes();
        let taken = match message.kind {
            Small::Camera => decode::<CameraInfo>(&payload).map(|info| {
                self.sync.take_camera(intrinsics_from_info(&info, self.rectified));
            }),
            Small::Pose => decode::<PoseStamped>(&payload).and_then(|message| {
                let mut stamped = pose_from_message(&message)?;
                stamped.child.clone_from(&self.pose_child);
                self.sync.take_transform(stamped, false);
                Ok(())
            }),
            Small::Transforms { is_still } => self.take_transforms(&payload, is_still),
        };
        if let Err(error) = taken {
            self.complaints.note("a message", &error.to_string());
        }
    }

    fn take_transforms(&mut self, payload: &[u8], is_still: bool) -> Result<()> {
        let message = decode::<TfMessage>(payload)?;
        if message.transforms.len() > MAX_TRANSFORMS {
            let problem = format!("{}; the limit is {MAX_TRANSFORMS}", message.transforms.len());
            return Err(Error::invalid("transforms", problem));
        }
        for transform in &message.transforms {
            match transform_from_message(transform) {
                Ok(stamped) => self.sync.take_transform(stamped, is_still),
                Err(error) => self.complaints.note("a transform", &error.to_string()),
            }
        }
        Ok(())
    }

    /// Decoding takes milliseconds: not for threads that others wait for.
    async fn take_picture(&mut self, picture: Arrival<Picture>) {
        let arrived = picture.arrived;
        let is_color = matches!(picture.kind, Picture::Color { .. });
        if let Some(attachment) = picture.attachment.as_ref().filter(|_| !is_color) {
            self.follow(attachment);
        }
        let decoding = tokio::task::spawn_blocking(move || read(&picture));
        let failed = |_| Err(Error::Internal("decoding this image failed".into()));
        match decoding.await.unwrap_or_else(failed) {
            Ok(Decoded::Depth(depth)) => self.sync.take_depth(depth),
            Ok(Decoded::Color(color)) => self.sync.take_color(color),
            Err(error) if is_color => self.complaints.note("a color image", &error.to_string()),
            Err(error) => self.refuse(error, arrived),
        }
    }

    /// Counts depth images that were sent and never came, where their publisher numbers them.
    fn follow(&mut self, attachment: &ZBytes) {
        match Attachment::from_bytes(&attachment.to_bytes()) {
            Ok(next) => {
                let last = self.last.replace(next);
                let lost = last.map_or(0, |last| next.lost_since(&last));
                self.service.lose_frames(&self.map_id, lost);
            }
            Err(error) => self.complaints.note("an attachment", &error.to_string()),
        }
    }

    fn refuse(&self, error: Error, arrived: Instant) {
        self.complaints.note("a frame", &error.to_string());
        self.service.refuse_frame(&self.map_id, error, self.sink(), arrived);
    }

    fn sink(&self) -> Box<dyn FrameSink> {
        Box::new(Told(self.complaints.clone()))
    }

    async fn settle(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Made(made) => {
                if let Some(why) = made.colorless {
                    self.complaints.note("a frame without color", why.text());
                }
                if made.run != self.session.0 {
                    self.session = (made.run, self.service.session());
                }
                let frame = made.frame;
                let (world_from_camera, intrinsics) = (frame.world_from_camera, frame.intrinsics);
                self.seen.send_replace(Some(Camera { world_from_camera, intrinsics }));
                let (session, policy, sink) = (self.session.1, QueuePolicy::Latest, self.sink());
                let (service, map_id) = (&self.service, &self.map_id);
                service.submit_frame(session, map_id, frame, policy, sink, made.arrived).await;
            }
            Outcome::Lost(error, arrived) => self.refuse(error, arrived),
            Outcome::Crowded(why, arrived) => {
                self.complaints.note("a frame gave way to newer ones", &why);
                let verdict = Verdict::Dropped(Reason::Replaced);
                self.service.settle_frame(&self.map_id, verdict, self.sink(), arrived);
            }
        }
    }
}

enum Decoded {
    Depth(Seen<crate::frame::DepthImage>),
    Color(Seen<crate::frame::ColorImage>),
}

fn read(picture: &Arrival<Picture>) -> Result<Decoded> {
    let payload = picture.payload.to_bytes();
    let arrived = picture.arrived;
    match picture.kind {
        Picture::Depth { is_compressed: false } => {
            let message = decode::<Image<'_>>(&payload)?;
            Ok(Decoded::Depth(seen(depth_from_image(&message)?, &message.header, arrived)?))
        }
        Picture::Depth { is_compressed: true } => {
            let message = decode::<CompressedImage<'_>>(&payload)?;
            Ok(Decoded::Depth(seen(depth_from_compressed(&message)?, &message.header, arrived)?))
        }
        Picture::Color { is_compressed: false } => {
            let message = decode::<Image<'_>>(&payload)?;
            Ok(Decoded::Color(seen(color_from_image(&message)?, &message.header, arrived)?))
        }
        Picture::Color { is_compressed: true } => {
            let message = decode::<CompressedImage<'_>>(&payload)?;
            Ok(Decoded::Color(seen(color_from_compressed(&message)?, &message.header, arrived)?))
        }
    }
}

fn seen<T>(image: T, header: &Header, arrived: Instant) -> Result<Seen<T>> {
    let stamp_ns = header.stamp.to_ns();
    if stamp_ns <= 0 {
        return Err(Error::frame(Fault::OutOfOrder, "header.stamp", "is not set"));
    }
    let frame_id = header.frame_id.trim_start_matches('/').to_owned();
    Ok(Seen { stamp_ns, frame_id, image, arrived })
}

/// Says why the mapper refused a frame: there is nobody on the robot to be told.
struct Told(Arc<Complaints>);

impl FrameSink for Told {
    fn accepted(&mut self, _queue: Queue) {}

    fn settle(self: Box<Self>, verdict: Verdict) {
        if let Verdict::Rejected(error) = verdict {
            self.0.note("a frame", &error.to_string());
        }
    }
}
