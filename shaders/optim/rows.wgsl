// One Adam step of every row that the step touched, each with its own step count (paper
// eq:onlineadam). Eight invocations a row: seven own a quad of its columns each; the eighth counts
// the steps and notes that the row changed. Leaves the gradients zero. Twin:
// src/backend/cpu/rows.rs.
#import lib/step
#import lib/adam

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> learned: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> first_moments: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> second_moments: array<vec4f>;
// t_k of the distance columns and of the occupancy columns.
@group(0) @binding(4) var<storage, read_write> row_steps: array<vec2u>;
@group(0) @binding(5) var<storage, read_write> gradients: array<vec4i>;
@group(0) @binding(6) var<storage, read_write> flags: array<u32>;
// Rows that the step touched; [0] is their number.
@group(0) @binding(7) var<storage, read> touched: array<u32>;
// Rows that changed since the host read them; [0] is their number.
@group(0) @binding(8) var<storage, read_write> changed: array<atomic<u32>>;
// Sums that came near the end of their range.
@group(0) @binding(9) var<storage, read_write> saturated: atomic<u32>;

// Beyond half of the range a sum counts as saturated: it may have wrapped.
const SATURATION = 0x40000000;

fn units_of(quad: u32) -> vec4f {
  if quad < OCCUPANCY_QUAD {
    return vec4f(SDF_UNITS);
  }
  if quad < EXPLICIT_QUAD {
    return vec4f(OCCUPANCY_UNITS);
  }
  return vec4f(DISTANCE_UNITS, vec3f(GRADIENT_UNITS));
}

// One Adam step of a quad of a row.
fn step_quad(row: u32, quad: u32, t: u32, rate: f32) {
  let at = row * ROW_QUADS + quad;
  let sum = gradients[at];
  gradients[at] = vec4i(0);
  if any(abs(sum) >= vec4i(SATURATION)) {
    atomicAdd(&saturated, 1u);
  }
  let gradient = vec4f(sum) / (units_of(quad) * step.gradient_scale);
  var memory = Moments(first_moments[at], second_moments[at]);
  learned[at] -= adam(&memory, gradient, t, rate);
  first_moments[at] = memory.first;
  second_moments[at] = memory.second;
}

@compute @workgroup_size(128)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  let quad = t % 8u;
  let count = touched[0];
  for (var base = group.x * 16u; base < count; base += groups.x * 16u) {
    let i = base + t / 8u;
    if i < count {
      let row = touched[1u + i];
      let occupied = (flags[row] & OCCUPIED) != 0u;
      let steps = row_steps[row];
      if quad == EXPLICIT_QUAD || quad < OCCUPANCY_QUAD {
        step_quad(row, quad, steps.x + 1u, step.rate);
      } else if quad < EXPLICIT_QUAD && occupied {
        step_quad(row, quad, steps.y + 1u, step.occupancy_rate);
      }
    }
    // Everybody has read the row's flags and steps.
    workgroupBarrier();
    if i < count && quad == 7u {
      let row = touched[1u + i];
      let before = flags[row];
      let occupied = (before & OCCUPIED) != 0u;
      row_steps[row] += vec2u(1u, select(0u, 1u, occupied));
      flags[row] = CHANGED;
      if (before & CHANGED) == 0u {
        atomicStore(&changed[1u + atomicAdd(&changed[0], 1u)], row);
      }
    }
  }
}
