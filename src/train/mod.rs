//! What to train on: key frames, the window of a step, rays, samples and their labels.

mod batch;
mod colors;
mod key_frame;
mod key_frames;
mod rays;
mod schedule;

pub use batch::{Batch, SampleKind};
pub use colors::{ColorRay, draw_colors, frame_of_step};
pub use key_frame::{KeyFrame, Pixel};
pub use key_frames::{FrameRecord, KeyFrames, KeyFramesState, NO_ROBOT};
pub use rays::{
    FREE_END_M, FREE_START_M, PERTURBED_LIMIT_M, PERTURBED_M, RAY_SAMPLES, RayPlan, sample, stale_m,
};
pub use schedule::{Pace, Schedule};
