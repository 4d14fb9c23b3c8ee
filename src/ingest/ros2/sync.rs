//! Depth, colour, camera and pose, which come on topics of their own, put together by their stamps.
//!
//! Knows no clock: who calls says what time it is.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::tree::{NoPose, Tree};
use crate::error::{Error, Fault};
use crate::frame::{ColorImage, DepthImage, Frame};
use crate::geometry::{Intrinsics, Pose};
use crate::wire::ros2::Stamped;

/// Depth images that wait for the rest.
const WAITING: usize = 8;
/// Colour images that wait for their depth.
const COLORS: usize = 8;
/// A stamp this far before the last one is of a clock that began anew, ns.
const RESTART_NS: i64 = 2_000_000_000;

/// What belongs together.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rules {
    pub(super) robot_id: Arc<str>,
    pub(super) sensor_id: Arc<str>,
    /// The world.
    pub(super) map_frame: String,
    /// Whose pose is asked for; `None`: that of the depth image.
    pub(super) camera_frame: Option<String>,
    pub(super) has_color: bool,
    /// How far apart the stamps of depth and colour may be, ns.
    pub(super) tolerance_ns: i64,
    /// How long a depth image waits for the rest.
    pub(super) patience: Duration,
}

/// An image and where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Seen<T> {
    pub(super) stamp_ns: i64,
    pub(super) frame_id: String,
    pub(super) image: T,
    pub(super) arrived: Instant,
}

/// A whole frame.
#[derive(Debug)]
pub(super) struct Made {
    pub(super) frame: Frame,
    pub(super) arrived: Instant,
    /// Counts clocks that began anew.
    pub(super) run: u64,
    /// Why it has no colour, if it should have one.
    pub(super) colorless: Option<Colorless>,
}

/// Why a frame has no colour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Colorless {
    /// No image within the tolerance.
    TooFar,
    /// The image is of another camera: it must be aligned with depth.
    OtherView,
}

impl Colorless {
    pub(super) fn text(self) -> &'static str {
        match self {
            Self::TooFar => "no color image within ros2.tolerance_ms of the depth image",
            Self::OtherView => "color is of another camera: align it with depth on the robot",
        }
    }
}

/// What became of a depth image.
#[derive(Debug)]
pub(super) enum Outcome {
    Made(Box<Made>),
    /// Never became a frame; when it arrived.
    Lost(Error, Instant),
    /// Gave way to newer ones while it waited for what the text says.
    Crowded(String, Instant),
}

/// Puts frames together, in the order of their stamps.
pub(super) struct Synchroniser {
    rules: Rules,
    tree: Tree,
    camera: Option<Result<Intrinsics, String>>,
    depths: VecDeque<Seen<DepthImage>>,
    colors: VecDeque<Seen<ColorImage>>,
    newest_ns: Option<i64>,
    seq: u64,
    run: u64,
    lost: Vec<Outcome>,
}

impl Synchroniser {
    pub(super) fn new(rules: Rules) -> Self {
        Self {
            rules,
            tree: Tree::default(),
            camera: None,
            depths: VecDeque::new(),
            colors: VecDeque::new(),
            newest_ns: None,
            seq: 0,
            run: 0,
            lost: Vec::new(),
        }
    }

    pub(super) fn take_transform(&mut self, stamped: Stamped, is_still: bool) {
        self.tree.take(stamped, is_still);
    }

    /// The newest word on the camera counts, also where it says that there is none to work with.
    pub(super) fn take_camera(&mut self, camera: Result<Intrinsics, Error>) {
        self.camera = Some(camera.map_err(|error| error.to_string()));
    }

    pub(super) fn take_color(&mut self, color: Seen<ColorImage>) {
        if self.colors.len() >= COLORS {
            self.colors.pop_front();
        }
        self.colors.push_back(color);
    }

    pub(super) fn take_depth(&mut self, depth: Seen<DepthImage>) {
        if let Some(newest_ns) = self.newest_ns
            && depth.stamp_ns <= newest_ns
        {
            if newest_ns.saturating_sub(depth.stamp_ns) <= RESTART_NS {
                let problem = format!("{} ns does not follow {newest_ns}", depth.stamp_ns);
                let error = Error::frame(Fault::OutOfOrder, "header.stamp", problem);
                self.lost.push(Outcome::Lost(error, depth.arrived));
                return;
            }
            self.restart();
        }
        self.newest_ns = Some(depth.stamp_ns);
        self.depths.push_back(depth);
    }

    /// A clock that began anew, as of a recording that is played again: nothing of before fits.
    fn restart(&mut self) {
        for depth in self.depths.drain(..) {
            self.lost.push(Outcome::Crowded("the clock went back".into(), depth.arrived));
        }
        self.colors.clear();
        self.tree.restart();
        self.run += 1;
    }

    /// When the oldest depth image gives up.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.depths.front().map(|depth| depth.arrived + self.rules.patience)
    }

    /// What became of images until now, in order.
    pub(super) fn outcomes(&mut self, now: Instant) -> Vec<Outcome> {
        let mut outcomes = std::mem::take(&mut self.lost);
        while let Some(depth) = self.depths.front() {
            let is_late = now >= depth.arrived + self.rules.patience;
            let is_crowded = self.depths.len() > WAITING;
            let arrived = depth.arrived;
            match self.parts(depth, is_late || is_crowded) {
                Ok((camera, pose, color)) => {
                    let made = self.make(camera, pose, color);
                    outcomes.extend(made.map(|made| Outcome::Made(Box::new(made))));
                    continue;
                }
                Err(Missing::Never(error)) => outcomes.push(Outcome::Lost(error, arrived)),
                Err(Missing::Yet(error)) if is_late => outcomes.push(Outcome::Lost(error, arrived)),
                Err(Missing::Yet(error)) if is_crowded => {
                    outcomes.push(Outcome::Crowded(error.to_string(), arrived));
                }
                Err(_) => break,
            }
            self.depths.pop_front();
        }
        outcomes
    }

    /// What a depth image needs to become a frame. Without a colour it is one too, `at_once` or when
    /// no colour can come any more.
    fn parts(&self, depth: &Seen<DepthImage>, at_once: bool) -> Result<Parts, Missing> {
        let camera = match &self.camera {
            Some(Ok(camera)) => *camera,
            Some(Err(problem)) => return Err(Missing::Yet(no_camera(problem))),
            None => return Err(Missing::Yet(no_camera("no CameraInfo has come"))),
        };
        let source = self.rules.camera_frame.as_deref().unwrap_or(&depth.frame_id);
        let pose = self.tree.pose(&self.rules.map_frame, source, depth.stamp_ns);
        let no_pose = |no: &NoPose| Error::invalid("world_from_camera", no.problem());
        let pose = match pose {
            Ok(pose) => pose,
            Err(no @ NoPose::Yet(_)) => return Err(Missing::Yet(no_pose(&no))),
            Err(no @ NoPose::Gone(_)) => return Err(Missing::Never(no_pose(&no))),
        };
        if !self.rules.has_color {
            return Ok((camera, pose, Ok(None)));
        }
        let gap = |color: &Seen<ColorImage>| color.stamp_ns.abs_diff(depth.stamp_ns);
        let best = (0..self.colors.len()).min_by_key(|at| gap(&self.colors[*at]));
        match best {
            Some(at) if gap(&self.colors[at]) <= self.rules.tolerance_ns.unsigned_abs() => {
                let is_same = self.colors[at].frame_id == depth.frame_id;
                Ok((camera, pose, if is_same { Ok(Some(at)) } else { Err(Colorless::OtherView) }))
            }
            // What comes next is later still.
            Some(at) if self.colors[at].stamp_ns > depth.stamp_ns || at_once => {
                Ok((camera, pose, Err(Colorless::TooFar)))
            }
            _ if at_once => Ok((camera, pose, Err(Colorless::TooFar))),
            _ => Err(Missing::Yet(Error::invalid("color", "has not come"))),
        }
    }

    /// The frame of the oldest depth image.
    fn make(
        &mut self,
        intrinsics: Intrinsics,
        world_from_camera: Pose,
        color: Result<Option<usize>, Colorless>,
    ) -> Option<Made> {
        let Seen { stamp_ns, image: depth, arrived, .. } = self.depths.pop_front()?;
        let colorless = color.err();
        let color = color.ok().flatten().and_then(|at| self.colors.remove(at));
        let tolerance_ns = self.rules.tolerance_ns;
        self.colors.retain(|other| other.stamp_ns >= stamp_ns.saturating_sub(tolerance_ns));
        self.seq += 1;
        let frame = Frame {
            robot_id: self.rules.robot_id.clone(),
            sensor_id: self.rules.sensor_id.clone(),
            seq: self.seq,
            stamp_ns,
            world_from_camera,
            intrinsics,
            depth,
            color: color.map(|color| color.image),
            features: None,
        };
        Some(Made { frame, arrived, run: self.run, colorless })
    }
}

/// The camera, its pose, and the place of the colour among those that wait, if there should be one.
type Parts = (Intrinsics, Pose, Result<Option<usize>, Colorless>);

/// What keeps a depth image from being a frame.
enum Missing {
    Yet(Error),
    Never(Error),
}

fn no_camera(problem: &str) -> Error {
    Error::frame(Fault::Intrinsics, "intrinsics", problem)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    const MS: i64 = 1_000_000;
    const PATIENCE: Duration = Duration::from_millis(500);

    struct Bench {
        sync: Synchroniser,
        start: Instant,
    }

    impl Bench {
        fn new(change: impl FnOnce(&mut Rules)) -> Self {
            let mut rules = Rules {
                robot_id: "bot".into(),
                sensor_id: "front".into(),
                map_frame: "map".into(),
                camera_frame: None,
                has_color: true,
                tolerance_ns: 10 * MS,
                patience: PATIENCE,
            };
            change(&mut rules);
            Self { sync: Synchroniser::new(rules), start: Instant::now() }
        }

        /// With a camera, and a pose every 100 ms up to `until_ms`.
        fn ready(until_ms: i64) -> Self {
            let mut bench = Self::new(|_| {});
            bench.camera();
            bench.poses(0, until_ms);
            bench
        }

        fn camera(&mut self) {
            let k = Intrinsics { fx: 2.0, fy: 2.0, cx: 0.5, cy: 0.5, width: 2, height: 2 };
            self.sync.take_camera(Ok(k));
        }

        fn poses(&mut self, from_ms: i64, until_ms: i64) {
            for ms in (from_ms..=until_ms).step_by(100) {
                let translation = DVec3::X * ms as f64;
                let pose = Pose { translation, ..Pose::IDENTITY };
                let (parent, child) = ("map".into(), "camera".into());
                self.sync.take_transform(Stamped { parent, child, stamp_ns: ms * MS, pose }, false);
            }
        }

        fn depth(&mut self, ms: i64) {
            let image = DepthImage { width: 2, height: 2, metres: vec![1.0; 4] };
            let frame_id = "camera".into();
            self.sync.take_depth(Seen { stamp_ns: ms * MS, frame_id, image, arrived: self.start });
        }

        fn color(&mut self, ms: i64, frame_id: &str) {
            let image = ColorImage { width: 2, height: 2, rgb: vec![ms as u8; 12] };
            let (stamp_ns, frame_id) = (ms * MS, frame_id.into());
            self.sync.take_color(Seen { stamp_ns, frame_id, image, arrived: self.start });
        }

        /// Each as a word: stamp and colour in ms, or what is wrong.
        fn outcomes(&mut self, after: Duration) -> Vec<String> {
            let word = |outcome: Outcome| match outcome {
                Outcome::Made(made) => {
                    let color = made.frame.color.map(|c| c.rgb[0].to_string());
                    let why = made.colorless.map_or("none".into(), |c| format!("{c:?}"));
                    let x = made.frame.world_from_camera.translation.x;
                    assert!((x - (made.frame.stamp_ns / MS) as f64).abs() < 1e-9, "{x}");
                    format!("{}+{}", made.frame.stamp_ns / MS, color.unwrap_or(why))
                }
                Outcome::Lost(error, _) => format!("lost: {error}"),
                Outcome::Crowded(why, _) => format!("crowded: {why}"),
            };
            self.sync.outcomes(self.start + after).into_iter().map(word).collect()
        }
    }

    #[test]
    fn colours_within_the_tolerance_join_and_others_do_not() {
        let mut bench = Bench::ready(400);
        bench.color(42, "camera");
        bench.depth(50);
        bench.depth(83);
        assert_eq!(bench.outcomes(Duration::ZERO), ["50+42"]);
        // Exactly at the tolerance.
        bench.color(93, "camera");
        bench.depth(150);
        bench.color(161, "camera");
        assert_eq!(bench.outcomes(Duration::ZERO), ["83+93", "150+TooFar"]);
        bench.depth(200);
        bench.color(200, "other_camera");
        assert_eq!(bench.outcomes(Duration::ZERO), ["200+OtherView"]);
        // It comes late, or never.
        bench.depth(250);
        assert_eq!(bench.outcomes(PATIENCE / 2), [""; 0]);
        assert_eq!(bench.sync.deadline(), Some(bench.start + PATIENCE));
        assert_eq!(bench.outcomes(PATIENCE), ["250+TooFar"]);
    }

    #[test]
    fn what_is_missing_is_waited_for_and_then_named() {
        let mut bench = Bench::new(|rules| rules.has_color = false);
        bench.depth(50);
        assert_eq!(bench.outcomes(Duration::ZERO), [""; 0]);
        bench.camera();
        bench.poses(0, 100);
        assert_eq!(bench.outcomes(Duration::ZERO), ["50+none"]);
        bench.depth(130);
        assert_eq!(bench.outcomes(Duration::ZERO), [""; 0]);
        let lost = bench.outcomes(PATIENCE).concat();
        assert!(lost.contains("lost: world_from_camera") && lost.contains("0.030 s"), "{lost}");
        bench.poses(200, 300);
        bench.sync.take_camera(Err(Error::invalid("camera_info.k", "not calibrated")));
        bench.depth(250);
        let lost = bench.outcomes(PATIENCE).concat();
        assert!(lost.contains("lost: intrinsics: camera_info.k: not calibrated"), "{lost}");
        let mut early = Bench::ready(0);
        early.poses(500, 600);
        early.depth(-100);
        let lost = early.outcomes(Duration::ZERO).concat();
        assert!(lost.contains("newer than the image"), "{lost}");
    }

    #[test]
    fn order_and_number_are_kept() {
        let mut bench = Bench::new(|rules| rules.has_color = false);
        bench.camera();
        for ms in 0..WAITING as i64 + 2 {
            bench.depth(ms);
        }
        bench.depth(3);
        let outcomes = bench.outcomes(Duration::ZERO);
        assert_eq!(outcomes.len(), 3, "{outcomes:?}");
        assert!(outcomes[0].contains("header.stamp"), "{outcomes:?}");
        assert!(outcomes[1].starts_with("crowded: world_from_camera"), "{outcomes:?}");
        bench.poses(0, 100);
        let outcomes = bench.outcomes(Duration::ZERO);
        assert_eq!(outcomes, (2..10).map(|ms| format!("{ms}+none")).collect::<Vec<_>>());
        for ms in 0..100 {
            bench.color(ms, "camera");
        }
        assert_eq!(bench.sync.colors.len(), COLORS);
    }

    #[test]
    fn a_recording_that_is_played_again_begins_anew() {
        let mut bench = Bench::new(|rules| rules.has_color = false);
        bench.camera();
        bench.poses(5000, 5100);
        bench.depth(5050);
        assert_eq!(bench.outcomes(Duration::ZERO), ["5050+none"]);
        bench.depth(50);
        bench.poses(0, 100);
        assert_eq!(bench.outcomes(Duration::ZERO), ["50+none"]);
        assert_eq!(bench.sync.run, 1);
    }

    #[test]
    fn a_pose_of_another_frame_may_be_meant() {
        let mut bench = Bench::new(|rules| {
            rules.has_color = false;
            rules.camera_frame = Some("camera".into());
        });
        bench.camera();
        bench.poses(0, 100);
        let image = DepthImage { width: 2, height: 2, metres: vec![1.0; 4] };
        let (frame_id, arrived) = ("no_such_frame".into(), bench.start);
        bench.sync.take_depth(Seen { stamp_ns: 7 * MS, frame_id, image, arrived });
        assert_eq!(bench.outcomes(Duration::ZERO), ["7+none"]);
    }
}
