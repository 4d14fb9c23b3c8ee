//! Where the map was seen from: of these, the view that shows a thing best.

use bytemuck::{Pod, Zeroable};
use glam::{DMat3, DQuat, Mat3, Vec2, Vec3};

use crate::geometry::Pose;
use crate::map::query::{Fields, State};
use crate::map::view::MapView;
use crate::train::KeyFrame;

/// Points of a thing that are looked for in an image.
const SAMPLES: usize = 24;
/// Places along a line of sight, up to this far from its end, m.
const STEPS: usize = 12;
const END_M: f32 = 0.15;
/// Viewpoints that are tried for lines of sight, of those that have most of the thing in the image.
const TRIED: usize = 6;
/// The nearest and farthest that a camera sees things well from, m.
const NEAREST_M: f32 = 0.3;
const FARTHEST_M: f32 = 6.0;

/// A camera that frames came from.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Viewpoint {
    /// World metres.
    origin: [f32; 3],
    /// Columns of the rotation from camera to world.
    rotation: [f32; 9],
    /// 1/fx, 1/fy, cx, cy.
    camera: [f32; 4],
}

impl Viewpoint {
    pub(in crate::map) fn new(frame: &KeyFrame) -> Self {
        Self {
            origin: frame.origin.to_array(),
            rotation: frame.world_from_camera.to_cols_array(),
            camera: frame.camera,
        }
    }

    /// Whether all numbers are finite.
    pub(in crate::map) fn is_finite(&self) -> bool {
        bytemuck::cast_ref::<Self, [f32; 16]>(self).iter().all(|x| x.is_finite())
    }

    fn pose(&self) -> Pose {
        let rotation = DMat3::from_cols_array(&self.rotation.map(f64::from));
        Pose {
            rotation: DQuat::from_mat3(&rotation).normalize(),
            translation: Vec3::from(self.origin).as_dvec3(),
        }
    }

    /// How far from the middle of the image a point is seen, 1 at the border of an image whose
    /// principal point is in its middle; `None` outside, or too near or far.
    fn sees(&self, point: Vec3) -> Option<f32> {
        let rotation = Mat3::from_cols_array(&self.rotation);
        let own = rotation.transpose() * (point - Vec3::from(self.origin));
        let [ifx, ify, cx, cy] = self.camera;
        let border = Vec2::new(ifx * (cx + 0.5), ify * (cy + 0.5));
        let place = (own.truncate() / own.z / border).abs().max_element();
        ((NEAREST_M..=FARTHEST_M).contains(&own.z) && place < 1.0).then_some(place)
    }
}

/// The pose of the camera that has most of these points in its image and nothing in between.
pub(super) fn best(view: &MapView, points: &[Vec3]) -> Option<Pose> {
    let step = points.len().div_ceil(SAMPLES);
    let points: Vec<Vec3> = points.iter().step_by(step.max(1)).copied().collect();
    let middle = points.iter().sum::<Vec3>() / points.len().max(1) as f32;
    let framed = |viewpoint: &Viewpoint| {
        let seen = |p: &Vec3| viewpoint.sees(*p).map_or(0.0, |place| 1.0 - 0.5 * place);
        let seen: f32 = points.iter().map(seen).sum();
        // Nearer is larger, up to where the thing fills the image.
        let distance = middle.distance(Vec3::from(viewpoint.origin)).max(1.0);
        seen / (points.len() as f32 * distance.sqrt())
    };
    let mut order: Vec<(f32, &Viewpoint)> =
        view.viewpoints.iter().map(|viewpoint| (framed(viewpoint), viewpoint)).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0));
    let tried = order.into_iter().filter(|(framed, _)| *framed > 0.0).take(TRIED);
    tried
        .map(|(framed, viewpoint)| (framed * open(view, viewpoint, &points), viewpoint))
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .filter(|(score, _)| *score > 0.0)
        .map(|(_, viewpoint)| viewpoint.pose())
}

/// The share of the points to which nothing stands in the way.
fn open(view: &MapView, viewpoint: &Viewpoint, points: &[Vec3]) -> f32 {
    let origin = Vec3::from(viewpoint.origin);
    let along = points.iter().flat_map(|point| {
        let (way, length) = (*point - origin, point.distance(origin).max(END_M));
        (0..STEPS)
            .map(move |i| origin + way * ((1.0 - END_M / length) * (i as f32 + 0.5) / STEPS as f32))
    });
    let along: Vec<Vec3> = along.collect();
    let state = view.query(&along, Fields { state: true, ..Fields::NONE }).state;
    let clear = |line: &&[u8]| line.iter().all(|state| *state != State::Occupied as u8);
    state.chunks_exact(STEPS).filter(clear).count() as f32 / points.len().max(1) as f32
}
