// Brings each cube to the tiles that it touches, in any order: (place in the order, cube).
#import lib/view
#import lib/pairs

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var<storage, read> spans: array<vec4u>;
// Where the next cube of each tile goes.
@group(0) @binding(2) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(3) var<storage, read_write> entries: array<vec2u>;

var<workgroup> orders: array<u32, GROUP>;

@compute @workgroup_size(64)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  for (var base = group.x * GROUP; base < view.cubes; base += groups.x * GROUP) {
    var mine = NOWHERE;
    if base + t < view.cubes {
      mine = spans[base + t];
    }
    orders[t] = mine.z;
    let pairs = deal(t, mine);
    for (var pair = t; pair < pairs; pair += GROUP) {
      let cube = cube_of(pair);
      let slot = atomicAdd(&counts[tile_of(cube, pair)], 1u);
      if slot < view.room {
        entries[slot] = vec2u(orders[cube], base + cube);
      }
    }
    workgroupBarrier();
  }
}
