// Gradients of rows in fixed point. The kernel declares `step` and `gradients`
// (array<atomic<i32>>, 4 · ROW_QUADS a row).
#import lib/step

// Adds to a quad of a row's gradient, in units per column.
fn add_gradient(row: u32, quad: u32, value: vec4f, units: vec4f) {
  let scaled = vec4i(round(value * (units * step.gradient_scale)));
  let at = (row * ROW_QUADS + quad) * 4u;
  atomicAdd(&gradients[at], scaled.x);
  atomicAdd(&gradients[at + 1u], scaled.y);
  atomicAdd(&gradients[at + 2u], scaled.z);
  atomicAdd(&gradients[at + 3u], scaled.w);
}
