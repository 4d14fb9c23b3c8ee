//! Point queries on a view.

use glam::Vec3;

use super::language::Scorer;
use super::view::{MapView, holds_cell};
use crate::config::Prior;
use crate::geometry::simd::prefetch;
use crate::modality::read::{Answers, evaluate, evaluate_grid};
use crate::octree::{Found, PointGrid};
use crate::surface::{Lattice, NEAR_M};

/// Points whose evidence is asked for ahead of its use: enough to hide a trip to memory.
const AHEAD: usize = 16;
/// The same in voxels that hold some points each.
const AHEAD_BLOCKS: usize = 4;

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
        let mut voxels = vec![Found::NONE; points.len()];
        let mut columns = Columns::new(self, points.len(), fields, text);
        let answers = Answers { voxels: &mut voxels, ..columns.answers() };
        evaluate(&self.store, &self.decoders, points, answers);
        let known = |voxel: &Found| voxel.is_some().then(|| self.store.known(voxel.node)).flatten();
        for (i, voxel) in voxels.iter().enumerate() {
            if let Some(known) = voxels.get(i + AHEAD).and_then(known) {
                prefetch(known);
            }
            if !voxel.is_some() {
                continue;
            }
            let point = points[i];
            let is_known = columns.is_near(i, *voxel)
                || known(voxel).is_some_and(|known| self.store.holds(known, point));
            columns.settle(i, *voxel, point, is_known);
        }
        columns.finish()
    }

    /// [`MapView::query`] at the points of a grid, with the same answers to the bit, and faster: what
    /// a voxel holds is fetched once.
    pub fn query_grid(&self, grid: &PointGrid<'_>, fields: Fields) -> PointAnswers {
        let mut columns = Columns::new(self, grid.len(), fields, None);
        let blocks = evaluate_grid(&self.store, &self.decoders, grid, columns.answers());
        let cells = grid
            .axes
            .map(|axis| axis.iter().map(|x| self.store.cell_along(*x) as u8).collect::<Vec<u8>>());
        for (at, block) in blocks.iter().enumerate() {
            let ahead = blocks.get(at + AHEAD_BLOCKS);
            if let Some(known) = ahead.and_then(|ahead| self.store.known(ahead.voxel.node)) {
                prefetch(known);
            }
            let known = self.store.known(block.voxel.node);
            for z in block.low[2]..block.high[2] {
                for y in block.low[1]..block.high[1] {
                    for x in block.low[0]..block.high[0] {
                        let i = grid.index([x, y, z]);
                        let cell = [cells[0][x], cells[1][y], cells[2][z]].map(usize::from);
                        let is_known = columns.is_near(i, block.voxel)
                            || known.is_some_and(|known| holds_cell(known, cell));
                        columns.settle(i, block.voxel, grid.point([x, y, z]), is_known);
                    }
                }
            }
        }
        columns.finish()
    }

    /// Distances as the field goes on, also of unknown points; NaN where there is no voxel.
    pub(super) fn distances(&self, points: &[Vec3]) -> Vec<f32> {
        let mut distance = vec![f32::NAN; points.len()];
        let answers = Answers { distance: &mut distance, ..Answers::default() };
        evaluate(&self.store, &self.decoders, points, answers);
        distance
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

/// Answers as they come to be.
struct Columns<'a> {
    view: &'a MapView,
    fields: Fields,
    text: Option<&'a Scorer>,
    near_voxel: Option<u8>,
    code: Vec<f32>,
    reach_m: f32,
    /// What is known depends on the distance, which is there whatever was asked for.
    columns: PointAnswers,
}

impl<'a> Columns<'a> {
    fn new(view: &'a MapView, n: usize, fields: Fields, text: Option<&'a Scorer>) -> Self {
        let fields = Fields {
            occupancy: fields.occupancy && view.config.has("occupancy"),
            color: fields.color && view.config.has("radiance"),
            text_score: fields.text_score && text.is_some(),
            ..fields
        };
        let text = text.filter(|_| fields.text_score);
        let wanted = |on: bool| if on { n } else { 0 };
        Self {
            view,
            fields,
            text,
            near_voxel: view.near_voxel(),
            code: vec![0.0; if text.is_some() { view.atoms() } else { 0 }],
            reach_m: view.code_reach_m(),
            columns: PointAnswers {
                distance: vec![f32::NAN; n],
                gradient: vec![Vec3::NAN; wanted(fields.gradient)],
                occupancy: vec![f32::NAN; wanted(fields.occupancy)],
                state: vec![State::Unknown as u8; wanted(fields.state)],
                color: vec![Vec3::NAN; wanted(fields.color)],
                text_score: vec![f32::NAN; wanted(fields.text_score)],
            },
        }
    }

    /// Where the fields are written to.
    fn answers(&mut self) -> Answers<'_> {
        Answers {
            distance: &mut self.columns.distance,
            gradient: &mut self.columns.gradient,
            occupancy: &mut self.columns.occupancy,
            voxels: &mut [],
        }
    }

    /// Whether an answer is that of a surface close by.
    #[inline]
    fn is_near(&self, i: usize, voxel: Found) -> bool {
        self.columns.distance[i].abs() <= NEAR_M
            && self.near_voxel.is_some_and(|limit| voxel.log2_size <= limit)
    }

    /// A point in a voxel gets what the fields do not say, or loses all.
    #[inline]
    fn settle(&mut self, i: usize, voxel: Found, point: Vec3, is_known: bool) {
        let Self { view, fields, columns, .. } = self;
        if !is_known {
            columns.distance[i] = f32::NAN;
            if fields.gradient {
                columns.gradient[i] = Vec3::NAN;
            }
            if fields.occupancy {
                columns.occupancy[i] = f32::NAN;
            }
            return;
        }
        let d = columns.distance[i];
        if fields.state {
            columns.state[i] = if d < 0.0 { State::Occupied } else { State::Free } as u8;
        }
        if fields.color {
            columns.color[i] = view.store.color(voxel.node, point).unwrap_or(Vec3::NAN);
        }
        if let Some(text) = self.text
            && d.abs() <= self.reach_m
            && view.store.code(voxel.node, point, &mut self.code)
        {
            columns.text_score[i] = text.score(&self.code);
        }
    }

    fn finish(mut self) -> PointAnswers {
        if !self.fields.distance {
            self.columns.distance = Vec::new();
        }
        self.columns
    }
}
