// What the comparison of colours shares: its numbers, its rays and the points on them.

struct Radiance {
  // Rays that are drawn.
  rays: u32,
  // Points of all rays that there is room for.
  room: u32,
  // log2 of the largest voxels around surfaces, lattice units.
  surface_log2: u32,
  // s of the density, 1/m.
  sharpness: f32,
  // A surface takes light up to this far in front of it, m.
  reach_m: f32,
  // Of the mean difference among the losses.
  weight: f32,
  // Learning rate of vertices of colour.
  rate: f32,
  // Fixed-point units of a vertex's gradient, before the factor of the mean.
  units: f32,
  // Of the vertices along an edge of a block.
  log2_side: u32,
  vertices_per_m: f32,
  // Coefficients of a vertex; 0: colours do not depend on the direction.
  harmonics: u32,
}

// A ray through a pixel of known depth and colour, and where its points are; one whose surface is
// not there any more has no points.
struct Ray {
  // World metres.
  origin: vec3f,
  // z-depth of its return, m; negative: it is left out.
  z: f32,
  // With z = 1 in camera axes, so that lengths are depths.
  direction: vec3f,
  points: u32,
  // sRGB, with the gain of its frame.
  color: vec3f,
  first: u32,
}

// A place where a piece of a ray begins or ends.
struct RayPoint {
  // World metres.
  place: vec3f,
  // In lengths of the ray's direction.
  t: f32,
  // Signed distance, m.
  f: f32,
  // ∂L/∂f, before the factor of the mean; until then the light that gets here.
  by_f: f32,
  // Whether a piece ends here that began at the point before.
  ends: u32,
  // Packed; NONE outside of the tree.
  voxel: u32,
}

// Where sums over rays stand: rays that had a colour, their summed differences in LOSS_UNITS,
// points of all rays, and rays that found no room.
const RAYS_AT = 0u;
const LOSS_AT = 1u;
const POINTS_AT = 2u;
const CROWDED_AT = 3u;
const LOSS_UNITS: f32 = 16384.0;
