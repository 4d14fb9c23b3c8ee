// Where voxels lie, from the lattice alone. The kernel declares `step`.
#import lib/step

// A point's cell from the root's low corner, lattice units; the point lies in the root.
fn offset_of(point: vec3f) -> vec3u {
  return vec3u(vec3i(floor(point / step.unit_m)) - step.root_min);
}

// Low corner, world metres, and edge length, m, of the voxel of 2^log2_size units around a point.
fn voxel_box(point: vec3f, log2_size: u32) -> vec4f {
  let shift = vec3u(log2_size);
  let low = vec3i((offset_of(point) >> shift) << shift) + step.root_min;
  return vec4f(vec3f(low) * step.unit_m, f32(1u << log2_size) * step.unit_m);
}
