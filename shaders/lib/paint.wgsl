// What colours a pixel's ray met; the twin of `Paint` in src/map/render/patch.rs. The kernel
// declares what lib/color and lib/octree need, `nodes` and `view`. Constants of the host: RIM (how
// far from a voxel's border a colour is read, in its edges), BESIDE_M (how far around its place a
// pixel looks for a colour), BESIDE_WEIGHT (a sample that takes less does not).
#import lib/color
#import lib/octree

struct Paint {
  sum: vec3f,
  weight: f32,
}

// The nearest colour along a ray, or along an axis: the surface of the map is not quite where frames
// saw it, and some of it none saw.
fn color_beside(at: vec3f, direction: vec3f) -> vec4f {
  let spacing = 1.0 / scene.band_scale;
  let steps = i32(ceil(BESIDE_M / spacing));
  var ways = array(normalize(direction), vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), vec3f(0.0, 0.0, 1.0));
  for (var n = 1; n <= steps; n += 1) {
    for (var i = 0u; i < 8u; i += 1u) {
      let point = at + ways[i / 2u] * (spacing * f32(select(n, -n, i % 2u == 1u)));
      let voxel = find_voxel(point);
      if voxel != NONE {
        let color = color_in(nodes[voxel_node(voxel)].block, point);
        if color.w > 0.0 {
          return color;
        }
      }
    }
  }
  return vec4f(0.0);
}

// Adds the colour at a place of a ray in a voxel, given its low corner from the eye and edge length,
// if there is one.
fn add_color(
  paint: ptr<private, Paint>,
  block: u32,
  host: vec4f,
  direction: vec3f,
  t: f32,
  weight: f32,
) {
  // A point on the voxel's border is its own, whatever rounding says: blocks of colour are found by
  // voxel.
  let rim = vec3f(RIM * host.w);
  let low = view.eye + host.xyz;
  let at = view.eye + direction * t;
  var color = color_in(block, clamp(at, low + rim, low + vec3f(host.w) - rim));
  // Worth a search only where it would show.
  if color.w == 0.0 && weight > BESIDE_WEIGHT {
    color = color_beside(at, direction);
  }
  if color.w > 0.0 {
    (*paint).sum += color.xyz * weight;
    (*paint).weight += weight;
  }
}

// The colour of a pixel, if its ray lost more than half of its light.
fn color_of(paint: Paint, opacity: f32) -> vec3f {
  return select(vec3f(0.0), paint.sum / paint.weight, opacity > 0.5 && paint.weight > 0.0);
}
