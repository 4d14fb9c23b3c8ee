// Starts rows anew: what was learned, Adam's memory and the step counts become zero. Eight
// invocations a row.
#import lib/constants

@group(0) @binding(0) var<storage, read> rows: array<u32>;
@group(0) @binding(1) var<storage, read_write> learned: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> first_moments: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> second_moments: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> row_steps: array<vec2u>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  for (var item = id.x; item < arrayLength(&rows) * 8u; item += groups.x * 64u) {
    let row = rows[item / 8u];
    let quad = item % 8u;
    if quad < ROW_QUADS {
      let at = row * ROW_QUADS + quad;
      learned[at] = vec4f(0.0);
      first_moments[at] = vec4f(0.0);
      second_moments[at] = vec4f(0.0);
    } else {
      row_steps[row] = vec2u(0u);
    }
  }
}
