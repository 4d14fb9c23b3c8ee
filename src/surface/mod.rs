//! The observed surface in closed form: fused surfels, the evidence of free space, and the
//! distance prior that both give to every vertex (algorithms.md §13).

mod color;
mod evidence;
mod forget;
mod fusion;
mod label;
mod lattice;
mod noise;
mod observe;
mod prior;
mod seen_free;
mod sight;
mod split;
mod stamp;
mod surfel;
#[cfg(test)]
mod test_frame;
mod witnesses;

pub use color::{ColorField, ColorState, DISTANCE_STEP_M, SeenColor, SeenDistance};
pub use evidence::{BRICK_CELLS, CELLS, Carved, CellAddress, Evidence, EvidenceState, Known};
pub use forget::{Forget, Lost};
pub use fusion::{Surface, SurfaceChange, SurfaceState};
pub use lattice::{Lattice, NEAR_M};
pub use prior::{BESIDE, FAR_BEHIND, FAR_BESIDE, PriorChange, PriorField, PriorState};
pub use stamp::{Stamped, Stamping};
pub use surfel::{FirstSurfel, Link, NO_SURFEL, RIM_SHARE, Surfel, SurfelMap, SurfelState, Touch};
pub use witnesses::WitnessSets;
