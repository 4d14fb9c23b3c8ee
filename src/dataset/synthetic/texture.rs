//! Procedural surface patterns.

use glam::Vec3;

use crate::geometry::random::{pcg4d, unit};

/// How the albedo varies over an object's own axes; lengths in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Texture {
    Plain,
    Checker {
        size: f32,
    },
    /// Bands across x + y.
    Stripes {
        size: f32,
    },
    /// Boards along x with their own shade each.
    Planks {
        width: f32,
    },
    /// Cells of random shade.
    Speckles {
        size: f32,
    },
}

impl Texture {
    /// The factor on the albedo at a point in the object's own axes.
    pub fn shade(self, p: Vec3) -> f32 {
        // Half a millimetre off, so that faces on a cell's border do not flicker.
        let cell = |size: f32| ((p + 5e-4) / size).floor();
        match self {
            Self::Plain => 1.0,
            Self::Checker { size } => {
                if cell(size).element_sum().rem_euclid(2.0) < 1.0 {
                    1.0
                } else {
                    0.6
                }
            }
            Self::Stripes { size } => {
                if ((p.x + p.y) / size).floor().rem_euclid(2.0) < 1.0 {
                    1.0
                } else {
                    0.65
                }
            }
            Self::Planks { width } => {
                let row = (p.y / width).floor();
                let board = ((p.x + row * 0.37) / 1.2).floor();
                0.8 + 0.2 * noise(Vec3::new(board, row, 0.0))
            }
            Self::Speckles { size } => 0.75 + 0.25 * noise(cell(size)),
        }
    }
}

/// A fixed random number in [0, 1) for a cell.
fn noise(cell: Vec3) -> f32 {
    unit(pcg4d([cell.x as i32 as u32, cell.y as i32 as u32, cell.z as i32 as u32, 17])[0])
}
