// The zero-anchored decoder, forwards and backwards, for a tile of points by one workgroup; the
// twin of src/modality/decoder. The kernel has the constants INPUTS, FIRST, SECOND (0: one hidden
// layer), SCALE and declares
//
//   weights:  array<vec4f>, read        W1 (input-major), w_c, b, W2 (first-major), w
//   partials: array<vec4f>, read_write  gradients by lane, LANE_QUADS each
//
// Hidden units lie along quads; an invocation owns one quad of units at some points. Activations
// never leave registers and workgroup memory. What an invocation sums for the weights' gradients
// stays with it from tile to tile, so that sums have one order whatever the hardware does.
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
// Quads of W1's gradient, and rows of a quad of W2's, of one invocation.
const FIRST_ITEMS = max(INPUTS * FIRST_QUADS / THREADS, 1u);
const SECOND_ROWS = max(FIRST * SECOND_QUADS / THREADS, 4u);

// Feature rows, and after the backward pass ∂L/∂f.
var<workgroup> features: array<vec4f, TILE * INPUT_QUADS>;
var<workgroup> contexts: array<f32, TILE>;
var<workgroup> outputs: array<f32, TILE>;
// ∂L/∂D, and ∂L/∂c.
var<workgroup> by_outputs: array<f32, TILE>;
var<workgroup> by_contexts: array<f32, TILE>;
// Δ, then ∂L/∂(W1·f).
var<workgroup> change: array<vec4f, TILE * FIRST_QUADS>;
// ∂L/∂(W2·Δ).
var<workgroup> by_second: array<vec4f, max(TILE * SECOND_QUADS, 1u)>;
// Sums over a quad, by point; at least THREADS of them.
var<workgroup> sums: array<f32, TILE * max(max(FIRST_QUADS, SECOND_QUADS), 4u)>;

// W1·f + z and W2·Δ of the invocation's points.
var<private> open_first: array<vec4f, FIRST_POINTS>;
var<private> open_second: array<vec4f, SECOND_POINTS>;
// Gradients of the weights.
var<private> by_first_weights: array<vec4f, FIRST_ITEMS>;
var<private> by_second_weights: array<vec4f, SECOND_ROWS>;
var<private> by_context_weight: vec4f;
var<private> by_bias: vec4f;
var<private> by_output_weight: vec4f;

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

// After `decoder_forward` at the same points: from `by_outputs`, ∂L/∂f into `features` and ∂L/∂c
// into `by_contexts`; the weights' gradients are added to the invocation's. A barrier stands
// before; one stands after.
fn decoder_backward(t: u32) {
  if SECOND > 0u {
    backward_output(t);
    workgroupBarrier();
    add_second_weights(t);
  }
  backward_change(t);
  workgroupBarrier();
  add_first_weights(t);
  // ∂L/∂f, held until everybody has read the features.
  var by_feature = vec4f(0.0);
  let point = t / INPUT_QUADS;
  if point < TILE {
    let input = 4u * (t % INPUT_QUADS);
    for (var q = 0u; q < FIRST_QUADS; q += 1u) {
      let by = change[point * FIRST_QUADS + q];
      let at = input * FIRST_QUADS + q;
      by_feature += vec4f(
        dot(by, weights[at]),
        dot(by, weights[at + FIRST_QUADS]),
        dot(by, weights[at + 2u * FIRST_QUADS]),
        dot(by, weights[at + 3u * FIRST_QUADS]),
      );
    }
  }
  if t < TILE {
    var sum = 0.0;
    for (var q = 0u; q < FIRST_QUADS; q += 1u) {
      sum += sums[t * FIRST_QUADS + q];
    }
    by_contexts[t] = sum;
  }
  workgroupBarrier();
  if point < TILE {
    features[t] = by_feature;
  }
  workgroupBarrier();
}

// ∂L/∂D to ∂L/∂(W2·Δ), through the last layer and the second relu. Its derivative at 0 is 1, so
// that a zero feature is no dead start.
fn backward_output(t: u32) {
  let quad = t % max(SECOND_QUADS, 1u);
  let start = t / max(SECOND_QUADS, 1u) * SECOND_POINTS;
  if start >= TILE {
    return;
  }
  let weight = weights[OUTPUT_AT + quad];
  for (var i = 0u; i < SECOND_POINTS; i += 1u) {
    let by = SCALE * by_outputs[start + i];
    let open = open_second[i];
    by_output_weight += by * relu(open);
    by_second[(start + i) * SECOND_QUADS + quad] =
      select(vec4f(0.0), by * weight, open >= vec4f(0.0));
  }
}

// The gradient of W2, from Δ and ∂L/∂(W2·Δ).
fn add_second_weights(t: u32) {
  let quad = t % max(SECOND_QUADS, 1u);
  let row = t / max(SECOND_QUADS, 1u) * SECOND_ROWS;
  if row >= FIRST {
    return;
  }
  for (var point = 0u; point < TILE; point += 1u) {
    let by = by_second[point * SECOND_QUADS + quad];
    for (var i = 0u; i < SECOND_ROWS / 4u; i += 1u) {
      let delta = change[point * FIRST_QUADS + row / 4u + i];
      by_second_weights[4u * i] += delta.x * by;
      by_second_weights[4u * i + 1u] += delta.y * by;
      by_second_weights[4u * i + 2u] += delta.z * by;
      by_second_weights[4u * i + 3u] += delta.w * by;
    }
  }
}

// ∂L/∂Δ to ∂L/∂(W1·f), to the context and to the weights of z. Leaves ∂L/∂(W1·f) in `change`.
fn backward_change(t: u32) {
  let quad = t % FIRST_QUADS;
  let start = t / FIRST_QUADS * FIRST_POINTS;
  var by_change: array<vec4f, FIRST_POINTS>;
  if start < TILE {
    if SECOND > 0u {
      for (var k = 0u; k < SECOND_QUADS; k += 1u) {
        let at = SECOND_AT + 4u * quad * SECOND_QUADS + k;
        let w = mat4x4f(
          weights[at],
          weights[at + SECOND_QUADS],
          weights[at + 2u * SECOND_QUADS],
          weights[at + 3u * SECOND_QUADS],
        );
        for (var i = 0u; i < FIRST_POINTS; i += 1u) {
          by_change[i] += by_second[(start + i) * SECOND_QUADS + k] * w;
        }
      }
    } else {
      for (var i = 0u; i < FIRST_POINTS; i += 1u) {
        let by = SCALE * by_outputs[start + i];
        by_change[i] = by * weights[OUTPUT_AT + quad];
        by_output_weight += by * change[(start + i) * FIRST_QUADS + quad];
      }
    }
  }
  // Everybody has read Δ.
  workgroupBarrier();
  if start < TILE {
    let by_z_of_context = weights[CONTEXT_AT + quad];
    let bias = weights[BIAS_AT + quad];
    for (var i = 0u; i < FIRST_POINTS; i += 1u) {
      let context = contexts[start + i];
      let z = context * by_z_of_context + bias;
      let by_open = select(vec4f(0.0), by_change[i], open_first[i] > vec4f(0.0));
      let by_z = by_open - select(vec4f(0.0), by_change[i], z > vec4f(0.0));
      by_bias += by_z;
      by_context_weight += context * by_z;
      sums[(start + i) * FIRST_QUADS + quad] = dot(by_z, by_z_of_context);
      change[(start + i) * FIRST_QUADS + quad] = by_open;
    }
  }
}

// The gradient of W1, from the features and ∂L/∂(W1·f).
fn add_first_weights(t: u32) {
  for (var i = 0u; i < FIRST_ITEMS; i += 1u) {
    let item = t + i * THREADS;
    if item < INPUTS * FIRST_QUADS {
      let input = item / FIRST_QUADS;
      let quad = item % FIRST_QUADS;
      var sum = vec4f(0.0);
      for (var point = 0u; point < TILE; point += 1u) {
        let feature = features[point * INPUT_QUADS + input / 4u][input % 4u];
        sum += feature * change[point * FIRST_QUADS + quad];
      }
      by_first_weights[i] += sum;
    }
  }
}

// Leaves the weights' gradients of all tiles so far in the lane's part of `partials`.
fn decoder_store(t: u32, lane: u32) {
  let base = lane * LANE_QUADS;
  for (var i = 0u; i < FIRST_ITEMS; i += 1u) {
    let item = t + i * THREADS;
    if item < INPUTS * FIRST_QUADS {
      partials[base + item] = by_first_weights[i];
    }
  }
  if SECOND > 0u {
    let quad = t % max(SECOND_QUADS, 1u);
    let row = t / max(SECOND_QUADS, 1u) * SECOND_ROWS;
    if row < FIRST {
      for (var i = 0u; i < SECOND_ROWS; i += 1u) {
        partials[base + SECOND_AT + (row + i) * SECOND_QUADS + quad] = by_second_weights[i];
      }
    }
  }
  store_sum(t, base + CONTEXT_AT, by_context_weight, FIRST_QUADS);
  store_sum(t, base + BIAS_AT, by_bias, FIRST_QUADS);
  store_sum(t, base + OUTPUT_AT, by_output_weight, LAST_QUADS);
}

// Sums what the invocations have for their quad of units, over their points.
fn store_sum(t: u32, at: u32, value: vec4f, quads: u32) {
  workgroupBarrier();
  change[t] = value;
  workgroupBarrier();
  if t < quads {
    var sum = vec4f(0.0);
    for (var i = t; i < THREADS; i += quads) {
      sum += change[i];
    }
    partials[at + t] = sum;
  }
}

// Leaves the losses of all tiles behind the weights' gradients.
fn losses_store(t: u32, lane: u32, losses: array<f32, LOSSES>) {
  var mine = losses;
  var whole: array<f32, LOSSES>;
  for (var l = 0u; l < LOSSES; l += 1u) {
    workgroupBarrier();
    sums[t] = mine[l];
    workgroupBarrier();
    if t == 0u {
      for (var i = 0u; i < THREADS; i += 1u) {
        whole[l] += sums[i];
      }
    }
  }
  if t == 0u {
    for (var q = 0u; q < LOSS_QUADS; q += 1u) {
      partials[lane * LANE_QUADS + WEIGHT_QUADS + q] =
        vec4f(whole[4u * q], whole[4u * q + 1u], whole[4u * q + 2u], whole[4u * q + 3u]);
    }
  }
}
