// Takes the rows that optim/collect copied off the list. One invocation.

@group(0) @binding(0) var<storage, read_write> changed: array<u32>;
// x: rows that there was room for.
@group(0) @binding(1) var<uniform> room: vec4u;

@compute @workgroup_size(1)
fn main() {
  changed[0] -= min(changed[0], room.x);
}
