// The numbers of one step, the same for all kernels of the step.
#import lib/constants

struct Step {
  // Low corner of the root, lattice units.
  root_min: vec3i,
  root_node: u32,
  // Edge length of a lattice unit, m.
  unit_m: f32,
  root_log2: u32,
  // Vertex rows that exist.
  rows: u32,
  // Slots for samples, used or not.
  samples: u32,
  // Weight of |f − y|, and of the Eikonal term, by kind of sample.
  distance_weights: vec3f,
  occupancy_weight: f32,
  eikonal_weights: vec3f,
  consistency_weight: f32,
  // Learning rates.
  rate: f32,
  occupancy_rate: f32,
  decoder_rate: f32,
  // Power of two, at least `samples`: a row's gradient is kept times this, times its units.
  gradient_scale: f32,
}
