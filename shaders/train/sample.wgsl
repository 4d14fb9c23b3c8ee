// The samples of a step: rays of the window's frames, four invocations a ray, of which each draws
// and labels one sample: on the surface, in free space, and twice around the surface. A ray whose
// surface is no longer there leaves its slots empty. Twin: src/train/rays.rs. Constants:
// FREE_START_M, FREE_END_M, PERTURBED_M, PERTURBED_LIMIT_M, and those of lib/surfels.
#import lib/step
#import lib/draw
#import lib/sample
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
@group(0) @binding(10) var<storage, read_write> samples: array<Sample>;

// Whether a ray's surface is there.
var<workgroup> is_there: array<u32, 16>;

// The z-depth of a ray's slot, m.
fn depth_of(slot: u32, surface_m: f32, words: vec4u, more: vec4u) -> f32 {
  if slot == 0u {
    return surface_m;
  }
  if slot == 1u {
    let top = max(surface_m - FREE_END_M, FREE_START_M + FREE_END_M);
    return FREE_START_M + unit(words.y) * (top - FREE_START_M);
  }
  let pair = select(words.zw, more.xy, slot == 3u);
  let offset = normal(pair.x, pair.y) * PERTURBED_M;
  return surface_m + clamp(offset, -PERTURBED_LIMIT_M, PERTURBED_LIMIT_M);
}

fn draw_sample(ray: u32, slot: u32) -> Sample {
  let words = pcg4d(vec4u(draw.seed, draw.counter, ray, 0u));
  let more = pcg4d(vec4u(draw.seed, draw.counter, ray, 1u));
  let last = pcg4d(vec4u(draw.seed, draw.counter, ray, 2u));
  let frame = frames[ray * draw.frames / draw.rays];
  let pixel = pixels[frame.first + multiply_high(words.x, frame.pixels)];
  let direction = pixel_direction(frame, pixel.x);
  let depth = depth_of(slot, bitcast<f32>(pixel.y), words, more);
  var sample: Sample;
  sample.point = frame.origin + direction * depth;
  let found = label(sample.point);
  sample.distance = found.distance;
  sample.kind = NONE;
  var coin = more.w;
  if slot == 0u {
    sample.occupancy = 0.75;
    if found.known && abs(found.distance) <= draw.stale_m {
      sample.kind = SURFACE;
    }
  } else if slot == 1u {
    coin = last.x;
    // What was measured free is free, whatever a neighbouring surfel's plane says.
    if found.known && found.distance >= 0.0 {
      sample.kind = FREE;
    }
  } else {
    coin = select(last.y, last.z, slot == 3u);
    sample.occupancy = select(0.0, 1.0, found.distance < 0.0);
    if found.known {
      sample.kind = PERTURBED;
    }
  }
  sample.eikonal = u32(unit(coin) < draw.eikonal_share);
  return sample;
}

@compute @workgroup_size(64)
fn main(
  @builtin(global_invocation_id) id: vec3u,
  @builtin(local_invocation_index) local: u32,
) {
  let slot = id.x % 4u;
  var sample: Sample;
  sample.kind = NONE;
  if id.x < step.samples {
    sample = draw_sample(id.x / 4u, slot);
  }
  if slot == 0u {
    is_there[local / 4u] = u32(sample.kind != NONE);
  }
  workgroupBarrier();
  if is_there[local / 4u] == 0u {
    sample.kind = NONE;
  }
  if id.x < step.samples {
    samples[id.x] = sample;
  }
}
