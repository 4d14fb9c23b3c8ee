// A map as it is drawn: what its kernels share.
#import lib/constants

struct Scene {
  // Slots of nodes, used or not; vertex rows; room for cubes.
  nodes: u32,
  rows: u32,
  room: u32,
  // log2 of the largest voxels that take light, lattice units.
  surface_log2: u32,
  // How far from a surface light is taken, m.
  light_m: f32,
  // Edge length of an evidence cell, m.
  cell_m: f32,
  // Vertices of the band of colour in a metre, and log2 of those along an edge of a block.
  band_scale: f32,
  band_log2: u32,
  // The decoder of distances: its widths (0: no second layer) and its factor.
  inputs: u32,
  first: u32,
  second: u32,
  scale: f32,
  // Room for the cubes that are drawn; `room` is for leaves.
  cube_room: u32,
  // Cubes lie on a lattice of their own, 2^fine_log2 times as fine, in whose units are: log2 of the
  // largest cubes, and of the cells of the relief.
  fine_log2: u32,
  largest_log2: u32,
  cell_log2: u32,
  // Coefficients of a vertex of colour; 0: colours do not depend on the direction.
  harmonics: u32,
}

struct Node {
  // Low corner, lattice units.
  low: vec3i,
  // log2 of its edge length in lattice units, and 1; 0 for a slot without a node.
  size: u32,
  // The evidence brick that holds its cells, and the block of colour of its level-0 voxel; NONE
  // where there is none.
  brick: u32,
  block: u32,
  padding: vec2u,
}

// A leaf near a surface, an octant that is missing of a voxel there, or a cell of the relief.
struct Cube {
  // Low corner and log2 of its edge length, in units of the lattice of cubes.
  low: vec3i,
  log2_size: u32,
  // Those of the cube whose corners it reads: itself, or the voxel around it.
  host_low: vec3i,
  host_log2: u32,
  block: u32,
  // The leaf that says its distance; NONE for a cell of the relief.
  leaf: u32,
  padding: vec2u,
}
