// A labelled point of a batch, and where it lies.
#import lib/constants

struct Sample {
  // World metres.
  point: vec3f,
  // Signed distance label, m.
  distance: f32,
  // Occupancy label.
  occupancy: f32,
  // NONE: the slot is empty.
  kind: u32,
  // Whether it is asked to pay the Eikonal loss.
  eikonal: u32,
  padding: u32,
}

// The voxels of a sample and of its stencil's points, packed; NONE where there is none. A sample
// pays the Eikonal loss iff `around[0]` is some.
struct Site {
  centre: u32,
  around: array<u32, STENCIL_POINTS>,
  padding: u32,
}

// A voxel's node and the log2 of its edge in lattice units, in one word.
fn pack_voxel(node: u32, log2_size: u32) -> u32 {
  return (node << 5u) | log2_size;
}

fn voxel_node(packed: u32) -> u32 {
  return packed >> 5u;
}

fn voxel_log2(packed: u32) -> u32 {
  return packed & 31u;
}

// The i-th offset of a stencil, m: x, y, z, then −x, −y, −z.
fn stencil_offset(i: u32) -> vec3f {
  let along = select(STENCIL_M, -STENCIL_M, i >= 3u);
  let axis = i % 3u;
  return vec3f(
    select(0.0, along, axis == 0u),
    select(0.0, along, axis == 1u),
    select(0.0, along, axis == 2u),
  );
}
