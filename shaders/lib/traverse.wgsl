// Rays through the octree, one segment a voxel, in order; the twin of src/octree/traverse.rs, which
// says how. The kernel declares `step`, `links` and `corners`.
#import lib/step
#import lib/sample

const LEVELS = 32u;
const LEAST: f32 = 1e-9;

// What a ray has of one voxel.
struct Segment {
  // The finest voxel with rows around it, packed.
  voxel: u32,
  // Where the ray enters and leaves, in lengths of its direction.
  t_in: f32,
  t_out: f32,
}

// Where a ray is.
struct Path {
  // Planes of the lattice are met at start + offset · pace, along mirrored axes.
  start: vec3f,
  mirrored: u32,
  pace: vec3f,
  level: u32,
  at: vec3u,
  t: f32,
  t_end: f32,
  // Found, but may still grow; its voxel is NONE where there is none.
  pending: Segment,
}

var<private> path: Path;
// Voxels on the way down, by log2 of their size.
var<private> path_nodes: array<u32, LEVELS>;

// Where the ray meets three planes across the axes.
fn planes(offset: vec3u) -> vec3f {
  return path.start + vec3f(offset) * path.pace;
}

// Starts with the part of origin + t · direction from `t` to `t_end`.
fn follow(origin: vec3f, direction: vec3f, t: f32, t_end: f32) {
  path.t = t;
  path.t_end = t_end;
  path.mirrored = 0u;
  path.at = vec3u(0u);
  path.level = step.root_log2;
  path.pending.voxel = NONE;
  if step.root_node == NONE {
    path.t_end = path.t;
    return;
  }
  path_nodes[path.level] = step.root_node;
  let span = 1u << step.root_log2;
  let low = vec3f(step.root_min);
  let speed = max(abs(direction), vec3f(LEAST));
  let downwards = direction < vec3f(0.0);
  path.mirrored = dot(select(vec3u(0u), vec3u(1u, 2u, 4u), downwards), vec3u(1u));
  let near = select(
    low * step.unit_m - origin,
    origin - (low + vec3f(f32(span))) * step.unit_m,
    downwards,
  );
  path.start = near / speed;
  path.pace = vec3f(step.unit_m) / speed;
  let first = planes(vec3u(0u));
  let last = planes(vec3u(span));
  path.t = max(max(path.t, first.x), max(first.y, first.z));
  path.t_end = min(min(path.t_end, last.x), min(last.y, last.z));
}

// Goes down to the leaf or hole at `t`; returns the log2 of its size.
fn descend() -> u32 {
  var node = path_nodes[path.level];
  while path.level > 0u {
    let link = links[node];
    if (link & 0xffu) == 0u {
      break;
    }
    let half = 1u << (path.level - 1u);
    let beyond = planes(path.at + vec3u(half)) <= vec3f(path.t);
    path.at += select(vec3u(0u), vec3u(half), beyond);
    let octant = dot(select(vec3u(0u), vec3u(1u, 2u, 4u), beyond), vec3u(1u)) ^ path.mirrored;
    if ((link >> octant) & 1u) == 0u {
      return path.level - 1u;
    }
    node = (link >> 8u) * 8u + octant;
    path.level -= 1u;
    path_nodes[path.level] = node;
  }
  return path.level;
}

// Steps out of the cube of 2^log2 units, and up to the voxel around both sides; returns where.
fn leave(log2_size: u32) -> f32 {
  let size = 1u << log2_size;
  let ends = planes(path.at + vec3u(size));
  var axis = 0u;
  var t = ends.x;
  if ends.y < t {
    axis = 1u;
    t = ends.y;
  }
  if ends.z < t {
    axis = 2u;
    t = ends.z;
  }
  path.t = min(t, path.t_end);
  let from_at = path.at[axis];
  let next = from_at + size;
  let changed = firstLeadingBit(from_at ^ next);
  if changed >= step.root_log2 {
    path.t = path.t_end;
  } else {
    let is_axis = vec3u(0u, 1u, 2u) == vec3u(axis);
    path.level = changed + 1u;
    path.at = (select(path.at, vec3u(next), is_axis) >> vec3u(path.level)) << vec3u(path.level);
  }
  return min(t, path.t_end);
}

// The next leaf or missing octant, however short, under the finest voxel with rows around it.
fn next_piece() -> Segment {
  let log2_size = descend();
  var piece: Segment;
  piece.voxel = NONE;
  piece.t_in = path.t;
  for (var level = path.level; level <= step.root_log2; level += 1u) {
    if corners[path_nodes[level]][0] != NONE {
      piece.voxel = pack_voxel(path_nodes[level], level);
      break;
    }
  }
  piece.t_out = leave(log2_size);
  return piece;
}

// The next segment; its voxel is NONE at the end.
fn next_segment() -> Segment {
  while path.t < path.t_end {
    let piece = next_piece();
    if piece.t_out <= piece.t_in {
      continue;
    }
    let held = path.pending;
    if held.voxel != NONE && held.voxel == piece.voxel && held.t_out == piece.t_in {
      path.pending.t_out = piece.t_out;
      continue;
    }
    path.pending = piece;
    if held.voxel != NONE {
      return held;
    }
  }
  let last = path.pending;
  path.pending.voxel = NONE;
  return last;
}
