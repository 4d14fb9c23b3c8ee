// A ray through the octree, piece by piece; the twin of src/octree/traverse.rs. The kernel declares
// `step`, `links` and `corners`.
#import lib/step

// More than there are levels below any root.
const LEVELS = 32u;
// The least |direction| along an axis.
const LEAST: f32 = 1e-9;

struct Walk {
  // Planes across the mirrored axes: met at start + offset * stride.
  start: vec3f,
  // Octant bits of the mirrored axes.
  mirrored: u32,
  stride: vec3f,
  // The next piece begins here, and the ray ends at `t_end`.
  t: f32,
  // Low corner of the voxel of `level`, mirrored, in units from the root's corner.
  at: vec3u,
  level: u32,
  t_end: f32,
}

// A leaf or missing octant on the way, under the finest voxel with rows around it; NONE where there
// is none.
struct Piece {
  node: u32,
  t_in: f32,
  t_out: f32,
}

// Voxels on the way down, by log2 of their size; valid from the walk's level up.
var<private> trail: array<u32, LEVELS>;

fn aim(origin: vec3f, direction: vec3f, t_end: f32) -> Walk {
  let speed = max(abs(direction), vec3f(LEAST));
  let low = vec3f(step.root_min);
  let span = f32(1u << step.root_log2);
  let down = direction < vec3f(0.0);
  let above = origin - (low + vec3f(span)) * step.unit_m;
  let below = low * step.unit_m - origin;
  var walk: Walk;
  walk.start = select(below, above, down) / speed;
  walk.stride = vec3f(step.unit_m) / speed;
  let bits = select(vec3u(0u), vec3u(1u, 2u, 4u), down);
  walk.mirrored = bits.x | bits.y | bits.z;
  let first = walk.start;
  let last = walk.start + span * walk.stride;
  walk.t = max(max(first.x, first.y), max(first.z, 0.0));
  walk.t_end = min(min(last.x, last.y), min(last.z, t_end));
  walk.level = step.root_log2;
  if step.root_node == NONE {
    walk.t_end = 0.0;
  } else {
    trail[step.root_log2] = step.root_node;
  }
  return walk;
}

// Goes down to the leaf or hole at `t`; returns the log2 of its size.
fn descend(walk: ptr<function, Walk>) -> u32 {
  var node = trail[(*walk).level];
  while (*walk).level > 0u {
    let link = links[node];
    if (link & 0xffu) == 0u {
      break;
    }
    let half = 1u << ((*walk).level - 1u);
    let planes = (*walk).start + vec3f((*walk).at + vec3u(half)) * (*walk).stride;
    let beyond = planes <= vec3f((*walk).t);
    (*walk).at += select(vec3u(0u), vec3u(half), beyond);
    let bits = select(vec3u(0u), vec3u(1u, 2u, 4u), beyond);
    let octant = (bits.x | bits.y | bits.z) ^ (*walk).mirrored;
    if ((link >> octant) & 1u) == 0u {
      return (*walk).level - 1u;
    }
    node = (link >> 8u) * 8u + octant;
    (*walk).level -= 1u;
    trail[(*walk).level] = node;
  }
  return (*walk).level;
}

// Steps out of the cube of 2^log2_size units at `at`, and up to the voxel around both sides; returns
// where.
fn leave(walk: ptr<function, Walk>, log2_size: u32) -> f32 {
  let size = 1u << log2_size;
  let planes = (*walk).start + vec3f((*walk).at + vec3u(size)) * (*walk).stride;
  var exit = 0u;
  if planes.y < planes[exit] {
    exit = 1u;
  }
  if planes.z < planes[exit] {
    exit = 2u;
  }
  let t = min(planes[exit], (*walk).t_end);
  (*walk).t = t;
  let next = (*walk).at[exit] + size;
  let changed = firstLeadingBit((*walk).at[exit] ^ next);
  if changed >= step.root_log2 {
    (*walk).t = (*walk).t_end;
  } else {
    (*walk).at[exit] = next;
    (*walk).level = changed + 1u;
    let shift = vec3u((*walk).level);
    (*walk).at = ((*walk).at >> shift) << shift;
  }
  return t;
}

// The next piece; the walk is not at its end.
fn next_piece(walk: ptr<function, Walk>) -> Piece {
  let log2_size = descend(walk);
  let t_in = (*walk).t;
  var owner = NONE;
  for (var level = (*walk).level; level <= step.root_log2; level += 1u) {
    if corners[trail[level]][0] != NONE {
      owner = trail[level];
      break;
    }
  }
  return Piece(owner, t_in, leave(walk, log2_size));
}
