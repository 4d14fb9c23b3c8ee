//! Point queries on a view.

use glam::Vec3;

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
