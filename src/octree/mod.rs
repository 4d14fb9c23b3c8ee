//! The octree's topology: nodes, vertices, lookup.
//!
//! Lattice coordinates are signed integers in units of the finest configured size, with the
//! origin at world zero. Corner and octant order is little-endian: bit 0 = x, bit 1 = y, bit 2 = z.

mod lookup;

pub use lookup::{Cell, ChildLink, Located, Lookup, NodeSource, Root, locate};

/// The farthest coordinate that the lattice of 21-bit keys is used for, m.
pub const MAX_COORDINATE_M: f64 = 10_000.0;
