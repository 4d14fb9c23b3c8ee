// The observed surface, asked for signed distances; the twin of src/surface/label.rs. The kernel
// declares `draw`, what lib/octree needs, and `anchors` (nearest surfel and the epoch that last saw
// through it, by row), `surfels`, `bricks` (a table with a power of two of slots: a brick's place,
// and its id + 1 or 0) and `cells` (first surfel and the epoch since which it is free or 0; CELLS
// a brick). Constants: CELLS (8³), NEAR_M (how far cells are searched), and those of
// `PriorField::measure`: BESIDE, FAR_BEHIND, FAR_BESIDE.
#import lib/constants
#import lib/draw
#import lib/octree
#import lib/places

struct Surfel {
  position: vec3f,
  // The next of the same cell, or NONE.
  next: u32,
  normal: vec3f,
  // The epoch that made it; from 1.
  born: u32,
}

// What the surfels say of a point.
struct Label {
  known: bool,
  distance: f32,
}

// A search for the nearest surfel: the best so far, its squared distance, and the brick that was
// looked up last.
struct Search {
  best: u32,
  reach: f32,
  brick: vec3i,
  id: u32,
}

// A brick's id; NONE if there is none.
fn find_brick(brick: vec3i) -> u32 {
  let mask = arrayLength(&bricks) - 1u;
  let start = place_slot(brick);
  for (var i = 0u; i <= mask; i += 1u) {
    let entry = bricks[(start + i) & mask];
    if entry.w == 0 || all(entry.xyz == brick) {
      return u32(entry.w) - 1u;
    }
  }
  return NONE;
}

// A cell's index within its brick.
fn cell_index(cell: vec3i) -> u32 {
  let c = vec3u(cell & vec3i(7));
  return c.x | (c.y << 3u) | (c.z << 6u);
}

fn distance_squared(a: vec3f, b: vec3f) -> f32 {
  let offset = a - b;
  return dot(offset, offset);
}

fn search_cell(cell: vec3i, point: vec3f, search: ptr<function, Search>) {
  let brick = cell >> vec3u(3u);
  if any(brick != (*search).brick) {
    (*search).brick = brick;
    (*search).id = find_brick(brick);
  }
  if (*search).id == NONE {
    return;
  }
  var id = cells[(*search).id * CELLS + cell_index(cell)].x;
  while id != NONE {
    let reach = distance_squared(point, surfels[id].position);
    if reach < (*search).reach {
      (*search).best = id;
      (*search).reach = reach;
    }
    id = surfels[id].next;
  }
}

// Searches the cells that the ball around a point touches, the own cell first: it shrinks the ball
// most.
fn search_around(point: vec3f, search: ptr<function, Search>) {
  let radius = vec3f(sqrt((*search).reach));
  let home = vec3i(floor(point / draw.cell_m));
  (*search).brick = home >> vec3u(3u);
  (*search).id = find_brick((*search).brick);
  search_cell(home, point, search);
  let low = vec3i(floor((point - radius) / draw.cell_m));
  let high = vec3i(floor((point + radius) / draw.cell_m));
  for (var z = low.z; z <= high.z; z += 1) {
    for (var y = low.y; y <= high.y; y += 1) {
      for (var x = low.x; x <= high.x; x += 1) {
        let cell = vec3i(x, y, z);
        let corner = vec3f(cell) * draw.cell_m;
        let nearest = clamp(point, corner, corner + vec3f(draw.cell_m));
        if any(cell != home) && distance_squared(point, nearest) < (*search).reach {
          search_cell(cell, point, search);
        }
      }
    }
  }
}

// Signed distance of a point to a surfel as a disc.
fn disc_distance(surfel: Surfel, point: vec3f) -> f32 {
  let offset = point - surfel.position;
  let height = dot(offset, surfel.normal);
  let lateral = offset - surfel.normal * height;
  let reach = length(lateral);
  if reach <= draw.radius_m {
    return height;
  }
  let to_rim = max(length(offset - lateral * (draw.radius_m / reach)), 1e-9);
  if to_rim < RIM_SHARE * draw.radius_m {
    return height;
  }
  return select(to_rim, -to_rim, height < 0.0);
}

// The epoch since which the cell around a point is free; 0 if it is not.
fn free_since(point: vec3f) -> u32 {
  let cell = vec3i(floor(point * draw.inverse_cell));
  let id = find_brick(cell >> vec3u(3u));
  if id == NONE {
    return 0u;
  }
  return cells[id * CELLS + cell_index(cell)].y;
}

// Signed distance of a point to the observed surface.
fn label(point: vec3f) -> Label {
  let voxel = find_voxel(point);
  if voxel == NONE {
    return Label(false, 0.0);
  }
  let node = voxel_node(voxel);
  var search: Search;
  search.best = NONE;
  search.reach = 3.4e38;
  var last = NONE;
  for (var k = 0u; k < 8u; k += 1u) {
    let id = anchors[corners[node][k]].x;
    if id != NONE && id != last {
      last = id;
      let reach = distance_squared(point, surfels[id].position);
      if reach < search.reach {
        search.best = id;
        search.reach = reach;
      }
    }
  }
  if search.best == NONE {
    return Label(false, 0.0);
  }
  if search.reach < NEAR_M * NEAR_M {
    search_around(point, &search);
  }
  let place = voxel_box(point, voxel_log2(voxel));
  let upper_half = (point - place.xyz) / place.w >= vec3f(0.5);
  let corner = dot(select(vec3u(0u), vec3u(1u, 2u, 4u), upper_half), vec3u(1u));
  let surfel = surfels[search.best];
  let distance = disc_distance(surfel, point);
  if distance < 0.0 {
    let height = dot(point - surfel.position, surfel.normal);
    let is_beside = abs(height) < BESIDE * -distance;
    let since = select(surfel.born, 1u, is_beside);
    let far = select(FAR_BEHIND, FAR_BESIDE, is_beside);
    let seen = anchors[corners[node][corner]].y >= since;
    if seen || (distance < -far * draw.cell_m && free_since(point) >= since) {
      return Label(true, -distance);
    }
  }
  return Label(true, distance);
}
