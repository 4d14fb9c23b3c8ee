// Vertices of the band of colour around a place; the twin of src/octree/band.rs. The kernel declares
// `radiance`, `blocks` (a table of the blocks: a cell of level 0, and the block + 1 or 0) and
// `uppers` (each block and its neighbours).
#import lib/constants
#import lib/interpolation
#import lib/places
#import lib/radiance

struct BandPlace {
  // Of level 0.
  cell: vec3i,
  // The vertex at the low corner, within its block.
  local: vec3u,
  // From that vertex, in units of the spacing.
  offset: vec3f,
}

fn band_place(point: vec3f) -> BandPlace {
  let at = point * radiance.vertices_per_m;
  let low = floor(at);
  let vertex = vec3i(low);
  let side = i32(1u << radiance.log2_side);
  let local = vec3u(vertex & vec3i(side - 1));
  return BandPlace(vertex >> vec3u(radiance.log2_side), local, at - low);
}

// The block of a cell; NONE if there is none.
fn find_block(cell: vec3i) -> u32 {
  let mask = arrayLength(&blocks) - 1u;
  let start = place_slot(cell);
  for (var i = 0u; i <= mask; i += 1u) {
    let entry = blocks[(start + i) & mask];
    if entry.w == 0 || all(entry.xyz == cell) {
      return u32(entry.w) - 1u;
    }
  }
  return NONE;
}

// The row of vertex k of the eight around a place in a block; NONE where its block is missing.
fn vertex_row(block: u32, place: BandPlace, k: u32) -> u32 {
  let side = 1u << radiance.log2_side;
  let at = place.local + (vec3u(k, k >> 1u, k >> 2u) & vec3u(1u));
  let is_beyond = at == vec3u(side);
  let neighbour = dot(select(vec3u(0u), vec3u(1u, 2u, 4u), is_beyond), vec3u(1u));
  let home = uppers[block][neighbour];
  let within = at & vec3u(side - 1u);
  let index = (within.z * side + within.y) * side + within.x;
  return select((home << (3u * radiance.log2_side)) + index, NONE, home == NONE);
}

// The trilinear weight of vertex k, ...
fn vertex_weight(offset: vec3f, k: u32) -> f32 {
  let shares = select(vec3f(1.0) - offset, offset, upper(k) > vec3f(0.0));
  return shares.x * shares.y * shares.z;
}

// ... and how it changes with a movement, in units of the spacing.
fn vertex_slope(offset: vec3f, k: u32, movement: vec3f) -> f32 {
  let shares = select(vec3f(1.0) - offset, offset, upper(k) > vec3f(0.0));
  let along = movement * (2.0 * upper(k) - vec3f(1.0));
  return along.x * shares.y * shares.z + along.y * shares.z * shares.x
    + along.z * shares.x * shares.y;
}
