// Which pixels show what lies beyond unobserved space: one ray looks out for a block of pixels, an
// invocation a block. Twin: src/map/render/unknown.rs and `look_out` in
// src/map/render/tile/shade.rs. Constants of the host: BLOCK (side of a block, pixels), SHORTEST_M
// (unobserved space shorter than this does not count), STEP_M (how far apart the evidence is looked
// at), NEAR_SUM_M (eight corners whose distances add up to less are near a surface).
#import lib/scene
#import lib/view
#import lib/walk

@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<uniform> view: View;
@group(0) @binding(3) var<storage, read> links: array<u32>;
@group(0) @binding(4) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(5) var<storage, read> nodes: array<Node>;
@group(0) @binding(6) var<storage, read> rows: array<vec4f>;
// A bit a cell, sixteen words a brick.
@group(0) @binding(7) var<storage, read> bricks: array<u32>;
@group(0) @binding(8) var<storage, read> image: array<f32>;
// A bit a pixel, a word a block.
@group(0) @binding(9) var<storage, read_write> mask: array<u32>;

// Farther than any surface.
const NEVER: f32 = 3.4e38;

// How a ray has fared: whether it was in observed space, the length since, and whether it left.
struct Outlook {
  seen: bool,
  unseen_m: f32,
  left: bool,
}

fn go(outlook: ptr<function, Outlook>, length_m: f32, known: bool) {
  if known {
    (*outlook).seen = true;
    (*outlook).unseen_m = 0.0;
  } else if (*outlook).seen {
    (*outlook).unseen_m += length_m;
    (*outlook).left = (*outlook).left || (*outlook).unseen_m > SHORTEST_M;
  }
}

fn near_surface(node: u32) -> bool {
  var sum = 0.0;
  for (var k = 0u; k < 8u; k += 1u) {
    sum += rows[corners[node][k]].x;
  }
  return abs(sum) <= NEAR_SUM_M;
}

fn is_crossed(brick: u32, point: vec3f) -> bool {
  let cell = vec3u(vec3i(floor(point / scene.cell_m)) & vec3i(7));
  let index = cell.x | (cell.y << 3u) | (cell.z << 6u);
  return ((bricks[16u * brick + index / 32u] >> (index % 32u)) & 1u) == 1u;
}

// Goes on through a voxel.
fn pass_voxel(outlook: ptr<function, Outlook>, piece: Piece, direction: vec3f) {
  let length_m = (piece.t_out - piece.t_in) * length(direction);
  let brick = nodes[piece.node].brick;
  let near = near_surface(piece.node);
  let pieces = max(ceil(length_m / STEP_M), 1.0);
  for (var i = 0.0; i < pieces; i += 1.0) {
    let t = piece.t_in + (piece.t_out - piece.t_in) * (i + 0.5) / pieces;
    let point = view.eye + direction * t;
    go(outlook, length_m / pieces, near || (brick != NONE && is_crossed(brick, point)));
  }
}

// Where a ray has left observed space, if that is before `farthest`.
fn leaves_observed_space(direction: vec3f, farthest: f32) -> f32 {
  let speed = length(direction);
  var outlook = Outlook(false, 0.0, false);
  var walk = aim(view.eye, direction, farthest);
  var last = 0.0;
  // What touches of one voxel is passed as one.
  var pending = Piece(NONE, 0.0, 0.0);
  loop {
    var piece = Piece(NONE, 0.0, 0.0);
    let is_end = walk.t >= walk.t_end;
    if !is_end {
      piece = next_piece(&walk);
      if piece.t_out <= piece.t_in {
        continue;
      }
      if piece.node != NONE && piece.node == pending.node && pending.t_out == piece.t_in {
        pending.t_out = piece.t_out;
        continue;
      }
    }
    if pending.node != NONE {
      go(&outlook, (pending.t_in - last) * speed, false);
      pass_voxel(&outlook, pending, direction);
      last = pending.t_out;
      if outlook.left {
        return last;
      }
    }
    if is_end {
      return NEVER;
    }
    pending = piece;
  }
  return NEVER;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  let columns = (view.width + BLOCK - 1u) / BLOCK;
  let blocks = columns * ((view.height + BLOCK - 1u) / BLOCK);
  for (var block = id.x; block < blocks; block += groups.x * 64u) {
    let low = vec2u(block % columns, block / columns) * BLOCK;
    let high = min(low + vec2u(BLOCK), vec2u(view.width, view.height));
    var farthest = 0.0;
    for (var v = low.y; v < high.y; v += 1u) {
      for (var u = low.x; u < high.x; u += 1u) {
        farthest = max(farthest, image[view.depth_at + v * view.width + u]);
      }
    }
    let middle = (low + high) / 2u;
    let end = leaves_observed_space(ray_through(middle.x, middle.y), farthest);
    var bits = 0u;
    for (var v = low.y; v < high.y; v += 1u) {
      for (var u = low.x; u < high.x; u += 1u) {
        let depth = image[view.depth_at + v * view.width + u];
        // Beyond every surface where there is none.
        if depth == 0.0 || depth > end {
          bits |= 1u << ((v - low.y) * BLOCK + u - low.x);
        }
      }
    }
    mask[block] = bits;
  }
}
