//! Procedural scenes with closed-form distance: for the demo, tests and benchmarks.
//!
//! [`open`] knows `room`, `house`, `corridor`, `moved-box` and `removed-box`, with options after a colon:
//! `room:frames=300,width=320`, `corridor:length=100,step=0.2,range=5`, `moved-box:at=60`.

mod bvh;
pub mod corridor;
pub mod house;
pub mod moved_box;
mod render;
pub mod room;
mod scene;
mod solid;
mod texture;
pub mod truth;

use std::sync::Arc;

use super::{Dataset, FRAME_PERIOD_NS, ROBOT_ID, SENSOR_ID, check_index};
use crate::error::{Error, Result};
use crate::frame::{Frame, LabelImage, MAX_DEPTH_M, MAX_SIDE};
use crate::geometry::{Intrinsics, Pose};

pub use render::Renderer;
pub use scene::{Hit, Object, Scene, SceneBuilder};
pub use solid::Nearest;
pub use texture::Texture;

/// Frames of a synthetic sequence unless asked otherwise.
const FRAMES: usize = 600;
const WIDTH: u32 = 640;
const MAX_FRAMES: usize = 1_000_000;
const MAX_LENGTH_M: f32 = 5000.0;

/// A scene, or two in turn, and a camera's way through it.
pub struct Synthetic {
    name: String,
    /// Scenes in turn, each from its frame on; the first from frame 0.
    scenes: Vec<(usize, Scene)>,
    path: Path,
    frames: usize,
    intrinsics: Intrinsics,
    range_m: f32,
    renderer: Renderer,
}

/// The camera's way.
#[derive(Debug, Clone, Copy)]
enum Path {
    /// A loop that takes as many frames as there are.
    Room,
    /// The same through all rooms.
    House,
    Corridor {
        step_m: f64,
    },
    /// Swaying about one place.
    Sway,
}

impl Synthetic {
    /// The furnished room, walked through once in `frames` frames.
    pub fn room(frames: usize) -> Self {
        Self::new("synthetic:room", vec![(0, room::scene())], Path::Room, frames)
    }

    /// The house of three rooms and many classes, walked through once in `frames` frames.
    pub fn house(frames: usize) -> Self {
        Self::new("synthetic:house", vec![(0, house::scene())], Path::House, frames)
    }

    /// A corridor of `length_m`, walked along in steps of `step_m`.
    pub fn corridor(length_m: f32, step_m: f64) -> Self {
        let frames = corridor::steps(length_m, step_m);
        let scenes = vec![(0, corridor::scene(length_m))];
        Self::new("synthetic:corridor", scenes, Path::Corridor { step_m }, frames)
    }

    /// A box that moves aside at frame `at`.
    pub fn moved_box(frames: usize, at: usize) -> Self {
        let (before, after) = (moved_box::BEFORE, moved_box::AFTER);
        let scenes = vec![(0, moved_box::scene(Some(before))), (at, moved_box::scene(Some(after)))];
        Self::new("synthetic:moved-box", scenes, Path::Sway, frames)
    }

    /// A box that is gone from frame `at` on.
    pub fn removed_box(frames: usize, at: usize) -> Self {
        let scenes =
            vec![(0, moved_box::scene(Some(moved_box::BEFORE))), (at, moved_box::scene(None))];
        Self::new("synthetic:removed-box", scenes, Path::Sway, frames)
    }

    fn new(name: &str, scenes: Vec<(usize, Scene)>, path: Path, frames: usize) -> Self {
        Self {
            name: name.into(),
            scenes,
            path,
            frames,
            intrinsics: camera(WIDTH),
            range_m: MAX_DEPTH_M,
            renderer: Renderer::default(),
        }
    }

    /// The same with images `width` pixels wide and ¾ as high, and the same field of view.
    pub fn with_width(mut self, width: u32) -> Self {
        self.intrinsics = camera(width);
        self
    }

    /// The same with images `height` pixels high, their centre where it was.
    pub fn with_height(mut self, height: u32) -> Self {
        self.intrinsics.height = height;
        self.intrinsics.cy = (f64::from(height) - 1.0) * 0.5;
        self
    }

    /// The same with a depth camera that sees as far as `range_m`.
    pub fn with_range(mut self, range_m: f32) -> Self {
        self.range_m = range_m.min(MAX_DEPTH_M);
        self
    }

    /// How far the depth camera sees, m.
    pub fn range_m(&self) -> f32 {
        self.range_m
    }

    /// The scene as it is at a frame.
    pub fn scene(&self, index: usize) -> &Scene {
        let now = self.scenes.iter().rev().find(|(first, _)| *first <= index);
        &now.unwrap_or(&self.scenes[0]).1
    }

    /// The camera at a frame.
    pub fn pose(&self, index: usize) -> Pose {
        match self.path {
            Path::Room => room::walk(index as f64 / self.frames as f64),
            Path::House => house::walk(index as f64 / self.frames as f64),
            Path::Corridor { step_m } => corridor::walk(index, step_m),
            Path::Sway => moved_box::sway(index),
        }
    }
}

impl Dataset for Synthetic {
    fn name(&self) -> &str {
        &self.name
    }

    fn len(&self) -> usize {
        self.frames
    }

    fn intrinsics(&self) -> Intrinsics {
        self.intrinsics
    }

    fn load(&self, index: usize, with_color: bool) -> Result<Frame> {
        check_index(index, self.frames)?;
        let (scene, k, pose) = (self.scene(index), self.intrinsics, self.pose(index));
        let (depth, color) = if with_color {
            let (depth, color) = self.renderer.depth_and_color(scene, &k, &pose, self.range_m);
            (depth, Some(color))
        } else {
            (self.renderer.depth(scene, &k, &pose, self.range_m), None)
        };
        Ok(Frame {
            robot_id: Arc::from(ROBOT_ID),
            sensor_id: Arc::from(SENSOR_ID),
            seq: index as u64,
            stamp_ns: (index as i64 + 1) * FRAME_PERIOD_NS,
            world_from_camera: pose,
            intrinsics: k,
            depth,
            color,
            features: None,
        })
    }

    fn labels(&self, index: usize) -> Result<Option<LabelImage>> {
        check_index(index, self.frames)?;
        let (scene, pose) = (self.scene(index), self.pose(index));
        Ok(Some(self.renderer.labels(scene, &self.intrinsics, &pose, self.range_m)))
    }
}

/// A camera 62° wide, as common RGB-D cameras are.
fn camera(width: u32) -> Intrinsics {
    let height = (width * 3 / 4).max(1);
    let f = f64::from(width) * 525.0 / 640.0;
    let centre = |side: u32| (f64::from(side) - 1.0) * 0.5;
    Intrinsics { fx: f, fy: f, cx: centre(width), cy: centre(height), width, height }
}

/// Opens a synthetic sequence by its name and options, without the `synthetic:` before them.
pub fn open(spec: &str) -> Result<Synthetic> {
    let (name, options) = spec.split_once(':').unwrap_or((spec, ""));
    let mut options = Options::parse(options)?;
    let frames = options.take("frames", FRAMES as f64, 1.0, MAX_FRAMES as f64)? as usize;
    let width = options.take("width", f64::from(WIDTH), 8.0, f64::from(MAX_SIDE))? as u32;
    let range_m = options.take("range", f64::from(MAX_DEPTH_M), 0.1, f64::from(MAX_DEPTH_M))?;
    let sequence = match name {
        "room" => Synthetic::room(frames),
        "house" => Synthetic::house(frames),
        "corridor" => {
            let length_m = options.take("length", 30.0, 4.0, f64::from(MAX_LENGTH_M))? as f32;
            let step_m = options.take("step", 0.1, 0.01, 10.0)?;
            let mut corridor = Synthetic::corridor(length_m, step_m);
            corridor.frames = corridor.frames.min(frames.max(1));
            corridor
        }
        "moved-box" | "removed-box" => {
            let at = options.take("at", 60.0, 0.0, MAX_FRAMES as f64)? as usize;
            let make =
                if name == "moved-box" { Synthetic::moved_box } else { Synthetic::removed_box };
            make(frames, at)
        }
        _ => {
            return Err(Error::invalid(
                "dataset",
                format!(
                    "unknown synthetic scene '{name}'; there are room, house, corridor, \
                     moved-box, removed-box"
                ),
            ));
        }
    };
    options.finish()?;
    Ok(sequence.with_width(width).with_range(range_m as f32))
}

/// `key=number` pairs that have not been used yet.
struct Options<'a>(Vec<(&'a str, f64)>);

impl<'a> Options<'a> {
    fn parse(text: &'a str) -> Result<Self> {
        let pair = |part: &'a str| {
            part.split_once('=')
                .and_then(|(key, value)| Some((key, value.parse().ok()?)))
                .ok_or_else(|| {
                    Error::invalid("dataset", format!("option '{part}' must be key=number"))
                })
        };
        Ok(Self(text.split(',').filter(|p| !p.is_empty()).map(pair).collect::<Result<_>>()?))
    }

    fn take(&mut self, key: &str, default: f64, least: f64, most: f64) -> Result<f64> {
        let Some(place) = self.0.iter().position(|(k, _)| *k == key) else { return Ok(default) };
        let (_, value) = self.0.remove(place);
        if (least..=most).contains(&value) {
            return Ok(value);
        }
        Err(Error::invalid(
            format!("dataset option {key}"),
            format!("{value} must lie within {least}..={most}"),
        ))
    }

    fn finish(self) -> Result<()> {
        match self.0.first() {
            None => Ok(()),
            Some((key, _)) => {
                Err(Error::invalid("dataset", format!("this scene has no option '{key}'")))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::truth::Region;
    use super::*;

    #[test]
    fn every_hit_of_every_scene_lies_on_a_surface() {
        for spec in ["room:width=80", "house:width=80", "corridor:width=80", "moved-box:width=80"] {
            let data = open(spec).expect("opened");
            for index in (0..data.len()).step_by(41) {
                let frame = data.load(index, false).expect("loaded");
                let scene = data.scene(index);
                for v in 0..frame.depth.height {
                    for u in 0..frame.depth.width {
                        let z = frame.depth.at(u, v);
                        if z > 0.0 {
                            let d = scene.distance(frame.world_point(u, v, z));
                            assert!(d.abs() < 1e-4, "{spec} frame {index} ({u}, {v}): {d}");
                            let before = scene.distance(frame.world_point(u, v, z * 0.99));
                            assert!(before > 0.0, "{spec} frame {index} ({u}, {v}): {before}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_room_is_closed_and_all_its_objects_are_seen() {
        let data = Synthetic::room(300).with_width(64);
        let scene = data.scene(0);
        let k = data.intrinsics();
        let mut pixels = vec![0; scene.objects().len()];
        for index in (0..data.len()).step_by(4) {
            let frame = data.load(index, false).expect("loaded");
            assert_eq!(frame.depth.valid_pixels(), k.pixels());
            for v in 0..k.height {
                for u in 0..k.width {
                    let direction = frame.world_point(u, v, 1.0) - frame.world_point(u, v, 0.0);
                    let hit = scene.cast(frame.world_from_camera.position_f32(), direction);
                    pixels[usize::from(hit.expect("a closed room").object)] += 1;
                }
            }
        }
        for (object, seen) in scene.objects().iter().zip(pixels) {
            assert!(seen >= 10, "{} is seen in {seen} pixels", object.name);
        }
    }

    #[test]
    fn distances_change_by_their_gradient_and_have_the_right_sign() {
        let data = Synthetic::room(200).with_width(64);
        let scene = data.scene(0);
        let frames: Vec<usize> = (0..200).step_by(5).collect();
        for region in [Region::Near { band_m: 0.1 }, Region::Far { clear_m: 0.1 }] {
            let points = truth::points(&data, &frames, region, 2000, 1);
            assert_eq!(points.len(), 2000);
            let mut smooth = 0;
            for p in &points {
                assert!((p.gradient.length() - 1.0).abs() < 1e-4);
                assert_eq!(scene.distance(p.point), p.distance);
                let foot = p.point - p.gradient * p.distance;
                assert!(scene.distance(foot).abs() < 1e-4, "{}", p.point);
                let h = 1e-3;
                let along = |axis: Vec3| {
                    scene.distance(p.point + axis * h) - scene.distance(p.point - axis * h)
                };
                let difference = Vec3::from(Vec3::AXES.map(along)) / (2.0 * h);
                smooth += usize::from((difference - p.gradient).length() < 0.02);
            }
            // Where two surfaces are equally near there is no gradient.
            assert!(smooth > 1900, "{region:?}: {smooth}");
            let behind = points.iter().filter(|p| p.distance < 0.0).count();
            match region {
                Region::Near { .. } => assert!((500..1200).contains(&behind), "{behind} behind"),
                Region::Far { .. } => assert_eq!(behind, 0),
            }
            assert!(points.iter().filter(|p| p.closest_observed).count() > 1600);
        }
        assert!(scene.distance(Vec3::new(4.0, 0.0, 1.0)) < -0.99, "behind a wall");
        assert!(scene.distance(Vec3::new(2.68, -1.3, 1.0)) < -0.3, "inside the wardrobe");
    }

    #[test]
    fn no_point_of_a_surface_is_nearer_than_the_distance() {
        let data = Synthetic::room(60).with_width(48);
        let scene = data.scene(0);
        let frames: Vec<usize> = (0..60).collect();
        let free = truth::points(&data, &frames, Region::Far { clear_m: 0.0 }, 100, 2);
        for index in (0..60).step_by(3) {
            let frame = data.load(index, false).expect("loaded");
            for (v, u) in (0..36).flat_map(|v| (0..48).map(move |u| (v, u))) {
                let surface = frame.world_point(u, v, frame.depth.at(u, v));
                for p in &free {
                    assert!(p.point.distance(surface) > p.distance - 1e-4);
                }
            }
        }
        assert!(scene.objects().len() > 40);
    }

    #[test]
    fn the_box_moves_at_its_frame() {
        let data = open("moved-box:at=10,frames=20").expect("opened");
        for (index, at_first, later) in [(9, true, false), (10, false, true)] {
            let scene = data.scene(index);
            assert_eq!(scene.distance(moved_box::BEFORE) < 0.0, at_first);
            assert_eq!(scene.distance(moved_box::AFTER) < 0.0, later);
        }
        let gone = open("removed-box:at=10").expect("opened");
        assert!(gone.scene(10).distance(moved_box::AFTER) > 0.0);
        assert!(gone.scene(10).distance(moved_box::BEFORE) > 0.0);
    }

    #[test]
    fn wrong_names_and_options_are_refused() {
        for (spec, part) in [
            ("attic", "attic"),
            ("room:length=5", "length"),
            ("room:frames=0", "frames"),
            ("room:frames", "key=number"),
            ("corridor:step=nan", "step"),
        ] {
            let error = open(spec).err().expect("refused");
            assert!(error.to_string().contains(part), "{error}");
        }
        let room = open("room:frames=30,width=320").expect("opened");
        assert_eq!((room.len(), room.intrinsics().height), (30, 240));
        assert!(room.load(0, true).expect("loaded").check().is_ok());
    }
}
