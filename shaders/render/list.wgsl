// The leaves that may take light, with what a ray needs of their corners, and octants that are missing
// of voxels near a surface. An invocation a node; the order of the list has no
// meaning. Twin: src/map/render/near.rs and src/map/render/tile/cubes.rs. Constants of the host:
// HALF_DIAGONAL (how far the nearest corner of a voxel may be from a point in it, in edges), LEARNED_M
// (how far training may have moved the distance at a corner).
#import lib/scene
#import lib/step
#import lib/interpolation

@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<storage, read> links: array<u32>;
@group(0) @binding(3) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(4) var<storage, read> nodes: array<Node>;
@group(0) @binding(5) var<storage, read> rows: array<vec4f>;
@group(0) @binding(6) var<storage, read> vertices: array<vec4f>;
@group(0) @binding(7) var<storage, read_write> leaves: array<Cube>;
// Eight a cube: with x from 0 to 1 across the host, corner k says c.x + dot(c.yzw, x).
@group(0) @binding(8) var<storage, read_write> leaf_corners: array<vec4f>;
// How many there are, also those that found no room.
@group(0) @binding(9) var<storage, read_write> listed_leaves: atomic<u32>;

fn edge_m(log2_size: u32) -> f32 {
  return f32(1u << log2_size) * step.unit_m;
}

fn takes_light(id: u32, log2_size: u32) -> bool {
  if corners[id][0] == NONE {
    return false;
  }
  let reach = HALF_DIAGONAL * edge_m(log2_size) + scene.light_m + LEARNED_M;
  for (var k = 0u; k < 8u; k += 1u) {
    if abs(rows[corners[id][k]].x) <= reach {
      return true;
    }
  }
  return false;
}

fn add(id: u32, node: Node, low: vec3i, log2_size: u32) {
  let index = atomicAdd(&listed_leaves, 1u);
  if index >= scene.room {
    return;
  }
  let host_log2 = node.size - 1u;
  let fine = vec3u(scene.fine_log2);
  leaves[index] = Cube(
    low << fine,
    log2_size + fine.x,
    node.low << fine,
    host_log2 + fine.x,
    node.block,
    index,
    vec2u(0u),
  );
  let lever = GRADIENT_SHARE * edge_m(host_log2);
  for (var k = 0u; k < 8u; k += 1u) {
    let vertex = vertices[corners[id][k]];
    let slope = vertex.yzw * lever;
    // From the corner's own origin to the voxel's.
    leaf_corners[8u * index + k] = vec4f(vertex.x - dot(slope, upper(k)), slope);
  }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u, @builtin(num_workgroups) groups: vec3u) {
  for (var id = invocation.x; id < scene.nodes; id += groups.x * 64u) {
    let node = nodes[id];
    if node.size == 0u || node.size - 1u > scene.surface_log2 || !takes_light(id, node.size - 1u) {
      continue;
    }
    let children = links[id] & 0xffu;
    if children == 0u {
      add(id, node, node.low, node.size - 1u);
      continue;
    }
    let log2_size = node.size - 2u;
    for (var octant = 0u; octant < 8u; octant += 1u) {
      if ((children >> octant) & 1u) == 0u {
        let bits = vec3i(vec3u(octant, octant >> 1u, octant >> 2u) & vec3u(1u));
        add(id, node, node.low + (bits << vec3u(log2_size)), log2_size);
      }
    }
  }
}
