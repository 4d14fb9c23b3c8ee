//! What to train on: key frames, the window of a step, rays, samples and their labels.

mod batch;
mod key_frame;
mod rays;
mod schedule;

pub use batch::{Batch, SampleKind};
pub use key_frame::{FrameRecord, KeyFrame, KeyFrames, KeyFramesState, Pixel};
pub use rays::{RayPlan, sample};
pub use schedule::{Pace, Schedule};
