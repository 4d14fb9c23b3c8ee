//! The octree's topology: nodes, vertices, lookup.
//!
//! Lattice coordinates are signed integers in units of the finest configured size, with the
//! origin at world zero. Corner and octant order is little-endian: bit 0 = x, bit 1 = y, bit 2 = z.

mod lookup;

pub use lookup::{ChildLink, Located, NodeSource, Root, locate};
