//! The numbers by which an image is drawn. The CPU renderer has them, and kernels are compiled with
//! them, so that there is one of each.

use super::super::shader::Constant;
use crate::modality::decoder::MAX_HIDDEN;
use crate::modality::density;
use crate::surface::{DISTANCE_STEP_M, NEAR_M};

/// Side of a tile, pixels; what shaders/render/draw.wgsl is written for.
pub(super) const TILE: u32 = 16;

/// What the CPU renderer draws by.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// How far the nearest corner of a voxel may be from a point in it, in edges.
    pub half_diagonal: f32,
    /// How far the distance at a corner may be from what its row says before training adds to it, m.
    pub learned_m: f32,
    /// Nothing nearer to the camera than this is drawn, m.
    pub nearest_m: f32,
    /// Rounding of projected corners, pixels.
    pub slack: f32,
    /// Cubes that meet within this length of a ray touch.
    pub touch: f32,
    /// The least |direction| along an axis.
    pub least_direction: f32,
    /// A sample that takes less of the light is not looked up.
    pub least_weight: f32,
    /// Steps of the search for a zero crossing.
    pub refinements: u32,
    /// How far from a voxel's border a colour is read, in edges of the voxel.
    pub rim: f32,
    /// How far along its ray a pixel looks for a colour, m.
    pub beside_m: f32,
    /// A sample that takes less of the light does not look beside itself for a colour.
    pub beside_weight: f32,
    /// Side of a block of pixels for which one ray looks out for unobserved space.
    pub block: u32,
    /// Unobserved space shorter than this along a ray does not count, m.
    pub shortest_m: f32,
    /// How far apart a ray looks at the evidence within one voxel, m.
    pub step_m: f32,
}

impl Rules {
    /// The constants of a kernel.
    pub(super) fn constants(&self, kernel: &str) -> Vec<(&'static str, Constant)> {
        use Constant::{F32, U32};
        match kernel {
            "render/vertices" => vec![("MAX_QUADS", U32(MAX_HIDDEN as u32 / 4))],
            "render/list" => {
                vec![("HALF_DIAGONAL", F32(self.half_diagonal)), ("LEARNED_M", F32(self.learned_m))]
            }
            "render/relief" => vec![("DISTANCE_STEP_M", F32(DISTANCE_STEP_M))],
            "render/cull" => vec![
                ("NEAREST_M", F32(self.nearest_m)),
                ("SLACK", F32(self.slack)),
                ("SIDE", U32(TILE)),
            ],
            "render/scatter" => vec![("SIDE", U32(TILE))],
            "render/draw" => vec![
                ("SIDE", U32(TILE)),
                ("REACH", F32(density::REACH)),
                ("LEAST_POSITIVE", F32(f32::MIN_POSITIVE)),
                ("LEAST_LIGHT", F32(density::LEAST_LIGHT)),
                ("FAR", F32(density::FAR)),
                ("TOUCH", F32(self.touch)),
                ("LEAST_DIRECTION", F32(self.least_direction)),
                ("LEAST_WEIGHT", F32(self.least_weight)),
                ("REFINEMENTS", U32(self.refinements)),
                ("RIM", F32(self.rim)),
                ("BESIDE_M", F32(self.beside_m)),
                ("BESIDE_WEIGHT", F32(self.beside_weight)),
            ],
            "render/unknown" => vec![
                ("BLOCK", U32(self.block)),
                ("SHORTEST_M", F32(self.shortest_m)),
                ("STEP_M", F32(self.step_m)),
                ("NEAR_SUM_M", F32(8.0 * NEAR_M)),
            ],
            _ => Vec::new(),
        }
    }
}
