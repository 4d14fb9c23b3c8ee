//! The octree's topology: nodes, vertices, lookup, rays.
//!
//! Lattice coordinates are signed integers in units of the finest configured size, with the
//! origin at world zero. Corner and octant order is little-endian: bit 0 = x, bit 1 = y, bit 2 = z.

mod band;
mod key;
mod lookup;
#[cfg(test)]
mod random_tree;
mod topology;
mod traverse;

pub use band::{Band, BandPlace, BandScale, NO_BLOCK, NO_VERTEX, Uppers};
pub use key::{Cell, LIMIT, cell_of, pack};
pub use lookup::{ChildLink, Found, Located, Lookup, NodeSource, Root, locate};
pub use topology::{NO_NODE, NO_ROW, Topology, TopologyState};
pub use traverse::{Segment, Traversal};

/// Explicit part of a vertex: distance d, m, and its gradient g.
pub type Explicit = [f32; 4];
