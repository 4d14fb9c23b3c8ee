//! Point queries on a view.

use glam::Vec3;

use super::language::Scorer;
use super::view::MapView;
use crate::config::Prior;
use crate::geometry::simd::prefetch;
use crate::modality::read::{Answers, evaluate};
use crate::octree::Found;
use crate::surface::{Lattice, NEAR_M};

/// Points whose evidence is asked for ahead of its use: enough to hide a trip to memory.
const AHEAD: usize = 16;

/// What a query asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fields {
    pub distance: bool,
    pub gradient: bool,
    pub occupancy: bool,
    pub state: bool,
    pub color: bool,
    /// Where a question comes with a text.
    pub text_score: bool,
}

impl Fields {
    /// Every field of the map itself: all but the score of a text.
    pub const ALL: Self =
        Self { distance: true, gradient: true, occupancy: true, state: true, ..Self::COLOR };
    const COLOR: Self = Self { color: true, ..Self::NONE };
    pub const NONE: Self = Self {
        distance: false,
        gradient: false,
        occupancy: false,
        state: false,
        color: false,
        text_score: false,
    };
    pub const DISTANCE: Self = Self { distance: true, ..Self::NONE };
}

/// What is known about a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    Unknown = 0,
    Free = 1,
    Occupied = 2,
}

/// Answers column by column; a column that was not asked for, or that the map does not have, is
/// empty.
///
/// Where the state is [`State::Unknown`] the numbers are NaN; so is the colour where no surface was
/// seen close by.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointAnswers {
    /// Signed distance, m, positive outside.
    pub distance: Vec<f32>,
    /// Gradient of the distance in world axes, towards increasing distance, unitless.
    pub gradient: Vec<Vec3>,
    /// Probability that the point is occupied.
    pub occupancy: Vec<f32>,
    /// One [`State`] a point, as its byte.
    pub state: Vec<u8>,
    /// sRGB within 0..1.
    pub color: Vec<Vec3>,
    /// How well the text fits; NaN away from surfaces that were seen with features.
    pub text_score: Vec<f32>,
}

impl PointAnswers {
    /// The answers to all points, from those to the chunks that they were cut into.
    pub fn concatenate(parts: Vec<Self>) -> Self {
        fn column<T: Copy>(parts: &[PointAnswers], of: impl Fn(&PointAnswers) -> &[T]) -> Vec<T> {
            parts.iter().map(of).collect::<Vec<_>>().concat()
        }
        Self {
            distance: column(&parts, |p| &p.distance),
            gradient: column(&parts, |p| &p.gradient),
            occupancy: column(&parts, |p| &p.occupancy),
            state: column(&parts, |p| &p.state),
            color: column(&parts, |p| &p.color),
            text_score: column(&parts, |p| &p.text_score),
        }
    }
}

impl MapView {
    /// Answers `points` (world metres) on the calling thread. Points outside, unobserved or not
    /// finite are unknown.
    pub fn query(&self, points: &[Vec3], fields: Fields) -> PointAnswers {
        self.query_with(points, fields, None)
    }

    /// [`MapView::query`] with a text, made by [`MapView::scorer`] of this view.
    pub fn query_with(
        &self,
        points: &[Vec3],
        fields: Fields,
        text: Option<&Scorer>,
    ) -> PointAnswers {
        let n = points.len();
        let fields = Fields {
            occupancy: fields.occupancy && self.config.has("occupancy"),
            color: fields.color && self.config.has("radiance"),
            text_score: fields.text_score && text.is_some(),
            ..fields
        };
        let wanted = |on: bool| if on { n } else { 0 };
        // What is known depends on the distance and on the voxel.
        let mut distance = vec![f32::NAN; n];
        let mut voxels = vec![Found::NONE; n];
        let mut gradient = vec![Vec3::NAN; wanted(fields.gradient)];
        let mut occupancy = vec![f32::NAN; wanted(fields.occupancy)];
        let mut state = vec![State::Unknown as u8; wanted(fields.state)];
        let mut color = vec![Vec3::NAN; wanted(fields.color)];
        let mut text_score = vec![f32::NAN; wanted(fields.text_score)];
        let text = text.filter(|_| fields.text_score);
        let mut code = vec![0.0; if text.is_some() { self.atoms() } else { 0 }];
        let reach = self.code_reach_m();
        let answers = Answers {
            distance: &mut distance,
            gradient: &mut gradient,
            occupancy: &mut occupancy,
            voxels: &mut voxels,
        };
        evaluate(&self.store, &self.decoders, points, answers);
        let near_voxel = self.near_voxel();
        let known = |voxel: &Found| voxel.is_some().then(|| self.store.known(voxel.node)).flatten();
        for (i, &voxel) in voxels.iter().enumerate() {
            if let Some(known) = voxels.get(i + AHEAD).and_then(known) {
                prefetch(known);
            }
            if !voxel.is_some() {
                continue;
            }
            let d = distance[i];
            let near =
                d.abs() <= NEAR_M && near_voxel.is_some_and(|limit| voxel.log2_size <= limit);
            if near || known(&voxel).is_some_and(|known| self.store.holds(known, points[i])) {
                if fields.state {
                    state[i] = if d < 0.0 { State::Occupied } else { State::Free } as u8;
                }
                if fields.color {
                    color[i] = self.store.color(voxel.node, points[i]).unwrap_or(Vec3::NAN);
                }
                if let Some(text) = text
                    && d.abs() <= reach
                    && self.store.code(voxel.node, points[i], &mut code)
                {
                    text_score[i] = text.score(&code);
                }
                continue;
            }
            distance[i] = f32::NAN;
            if fields.gradient {
                gradient[i] = Vec3::NAN;
            }
            if fields.occupancy {
                occupancy[i] = f32::NAN;
            }
        }
        distance.truncate(wanted(fields.distance));
        PointAnswers { distance, gradient, occupancy, state, color, text_score }
    }

    /// log2 of the largest voxels whose small distances count as known: those that surfaces ask
    /// for. A coarse voxel only holds small distances by interpolation. With a learned prior
    /// every distance starts small, so that none counts.
    fn near_voxel(&self) -> Option<u8> {
        match self.config.prior {
            Prior::Closed => Some(Lattice::new(&self.config).surface()),
            Prior::Learned => None,
        }
    }
}
