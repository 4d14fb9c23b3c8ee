//! The observed surface in closed form: fused surfels, the evidence of free space, and the
//! distance prior that both give to every vertex (algorithms.md §13).

mod color;
mod evidence;
mod fusion;
mod label;
mod lattice;
mod noise;
mod observe;
mod prior;
mod sight;
mod split;
mod surfel;
#[cfg(test)]
mod test_frame;

pub use color::{ColorField, ColorState, SeenColor};
pub use evidence::{BRICK_CELLS, CELLS, Carved, CellAddress, Evidence, EvidenceState, Known};
pub use fusion::{Surface, SurfaceChange, SurfaceState};
pub use lattice::{Lattice, NEAR_M};
pub use prior::{PriorChange, PriorField, PriorState};
pub use surfel::{Link, NO_SURFEL, RIM_SHARE, Surfel, SurfelMap, SurfelState, Touch};
