//! The map: [`Mapper`] takes frames and publishes [`MapView`]s; a view answers questions.

mod budget;
mod codes;
mod empty;
mod language;
mod mapper;
mod mesh;
mod pages;
mod parallel;
mod picture;
mod publish;
mod query;
mod render;
mod robots;
mod slice;
mod state;
mod trainer;
mod view;

pub use codes::ViewCodesState;
pub use language::{
    FindSettings, Findings, LanguageCounts, Match, OrientedBox, Places, Scorer, Viewpoint,
};
pub use mapper::{FrameOutcome, MapStats, Mapper};
pub use mesh::{TriangleMesh, default_resolution_m, extract_mesh};
pub use parallel::{CHUNK_POINTS, PointQuery, query_parallel, query_pool};
pub use picture::{Encoding, Output};
pub use query::{Fields, PointAnswers, State};
pub use render::{
    Camera, Channels, MAX_SIDE, RenderSettings, Renderer, Rendering, SamplePosition, render,
    render_with,
};
pub use robots::Robots;
pub use slice::{Plane, Slice, draw_slice, slice};
pub use state::{MapperState, Progress, ViewRecord, ViewState};
pub use trainer::Trainer;
#[cfg(test)]
pub(crate) use trainer::tests::lose_device;
pub use view::MapView;
