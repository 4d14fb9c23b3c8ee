// The rays of a step whose colours are compared, one invocation each. A ray whose surface is no
// longer there is left out. Twin: src/train/colors.rs. Constants: those of lib/surfels.
#import lib/step
#import lib/draw
#import lib/radiance
#import lib/random
#import lib/surfels

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> draw: Draw;
@group(0) @binding(2) var<storage, read> links: array<u32>;
@group(0) @binding(3) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(4) var<storage, read> anchors: array<vec2u>;
@group(0) @binding(5) var<storage, read> surfels: array<Surfel>;
@group(0) @binding(6) var<storage, read> bricks: array<vec4i>;
@group(0) @binding(7) var<storage, read> cells: array<vec2u>;
@group(0) @binding(8) var<storage, read> frames: array<Frame>;
// u and v in 16 bits each, and the z-depth, m.
@group(0) @binding(9) var<storage, read> pixels: array<vec2u>;
// Of each pixel, in bytes.
@group(0) @binding(10) var<storage, read> colors: array<u32>;
@group(0) @binding(11) var<storage, read_write> rays: array<Ray>;

// The stream of random numbers, beside those of depth rays.
const STREAM = 3u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
  if id.x >= draw.rays {
    return;
  }
  let words = pcg4d(vec4u(draw.seed, draw.counter, id.x, STREAM));
  let frame = frames[id.x * draw.frames / draw.rays];
  let index = frame.first + multiply_high(words.x, frame.pixels);
  let pixel = pixels[index];
  var ray: Ray;
  ray.origin = frame.origin;
  ray.direction = pixel_direction(frame, pixel.x);
  let bytes = (vec3u(colors[index]) >> vec3u(0u, 8u, 16u)) & vec3u(0xffu);
  ray.color = vec3f(bytes) * (1.0 / 255.0) * frame.gain;
  ray.z = bitcast<f32>(pixel.y);
  let found = label(ray.origin + ray.direction * ray.z);
  if !found.known || abs(found.distance) > draw.stale_m {
    ray.z = -1.0;
  }
  rays[id.x] = ray;
}
