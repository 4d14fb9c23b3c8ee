// Cubes and the tiles that they touch, as pairs that a workgroup deals out evenly: a cube right
// before the camera touches thousands of tiles, most touch a few. The kernel declares `view`.
// Constant of the host: SIDE (pixels along an edge of a tile).

// Invocations of a workgroup, one a cube.
const GROUP = 64u;

// By cube: tiles of all cubes up to it; first column, first row and columns of its tiles.
var<workgroup> ends: array<u32, GROUP>;
var<workgroup> areas: array<vec3u, GROUP>;

// What a cube covers of the image: columns (first, last) and rows (first, last), 16 bits each, and
// its place in the order.
fn span_of(left: u32, right: u32, top: u32, bottom: u32, order: u32) -> vec4u {
  return vec4u(left | (right << 16u), top | (bottom << 16u), order, 0u);
}

// A span that covers nothing.
const NOWHERE = vec4u(1u, 1u, 0u, 0u);

// Takes the spans of the workgroup's cubes, one an invocation; returns the number of pairs.
fn deal(t: u32, span: vec4u) -> u32 {
  let first = vec2u(span.x & 0xffffu, span.y & 0xffffu);
  let last = vec2u(span.x >> 16u, span.y >> 16u);
  var tiles = vec2u(0u);
  if all(first <= last) {
    tiles = last / SIDE - first / SIDE + vec2u(1u);
  }
  areas[t] = vec3u(first / SIDE, max(tiles.x, 1u));
  ends[t] = tiles.x * tiles.y;
  workgroupBarrier();
  for (var reach = 1u; reach < GROUP; reach *= 2u) {
    var before = 0u;
    if t >= reach {
      before = ends[t - reach];
    }
    workgroupBarrier();
    ends[t] += before;
    workgroupBarrier();
  }
  return ends[GROUP - 1u];
}

// The workgroup's cube of a pair.
fn cube_of(pair: u32) -> u32 {
  var cube = 0u;
  for (var reach = GROUP / 2u; reach > 0u; reach /= 2u) {
    if ends[cube + reach - 1u] <= pair {
      cube += reach;
    }
  }
  return cube;
}

// The tile of a pair.
fn tile_of(cube: u32, pair: u32) -> u32 {
  var start = 0u;
  if cube > 0u {
    start = ends[cube - 1u];
  }
  let area = areas[cube];
  let at = pair - start;
  return (area.y + at / area.z) * view.columns + area.x + at % area.z;
}
