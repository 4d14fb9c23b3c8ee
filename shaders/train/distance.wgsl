// The signed distance of a step, fused: gather, decoder, losses, backward, scatter. A workgroup
// owns every lanes-th tile of samples; within a tile, one evaluation is a sample or a point of its
// stencil. Twin: src/backend/cpu/chunk.rs. Constants: POINTS (evaluations of a sample: 7 for
// central differences, 4 for forward ones), OCCUPANCY (1: the logits of this step are there), and
// those of lib/decoder.
#import lib/step
#import lib/sample
#import lib/losses
#import lib/backward
#import lib/field
#import lib/scatter

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> corners: array<array<u32, 8>>;
@group(0) @binding(2) var<storage, read> prior: array<vec4f>;
@group(0) @binding(3) var<storage, read> learned: array<vec4f>;
@group(0) @binding(4) var<storage, read> samples: array<Sample>;
@group(0) @binding(5) var<storage, read> sites: array<Site>;
@group(0) @binding(6) var<storage, read> counts: array<u32, 6>;
@group(0) @binding(7) var<storage, read> logits: array<f32>;
@group(0) @binding(8) var<storage, read> weights: array<vec4f>;
@group(0) @binding(9) var<storage, read_write> partials: array<vec4f>;
@group(0) @binding(10) var<storage, read_write> gradients: array<atomic<i32>>;
@group(0) @binding(11) var<storage, read_write> flags: array<atomic<u32>>;
// Rows that the step touched; [0] is their number.
@group(0) @binding(12) var<storage, read_write> touched: array<atomic<u32>>;

const TILE_SAMPLES = TILE / POINTS;

// By evaluation: the sample's first evaluation in the same voxel.
var<workgroup> leaders: array<u32, TILE>;

// The losses that this invocation has seen, in the order of the host's Losses.
var<private> losses: array<f32, LOSSES>;

fn evaluation_point(sample: Sample, j: u32) -> vec3f {
  if j == 0u {
    return sample.point;
  }
  return sample.point + stencil_offset(j - 1u);
}

fn evaluation_voxel(site: u32, j: u32) -> u32 {
  let centre = sites[site].centre;
  if j == 0u || centre == NONE {
    return centre;
  }
  if sites[site].around[0] == NONE {
    return NONE;
  }
  return sites[site].around[j - 1u];
}

// What rows say of the tile's evaluations, by four invocations each.
fn gather(t: u32, tile: u32) {
  let evaluation = t / 4u;
  let j = evaluation % POINTS;
  let index = tile * TILE_SAMPLES + evaluation / POINTS;
  var voxel = NONE;
  var point = vec3f(0.0);
  if evaluation < TILE_SAMPLES * POINTS && index < step.samples {
    voxel = evaluation_voxel(index, j);
    point = evaluation_point(samples[index], j);
  }
  gather_at(t, voxel, point);
}

// One evaluation's d_ga, context and leader.
fn prepare(evaluation: u32) {
  sum_up(evaluation);
  by_outputs[evaluation] = 0.0;
  var leader = evaluation / POINTS * POINTS;
  while leader < evaluation && nodes[leader] != nodes[evaluation] {
    leader += 1u;
  }
  leaders[evaluation] = leader;
}

fn per(weight: f32, count: u32) -> f32 {
  return weight / f32(max(count, 1u));
}

// The losses of one sample, and ∂L/∂f at its evaluations.
fn lose(index: u32, first: u32) {
  let sample = samples[index];
  let found = found_at(first);
  let near = counts[3u + PERTURBED] + counts[3u + SURFACE];
  let distance = absolute_loss(found, sample.distance);
  let factor = per(step.distance_weights[sample.kind], counts[sample.kind]);
  var total = factor * distance.value;
  var by_found = factor * distance.slope;
  losses[2u - sample.kind] += distance.value;
  if nodes[first + 1u] != NONE {
    let is_free = sample.kind == FREE;
    let eikonal_factor =
      per(step.eikonal_weights[sample.kind], select(near, counts[3u + FREE], is_free));
    let loss = eikonal(first, eikonal_factor, &by_found);
    total += eikonal_factor * loss;
    losses[select(3u, 4u, is_free)] += loss;
  }
  if OCCUPANCY == 1u && sample.kind != SURFACE {
    let loss = consistency_loss(found, logits[index]);
    let consistency_factor = per(step.consistency_weight, counts[FREE] + counts[PERTURBED]);
    total += consistency_factor * loss.value;
    by_found += consistency_factor * loss.slope;
    losses[6] += loss.value;
  }
  by_outputs[first] = by_found;
  losses[7] += total;
}

// The Eikonal loss of a sample with a stencil.
fn eikonal(first: u32, factor: f32, by_found: ptr<function, f32>) -> f32 {
  let high = vec3f(found_at(first + 1u), found_at(first + 2u), found_at(first + 3u));
  if POINTS == 7u {
    // Indices stay in the tile where POINTS is 4 and nobody comes here.
    let low = vec3f(
      found_at(first + (POINTS - 3u)),
      found_at(first + (POINTS - 2u)),
      found_at(first + (POINTS - 1u)),
    );
    let step_m = 2.0 * STENCIL_M;
    let loss = eikonal_loss((high - low) / step_m);
    for (var axis = 0u; axis < 3u; axis += 1u) {
      by_outputs[first + 1u + axis] = factor * loss[axis] / step_m;
      by_outputs[first + (POINTS - 3u) + axis] = -factor * loss[axis] / step_m;
    }
    return loss.w;
  }
  let loss = eikonal_loss((high - vec3f(found_at(first))) / STENCIL_M);
  for (var axis = 0u; axis < 3u; axis += 1u) {
    by_outputs[first + 1u + axis] = factor * loss[axis] / STENCIL_M;
  }
  *by_found -= factor * (loss.x + loss.y + loss.z) / STENCIL_M;
  return loss.w;
}

// Adds the tile's derivatives to the rows' gradients: one item is a quad of a corner of a sample's
// voxel, summed over the evaluations that share it, or of a voxel that only its stencil reaches.
fn scatter(t: u32) {
  for (var item = t; item < TILE_SAMPLES * 8u * QUADS; item += THREADS) {
    let quad = item % QUADS;
    let corner = item / QUADS % 8u;
    let first = item / (8u * QUADS) * POINTS;
    for (var j = 0u; j < POINTS; j += 1u) {
      let leader = first + j;
      if nodes[leader] == NONE || leaders[leader] != leader {
        continue;
      }
      var sum = vec4f(0.0);
      for (var i = leader; i < first + POINTS; i += 1u) {
        if leaders[i] == leader {
          sum += by_corner(i, corner, quad);
        }
      }
      scatter_to(corners[nodes[leader]][corner], quad, sum);
    }
  }
}

@compute @workgroup_size(128)
fn main(
  @builtin(local_invocation_index) t: u32,
  @builtin(workgroup_id) group: vec3u,
  @builtin(num_workgroups) groups: vec3u,
) {
  let tiles = (step.samples + TILE_SAMPLES - 1u) / TILE_SAMPLES;
  for (var tile = group.x; tile < tiles; tile += groups.x) {
    gather(t, tile);
    workgroupBarrier();
    if t < TILE {
      prepare(t);
    }
    workgroupBarrier();
    decoder_forward(t);
    let index = tile * TILE_SAMPLES + t;
    if t < TILE_SAMPLES && nodes[t * POINTS] != NONE {
      lose(index, t * POINTS);
    }
    workgroupBarrier();
    decoder_backward(t);
    scatter(t);
    workgroupBarrier();
  }
  decoder_store(t, group.x);
  losses_store(t, group.x, losses);
}
