// Distances at vertices, decoded: d + D(c, f), with their gradients. An invocation a row; asks no
// neighbours, so that the decoder's layers stay in registers. Twin: src/modality/decoder, as
// src/map/render/tile/cubes.rs asks it. Constant of the host: MAX_QUADS (of the widest layer).
#import lib/scene
#import modality/sdf

@group(0) @binding(0) var<uniform> scene: Scene;
// (d, g) by row.
@group(0) @binding(1) var<storage, read> rows: array<vec4f>;
// Sixteen halves (bfloat16) a row.
@group(0) @binding(2) var<storage, read> features: array<array<vec4u, 2>>;
// W1 (input-major), w_c, b, W2 (first-major), w.
@group(0) @binding(3) var<storage, read> weights: array<vec4f>;
@group(0) @binding(4) var<storage, read_write> vertices: array<vec4f>;

// Δ, the change by the feature after the first layer.
var<private> change: array<vec4f, MAX_QUADS>;

fn relu(x: vec4f) -> vec4f {
  return max(x, vec4f(0.0));
}

// Number i of a feature.
fn number(feature: array<vec4u, 2>, i: u32) -> f32 {
  var whole = feature;
  let word = whole[i / 8u][(i / 2u) % 4u];
  return bitcast<f32>(select(word << 16u, word & 0xffff0000u, (i & 1u) == 1u));
}

fn decode(feature: array<vec4u, 2>, context: f32) -> f32 {
  let first = scene.first / 4u;
  let second = scene.second / 4u;
  let context_at = scene.inputs * first;
  let second_at = context_at + 2u * first;
  let output_at = second_at + scene.first * second;
  var output = 0.0;
  for (var q = 0u; q < first; q += 1u) {
    let z = context * weights[context_at + q] + weights[context_at + first + q];
    var sum = z;
    for (var i = 0u; i < scene.inputs; i += 1u) {
      sum += number(feature, i) * weights[i * first + q];
    }
    change[q] = relu(sum) - relu(z);
    if second == 0u {
      output += dot(change[q], weights[output_at + q]);
    }
  }
  for (var q = 0u; q < second; q += 1u) {
    var sum = vec4f(0.0);
    for (var k = 0u; k < first; k += 1u) {
      let delta = change[k];
      let at = second_at + 4u * k * second + q;
      sum += delta.x * weights[at];
      sum += delta.y * weights[at + second];
      sum += delta.z * weights[at + 2u * second];
      sum += delta.w * weights[at + 3u * second];
    }
    output += dot(relu(sum), weights[output_at + q]);
  }
  return scene.scale * output;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) groups: vec3u) {
  for (var row = id.x; row < scene.rows; row += groups.x * 64u) {
    let vertex = rows[row];
    let feature = features[row];
    var learned = 0.0;
    if any((feature[0] | feature[1]) != vec4u(0u)) {
      learned = decode(feature, context_of(vertex.x));
    }
    vertices[row] = vec4f(vertex.x + learned, vertex.yzw);
  }
}
