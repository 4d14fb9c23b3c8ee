//! A band of heights of the map, seen from above: for Nav2 (`OccupancyGrid`) and for those that read
//! nvblox (`DistanceMapSlice`).

use glam::Vec3;

use super::Source;
use crate::error::{Error, Result};
use crate::map::{Fields, State};
use crate::service::{Call, PointsQuestion};
use crate::wire::ros2::{
    DistanceMapSlice, Header, MapMetaData, OccupancyGrid, Point, PoseMessage, Quaternion, encode,
};

/// Points of one grid, so that it does not crowd out questions.
const MAX_POINTS: usize = 1 << 19;
/// The most between two heights that are asked, m: what stands between them is as close as half of it.
const MAX_STEP_M: f32 = 0.1;
/// What nvblox says where nothing is known.
const UNKNOWN_M: f32 = -1000.0;
/// -1 in the bytes of a grid.
const UNKNOWN: u8 = 255;
const FREE: u8 = 0;
const OCCUPIED: u8 = 100;

/// What is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Band {
    pub(super) cell_m: f32,
    pub(super) heights_m: (f32, f32),
    /// What is closer to an obstacle is occupied, m.
    pub(super) radius_m: f32,
}

/// The cells, x first, from low y.
#[derive(Debug, PartialEq)]
pub(super) struct Columns {
    width: u32,
    height: u32,
    /// The low corner of the low cell, m.
    low: Vec3,
    cells: Vec<Column>,
    newest_stamp_ns: i64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Column {
    /// The least of those that are known; infinite without one.
    distance_m: f32,
    is_whole: bool,
}

impl Band {
    /// The heights that are asked.
    fn heights(&self) -> Vec<f32> {
        let (low, high) = self.heights_m;
        let steps = ((high - low) / MAX_STEP_M).ceil();
        let step = if steps > 0.0 { (high - low) / steps } else { 0.0 };
        (0..=steps as u32).map(|i| low + step * i as f32).collect()
    }

    /// What is closer than this is taken for occupied: half of what lies between samples, and the
    /// robot's own size.
    fn reach_m(&self) -> f32 {
        let step = if self.heights_m.0 < self.heights_m.1 { MAX_STEP_M } else { 0.0 };
        self.radius_m + self.cell_m.max(step) / 2.0
    }
}

/// The band over the whole map; `None` while the map is empty.
pub(super) async fn bands(source: &Source, band: &Band) -> Result<Option<Columns>> {
    let bounds = source.service.map_detail(&source.map_id)?.summary.bounds;
    if bounds.min.cmpgt(bounds.max).any() {
        return Ok(None);
    }
    let cell = |m: f32| (m / band.cell_m).floor();
    let (low_x, low_y) = (cell(bounds.min.x), cell(bounds.min.y));
    let sides = [cell(bounds.max.x) - low_x + 1.0, cell(bounds.max.y) - low_y + 1.0];
    let heights = band.heights();
    let points = sides[0] * sides[1] * heights.len() as f32;
    if points > MAX_POINTS as f32 {
        let what = format!("a grid of {} x {} cells", sides[0], sides[1]);
        let limit = format!("{points} points; the limit is {MAX_POINTS} (ros2.grid_cell_m)");
        return Err(Error::ResourceExhausted { what, limit });
    }
    let (width, height) = (sides[0] as u32, sides[1] as u32);
    let mut points = Vec::with_capacity(points as usize);
    for row in 0..height {
        for column in 0..width {
            let x = (low_x + column as f32 + 0.5) * band.cell_m;
            let y = (low_y + row as f32 + 0.5) * band.cell_m;
            points.extend(heights.iter().map(|z| Vec3::new(x, y, *z)));
        }
    }
    let fields = Fields { distance: true, state: true, ..Fields::NONE };
    let map_id = source.map_id.clone();
    let question = PointsQuestion { map_id, fields, ..PointsQuestion::new(points) };
    let reply = source.service.query_points(question, Call::Ros2Grid).await?;
    let answers = &reply.answers;
    let per = heights.len();
    let columns = answers.distance.chunks(per).zip(answers.state.chunks(per));
    let cells = columns.map(|(distances, states)| Column {
        distance_m: distances.iter().copied().fold(f32::INFINITY, f32::min),
        is_whole: states.iter().all(|state| *state != State::Unknown as u8),
    });
    let low = Vec3::new(low_x * band.cell_m, low_y * band.cell_m, band.heights_m.0);
    let newest_stamp_ns = reply.newest_stamp_ns;
    Ok(Some(Columns { width, height, low, cells: cells.collect(), newest_stamp_ns }))
}

impl Columns {
    /// Occupied if anything is in reach, else unknown if any of it is, else free.
    pub(super) fn occupancy(&self, source: &Source, band: &Band) -> Result<Vec<u8>> {
        let header = source.header(self.newest_stamp_ns);
        self.occupancy_of(header, band)
    }

    fn occupancy_of(&self, header: Header, band: &Band) -> Result<Vec<u8>> {
        let reach_m = band.reach_m();
        let value = |cell: &Column| match cell {
            Column { distance_m, .. } if *distance_m <= reach_m => OCCUPIED,
            Column { is_whole: false, .. } => UNKNOWN,
            _ => FREE,
        };
        let data: Vec<u8> = self.cells.iter().map(value).collect();
        let info = MapMetaData {
            map_load_time: header.stamp,
            resolution: band.cell_m,
            width: self.width,
            height: self.height,
            // A grid lies on the ground, whatever band it was made of.
            origin: PoseMessage {
                position: Point { z: 0.0, ..self.origin() },
                orientation: Quaternion::default(),
            },
        };
        encode(&OccupancyGrid { header, info, data: &data })
    }

    /// The least distance within the band.
    pub(super) fn distances(&self, source: &Source, band: &Band) -> Result<Vec<u8>> {
        let value = |cell: &Column| match cell.distance_m {
            distance if distance.is_finite() => distance,
            _ => UNKNOWN_M,
        };
        encode(&DistanceMapSlice {
            header: source.header(self.newest_stamp_ns),
            resolution: band.cell_m,
            width: self.width,
            height: self.height,
            origin: self.origin(),
            unknown_value: UNKNOWN_M,
            data: self.cells.iter().map(value).collect(),
        })
    }

    fn origin(&self) -> Point {
        let low = self.low.as_dvec3();
        Point { x: low.x, y: low.y, z: low.z }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::ros2::decode;

    #[test]
    fn heights_lie_close_enough_to_see_everything_between() {
        let band = |low, high| Band { cell_m: 0.05, heights_m: (low, high), radius_m: 0.2 };
        let heights = band(0.1, 0.55).heights();
        assert_eq!(heights.len(), 6);
        assert!(heights.windows(2).all(|w| w[1] - w[0] <= MAX_STEP_M + 1e-6), "{heights:?}");
        assert!((heights[5] - 0.55).abs() < 1e-6);
        assert_eq!(band(0.3, 0.3).heights(), [0.3]);
        assert!((band(0.1, 0.55).reach_m() - 0.25).abs() < 1e-6);
        assert!((band(0.3, 0.3).reach_m() - 0.225).abs() < 1e-6);
    }

    #[test]
    fn an_obstacle_counts_more_than_what_is_unknown() {
        let column = |distance_m, is_whole| Column { distance_m, is_whole };
        let columns = Columns {
            width: 2,
            height: 2,
            low: Vec3::new(-1.0, 2.0, 0.1),
            cells: vec![
                column(0.04, false),
                column(1.0, false),
                column(1.0, true),
                column(f32::INFINITY, false),
            ],
            newest_stamp_ns: 5,
        };
        let band = Band { cell_m: 0.05, heights_m: (0.1, 0.3), radius_m: 0.0 };
        let payload = columns.occupancy_of(Header::default(), &band).expect("a grid");
        let grid: OccupancyGrid<'_> = decode(&payload).expect("a grid");
        assert_eq!(grid.data, [OCCUPIED, UNKNOWN, FREE, UNKNOWN]);
        assert_eq!((grid.info.origin.position.x, grid.info.origin.position.z), (-1.0, 0.0));
    }
}
