// What each cube covers of the image, its place in the order from the eye, and how many cubes each
// tile has. Twin: `Lens` in src/map/render/tile/lens.rs. Constants of the host: NEAREST_M (nothing
// nearer to the camera is drawn), SLACK (rounding of projected corners, pixels), SIDE.
//
// The order: cells of the largest size by the steps between them and the eye's, all axes added. A
// ray leaves the eye along every axis, so that each cell that it enters has more than the last.
// Within such a cell, halves on the far side come after those on the eye's, level by level. Two
// cubes of the same place lie on no ray together. This is exact for cubes of all sizes, as the
// descent of the CPU is, and needs no place in the tree.
#import lib/scene
#import lib/eye
#import lib/interpolation
#import lib/pairs

@group(0) @binding(0) var<uniform> scene: Scene;
@group(0) @binding(1) var<uniform> view: View;
@group(0) @binding(2) var<storage, read> cubes: array<Cube>;
@group(0) @binding(3) var<storage, read_write> spans: array<vec4u>;
@group(0) @binding(4) var<storage, read_write> counts: array<atomic<u32>>;

fn order_of(cube: Cube) -> u32 {
  let shift = vec3u(scene.largest_log2);
  let steps = vec3u(abs((cube.low >> shift) - (view.eye_cell >> shift)));
  var order = steps.x + steps.y + steps.z;
  for (var level = scene.largest_log2; level > cube.log2_size; level -= 1u) {
    let half = vec3u(level - 1u);
    let mine = cube.low >> vec3u(level);
    let eyes = view.eye_cell >> vec3u(level);
    let upper_half = (cube.low >> half) & vec3i(1);
    let eyes_half = (view.eye_cell >> half) & vec3i(1);
    // The half on the eye's side: the eye's own where it is in the same cell.
    let first = select(select(vec3i(0), vec3i(1), mine < eyes), eyes_half, mine == eyes);
    let far = vec3u(upper_half ^ first);
    order = (order << 2u) | (far.x + far.y + far.z);
  }
  return order << (2u * cube.log2_size);
}

fn span(cube: Cube) -> vec4u {
  let size = size_m(cube.log2_size);
  let low = from_eye(cube.low);
  var camera: array<vec3f, 8>;
  var least = vec2f(3.4e38);
  var most = vec2f(-3.4e38);
  var in_front = 0u;
  for (var k = 0u; k < 8u; k += 1u) {
    let corner = low + upper(k) * size;
    let at = vec3f(dot(view.x_axis, corner), dot(view.y_axis, corner), dot(view.z_axis, corner));
    camera[k] = at;
    if at.z >= NEAREST_M {
      in_front |= 1u << k;
      least = min(least, at.xy / at.z);
      most = max(most, at.xy / at.z);
    }
  }
  if in_front == 0u {
    return NOWHERE;
  }
  if in_front != 0xffu {
    // Where edges pass the nearest plane.
    for (var edge = 0u; edge < 24u; edge += 1u) {
      let k = edge / 3u;
      let other = k | (1u << (edge % 3u));
      if k != other && (((in_front >> k) ^ (in_front >> other)) & 1u) == 1u {
        let a = camera[k];
        let b = camera[other];
        let at = (a + (b - a) * ((NEAREST_M - a.z) / (b.z - a.z))).xy / NEAREST_M;
        least = min(least, at);
        most = max(most, at);
      }
    }
  }
  let size_px = vec2f(f32(view.width), f32(view.height));
  let first = max(ceil(least * view.camera.xy + view.camera.zw - vec2f(SLACK)), vec2f(0.0));
  let last = min(
    floor(most * view.camera.xy + view.camera.zw + vec2f(SLACK)),
    size_px - vec2f(1.0),
  );
  if any(first > last) {
    return NOWHERE;
  }
  let a = vec2u(first);
  let b = vec2u(last);
  return span_of(a.x, b.x, a.y, b.y, order_of(cube));
}

@compute @workgroup_size(64)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  for (var base = group.x * GROUP; base < view.cubes; base += groups.x * GROUP) {
    var mine = NOWHERE;
    if base + t < view.cubes {
      mine = span(cubes[base + t]);
      spans[base + t] = mine;
    }
    let pairs = deal(t, mine);
    for (var pair = t; pair < pairs; pair += GROUP) {
      atomicAdd(&counts[tile_of(cube_of(pair), pair)], 1u);
    }
    workgroupBarrier();
  }
}
