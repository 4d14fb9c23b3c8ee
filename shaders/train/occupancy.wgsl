// The occupancy of a step, fused: gather, decoder, cross-entropy, backward, scatter. A workgroup
// owns every lanes-th tile of samples. It runs before train/distance, which reads the logits.
// Twin: src/backend/cpu/chunk.rs. Constants: those of lib/decoder.
#import lib/step
#import lib/sample
#import lib/lattice
#import lib/interpolation
#import lib/losses
#import lib/backward
#import lib/gradients
#import modality/sdf
#import modality/occupancy

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(2) var<storage, read> prior: array<vec4f>;
@group(0) @binding(3) var<storage, read> learned: array<vec4f>;
@group(0) @binding(4) var<storage, read> samples: array<Sample>;
@group(0) @binding(5) var<storage, read> sites: array<Site>;
@group(0) @binding(6) var<storage, read> counts: array<u32, 6>;
@group(0) @binding(7) var<storage, read_write> logits: array<f32>;
@group(0) @binding(8) var<storage, read> weights: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> partials: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> gradients: array<atomic<i32>>;
@group(0) @binding(11) var<storage, read_write> flags: array<atomic<u32>>;

var<workgroup> places: array<vec4f, TILE>;
var<workgroup> nodes: array<u32, TILE>;
var<workgroup> distances: array<f32, TILE>;

var<private> losses: array<f32, LOSSES>;

// Interpolates features and d_ga. Four invocations a sample: two of them a quad of the feature
// each, all of them d_ga's share of two corners.
fn gather(t: u32, tile: u32) {
  let local = t / 4u;
  let part = t % 4u;
  let index = tile * TILE + local;
  var voxel = NONE;
  if index < step.samples {
    voxel = sites[index].centre;
  }
  var feature = vec4f(0.0);
  var share = 0.0;
  var place = vec4f(0.0, 0.0, 0.0, 1.0);
  if voxel != NONE {
    let point = samples[index].point;
    let box = voxel_box(point, voxel_log2(voxel));
    place = vec4f(point - box.xyz, box.w);
    for (var k = 0u; k < 8u; k += 1u) {
      let row = corners[voxel_node(voxel)][k];
      let weight = corner_weight(place, k);
      if part < INPUT_QUADS {
        feature += weight * learned[row * ROW_QUADS + OCCUPANCY_QUAD + part];
      }
      if k / 2u == part {
        let vertex = prior[row] + learned[row * ROW_QUADS + EXPLICIT_QUAD];
        share += weight * extrapolated(place, k, vertex);
      }
    }
  }
  if part < INPUT_QUADS {
    features[local * INPUT_QUADS + part] = feature;
  }
  sums[t] = share;
  if part == 0u {
    places[local] = place;
    nodes[local] = select(voxel_node(voxel), NONE, voxel == NONE);
  }
}

// The loss of one sample, and ∂L/∂D.
fn lose(index: u32, local: u32) {
  let sample = samples[index];
  let logit = prior_logit(distances[local]) + outputs[local];
  logits[index] = logit;
  let loss = cross_entropy(logit, sample.occupancy);
  let factor =
    step.occupancy_weight / f32(max(counts[FREE] + counts[PERTURBED] + counts[SURFACE], 1u));
  by_outputs[local] = factor * loss.slope;
  losses[5] += loss.value;
  losses[7] += factor * loss.value;
}

// Adds the tile's derivatives to the rows' gradients: one item is a quad of a corner of a sample's
// voxel. Distance is a constant to occupancy.
fn scatter(t: u32) {
  for (var item = t; item < TILE * 8u * INPUT_QUADS; item += THREADS) {
    let quad = item % INPUT_QUADS;
    let corner = item / INPUT_QUADS % 8u;
    let local = item / (8u * INPUT_QUADS);
    if nodes[local] != NONE {
      let row = corners[nodes[local]][corner];
      let by = corner_weight(places[local], corner) * features[local * INPUT_QUADS + quad];
      add_gradient(row, OCCUPANCY_QUAD + quad, by, vec4f(OCCUPANCY_UNITS));
      if quad == 0u {
        atomicOr(&flags[row], OCCUPIED);
      }
    }
  }
}

@compute @workgroup_size(128)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  let tiles = (step.samples + TILE - 1u) / TILE;
  for (var tile = group.x; tile < tiles; tile += groups.x) {
    gather(t, tile);
    workgroupBarrier();
    if t < TILE {
      let at = 4u * t;
      let distance = (sums[at] + sums[at + 1u]) + (sums[at + 2u] + sums[at + 3u]);
      distances[t] = distance;
      contexts[t] = context_of(distance);
      by_outputs[t] = 0.0;
    }
    workgroupBarrier();
    decoder_forward(t);
    if t < TILE && nodes[t] != NONE {
      lose(tile * TILE + t, t);
    }
    workgroupBarrier();
    decoder_backward(t);
    scatter(t);
    workgroupBarrier();
  }
  decoder_store(t, group.x);
  losses_store(t, group.x, losses);
}
