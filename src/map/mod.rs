//! The map: [`Mapper`] takes frames and publishes [`MapView`]s; a view answers questions.

mod mapper;
mod pages;
mod query;
mod view;

pub use mapper::{FrameOutcome, MapStats, Mapper};
pub use query::{Fields, PointAnswers, State};
pub use view::MapView;
