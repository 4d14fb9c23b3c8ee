//! A view somewhere else: what changed between two views, in parts of bounded size, and a view put
//! together from them. The copy answers as the original does, bit for bit.
//!
//! A *change* is a [`Head`] (how large the new view is) and slots of [`Table`]s, each with the bytes
//! that it has in the new view. What two views share is found by comparing the addresses of their
//! pages, so that a change costs what it changes, not what the map holds.

mod changes;
mod copy;
mod slots;

pub use changes::Changes;
pub use copy::Copying;

use std::sync::Arc;

use crate::config::MapConfig;
use crate::frame::Contract;
use crate::geometry::Aabb;
use crate::octree::Root;

/// What a view is made of. Integers and numbers of all slots are little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Table {
    /// Nodes of the tree: link to the children u32, rows of the eight corners u32, evidence brick,
    /// block of colours and block of codes u32, low corner i32×3, log2 of the size u32.
    Nodes,
    /// Vertices: distance and gradient f32×4, features of the decoders as bfloat16.
    Rows,
    /// Bricks of evidence: a bit a cell.
    Bricks,
    /// Blocks of colours: cell i32×3, upper neighbours u32×8, logits and a distance i16×4 a vertex, and
    /// where colours depend on the direction i16×3 a harmonic of a vertex.
    Colors,
    /// Blocks of codes: cell i32×3, upper neighbours u32×8, ‖c‖² f32 and the code a vertex, as wide as
    /// the dictionary.
    Codes,
    /// Atoms of the dictionary, f32 each number.
    Atoms,
    /// The weights of the decoders, f32, one slot each: of distances, of occupancy.
    Decoders,
    /// Cameras of key frames: origin, columns of the rotation, 1/fx, 1/fy, cx, cy, f32.
    Viewpoints,
}

impl Table {
    /// All of them, in the order in which they are told: what others refer to comes later, and is
    /// checked against the sizes of the head.
    pub const ALL: [Self; 8] = [
        Self::Nodes,
        Self::Rows,
        Self::Bricks,
        Self::Colors,
        Self::Codes,
        Self::Atoms,
        Self::Decoders,
        Self::Viewpoints,
    ];
}

/// What a view is, apart from its slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// The view that slots change; `None`: an empty one.
    pub from_epoch: Option<u64>,
    pub epoch: u64,
    pub newest_stamp_ns: i64,
    pub config: Arc<MapConfig>,
    pub root: Option<Root>,
    pub bounds: Option<Aabb>,
    /// Slots of each table, in the order of [`Table::ALL`].
    pub slots: [u32; 8],
    /// The encoder of the codes, once there are any.
    pub contract: Option<Contract>,
}

impl Head {
    fn count(&self, table: Table) -> usize {
        self.slots[table as usize] as usize
    }
}

/// Some slots of a table. All have the same number of bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    pub table: Table,
    pub slots: Vec<u32>,
    /// One slot after another.
    pub bytes: Vec<u8>,
}

/// Which modalities a copy has beside distances and occupancy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Copied {
    pub radiance: bool,
    pub language: bool,
}

impl Copied {
    pub const ALL: Self = Self { radiance: true, language: true };
}
