//! The samples of one training step.

use glam::Vec3;

/// Which part of a ray a training sample stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum SampleKind {
    /// Stratified in free space between the camera and the surface.
    Free = 0,
    /// Perturbed around the surface.
    Perturbed = 1,
    /// On the surface.
    Surface = 2,
    /// On a ray whose colour depends on the distance there. Its label is not a distance but ∂L/∂f.
    Ray = 3,
}

/// The samples of one training step, column by column.
#[derive(Debug, Clone, Default)]
pub struct Batch {
    /// World metres.
    pub points: Vec<Vec3>,
    pub kinds: Vec<SampleKind>,
    /// Signed distance label, m; ∂L/∂f where the kind is [`SampleKind::Ray`].
    pub distances: Vec<f32>,
    /// Occupancy label: 0 free, 0.75 on the surface, 1 behind.
    pub occupancies: Vec<f32>,
    /// Whether the sample pays the Eikonal loss.
    pub eikonal: Vec<bool>,
}

impl Batch {
    /// Adds the samples of another batch behind these.
    pub fn append(&mut self, mut other: Self) {
        self.points.append(&mut other.points);
        self.kinds.append(&mut other.kinds);
        self.distances.append(&mut other.distances);
        self.occupancies.append(&mut other.occupancies);
        self.eikonal.append(&mut other.eikonal);
    }
}
