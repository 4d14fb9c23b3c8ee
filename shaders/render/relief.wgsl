// The cubes that are drawn: leaves as they were listed, and where surfaces have a relief, its cells.
// An invocation a leaf; the order of the list has no meaning. Twin: `Grid` in src/map/render/relief.rs,
// `emit_cells` and `complete` in src/map/render/tile/cubes.rs. Constant of the host: DISTANCE_STEP_M (a
// step of a stored distance).
#import lib/scene
#import lib/interpolation

@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var<storage, read> leaves: array<Cube>;
@group(0) @binding(2) var<storage, read> leaf_corners: array<vec4f>;
@group(0) @binding(3) var<storage, read> listed_leaves: u32;
@group(0) @binding(4) var<storage, read> blocks: array<u32>;
@group(0) @binding(5) var<storage, read> texels: array<vec2u>;
@group(0) @binding(6) var<storage, read_write> cubes: array<Cube>;
// Distances at the corners of cells, eight a cube; of no meaning for cubes that a leaf speaks for.
@group(0) @binding(7) var<storage, read_write> cell_corners: array<array<f32, 8>>;
// How many there are, also those that found no room.
@group(0) @binding(8) var<storage, read_write> listed: atomic<u32>;

// The corners of the cell in hand: the distance, and 1 where the relief knows it.
var<private> told: array<vec2f, 8>;

// The distance at a vertex of a block or on the upper faces of its cell, and 1 where it is known.
fn relief_at(block: u32, vertex: vec3u) -> vec2f {
  let side = 1u << scene.band_log2;
  let beyond = select(vec3u(0u), vec3u(1u, 2u, 4u), vertex == vec3u(side));
  let owner = blocks[8u * block + (beyond.x | beyond.y | beyond.z)];
  if owner == NONE {
    return vec2f(0.0);
  }
  let shifts = vec3u(0u, scene.band_log2, 2u * scene.band_log2);
  let within = (vertex & vec3u(side - 1u)) << shifts;
  let texel = texels[(owner << (3u * scene.band_log2)) + (within.x | within.y | within.z)];
  let steps = bitcast<i32>(texel.y) >> 16u;
  return select(vec2f(0.0), vec2f(f32(steps) * DISTANCE_STEP_M, 1.0), steps != 0);
}

fn corner_bits(k: u32) -> vec3u {
  return vec3u(k, k >> 1u, k >> 2u) & vec3u(1u);
}

// Reads the corners of a cell; how many are known.
fn read_cell(block: u32, at: vec3u) -> u32 {
  var known = 0u;
  for (var k = 0u; k < 8u; k += 1u) {
    told[k] = relief_at(block, at + corner_bits(k));
    known += u32(told[k].y);
  }
  return known;
}

// Whether the cell in hand takes light, by what is known of it.
fn takes_light() -> bool {
  var near = false;
  var above = false;
  var below = false;
  for (var k = 0u; k < 8u; k += 1u) {
    let is_known = told[k].y > 0.0;
    near = near || (is_known && abs(told[k].x) <= scene.light_m);
    above = above || (is_known && told[k].x > 0.0);
    below = below || (is_known && told[k].x < 0.0);
  }
  return near || (above && below);
}

// What a leaf says at a place across its host, where x is from 0 to 1.
fn leaf_at(leaf: u32, x: vec3f) -> f32 {
  var sum = 0.0;
  for (var k = 0u; k < 8u; k += 1u) {
    let shares = select(vec3f(1.0) - x, x, upper(k) > vec3f(0.0));
    let c = leaf_corners[8u * leaf + k];
    sum += shares.x * shares.y * shares.z * (c.x + dot(c.yzw, x));
  }
  return sum;
}

// A distance at corner k of the cell in hand that fits those which are known: a distance changes by no
// more than the way between two places.
fn bounded(distance: f32, k: u32) -> f32 {
  var least = -3.4e38;
  var most = 3.4e38;
  for (var other = 0u; other < 8u; other += 1u) {
    if told[other].y > 0.0 {
      let way = sqrt(f32(countOneBits(k ^ other))) / scene.band_scale;
      least = max(least, told[other].x - way);
      most = min(most, told[other].x + way);
    }
  }
  // What is known may not fit itself.
  return min(max(distance, least), most);
}

// Room for another cube; NONE where there is none.
fn place() -> u32 {
  let index = atomicAdd(&listed, 1u);
  return select(NONE, index, index < scene.cube_room);
}

// A part of a leaf that is drawn as the leaf says.
fn add_part(leaf: u32, low: vec3i, log2_size: u32) {
  let index = place();
  if index == NONE {
    return;
  }
  cubes[index] = leaves[leaf];
  cubes[index].low = low;
  cubes[index].log2_size = log2_size;
}

// The cell in hand, some corners of which are known.
fn add_cell(leaf: u32, low: vec3i) {
  let index = place();
  if index == NONE {
    return;
  }
  let cube = leaves[leaf];
  let log2_size = scene.cell_log2;
  cubes[index] = Cube(low, log2_size, low, log2_size, cube.block, NONE, vec2u(0u));
  let host_size = f32(1u << cube.host_log2);
  for (var k = 0u; k < 8u; k += 1u) {
    var distance = told[k].x;
    if told[k].y == 0.0 {
      let at = low - cube.host_low + (vec3i(corner_bits(k)) << vec3u(log2_size));
      distance = bounded(leaf_at(leaf, vec3f(at) / host_size), k);
    }
    cell_corners[index][k] = distance;
  }
}

fn refine(leaf: u32) {
  let cube = leaves[leaf];
  if cube.block == NONE || cube.log2_size < scene.cell_log2 {
    add_part(leaf, cube.low, cube.log2_size);
    return;
  }
  let log2_side = cube.log2_size - scene.cell_log2;
  let side = 1u << log2_side;
  let mask = vec3i(i32(1u << scene.band_log2) - 1);
  let first = vec3u((cube.low >> vec3u(scene.cell_log2)) & mask);
  let cells = 1u << (3u * log2_side);
  let shifts = vec3u(0u, log2_side, 2u * log2_side);
  var is_known = false;
  for (var i = 0u; i < cells && !is_known; i += 1u) {
    is_known = read_cell(cube.block, first + ((vec3u(i) >> shifts) & vec3u(side - 1u))) > 0u;
  }
  if !is_known {
    add_part(leaf, cube.low, cube.log2_size);
    return;
  }
  for (var i = 0u; i < cells; i += 1u) {
    let at = (vec3u(i) >> shifts) & vec3u(side - 1u);
    let known = read_cell(cube.block, first + at);
    let low = cube.low + (vec3i(at) << vec3u(scene.cell_log2));
    if known == 0u {
      add_part(leaf, low, scene.cell_log2);
    } else if takes_light() {
      add_cell(leaf, low);
    }
  }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) invocation: vec3u, @builtin(num_workgroups) groups: vec3u) {
  let count = min(listed_leaves, scene.room);
  for (var leaf = invocation.x; leaf < count; leaf += groups.x * 64u) {
    refine(leaf);
  }
}
