// One Adam step of every vertex of colour that a ray of the step touched, each with its own step
// count; an invocation a vertex of a touched block. Leaves the gradients zero. Twin:
// src/backend/cpu/radiance/rows.rs.
#import lib/radiance
#import lib/adam

@group(0) @binding(0) var<uniform> radiance: Radiance;
@group(0) @binding(1) var<storage, read> compared: array<u32, 4>;
@group(0) @binding(2) var<storage, read_write> learned_colors: array<f32>;
@group(0) @binding(3) var<storage, read_write> color_first: array<f32>;
@group(0) @binding(4) var<storage, read_write> color_second: array<f32>;
@group(0) @binding(5) var<storage, read_write> color_steps: array<u32>;
@group(0) @binding(6) var<storage, read_write> color_gradients: array<vec4i>;
@group(0) @binding(7) var<storage, read_write> block_flags: array<u32>;
// Blocks that the step touched; [0] is their number.
@group(0) @binding(8) var<storage, read> touched_blocks: array<u32>;
// Blocks that changed since the host read them; [0] is their number.
@group(0) @binding(9) var<storage, read_write> changed_blocks: array<atomic<u32>>;

fn step_vertex(row: u32) {
  let sum = color_gradients[row];
  if sum.w == 0 {
    return;
  }
  color_gradients[row] = vec4i(0);
  // The loss is a mean over the rays that have a colour, and over channels.
  let factor = radiance.weight / f32(3u * max(compared[RAYS_AT], 1u));
  let gradient = vec3f(sum.xyz) * (factor / radiance.units);
  let at = 3u * row;
  var memory = Moments(
    vec4f(color_first[at], color_first[at + 1u], color_first[at + 2u], 0.0),
    vec4f(color_second[at], color_second[at + 1u], color_second[at + 2u], 0.0),
  );
  let t = color_steps[row] + 1u;
  color_steps[row] = t;
  let by = adam(&memory, vec4f(gradient, 0.0), t, radiance.rate);
  for (var i = 0u; i < 3u; i += 1u) {
    learned_colors[at + i] -= by[i];
    color_first[at + i] = memory.first[i];
    color_second[at + i] = memory.second[i];
  }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  let log2_vertices = 3u * radiance.log2_side;
  let items = touched_blocks[0] << log2_vertices;
  for (var item = id.x; item < items; item += groups.x * 64u) {
    let block = touched_blocks[1u + (item >> log2_vertices)];
    let within = item & ((1u << log2_vertices) - 1u);
    step_vertex((block << log2_vertices) + within);
    if within == 0u {
      let before = block_flags[block];
      block_flags[block] = CHANGED;
      if (before & CHANGED) == 0u {
        atomicStore(&changed_blocks[1u + atomicAdd(&changed_blocks[0], 1u)], block);
      }
    }
  }
}
