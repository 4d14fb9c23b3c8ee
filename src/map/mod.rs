//! The map: [`Mapper`] takes frames and publishes [`MapView`]s; a view answers questions.

mod budget;
mod codes;
mod edit;
mod empty;
mod grid;
mod language;
mod mapper;
mod mesh;
mod mirror;
mod nearest;
mod pages;
mod parallel;
mod paths;
mod picture;
mod publish;
mod query;
mod rays;
mod render;
mod robots;
mod slice;
mod sphere;
mod state;
mod timeline;
mod trainer;
mod view;
mod waypoint;

pub use codes::ViewCodesState;
pub use edit::{Clear, Edit, Edited, STAMP_ROBOT, Stamp};
pub use grid::{GridShape, Pieces};
pub use language::{
    FindSettings, Findings, LanguageCounts, Match, OrientedBox, Places, Scorer, Viewpoint,
};
pub use mapper::{FrameOutcome, MapStats, Mapper};
pub use mesh::{
    Detail, MeshFormat, MeshPart, MeshSource, PieceKey, PieceTable, TriangleMesh, WholeMesh,
    default_resolution_m, extract_mesh, packed_piece, piece_size_m, vertex_colors,
};
pub use mirror::{Changes, Copied, Copying, Head, Part, Table};
pub use nearest::{NearestAnswers, nearest_surfaces};
pub use parallel::{CHUNK_POINTS, GridQuery, PointQuery, query_parallel, query_pool};
pub use paths::{PathPart, PathPlace, PathSettings, PathVerdict, check_paths, looks};
pub use picture::{Encoding, Output};
pub use query::{Fields, PointAnswers, State};
pub use rays::{LONGEST_M, Ray, RayAnswers, RayState, Unseen, cast_rays};
pub use render::{
    Camera, Channels, MAX_SIDE, Painted, Painter, RenderSettings, Rendering, SamplePosition,
    Subject, render, render_with,
};
pub use robots::Robots;
pub use slice::{Costs, LevelShape, Plane, Slice, draw_slice, slice};
pub use sphere::Sphere;
pub use state::{MapperState, Progress, ViewRecord, ViewState};
pub use timeline::Timeline;
pub use trainer::Trainer;
#[cfg(test)]
pub(crate) use trainer::tests::lose_device;
pub use view::MapView;
pub use waypoint::Waypoint;
