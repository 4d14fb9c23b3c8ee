// One Adam step of a decoder: an invocation owns one quad of its weights, sums their gradient over
// the lanes in their order, and steps it; behind the weights lie the losses, which are summed
// alike. Twin: DecoderMemory in src/backend/cpu/mod.rs. Constant: LANE_QUADS.
#import lib/step
#import lib/adam

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> partials: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> weights: array<vec4f>;
@group(0) @binding(3) var<storage, read_write> first_moments: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> second_moments: array<vec4f>;
@group(0) @binding(5) var<storage, read_write> losses: array<vec4f>;
// x: the number of lanes; then y more from lane z on.
@group(0) @binding(6) var<uniform> lanes: vec4u;
@group(0) @binding(7) var<storage, read> touched: array<u32>;
// t by quad of weights: every invocation counts its own.
@group(0) @binding(8) var<storage, read_write> decoder_steps: array<u32>;

const WEIGHT_QUADS = LANE_QUADS - LOSSES / 4u;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
  let quad = id.x;
  if quad >= LANE_QUADS {
    return;
  }
  var sum = vec4f(0.0);
  for (var lane = 0u; lane < lanes.x; lane += 1u) {
    sum += partials[lane * LANE_QUADS + quad];
  }
  for (var lane = lanes.z; lane < lanes.z + lanes.y; lane += 1u) {
    sum += partials[lane * LANE_QUADS + quad];
  }
  if quad >= WEIGHT_QUADS {
    losses[quad - WEIGHT_QUADS] = sum;
    return;
  }
  // Without a sample nothing is stepped.
  if touched[0] == 0u {
    return;
  }
  var memory = Moments(first_moments[quad], second_moments[quad]);
  weights[quad] -= adam(&memory, sum, decoder_steps[quad] + 1u, step.decoder_rate);
  decoder_steps[quad] += 1u;
  first_moments[quad] = memory.first;
  second_moments[quad] = memory.second;
}
