// The lattice of cubes as an eye sees it. The kernel declares `view`.
#import lib/view

// A lattice point from the eye, m. Of whole units, so that neighbours agree on the plane between
// them to the bit.
fn from_eye(at: vec3i) -> vec3f {
  return vec3f(at) * view.unit_m - view.eye;
}

// An edge length, m.
fn size_m(log2_size: u32) -> f32 {
  return f32(1u << log2_size) * view.unit_m;
}
