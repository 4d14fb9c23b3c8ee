//! Point queries on a view.

use glam::Vec3;

use super::view::MapView;
use crate::modality::RowSource;
use crate::octree::{NodeSource, locate};
use crate::surface::NEAR_M;

/// What a query asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fields {
    pub distance: bool,
    pub gradient: bool,
    pub occupancy: bool,
    pub state: bool,
}

impl Fields {
    pub const ALL: Self = Self { distance: true, gradient: true, occupancy: true, state: true };
    pub const DISTANCE: Self =
        Self { distance: true, gradient: false, occupancy: false, state: false };
}

/// What is known about a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    Unknown = 0,
    Free = 1,
    Occupied = 2,
}

/// Answers column by column; a column that was not asked for is empty.
///
/// Where the state is [`State::Unknown`] the numbers are NaN.
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
}

impl MapView {
    /// Answers `points` (world metres) on the calling thread. Points outside, unobserved or not
    /// finite are unknown.
    pub fn query(&self, points: &[Vec3], fields: Fields) -> PointAnswers {
        let n = points.len();
        let mut answers = PointAnswers {
            distance: vec![f32::NAN; if fields.distance { n } else { 0 }],
            gradient: vec![Vec3::NAN; if fields.gradient { n } else { 0 }],
            occupancy: vec![f32::NAN; if fields.occupancy { n } else { 0 }],
            state: vec![State::Unknown as u8; if fields.state { n } else { 0 }],
        };
        let store = &self.store;
        for (i, &point) in points.iter().enumerate() {
            let Some(at) = locate(store, point) else { continue };
            let corners = store.corners(at.node);
            let local = (point - at.min_m) / at.size_m;
            let (mut d, mut g) = (0.0, Vec3::ZERO);
            for (k, &row) in corners.iter().enumerate() {
                let e = store.explicit(row);
                let bit = Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32);
                let w = Vec3::ONE - (local - bit).abs();
                let s = bit * 2.0 - Vec3::ONE;
                let gk = Vec3::new(e[1], e[2], e[3]);
                let v = e[0] + gk.dot((local - bit) * at.size_m);
                let weight = w.x * w.y * w.z;
                d += weight * v;
                g += gk * weight
                    + Vec3::new(s.x * w.y * w.z, w.x * s.y * w.z, w.x * w.y * s.z)
                        * (v / at.size_m);
            }
            let known = d.abs() <= NEAR_M || store.is_known(&at, point);
            if !known {
                continue;
            }
            if fields.distance {
                answers.distance[i] = d;
            }
            if fields.gradient {
                answers.gradient[i] = g;
            }
            if fields.occupancy {
                answers.occupancy[i] = 1.0 / (1.0 + (d * 40.0).exp());
            }
            if fields.state {
                answers.state[i] = if d < 0.0 { State::Occupied } else { State::Free } as u8;
            }
        }
        answers
    }
}
