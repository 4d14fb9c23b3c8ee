// Copies rows that changed to where the host reads them, from the end of the list, and takes their
// flags; optim/trim then shortens the list. Eight invocations a row.
#import lib/constants

@group(0) @binding(0) var<storage, read> learned: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> flags: array<u32>;
// Rows that changed since the host read them; [0] is their number.
@group(0) @binding(2) var<storage, read> changed: array<u32>;
// By row: 7 quads of columns, and one that ends with its number.
@group(0) @binding(3) var<storage, read_write> copied: array<vec4f>;
// x: rows that there is room for.
@group(0) @binding(4) var<uniform> room: vec4u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  let count = changed[0];
  let copies = min(count, room.x);
  for (var item = id.x; item < copies * 8u; item += groups.x * 64u) {
    let row = changed[1u + (count - copies) + item / 8u];
    let quad = item % 8u;
    if quad < ROW_QUADS {
      copied[item] = learned[row * ROW_QUADS + quad];
    } else {
      copied[item] = vec4f(0.0, 0.0, 0.0, bitcast<f32>(row));
      flags[row] &= ~CHANGED;
    }
  }
}
