// The cubes of a tile on its pixels, front to back; a workgroup a tile, an invocation a pixel. Twin:
// src/map/render/tile/raster.rs and shade.rs. Constants of the host: SIDE, REACH, LEAST_POSITIVE,
// LEAST_LIGHT (a ray ends where less is left), FAR (in 1/s, what reaches no further takes no light),
// TOUCH (cubes that meet within this length of a ray touch), LEAST_DIRECTION, LEAST_WEIGHT (a sample
// that takes less is not looked up), REFINEMENTS (of a zero crossing), and those of lib/paint.
#import lib/scene
#import lib/eye
#import lib/step
#import lib/interpolation
#import lib/density
#import lib/paint

@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<uniform> view: View;
@group(0) @binding(3) var<storage, read> starts: array<u32>;
// (place in the order, cube), tile after tile; sorted here.
@group(0) @binding(4) var<storage, read_write> entries: array<vec2u>;
@group(0) @binding(5) var<storage, read> spans: array<vec4u>;
@group(0) @binding(6) var<storage, read> cubes: array<Cube>;
@group(0) @binding(7) var<storage, read> cell_corners: array<array<f32, 8>>;
@group(0) @binding(8) var<storage, read> links: array<u32>;
@group(0) @binding(9) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(10) var<storage, read> nodes: array<Node>;
@group(0) @binding(11) var<storage, read> blocks: array<u32>;
@group(0) @binding(12) var<storage, read> texels: array<vec2u>;
@group(0) @binding(13) var<storage, read> harmonics: array<vec2u>;
@group(0) @binding(14) var<storage, read> leaf_corners: array<vec4f>;
// Plane after plane, as `view` says.
@group(0) @binding(15) var<storage, read_write> image: array<f32>;

const PIXELS = 256u;
// Cubes of a tile that are sorted in workgroup memory; more are sorted where they lie.
const SORTED = 1024u;
// Cubes that are read together.
const BATCH = 32u;

var<workgroup> count: u32;
var<workgroup> order: array<vec2u, SORTED>;
var<workgroup> lit: atomic<u32>;
var<workgroup> is_lit: u32;
// Of a batch: what a cube covers, its low and high corner from the eye, its host's low corner from
// the eye and edge length, its block, and its corners.
var<workgroup> covers: array<vec2u, BATCH>;
var<workgroup> lows: array<vec3f, BATCH>;
var<workgroup> highs: array<vec3f, BATCH>;
var<workgroup> hosts: array<vec4f, BATCH>;
var<workgroup> block_of: array<u32, BATCH>;
var<workgroup> read_corners: array<vec4f, 8u * BATCH>;

// The pixel's ray: its direction and the inverse of that, what is left of its light, where it left
// the last cube and the distance there, and 1 where it came out of free space into it.
var<private> direction: vec3f;
var<private> inverse: vec3f;
var<private> light: f32;
var<private> last_t: f32;
var<private> last_f: f32;
var<private> front: f32;
// What it shows.
var<private> paint: Paint;
var<private> depth_m: f32;
var<private> normal: vec3f;

fn comes_after(a: vec2u, b: vec2u) -> bool {
  return a.x > b.x || (a.x == b.x && a.y > b.y);
}

// Sorting by merges whose halves lie back to back, so that the larger of two always goes to the
// higher place, and what is missing of a power of two counts as last without being there. `size` is
// the merge's, `reach` half the distance of its steps; `pair` the pair of places.
fn flipped(pair: u32, size: u32) -> vec2u {
  let base = pair / (size / 2u) * size;
  let at = pair % (size / 2u);
  return vec2u(base + at, base + size - 1u - at);
}

fn spread(pair: u32, reach: u32) -> vec2u {
  let low = pair / reach * 2u * reach + pair % reach;
  return vec2u(low, low + reach);
}

fn order_pair(at: vec2u) {
  if at.y < count {
    let a = order[at.x];
    let b = order[at.y];
    if comes_after(a, b) {
      order[at.x] = b;
      order[at.y] = a;
    }
  }
}

fn sort_here(t: u32, first: u32) {
  for (var i = t; i < count; i += PIXELS) {
    order[i] = entries[first + i];
  }
  workgroupBarrier();
  for (var size = 2u; size / 2u < count; size *= 2u) {
    let pairs = ((count + size - 1u) / size) * (size / 2u);
    for (var pair = t; pair < pairs; pair += PIXELS) {
      order_pair(flipped(pair, size));
    }
    workgroupBarrier();
    for (var reach = size / 4u; reach > 0u; reach /= 2u) {
      for (var pair = t; pair < pairs; pair += PIXELS) {
        order_pair(spread(pair, reach));
      }
      workgroupBarrier();
    }
  }
}

fn order_pair_there(first: u32, at: vec2u) {
  if at.y < count {
    let a = entries[first + at.x];
    let b = entries[first + at.y];
    if comes_after(a, b) {
      entries[first + at.x] = b;
      entries[first + at.y] = a;
    }
  }
}

fn sort_there(t: u32, first: u32) {
  for (var size = 2u; size / 2u < count; size *= 2u) {
    let pairs = ((count + size - 1u) / size) * (size / 2u);
    for (var pair = t; pair < pairs; pair += PIXELS) {
      order_pair_there(first, flipped(pair, size));
    }
    storageBarrier();
    for (var reach = size / 4u; reach > 0u; reach /= 2u) {
      for (var pair = t; pair < pairs; pair += PIXELS) {
        order_pair_there(first, spread(pair, reach));
      }
      storageBarrier();
    }
  }
}

// The i-th cube of the tile from the front.
fn sorted(first: u32, i: u32) -> u32 {
  if count <= SORTED {
    return order[i].y;
  }
  return entries[first + i].y;
}

// Reads a batch into workgroup memory, an invocation a corner.
fn read_batch(t: u32, first: u32, base: u32) {
  let corner = base + t / 8u;
  if corner < count {
    let id = sorted(first, corner);
    let leaf = cubes[id].leaf;
    if leaf == NONE {
      read_corners[t] = vec4f(cell_corners[id][t % 8u], 0.0, 0.0, 0.0);
    } else {
      read_corners[t] = leaf_corners[8u * leaf + t % 8u];
    }
  }
  if t < BATCH && base + t < count {
    let id = sorted(first, base + t);
    let cube = cubes[id];
    covers[t] = spans[id].xy;
    lows[t] = from_eye(cube.low);
    highs[t] = from_eye(cube.low + vec3i(i32(1u << cube.log2_size)));
    hosts[t] = vec4f(from_eye(cube.host_low), size_m(cube.host_log2));
    block_of[t] = cube.block;
  }
}

// The distance in cube `c` of the batch at three places across its host, where x is from 0 to 1.
fn distances(c: u32, x: vec3f, y: vec3f, z: vec3f) -> vec3f {
  var at: array<vec3f, 8>;
  for (var k = 0u; k < 8u; k += 1u) {
    let corner = read_corners[8u * c + k];
    at[k] = corner.w * z + (corner.z * y + (corner.y * x + corner.x));
  }
  let low = mix(mix(at[0], at[1], x), mix(at[2], at[3], x), y);
  let high = mix(mix(at[4], at[5], x), mix(at[6], at[7], x), y);
  return mix(low, high, z);
}

fn distance_at(c: u32, x: vec3f) -> f32 {
  return distances(c, vec3f(x.x), vec3f(x.y), vec3f(x.z)).x;
}

// The gradient of the distance in cube `c` at a place across its host, times the host's edge.
fn slope_at(c: u32, x: vec3f) -> vec3f {
  var gradient = vec3f(0.0);
  for (var k = 0u; k < 8u; k += 1u) {
    let corner = read_corners[8u * c + k];
    let side = upper(k);
    let w = mix(vec3f(1.0) - x, x, side);
    let sign = 2.0 * side - vec3f(1.0);
    let value = corner.x + dot(corner.yzw, x);
    let by_weight = sign * vec3f(w.y * w.z, w.x * w.z, w.x * w.y);
    gradient += by_weight * value + corner.yzw * (w.x * w.y * w.z);
  }
  return gradient;
}

// Takes the pixel's ray through cube `c` of the batch.
fn pass_through(c: u32) {
  let a = lows[c] * inverse;
  let b = highs[c] * inverse;
  let near = min(a, b);
  let far = max(a, b);
  let t_in = max(max(near.x, near.y), max(near.z, 0.0));
  let t_out = min(min(far.x, far.y), far.z);
  if t_out <= t_in {
    return;
  }
  let host = hosts[c];
  let start = host.xyz * (-1.0 / host.w);
  let slope = direction * (1.0 / host.w);
  let t = vec3f(t_in, 0.5 * (t_in + t_out), t_out);
  var f = distances(c, slope.x * t + start.x, slope.y * t + start.y, slope.z * t + start.z);
  // What touches the last cube goes on with its distance: no light is lost between voxels.
  let touches = abs(t_in - last_t) < TOUCH;
  if touches {
    f.x = last_f;
  } else {
    front = 0.0;
  }
  if f.x > 0.0 {
    front = 1.0;
  }
  last_t = t_out;
  last_f = f.z;
  let s = view.sharpness;
  if front == 0.0 || min(f.x, min(f.y, f.z)) >= FAR / s {
    return;
  }
  let dim = dimness(f.y, s);
  let passed = min(dimness(f.x, s) / dim, 1.0) * min(dim / dimness(f.z, s), 1.0);
  let before = light;
  light = before * passed;
  let weight = before - light;
  let is_surface = before > 0.5 && light <= 0.5;
  if weight <= LEAST_WEIGHT && !is_surface {
    return;
  }
  let at = place_in(c, t, f, start, slope, before, is_surface);
  if is_surface {
    depth_m = at;
    let gradient = slope_at(c, slope * at + start);
    let size = length(gradient);
    normal = select(vec3f(0.0), gradient / size, size > 0.0);
    normal = select(normal, -normal, dot(normal, direction) > 0.0);
  }
  if view.color_at != NONE {
    add_color(&paint, block_of[c], host, direction, at, weight);
  }
}

// Where on the ray a cube's sample is taken, given distances at three places.
fn place_in(
  c: u32,
  t: vec3f,
  f: vec3f,
  start: vec3f,
  slope: vec3f,
  before: f32,
  is_surface: bool,
) -> f32 {
  if view.midpoint == 1u {
    return t.y;
  }
  let first = f.x > 0.0 && f.y <= 0.0;
  if first || (f.y > 0.0 && f.z <= 0.0) {
    return crossing(c, select(t.yz, t.xy, first), select(f.yz, f.xy, first), start, slope);
  }
  var share = middle(f.x, f.z, view.sharpness);
  if is_surface {
    share = place_of(0.5 / before, f.x, f.z, view.sharpness);
  }
  return t.x + (t.z - t.x) * share;
}

// Where the distance falls through zero between two places: by false position with the weights of
// Illinois.
fn crossing(c: u32, between: vec2f, falling: vec2f, start: vec3f, slope: vec3f) -> f32 {
  var t = between;
  var f = falling;
  var at = t.x + (t.y - t.x) * (f.x / (f.x - f.y));
  for (var i = 0u; i < REFINEMENTS; i += 1u) {
    let found = distance_at(c, slope * at + start);
    if found > 0.0 {
      t.x = at;
      f = vec2f(found, 0.5 * f.y);
    } else {
      t.y = at;
      f = vec2f(0.5 * f.x, found);
    }
    // A distance of exactly zero at both ends has no slope to follow.
    let fall = max(f.x - f.y, LEAST_POSITIVE);
    at = t.x + (t.y - t.x) * clamp(f.x / fall, 0.0, 1.0);
  }
  return at;
}

// Begins the ray of a pixel; one beyond the image's border has no light.
fn begin(pixel: vec2u) {
  direction = ray_through(pixel.x, pixel.y);
  let least = select(vec3f(LEAST_DIRECTION), vec3f(-LEAST_DIRECTION), direction < vec3f(0.0));
  inverse = vec3f(1.0) / select(direction, least, abs(direction) < vec3f(LEAST_DIRECTION));
  light = select(0.0, 1.0, pixel.x < view.width && pixel.y < view.height);
  if scene.harmonics > 0u {
    look_along(direction);
  }
  last_t = -1.0;
  last_f = 0.0;
  front = 0.0;
  paint = Paint(vec3f(0.0), 0.0);
  depth_m = 0.0;
  normal = vec3f(0.0);
}

fn write(plane: u32, pixel: u32, value: vec3f) {
  if plane != NONE {
    image[plane + 3u * pixel] = value.x;
    image[plane + 3u * pixel + 1u] = value.y;
    image[plane + 3u * pixel + 2u] = value.z;
  }
}

fn finish(pixel: vec2u) {
  if pixel.x >= view.width || pixel.y >= view.height {
    return;
  }
  let at = pixel.y * view.width + pixel.x;
  let opacity = 1.0 - light;
  write(view.color_at, at, color_of(paint, opacity));
  write(view.normal_at, at, normal);
  if view.depth_at != NONE {
    image[view.depth_at + at] = depth_m;
  }
  if view.opacity_at != NONE {
    image[view.opacity_at + at] = opacity;
  }
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) t: u32, @builtin(workgroup_id) group: vec3u) {
  // Neighbouring invocations are a patch of 8 by 4 pixels: what they pass is mostly the same.
  let patch_of = t / 32u;
  let local = vec2u(t % 8u + 8u * (patch_of % 2u), (t % 32u) / 8u + 4u * (patch_of / 2u));
  let pixel = group.xy * SIDE + local;
  let tile = group.y * view.columns + group.x;
  let first = min(starts[tile], view.room);
  if t == 0u {
    count = min(starts[tile + 1u], view.room) - first;
  }
  workgroupBarrier();
  if count <= SORTED {
    sort_here(t, first);
  } else {
    sort_there(t, first);
  }
  begin(pixel);
  for (var base = 0u; base < count; base += BATCH) {
    if t == 0u {
      atomicStore(&lit, 0u);
    }
    workgroupBarrier();
    if light > LEAST_LIGHT {
      atomicOr(&lit, 1u);
    }
    read_batch(t, first, base);
    workgroupBarrier();
    if t == 0u {
      is_lit = atomicLoad(&lit);
    }
    workgroupBarrier();
    if is_lit == 0u {
      break;
    }
    let cubes_here = min(BATCH, count - base);
    for (var c = 0u; c < cubes_here; c += 1u) {
      let span = covers[c];
      let is_in = pixel.x >= (span.x & 0xffffu) && pixel.x <= (span.x >> 16u)
        && pixel.y >= (span.y & 0xffffu) && pixel.y <= (span.y >> 16u);
      if is_in && light > LEAST_LIGHT {
        pass_through(c);
      }
    }
    workgroupBarrier();
  }
  finish(pixel);
}
