// The zero-anchored decoder, forwards, for a tile of points by one workgroup; the twin of
// src/modality/decoder. The kernel has the constants INPUTS, FIRST, SECOND (0: one hidden layer),
// SCALE and declares
//
//   weights:  array<vec4f>, read        W1 (input-major), w_c, b, W2 (first-major), w
//
// Hidden units lie along quads; an invocation owns one quad of units at some points. Activations
// never leave registers and workgroup memory.
#import lib/constants

const TILE = 32u;
const THREADS = 128u;

const INPUT_QUADS = INPUTS / 4u;
const FIRST_QUADS = FIRST / 4u;
const SECOND_QUADS = SECOND / 4u;
const LAST_QUADS = select(SECOND_QUADS, FIRST_QUADS, SECOND == 0u);

// Where the parts of the weights begin, in quads.
const CONTEXT_AT = INPUTS * FIRST_QUADS;
const BIAS_AT = CONTEXT_AT + FIRST_QUADS;
const SECOND_AT = BIAS_AT + FIRST_QUADS;
const OUTPUT_AT = SECOND_AT + FIRST * SECOND_QUADS;
const WEIGHT_QUADS = OUTPUT_AT + LAST_QUADS;
const LOSS_QUADS = LOSSES / 4u;
const LANE_QUADS = WEIGHT_QUADS + LOSS_QUADS;

// Points of one invocation, by layer.
const FIRST_POINTS = max(TILE * FIRST_QUADS / THREADS, 1u);
const SECOND_POINTS = max(TILE * SECOND_QUADS / THREADS, 1u);

// Feature rows, and after a backward pass ∂L/∂f.
var<workgroup> features: array<vec4f, TILE * INPUT_QUADS>;
var<workgroup> contexts: array<f32, TILE>;
var<workgroup> outputs: array<f32, TILE>;
// Δ, then in a backward pass ∂L/∂(W1·f).
var<workgroup> change: array<vec4f, TILE * FIRST_QUADS>;
// Sums over a quad, by point; at least THREADS of them.
var<workgroup> sums: array<f32, TILE * max(max(FIRST_QUADS, SECOND_QUADS), 4u)>;

// W1·f + z and W2·Δ of the invocation's points.
var<private> open_first: array<vec4f, FIRST_POINTS>;
var<private> open_second: array<vec4f, SECOND_POINTS>;

fn relu(x: vec4f) -> vec4f {
  return max(x, vec4f(0.0));
}

// D at the tile's points, from `features` and `contexts` into `outputs`. A barrier stands before;
// one stands after.
fn decoder_forward(t: u32) {
  let quad = t % FIRST_QUADS;
  let start = t / FIRST_QUADS * FIRST_POINTS;
  if start < TILE {
    var sum: array<vec4f, FIRST_POINTS>;
    for (var k = 0u; k < INPUT_QUADS; k += 1u) {
      let at = 4u * k * FIRST_QUADS + quad;
      let w = mat4x4f(
        weights[at],
        weights[at + FIRST_QUADS],
        weights[at + 2u * FIRST_QUADS],
        weights[at + 3u * FIRST_QUADS],
      );
      for (var i = 0u; i < FIRST_POINTS; i += 1u) {
        sum[i] += w * features[(start + i) * INPUT_QUADS + k];
      }
    }
    let by_z = weights[CONTEXT_AT + quad];
    let bias = weights[BIAS_AT + quad];
    for (var i = 0u; i < FIRST_POINTS; i += 1u) {
      let z = contexts[start + i] * by_z + bias;
      open_first[i] = sum[i] + z;
      let delta = relu(open_first[i]) - relu(z);
      change[(start + i) * FIRST_QUADS + quad] = delta;
      if SECOND == 0u {
        sums[(start + i) * FIRST_QUADS + quad] = dot(delta, weights[OUTPUT_AT + quad]);
      }
    }
  }
  workgroupBarrier();
  if SECOND > 0u {
    forward_second(t);
    workgroupBarrier();
  }
  if t < TILE {
    var sum = 0.0;
    for (var q = 0u; q < LAST_QUADS; q += 1u) {
      sum += sums[t * LAST_QUADS + q];
    }
    outputs[t] = SCALE * sum;
  }
  workgroupBarrier();
}

fn forward_second(t: u32) {
  let quad = t % max(SECOND_QUADS, 1u);
  let start = t / max(SECOND_QUADS, 1u) * SECOND_POINTS;
  if start >= TILE {
    return;
  }
  var sum: array<vec4f, SECOND_POINTS>;
  for (var k = 0u; k < FIRST_QUADS; k += 1u) {
    let at = SECOND_AT + 4u * k * SECOND_QUADS + quad;
    let w = mat4x4f(
      weights[at],
      weights[at + SECOND_QUADS],
      weights[at + 2u * SECOND_QUADS],
      weights[at + 3u * SECOND_QUADS],
    );
    for (var i = 0u; i < SECOND_POINTS; i += 1u) {
      sum[i] += w * change[(start + i) * FIRST_QUADS + k];
    }
  }
  let by_output = weights[OUTPUT_AT + quad];
  for (var i = 0u; i < SECOND_POINTS; i += 1u) {
    open_second[i] = sum[i];
    sums[(start + i) * SECOND_QUADS + quad] = dot(relu(sum[i]), by_output);
  }
}
