// The decoder of lib/decoder, backwards. The kernel declares besides
//
//   partials: array<vec4f>, read_write  gradients by lane, LANE_QUADS each
//
// What an invocation sums for the weights' gradients stays with it from tile to tile, so that sums
// have one order whatever the hardware does.
#import lib/decoder

// Quads of W1's gradient, and rows of a quad of W2's, of one invocation.
const FIRST_ITEMS = max(INPUTS * FIRST_QUADS / THREADS, 1u);
const SECOND_ROWS = max(FIRST * SECOND_QUADS / THREADS, 4u);

// ∂L/∂D, and ∂L/∂c.
var<workgroup> by_outputs: array<f32, TILE>;
var<workgroup> by_contexts: array<f32, TILE>;
// ∂L/∂(W2·Δ).
var<workgroup> by_second: array<vec4f, max(TILE * SECOND_QUADS, 1u)>;

// Gradients of the weights.
var<private> by_first_weights: array<vec4f, FIRST_ITEMS>;
var<private> by_second_weights: array<vec4f, SECOND_ROWS>;
var<private> by_context_weight: vec4f;
var<private> by_bias: vec4f;
var<private> by_output_weight: vec4f;

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
