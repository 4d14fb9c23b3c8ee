//! The octree's topology: nodes, vertices, lookup, rays.
//!
//! Lattice coordinates are signed integers in units of the finest configured size, with the
//! origin at world zero. Corner and octant order is little-endian: bit 0 = x, bit 1 = y, bit 2 = z.

mod band;
mod blocks;
mod key;
mod lookup;
#[cfg(test)]
mod random_tree;
mod sound;
mod topology;
mod traverse;

pub use band::{Band, BandPlace, BandScale, NO_BLOCK, NO_VERTEX, Uppers, sum_of_observed};
pub use blocks::{Block, PointGrid};
pub use key::{Cell, LIMIT, cell_of, pack};
pub use lookup::{ChildLink, Found, Located, Lookup, NodeSource, Root, locate};
pub use sound::StoredNodes;
pub use topology::{NO_NODE, NO_ROW, Topology, TopologyState};
pub use traverse::{Segment, Traversal};

/// Explicit part of a vertex: distance d, m, and its gradient g.
pub type Explicit = [f32; 4];

/// The share of a corner's gradient that counts. The paper takes all of it. With all of it the
/// interpolation of a curved field errs by −½ δᵀHδ (H its second derivatives, δ the way to a corner,
/// averaged), with none of it by +½ δᵀHδ; with half both cancel, and what is flat stays exact.
/// Measured on an office with known truth, `lite`: near surfaces 2.96 → 2.41 mm, farther away 4.26 →
/// 3.62 mm, gradients 0.190 → 0.175 rad.
pub const GRADIENT_SHARE: f32 = 0.5;
